"""The vehicle's healthy vibration from healthy flights alone: AR models of the IMU's signals, and when they changed.

    a_i, order       least squares over all flights, order by BIC
    variances        least and largest of e in windows of 5 s: the air that the flights were in
    threshold        each flight judged by the model of the others, as on line: largest change in 10 s

A flight never sets the threshold of a model that was fitted to it; of a single flight one half judges the other, and
what differs from day to day is then not in it.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gcs_health.airframe import AlarmLevel, HealthyVibration
from gcs_health.calibration.alarm_level import LEAST_BLOCKS, block_maxima, fit_level
from gcs_health.calibration.false_alarms import BLOCK
from gcs_health.calibration.findings import Finding, missing
from gcs_health.estimators.healthy_vibration import HealthyWatch
from gcs_health.estimators.labelled_flights import IMU, Label, LabelledFlight, flown, imu_filters, imu_rate
from gcs_health.estimators.pooled_ar_alarm import promised
from gcs_health.estimators.pooled_ar_model import Array, Moments, best_order, fit, moments
from gcs_health.estimators.pooled_ar_training import SLOWEST_FILTER, orders_for
from gcs_health.estimators.pooled_ar_watch import WatchConfig
from gcs_health.samples import FlightReading, ImuFilterReading, ImuReading, Reading

LEAST_RATE = 90.0  # Hz: slower, gusts hide what is left of the rotors (sheet 4 section 7)
EVEN = 0.05  # by so much the rates of two flights may differ
UNKNOWN = AlarmLevel(math.inf, math.nan, math.nan, math.inf)

Judged = Sequence[ImuReading | FlightReading | ImuFilterReading]


class _Flight(NamedTuple):
    """One flight, or half of one: its steady stretches (steps, 6), and what the watch is fed."""

    stretches: list[Array]
    readings: Judged
    rate: float
    filters: tuple[float, float]


class VibrationBaseline:
    """Fed whole healthy flights, one after the other."""

    def __init__(self) -> None:
        self._flights: list[_Flight] = []

    def fly(self, readings: Sequence[Reading]) -> None:
        """Take one flight."""
        rate = imu_rate(readings)
        cut = flown(readings, "", Label(0, 0.0), rate) if rate == rate else []
        stretches = [_steps(one) for one in cut if one.booms is None]
        stretches = [stretch for stretch in stretches if len(stretch) > rate]
        seen = [r for r in readings if isinstance(r, ImuReading | FlightReading | ImuFilterReading)]
        self._flights.append(_Flight(stretches, seen, rate, imu_filters(readings)))

    def model(self) -> HealthyVibration:
        """Return the AR models of all flights, without what the air and the alarm are."""
        order = max(orders_for(self._flights[0].rate))
        return _fitted([_moments(one, order) for one in self._flights], self._flights[0])

    def found(self, every: float) -> tuple[HealthyVibration | None, Finding]:
        """Return the baseline whose alarm is passed once in `every` [s], and what is said of it."""
        why = self._unusable()
        if why:
            return None, missing("vibration", "healthy", why)
        halves = len(self._flights) == 1
        flights = _halves(self._flights[0]) if halves else self._flights
        order = max(orders_for(flights[0].rate))
        learned = [_moments(one, order) for one in flights]
        maxima: list[list[float]] = []
        air: list[tuple[float, ...]] = []
        for k, flight in enumerate(flights):
            others = [each for j, each in enumerate(learned) if j != k]
            changes, flown_in = _judged(_fitted(others, flight), flight)
            maxima.append(block_maxima(changes))
            air += flown_in
        fitted = fit_level(maxima, every)
        if fitted is None:
            time, needed = sum(map(len, maxima)) * BLOCK, LEAST_BLOCKS * BLOCK
            return None, missing("vibration", "healthy", f"{time:.0f} s of flight, {needed:.0f} s are needed")
        rows = np.array(air)
        least, largest = rows.min(axis=0).tolist(), rows.max(axis=0).tolist()
        variances: tuple[tuple[float, float], ...] = tuple(zip(least, largest, strict=True))
        healthy = replace(_fitted(learned, flights[0]), variances=variances, alarm=fitted.level)
        orders = ", ".join(f"{c} {len(a)}" for c, a in zip(IMU, healthy.coefficients, strict=True))
        said = f"orders {orders} at {healthy.rate:.0f} Hz; {promised(fitted)}"
        if halves:
            said += "; from one flight, what differs from day to day is not in it"
        level = Finding("vibration", "healthy", (fitted.level.threshold,), (fitted.std,), said)
        return healthy, level

    def _unusable(self) -> str:
        rates = [one.rate for one in self._flights]
        if not all(rate == rate for rate in rates):
            return "no accelerations and rates"
        if min(rates) < LEAST_RATE:
            return f"accelerations at {min(rates):.0f} Hz, {LEAST_RATE:.0f} Hz are needed"
        if max(rates) > (1.0 + EVEN) * min(rates):
            return f"accelerations at {min(rates):.0f} Hz in one flight, at {max(rates):.0f} Hz in another"
        cutoffs = {one.filters for one in self._flights if one.filters == one.filters}
        slowest = min((cutoff for _, cutoff in cutoffs if cutoff == cutoff), default=math.inf)
        if slowest < SLOWEST_FILTER:
            return f"a filter of {slowest:g} Hz on board leaves nothing of the rotors"
        if len({tuple(map(str, one.filters)) for one in self._flights}) > 1:
            return "the accelerations are filtered otherwise in one flight than in another"
        if not all(one.stretches for one in self._flights):
            return "a flight without gapless stretches of a second, 6 s after take-off"
        return ""


def _steps(flight: LabelledFlight) -> Array:
    """Return (n, 6): what each signal moves from sample to sample."""
    return np.diff(np.stack([flight.signal(channel, 0) for channel in IMU], axis=1), axis=0)


def _moments(flight: _Flight, order: int) -> list[Moments]:
    """Return each signal's moments over the stretches of one flight."""
    return [_total([moments(stretch[:, k], order) for stretch in flight.stretches]) for k in range(len(IMU))]


def _total(parts: Sequence[Moments]) -> Moments:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _fitted(learned: Sequence[list[Moments]], flight: _Flight) -> HealthyVibration:
    """Fit every signal's AR model to the moments of some flights; rate and filters are those of `flight`."""
    coefficients = []
    for k in range(len(IMU)):
        level = _total([one[k] for one in learned])
        order = best_order(level, orders_for(flight.rate))
        coefficients.append(tuple(fit([level], np.zeros(1), order, 1)[:, 0].tolist()))
    return HealthyVibration(
        rate=flight.rate,
        mean_over=flight.filters[0],
        cutoff=flight.filters[1],
        channels=IMU,
        coefficients=tuple(coefficients),
        variances=((0.0, math.inf),) * len(IMU),
        alarm=UNKNOWN,
    )


def _judged(healthy: HealthyVibration, flight: _Flight) -> tuple[list[float], list[tuple[float, ...]]]:
    """Return the change every 0.1 s in the air, and the residuals' variances then."""
    watch = HealthyWatch(healthy, WatchConfig())
    changes, variances = [], []
    for reading in flight.readings:
        if watch.feed(reading) and watch.change == watch.change:
            changes.append(watch.change)
            variances.append(watch.variances)
    return changes, variances


def _halves(flight: _Flight) -> list[_Flight]:
    """Cut a flight in the middle of its readings and of its steady stretches."""
    n = len(flight.readings) // 2
    cut: tuple[list[Array], list[Array]] = ([], [])
    left = sum(map(len, flight.stretches)) // 2
    for stretch in flight.stretches:
        at = min(max(left, 0), len(stretch))
        for half, part in zip(cut, (stretch[:at], stretch[at:]), strict=True):
            if len(part) > flight.rate:
                half.append(part)
        left -= len(stretch)
    parts = (flight.readings[:n], flight.readings[n:])
    return [flight._replace(stretches=s, readings=r) for s, r in zip(cut, parts, strict=True)]
