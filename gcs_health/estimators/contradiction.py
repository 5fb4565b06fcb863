"""A vehicle that falls towards a rotor although that rotor is told to push: a total loss, without any model.

    f_i = (y_i p - x_i q) / |r_i|       rate of falling towards rotor i [rad/s]
    u_i = command²                      about its thrust

Rotor i is named where f_i is above 1.5 rad/s and grew by .5 within 120 ms, while from 60 ms before those
120 ms until now u_i stayed above that of the opposite rotor by more than .4 of the hover value: the controller
did what it could, and the vehicle went the other way. Slower than the fault bank, but it needs no rotor speeds,
no gains and no high rate of commands.

Source: sheet 5 section 4 (531 s of flight without a false alarm).
"""

import math
from collections import deque
from dataclasses import dataclass

from gcs_health.airframe import Airframe


@dataclass(frozen=True, slots=True)
class ContradictionConfig:
    """Thresholds of the test, sheet 5 section 4."""

    falling: float = 1.5  # rad/s
    grown: float = 0.5  # rad/s ...
    within: float = 0.12  # s
    lag: float = 0.06  # s from a command to what comes of it
    push: float = 0.4  # of the hover value of u
    flying: float = 1.0  # s of turning rotors before anything is judged; this project
    off: float = 0.02  # mean u below which the rotors do not fly; this project
    memory: float = 5.0  # s, of the hover value; this project
    gap: float = 0.5  # s without commands, or rates: nothing reaches across; this project


class Contradiction:
    """Fed commands and rates; names the rotor that does not push.

    Attributes
    ----------
    rotor : the one named, None = none.
    """

    def __init__(self, airframe: Airframe, config: ContradictionConfig) -> None:
        self.config = config
        places = [rotor.position[:2] for rotor in airframe.rotors]
        reach = [math.hypot(x, y) or 1.0 for x, y in places]
        self._towards = [(y / r, -x / r) for (x, y), r in zip(places, reach, strict=True)]
        self._opposite = [
            min(range(len(places)), key=lambda j: x * places[j][0] + y * places[j][1]) for x, y in places
        ]
        self.restart()

    def restart(self) -> None:
        """Begin a new flight."""
        self.rotor: int | None = None
        self._commands: deque[tuple[float, list[float]]] = deque()  # time, u of each rotor
        self._rates: deque[tuple[float, float, float]] = deque()  # time, p, q
        self._flown = 0.0
        self._hover = 0.0  # usual mean u

    def commands(self, t: float, u: list[float]) -> None:
        """Take the squared commands of all rotors."""
        c = self.config
        mean = sum(u) / len(u)
        recent = self._commands
        dt = t - recent[-1][0] if recent else math.inf
        if dt <= 0.0:
            return
        if dt > c.gap or mean < c.off:
            recent.clear()
            self._flown = 0.0
        else:
            self._flown += dt
            self._hover += min(1.0, dt / min(c.memory, self._flown)) * (mean - self._hover)
        recent.append((t, u))
        while len(recent) > 1 and t - recent[1][0] > c.within + c.lag + c.gap:
            recent.popleft()

    def rates(self, t: float, p: float, q: float) -> bool:
        """Take body rates [rad/s]; return whether a rotor was named."""
        c = self.config
        rates = self._rates
        if not (p - p == 0.0 and q - q == 0.0) or (rates and t <= rates[-1][0]):
            return False
        if rates and t - rates[-1][0] > c.within:
            rates.clear()
        rates.append((t, p, q))
        while len(rates) > 1 and t - rates[1][0] >= c.within:
            rates.popleft()
        if self.rotor is not None or self._flown < c.flying or t - self._commands[-1][0] > c.gap:
            return False
        first, p0, q0 = rates[0]
        if t - first < 0.5 * c.within or math.hypot(p, q) < c.falling:
            return False
        for i, (a, b) in enumerate(self._towards):
            falling = a * p + b * q
            if falling > c.falling and falling - a * p0 - b * q0 > c.grown and self._pushed(t, i):
                self.rotor = i
                return True
        return False

    def _pushed(self, t: float, rotor: int) -> bool:
        """Whether the rotor was told to push more than its opposite, all the while."""
        c = self.config
        opposite = self._opposite[rotor]
        limit = c.push * self._hover
        begin = t - c.lag - c.within
        said = False
        for k, (at, u) in enumerate(self._commands):
            until = self._commands[k + 1][0] if k + 1 < len(self._commands) else math.inf
            if until <= begin:
                continue  # replaced before the time that counts
            if u[rotor] - u[opposite] <= limit:
                return False
            said = said or at <= t - c.lag
        return said
