"""A protocol in Python: poses along a spiral, evenly spread over the hemisphere up to 50 degrees.

halfangle capture examples/spiral.py --rig examples/simulated.toml -o spiral.h5
"""

import math

name = "spiral"
sample = "demo relief"
bracket = {"exposure_times_s": [0.002, 0.01, 0.05], "darks": 4}

COUNT, LARGEST_TILT_DEG, GOLDEN_ANGLE_DEG = 40, 50.0, 137.50776


def poses():
    """Yield equal shares of the spherical cap; the turntable goes on by the golden angle."""
    cap = 1.0 - math.cos(math.radians(LARGEST_TILT_DEG))
    for i in range(COUNT):
        tilt = math.degrees(math.acos(1.0 - cap * (i + 0.5) / COUNT))
        yield {"tilt": round(tilt, 3), "turn": round(i * GOLDEN_ANGLE_DEG % 360.0, 3)}
