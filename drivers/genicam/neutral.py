"""Features that alter counts, put to where they alter nothing: counts have to be proportional to light.

What cannot be put there is refused by name. Names are those of GenICam's Standard Features Naming Convention, and of
makers beside it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from drivers.errors import DeviceError
from drivers.genicam.link import GenicamLink, Value

_OFF_WORDS = ("Off", "None", "Disabled", "Disable", "Linear", "NoEffect", "Normal")
"""Choices that mean that nothing is done, in the order in which they are looked for."""


@dataclass(frozen=True, slots=True)
class Neutral:
    """Features of one kind.

    Attributes
    ----------
    features : tuple of str
    why : str
        What they do to counts.
    number : float
        Where the feature is a number, the one that does nothing; a flag is off, a choice one of `_OFF_WORDS`.
    word : str
        Where the feature is a choice, the one that does nothing, if it is none of `_OFF_WORDS`.
    switches : tuple of str
        Flags that switch it off altogether; where a camera has one, the value itself matters no more.
    """

    features: tuple[str, ...]
    why: str
    number: float = 0.0
    word: str = ""
    switches: tuple[str, ...] = ()


NEUTRAL = (
    Neutral(
        (
            "pgrHDRModeEnabled",
            "HDREnable",
            "HdrEnable",
            "pgrExposureCompensationAuto",
            "SequencerMode",
            "SequencerEnable",
        ),
        "frames take turns in their exposure",
    ),
    Neutral(
        (
            "ExposureAuto",
            "GainAuto",
            "BlackLevelAuto",
            "BalanceWhiteAuto",
            "IrisAuto",
            "GammaAuto",
            "SharpnessAuto",
            "SaturationAuto",
            "HueAuto",
            "TargetBrightnessAuto",
            "AcquisitionFrameRateAuto",
        ),
        "the camera changes it by itself",
    ),
    Neutral(("ExposureMode",), "the exposure is not the one set", word="Timed"),
    Neutral(("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled"), "it shortens the longest exposure"),
    Neutral(("GammaEnable", "GammaEnabled", "LUTEnable"), "counts are bent"),
    Neutral(("Gamma",), "counts are bent", 1.0, switches=("GammaEnable", "GammaEnabled")),
    Neutral(("ContrastEnable", "ContrastMode", "BslContrastMode"), "counts are stretched"),
    Neutral(("BslContrast", "BslBrightness"), "counts are stretched"),
    Neutral(("DigitalShift",), "counts are doubled"),
    Neutral(
        (
            "EdgeFilter",
            "SharpnessEnabled",
            "SharpnessEnable",
            "SharpeningEnable",
            "SharpeningMode",
            "SharpnessEnhancement",
            "BslSharpnessEnhancement",
        ),
        "a pixel takes from its neighbours",
    ),
    Neutral(
        (
            "NoiseReduction",
            "NoiseReductionMode",
            "NoiseReductionEnable",
            "BslNoiseReduction",
            "DenoiseEnable",
            "PgiMode",
        ),
        "a pixel takes from its neighbours",
    ),
    Neutral(
        (
            "ColorTransformationEnable",
            "SaturationEnabled",
            "SaturationEnable",
            "HueEnabled",
            "HueEnable",
            "LightSourcePreset",
            "BslLightSourcePreset",
            "ColorCorrectionMatrixEnable",
        ),
        "colours are mixed",
    ),
    Neutral(("pgrExposureCompensation", "ExposureCompensation"), "the exposure is another than the one set"),
    Neutral(("TestPattern", "TestImageSelector", "TestPatternGeneratorSelector"), "the picture is a drawn one"),
    Neutral(("ReverseX", "ReverseY"), "the picture is mirrored"),
    Neutral(("DecimationHorizontal", "DecimationVertical"), "pixels are left out", 1.0),
)

_RATIOS = ("BalanceRatio", "BalanceRatioAbs")
_SELECTORS = {"GainSelector": ("All", "AnalogAll"), "BlackLevelSelector": ("All",)}
"""Of what is set afterwards: the choice that stands for all parts."""


def put_to_neutral(link: GenicamLink) -> None:
    """Put all that alters counts to where it does not, and read it back.

    Raises
    ------
    DeviceError
        With every feature that stays as it was, and what it does.
    """
    problems = [*_problems(link, NEUTRAL), *_ratio_problems(link)]
    for selector, choices in _SELECTORS.items():
        if link.has(selector) and (chosen := next((c for c in choices if c in link.choices(selector)), "")):
            link.set_value(selector, chosen)
    if problems:
        raise DeviceError(
            f"the camera alters its counts: {'; '.join(problems)}. "
            "Set it with the camera's own program, and save it there"
        )


def _problems(link: GenicamLink, table: Iterable[Neutral]) -> Iterator[str]:
    for neutral in table:
        if any(link.has(switch) for switch in neutral.switches):
            continue
        for feature in neutral.features:
            if link.has(feature):
                yield from _put(link, feature, neutral)


def _ratio_problems(link: GenicamLink) -> Iterator[str]:
    """White balance: the colours of a mosaic are multiplied, each by a number of its own."""
    for feature in _RATIOS:
        if link.has(feature) and isinstance(link.value(feature), float):
            selector = "BalanceRatioSelector"
            colours = link.choices(selector) if link.has(selector) else ("",)
            for colour in colours:
                if colour:
                    link.set_value(selector, colour)
                neutral = Neutral((feature,), f"{colour or 'a colour'} is multiplied".lower(), 1.0)
                yield from _put(link, feature, neutral)


def _put(link: GenicamLink, feature: str, neutral: Neutral) -> Iterator[str]:
    found = link.value(feature)
    wanted = _wanted(link, feature, found, neutral)
    if wanted is None:
        yield f"{feature} is {_said(found)}, and none of its choices does nothing ({neutral.why})"
        return
    if _same(found, wanted):
        return
    refused = ""
    try:
        link.set_value(feature, wanted)
    except DeviceError as error:
        refused = f": {error}"
    if not _same(read_back := link.value(feature), wanted):
        yield f"{feature} was set to {_said(wanted)} and reads back {_said(read_back)} ({neutral.why}){refused}"


def _wanted(link: GenicamLink, feature: str, found: Value, neutral: Neutral) -> Value | None:
    if isinstance(found, bool):
        return False
    if isinstance(found, str):
        choices = link.choices(feature)
        return next((word for word in (neutral.word, *_OFF_WORDS) if word in choices), None)
    return neutral.number


def _same(a: Value, b: Value) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=0.0, abs_tol=0.005)
    return a == b


def _said(value: Value) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else value
