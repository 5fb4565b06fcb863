"""Speed against command: a rotor that does not turn although it is told to, and one that was told to stand.

    g_i = W_i / u_i, learned in flight with a memory of 5 s; held against the median of all g_i / learned, so that a
    sagging battery is no fault
    slow: W_i below half of what the least command of the last 0.3 s gives, for 0.2 s; without current below .8 of
    it, in two readings 0.06 s apart, if a command between bids it still, and does not fall: before a controller that
    gives it up cuts it

Least command, because commands come late and seldom: a speed that lags behind a jump is well. A rotor that brakes
passes through no current, and its order to slow down may not have come yet. Under current it is
stuck, without it is stopped; where currents are not known it may be either. A rotor whose command went to zero after
another one failed was switched off by the controller: that is no second fault.
"""

import math
from collections import deque

from gcs_health.fusion.kinds import Kind
from gcs_health.fusion.verdicts import BOUND, Evidence
from gcs_health.samples import CommandReading, RotorReading

MEMORY, LEARN = 5.0, 2.0  # s, of the gains; and s of flight until they are believed
EARLY = 10.0  # s of flight: against what they are then a sag is told
WINDOW, HOLD, HOLD_UNDRIVEN, STALE = 0.3, 0.2, 0.06, 0.5  # s
SLOW, UNDRIVEN, STANDS = 0.5, 0.8, 0.05  # of the speed that the command gives
OFF, BIDDEN = 0.1, 0.8  # of the usual command: an order to stand; one that shows that it should turn
UNDER_CURRENT, NO_CURRENT = 0.5, 0.15  # of the usual current
LEAST = 0.02  # command
LASTS = 1.0  # s


class Commanded:
    """Fed speeds and commands of one vehicle; returns evidence only where there is something to say."""

    def __init__(self, rotors: int) -> None:
        self._n = rotors
        self.new_flight()

    def new_flight(self) -> None:
        """Forget the flight before."""
        n = self._n
        self._commands: deque[CommandReading] = deque(maxlen=64)
        self._gain, self._usual, self._current = [math.nan] * n, [math.nan] * n, [math.nan] * n
        self._flown = 0.0
        self._early: list[float] | None = None  # gains once they were learned
        self._t = math.nan
        self._slow_since = [math.nan] * n
        self._speed, self._now = [math.nan] * n, [math.nan] * n

    def command(self, reading: CommandReading) -> None:
        """Take commands."""
        recent = self._commands
        recent.append(reading)
        while len(recent) > 1 and recent[1].t <= reading.t - WINDOW:
            recent.popleft()

    def rotors(self, reading: RotorReading, flies: bool) -> list[Evidence]:
        """Take speeds; `flies` = the autopilot says that the vehicle is in the air."""
        t, recent = reading.t, self._commands
        dt, self._t = t - self._t, t
        if not flies or not recent or t - recent[-1].t > STALE or not 0.0 < dt < STALE:
            self._slow_since = [math.nan] * self._n
            return []
        self._flown += dt
        least = recent[0].command if len(recent) == 1 else tuple(map(min, *[each.command for each in recent]))
        share = min(1.0, dt / min(MEMORY, self._flown))
        gains = []
        for k, (speed, current, u) in enumerate(
            zip(reading.speed, reading.current, recent[-1].command, strict=True)
        ):
            if speed == speed:
                self._speed[k], self._now[k] = speed, current
            gain = self._speed[k] / u if u > LEAST else math.nan
            usual = self._gain[k]
            gains.append(gain / usual)
            if gain != gain or gain / usual < UNDRIVEN:
                continue  # what may be the fault itself teaches nothing
            self._gain[k] = gain if usual != usual else usual + share * (gain - usual)
            self._usual[k] = _towards(self._usual[k], u, share)
            self._current[k] = _towards(self._current[k], self._now[k], share)
        if self._flown < LEARN:
            return []
        if self._early is None and self._flown >= EARLY:
            self._early = self._gain[:]
        known = sorted(gain for gain in gains if gain == gain)
        if len(known) < 3:
            return []
        common = min(known[len(known) // 2], 1.0)  # above, all follow a command that has just fallen
        each = range(self._n)
        return [said for k in each if (said := self._judge(t, dt, k, least[k], common)) is not None]

    def sag(self) -> float:
        """Return the speed of all rotors for the same command, against early in the flight [-]; NaN = not known."""
        if self._early is None:
            return math.nan
        ratios = [now / then for now, then in zip(self._gain, self._early, strict=True)]
        ratios = sorted(ratio for ratio in ratios if ratio == ratio)
        return ratios[len(ratios) // 2] if ratios else math.nan

    def switched_off(self, rotor: int) -> bool:
        """Whether its last command was to stand."""
        usual = self._usual[rotor]
        return bool(self._commands) and self._commands[-1].command[rotor] < OFF * usual

    def _judge(self, t: float, dt: float, k: int, least: float, common: float) -> Evidence | None:
        wanted = least * self._gain[k] * common
        current = self._now[k] / self._current[k] if self._current[k] else math.nan
        undriven = abs(current) < NO_CURRENT  # one that brakes is driven
        limit, hold = (UNDRIVEN, max(HOLD_UNDRIVEN, 0.9 * dt)) if undriven else (SLOW, HOLD)
        if not (least > SLOW * self._usual[k] and self._speed[k] < limit * wanted):
            self._slow_since[k] = math.nan
            return None
        if self._slow_since[k] != self._slow_since[k]:
            self._slow_since[k] = t
        last = self._commands[-1]
        bidden = last.t > self._slow_since[k] and last.command[k] >= BIDDEN * self._usual[k]
        if t - self._slow_since[k] < hold or (undriven and not bidden):
            return None
        stands = self._speed[k] < STANDS * wanted
        stopped = stuck = BOUND
        if current > UNDER_CURRENT:
            stopped, stuck = -BOUND, BOUND if stands else 0.0
        elif undriven:
            stuck = -3.0
        figures: tuple[tuple[str, float | str], ...] = (
            ("speed_over_commanded", self._speed[k] / wanted),
            ("current_over_usual", current),
        )
        odds = ((Kind.MOTOR_STOPPED, stopped), (Kind.MOTOR_STUCK, stuck))
        return Evidence(t, k, "command", odds, True, LASTS, figures)


def _towards(value: float, new: float, share: float) -> float:
    if new != new:
        return value
    return new if value != value else value + share * (new - value)
