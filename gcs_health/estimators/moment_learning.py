"""What lessons teach of the rotors' moments: gains, the shift of stamps, and whether the geometry holds."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from gcs_health.calibration import geometry_check
from gcs_health.calibration.control_effectiveness import ControlEffectiveness, MomentRegression
from gcs_health.calibration.time_shift import TimeShift
from gcs_health.estimators.effectiveness_config import RecommendedConfig
from gcs_health.estimators.lesson import Lesson

Array = NDArray[np.float64]


class MomentLearning:
    """Fed lessons; teaches `gains` roll and pitch.

    Attributes
    ----------
    shift : the time to add to rotor speed stamps.
    contradicted : the rotors do not answer as the geometry says.
    exchange_cost : (n (n - 1) / 2,) what the flight so far says against two rotors in each other's seats.
    """

    def __init__(self, gains: ControlEffectiveness, config: RecommendedConfig) -> None:
        self.config = config
        self.gains = gains
        self.shift = TimeShift(config.shift)
        self.contradicted = False
        self.exchange_cost: Array = np.zeros(gains.rotors * (gains.rotors - 1) // 2)
        self._regression = MomentRegression(gains.rotors, config.prior)
        # what teaches where the rotors sit lags, lest a fault look like a wrong geometry
        self._late: deque[Lesson] = deque()
        self._slow_mean: Array = np.zeros((2, 2))  # of predicted and measured roll, pitch
        self._strikes = 0

    def gap(self) -> None:
        """Ticks are missing: nothing reaches across."""
        self._late.clear()
        self.shift.gap()

    def feed(self, lesson: Lesson, interval: float, tick_length: float) -> None:
        """Take the final ticks of one lesson; rotor speeds come every `interval` [s]."""
        c = self.config
        late = self._late
        late.append(lesson)
        while lesson.last_t - late[0].last_t > c.geometry.delay:
            old = late.popleft()
            self._regression.feed(old.dt, old.squares, old.measured)
        if not (interval < c.shift_rotor_speeds and tick_length < c.shift_rotor_speeds):
            return
        both = np.array((lesson.predicted, lesson.measured))
        mean = self._slow_mean
        gain = min(1.0, lesson.length / c.prior.high_pass)
        mean += gain * (np.add.reduce(both, axis=1) / both.shape[1] - mean)
        predicted, measured = both - mean[:, None, :]
        if self.shift.feed(lesson.dt, predicted, measured):
            # what was gathered paired rates with the wrong speeds
            self._regression = MomentRegression(self.gains.rotors, c.prior)
            late.clear()

    def check(self, interval: float, tick_length: float) -> bool:
        """Learn gains that are not given; return whether `contradicted` changed. Twice a second."""
        was = self.contradicted
        regression = self._regression
        if self.gains.learns:
            self.gains.learn_moments(
                regression.axis(0, self.gains.roll), regression.axis(1, self.gains.pitch), regression.time
            )
        fits = self._fits(interval, tick_length)
        rows = self.gains.roll, self.gains.pitch
        self.exchange_cost = geometry_check.exchange_cost(regression, rows, self.config.prior.apart)
        g = self.config.geometry
        if regression.time > g.strong_time and geometry_check.contradicted(fits, g):
            self._strikes += 1
            if self._strikes >= self.config.strikes:
                self.contradicted = True
        else:
            self._strikes = 0
            if self.contradicted and geometry_check.agrees(fits, g):
                self.contradicted = False
        return self.contradicted != was

    def doubtful(self, interval: float, tick_length: float) -> bool:
        """Whether a verdict must not be given on this geometry; it then counts as contradicted."""
        if geometry_check.doubtful(self._fits(interval, tick_length), self.config.geometry):
            self.contradicted = True
        return self.contradicted

    def bears_a_name(self, interval: float, tick_length: float, assumed: bool) -> bool:
        """Whether a rotor may be named on this geometry; one only `assumed` must be borne out by the flight."""
        g = self.config.geometry
        fits = self._fits(interval, tick_length)
        if self._regression.time < g.least_time or geometry_check.doubtful(fits, g):
            return False
        return not assumed or geometry_check.supports(fits, g)

    def _fits(self, interval: float, tick_length: float) -> list[geometry_check.AxisFit]:
        if self._regression.time < self.config.geometry.least_time:
            return []
        block = max(self.config.prior.block, tick_length, interval if interval == interval else 0.0)
        found = (
            geometry_check.fit_axis(self._regression, 0, self.gains.roll, block),
            geometry_check.fit_axis(self._regression, 1, self.gains.pitch, block),
        )
        return [fit for fit in found if fit is not None]
