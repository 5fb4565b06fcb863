"""How rotor speeds move between two slow samples of them: as the motor commands say.

    c_i    command of rotor i [-]            l_i    c_i through a first-order lag of the rotor's time constant
    b      speed per command [rad/s], one for all rotors, learned:  b = sum dl dw / sum dl²  over the steps
           dw, dl from each sample of the speeds to the next,  R² = (sum dl dw)² / (sum dl² sum dw²)
    w(t)   = straight line through the samples + b (l(t) - straight line through l at the samples)
    bend   = share of a rotor's part, per relative change of u within a tick, that is hidden all the same:
             T² / (8 tau dt) times `bend`, or `bend_commanded`, or between the two where commands come as seldom

Only differences of l count, so neither the command's zero nor its unit need be known. Before commands have
borne out how speeds move, b is 0 and nothing changes.

Source: sheet 1 section 7, step 2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import sub

from gcs_health.samples import CommandReading

Row = Sequence[float]


@dataclass(frozen=True, slots=True)
class CommandConfig:
    """Times and thresholds; this project, but for the time constant (sheet 1: 25 to 40 ms)."""

    lag: float = 0.035  # s
    memory: float = 20.0  # s, of what b is learned from
    least_r2: float = 0.5
    least_steps: int = 10  # between samples of the speeds
    stale: float = 0.15  # s after which the last command is no longer believed to hold
    rotor_time: float = 0.04  # s, time constant of a rotor's speed
    bend: float = 1.1  # of the deviation from a straight line between samples
    bend_commanded: float = 0.3  # likewise where commands tell how speeds move
    orders: float = 0.5  # of the time between samples: commands that come as often tell of every order
    pace: float = 0.1  # share of a new time between commands in the usual one
    kept: int = 256  # commands; half of them at 500 Hz are a quarter of a second


class CommandedSpeeds:
    """Fed commands and samples of the speeds.

    Attributes
    ----------
    r2 : how much of the speeds' steps the commands explain [-].
    trusted : whether the commands have borne out how speeds move.
    interval : usual time between commands [s]; infinite before two came.
    """

    def __init__(self, rotors: int, config: CommandConfig) -> None:
        self.config = config
        self.rotors = rotors
        self.r2 = 0.0
        self.trusted = False
        self.interval = math.inf
        self._speed_per_command = 0.0
        self._times: list[float] = []
        self._commands: list[Row] = []
        self._lagged: list[Row] = []  # at each command, before it acted
        self._steps = 0
        self._xx = self._xy = self._yy = 0.0
        self._before: tuple[float, Row, Row] | None = None  # t, speeds, lagged commands of the last sample

    def command(self, reading: CommandReading) -> None:
        """Take the commands of all rotors; some unknown, or late, and it is dropped."""
        t, command = reading
        total = sum(command)
        if len(command) != self.rotors or total - total != 0.0 or t - t != 0.0:
            return
        times = self._times
        if times and t <= times[-1]:
            return
        lagged = self._at(t) if times and t - times[-1] <= self.config.stale else command
        if times:
            self._pace(t - times[-1])
        times.append(t)
        self._commands.append(command)
        self._lagged.append(lagged if lagged is not None else command)
        if len(times) > self.config.kept:
            for kept in (times, self._commands, self._lagged):
                del kept[: self.config.kept // 2]

    def _pace(self, step: float) -> None:
        c = self.config
        if step <= c.stale:
            known = self.interval < math.inf
            self.interval = self.interval + c.pace * (step - self.interval) if known else step

    def learn(self, t: float, speeds: Row) -> None:
        """Take the sample of all speeds [rad/s] at time t [s]."""
        c = self.config
        lagged = self._at(t)
        before, self._before = self._before, None if lagged is None else (t, speeds, lagged)
        if before is None or lagged is None or not 0.0 < t - before[0] < 1.0:
            return
        keep = math.exp(-(t - before[0]) / c.memory)
        dw = list(map(sub, speeds, before[1]))
        dl = list(map(sub, lagged, before[2]))
        self._xx = keep * self._xx + sum(x * x for x in dl)
        self._xy = keep * self._xy + sum(x * y for x, y in zip(dl, dw, strict=True))
        self._yy = keep * self._yy + sum(y * y for y in dw)
        self._steps += 1
        if self._xy > 0.0 and self._steps >= c.least_steps:
            self.r2 = self._xy * self._xy / (self._xx * self._yy)
            self._speed_per_command = self._xy / self._xx if self.r2 >= c.least_r2 else 0.0
            self.trusted = self._speed_per_command > 0.0

    def moved(self, t: float, since: float) -> Row | None:
        """Return by how much each speed moved from `since` to t [rad/s]; None where commands do not tell."""
        if not self._speed_per_command:
            return None
        now, then = self._at(t), self._at(since)
        if now is None or then is None:
            return None
        b = self._speed_per_command
        return [b * (x - y) for x, y in zip(now, then, strict=True)]

    def corrected(self, speeds: Row, t: float, before: float, after: float) -> Row:
        """Return speeds (n,) at time t on the straight line between the samples `before` and `after` as they bend.

        Without a sample after it, `after` is infinite and `speeds` are those of the one before.
        """
        moved = self.moved(t, before)
        if moved is None:
            return speeds
        between = self.moved(after, before) if after < math.inf else None
        if between is None:
            return [max(w + m, 0.0) for w, m in zip(speeds, moved, strict=True)]
        share = (t - before) / (after - before)
        return [max(w + m - share * b, 0.0) for w, m, b in zip(speeds, moved, between, strict=True)]

    def bend(self, interval: float, dt: float) -> float:
        """Return what samples `interval` [s] apart hide of a rotor's part, per relative change of u within dt [s].

        A rotor of time constant tau that moves by D between two samples T apart leaves the straight line between
        them by some D T / 8 tau. What is ordered and taken back between two commands nobody tells.
        """
        c = self.config
        if not interval > dt:
            return 0.0
        hidden = c.bend * interval * interval
        if self.trusted:
            unseen = min(self.interval, interval)
            hidden = c.bend_commanded * interval * interval + (c.bend - c.bend_commanded) * unseen * unseen
        return hidden / (8.0 * c.rotor_time * dt)

    def tell_orders(self, interval: float) -> bool:
        """Whether commands come often enough to tell of an order between samples `interval` [s] apart."""
        return self.trusted and self.interval <= self.config.orders * interval

    def _at(self, t: float) -> Row | None:
        """Return the lagged commands at time t; None where no command is known to hold."""
        times = self._times
        j = len(times) - 1
        while j >= 0 and times[j] > t:
            j -= 1
        if j < 0 or t - times[j] > self.config.stale:
            return None
        keep = math.exp(-(t - times[j]) / self.config.lag)
        return [c + keep * (x - c) for c, x in zip(self._commands[j], self._lagged[j], strict=True)]
