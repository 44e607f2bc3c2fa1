"""Any text at all as rig.toml, protocol.toml or capture.toml: it is read, or refused by line."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from instrument.config.capture_config import CaptureConfig
from instrument.config.loading import load_protocol, load_rig, load_settings
from instrument.config.tables import SettingsFile
from instrument.files.validation import InvalidInputError

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = (EXAMPLES / "simulated.toml").read_text(encoding="utf-8")
PROTOCOL = (EXAMPLES / "hdr_sweep.toml").read_text(encoding="utf-8")

PIECES = st.sampled_from([
    *RIG.splitlines(), *PROTOCOL.splitlines(), "[", "]", "[[", "]]", "{", "}", "=", ".", '"""', "'", "\\", "\0",
    "\x1b[2J", "nan", "-inf", "1e999", "9" * 5000, "0x_", "9999-12-31", "\u202e", "\r", "\ud7ff", "#", "a.b.c = 1",
    "[a.b]", "[[a]]",
])  # fmt: skip


def attempt(text: str, folder: Path) -> None:
    """Read `text` as each kind of file; only a refusal may come of it."""
    path = folder / "strange.toml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    for read in (load_rig, load_protocol, lambda path: load_settings(CaptureConfig, path)):
        refused = refusal(read, path)
        assert "\x1b" not in refused
        assert refused == "" or ": " in refused


def refusal(read: Callable[[Path], SettingsFile], path: Path) -> str:
    """Return why a file is refused; empty if it is not."""
    try:
        read(path)
    except InvalidInputError as error:
        return str(error)
    return ""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("toml")


LENIENT = settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@LENIENT
@given(text=st.text(max_size=200))
def test_any_text_is_read_or_refused(text: str, folder: Path) -> None:
    attempt(text, folder)


@LENIENT
@given(pieces=st.lists(PIECES, max_size=40), gap=st.sampled_from(["\n", "", " "]))
def test_pieces_of_toml_in_any_order_are_read_or_refused(pieces: list[str], gap: str, folder: Path) -> None:
    attempt(gap.join(pieces), folder)


@LENIENT
@given(data=st.data(), source=st.sampled_from([RIG, PROTOCOL]))
def test_a_changed_line_is_read_or_refused(data: st.DataObject, source: str, folder: Path) -> None:
    lines = source.splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(lines) - 1))
        key = lines[at].partition("=")[0]
        lines[at] = data.draw(PIECES) if "=" not in lines[at] else f"{key} = {data.draw(PIECES)}"
    attempt("\n".join(lines), folder)


@LENIENT
@given(content=st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(content: bytes, folder: Path) -> None:
    path = folder / "bytes.toml"
    path.write_bytes(content)
    refusal(load_rig, path)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 20_000,
        "a = " + "[" * 500 + "]" * 500,
        ".".join(["a"] * 2000) + " = 1",
        "a = " + "{a=" * 3000 + "1" + "}" * 3000,
        "[" + ".".join(["a"] * 3000) + "]",
        "a = " + "9" * 6000,
        "a = [\n" + "1,\n" * 20_000 + "]",
        'a = """\n' + "x\n" * 20_000 + '"""',
        "".join(f"k{i} = 1\n" for i in range(2_000)),
        "".join(f"[[a{i}]]\n" for i in range(2_000)),
    ],
    ids=["brackets", "lists", "names", "tables", "header", "digits", "lines", "text", "keys", "arrays"],
)
def test_what_is_nested_or_long_beyond_reason_is_refused_in_seconds(text: str, tmp_path: Path) -> None:
    begun = time.process_time()
    attempt(text, tmp_path)
    assert time.process_time() - begun < 20


def test_a_list_of_a_hundred_lines_keeps_its_lines(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text("x = [\n" + "1,\n" * 100 + "]\nwrong = 1\n")
    with pytest.raises(InvalidInputError, match=r"rig\.toml:103: unknown key 'wrong'"):
        load_rig(tmp_path / "rig.toml")
