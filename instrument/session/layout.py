"""The layout of a session file: path, type, shape and unit of each dataset, and the format version.

The recorder, the reader, the checks and the tests import this; nobody else writes a path down.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

SCHEMA_VERSION = "1.2"

SCHEMA_ATTRIBUTE = "halfangle_schema"

# Sizes that no real session exceeds; a file that claims more is refused before memory is taken.
MAX_SIZES = {"P": 100_000, "E": 256, "H": 65_536, "W": 65_536, "R": 1_000, "F": 1_000, "A": 100_000, "L": 65_536}

MAX_BRACKET_BYTES = 16 * 2**30


class Status(StrEnum):
    """How far a session came."""

    RECORDING = "recording"
    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class Field:
    """One dataset.

    Attributes
    ----------
    path : str
        From the root of the file.
    dtype : str
        As numpy writes it; ``"str"`` is UTF-8 text of any length, ``"S64"`` ASCII of at most 64 bytes;
        ``"frame"`` is u2 or f4, whichever `IMAGES` has.
    shape : tuple of str or int
        ``P`` poses, ``E`` exposures, ``H`` and ``W`` pixels of a frame, ``h`` and ``w`` of a preview,
        ``C`` channels; ``R``, ``F`` and ``A`` pictures for the response, of the flat field and of ambient light;
        ``L`` counts. ``?`` after a letter: frames without channels lack this axis. ``()`` for a single value.
    units : str
        Attribute ``units``; ``""`` for none.
    optional : bool
        Whether a session may lack it.
    """

    path: str
    dtype: str
    shape: tuple[str | int, ...] = ()
    units: str = ""
    optional: bool = False

    @property
    def group(self) -> str:
        """Path of the group that holds it."""
        return self.path.rpartition("/")[0]

    @property
    def name(self) -> str:
        """Last part of the path."""
        return self.path.rpartition("/")[2]


ENTRY = "/entry"

INSTRUMENT = f"{ENTRY}/instrument"

CAMERA = f"{INSTRUMENT}/camera"

LIGHT = f"{INSTRUMENT}/light"

STAGE = f"{INSTRUMENT}/stage"

SAMPLE = f"{ENTRY}/sample"

TRANSFORMATIONS = f"{SAMPLE}/transformations"

CALIBRATION = f"{ENTRY}/calibration"

BOARDS = f"{CALIBRATION}/boards"

PLAN = f"{ENTRY}/plan"

JOURNAL = f"{ENTRY}/journal"

QUALITY = f"{ENTRY}/quality"

RAW = f"{ENTRY}/raw"

OVERVIEW = f"{ENTRY}/overview"

REFERENCE_GROUP = f"{ENTRY}/reference"

PROCESS = f"{ENTRY}/process_capture"

TITLE = Field(f"{ENTRY}/title", "str")

START_TIME = Field(f"{ENTRY}/start_time", "str")

END_TIME = Field(f"{ENTRY}/end_time", "S40")

UUID = Field(f"{ENTRY}/entry_identifier_uuid", "str")

DESCRIPTION = Field(f"{ENTRY}/experiment_description", "str")

STATUS = Field(f"{ENTRY}/status", "S16")

MAKE, MODEL, SERIAL = (Field(f"{CAMERA}/{name}", "str") for name in ("make", "model", "serial_number"))

BIT_DEPTH = Field(f"{CAMERA}/bit_depth_readout", "i4")

BLACK_LEVEL = Field(f"{CAMERA}/black_level", "f8", units="counts")

SATURATION = Field(f"{CAMERA}/saturation_value", "f8", units="counts")

CONVERSION_GAIN = Field(f"{CAMERA}/conversion_gain", "f8", units="e-/count")

READ_NOISE = Field(f"{CAMERA}/read_noise", "f8", units="e-")

BAYER_PATTERN = Field(f"{CAMERA}/bayer_pattern", "str")

COUNT_TIME = Field(f"{CAMERA}/count_time", "f8", ("E",), "s")

IMAGES = Field(f"{CAMERA}/images", "frame", ("P", "E", "H", "W", "C?"), "counts")

FRAME_OK = Field(f"{CAMERA}/frame_ok", "u1", ("P", "E"))

FRAME_DIGEST = Field(f"{CAMERA}/frame_digest", "S64", ("P", "E"))

TIMESTAMP = Field(f"{CAMERA}/timestamp", "f8", ("P", "E"), "s")

MONOTONIC = Field(f"{CAMERA}/monotonic_ns", "i8", ("P", "E"), "ns")

EXPOSURE_READBACK = Field(f"{CAMERA}/exposure_readback", "f8", ("P", "E"), "s")

SENSOR_TEMPERATURE = Field(f"{CAMERA}/sensor_temperature", "f8", ("P", "E"), "degC")

DARK = Field(f"{CAMERA}/dark", "f4", ("E", "H", "W", "C?"), "counts", optional=True)

DARK_VARIANCE = Field(f"{CAMERA}/dark_variance", "f4", ("E", "H", "W", "C?"), "counts^2", optional=True)

DARK_TIMESTAMP = Field(f"{CAMERA}/dark_timestamp", "f8", ("E",), "s", optional=True)

DARK_TEMPERATURE = Field(f"{CAMERA}/dark_temperature", "f8", ("E",), "degC", optional=True)

FLAT = Field(f"{CAMERA}/flat", "f4", ("H", "W"), optional=True)

BLACK_LEVEL_CELL = Field(f"{CAMERA}/black_level_cell", "f8", (2, 2), "counts", optional=True)

RESPONSE = Field(f"{CAMERA}/response", "f4", ("K", "L"), optional=True)

RESPONSE_IMAGES = Field(f"{CAMERA}/response_images", "frame", ("R", "H", "W", "C?"), "counts", optional=True)

RESPONSE_TIME = Field(f"{CAMERA}/response_time", "f8", ("R",), "s", optional=True)

FLAT_IMAGES = Field(f"{CAMERA}/flat_images", "frame", ("F", "H", "W", "C?"), "counts", optional=True)

FLAT_TIME = Field(f"{CAMERA}/flat_time", "f8", ("F",), "s", optional=True)

FLAT_DISTANCE = Field(f"{CAMERA}/flat_distance", "f8", ("F",), "mm", optional=True)

AMBIENT_IMAGES = Field(f"{CAMERA}/ambient_images", "frame", ("A", "H", "W", "C?"), "counts", optional=True)

AMBIENT_TIME = Field(f"{CAMERA}/ambient_time", "f8", ("A",), "s", optional=True)

AMBIENT_OF_POSE = Field(f"{CAMERA}/ambient_of_pose", "i4", ("P",), optional=True)

LIGHT_TYPE = Field(f"{LIGHT}/type", "str")

LIGHT_SERIAL = Field(f"{LIGHT}/serial_number", "str")

LEVEL_SET = Field(f"{LIGHT}/level_set", "f8", ("P", "E"))

LEVEL_READBACK = Field(f"{LIGHT}/level_readback", "f8", ("P", "E"))

MONITOR = Field(f"{LIGHT}/monitor", "f8", ("P", "E"))

LIGHT_TEMPERATURE = Field(f"{LIGHT}/temperature", "f8", ("P", "E"), "degC")

STAGE_SERIAL = Field(f"{STAGE}/serial_number", "str")

SAMPLE_NAME = Field(f"{SAMPLE}/name", "str")

AREA = Field(f"{CALIBRATION}/area", "f8", (2,), "mm", optional=True)

WORKING_DISTANCE = Field(f"{CALIBRATION}/working_distance", "f8", units="mm", optional=True)

FOCAL_LENGTH = Field(f"{CALIBRATION}/focal_length", "f8", units="pixels", optional=True)

CAMERA_MATRIX = Field(f"{CALIBRATION}/camera_matrix", "f8", (3, 3), "pixels", optional=True)

DISTORTION = Field(f"{CALIBRATION}/distortion", "f8", (5,), optional=True)

LIGHT_OFFSET = Field(f"{CALIBRATION}/light_offset", "f8", (3,), "mm", optional=True)

LIGHT_OFFSET_SIGMA = Field(f"{CALIBRATION}/light_offset_sigma", "f8", (3,), "mm", optional=True)

PIXEL_PITCH = Field(f"{CALIBRATION}/pixel_pitch", "f8", units="mm", optional=True)

BOARDS_JSON = Field(f"{BOARDS}/json", "str")

PLAN_JSON = Field(f"{PLAN}/json", "str")

PLAN_SHA256 = Field(f"{PLAN}/sha256", "S64")

ORDER = Field(f"{PLAN}/order", "i8", ("P",))

POSE_COMPLETE = Field(f"{JOURNAL}/pose_complete", "u1", ("P",))

ATTEMPTS = Field(f"{JOURNAL}/attempts", "u2", ("P",))

POSE_DIGEST = Field(f"{JOURNAL}/pose_digest", "S64", ("P",))

# Of fixed length: a text of any length lies apart from what points to it, and a kill between the two leaves a file that
# can crash the library when it is written again.
EVENTS = Field(f"{JOURNAL}/events", "S1024", ("*",))

MAX_EVENT = 1024

SATURATED_FRACTION = Field(f"{QUALITY}/saturated_fraction", "f8", ("P", "E"))

BLACK_FRACTION = Field(f"{QUALITY}/black_fraction", "f8", ("P", "E"))

REFERENCE = Field(f"{REFERENCE_GROUP}/patch", "f8", ("P",), "counts/s", optional=True)

PREVIEW = Field(f"{OVERVIEW}/preview", "f4", ("P", "h", "w"), "counts/s")

PROGRAM = Field(f"{PROCESS}/program", "str")

PROGRAM_VERSION = Field(f"{PROCESS}/version", "str")

DATE = Field(f"{PROCESS}/date", "str")

SEQUENCE_INDEX = Field(f"{PROCESS}/sequence_index", "i4")

RIG_TEXT = Field(f"{PROCESS}/rig/data", "str", optional=True)

PROTOCOL_TEXT = Field(f"{PROCESS}/protocol/data", "str")

RIG_JSON = Field(f"{PROCESS}/rig_values/data", "str", optional=True)

VERSIONS = Field(f"{PROCESS}/versions/data", "str")

# Every dataset with a fixed name; those of a stage axis and of a board follow below.
FIELDS: tuple[Field, ...] = tuple(value for value in list(globals().values()) if isinstance(value, Field))

AXIS_FIELDS = (
    Field("value", "f8", ("P",)),
    Field("target_value", "f8", ("P",)),
    Field("tolerance", "f8"),
    Field("soft_limit_min", "f8"),
    Field("soft_limit_max", "f8"),
)

BOARD_FIELDS = (
    Field("kind", "str"),
    Field("dictionary", "str"),
    Field("first_id", "i8"),
    Field("squares", "i8", (2,)),
    Field("square_mm", "f8", units="mm"),
    Field("marker_mm", "f8", units="mm"),
    Field("corner_mm", "f8", (2,), "mm"),
)

GROUPS = {
    ENTRY: "NXentry",
    INSTRUMENT: "NXinstrument",
    CAMERA: "NXdetector",
    LIGHT: "NXsource",
    STAGE: "NXcollection",
    SAMPLE: "NXsample",
    TRANSFORMATIONS: "NXtransformations",
    CALIBRATION: "NXcollection",
    BOARDS: "NXcollection",
    PLAN: "NXcollection",
    JOURNAL: "NXcollection",
    QUALITY: "NXdata",
    RAW: "NXdata",
    OVERVIEW: "NXdata",
    PROCESS: "NXprocess",
}

# Notes within the process, with the type of their text.
NOTES = {
    RIG_TEXT: "application/toml",
    PROTOCOL_TEXT: "application/toml",
    RIG_JSON: "application/json",
    VERSIONS: "application/json",
}

# A plot group shows datasets that lie elsewhere: group -> the fields it links to by hard links.
LINKS = {
    QUALITY: (ORDER, COUNT_TIME),
    RAW: (IMAGES, ORDER, COUNT_TIME),
    OVERVIEW: (ORDER,),
}


def axis_field(axis: str, name: str, units: str = "") -> Field:
    """Return the dataset `name` of the stage axis `axis`."""
    return _within(f"{STAGE}/{axis}", next(field for field in AXIS_FIELDS if field.name == name), units)


def board_fields(index: int) -> tuple[Field, ...]:
    """Return the datasets of one marker board."""
    return tuple(_within(board_group(index), field, field.units) for field in BOARD_FIELDS)


def board_group(index: int) -> str:
    """Return the path of one marker board."""
    return f"{BOARDS}/board_{index:02d}"


def _within(group: str, field: Field, units: str) -> Field:
    return Field(f"{group}/{field.path}", field.dtype, field.shape, units)
