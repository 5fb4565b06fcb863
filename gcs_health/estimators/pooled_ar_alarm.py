"""A trained model on this vehicle's own healthy flights: whether it fits them, and where its alarm has to lie.

The models' own thresholds are those of the vehicles and the air that they were trained in. Judged as on line, by the
same watch: what it is blind to raises no alarm and promises none.
"""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from gcs_health.airframe import AlarmLevel
from gcs_health.calibration.alarm_level import LEAST_BLOCKS, Fitted, block_maxima, fit_level
from gcs_health.calibration.false_alarms import BLOCK, most
from gcs_health.calibration.findings import Finding, missing
from gcs_health.estimators.contract import REASON_TEXT, Reason
from gcs_health.estimators.pooled_ar_model import PooledModel
from gcs_health.estimators.pooled_ar_watch import ModelWatch, WatchConfig
from gcs_health.samples import FlightReading, ImuFilterReading, Reading

STALE = 1.0  # s, as on line
FITS = 0.5  # of the healthy flights; a model that fits less is of other air or another vehicle


class ModelHealth:
    """Fed whole healthy flights, one after the other.

    Attributes
    ----------
    maxima : of each flight, the largest k of any rotor in every 10 s that the model fits.
    """

    def __init__(self, name: str, model: PooledModel) -> None:
        self.name, self.model = name, model
        self.maxima: list[list[float]] = []
        self._refused: Counter[Reason] = Counter()
        self._steps = 0  # of 0.1 s, in the air
        self._ratios: list[float] = []  # residual variance over the trained one
        self._rates: list[float] = []

    def fly(self, readings: Iterable[Reading]) -> None:
        """Take one flight."""
        watch, flies = ModelWatch(self.model, WatchConfig()), True
        values: list[float] = []
        times: list[float] = []
        for reading in readings:
            if isinstance(reading, FlightReading):
                flies = reading.flies
            elif isinstance(reading, ImuFilterReading):
                watch.filtered(reading.mean_over, reading.cutoff)
            elif type(reading) is watch.takes and flies:
                times.append(reading.t)
                if watch.feed(reading):  # type: ignore[arg-type]
                    self._judge(watch, reading.t, values)
        self.maxima.append(block_maxima(values))
        if len(times) > 1:
            self._rates.append(1.0 / float(np.median(np.diff(times))))

    def _judge(self, watch: ModelWatch, t: float, values: list[float]) -> None:
        verdict = watch.verdict
        refused = watch.missing(t, STALE) or (verdict.blind if verdict is not None else (Reason.FILLING,))
        if verdict is not None:
            self._ratios.append(verdict.views[verdict.best].ratio_alarm)
        if refused == (Reason.FILLING,):
            return
        self._steps += 1
        if refused or verdict is None:
            self._refused[refused[0]] += 1
        else:
            values.append(max(view.k_alarm for view in verdict.views.values()))

    def found(self, every: float) -> tuple[AlarmLevel | None, Finding]:
        """Return the level passed once in `every` [s], and what is said of it; None with the reason."""
        key = f"alarm.{self.name}"
        why = self._misfit()
        if why:
            return None, missing("vibration", key, why)
        fitted = fit_level(self.maxima, every)
        if fitted is None:
            time, needed = sum(map(len, self.maxima)) * BLOCK, LEAST_BLOCKS * BLOCK
            why = f"{time:.0f} s of healthy flight that it fits, {needed:.0f} s are needed; its own threshold stays"
            return None, missing("vibration", key, why)
        why = f"fits {self._fits:.0%} of the flights; {promised(fitted)}"
        if fitted.level.threshold >= 1.0:
            why += "; so rarely it sees no loss of speed: fly more, or bear more false alarms"
        return fitted.level, Finding("vibration", key, (fitted.level.threshold,), (fitted.std,), why)

    @property
    def _fits(self) -> float:
        return 1.0 - sum(self._refused.values()) / self._steps if self._steps else 0.0

    def _misfit(self) -> str:
        """Return why it is not this vehicle's; empty = it is."""
        if not self._rates:
            return REASON_TEXT[Reason.MODEL_SIGNAL]
        rate = float(np.median(self._rates))
        if not self._steps or self._refused[Reason.MODEL_RATE] > FITS * self._steps:
            return f"it was trained at {self.model.rate:.0f} Hz, these flights have {rate:.0f} Hz"
        if self._fits >= FITS:
            return ""
        reason = self._refused.most_common(1)[0][0]
        why = f"fits {self._fits:.0%} of the flights: {REASON_TEXT[reason]}"
        if reason is Reason.UNMODELLED:
            why += f"; residual variance {float(np.median(self._ratios)):.2g} times the trained one"
        return why


def promised(fitted: Fitted) -> str:
    """Say how often the level is passed, and what so little flight can show of that."""
    hours = fitted.time / 3600.0
    bound = most(0, hours)
    budget = 3600.0 / fitted.level.every
    said = f"once in {_time(fitted.level.every)}"
    if bound > budget:
        needed = most(0, 1.0) / budget
        shown = f"{_time(fitted.time)} without an alarm show at most {bound:.2g} /h"
        said += f", extrapolated: {shown}, {needed:.2g} h would"
    return said


def _time(seconds: float) -> str:
    return f"{seconds / 3600.0:.3g} h" if seconds >= 3600.0 else f"{seconds / 60.0:.3g} min"


def without_models() -> Finding:
    """Return the finding of a vehicle file that names none."""
    why = "no [vibration] models in the vehicle file: gcs-health train makes them from flights of known degradation"
    return missing("vibration", "alarm", why)
