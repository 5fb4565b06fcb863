"""Whether the vehicle still vibrates as in its healthy flights: the pooled model at k = 0 alone.

    y[t] = s[t] - s[t-1]                          of each signal s of the IMU: turning and leaning are no vibration
    e[t] = y[t] - sum_i a_i y[t-i]                a_i from healthy flights
    r_l = sum_t e[t] e[t-l] / sum_t e[t]²         l = 1 .. 20, windows of 5 s
    change = mean over the signals of sum_l r_l²

Where the dynamics are the healthy ones e is white, however strong the gusts are: r_l does not know the variance of e.
How white it is in healthy flight, and not a chi-squared law, sets the threshold: with the law's, healthy windows of
other flights are called faulty too (sheet 4 section 5). It names no rotor and no size.

Source: Dutta et al. (2023), eqs. (27), (28), whose whiteness test this is; sheet 4 sections 2 and 5.
"""

import math

import numpy as np

from gcs_health.airframe import HealthyVibration
from gcs_health.estimators.contract import Reason
from gcs_health.estimators.pooled_ar_model import Part, PooledModel
from gcs_health.estimators.pooled_ar_watch import FULL, GAP, ModelWatch, WatchConfig
from gcs_health.samples import FlightReading, ImuFilterReading, ImuReading

LAGS = 20
WINDOW = 5.0  # s
SETTLE = 6.0  # s after take-off, as in training: a climb is not how it flies
RESIDUAL = np.array([1.0, -1.0])  # of [y, what the model expects of it]


class HealthyWatch:
    """Feed the IMU and what is said of flight and filter; a window lies within one flight.

    Attributes
    ----------
    change, variances : of the window that ends now; NaN and () while there is none.
    changed : the change has passed the threshold, or has done so within the hold.
    other_air : the residual's variance is far from that of the healthy flights. That alone is no change: gusts do
        it, and leave e white (benchmarks/vibration_alarm.md).
    """

    def __init__(self, healthy: HealthyVibration, config: WatchConfig) -> None:
        self.healthy, self.config = healthy, config
        self._watch = ModelWatch(_model(healthy), config, LAGS)
        self._size = round(WINDOW * 10.0)
        self.change = math.nan
        self.variances: tuple[float, ...] = ()
        self.other_air = self.changed = False
        self._until = -math.inf  # the hold
        self._flies = True
        self._settled = -math.inf  # when the take-off was over [s]
        self._before: ImuReading | None = None

    def feed(self, reading: ImuReading | FlightReading | ImuFilterReading) -> bool:
        """Take one reading; return whether the answer is new."""
        if isinstance(reading, ImuFilterReading):
            self._watch.filtered(reading.mean_over, reading.cutoff)
        elif isinstance(reading, FlightReading):
            if reading.flies and not self._flies:
                self._settled = reading.t + SETTLE
            self._flies = reading.flies
        else:
            step = self._step(reading)
            if step is not None and self._watch.feed(step):
                self._look(reading.t)
                return True
        return False

    def _step(self, reading: ImuReading) -> ImuReading | None:
        """Return what each signal has moved since the sample before; None after a gap."""
        before, self._before = self._before, reading
        if before is None or reading.t - before.t > GAP / self.healthy.rate:
            return None
        return ImuReading(reading.t, *[now - then for now, then in zip(reading[1:], before[1:], strict=True)])

    def missing(self, t: float, stale_after: float) -> tuple[Reason, ...]:
        """Return why nothing is told at time t [s]; empty = it is."""
        missing = self._watch.missing(t, stale_after)
        if missing:
            return missing
        if not self._flies:
            return (Reason.ON_GROUND,)
        return (Reason.FILLING,) if self.change != self.change else ()

    def told(self, t: float, stale_after: float) -> tuple[tuple[Reason, ...], tuple[tuple[str, float], ...]]:
        """Return what an estimate has to say of it: a reason where it is not as ever, and change over threshold."""
        if self.missing(t, stale_after):
            return (), ()
        unlike = (Reason.UNMODELLED,) if self.other_air else ()
        reasons = (Reason.VIBRATION_CHANGED,) if self.changed else unlike
        return reasons, (("vibration_change", self.change / self.healthy.alarm.threshold),)

    def _look(self, t: float) -> None:
        blocks = self._watch.blocks
        start = max(t - WINDOW - 0.05, self._settled)
        while blocks and blocks[0][0] < start:
            blocks.popleft()
        if not self._flies or len(blocks) < FULL * self._size:
            self.change, self.variances, self.changed = math.nan, (), False
            return
        # (signals, lags + 1, 2, 2)
        lagged = np.array([list(grams.values()) for _, grams in blocks]).sum(axis=0)
        c = np.einsum("i,slij,j->sl", RESIDUAL, lagged, RESIDUAL)
        power = np.maximum(c[:, 0], 1e-300)
        self.change = float(((c[:, 1:] / power[:, None]) ** 2).sum(axis=1).mean())
        self.variances = tuple((power / (len(blocks) * self._watch.model.block)).tolist())
        low, high = self.config.ratio
        self.other_air = not all(
            low * least <= now <= high * largest
            for now, (least, largest) in zip(self.variances, self.healthy.variances, strict=True)
        )
        if self.change > self.healthy.alarm.threshold:
            self._until = t + self.config.hold
        self.changed = t <= self._until


def _model(healthy: HealthyVibration) -> PooledModel:
    """Return it as a pooled model of one level; each signal is a part of its own, so that none is summed."""
    count = len(healthy.channels)
    parts = tuple(
        Part(k, channel, np.array(healthy.coefficients[k])[:, None], np.ones(1))
        for k, channel in enumerate(healthy.channels)
    )
    return PooledModel(
        vehicle="",
        regime="",
        rate=healthy.rate,
        mean_over=healthy.mean_over,
        cutoff=healthy.cutoff,
        levels=np.zeros(1),
        channels=healthy.channels,
        offsets=np.zeros(count),
        scales=np.ones(count),
        parts=parts,
        alarm_window=WINDOW,
        value_window=WINDOW,
        bias=math.nan,
        threshold=healthy.alarm.threshold,
        alarm_every=healthy.alarm.every,
        tail=(healthy.alarm.location, healthy.alarm.scale),
        healthy_time=math.nan,
        names=math.nan,
    )
