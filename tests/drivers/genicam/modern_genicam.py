"""Another description for Aravis' own camera: the names and units of today's cameras, and what it lacks itself.

Nothing is copied: the description that the camera delivers is rewritten while the tests run.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

from drivers.genicam.aravis import library
from tests.drivers.genicam.fake_genicam import ADDRESS

TEMPERATURE = 41.5

# Memory of the camera that nothing else uses; it holds zeros at the start.
_SPARE = {
    "ExposureAutoRegister": 0x2000,
    "GammaEnableRegister": 0x2004,
    "AcquisitionFrameRateEnableRegister": 0x2008,
    "BlackLevelRegister": 0x200C,
    "AcquisitionAbortRegister": 0x2010,
}


def write_modern_description(path: Path) -> None:
    """Write the description of the camera that answers now, brought up to date."""
    before, after = _delivered().split('<Integer Name="GainRaw"')
    rest = after.partition("</Integer>")[2]
    # 12 bits in two bytes.
    entry = '<EnumEntry Name="Mono12" NameSpace="Standard"><Value>17825797</Value></EnumEntry>'
    mono8 = '<EnumEntry Name="Mono8" NameSpace="Standard">'
    new = f"{before}{_gain()}{_additions()}{rest}".replace(mono8, entry + mono8)
    path.write_text(new.replace(">GainRaw<", ">Gain<").replace("ExposureTimeAbs", "ExposureTime"), encoding="utf-8")


def _delivered() -> str:
    """Return the description that the camera delivers.

    Its text does not end with a zero, which PyGObject takes for granted: it reads on into whatever lies behind. The
    library itself tells the length.
    """
    device = library().Camera.new(ADDRESS).get_device()
    get_xml = ctypes.CDLL("libaravis-0.8.so.0").arv_device_get_genicam_xml
    get_xml.restype, get_xml.argtypes = ctypes.c_void_p, [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]
    size = ctypes.c_size_t()
    # The hash of such an object is where it lies.
    return ctypes.string_at(get_xml(hash(device), ctypes.byref(size)), size.value).decode()


def _gain() -> str:
    return """
        <Float Name="Gain"><pValue>GainConverter</pValue><Min>0.0</Min><Max>24.0</Max><Unit>dB</Unit></Float>
        <Converter Name="GainConverter">
            <FormulaTo>FROM * 10</FormulaTo><FormulaFrom>TO / 10.0</FormulaFrom><pValue>GainRawRegister</pValue>
        </Converter>"""


def _additions() -> str:
    """Return what is on, or automatic, when the camera is switched on: its memory holds zeros."""
    return "".join(
        [
            f'<SwissKnife Name="DeviceTemperature"><Formula>{TEMPERATURE}</Formula></SwissKnife>',
            _register("ExposureAutoRegister"),
            '<Enumeration Name="ExposureAuto">'
            '<EnumEntry Name="Continuous"><Value>0</Value></EnumEntry>'
            '<EnumEntry Name="Off"><Value>1</Value></EnumEntry>'
            "<pValue>ExposureAutoRegister</pValue></Enumeration>",
            *(_flag(name) for name in ("GammaEnable", "AcquisitionFrameRateEnable")),
            _register("BlackLevelRegister"),
            '<Float Name="BlackLevel"><pValue>BlackLevelRegister</pValue><Min>0.0</Min><Max>12.0</Max>'
            "<Unit>%</Unit></Float>",
            _register("AcquisitionAbortRegister"),
            '<Command Name="AcquisitionAbort"><pValue>AcquisitionAbortRegister</pValue>'
            "<CommandValue>1</CommandValue></Command>",
        ]
    )


def _flag(name: str) -> str:
    return (
        f'<Boolean Name="{name}"><pValue>{name}Register</pValue><OnValue>0</OnValue><OffValue>1</OffValue></Boolean>'
        f"{_register(f'{name}Register')}"
    )


def _register(name: str) -> str:
    return (
        f'<IntReg Name="{name}"><Address>{_SPARE[name]:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )
