"""What healthy flights teach of the vibration: the law of its alarms, the baseline, and what is written of both."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from synthetic_flight import airframe
from test_pooled_ar import GRAVITY, RATE, learned, readings, vibration

from gcs_health.airframe import Airframe, AlarmLevel, HealthyVibration
from gcs_health.calibration.alarm_level import block_maxima, fit_level
from gcs_health.calibration.vehicle_text import vehicle_text
from gcs_health.errors import AirframeError
from gcs_health.estimators.contract import Estimate, Reason
from gcs_health.estimators.pooled_ar import PooledArEstimator
from gcs_health.estimators.pooled_ar_alarm import ModelHealth
from gcs_health.estimators.pooled_ar_file import save
from gcs_health.estimators.pooled_ar_model import PooledModel
from gcs_health.estimators.vibration_baseline import VibrationBaseline
from gcs_health.samples import FlightReading, ImuFilterReading, ImuReading, Reading
from gcs_health.vehicle_file import load_vehicle

HZ = 100.0
TEN_HOURS = 36_000.0


def shaking(seconds: float, seed: int, a1: float = 1.2, loud: float = 1.0, hz: float = HZ) -> list[Reading]:
    """Return an IMU whose six signals' steps have one resonance; a1 moves it."""
    noise = loud * np.random.default_rng(seed).standard_normal((6, round(seconds * hz) + 200))
    steps = lfilter([1.0], [1.0, -a1, 0.8], noise)[:, 200:].T
    rows = np.cumsum(steps, axis=0) - np.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0])
    return [ImuReading(k / hz, *row) for k, row in enumerate(rows.tolist())]


@pytest.fixture(scope="module")
def healthy() -> HealthyVibration:
    found, finding = calibrated([shaking(60.0, seed) for seed in range(5)])
    assert found is not None, finding.why
    return found


def calibrated(flights: list[list[Reading]]) -> tuple:
    baseline = VibrationBaseline()
    for flight in flights:
        baseline.fly(flight)
    return baseline.found(TEN_HOURS)


def told(healthy: HealthyVibration, stream: list[Reading]) -> Estimate:
    estimator = PooledArEstimator(replace(airframe(4), healthy_vibration=healthy))
    for reading in stream:
        estimator.feed(reading)
    return estimator.estimates(stream[-1].t)[0]


# -- the law of the alarms ----------------------------------------------------------------------------


def test_nineteen_of_twenty_levels_lie_above_what_is_passed_once_in_ten_hours() -> None:
    """Gumbel's law with location 1, scale .1: 10 s pass x with probability 1 - exp(-exp(-(x - 1) / .1))."""
    truth = 1.0 - 0.1 * math.log(-math.log(1.0 - 10.0 / TEN_HOURS))
    rng = np.random.default_rng(3)
    levels = [fit_level(rng.gumbel(1.0, 0.1, (10, 6)).tolist(), TEN_HOURS) for _ in range(400)]
    above = np.mean([level is not None and level.level.threshold > truth for level in levels])
    assert 0.88 < above < 0.99
    assert fit_level([rng.gumbel(1.0, 0.1, 11).tolist()], TEN_HOURS) is None


def test_flights_that_differ_from_one_another_make_a_level_less_sure() -> None:
    """The same values, once shuffled over the flights and once sorted into them."""
    rows = np.random.default_rng(5).gumbel(1.0, 0.1, 60)
    shuffled, apart = (fit_level(each.reshape(10, 6).tolist(), TEN_HOURS) for each in (rows, np.sort(rows)))
    assert shuffled is not None
    assert apart is not None
    assert apart.std > 2.0 * shuffled.std
    assert apart.level.threshold > shuffled.level.threshold


def test_blocks_are_whole_ten_seconds() -> None:
    assert block_maxima([*range(250)]) == [99, 199]


# -- the healthy baseline -----------------------------------------------------------------------------


def test_the_law_of_the_healthy_vibration_is_learned(healthy: HealthyVibration) -> None:
    for coefficients in healthy.coefficients:
        assert coefficients[:2] == pytest.approx((1.2, -0.8), abs=0.02)
    assert all(least < 1.0 < largest for least, largest in healthy.variances)


def test_a_change_is_told_without_a_rotor_or_a_size(healthy: HealthyVibration) -> None:
    well, changed = told(healthy, shaking(20.0, 50)), told(healthy, shaking(20.0, 51, a1=1.0))
    assert Reason.VIBRATION_CHANGED not in well.reasons
    assert dict(well.evidence)["vibration_change"] < 1.0  # type: ignore[operator]
    assert changed.reasons[0] is Reason.VIBRATION_CHANGED
    assert dict(changed.evidence)["vibration_change"] > 1.0  # type: ignore[operator]
    assert math.isnan(changed.value)
    assert math.isnan(changed.failure_probability)


def test_louder_air_is_no_change_and_much_louder_air_is_called_unmodelled(healthy: HealthyVibration) -> None:
    louder = told(healthy, shaking(20.0, 52, loud=1.25))
    assert Reason.VIBRATION_CHANGED not in louder.reasons
    assert dict(louder.evidence)["vibration_change"] < 1.0  # type: ignore[operator]
    storm = told(healthy, shaking(20.0, 53, loud=3.0))
    assert storm.reasons[0] is Reason.UNMODELLED
    assert Reason.VIBRATION_CHANGED not in storm.reasons
    assert told(healthy, shaking(20.0, 54, a1=1.0, loud=3.0)).reasons[0] is Reason.VIBRATION_CHANGED


def test_on_the_ground_and_while_it_takes_off_nothing_is_told(healthy: HealthyVibration) -> None:
    stream = shaking(20.0, 54, a1=1.0)
    ground = [FlightReading(-1.0, False, True), *stream]
    assert Reason.VIBRATION_CHANGED not in told(healthy, ground).reasons
    up = [FlightReading(-1.0, False, True), *stream[:1500], FlightReading(15.0, True, False), *stream[1500:]]
    assert Reason.VIBRATION_CHANGED not in told(healthy, up).reasons


def test_what_cannot_be_identified_is_said() -> None:
    for flights, why in (
        ([shaking(60.0, 1, hz=50.0)] * 3, "accelerations at 50 Hz, 90 Hz are needed"),
        ([shaking(60.0, 1), shaking(60.0, 1, hz=200.0)], "100 Hz in one flight, at 200 Hz in another"),
        ([[ImuFilterReading(0.0, math.nan, 20.0, ""), *shaking(60.0, 1)]], "a filter of 20 Hz on board"),
        ([shaking(40.0, 1)], "20 s of flight, 120 s are needed"),
        ([[]], "no accelerations and rates"),
    ):
        found, finding = calibrated(flights)
        assert found is None
        assert why in finding.why


def test_one_long_flight_is_halved_and_that_is_said() -> None:
    found, finding = calibrated([shaking(200.0, 9)])
    assert found is not None
    assert "what differs from day to day is not in it" in finding.why


# -- a trained model's alarm --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model() -> PooledModel:
    return learned()


def on_healthy(model: PooledModel, loud: float = 1.0, rate: float = RATE, count: int = 6) -> tuple:
    health = ModelHealth("m.npz", model)
    for seed in range(count):
        health.fly(readings(vibration(0, 0.0, 60.0, 900 + seed, loud), rate=rate))
    return health.found(TEN_HOURS)


def test_a_models_alarm_is_set_by_the_vehicles_own_flights(model: PooledModel) -> None:
    level, finding = on_healthy(model)
    assert level.every == TEN_HOURS
    assert level.threshold > model.threshold  # which is passed once in 5 min
    assert finding.values == (level.threshold,)
    assert "once in 10 h, extrapolated: " in finding.why
    mine = model.alarmed(level)
    assert (mine.threshold, mine.tail) == (level.threshold, (level.location, level.scale))


def test_a_model_of_other_air_or_another_rate_is_refused(model: PooledModel) -> None:
    for (level, finding), why in (
        (on_healthy(model, loud=3.0), "no trained model explains the vibration"),
        (on_healthy(model, rate=100.0), "it was trained at 200 Hz, these flights have 100 Hz"),
        (on_healthy(model, count=1), "120 s are needed; its own threshold stays"),
    ):
        assert level is None
        assert why in finding.why


# -- the vehicle file ---------------------------------------------------------------------------------


def craft(model: PooledModel, healthy: HealthyVibration, folder: Path) -> Airframe:
    save(model, folder / "m.npz")
    alarms = (("m.npz", AlarmLevel(0.3, 0.1, 0.02, TEN_HOURS)),)
    models = (str(folder / "m.npz"),)
    return replace(airframe(4), vibration_models=models, vibration_alarms=alarms, healthy_vibration=healthy)


def test_what_is_written_is_read_back(model: PooledModel, healthy: HealthyVibration, tmp_path: Path) -> None:
    meant = craft(model, replace(healthy, mean_over=0.005), tmp_path)
    (tmp_path / "v.toml").write_text(vehicle_text(meant, [], "a test"), encoding="utf-8")
    again = load_vehicle(tmp_path / "v.toml")
    assert again.vibration_models == meant.vibration_models
    assert again.vibration_alarms == meant.vibration_alarms
    got, had = again.healthy_vibration, meant.healthy_vibration
    assert got is not None
    assert had is not None
    assert got.rate == pytest.approx(had.rate)
    assert (got.mean_over, got.channels) == (0.005, had.channels)
    assert math.isnan(got.cutoff)
    for one, other in zip(got.coefficients, had.coefficients, strict=True):
        assert one == pytest.approx(other, abs=1e-6)
    assert got.alarm.threshold == pytest.approx(had.alarm.threshold, rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('alarm."m.npz"', "alarm.other", "vibration.alarm.other: is not among vibration.models"),
        ("threshold = 0.3", "treshold = 0.3", "vibration.alarm.m.npz.treshold: unknown key; did you mean"),
        ("location = 0.1\n", "", "vibration.alarm.m.npz.location: is missing"),
        ("scale = 0.02", "scale = -1", "vibration.alarm.m.npz.scale: expected a number above 0"),
        ("rate = 100.0", "rate = 'x'", "vibration.healthy.rate: expected a number"),
        ('["ax", ', '["up", ', "vibration.healthy.channels: expected some of ax, ay"),
        ("variances = [[", "variances = [[9e9, 1], [", "vibration.healthy.variances: expected 6 items"),
        (
            "coefficients = [[",
            "coefficients = [['x', ",
            "vibration.healthy.coefficients[0][0]: expected a number",
        ),
    ],
)
def test_a_wrong_entry_names_its_key(
    model: PooledModel, healthy: HealthyVibration, tmp_path: Path, old: str, new: str, complaint: str
) -> None:
    text = vehicle_text(craft(model, healthy, tmp_path), [], "a test")
    at = text.index("[vibration")
    assert old in text[at:]
    (tmp_path / "v.toml").write_text(text[:at] + text[at:].replace(old, new, 1), encoding="utf-8")
    with pytest.raises(AirframeError) as error:
        load_vehicle(tmp_path / "v.toml")
    assert complaint in str(error.value)
