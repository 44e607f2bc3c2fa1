"""Small valid files of each kind, to be mutated."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.evaluation.scoring import score, truth_error
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.reflectance.atoms import TabulatedAtom
from analysis.reflectance.dictionary_file import Material, MaterialTables, write_dictionary
from analysis.registration.stack_file import write_stack
from analysis.results.result import result_of
from analysis.results.result_file import write_result
from analysis.stages import Stages
from protocols.capture.engine import capture
from tests.protocols.fakes import FakeBench, protocol_config, rig_config
from tests.synthetic import make_stack


def write_sources(folder: Path) -> dict[str, Path]:
    """Write a session, a stack, a result and a dictionary."""
    paths = {kind: folder / f"{kind}.h5" for kind in ("session", "stack", "result", "dictionary")}
    capture(rig_config(), protocol_config(count=3), paths["session"], devices=FakeBench().devices)
    stack = make_stack(n_views=10, size=8)
    write_stack(paths["stack"], stack)
    stages = Stages()
    with stages.measure("reading"):
        reconstruction = reconstruct(stack, Options(palette="off"), stages)
    summary = replace(score(reconstruction, 2), calibration={"rms": 0.1, "views": [1, 2]})
    write_result(paths["result"], result_of(reconstruction, stages, summary, truth_error(reconstruction)))
    write_dictionary(paths["dictionary"], _tables())
    return paths


def _tables() -> MaterialTables:
    theta = np.linspace(0.0, 1.5, 6)
    atoms = tuple(TabulatedAtom("felt", theta, theta[:3], np.full((6, 3), 0.1 + c), c) for c in range(3))
    return MaterialTables(
        (Material("felt", "cloth", "felt.binary", "0" * 64),), atoms, np.ones((3, 6, 3), np.uint8), "1"
    )
