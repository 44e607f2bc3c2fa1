"""The one file that talks to Aravis 0.8, by way of PyGObject.

References
----------
Aravis 0.8 reference manual, classes Camera, Device, GvDevice, Stream and Buffer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from threading import Thread
from typing import Any

from drivers.errors import DeviceError, DeviceLostError, DriverNotFoundError
from drivers.genicam.link import Identity, Number, RawFrame, Region, Side, Steps, Value
from drivers.genicam.listing import ListedCamera

_HELP = (
    "GenICam cameras need Aravis and PyGObject. Install them: `make setup` as root, or "
    "`apt install gir1.2-aravis-0.8 libgirepository1.0-dev pkg-config gcc python3-dev` and `make setup`; "
    "elsewhere Aravis 0.8 and halfangle[genicam]"
)
# One that is filled, one that waits to be, and one that is read.
_N_BUFFERS = 3
_KINDS = {"string": str, "boolean": bool, "float": float, "integer": float}
_MICROSECONDS = {"exposure_time": 1e6}
# Names of before the naming convention 2 last.
_NAMES = {"gain": ("Gain", "GainRaw"), "black_level": ("BlackLevel", "BlackLevelRaw")}
# A register of GigE Vision; 0 where nobody has control.
_CONTROL_CHANNEL_PRIVILEGE = 0x0A00
_TEMPERATURE, _FIRMWARES = "DeviceTemperature", ("DeviceFirmwareVersion", "DeviceVersion")
# The camera is not there, answered none of 5 tries of 0.5 s, or is another program's.
_GONE = ("NOT_CONNECTED", "TIMEOUT", "NOT_FOUND", "TRANSFER_ERROR", "NOT_CONTROLLER", "PROTOCOL_ERROR_ACCESS_DENIED")


def library() -> Any:
    """Return the module Aravis.

    Raises
    ------
    DriverNotFoundError
        If it or PyGObject is not installed.
    """
    try:
        import_module("gi").require_version("Aravis", "0.8")
        return import_module("gi.repository.Aravis")
    except (ImportError, ValueError) as error:
        raise DriverNotFoundError(f"{_HELP} ({error})") from None


def listed_cameras() -> tuple[ListedCamera, ...]:
    """Return the cameras that answer; it takes a second, since those in the network have as long.

    Raises
    ------
    DriverNotFoundError
        If Aravis or PyGObject is not installed.
    """
    aravis = library()
    aravis.update_device_list()
    return tuple(
        ListedCamera(
            device_id=aravis.get_device_id(i),
            make=aravis.get_device_vendor(i) or "",
            model=aravis.get_device_model(i) or "",
            serial_number=aravis.get_device_serial_nbr(i) or "",
            address=aravis.get_device_address(i) or "",
            protocol=aravis.get_device_protocol(i) or "",
        )
        for i in range(aravis.get_n_devices())
    )


class AravisLink:
    """An open camera; see `drivers.genicam.link.GenicamLink`.

    Parameters
    ----------
    address : str
        An address in the network, or an id of Aravis.

    Raises
    ------
    DriverNotFoundError
        If Aravis or PyGObject is not installed.
    DeviceLostError
        If no camera answers there.
    """

    def __init__(self, address: str) -> None:
        self._aravis = library()
        self._stream: Any = None
        self._camera: Any = None
        self._wanted: tuple[int, int, int] | None = None
        self._is_lost = False
        self._name = f"the camera {address}"
        with self._explained():
            self._camera = self._aravis.Camera.new(address)
        with self._closed_on_failure():
            self._identity = self._identified()
            self.check_presence()

    @property
    def identity(self) -> Identity:
        """What the camera is."""
        return self._identity

    def close(self) -> None:
        """Give the camera back; safe to call twice."""
        if not self._is_lost:
            with suppress(DeviceError):
                self.stop()
        # Aravis gives a camera back when nobody refers to it any more.
        held = [self._stream, self._camera]
        self._stream = self._camera = None
        if self._is_lost:
            # It takes leave of a camera that is gone for 10 s, which nobody has to wait for.
            Thread(target=held.clear, name="forget a lost camera", daemon=True).start()

    def has(self, feature: str) -> bool:
        """Whether the camera has a feature of that name."""
        with self._explained():
            return bool(self._open().is_feature_available(feature))

    def text(self, feature: str) -> str:
        """Return the value of a text or a choice."""
        with self._explained():
            return str(self._open().get_string(feature))

    def set_text(self, feature: str, value: str) -> None:
        """Set a text or a choice."""
        with self._explained():
            self._open().set_string(feature, value)

    def choices(self, feature: str) -> tuple[str, ...]:
        """Return what a choice can be."""
        with self._explained():
            return tuple(self._open().dup_available_enumerations_as_strings(feature))

    def value(self, feature: str) -> Value:
        """Return the value of a feature of any kind; a whole number as a float."""
        with self._explained():
            kind = self._kind(feature)
            found: Value = _KINDS[kind](getattr(self._open(), f"get_{kind}")(feature))
            return found

    def set_value(self, feature: str, value: Value) -> None:
        """Set a feature to a value of its own kind."""
        with self._explained():
            kind = self._kind(feature)
            getattr(self._open(), f"set_{kind}")(feature, int(value) if kind == "integer" else value)

    def _kind(self, feature: str) -> str:
        node = self._open().get_device().get_feature(feature)
        kinds = {"GcEnumeration": "string", "GcBoolean": "boolean", "GcFloat": "float", "GcInteger": "integer"}
        # A choice is a whole number, too, so that the order counts.
        return next((kind for name, kind in kinds.items() if isinstance(node, getattr(self._aravis, name))), "string")

    def has_number(self, name: Number) -> bool:
        """Whether the camera has that number under any of its names."""
        with self._explained():
            return bool(getattr(self._open(), f"is_{name}_available")())

    def number(self, name: Number) -> float:
        """Return a number."""
        with self._explained():
            return float(getattr(self._open(), f"get_{name}")()) / _MICROSECONDS.get(name, 1.0)

    def set_number(self, name: Number, value: float) -> None:
        """Set a number; what the camera makes of it only `number` tells."""
        scale = _MICROSECONDS.get(name, 1.0)
        with self._explained():
            # 1e-5 s is not quite 10 microseconds to the bit, and a bound is a bound.
            low, high = getattr(self._open(), f"get_{name}_bounds")()
            getattr(self._open(), f"set_{name}")(min(max(value * scale, low), high))

    def bounds(self, name: Number) -> tuple[float, float]:
        """Return lowest and highest value of a number."""
        scale = _MICROSECONDS.get(name, 1.0)
        with self._explained():
            low, high = getattr(self._open(), f"get_{name}_bounds")()
            return low / scale, high / scale

    def unit(self, name: Number) -> str:
        """Return the unit of a number; ``""`` where the camera tells none."""
        if name in _MICROSECONDS:
            return "s"
        with self._explained():
            nodes = [self._open().get_device().get_feature(feature) for feature in _NAMES[name]]
            units = (node.get_unit() for node in nodes if hasattr(node, "get_unit"))
            return str(next(units, None) or "")

    def temperature(self) -> float:
        """Return the sensor's in degrees Celsius; NaN where the camera tells none."""
        with self._explained():
            return float(self._open().get_float(_TEMPERATURE)) if self.has(_TEMPERATURE) else math.nan

    def steps(self, side: Side) -> Steps:
        """Return what a side of the region can be."""
        with self._explained():
            low, high = getattr(self._open(), f"get_{side}_bounds")()
            return Steps(low, high, max(1, getattr(self._open(), f"get_{side}_increment")()))

    def region(self) -> Region:
        """Return the part of the sensor that is read."""
        with self._explained():
            found = self._open().get_region()
            return Region(found.x, found.y, found.width, found.height)

    def set_region(self, region: Region) -> None:
        """Set the part of the sensor that is read, all of it, at full resolution."""
        with self._explained():
            camera = self._open()
            if camera.is_binning_available():
                camera.set_binning(1, 1)
            # From the corner first: the old offset may leave no room for the new size.
            camera.set_region(0, 0, region.width, region.height)
            camera.set_region(region.x, region.y, region.width, region.height)

    def start(self) -> None:
        """Wait for software triggers from now on; no frame of before arrives any more."""
        self.stop()
        with self._explained():
            camera = self._open()
            camera.set_acquisition_mode(self._aravis.AcquisitionMode.CONTINUOUS)
            camera.set_trigger("Software")
            # In the network a stream has a port of its own, so what is late for the last one is nobody's.
            self._stream = camera.create_stream(None, None)
            if self._stream is None:
                raise DeviceLostError(f"{self._name} gives no stream. Connect it again")
            region = camera.get_region()
            # The first time stands for all: nobody sets the camera between two streams.
            self._wanted = self._wanted or (region.width, region.height, camera.get_pixel_format())
            for _ in range(_N_BUFFERS):
                self._stream.push_buffer(self._aravis.Buffer.new_allocate(camera.get_payload()))
            camera.start_acquisition()

    def stop(self) -> None:
        """End any exposure, and wait for triggers no more; safe to call twice."""
        stream, self._stream = self._stream, None
        if stream is None:
            return
        with self._explained():
            camera = self._open()
            if camera.is_feature_available("AcquisitionAbort"):
                camera.abort_acquisition()
            camera.stop_acquisition()

    def trigger(self) -> None:
        """Begin one exposure."""
        with self._explained():
            self._open().software_trigger()

    def frame(self, seconds: float) -> RawFrame | None:
        """Return the next frame, or None if none arrives in time."""
        stream = self._stream
        if stream is None:
            raise DeviceLostError(f"{self._name} waits for no trigger. Connect it again")
        missing = _n_missing(stream)
        buffer = stream.timeout_pop_buffer(round(1e6 * seconds)) if seconds > 0.0 else stream.try_pop_buffer()
        if buffer is None:
            return None
        fault = self._fault(buffer, _n_missing(stream) - missing)
        frame = RawFrame(buffer.get_frame_id(), fault, b"" if fault else bytes(buffer.get_image_data()))
        stream.push_buffer(buffer)
        return frame

    def check_presence(self) -> None:
        """Raise unless the camera answers and is still ours."""
        with self._explained():
            if not self._open().is_gv_device():
                self._open().get_region()
                return
            device = self._open().get_device()
            is_ours = device.is_controller() and device.read_register(_CONTROL_CHANNEL_PRIVILEGE)
        if not is_ours:
            # One that was switched off and on is back at settings of its own.
            raise DeviceLostError(
                f"{self._name} is not in our control any more: it was switched off and on, or another program has it. "
                "Connect it again"
            )

    def _fault(self, buffer: Any, n_missing: int) -> str:
        status = buffer.get_status()
        if status != self._aravis.BufferStatus.SUCCESS:
            # Aravis counts whatever should have come after the first one that is missing; at USB it does not count.
            lacks = f"up to {n_missing} packets are missing" if n_missing else "not all of it arrived"
            return f"{lacks} (status {status.value_nick})"
        came = (buffer.get_image_width(), buffer.get_image_height(), buffer.get_image_pixel_format())
        return "" if came == self._wanted else f"width, height and pixel format are {came}, not {self._wanted}"

    def _identified(self) -> Identity:
        with self._explained():
            camera = self._open()
            firmwares = (camera.get_string(name) for name in _FIRMWARES if camera.is_feature_available(name))
            return Identity(
                make=camera.get_vendor_name() or "",
                model=camera.get_model_name() or "",
                serial_number=camera.get_device_serial_number() or "",
                firmware=next(firmwares, ""),
            )

    def _open(self) -> Any:
        if self._camera is None:
            raise DeviceLostError(f"{self._name} is closed. Connect it again")
        return self._camera

    @contextmanager
    def _closed_on_failure(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self.close()
            raise

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Raise an error of Aravis as a `DeviceError` that says what to do; every other one passes."""
        glib = import_module("gi.repository.GLib")
        try:
            yield
        except glib.Error as error:
            # The names of the nodes that it passed stand before.
            said = error.message.rpartition("] ")[2]
            codes = [getattr(self._aravis.DeviceError, name) for name in _GONE]
            if error.domain == "arv-device-error-quark" and error.code in codes:
                self._is_lost = True
                raise DeviceLostError(
                    f"{self._name} is gone ({said}). Look at its cable and its power, then connect again"
                ) from None
            raise DeviceError(f"{self._name} failed: {said}. Connect it again") from None


def _n_missing(stream: Any) -> int:
    """Return how many packets of a stream were missed so far; USB3 Vision does not count them."""
    names = [stream.get_info_name(i) for i in range(stream.get_n_infos())]
    name = "n_missing_packets"
    return int(stream.get_info_uint64(names.index(name))) if name in names else 0
