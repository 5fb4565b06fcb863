"""Final ticks of some tenths of a second as columns: what baselines and gains are learned from.

Nothing that is learned decides about the tick that teaches it, so it can wait a little; over some dozen
ticks at once numpy is several times cheaper than plain floats tick by tick.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gcs_health.estimators.residual_model import Evidence, Step, rows

Array = NDArray[np.float64]


class Lesson:
    """Successive ticks, of k steps of some rotors.

    Attributes
    ----------
    first_t, last_t : of the first and last tick [s]. length : of all steps [s].
    dt (k,) [s]; inflation (k,) [-].
    e (k, 4) : raw residuals; variances (k, 4) of them.
    measured, predicted (k, 2) : roll and pitch acceleration [rad/s²].
    squares (k, n) : mean squared rotor speeds over each step; last_squares (k, n) : at its end [(rad/s)²].
    """

    def __init__(self, ticks: list[tuple[Step, Evidence]]) -> None:
        steps, evidence = zip(*ticks, strict=True)
        columns = rows(steps, len(steps[0]))
        self.first_t, self.last_t = steps[0].t, steps[-1].t
        self.dt: Array = columns[:, 1]
        self.length = float(np.add.reduce(self.dt))
        self.measured: Array = columns[:, 2:4]
        self.inflation: Array = columns[:, 6]
        e, _, variances, _, w0, w1, *_ = zip(*evidence, strict=True)
        self.e: Array = rows(e, 4)
        self.predicted: Array = self.measured - self.e[:, :2]
        self.variances: Array = rows(variances, 4) * self.inflation[:, None]
        first, last = rows(w0, len(w0[0])), rows(w1, len(w1[0]))
        self.last_squares: Array = last * last
        self.squares: Array = 0.5 * (first * first + self.last_squares)


class NextLesson:
    """Ticks gathered for the next lesson.

    Attributes
    ----------
    time : of its final ticks [s].
    aged : (age, raw residual, length, inflation) of ticks judged with rotor speeds held for `age` ticks.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget what was gathered: no lesson reaches across a closed gate."""
        self.time = 0.0
        self.aged: list[tuple[int, tuple[float, ...], float, float]] = []
        self._ticks: list[tuple[Step, Evidence]] = []
        self._calm: list[bool] = []

    def add(self, step: Step, tick: Evidence, calm: bool) -> None:
        """Add a final tick; `calm` = no hypothesis was half way, so it teaches the noise."""
        self._ticks.append((step, tick))
        self._calm.append(calm)
        self.time += step.dt

    def begin(self) -> tuple[Lesson, NDArray[np.bool_]]:
        """Return the lesson and which of its ticks were calm; the next one begins empty but for what is aged."""
        lesson, calm = Lesson(self._ticks), np.array(self._calm)
        self._ticks, self._calm, self.time = [], [], 0.0
        return lesson, calm


class Freeze:
    """No learning while a hypothesis is half way, lest the fault become the baseline.

    Parameters
    ----------
    lasting : after the hypothesis was last half way [s]. at_most : on end [s], since a baseline that is simply wrong
        must be able to mend itself.

    Attributes
    ----------
    until : vehicle time up to which nothing is learned [s].
    """

    def __init__(self, lasting: float, at_most: float) -> None:
        self.until = -math.inf
        self._lasting, self._at_most = lasting, at_most
        self._since = math.nan

    def half_way(self, t: float) -> None:
        """Take that a hypothesis is half way at t [s]."""
        if self._since != self._since:
            self._since = t
        if t - self._since < self._at_most:
            self.until = t + self._lasting

    def quiet(self, t: float) -> None:
        """Take that none is at t [s]."""
        if t > self.until:
            self._since = math.nan
