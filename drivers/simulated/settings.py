"""The rig file as the simulator reads it: plain values, checked once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

SCENE_NAMES = ("relief", "plane", "sphere_cap")


@dataclass(frozen=True, slots=True)
class BoardSettings:
    """One printed marker board.

    Attributes
    ----------
    dictionary : str
        Name in `cv2.aruco`, e.g. ``"DICT_4X4_50"``.
    first_id : int
        Of its markers; the others follow.
    squares : tuple of int
        Squares across and down.
    square_mm, marker_mm : float
        Sides.
    corner_mm : tuple of float
        Where its top left corner lies, sample frame.
    """

    dictionary: str
    first_id: int
    squares: tuple[int, int]
    square_mm: float
    marker_mm: float
    corner_mm: tuple[float, float]

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> BoardSettings:
        """Read a ``[[boards]]`` table."""
        across, down = table["squares"]
        left, top = table["corner_mm"]
        return cls(
            dictionary=table["dictionary"],
            first_id=int(table.get("first_id", 0)),
            squares=(int(across), int(down)),
            square_mm=float(table["square_mm"]),
            marker_mm=float(table["marker_mm"]),
            corner_mm=(float(left), float(top)),
        )

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the board in mm."""
        return self.squares[0] * self.square_mm, self.squares[1] * self.square_mm


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """The ``[simulation]`` table: the truth that the analysis has to find out.

    Attributes
    ----------
    seed : int
        Of everything random.
    scene : str
        One of `SCENE_NAMES`.
    light_offset_mm : tuple of float
        Light from lens, camera frame (x right, y down, z forward).
    power_jitter : float
        Relative standard deviation of the light's power from pose to pose.
    warm_up_drift, warm_up_s : float
        Share of the power lost while the light warms up, and the lit seconds that takes.
    distortion : tuple of float
        k1 and k2 of the Brown-Conrady model.
    vignetting : float
        Share of the light lost in the corners of the picture.
    lobe_exponent : float
        The light shines as cos^m about its axis, which is parallel to the camera's.
    mount_rotation_deg, mount_translation_mm : float
        Standard deviation per axis of how the stage stands off its nominal place.
    axis_error_deg : float
        Standard deviation between an axis' read-back and where it truly is.
    focal_length_error, principal_point_px : float
        Standard deviation of the true focal length (relative) and principal point (pixels).
    real_time : bool
        Whether the devices take their time on the computer's clock, not on a virtual one.
    """

    seed: int = 0
    scene: str = "relief"
    light_offset_mm: tuple[float, float, float] = (12.0, 0.0, 0.0)
    power_jitter: float = 0.01
    warm_up_drift: float = 0.02
    warm_up_s: float = 120.0
    distortion: tuple[float, float] = (0.0, 0.0)
    vignetting: float = 0.1
    lobe_exponent: float = 2.0
    mount_rotation_deg: float = 0.5
    mount_translation_mm: float = 0.5
    axis_error_deg: float = 0.02
    focal_length_error: float = 0.003
    principal_point_px: float = 2.0
    real_time: bool = False

    def __post_init__(self) -> None:
        """Refuse a scene that does not exist."""
        if self.scene not in SCENE_NAMES:
            raise ValueError(f"simulation.scene is {self.scene!r}; allowed are {', '.join(SCENE_NAMES)}")

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> SimulationSettings:
        """Read the ``[simulation]`` table; keys that are missing keep their defaults."""
        allowed = [field.name for field in fields(cls)]
        unknown = sorted(set(table) - set(allowed))
        if unknown:
            raise ValueError(f"simulation has no key {', '.join(unknown)}; allowed are {', '.join(allowed)}")
        values: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in table.items()}
        return cls(**values)


@dataclass(frozen=True, slots=True)
class BenchSettings:
    """All that the simulator takes from a rig file; lengths in mm, pictures in pixels."""

    width: int
    height: int
    focal_length_px: float
    working_distance_mm: float
    area_mm: tuple[float, float]
    boards: tuple[BoardSettings, ...]
    simulation: SimulationSettings

    @classmethod
    def from_rig(cls, rig: Mapping[str, Any]) -> BenchSettings:
        """Read a parsed rig.toml; the light stands where the ruler says unless [simulation] knows better."""
        camera, geometry = rig.get("camera", {}), rig.get("geometry", {})
        by_ruler = rig.get("light", {}).get("offset_mm", [12.0, 0.0, 0.0])
        area_x, area_y = geometry.get("area_mm", (60.0, 60.0))
        return cls(
            width=int(camera.get("width", 960)),
            height=int(camera.get("height", 720)),
            focal_length_px=float(camera.get("focal_length_px", 1850.0)),
            working_distance_mm=float(geometry.get("working_distance_mm", 350.0)),
            area_mm=(float(area_x), float(area_y)),
            boards=tuple(BoardSettings.from_table(table) for table in rig.get("boards", ())),
            simulation=SimulationSettings.from_table({"light_offset_mm": by_ruler, **rig.get("simulation", {})}),
        )
