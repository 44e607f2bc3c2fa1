"""The rules that let the person at the computer open halfangle's USB devices, and where they stand."""

UDEV_RULES = "drivers/udev/60-halfangle.rules"
