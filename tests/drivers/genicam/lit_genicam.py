"""Aravis' own GigE Vision camera, looking at a sheet of paper.

    python -m tests.drivers.genicam.lit_genicam SERIAL RECORD

The camera is Aravis' own, network and all; only what fills its picture is not: a sheet that is as bright as the
exposure time and the light tell, whose state stands in the last line of RECORD (see `tests.drivers.usb_site`).
"""

from __future__ import annotations

import ctypes
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ADDRESS = b"127.0.0.1"
BLACK, RATE = 800.0, 2e6
"""Counts of darkness, and counts per second in full light, of 16 bits."""

_MONO16 = 0x01100007  # of the GenICam Pixel Format Naming Convention
_Fill = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32)


def level(record: Path) -> float:
    """Return the level at which the light shines now."""
    lines = record.read_text().splitlines() if record.exists() else []
    return float(lines[-1].split()[0]) if lines else 0.0


def picture(height: int, width: int, exposure_time: float, shining: float) -> NDArray[np.uint16]:
    """Return counts, shape (height, width), of a sheet that is darker towards its edges."""
    y, x = np.ogrid[-1.0 : 1.0 : height * 1j, -1.0 : 1.0 : width * 1j]
    signal = RATE * shining * exposure_time * (1.0 - 0.3 * (x**2 + y**2))
    rng = np.random.default_rng()
    return np.clip(rng.normal(BLACK + signal, 8.0 + np.sqrt(signal)), 0, 65535).astype(np.uint16)


def main(serial_number: str, record: Path) -> None:
    aravis = ctypes.CDLL("libaravis-0.8.so.0")
    aravis.arv_gv_fake_camera_new.restype = ctypes.c_void_p
    aravis.arv_gv_fake_camera_get_fake_camera.restype = ctypes.c_void_p
    aravis.arv_buffer_get_data.restype = ctypes.POINTER(ctypes.c_uint8)

    @_Fill
    def fill(buffer: int, _: int, exposure_time_us: int, __: int, pixel_format: int) -> None:
        if pixel_format != _MONO16:
            return  # and leave the picture black
        region = [ctypes.c_int() for _ in range(4)]  # x, y, width, height
        aravis.arv_buffer_get_image_region(ctypes.c_void_p(buffer), *map(ctypes.byref, region))
        counts = picture(region[3].value, region[2].value, exposure_time_us * 1e-6, level(record))
        # The size that it tells is that of what has been received, which is nothing yet.
        data = aravis.arv_buffer_get_data(ctypes.c_void_p(buffer), ctypes.byref(ctypes.c_size_t()))
        ctypes.memmove(data, counts.ctypes.data, counts.nbytes)

    camera = ctypes.c_void_p(aravis.arv_gv_fake_camera_new(ADDRESS, serial_number.encode()))
    inner = ctypes.c_void_p(aravis.arv_gv_fake_camera_get_fake_camera(camera))
    aravis.arv_fake_camera_set_fill_pattern(inner, fill, None)
    while aravis.arv_gv_fake_camera_is_running(camera):
        time.sleep(0.1)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
