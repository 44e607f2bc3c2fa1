"""A rig whose three real drivers talk to doubles of their devices, for `halfangle` in processes of their own.

The camera is Aravis' own on the loopback interface, the stage a GRBL double on a pseudo-terminal, the light a USBTMC
double below pyusb. Nothing of halfangle is replaced: all that the drivers know stands in the rig file.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.drivers.genicam.fake_genicam import ADDRESS, FakeGenicam
from tests.drivers.genicam.lit_genicam import level
from tests.drivers.grbl.grbl_double import GrblDouble
from tests.drivers.real_rigs import HEAD, SCPI

ROOT = Path(__file__).parents[2]
PROTOCOL = """
name = "three views"
bracket = { exposure_times_s = [0.002, 0.008], darks = 2 }
rings = [{ tilt_deg = 20.0, count = 3 }]
"""
CAMERA = f"""[camera]
driver = "genicam"
width = 96
height = 64
focal_length_px = 200.0

[camera.device]
address = "{ADDRESS}"
black_level = 800.0
"""
STAGE = """[stage]
driver = "grbl"

[stage.device]
port = "{port}"
settling_time_s = 0.05

[[stage.device.axes]]
name = "tilt"
letter = "Y"
kind = "rotation"
vector = [1.0, 0.0, 0.0]
soft_limits = [-65.0, 65.0]
tolerance = 0.02
scale = -1.0
zero = -100.0

[[stage.device.axes]]
name = "turn"
letter = "X"
kind = "rotation"
vector = [0.0, 0.0, 1.0]
soft_limits = [0.0, 360.0]
tolerance = 0.05
scale = 0.5
zero = -190.0
"""


class RealRig:
    """The files of a rig in a folder, and the doubles that are behind them.

    Parameters
    ----------
    folder : Path
    stage : GrblDouble
    """

    def __init__(self, folder: Path, stage: GrblDouble) -> None:
        self.folder = folder
        # A name that outlives a new plugging, as udev makes one.
        self.port = folder / "stage"
        self.plug_stage_in(stage)
        self.rig, self.protocol, self.session = (folder / name for name in ("rig.toml", "protocol.toml", "s.h5"))
        self.rig.write_text(HEAD + CAMERA + "\n" + SCPI + "\n" + STAGE.format(port=self.port))
        self.protocol.write_text(PROTOCOL)
        self.plug_light_in()
        # Of the command that starts halfangle.
        self.prefix: list[str] = []

    @property
    def record(self) -> Path:
        """Of the light: a line each time it changed."""
        return self.folder / "record"

    @property
    def light_level(self) -> float:
        return level(self.record)

    @property
    def n_flashes(self) -> int:
        lines = self.record.read_text().splitlines() if self.record.exists() else []
        return sum(not line.startswith("0.0") for line in lines)

    def plug_light_in(self, **attributes: Any) -> None:
        """Put a controller with these attributes (of the double) on the bus."""
        (self.folder / "unplug").unlink(missing_ok=True)
        (self.folder / "device.json").write_text(json.dumps(attributes))

    def plug_stage_in(self, stage: GrblDouble) -> None:
        self.stage = stage
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(stage.port)

    def forbid_stage(self) -> None:
        """Let nobody open its port, the administrator included: that one gives up its privilege."""
        Path(self.stage.port).chmod(0)
        if os.geteuid() == 0:
            taken = "-dac_override,-dac_read_search"
            self.prefix = ["setpriv", f"--bounding-set={taken}", f"--inh-caps={taken}"]

    def unplug_light(self) -> None:
        (self.folder / "unplug").touch()
        (self.folder / "device.json").unlink(missing_ok=True)

    def change(self, old: str, new: str) -> None:
        """Change the rig file."""
        text = self.rig.read_text()
        assert old in text
        self.rig.write_text(text.replace(old, new))

    @property
    def environment(self) -> dict[str, str]:
        """What a process needs to find the light's double."""
        usb_site = Path(__file__).parents[1] / "drivers" / "usb_site"
        path = os.pathsep.join([str(usb_site), str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
        return {"PYTHONPATH": path, "HALFANGLE_TEST_USB": str(self.folder)}

    def start(self, *words: str | Path) -> subprocess.Popen[str]:
        """Start `halfangle` with these words."""
        environment = os.environ | self.environment
        command = [*self.prefix, sys.executable, "-c", "from cli.main import main; main()", *map(str, words)]
        pipe = subprocess.PIPE
        return subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True)

    def run(self, *words: str | Path) -> subprocess.CompletedProcess[str]:
        """Run `halfangle` with these words to its end."""
        process = self.start(*words)
        out, err = process.communicate(timeout=120)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def capture(self) -> subprocess.CompletedProcess[str]:
        return self.run("capture", self.protocol, "--rig", self.rig, "-o", self.session)


@contextmanager
def real_rig(folder: Path, pace: float = 50.0) -> Iterator[tuple[RealRig, FakeGenicam]]:
    """Set up a rig with all three, ready."""
    with GrblDouble(pace) as stage:
        rig = RealRig(folder, stage)
        with FakeGenicam(light=rig.record) as camera:
            yield rig, camera
