"""Degradation from rotor speeds: by what of them no mixer commands, and, where commands are known, against those.

    speeds    e = P W / mean W less its own healthy value          -> k (`speed_span.py`)
    commands  k_i = 1 - (W_i / u_i) / (its healthy value) / c,     c : the median over the rotors (voltage sags)

Healthy trims differ by 20 % between rotors and days (sheet 5 section 4): the own healthy values are learned over the
first 10 s of flight, and until then doubted by as much. Speeds alone never decide on a vehicle that nobody
has trained. Source: sheet 4 sections 4 and 6.7.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.estimators.onset import Onset
from gcs_health.estimators.speed_span import Array, Span, SpeedFacts
from gcs_health.samples import CommandReading, RotorReading

BLOCK = 0.1  # s
FASTEST = 1e5  # rad/s
LEAST_COMMAND = 0.02


@dataclass(frozen=True, slots=True)
class SpeedConfig:
    """Windows, spreads and thresholds of the speed path."""

    fast: int = 5  # blocks of 0.1 s in which a fault is seen
    lasting: int = 3  # looks on end that must see it: a landing is shorter (indiflight_00230)
    value: int = 20  # blocks over which it is measured
    learn: float = 10.0  # s of flight that teach the own healthy values
    flying: float = 0.7  # of the highest mean speed so far
    risen: float = 1.25  # a mean higher by so much was no flight before: learn anew
    between: float = 0.10  # of speeds and of speed per command, over healthy rotors; sheet 5 section 4
    drift: float = 0.02  # of speeds within a flight: half the 3-6 % by which squared commands move
    drift_command: float = 0.01  # of speed per command within a flight, voltage removed
    exponent: float = 0.3  # speed goes with command to the power 1 +- so much
    exponent_trained: float = 0.03
    error: float = 0.05  # of k by geometry alone, relative; at least this much at k = 1
    sigmas: float = 5.0  # at which an alarm is given
    bound: float = 2.0  # of the exponent's doubt that an alarm must exceed
    least: float = 0.08  # k that is never an alarm
    least_trained: float = 0.03


@dataclass(frozen=True, slots=True)
class SpeedView:
    """One rotor's answer.

    k, std : over 2 s. k_fast, std_fast : over 0.5 s; threshold : what k_fast must exceed. by_command : commands were
    known. settled : the own healthy values are learned. decides : whether it may raise an alarm.
    """

    k: float
    std: float
    k_fast: float
    std_fast: float
    threshold: float
    by_command: bool
    settled: bool
    decides: bool


class _Healthy:
    """Healthy values of one figure a rotor, learned once in a flight, and how much its fast windows scatter."""

    def __init__(self, prior: Array, between: float, drift: float, learn: int) -> None:
        self.value, self.between, self.drift, self.learn = prior, between, drift, learn
        self._sum, self._squares = np.zeros(len(prior)), np.zeros(len(prior))
        self._count = 0
        self._scatter = between

    def teach(self, fast: Array) -> None:
        """Take a fast window's values, while learning."""
        if self.settled:
            return
        self._count += 1
        self._sum += fast
        self._squares += fast * fast
        if self.settled:
            self.value = self._sum / self._count
            variance = np.maximum(self._squares / self._count - self.value**2, 0.0)
            self._scatter = float(np.sqrt(variance.mean()))

    @property
    def settled(self) -> bool:
        """Whether learning is over."""
        return self._count >= self.learn

    def spread(self, share: float) -> float:
        """Return the standard deviation of a window's value about the healthy one; share of a fast one's scatter."""
        return math.hypot(self.drift if self.settled else self.between, share * self._scatter)


class SpeedDeficit:
    """Feed rotor speeds and commands; `views` is the last answer, one a rotor, None where there is none.

    Attributes
    ----------
    span : of the mixer. worst : the rotor farthest below its command: single faults, and the command of its
        opposite may fall to almost nothing.
    landed : as the autopilot says. speeds_at, commands_at, speed_t : when they last came [s].
    """

    def __init__(self, airframe: Airframe, config: SpeedConfig, facts: SpeedFacts | None = None) -> None:
        self.config, self.facts = config, facts
        self.span = Span(airframe)
        self.n = len(airframe.rotors)
        self.commands_at = self.speeds_at = -math.inf
        self.speed_t = [-math.inf] * self.n
        self.landed: bool | None = None
        self.views: list[SpeedView | None] = [None] * self.n
        self.worst = 0
        self._index = -1
        self._open = np.zeros((4, self.n))  # speed sum and count, command sum and count, of the open block
        self._ring: deque[tuple[int, Array]] = deque(maxlen=config.value)
        self._top = 0.0
        self._learn_anew()

    def _learn_anew(self) -> None:
        c, facts, blocks = self.config, self.facts, round(self.config.learn / BLOCK)
        prior = np.zeros(self.n) if facts is None else facts.healthy.copy()
        between, drift = (c.between, c.drift) if facts is None else (facts.between, facts.drift)
        self._outside = _Healthy(prior, between, drift, blocks)
        self._gains = _Healthy(
            np.ones(self.n), c.between, c.drift_command if facts is None else drift, blocks
        )
        self._rests = _Healthy(np.full(self.n, math.nan), 0.0, 0.0, blocks)
        self._onset = Onset(self.span.alike, self.span.own)
        self._seen: deque[Array] = deque(maxlen=self.config.lasting)

    @property
    def named(self) -> int | None:
        """The rotor that the onset told from its opposite."""
        return self._onset.named

    @property
    def trained(self) -> bool:
        """Whether healthy flights of the type were learned from."""
        return self.facts is not None

    def speeds(self, reading: RotorReading) -> bool:
        """Take rotor speeds; return whether there is a new answer."""
        new = self._turn(reading.t)
        for i, speed in enumerate(reading.speed[: self.n]):
            if 0.0 <= speed < FASTEST and reading.t >= self.speed_t[i]:
                self._open[0, i] += speed
                self._open[1, i] += 1.0
                self.speed_t[i] = self.speeds_at = reading.t
        return new

    def commands(self, reading: CommandReading) -> bool:
        """Take motor commands; return whether there is a new answer."""
        new = self._turn(reading.t)
        for i, command in enumerate(reading.command[: self.n]):
            if LEAST_COMMAND < command < 10.0:
                self._open[2, i] += command
                self._open[3, i] += 1.0
                self.commands_at = reading.t
        return new

    def _turn(self, t: float) -> bool:
        """Close the open block when time has left it."""
        index = math.floor(t / BLOCK)
        if index <= self._index:
            return False
        if self._index >= 0 and self._open.any():
            self._ring.append((self._index, self._open))
            self._open = np.zeros((4, self.n))
        self._index = index
        while self._ring and self._ring[0][0] < index - self.config.value:
            self._ring.popleft()
        self._look()
        return True

    def _means(self, blocks: int) -> tuple[Array, Array]:
        """Return mean speeds and commands over the newest blocks; NaN where there were none."""
        edge = self._index - blocks
        total = np.zeros((4, self.n))
        for index, row in self._ring:
            if index >= edge:
                total += row
        with np.errstate(invalid="ignore"):
            return total[0] / total[1], total[2] / total[3]

    def _look(self) -> None:
        c = self.config
        self.views = [None] * self.n
        slow, slow_u = self._means(c.value)
        fast, fast_u = self._means(c.fast)
        mean, mean_fast = float(slow.mean()), float(fast.mean())
        if not (mean > 0.0 and mean_fast > 0.0) or not self._flies(mean):
            return
        if math.isfinite(slow_u.sum()) and math.isfinite(fast_u.sum()):
            gain, gain_fast = _relative(slow, slow_u), _relative(fast, fast_u)
            self._gains.teach(gain_fast)
            self._rests.teach(fast_u)
            self.views = self._by_command(gain, gain_fast, slow_u)
        elif self.span.shows:
            outside = self.span.outside(fast)
            self._outside.teach(outside)
            self.views = self._by_span(slow, fast, outside)
            newest, _ = self._means(1)
            if self._outside.settled and newest.mean() > 0.0:
                e = self.span.outside(newest) - self._outside.value
                self._onset.feed(newest / newest.mean(), e)

    def _flies(self, mean: float) -> bool:
        if self.landed:
            return False
        if mean > self.config.risen * self._top:
            self._learn_anew()
            self._top = mean
        self._top = max(self._top, mean)
        return mean > self.config.flying * self._top

    def _lasting(self, k: Array) -> list[float]:
        """Return the least of the last few looks."""
        self._seen.append(k)
        return (
            [float(value) for value in np.min(self._seen, axis=0)] if len(self._seen) > 1 else [0.0] * self.n
        )

    def _by_span(self, slow: Array, fast: Array, outside: Array) -> list[SpeedView | None]:
        c, span, healthy = self.config, self.span, self._outside
        k = span.degradation(span.outside(slow) - healthy.value, slow).tolist()
        k_fast = self._lasting(span.degradation(outside - healthy.value, fast))
        least, error = (c.least, c.error) if self.facts is None else (c.least_trained, self.facts.error)
        out: list[SpeedView | None] = []
        for i, own in enumerate(span.own.tolist()):
            if not span.shown[i]:
                out.append(None)
                continue
            rest = min(max(1.0 - k[i], 0.1), 1.0) / own  # dk / de falls as the rotor slows
            std, std_fast = healthy.spread(0.5) * rest + error, healthy.spread(1.0) / own
            threshold = max(least, c.sigmas * std_fast)
            out.append(
                SpeedView(k[i], std, k_fast[i], std_fast, threshold, False, healthy.settled, self.trained)
            )
        return out

    def _by_command(self, gain: Array, gain_fast: Array, commands: Array) -> list[SpeedView | None]:
        c, healthy = self.config, self._gains
        value, value_fast = gain / healthy.value, gain_fast / healthy.value
        k, k_fast = 1.0 - value / np.median(value), self._lasting(1.0 - value_fast / np.median(value_fast))
        least, exponent = (c.least_trained, c.exponent_trained) if self.trained else (c.least, c.exponent)
        doubt = np.zeros(self.n)
        if self._rests.settled:  # what a wrong exponent makes of commands that left their healthy values
            away = np.log(commands / self._rests.value)
            doubt = exponent * np.abs(away - np.median(away))
        settled = healthy.settled
        self.worst = int(np.argmax(k_fast))
        out: list[SpeedView | None] = []
        for i, more in enumerate(doubt.tolist()):
            std, std_fast = math.hypot(healthy.spread(0.5), more), math.hypot(healthy.spread(1.0), more)
            # the exponent's doubt has a bound, unlike noise
            threshold = max(least, c.sigmas * healthy.spread(1.0) + c.bound * more)
            out.append(SpeedView(float(k[i]), std, k_fast[i], std_fast, threshold, True, settled, settled))
        return out


def _relative(speeds: Array, commands: Array) -> Array:
    """Return (n,): speed per command over the rotors' median, so that voltage falls out."""
    gain = speeds / commands
    return np.asarray(gain / max(float(np.median(gain)), 1e-12))
