"""What GRBL 1.1's numbers mean and what to do next.

After the lists of the firmwares' documentation: ``alarm_codes`` and ``error_codes`` of GRBL, "Errors and alarms" of
grblHAL.
"""

from __future__ import annotations

from drivers.errors import DeviceError, UnsafeError

_HOME = "Home the stage"
_LOOK = "Look at the stage before anything moves; when its way is free, connect and home it"
_WIRING = "Look at the limit switches, their wiring and the way of the axes, then home the stage"

# number -> what happened, what next
ALARMS = {
    1: ("hard limit: a limit switch was hit and the position is lost", _LOOK),
    2: (
        "soft limit: the target is beyond the firmware's travel; nothing moved",
        f"{_HOME}; compare soft_limits with $130",
    ),
    3: ("reset while moving: steps may be lost", _HOME),
    4: (
        "probe: in the wrong state before the probing cycle",
        "Nothing of ours probes; see what else uses the controller",
    ),
    5: ("probe: no contact within the travel", "Nothing of ours probes; see what else uses the controller"),
    6: ("homing failed: it was reset on the way", _HOME),
    7: ("homing failed: the safety door was opened", "Close the door, then home the stage"),
    8: ("homing failed: the limit switch stays pressed after the pull-off", f"Raise $27. {_WIRING}"),
    9: ("homing failed: no limit switch found within the search distance", f"Raise the travel $130. {_WIRING}"),
    # From here on those of grblHAL.
    10: ("the emergency stop is pressed", f"Release it. {_LOOK}"),
    11: ("it has to be homed first", _HOME),
    12: ("a limit switch is pressed", _LOOK),
    13: ("the probe is protected", "Nothing of ours probes; see what else uses the controller"),
    14: ("a spindle did not come to speed", "Nothing of ours turns a spindle; see what else uses the controller"),
    15: ("homing failed: the second switch of a ganged axis was not found", _WIRING),
    16: ("its self-test failed", "Switch it off and on; see the documentation of this controller"),
    17: ("a motor driver reports a fault", "Look at the motors, their drivers and their power, then home the stage"),
    18: ("homing failed: its configuration allows none", "Correct $22, $44 and $45, then home the stage"),
}

_OURS = "The line was garbled on its way, or the firmware is no GRBL 1.1; look at the cable"
ERRORS = {
    1: ("a G-code word lacks its letter", _OURS),
    2: ("a number is malformed or missing", _OURS),
    3: ("the '$' command is unknown", _OURS),
    4: ("a value is negative that must not be", _OURS),
    5: ("homing is not enabled", "Set $22=1 where there are limit switches, else homing = false in rig.toml"),
    6: ("the step pulse is shorter than 3 us", "Correct $0"),
    7: ("the settings' memory cannot be read; defaults are in force", "Write the settings anew, then compare them"),
    8: ("the command needs an idle controller", "Wait until it rests, or home it if it is locked"),
    9: ("G-code is locked out by an alarm or a jog", "Home the stage; or look at it, and unlock it by hand with $X"),
    10: ("soft limits need homing", "Set $22=1 before $20=1"),
    11: ("the line is too long", _OURS),
    12: ("the step rate is above what the controller can do", "Lower $110 or $100 of that axis"),
    13: ("the safety door is open", "Close it, then connect and home the stage"),
    14: ("the line is too long to be stored", _OURS),
    15: ("a jog goes beyond the travel", "Jog less far"),
    16: ("a jog command is malformed", _OURS),
    17: ("laser mode needs a pulsed output", "Set $32=0"),
    20: ("a G-code command is not supported", _OURS),
    21: ("two G-code commands of one modal group", _OURS),
    22: ("no feed rate is set", _OURS),
    23: ("a G-code command needs a whole number", _OURS),
    24: ("two G-code commands want the axis words", _OURS),
    25: ("a G-code word is repeated", _OURS),
    26: ("no axis word where one is needed", _OURS),
    27: ("the line number is out of range", _OURS),
    28: ("a G-code command lacks a word", _OURS),
    29: ("the work coordinate system is not supported", _OURS),
    30: ("G53 without G0 or G1", _OURS),
    31: ("axis words that no command uses", _OURS),
    32: ("an arc without axis words", _OURS),
    33: ("the target is invalid", _OURS),
    34: ("the radius of an arc is invalid", _OURS),
    35: ("an arc without offsets", _OURS),
    36: ("words that no command uses", "Does the firmware have that axis? Correct the letter in rig.toml"),
    37: ("the tool offset is for another axis", _OURS),
    38: ("the tool number is too large", _OURS),
    # From here on those of grblHAL.
    18: ("it was reset", "Home the stage"),
    19: ("a value must be above 0", _OURS),
    39: ("a value is out of range", _OURS),
    40: ("it waits for a change of tools", "Nothing of ours has tools; see what else uses the controller"),
    43: ("the feed rate is above the largest allowed", "Raise $110 of that axis, or lower its speed"),
    45: ("a limit switch is pressed; only homing is allowed", "Home the stage"),
    46: ("it has to be homed first", "Home the stage"),
    49: ("its self-test failed", "Switch it off and on; see the documentation of this controller"),
    50: ("the emergency stop is pressed", "Release it, look at the stage, then connect and home it"),
    51: ("a motor driver reports a fault", "Look at the motors, their drivers and their power, then home the stage"),
    52: ("a setting is out of range", "Correct the setting"),
    53: ("a setting is not available", "Correct the setting"),
    55: ("its configuration allows no homing", "Correct $22, $44 and $45"),
    77: ("it wants a password", "Unlock it by hand"),
    78: ("it refuses access", "Unlock it by hand"),
    79: ("a critical event has stopped it", "Look at the stage; reset it by hand, then connect and home it"),
}  # fmt: skip

# Trying again would not help: a switch, a door or the wiring needs somebody.
_UNSAFE_ALARMS = (1, 7, 8, 9, 10, 12, 15, 16, 17, 18)
_UNSAFE_ERRORS = (50, 51, 79)
_UNKNOWN = ("not in the documentation of GRBL 1.1 or grblHAL", "See the documentation of this firmware")

STATES = {
    "Alarm": (
        "locked; its position is unknown",
        "Home the stage; without limit switches look at it, and unlock it by hand with $X",
    ),
    "Door": ("stopped by the safety door", "Close the door, then connect and home the stage"),
    "Hold": ("in feed hold", "Release the hold button, or send ~"),
    "Sleep": ("asleep", "Connect again and home the stage"),
    "Check": ("in check mode, in which nothing moves", "Connect again"),
    "Jog": ("jogged by somebody else", "End the jog, then try again"),
    "Run": ("moved by somebody else", "Wait until it rests, then try again"),
    "Home": ("homed by somebody else", "Wait until it rests, then try again"),
}


def alarm(number: int) -> DeviceError:
    """Return the error for an alarm: `UnsafeError` where somebody has to look first."""
    what, next_ = ALARMS.get(number, _UNKNOWN)
    kind = UnsafeError if number in _UNSAFE_ALARMS else DeviceError
    return kind(f"the controller raised ALARM:{number}, {what}. {next_}.")


def refusal(number: int, line: str) -> DeviceError:
    """Return the error for a line that was answered by an error number."""
    what, next_ = ERRORS.get(number, _UNKNOWN)
    kind = UnsafeError if number in _UNSAFE_ERRORS else DeviceError
    return kind(f"the controller refused {line!r} with error:{number}, {what}. {next_}.")


def bad_state(state: str) -> DeviceError:
    """Return the error for a controller that is in a state in which it does not work."""
    what, next_ = STATES.get(state, ("in that state", "Connect again and home the stage"))
    kind = UnsafeError if state == "Door" else DeviceError
    return kind(f"the controller reports {state!r}: it is {what}. {next_}.")
