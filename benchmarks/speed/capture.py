"""What the engine costs besides motion, exposure and readout, and whether the disk sets the pace.

`python -m benchmarks.speed.capture FOLDER` captures brackets of 5 x 2.3 Mpixel on devices that take their time and
nothing else, into FOLDER (the disk to measure), and prints:

- dead time: seconds per pose that are spent in no device, with half a second of motion between poses;
- sustained: the same without any motion, exposure or readout, against writing as many bytes in one go and against the
  recorder alone;
- memory: the largest resident size, for some and for three times as many poses.
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drivers.camera import CameraDescription, Frame
from drivers.light import LightDescription, LightState
from drivers.limits import Limits
from drivers.registry import Devices
from drivers.stage import AxisDescription, StageDescription
from instrument.config.messages import validate
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import RigConfig
from protocols.capture.engine import capture

HEIGHT, WIDTH = 1200, 1920

EXPOSURE_TIMES = (0.001, 0.002, 0.004, 0.008, 0.016)

READOUT, MOTION = 0.012, 0.5

N_POSES = 12


@dataclass
class Stopwatch:
    """Adds up the seconds that are spent in devices."""

    seconds: float = 0.0
    at_move: list[tuple[float, float]] = field(default_factory=list)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Count the block."""
        began = time.perf_counter()
        yield
        self.seconds += time.perf_counter() - began


class TimedCamera:
    """Gives pictures that were made beforehand, with the noise of a sensor, so that they compress as real ones do."""

    def __init__(self, watch: Stopwatch, in_time: bool) -> None:
        self._watch, self._in_time = watch, in_time
        self._time, self._n_triggers, self.lit = EXPOSURE_TIMES[0], 0, False
        rng = np.random.default_rng(0)
        radiance = np.kron(rng.uniform(2e3, 2e5, (HEIGHT // 40, WIDTH // 40)), np.ones((40, 40)))
        self._pictures = {time: _photograph(radiance * time, rng) for time in EXPOSURE_TIMES}
        self._dark = _photograph(0.0 * radiance, rng)

    def connect(self) -> None:
        """Do nothing."""

    def disconnect(self) -> None:
        """Do nothing."""

    def stop(self) -> None:
        """Do nothing."""

    def describe(self) -> CameraDescription:
        """Return a camera of 2.3 Mpixel."""
        limits = Limits(1e-5, 10.0, "s")
        return CameraDescription("bench", "camera", "1", HEIGHT, WIDTH, 12, 64.0, 4095.0, "RGGB", 2.5, 3.0, limits)

    def set_exposure_time(self, exposure_time: float) -> float:
        """Set it."""
        self._time = exposure_time
        return exposure_time

    def trigger(self) -> Frame:
        """Return a picture after exposure and readout."""
        with self._watch.running():
            if self._in_time:
                time.sleep(self._time + READOUT)
            self._n_triggers += 1
            # A copy, as a driver gives one: the engine may keep it.
            counts = (self._pictures[self._time] if self.lit else self._dark).copy()
            return Frame(counts, self._n_triggers, self._time, 30.0)


class TimedLight:
    """Shines at once."""

    def __init__(self, camera: TimedCamera) -> None:
        self._camera = camera

    def connect(self) -> None:
        """Do nothing."""

    def disconnect(self) -> None:
        """Do nothing."""

    def describe(self) -> LightDescription:
        """Return a light."""
        return LightDescription("bench", "light", "1", Limits(0.0, 1.0, ""))

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine."""
        self._camera.lit = True
        return self.read()

    def off(self) -> LightState:
        """Go dark."""
        self._camera.lit = False
        return self.read()

    def read(self) -> LightState:
        """Return the state."""
        return LightState(self._camera.lit, float(self._camera.lit), float(self._camera.lit), 40.0)


class TimedStage:
    """Takes half a second for any motion, settling included."""

    def __init__(self, watch: Stopwatch, in_time: bool) -> None:
        self._watch, self._in_time, self._position = watch, in_time, 0.0

    def connect(self) -> None:
        """Do nothing."""

    def disconnect(self) -> None:
        """Do nothing."""

    def stop(self) -> None:
        """Do nothing."""

    def describe(self) -> StageDescription:
        """Return a turntable."""
        axis = AxisDescription("turn", "rotation", Limits(-360.0, 360.0, "deg"), 0.01, (0.0, 0.0, 1.0))
        return StageDescription("bench", "stage", "1", (axis,))

    def home(self) -> None:
        """Go to zero."""
        self._position = 0.0

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        """Go there."""
        self._watch.at_move.append((time.perf_counter(), self._watch.seconds))
        with self._watch.running():
            time.sleep(MOTION if self._in_time else 0.0)
            self._position = target["turn"]
            return self.read()

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return half a second."""
        return MOTION

    def read(self) -> dict[str, float]:
        """Return where it is."""
        return {"turn": self._position}


def _photograph(electrons: Any, rng: np.random.Generator) -> Any:
    counts = rng.poisson(np.minimum(electrons, 1e4)) / 2.5 + 64.0 + 1.2 * rng.standard_normal(electrons.shape)
    return np.clip(np.rint(counts), 0, 4095).astype(np.uint16)


def run(path: Path, n_poses: int, in_time: bool) -> tuple[Stopwatch, float]:
    """Capture `n_poses` brackets; return the stopwatch and the seconds of the whole run."""
    watch = Stopwatch()
    camera = TimedCamera(watch, in_time)
    devices = Devices(camera, TimedLight(camera), TimedStage(watch, in_time))
    protocol = validate(
        ProtocolConfig,
        {
            "name": "bench",
            "bracket": {"exposure_times_s": EXPOSURE_TIMES, "darks": 0},
            "poses": [{"axes": {"turn": float(i)}} for i in range(n_poses)],
        },
    )
    began = time.perf_counter()
    capture(_rig(), protocol, path, devices=lambda _: devices)
    return watch, time.perf_counter() - began


def _rig() -> RigConfig:
    # The values of a rig file; its devices are the ones above.
    return validate(
        RigConfig,
        {
            "name": "capture speed",
            "camera": {"driver": "simulated", "width": WIDTH, "height": HEIGHT, "focal_length_px": 3600.0},
            "light": {"driver": "simulated", "offset_mm": [12.0, 0.0, 0.0], "offset_sigma_mm": 3.0},
            "stage": {"driver": "simulated"},
            "geometry": {"working_distance_mm": 350.0, "area_mm": [60.0, 60.0]},
        },
    )


def dead_times(watch: Stopwatch) -> list[float]:
    """Return the seconds per pose that were spent in no device, from one motion to the next."""
    pairs = zip(watch.at_move, watch.at_move[1:], strict=False)
    return [(t1 - t0) - (inside1 - inside0) for (t0, inside0), (t1, inside1) in pairs]


def disk_seconds(folder: Path, n_bytes: int) -> float:
    """Return the seconds to write as many bytes in one go and hand them to the disk."""
    block, path = os.urandom(2**22), folder / "plain"
    began = time.perf_counter()
    with path.open("wb", buffering=0) as file:
        for _ in range(n_bytes // len(block)):
            file.write(block)
        os.fsync(file.fileno())
    path.unlink()
    return time.perf_counter() - began


def peak_mb(call: Callable[[], object]) -> float:
    """Return the largest resident size in MB of a child process that makes `call`."""
    child = os.fork()
    if child == 0:
        call()
        os._exit(0)
    _, _, usage = os.wait4(child, 0)
    return usage.ru_maxrss / 1024


def main(folder: Path) -> None:
    """Measure and print."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "s.h5"
    say = sys.stdout.write
    watch, seconds = run(path, N_POSES, in_time=True)
    dead = dead_times(watch)
    say(f"dead time per pose: median {1e3 * statistics.median(dead):.1f} ms, largest {1e3 * max(dead):.1f} ms\n")
    _remove(path)
    watch, seconds = run(path, 3 * N_POSES, in_time=False)
    size = path.stat().st_size
    raw = 3 * N_POSES * len(EXPOSURE_TIMES) * HEIGHT * WIDTH * 2
    plain = disk_seconds(folder, size)
    say(
        f"sustained: {raw / seconds / 1e6:.0f} MB/s of frames, {size / seconds / 1e6:.0f} MB/s on the disk "
        f"({seconds / 3 / N_POSES:.3f} s a bracket); writing as many bytes in one go: {size / plain / 1e6:.0f} MB/s\n"
    )
    _remove(path)
    few = peak_mb(lambda: run(folder / "few.h5", N_POSES, in_time=False))
    many = peak_mb(lambda: run(folder / "many.h5", 3 * N_POSES, in_time=False))
    say(f"memory: {few:.0f} MB for {N_POSES} poses, {many:.0f} MB for {3 * N_POSES}\n")
    for name in ("few.h5", "many.h5"):
        _remove(folder / name)


def _remove(path: Path) -> None:
    for file in path.parent.glob(f"{path.name}*"):
        file.unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
