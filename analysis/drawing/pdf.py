"""Pages of black rectangles, lines and letters at true size, as a PDF that needs no library."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

POINTS_PER_MM = 72.0 / 25.4

LETTER_WIDTH = 0.6
"""Of Courier, over its size."""

Rectangle = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Text:
    """A line of letters; `x` and `y` in mm are the left end of its base line, `size` in mm is its height.

    Attributes
    ----------
    x, y, size : float
    text : str
        What Latin-1 does not have is shown as a question mark.
    upwards : bool
        Whether it runs up the page.
    """

    x: float
    y: float
    size: float
    text: str
    upwards: bool = False

    @property
    def rectangle(self) -> Rectangle:
        """What the letters cover: left, top, right and bottom, mm."""
        length, above, below = LETTER_WIDTH * self.size * len(self.text), 0.8 * self.size, 0.25 * self.size
        if self.upwards:
            return (self.x - above, self.y - length, self.x + below, self.y)
        return (self.x, self.y - above, self.x + length, self.y + below)


@dataclass(frozen=True, slots=True)
class Page:
    """A page; millimetres from its top left corner, x right and y down.

    Attributes
    ----------
    size : tuple of float
        Width and height.
    shapes : tuple of tuple of Rectangle
        Left, top, right and bottom of black rectangles. Those of one shape may touch: no white is seen between them.
    texts : tuple of Text
    """

    size: tuple[float, float]
    shapes: tuple[tuple[Rectangle, ...], ...]
    texts: tuple[Text, ...]


def pdf(pages: Sequence[Page], title: str) -> bytes:
    """Return a PDF that asks to be printed as it is: not scaled, on one side, on paper of its own size."""
    kids = " ".join(f"{4 + 2 * i} 0 R" for i in range(len(pages)))
    preferences = "<< /PrintScaling /None /Duplex /Simplex /PickTrayByPDFSize true >>"
    objects = [
        f"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences {preferences} >>".encode(),
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>".encode(),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Courier /Encoding /WinAnsiEncoding >>",
    ]
    for i, page in enumerate(pages):
        objects += [_page_object(page, 5 + 2 * i), _stream("\n".join(_drawn(page)))]
    return _file([*objects, f"<< /Title ({_escaped(title)}) /Producer (halfangle) >>".encode("latin-1", "replace")])


def _page_object(page: Page, content: int) -> bytes:
    width, height = (side * POINTS_PER_MM for side in page.size)
    box = f"[0 0 {width:.4f} {height:.4f}]"
    resources = "<< /Font << /F 3 0 R >> >>"
    return (f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Resources {resources} /Contents {content} 0 R >>").encode()


def _drawn(page: Page) -> Iterator[str]:
    """Yield the operators of a page; its unit is made the millimetre."""
    yield f"{POINTS_PER_MM:.9f} 0 0 {POINTS_PER_MM:.9f} 0 0 cm 0 g"
    for shape in page.shapes:
        # One path, filled at once: edges that rectangles share leave no seam.
        yield from _path(shape, page.size[1])
        yield "f"
    for text in page.texts:
        turn = "0 1 -1 0" if text.upwards else "1 0 0 1"
        place = f"{turn} {text.x:.4f} {page.size[1] - text.y:.4f} Tm"
        yield f"BT /F {text.size:.4f} Tf {place} ({_escaped(text.text)}) Tj ET"


def _path(shape: Iterable[Rectangle], height: float) -> Iterator[str]:
    for left, top, right, bottom in shape:
        yield f"{left:.5f} {height - bottom:.5f} {right - left:.5f} {bottom - top:.5f} re"


def _stream(content: str) -> bytes:
    data = content.encode("latin-1", "replace")
    return b"<< /Length %d >>\nstream\n%s\nendstream" % (len(data), data)


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")


def _file(objects: Sequence[bytes]) -> bytes:
    """Put numbered objects behind each other, with the table of where each begins; the last one is the information."""
    parts = [b"%PDF-1.6\n%\xe2\xe3\xcf\xd3\n"]
    for number, content in enumerate(objects, start=1):
        parts.append(b"%d 0 obj\n%s\nendobj\n" % (number, content))
    starts = [sum(map(len, parts[:i])) for i in range(1, len(parts) + 1)]
    table = b"".join(b"%010d 00000 n \n" % start for start in starts[:-1])
    n = len(objects) + 1
    tail = b"xref\n0 %d\n0000000000 65535 f \n%strailer\n<< /Size %d /Root 1 0 R /Info %d 0 R >>\n"
    return b"".join([*parts, tail % (n, table, n, n - 1), b"startxref\n%d\n%%%%EOF\n" % starts[-1]])
