"""A motor that is not driven: no current flows and it runs down. Its propeller is not the one to blame.

While it runs down the balance of torques still shows a healthy propeller, until the rotor is too slow to
tell. A lost propeller is the other way about: little current at full speed. So: slower than .45 of the other
rotors, which fly, with less current than its speed would take by their measure.

A controller that idles a rotor (the one opposite to a lost one) looks alike while it slows down, and like a driven
one when it idles. Commands tell; without them the rule waits longer, and takes back what it said.

Source: sheet 3, recommended mode, step 9; the current's measure, hold times and commands are this project's.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class UndrivenConfig:
    """Thresholds of the rule."""

    slow: float = 0.45  # of the other rotors' mean speed
    slowest: float = 0.2  # likewise; below, a current says nothing until the rotor stands
    standing: float = 0.05
    share: float = 0.4  # of the current that the speed would take
    no_current: float = 0.1  # A, where it stands
    others: float = 0.6  # of the level, mean of the other rotors
    hold: float = 0.03  # s, where the commands say that it should turn
    hold_unasked: float = 0.5  # s without commands
    asked: float = 0.5  # of the others' mean command; less is an order to turn slowly
    flying: float = 0.5  # s that it must have flown before
    again: float = 0.6  # of the other rotors' mean speed at which it is driven again


@dataclass(slots=True)
class _Slow:
    """A spell at little speed: its length, and charge against what the speed would take, over it."""

    time: float = 0.0
    charge: float = 0.0
    usual: float = 0.0


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
        self._spells = [_Slow() for _ in range(rotors)]
        self._quiet = True  # no rotor is slow or was called undriven
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
        if total != total or not 0.0 < dt < 1.0:
            return False
        slowest = min(speeds)
        if self._quiet and slowest * (n - 1) >= c.again * (total - slowest):  # the usual case
            if slowest > c.slow * level:
                self._flown = [flown + dt for flown in self._flown]
            return False
        self._quiet = False
        changed = False
        drawn = sum(currents)
        for k, speed in enumerate(speeds):
            peers = (total - speed) / (n - 1)
            usual = (drawn - currents[k]) / (n - 1) * (speed / peers) ** 2 if peers > 0.0 else math.nan
            verdict = self._judge(k, dt, speed, currents[k], peers, usual, level, commands)
            if verdict is not None and verdict is not self.undriven[k]:
                self.undriven[k] = verdict
                changed = True
        self._quiet = not any(self.undriven) and all([spell.time == 0.0 for spell in self._spells])
        return changed

    def _judge(
        self,
        k: int,
        dt: float,
        speed: float,
        current: float,
        peers: float,
        usual: float,
        level: float,
        commands: list[float],
    ) -> bool | None:
        """Return whether a motor is undriven; None where this moment does not say."""
        c = self.config
        spell = self._spells[k]
        if speed > c.again * peers:
            self._spells[k] = _Slow()
            return False
        standing = speed < c.standing * peers
        if not (speed < c.slow * peers and peers > c.others * level):
            self._spells[k] = _Slow()
            return None
        if not standing and speed < c.slowest * peers:
            return None
        spell.time += dt
        spell.charge += dt * current
        spell.usual += dt * usual
        asked = self._asked(k, commands)
        if spell.time < (c.hold if asked else c.hold_unasked):
            return None
        self._spells[k] = _Slow()
        if standing:
            none = abs(spell.charge) < c.no_current * spell.time
        else:
            none = abs(spell.charge) < c.share * spell.usual
        if not none:
            return False
        return True if asked is not False and self._flown[k] > c.flying else None

    def _asked(self, rotor: int, commands: list[float]) -> bool | None:
        """Whether the motor is commanded to turn about as the others do; None where that is not known."""
        others = (sum(commands) - commands[rotor]) / (len(commands) - 1)
        mine = commands[rotor]
        return None if mine != mine or others != others else mine >= self.config.asked * others
