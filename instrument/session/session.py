"""Reads a session file, lazily; needs numpy and h5py only."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from instrument.files.digests import chain_digest
from instrument.session import layout
from instrument.session.axes import read_axes
from instrument.session.extra_frames import ExtraFrames
from instrument.session.import_plan import is_import
from instrument.session.layout import Status
from instrument.session.nominal import NominalSetup
from instrument.session.reader import SessionReader
from instrument.session.records import AxisRecord, CameraRecord
from instrument.session.structure import axis_names


class Session:
    """One capture, open to read.

    Values are read when they are asked for, and small ones are kept. Indices of poses and exposures
    are those of the plan; poses that were not captured are all zeros and not marked in `pose_complete`.

    Parameters
    ----------
    path : Path or str
        A session file; one that is still being recorded may be read too.

    Raises
    ------
    InvalidInputError
        With everything that is missing, mis-shaped, damaged or points out of the file.

    Attributes
    ----------
    path : Path
    nominal : NominalSetup
        What was configured: boards, area, lens, light, response.
    extra : ExtraFrames
        Pictures for the response, of a flat field and of ambient light.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._reader = SessionReader(path)
        self.nominal = NominalSetup(self._reader)
        self.extra = ExtraFrames(self._reader, self.n_poses)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; safe to call twice."""
        self._reader.close()

    @cached_property
    def n_poses(self) -> int:
        """P, how many poses the plan has."""
        return int(self._reader.file[layout.IMAGES.path].shape[0])

    @property
    def title(self) -> str:
        """Name of the protocol or of the import."""
        return self._reader.text(layout.TITLE)

    @property
    def sample(self) -> str:
        """What lay on the stage."""
        return self._reader.text(layout.SAMPLE_NAME)

    @property
    def start_time(self) -> str:
        """ISO 8601 with the offset from UTC."""
        return self._reader.text(layout.START_TIME)

    @property
    def end_time(self) -> str:
        """ISO 8601; empty while recording and after a kill."""
        return self._reader.text(layout.END_TIME)

    @property
    def status(self) -> Status:
        """How far the capture came."""
        text = self._reader.text(layout.STATUS)
        with self._reader.reading(layout.STATUS):
            return Status(text)

    @cached_property
    def exposure_times(self) -> NDArray[np.float64]:
        """Nominal exposure times, shape (E,), seconds, ascending."""
        return self._reader.array(layout.COUNT_TIME)

    @cached_property
    def camera(self) -> CameraRecord:
        """The camera and its nominal levels."""
        images = self._reader.file[layout.IMAGES.path]
        height, width, *channels = images.shape[2:]
        return CameraRecord(
            make=self._reader.text(layout.MAKE),
            model=self._reader.text(layout.MODEL),
            serial_number=self._reader.text(layout.SERIAL),
            height=int(height),
            width=int(width),
            n_channels=int(channels[0]) if channels else 1,
            dtype=images.dtype.str[1:],
            bit_depth=int(self._reader.scalar(layout.BIT_DEPTH)),
            black_level=self._reader.scalar(layout.BLACK_LEVEL),
            saturation_value=self._reader.scalar(layout.SATURATION),
            bayer_pattern=self._reader.text(layout.BAYER_PATTERN),
            conversion_gain=self._reader.scalar(layout.CONVERSION_GAIN),
            read_noise=self._reader.scalar(layout.READ_NOISE),
        )

    @property
    def serial_numbers(self) -> dict[str, str]:
        """Serial number of the camera, the light and the stage."""
        fields = {"camera": layout.SERIAL, "light": layout.LIGHT_SERIAL, "stage": layout.STAGE_SERIAL}
        return {kind: self._reader.text(field) for kind, field in fields.items()}

    @property
    def pose_complete(self) -> NDArray[np.bool_]:
        """Which poses are whole, shape (P,)."""
        return self._reader.array(layout.POSE_COMPLETE).astype(bool)

    @property
    def frame_ok(self) -> NDArray[np.bool_]:
        """Which frames are valid, shape (P, E)."""
        return self._reader.array(layout.FRAME_OK).astype(bool)

    def frames(self, i_pose: int) -> NDArray[np.uint16]:
        """Return the raw frames of one pose, shape (E, H, W) or (E, H, W, 3), counts.

        They are float32 where the pictures came as floating-point numbers; one that is not valid is 0.

        Raises
        ------
        IndexError
            If there is no such pose.
        InvalidInputError
            If the frames cannot be decoded.
        """
        if not -self.n_poses <= i_pose < self.n_poses:
            raise IndexError(f"pose {i_pose} of {self.n_poses}; allowed is 0 to {self.n_poses - 1}")
        return self._reader.array(layout.IMAGES, i_pose)

    def frame(self, i_pose: int, i_exposure: int) -> NDArray[np.uint16]:
        """Return one raw frame, shape (H, W) or (H, W, 3), counts."""
        return self._reader.array(layout.IMAGES, (i_pose, i_exposure))

    @property
    def has_darks(self) -> bool:
        """Whether the darks are whole; their times are written after them."""
        return layout.DARK.path in self._reader.file and bool(
            np.isfinite(self._reader.array(layout.DARK_TIMESTAMP)).all()
        )

    @property
    def dark(self) -> NDArray[np.float32] | None:
        """Mean dark frame of each exposure time, shape (E, H, W) or (E, H, W, 3), counts; None if not taken."""
        return self._reader.array(layout.DARK) if self.has_darks else None

    @property
    def dark_variance(self) -> NDArray[np.float32] | None:
        """Variance of a single dark frame, shape of `dark`, counts squared; None if not taken.

        NaN where an import had one dark frame only.
        """
        return self._reader.array(layout.DARK_VARIANCE) if self.has_darks else None

    @property
    def dark_timestamps(self) -> NDArray[np.float64]:
        """When the darks were taken, shape (E,), seconds since the start (before it: negative); NaN if not taken."""
        return self._reader.array(layout.DARK_TIMESTAMP)

    @property
    def dark_temperatures(self) -> NDArray[np.float64] | None:
        """Temperature of the sensor at the darks, shape (E,), degrees Celsius; None if not known."""
        return self._reader.optional(layout.DARK_TEMPERATURE)

    @property
    def reference(self) -> NDArray[np.float64] | None:
        """Brightness of the reference patch at each pose, shape (P,), counts per second; None if not measured.

        Tilt and distance are taken out by the rig's nominal geometry, so that it is the drift curve.
        """
        return self._reader.optional(layout.REFERENCE)

    @property
    def axes(self) -> tuple[AxisRecord, ...]:
        """The stage's axes, from the base to the sample; none for an import.

        Raises
        ------
        InvalidInputError
            If the file does not say how they ride on each other.
        """
        return read_axes(self._reader)

    @property
    def axis_values(self) -> dict[str, NDArray[np.float64]]:
        """Read-back of each stage axis, shape (P,), degrees or millimetres; NaN where not captured."""
        return {name: self._reader.array(layout.axis_field(name, "value")) for name in axis_names(self._reader.file)}

    @property
    def exposure_readback(self) -> NDArray[np.float64]:
        """Exposure times as the camera reported them, shape (P, E), seconds."""
        return self._reader.array(layout.EXPOSURE_READBACK)

    @property
    def timestamps(self) -> NDArray[np.float64]:
        """When each frame had been read, shape (P, E), seconds since `start_time`."""
        return self._reader.array(layout.TIMESTAMP)

    @property
    def saturated_fraction(self) -> NDArray[np.float64]:
        """Share of clipped pixels, shape (P, E); NaN where there is no frame."""
        return self._reader.array(layout.SATURATED_FRACTION)

    def preview(self, i_pose: int) -> NDArray[np.float32]:
        """Return a small picture of one pose, shape (h, w), counts per second."""
        return self._reader.array(layout.PREVIEW, i_pose)

    @property
    def plan_json(self) -> str:
        """The plan in canonical form."""
        return self._reader.text(layout.PLAN_JSON)

    @property
    def plan_sha256(self) -> str:
        """Digest of `plan_json`."""
        return self._reader.text(layout.PLAN_SHA256)

    @property
    def is_imported(self) -> bool:
        """Whether it holds pictures from elsewhere instead of a capture."""
        return is_import(self.plan_json)

    @property
    def rig_text(self) -> str:
        """The rig file as its author wrote it; empty for an import."""
        return self._reader.text(layout.RIG_TEXT) if layout.RIG_TEXT.path in self._reader.file else ""

    @property
    def rig_json(self) -> str:
        """The rig's values with the defaults of the day of the capture; empty for an import."""
        return self._reader.text(layout.RIG_JSON) if layout.RIG_JSON.path in self._reader.file else ""

    @property
    def protocol_text(self) -> str:
        """The protocol file, or the `capture.toml` of an import, as its author wrote it."""
        return self._reader.text(layout.PROTOCOL_TEXT)

    @property
    def frame_digests(self) -> list[list[str]]:
        """SHA-256 of each frame, P lists of E; empty texts where there is none."""
        texts = self._reader.texts(layout.FRAME_DIGEST)
        n_exposures = len(self.exposure_times)
        return [texts[i : i + n_exposures] for i in range(0, len(texts), n_exposures)]

    @property
    def pose_digests(self) -> list[str]:
        """SHA-256 over each pose's frame digests, P texts; empty where not captured."""
        return self._reader.texts(layout.POSE_DIGEST)

    @property
    def uuid(self) -> str:
        """What tells this session from all others."""
        return self._reader.text(layout.UUID)

    @property
    def monitor(self) -> NDArray[np.float64]:
        """Reading of the light's own photodiode at each frame, shape (P, E), relative; NaN where there is none."""
        return self._reader.array(layout.MONITOR)

    @property
    def versions(self) -> dict[str, Any]:
        """Versions of what wrote the session, firmware of its devices, digests of its texts and of its calibrations."""
        text = self._reader.text(layout.VERSIONS)
        with self._reader.reading(layout.VERSIONS):
            return dict(json.loads(text))

    @property
    def events(self) -> list[str]:
        """The journal, one JSON line an event."""
        return self._reader.texts(layout.EVENTS)

    def digest(self) -> str:
        """Return the SHA-256 over the plan and the frames of all complete poses, for provenance."""
        complete = zip(self.pose_complete, self.frame_digests, strict=True)
        return chain_digest([self.plan_sha256, *("".join(row) if whole else "-" for whole, row in complete)])
