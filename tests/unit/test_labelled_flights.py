"""Cutting labelled flights into what a model is trained on, and sharing them out."""

import math

import numpy as np
import pytest

from gcs_health.errors import ConfigError
from gcs_health.estimators.labelled_flights import Label, LabelledFlight, flown, split
from gcs_health.estimators.pooled_ar_training import TrainingSettings, train
from gcs_health.samples import FlightReading, ImuReading, Reading, RotorReading

RATE = 100.0
ABSENT = (math.nan,) * 4


def flight(up: float = 5.0, down: float = 35.0, told: bool = True) -> list[Reading]:
    """Forty seconds, in the air between two times; rotor k turns at 500 + k rad/s there, else at 100."""
    readings: list[Reading] = []
    for k in range(4000):
        t = k / RATE
        if told and t in (up, down):
            readings.append(FlightReading(t, True, t == down))
        readings.append(ImuReading(t, 0.0, 0.0, -9.8, math.sin(t), 0.0, 0.0))
        if k % 5 == 0:
            speed = 500.0 if up <= t < down else 100.0
            readings.append(RotorReading(t, tuple(speed + i for i in range(4)), ABSENT, ABSENT))
    return readings


@pytest.mark.parametrize("told", [True, False], ids=["landed state", "rotor speeds alone"])
def test_only_the_settled_time_in_the_air_teaches(told: bool) -> None:
    (cut,) = flown(flight(told=told), "a", Label(0, 0.0), RATE)
    assert cut.length / RATE == pytest.approx(24.0, abs=0.1)  # from 11 s to 35 s
    assert cut.speeds is not None
    np.testing.assert_allclose(cut.speeds, np.tile([500.0, 501.0, 502.0, 503.0], (len(cut.speeds), 1)))
    assert len(cut.speeds) == pytest.approx(240, abs=2)


def test_a_degraded_flight_teaches_from_its_onset_on() -> None:
    (cut,) = flown(flight(), "a", Label(2, 0.2, since=20.0), RATE)
    assert (cut.rotor, cut.k) == (2, 0.2)
    assert cut.length / RATE == pytest.approx(9.0, abs=0.1)  # from 26 s to 35 s
    assert flown(flight(), "a", Label(2, 0.2, since=33.0), RATE) == []


def test_a_gap_makes_two_stretches_and_a_silent_rotor_no_speeds() -> None:
    readings = [r for r in flight() if not 20.0 < r.t < 21.0]
    first, second = flown(readings, "a", Label(0, 0.0), RATE)
    assert (first.length + second.length) / RATE == pytest.approx(23.0, abs=0.1)
    silent = [
        RotorReading(r.t, (*r.speed[:3], math.nan), ABSENT, ABSENT) if isinstance(r, RotorReading) else r
        for r in flight()
    ]
    assert all(cut.speeds is None for cut in flown(silent, "a", Label(0, 0.0), RATE))


def one(k: float, number: int) -> tuple[Label, list[LabelledFlight]]:
    return Label(0, k), [LabelledFlight(str(number), 0, k, {"az": np.zeros(200)})]


def test_each_flight_fits_or_is_held_out_or_sets_the_threshold() -> None:
    flights = [one(0.0, n) for n in range(6)]
    flights += [one(k, 10 + n) for n, k in enumerate((0.1, 0.2, 0.3, 0.4))]
    fitted, held_out, healthy = split(flights)
    assert [f.k for f in fitted] == [0.1, 0.3, 0.4, 0.0, 0.0]  # never without the largest
    assert [f.k for f in held_out] == [0.2, 0.0, 0.0]
    assert [f.vehicle for f in healthy] == ["2", "3"]
    assert len(fitted) + len(held_out) + len(healthy) == len(flights)


@pytest.mark.parametrize(
    ("healthy", "levels", "complaint"),
    [
        (2, (0.1, 0.2, 0.3), "expected three healthy flights at least, got 2"),
        (3, (0.1, 0.2, 0.2), "expected three levels of degradation at least, got 0.1, 0.2"),
        (3, (), "at least, got none"),
    ],
)
def test_too_few_are_told(healthy: int, levels: tuple[float, ...], complaint: str) -> None:
    flights = [one(0.0, n) for n in range(healthy)] + [one(k, 9) for k in levels]
    with pytest.raises(ConfigError, match=complaint):
        split(flights)


@pytest.mark.parametrize(
    ("held", "healthy", "complaint"),
    [
        (3.0, 30.0, "no held-out flight is as long as 5 s"),
        (12.0, 8.0, "expected 11 s of healthy flight on end"),
    ],
)
def test_flights_too_short_to_measure_the_model_on_are_told(
    held: float, healthy: float, complaint: str
) -> None:
    rng = np.random.default_rng(1)

    def noise(k: float, seconds: float) -> LabelledFlight:
        return LabelledFlight("a", 0, k, {"az": rng.normal(size=round(seconds * RATE))})

    settings = TrainingSettings("quad", "still", RATE, ("az",), orders=(4,))
    fitted = [noise(k, 12.0) for k in (0.0, 0.1, 0.3)]
    with pytest.raises(ConfigError, match=complaint):
        train(fitted, [noise(0.2, held)], [noise(0.0, healthy)], settings)
