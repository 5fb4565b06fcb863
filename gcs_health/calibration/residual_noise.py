"""What is left when the model is taken from the measurement: its offset, spread and coherence.

Rows: 0 roll, 1 pitch, 2 yaw acceleration [rad/s²], 3 vertical specific force [m/s²].

    e = y - sum h_i      raw residual          b  slow offset           d = e - b
    R[age]               variance of d, one set for each age of the rotor speeds in IMU ticks
    kappa                Var(sum of the last 50 ms of d) / (L Var d): 1 where d is white

Learned from some ticks at once: within them the baseline stands still.

Source: sheet 1 section 6, with the start-up of sheet 5 section 3 rule 2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

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
    """Learns offset, variance by age and coherence of the four residuals.

    Attributes
    ----------
    offset : b of each row; replaced, never changed, when something is learned.
    """

    def __init__(self, config: NoiseConfig) -> None:
        self.config = config
        self.offset = [0.0] * ROWS
        self.learned_time = 0.0  # s of open gate that taught
        self._floor = np.array(config.floor)
        self._variance: Array = np.tile(np.square(config.typical), (MAX_AGE + 1, 1))
        self._coherence: Array = np.ones(ROWS)
        self._sum_variance: Array = self._variance[0].copy()  # of the sum divided by its length
        self._recent: Array = np.zeros((0, ROWS))
        self._lay_out()

    def expect(self, roll: float, pitch: float) -> None:
        """Scale what is typical to the craft: one rotor's roll and pitch acceleration in hover [rad/s²].

        Small craft turn faster and shake harder. Only before anything was learned.
        """
        if self.learned_time > 0.0:
            return
        for row, hover in enumerate((roll, pitch)):
            sigma = max(self.config.typical[row], self.config.typical_share * hover)
            self._variance[:, row] = sigma * sigma
            self._sum_variance[row] = sigma * sigma
        self._lay_out()

    def restart(self) -> None:
        """Start anew as the gate opens: offset and sums forgotten, variances kept."""
        self.offset = [0.0] * ROWS
        self._recent = np.zeros((0, ROWS))

    def learn(self, e: Array, dt: Array, inflation: Array, since_open: float) -> None:
        """Take the raw residuals of some ticks whose rotor speeds are bracketed.

        Parameters
        ----------
        e : (k, 4) raw residuals, offset not taken off; 0 in a row not used.
        dt : (k,) length of each tick [s].
        inflation : (k,) factor by which the variance was known to be raised [-].
        since_open : time since the gate opened, at the end [s].
        """
        c = self.config
        length = float(np.add.reduce(dt))
        weights = dt / length
        self.learned_time += length
        gain = self._gain(length, since_open)
        now = self._variance[0]
        share = inflation[:, None]
        d = e - self.offset
        squares = np.minimum(d * d / share, c.noise_clip**2 * now)
        limit = c.offset_clip * np.sqrt(now * share)
        taken = np.minimum(np.maximum(d, -limit), limit)
        self._variance[0] = np.maximum(now + gain * (weights @ squares - now), self._floor)
        offset_time = c.offset_first_time if since_open < c.offset_time else c.offset_time
        offset_gain = min(1.0, length / min(offset_time, max(0.1, since_open)))
        self.offset = (self.offset + offset_gain * (weights @ taken)).tolist()
        self._learn_coherence(taken / np.sqrt(share), length / len(dt), gain)
        self._lay_out()

    def learn_aged(self, ages: list[int], e: Array, dt: Array, inflation: Array, since_open: float) -> None:
        """Take raw residuals whose rotor speeds were `ages` (k) ticks old; `learn` takes in their variances."""
        limit = self.config.noise_clip**2
        age = np.minimum(ages, MAX_AGE)
        d = e - self.offset
        now = self._variance
        squares = np.minimum(d * d / inflation[:, None], limit * now[age])
        sums = np.zeros_like(now)
        np.add.at(sums, age, squares * dt[:, None])
        times = np.bincount(age, weights=dt, minlength=MAX_AGE + 1)[:, None]
        gain = self._gain(1.0, since_open)  # of a second
        now += np.minimum(gain * times, 1.0) * (sums / np.maximum(times, 1e-9) - now)
        np.maximum(now, self._floor, out=now)

    def _gain(self, length: float, since_open: float) -> float:
        c = self.config
        return min(1.0, length / min(c.noise_time, max(c.noise_first_time, since_open)))

    def _learn_coherence(self, taken: Array, dt: float, gain: float) -> None:
        """Take deviations without their known inflation, from ticks of `dt` [s]."""
        length = max(1, round(self.config.coherence_time / dt))
        row = np.concatenate((self._recent[max(0, len(self._recent) - length + 1) :], taken))
        self._recent = row[max(0, len(row) - length + 1) :]
        if len(row) < length:
            return
        ends = np.concatenate((np.zeros((1, ROWS)), row.cumsum(axis=0)))
        sums = ends[length:] - ends[:-length]
        variance = self._variance[0]
        squares = np.add.reduce(np.minimum(sums * sums / length, 12.0 * length * variance)) / len(sums)
        self._sum_variance += gain * (squares - self._sum_variance)
        self._coherence = np.minimum(np.maximum(self._sum_variance / variance, 1.0), float(length))

    def _lay_out(self) -> None:
        """Work out the rows that `variances` gives.

        A bucket is never trusted below a younger one: one seldom visited would otherwise be.
        """
        self._rows: list[list[float]] = (
            np.maximum.accumulate(self._variance, axis=0) * self._coherence
        ).tolist()

    def variances(self, age: int) -> list[float]:
        """Return the variance of each row [(rad/s²)², (m/s²)²] for a tick of this age; not to be changed."""
        return self._rows[age if age < MAX_AGE else MAX_AGE]

    def growth(self, age_time: float) -> float:
        """Return by what all variances grow for rotor speeds `age_time` [s] old."""
        c = self.config
        return min(1.0 + c.age_growth * age_time, c.age_growth_limit)
