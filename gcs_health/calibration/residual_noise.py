"""What is left when the model is taken from the measurement: its offset, spread and coherence.

Rows: 0 roll, 1 pitch, 2 yaw acceleration [rad/s²], 3 vertical specific force [m/s²].

    e = y - sum h_i      raw residual          b  slow offset           d = e - b
    R[age]               variance of d, one set for each age of the rotor speeds in IMU ticks
    kappa                Var(sum of the last 50 ms of d) / (L Var d): 1 where d is white

Source: sheet 1 section 6, with the start-up of sheet 5 section 3 rule 2.
"""

import math
from collections import deque
from dataclasses import dataclass

ROWS = 4
MAX_AGE = 12


@dataclass(frozen=True, slots=True)
class NoiseConfig:
    """How fast the residual's baseline is learned, and between which bounds."""

    typical: tuple[float, float, float, float] = (6.0, 6.0, 3.0, 2.0)  # sheet 5, rule 2
    typical_share: float = 0.12  # of one rotor's part in hover; 6 of the Bebop's 49 rad/s², this project
    floor: tuple[float, float, float, float] = (0.25, 0.25, 0.25, 0.04)  # variances; sheet 1, 6
    offset_time: float = 1.5  # s
    offset_first_time: float = 0.5  # s, after the gate opened
    noise_time: float = 8.0  # s
    noise_first_time: float = 1.5  # s, after the gate opened
    offset_clip: float = 2.5  # sigmas
    noise_clip: float = 3.5  # sigmas
    coherence_time: float = 0.05  # s
    age_growth: float = 30.0  # 1/s; R grows by 1 + 30 x age
    age_growth_limit: float = 4.0


class ResidualNoise:
    """Learns offset, variance by age and coherence of the four residuals; plain floats."""

    def __init__(self, config: NoiseConfig) -> None:
        self.config = config
        self.offset = [0.0] * ROWS
        self.variance = [[s * s for s in config.typical] for _ in range(MAX_AGE + 1)]
        self.coherence = [1.0] * ROWS
        self.learned_time = 0.0  # s of open gate that taught
        self._recent: deque[tuple[float, ...]] = deque()
        self._recent_sum = [0.0] * ROWS
        self._sum_variance = [s * s for s in config.typical]  # of the sum divided by its length

    def expect(self, roll: float, pitch: float) -> None:
        """Scale what is typical to the craft: one rotor's roll and pitch acceleration in hover [rad/s²].

        Small craft turn faster and shake harder. Only before anything was learned.
        """
        if self.learned_time > 0.0:
            return
        for row, hover in enumerate((roll, pitch)):
            sigma = max(self.config.typical[row], self.config.typical_share * hover)
            for variance in self.variance:
                variance[row] = sigma * sigma
            self._sum_variance[row] = sigma * sigma

    def restart(self) -> None:
        """Start anew as the gate opens: offset and sums forgotten, variances kept."""
        self.offset = [0.0] * ROWS
        self._recent.clear()
        self._recent_sum = [0.0] * ROWS

    def learn(self, e: list[float], dt: float, since_open: float, inflation: float) -> None:
        """Take one raw residual whose rotor speeds are bracketed.

        Parameters
        ----------
        e : 4 raw residuals (offset not taken off); NaN = row not used.
        dt : length of the tick [s].
        since_open : time since the gate opened [s].
        inflation : factor by which the variance is known to be raised now [-].
        """
        c = self.config
        variance = self.variance[0]
        gain = min(1.0, dt / min(c.noise_time, max(c.noise_first_time, since_open)))
        self.learned_time += dt
        offset_time = c.offset_first_time if since_open < c.offset_time else c.offset_time
        offset_gain = min(1.0, dt / min(offset_time, max(0.1, since_open)))
        clip2 = c.noise_clip * c.noise_clip
        step2 = c.offset_clip * c.offset_clip
        offset = self.offset
        taken = [0.0] * ROWS
        for row in range(ROWS):
            d = e[row] - offset[row]
            if d != d:
                continue
            now = variance[row]
            square = d * d / inflation
            if square > step2 * now:
                d = math.copysign(c.offset_clip * math.sqrt(now * inflation), d)
                if square > clip2 * now:
                    square = clip2 * now
            learned = now + gain * (square - now)
            variance[row] = learned if learned > c.floor[row] else c.floor[row]
            offset[row] += offset_gain * d
            taken[row] = d
        self._learn_coherence(taken, dt, gain, 1.0 / inflation)

    def learn_aged(self, age: int, e: list[float], dt: float, since_open: float, inflation: float) -> None:
        """Take one raw residual whose rotor speeds are `age` ticks old: teaches that age's variance."""
        c = self.config
        variance = self.variance[min(age, MAX_AGE)]
        gain = min(1.0, dt / min(c.noise_time, max(c.noise_first_time, since_open)))
        clip2 = c.noise_clip * c.noise_clip
        offset = self.offset
        for row in range(ROWS):
            d = e[row] - offset[row]
            if d != d:
                continue
            now = variance[row]
            square = d * d / inflation
            if square > clip2 * now:
                square = clip2 * now
            learned = now + gain * (square - now)
            variance[row] = learned if learned > c.floor[row] else c.floor[row]

    def _learn_coherence(self, taken: list[float], dt: float, gain: float, share: float) -> None:
        """`share` takes the known inflation off again."""
        length = max(1, round(self.config.coherence_time / dt))
        recent, sums = self._recent, self._recent_sum
        recent.append(tuple(taken))
        for row in range(ROWS):
            sums[row] += taken[row]
        while len(recent) > length:
            gone = recent.popleft()
            for row in range(ROWS):
                sums[row] -= gone[row]
        if len(recent) < length:
            return
        variance = self.variance[0]
        for row in range(ROWS):
            mean_square = sums[row] * sums[row] / length * share
            limit = 12.0 * length * variance[row]
            if mean_square > limit:
                mean_square = limit
            now = self._sum_variance[row]
            self._sum_variance[row] = now = now + gain * (mean_square - now)
            ratio = now / variance[row]
            self.coherence[row] = 1.0 if ratio < 1.0 else (ratio if ratio < length else float(length))

    def variances(self, age: int, age_time: float, inflation: float) -> list[float]:
        """Return the variance of each row [(rad/s²)², (m/s²)²] for a tick of this age.

        A bucket is never trusted below a younger one: one seldom visited would otherwise be.
        """
        c = self.config
        growth = min(1.0 + c.age_growth * age_time, c.age_growth_limit) * inflation
        base = self.variance[0]
        coherence = self.coherence
        if age <= 0:
            return [value * kept * growth for value, kept in zip(base, coherence, strict=True)]
        largest = map(max, *self.variance[: min(age, MAX_AGE) + 1])
        return [value * kept * growth for value, kept in zip(largest, coherence, strict=True)]
