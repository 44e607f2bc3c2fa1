"""Rigs for the tests of the simulated devices."""

from typing import Any

_BOARD = {"kind": "charuco", "dictionary": "DICT_4X4_50", "squares": [4, 4], "square_mm": 5.5, "marker_mm": 4.4}
_CORNERS = ([-54.0, 54.0], [32.0, 54.0], [-54.0, -32.0], [32.0, -32.0])


def small_rig(width: int = 160, height: int = 120, **simulation: Any) -> dict[str, Any]:
    """Return a parsed rig.toml whose pictures render in no time; `simulation` replaces its truth."""
    return {
        "camera": {"driver": "simulated", "width": width, "height": height, "focal_length_px": 1.93 * width},
        "light": {"driver": "simulated", "offset_mm": [12.0, 0.0, 0.0]},
        "stage": {"driver": "simulated"},
        "geometry": {"working_distance_mm": 350.0, "area_mm": [60.0, 60.0]},
        "boards": [{**_BOARD, "first_id": 8 * k, "corner_mm": corner} for k, corner in enumerate(_CORNERS)],
        "simulation": {"seed": 5, "distortion": [-0.08, 0.05], **simulation},
    }
