"""A damaged propeller from the commands that hover needs, against those of a healthy flight.

    u_i = command²                      about the thrust that rotor i would give, healthy
    d_i = (u_i - u_i,healthy) / mean u  means over windows of 2 s
    Y   = sum s_i d_i                   yaw part of the change; s_i spin

A cut propeller raises the command of its own rotor alone, which has a yaw part. A weight near rotor i raises
the rotors as (1 + 2 r_i r_j / r²) / n, (3, 1, -1, 1) / 4 on a quadrotor, which has none: that is what tells
the two apart. What the rotor has left is u_i,healthy / u_i. Without a healthy reference nothing can be said:
healthy trims differ by 20 % between rotors.

Source: sheet 5 section 4 (`crazypad_*`; the reference moves by 6-9 % of command between days).
"""

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

from gcs_health.airframe import Airframe


class Trim(StrEnum):
    """What the hover commands say."""

    SETTLING = "settling"
    USUAL = "usual"
    CUT = "cut"
    LOAD = "load"
    UNCLEAR = "unclear"


@dataclass(frozen=True, slots=True)
class TrimConfig:
    """Thresholds of the test, sheet 5 section 4."""

    window: float = 2.0  # s
    together: int = 3  # windows at most that are judged as one; this project
    agree: int = 2  # times on end that the same must be found; this project
    changed: float = 0.10  # of a rotor's command
    yaw_cut: float = 0.4
    yaw_load: float = 0.25
    steady: tuple[float, float] = (0.5, 1.8)  # of the healthy mean u: what is no hover; this project
    turning: float = 0.2  # of a rotor's healthy u, below which it does not fly; this project
    flying: float = 1.0  # s in the air before a window; this project
    gap: float = 0.5  # s without commands
    spread: float = 0.15  # of u, from day to day


class HoverTrim:
    """Fed squared commands; compares windows of hover with the healthy reference.

    Attributes
    ----------
    state, rotor : what the last windows say, and of which rotor (-1 = of none).
    u : (n,) mean squared command of the last windows.
    yaw : Y of it. explained : share of the change that the better pattern explains.
    """

    def __init__(self, airframe: Airframe, config: TrimConfig) -> None:
        self.config = config
        self.reference = [value * value for value in airframe.baseline.hover_command]
        self.known = bool(self.reference)
        self._spin = [rotor.spin for rotor in airframe.rotors]
        places = [rotor.position[:2] for rotor in airframe.rotors]
        square = sum(x * x + y * y for x, y in places) / len(places)
        self._loads = [
            [(1.0 + 2.0 * (x * a + y * b) / square) / len(places) for a, b in places] for x, y in places
        ]
        self.restart()

    def restart(self) -> None:
        """Begin a new flight."""
        self.state, self.rotor = Trim.SETTLING, -1
        self.u = list(self.reference)
        self.yaw = self.explained = math.nan
        self._found = (Trim.SETTLING, -1)
        self._agreeing = 0
        self._windows: deque[list[float]] = deque(maxlen=self.config.together)
        self._last = math.nan
        self._take_off()

    def _take_off(self) -> None:
        self._flown = 0.0
        self._clear()

    def _clear(self) -> None:
        self._length = 0.0
        self._sums = [0.0] * len(self._spin)

    def feed(self, t: float, u: list[float]) -> bool:
        """Take the squared commands of all rotors; return whether `state` or `rotor` changed."""
        if not self.known:
            return False
        c = self.config
        dt = t - self._last
        if dt <= 0.0:
            return False
        self._last = t
        idle = any([now < c.turning * usual for now, usual in zip(u, self.reference, strict=True)])
        if not dt < c.gap or idle:
            self._take_off()
            return False
        self._flown += dt
        if self._flown < c.flying:
            return False
        self._length += dt
        for i, value in enumerate(u):
            self._sums[i] += dt * value
        if self._length < c.window:
            return False
        mean = [value / self._length for value in self._sums]
        self._clear()
        return self._judge(mean)

    def _judge(self, u: list[float]) -> bool:
        c = self.config
        low, high = c.steady
        if not low < sum(u) / sum(self.reference) < high:
            return False
        self._windows.append(u)
        u = self.u = [sum(column) / len(self._windows) for column in zip(*self._windows, strict=True)]
        found = self._compare(u)
        self._agreeing = self._agreeing + 1 if found == self._found else 1
        self._found = found
        if self._agreeing < c.agree or found == (self.state, self.rotor):
            return False
        self.state, self.rotor = found
        return True

    def _compare(self, u: list[float]) -> tuple[Trim, int]:
        """Return what one window says, and of which rotor."""
        c = self.config
        n = len(u)
        mean = sum(u) / n
        d = [(now - usual) / mean for now, usual in zip(u, self.reference, strict=True)]
        self.yaw = sum(spin * change for spin, change in zip(self._spin, d, strict=True))
        total = sum(change * change for change in d) or 1.0
        raised = [math.sqrt(now / usual) - 1.0 for now, usual in zip(u, self.reference, strict=True)]
        if max(raised) <= c.changed:
            self.explained = math.nan
            return Trim.USUAL, -1
        cut = max(range(n), key=d.__getitem__)
        as_cut = d[cut] * d[cut] / total
        fits = [_explained(d, pattern, total) for pattern in self._loads]
        load = max(range(n), key=fits.__getitem__)
        self.explained = max(as_cut, fits[load])
        if not all(self._spin):
            return Trim.UNCLEAR, -1
        if self.yaw * self._spin[cut] > c.yaw_cut and raised[cut] > c.changed and as_cut > fits[load]:
            return Trim.CUT, cut
        if abs(self.yaw) < c.yaw_load:
            return Trim.LOAD, load
        return Trim.UNCLEAR, -1

    def left(self, rotor: int) -> float:
        """Return what a rotor has left of its thrust, 1 = all [-]."""
        return min(self.reference[rotor] / max(self.u[rotor], 1e-9), 1.5)


def _explained(d: list[float], pattern: list[float], total: float) -> float:
    """Return the share of d's squares that a positive multiple of the pattern explains."""
    along = sum(a * b for a, b in zip(d, pattern, strict=True))
    return max(along, 0.0) ** 2 / sum(a * a for a in pattern) / total
