"""One frame in the light, to look at: exposure, focus, marker boards."""

from __future__ import annotations

from drivers.camera import Frame
from instrument.rig.rig import Rig
from protocols.shot import expose, lease_seconds, light_on


def take_single_frame(rig: Rig, exposure_time: float) -> Frame:
    """Light on, one exposure, light off.

    Parameters
    ----------
    rig : Rig
        Connected.
    exposure_time : float
        Seconds.

    Raises
    ------
    DeviceError
        If a device does not do it; `DeviceLimitError` where the camera takes no such time.
    """
    with light_on(rig.light, rig.config.light.level, lease_seconds((exposure_time,))):
        return expose(rig.camera, exposure_time)
