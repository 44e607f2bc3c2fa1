"""From a session to its report in three calls; the command, the console and the benchmarks make the same ones.

calibrated = calibrate("session.h5", "area.stack.h5")
result = reconstruct("area.stack.h5")
report(result, "report.html")
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from analysis.calibration.register import register
from analysis.calibration.session import calibrate_session
from analysis.evaluation.scoring import score, truth_error
from analysis.radiometry.frames import MergedFrames
from analysis.reconstruction.error_budget import budget_of
from analysis.reconstruction.options import AUTO, Options
from analysis.reconstruction.reconstruction import reconstruct as reconstruct_stack
from analysis.reflectance.dictionary import by_name
from analysis.registration.stack import Stack
from analysis.registration.stack_file import is_stack, read_stack
from analysis.reporting.calibration_report import CalibrationReport, report_of
from analysis.reporting.result_report import write_report
from analysis.results.result import Result, result_of
from analysis.results.summary import SourceFile
from analysis.stages import Stages
from instrument.files.digests import file_digest
from instrument.files.json_text import parse_json
from instrument.files.probe import refuse_dangerous
from instrument.session.session import Session

N_HELD_OUT = 6
"""Views that are held out of the fit in turn, to be predicted."""


@dataclass(frozen=True)
class Calibrated:
    """A session's registered stack, and how good its calibration is.

    Attributes
    ----------
    stack : Stack
    report : CalibrationReport
    """

    stack: Stack
    report: CalibrationReport


def calibrate(
    session: Path | str, stack_file: Path | str, *, pitch: float | None = None, stages: Stages | None = None
) -> Calibrated:
    """Calibrate a session from its own pictures, and register it onto the sample plane.

    Parameters
    ----------
    session : Path or str
        Session file.
    stack_file : Path or str
        Registered stack to write; there must be no such file. No more than one picture is in memory at a time.
    pitch : float or None
        Size of a pixel of the stack, mm; None = as configured with the capture, or as fine as the pictures.
    stages : Stages or None
        Takes time and memory of each stage.

    Raises
    ------
    InvalidInputError
        If the session cannot be used, something needed is not known, or too few poses show the boards.
    FileExistsError
        If there is a file already.
    """
    stages = stages or Stages()
    refuse_dangerous(Path(session))
    with Session(session) as opened:
        calibration = register(opened, Path(stack_file), pitch, stages)
        stack = read_stack(Path(stack_file))
        with stages.measure("error budget"):
            budget = budget_of(stack)
        return Calibrated(stack, report_of(opened, calibration, budget))


def check_calibration(session: Path | str, *, stages: Stages | None = None) -> CalibrationReport:
    """Calibrate a session as far as it goes, and judge that; no stack is made.

    Parameters
    ----------
    session : Path or str
    stages : Stages or None

    Raises
    ------
    InvalidInputError
        If the session cannot be used, or there are boards that too few poses show.
    """
    refuse_dangerous(Path(session))
    with Session(session) as opened:
        return report_of(opened, calibrate_session(opened, MergedFrames(opened), stages or Stages()))


def reconstruct(
    source: Stack | Path | str,
    options: Options | None = None,
    *,
    n_held_out: int = N_HELD_OUT,
    pitch: float | None = None,
    scratch: Path | str | None = None,
    calibration: CalibrationReport | None = None,
    stages: Stages | None = None,
) -> Result:
    """Reconstruct normals, depth and BRDF, and score them: against the truth if there is one, and on views held out.

    Parameters
    ----------
    source : Stack, Path or str
        A registered stack or its file, or a session file, which is then registered first. Only of a file the result
        knows where it came from.
    options : Options or None
        None = the defaults.
    n_held_out : int
        Views that are held out in turn, spread evenly over the capture; 0 = none.
    pitch : float or None
        Of a session: size of a pixel, mm.
    scratch : Path, str or None
        Folder for the stack of a session while this runs; None = the system's folder for temporary files.
    calibration : CalibrationReport or None
        Of the stack, where it is at hand; else what the stack's own notes say is taken.
    stages : Stages or None

    Raises
    ------
    InvalidInputError
        If the source or the dictionary cannot be used, or the views cannot determine normals.
    """
    options, stages = options or Options(), stages or Stages()
    if options.dictionary != AUTO:
        refuse_dangerous(Path(options.dictionary))
        by_name(options.dictionary)  # before a session is registered, which takes minutes
    if isinstance(source, Stack):
        return _result(source, options, stages, n_held_out, _figures(source, calibration), None)
    source = Path(source)
    refuse_dangerous(source)
    if is_stack(source):
        with stages.measure("reading"):
            stack = read_stack(source)
        return _result(stack, options, stages, n_held_out, _figures(stack, calibration), source)
    with TemporaryDirectory(prefix=".halfangle-", dir=scratch) as folder:
        made = calibrate(source, Path(folder) / "area.stack.h5", pitch=pitch, stages=stages)
        return _result(made.stack, options, stages, n_held_out, made.report.figures, source)


def report(result: Result, page: Path | str, title: str = "Result") -> None:
    """Make one HTML page of a result; it needs no other file.

    Parameters
    ----------
    result : Result
    page : Path or str
        There must be no such file.
    title : str

    Raises
    ------
    FileExistsError
        If there is a file already.
    """
    write_report(Path(page), result, title)


def _figures(stack: Stack, calibration: CalibrationReport | None) -> dict[str, Any] | None:
    if calibration is not None:
        return calibration.figures
    text = stack.notes.get("calibration")
    return parse_json(text) if text else None


def _result(
    stack: Stack,
    options: Options,
    stages: Stages,
    n_held_out: int,
    calibration: dict[str, Any] | None,
    source: Path | None,
) -> Result:
    reconstruction = reconstruct_stack(stack, options, stages)
    with stages.measure("views left out"):
        figures = score(reconstruction, n_held_out, track=stages.track)
    summary = replace(
        figures,
        options=asdict(options),
        source=None if source is None else SourceFile(source.name, file_digest(source)),
        calibration=calibration or None,
    )
    return result_of(reconstruction, stages, summary, truth_error(reconstruction))
