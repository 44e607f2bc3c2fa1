"""The light's inner life: a lease that ends by the clock, and power that settles as it warms up."""

from __future__ import annotations

from drivers.clock import Clock

_COLD_C, _WARM_C = 24.0, 41.0
# A drift of which less than this share is left is none: a lamp that is warm is steady to the last digit.
_STEADY = 1e-3


class Lamp:
    """What the simulated light and camera both look at.

    Parameters
    ----------
    clock : Clock
        Whose seconds count.
    warm_up_drift : float
        Share of the power that is lost while it warms up.
    warm_up_s : float
        Lit seconds after which the power is steady.

    Attributes
    ----------
    gain : float
        What a failing supply makes of the power; 1 = nothing.
    history : list of tuple of float
        From when to when it shone, seconds on the clock, each time that it was switched off or on again.
    """

    def __init__(self, clock: Clock, warm_up_drift: float, warm_up_s: float) -> None:
        self._clock = clock
        self._warm_up_drift = warm_up_drift
        self._warm_up_s = warm_up_s
        self._lit_before = 0.0
        self._on_since = 0.0
        self._lease_end = 0.0
        self._level = 0.0
        self.gain = 1.0
        self.history: list[tuple[float, float]] = []

    def shine(self, level: float, max_seconds: float) -> None:
        """Begin a lease, or replace the one that runs."""
        self.darken()
        self._level = level
        self._on_since = self._clock.now()
        self._lease_end = self._on_since + max_seconds

    def darken(self) -> None:
        """End the lease; what was lit until now stays counted."""
        if self._level > 0.0:
            self.history.append((self._on_since, min(self._clock.now(), self._lease_end)))
        self._lit_before = self.lit_seconds
        self._on_since = self._lease_end = self._clock.now()
        self._level = 0.0

    @property
    def remaining(self) -> float:
        """Seconds for which it will go on shining, 0 when dark."""
        return max(0.0, self._lease_end - self._clock.now()) if self._level > 0.0 else 0.0

    @property
    def level(self) -> float:
        """Level at which it shines now, 0 when dark."""
        return self._level if self.remaining > 0.0 else 0.0

    @property
    def lit_seconds(self) -> float:
        """Seconds it has shone in all, at any level."""
        if self._level <= 0.0:
            return self._lit_before
        return self._lit_before + min(self._clock.now(), self._lease_end) - self._on_since

    @property
    def _cold_share(self) -> float:
        if self._warm_up_s <= 0.0:
            return 0.0
        left = max(0.0, 1.0 - self.lit_seconds / self._warm_up_s)
        # Squared, so that the power eases into its steady value and stays there.
        return left * left if left * left > _STEADY else 0.0

    @property
    def power(self) -> float:
        """Power now, relative to full level when warm."""
        return self.gain * self.level * (1.0 + self._warm_up_drift * self._cold_share)

    @property
    def temperature(self) -> float:
        """Degrees Celsius; it does not cool, as its drift does not come back."""
        return _WARM_C + (_COLD_C - _WARM_C) * self._cold_share
