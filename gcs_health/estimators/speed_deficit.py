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
from typing import NamedTuple

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


class SpeedView(NamedTuple):
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

    def __init__(self, prior: list[float], between: float, drift: float, learn: int) -> None:
        self.value, self.between, self.drift, self.learn = prior, between, drift, learn
        self._sum, self._squares = [0.0] * len(prior), [0.0] * len(prior)
        self._count = 0
        self._scatter = between

    def teach(self, fast: list[float]) -> None:
        """Take a fast window's values, while learning."""
        if self.settled:
            return
        self._count += 1
        self._sum = [total + value for total, value in zip(self._sum, fast, strict=True)]
        self._squares = [total + value * value for total, value in zip(self._squares, fast, strict=True)]
        if self.settled:
            self.value = [total / self._count for total in self._sum]
            pairs = zip(self._squares, self.value, strict=True)
            variance = [max(squares / self._count - value * value, 0.0) for squares, value in pairs]
            self._scatter = math.sqrt(sum(variance) / len(variance))

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
        self._open = [[0.0] * self.n for _ in range(4)]  # speed sum and count, command sum and count
        self._blocks = np.zeros((config.value, 4, self.n))  # likewise of the closed blocks, the newest last
        self._top = 0.0
        self._learn_anew()

    def _learn_anew(self) -> None:
        c, facts, blocks = self.config, self.facts, round(self.config.learn / BLOCK)
        prior = [0.0] * self.n if facts is None else facts.healthy.tolist()
        between, drift = (c.between, c.drift) if facts is None else (facts.between, facts.drift)
        self._outside = _Healthy(prior, between, drift, blocks)
        self._gains = _Healthy([1.0] * self.n, c.between, c.drift_command if facts is None else drift, blocks)
        self._rests = _Healthy([math.nan] * self.n, 0.0, 0.0, blocks)
        self._onset = Onset(self.span.alike, self.span.own)
        self._seen: deque[list[float]] = deque(maxlen=self.config.lasting)

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
        t, speed_t = reading.t, self.speed_t
        new = self._turn(t)
        total, count, _, _ = self._open
        for i, speed in enumerate(reading.speed[: self.n]):
            if 0.0 <= speed < FASTEST and t >= speed_t[i]:
                total[i] += speed
                count[i] += 1.0
                speed_t[i] = self.speeds_at = t
        return new

    def commands(self, reading: CommandReading) -> bool:
        """Take motor commands; return whether there is a new answer."""
        new = self._turn(reading.t)
        _, _, total, count = self._open
        for i, command in enumerate(reading.command[: self.n]):
            if LEAST_COMMAND < command < 10.0:
                total[i] += command
                count[i] += 1.0
                self.commands_at = reading.t
        return new

    def _turn(self, t: float) -> bool:
        """Close the open block when time has left it."""
        index = math.floor(t / BLOCK)
        if index <= self._index:
            return False
        if self._index >= 0:
            passed = min(index - self._index, len(self._blocks))
            self._blocks[:-passed] = self._blocks[passed:].copy()
            self._blocks[-passed:] = 0.0
            if index - self._index <= len(self._blocks):
                self._blocks[-passed] = self._open
            self._open = [[0.0] * self.n for _ in range(4)]
        self._index = index
        self._look()
        return True

    def _means(self, blocks: int) -> tuple[list[float], list[float]]:
        """Return mean speeds and commands over the newest blocks; NaN where there were none."""
        speeds, heard, commands, given = self._blocks[-blocks:].sum(axis=0).tolist()
        return list(map(_ratio, speeds, heard)), list(map(_ratio, commands, given))

    def _look(self) -> None:
        c = self.config
        self.views = [None] * self.n
        slow, slow_u = self._means(c.value)
        fast, fast_u = self._means(c.fast)
        mean, mean_fast = sum(slow) / self.n, sum(fast) / self.n
        if not (mean > 0.0 and mean_fast > 0.0) or not self._flies(mean):
            return
        if math.isfinite(sum(slow_u)) and math.isfinite(sum(fast_u)):
            gain, gain_fast = _relative(slow, slow_u), _relative(fast, fast_u)
            self._gains.teach(gain_fast)
            self._rests.teach(fast_u)
            self.views = self._by_command(gain, gain_fast, slow_u)
        elif self.span.shows:
            outside = self.span.outside(np.array(fast))
            self._outside.teach(outside.tolist())
            self.views = self._by_span(np.array(slow), np.array(fast), outside)
            newest = np.array(self._means(1)[0])
            if self._outside.settled and newest.mean() > 0.0:
                e = self.span.outside(newest) - np.array(self._outside.value)
                self._onset.feed(newest / newest.mean(), e, float(self._blocks[:, 1].mean()))

    def _flies(self, mean: float) -> bool:
        if self.landed:
            return False
        if mean > self.config.risen * self._top:
            self._learn_anew()
            self._top = mean
        self._top = max(self._top, mean)
        return mean > self.config.flying * self._top

    def _lasting(self, k: list[float]) -> list[float]:
        """Return the least of the last few looks."""
        self._seen.append(k)
        return list(map(min, *self._seen)) if len(self._seen) > 1 else [0.0] * self.n

    def _by_span(self, slow: Array, fast: Array, outside: Array) -> list[SpeedView | None]:
        c, span, healthy = self.config, self.span, self._outside
        usual = np.array(healthy.value)
        k = span.degradation(span.outside(slow) - usual, slow).tolist()
        k_fast = self._lasting(span.degradation(outside - usual, fast).tolist())
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

    def _by_command(
        self, gain: list[float], gain_fast: list[float], commands: list[float]
    ) -> list[SpeedView | None]:
        c, healthy = self.config, self._gains
        k = _deficits(list(map(_ratio, gain, healthy.value)))
        k_fast = self._lasting(_deficits(list(map(_ratio, gain_fast, healthy.value))))
        least, exponent = (c.least_trained, c.exponent_trained) if self.trained else (c.least, c.exponent)
        doubt = [0.0] * self.n
        if self._rests.settled:  # what a wrong exponent makes of commands that left their healthy values
            away = [math.log(u / rest) for u, rest in zip(commands, self._rests.value, strict=True)]
            middle = _median(away)
            doubt = [exponent * abs(each - middle) for each in away]
        settled = healthy.settled
        spread, spread_fast = healthy.spread(0.5), healthy.spread(1.0)
        self.worst = k_fast.index(max(k_fast))
        out: list[SpeedView | None] = []
        for i, more in enumerate(doubt):
            std, std_fast = math.hypot(spread, more), math.hypot(spread_fast, more)
            # the exponent's doubt has a bound, unlike noise
            threshold = max(least, c.sigmas * spread_fast + c.bound * more)
            out.append(SpeedView(k[i], std, k_fast[i], std_fast, threshold, True, settled, settled))
        return out


# so few rotors that plain lists are several times as fast as arrays


def _relative(speeds: list[float], commands: list[float]) -> list[float]:
    """Return (n,): speed per command over the rotors' median, so that voltage falls out."""
    gain = list(map(_ratio, speeds, commands))
    middle = max(_median(gain), 1e-12)
    return [each / middle for each in gain]


def _deficits(value: list[float]) -> list[float]:
    """Return (n,): by how much of the rotors' median each falls short of it."""
    middle = _median(value)
    return [1.0 - _ratio(each, middle) for each in value]


def _ratio(over: float, under: float) -> float:
    return over / under if under else math.nan


def _median(values: list[float]) -> float:
    """Return the median; NaN where any is."""
    if any([value != value for value in values]):
        return math.nan
    row, half = sorted(values), len(values) // 2
    return row[half] if len(row) % 2 else 0.5 * (row[half - 1] + row[half])
