"""A motor that is not driven: no current flows and it runs down. Its propeller is not the one to blame.

At coasting speed i ~ 0 and the balance of torques still shows a healthy propeller, until the rotor is too slow
to tell. A lost propeller is the other way about: little current at full speed. So: no current, and slower than
.45 of the other rotors, which fly.

Source: sheet 3, recommended mode, step 9; hold times and the commands' part are this project's.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class UndrivenConfig:
    """Thresholds of the rule."""

    slow: float = 0.45  # of the other rotors' mean speed
    current: float = 0.1  # of the other rotors' mean current
    offset: float = 0.5  # A that an idle ESC may be off
    others: float = 0.6  # of the level, mean of the other rotors
    hold: float = 0.03  # s, where the commands say that it should turn
    hold_unasked: float = 0.25  # s without commands: hard flying idles a rotor that long
    asked: float = 0.5  # of the others' mean command; less is an order to turn slowly
    flying: float = 0.5  # s that it must have flown before
    again: float = 0.6  # of the other rotors' mean speed at which it is driven again


class UndrivenMotor:
    """Fed the latest speeds and currents with every rotor reading.

    Attributes
    ----------
    undriven : (n,) whether each motor is held for not driven.
    """

    def __init__(self, rotors: int, config: UndrivenConfig) -> None:
        self.config = config
        self.undriven = [False] * rotors
        self._flown = [0.0] * rotors
        self._since = [math.nan] * rotors
        self._t = math.nan

    def feed(
        self, t: float, speeds: list[float], currents: list[float], level: float, commands: list[float]
    ) -> bool:
        """Take the latest of all rotors, NaN = never reported; return whether a verdict changed."""
        c = self.config
        n = len(speeds)
        total = sum(speeds)
        dt = t - self._t
        self._t = t
        if total != total:
            return False
        slowest = min(speeds)
        if slowest * (n - 1) >= c.again * (total - slowest) and not any(self.undriven):  # the usual case
            if 0.0 < dt < 1.0 and slowest > c.slow * level:
                self._flown = [flown + dt for flown in self._flown]
            self._since = [math.nan] * n
            return False
        changed = False
        for k, speed in enumerate(speeds):
            peers = (total - speed) / (n - 1)
            if self.undriven[k]:
                if speed > c.again * peers > 0.0:
                    self.undriven[k] = False
                    changed = True
                continue
            if self._is_dead(k, speeds, currents, peers, level):
                if self._since[k] != self._since[k]:
                    self._since[k] = t
                asked = self._asked(k, commands)
                hold = c.hold if asked else c.hold_unasked
                if asked is not False and t - self._since[k] >= hold and self._flown[k] > c.flying:
                    self.undriven[k] = True
                    self._since[k] = math.nan
                    changed = True
            else:
                self._since[k] = math.nan
        return changed

    def _is_dead(
        self, k: int, speeds: list[float], currents: list[float], peers: float, level: float
    ) -> bool:
        c = self.config
        if not (speeds[k] < c.slow * peers and peers > c.others * level):
            return False
        others = (sum(currents) - currents[k]) / (len(currents) - 1)
        return abs(currents[k]) < max(c.current * others, c.offset)

    def _asked(self, rotor: int, commands: list[float]) -> bool | None:
        """Whether the motor is commanded to turn about as the others do; None where that is not known."""
        others = (sum(commands) - commands[rotor]) / (len(commands) - 1)
        mine = commands[rotor]
        return None if mine != mine or others != others else mine >= self.config.asked * others
