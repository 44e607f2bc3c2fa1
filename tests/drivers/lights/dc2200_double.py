"""What Thorlabs' DC2200 does with SCPI, as far as a light needs it: modes, pulses, limits, protections."""

import re
import time
from collections.abc import Callable

_HEAD = r"^:?{}(\?)?(?:\s+(.*))?$"
# Of the Operation Manual 1.8, section 4.3.2: capitals are the short form, brackets may be left out.
_NUMBERS = {
    "SOURce1:CURRent:LIMIt[:AMPLitude]": ("limit", 0.0, 4.0),
    "SOURce1:PULSe[:BRIGhtness][:LEVel][:AMPLitude]": ("brightness", 0.0, 100.0),
    "SOURce1:PULSe:ONTime": ("on_time", 1e-6, 10.0),
    "SOURce1:PULSe:OFFTime": ("off_time", 1e-6, 10.0),
    "SOURce1:PULSe:COUNt": ("count", 0.0, 1000.0),
    "OUTPut1:TERMinal": ("terminal", 1.0, 2.0),
}
_FLAGS = {
    "SOURce1:CURRent:LIMIt:TRIPped": "limit_tripped",
    "OUTPut1:PROTection:INTLock:TRIPped": "interlock_open",
    "OUTPut1:PROTection:TEMPerature:DRIVer:TRIPped": "driver_hot",
    "OUTPut1:PROTection:TEMPerature:HEAD:TRIPped": "head_hot",
}


def pattern(header: str) -> re.Pattern[str]:
    """Return what matches a header in its short and in its long form."""

    def words(match: re.Match[str]) -> str:
        word = match.group()
        short = re.sub("[a-z]", "", word)
        return f"(?:{word.upper()}|{short})"

    optional = re.sub(r"\[(.*?)\]", r"(?:\1)?", header)
    return re.compile(_HEAD.format(re.sub(r"[A-Z][A-Za-z]+", words, optional)), re.IGNORECASE)


NUMBERS = {pattern(header): values for header, values in _NUMBERS.items()}
FLAGS = {pattern(header): name for header, name in _FLAGS.items()}
MODE, STATE = pattern("SOURce1:MODe"), pattern("OUTPut1[:STATe]")


class Dc2200Double:
    """Set its attributes to make it behave as one that is worn, hot or played with."""

    def __init__(self, now: Callable[[], float] = time.monotonic, identity: str = "Thorlabs,DC2200,M00000001,1.4.0"):
        self.now, self.identity = now, identity
        self.mode = "CC"
        self.limit, self.brightness, self.on_time, self.off_time = 1.0, 50.0, 1.0, 1.0
        self.count, self.terminal = 0.0, 2.0
        self.limit_tripped = self.interlock_open = self.driver_hot = self.head_hot = False
        self.errors: list[str] = []
        # Names of values that it holds on to, whatever it is told.
        self.stuck: set[str] = set()
        self.sticks_on = False
        self.knows_its_limits = True
        self.n_switched_on = 0
        self.n_limits_set = 0
        self._lit_since: float | None = 0.0

    @property
    def lit(self) -> bool:
        if self._lit_since is None:
            return False
        protected = self.limit_tripped or self.interlock_open or self.driver_hot or self.head_hot
        endless = self.mode != "PULS" or self.count == 0.0
        seconds = self.count * (self.on_time + self.off_time)
        return not protected and (endless or self.now() - self._lit_since < seconds)

    def receive(self, message: bytes) -> bytes | None:
        text = message.decode("ascii").strip()
        if text == "*CLS":
            self.errors.clear()
            return None
        if text == "*IDN?":
            return f"{self.identity}\n".encode()
        if re.match(r"^SYST(EM)?:ERR(OR)?(:NEXT)?\?$", text, re.IGNORECASE):
            return (self.errors.pop(0) if self.errors else '+0,"No error"').encode() + b"\n"
        return self._setting(text)

    def _setting(self, text: str) -> bytes | None:
        if match := STATE.match(text):
            return self._state(*match.groups())
        if match := MODE.match(text):
            self.mode = match.group(2)
            return None
        for header, (name, low, high) in NUMBERS.items():
            if match := header.match(text):
                return self._number(name, low, high, *match.groups())
        for header, name in FLAGS.items():
            if (match := header.match(text)) and match.group(1):
                return b"%d\n" % getattr(self, name)
        self.errors.append('-113,"Undefined header"')
        return None

    def _state(self, asked: str | None, word: str | None) -> bytes | None:
        if asked:
            return b"%d\n" % self.lit
        if word in ("ON", "1"):
            self._lit_since = self.now()
            self.n_switched_on += 1
        elif not self.sticks_on:
            self._lit_since = None
        return None

    def _answer(self, values: dict[str | None, float], word: str | None) -> bytes | None:
        if word is not None and not self.knows_its_limits:
            self.errors.append('-108,"Parameter not allowed"')
            return None
        return f"{values[word]:.6E}\n".encode()

    def _number(self, name: str, low: float, high: float, asked: str | None, word: str | None) -> bytes | None:
        if asked:
            return self._answer({None: getattr(self, name), "MIN": low, "MAX": high}, word)
        value = float(word or "nan")
        if not low <= value <= high:
            self.errors.append('-222,"Data out of range"')
        elif name not in self.stuck:
            setattr(self, name, value)
            self.n_limits_set += name == "limit"
        return None
