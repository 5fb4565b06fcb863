"""Commands and rates without rotor speeds: a total loss contradicts, a cut and a load trim differently."""

import math
from dataclasses import replace

import pytest
from synthetic_flight import HOVER, Scenario, airframe, fly

from gcs_health.airframe import Airframe, Baseline
from gcs_health.estimators.contract import Estimate, Reason, Status
from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.samples import CommandReading, FlightReading, Reading, RotorReading

FULL = 1.7 * HOVER  # rad/s at full command


def commanded(scenario: Scenario) -> list[Reading]:
    """Return the flight with commands, about as they must have been, for rotor speeds; 25 Hz."""
    return [
        CommandReading(reading.t, tuple(min(speed / FULL, 1.0) for speed in reading.speed))
        if isinstance(reading, RotorReading)
        else reading
        for reading in fly(replace(scenario, esc_hz=25.0))
    ]


def with_reference(craft: Airframe, *hover: float) -> Airframe:
    return replace(craft, baseline=Baseline(hover_command=hover))


def hover(
    estimator: EffectivenessEstimator, commands: tuple[float, ...], start: float = 0.0
) -> list[Estimate]:
    """Fly 14 s with these commands; return what is said on the way."""
    said = estimator.feed(FlightReading(start, True, None))
    for k in range(280):
        ripple = 0.01 * math.sin(0.7 * k)
        said += estimator.feed(CommandReading(start + 0.05 * k, tuple(c + ripple for c in commands)))
    return said


@pytest.mark.parametrize(("rotors", "lost"), [(4, 0), (4, 3), (6, 2)])
def test_a_lost_propeller_is_named_from_commands_and_rates(rotors: int, lost: int) -> None:
    estimator = EffectivenessEstimator(airframe(rotors))
    told = [
        e
        for reading in commanded(Scenario(rotors, duration=9.0, lost=lost, imu_hz=50.0))
        for e in estimator.feed(reading)
        if e.failure_probability > 0.9
    ]
    assert [estimate.rotor for estimate in told] == [lost]
    assert 7.0 < told[0].t < 7.6
    assert dict(told[0].evidence)["rule"] == "contradiction"


@pytest.mark.parametrize("seed", range(5))
def test_a_healthy_flight_contradicts_nothing(seed: int) -> None:
    estimator = EffectivenessEstimator(airframe(4))
    for reading in commanded(Scenario(4, imu_hz=50.0, seed=seed)):
        assert estimator.feed(reading) == []
    for estimate in estimator.estimates(10.0):
        assert estimate.status is Status.UNOBSERVABLE
        assert estimate.reasons == (Reason.NO_ROTOR_SPEEDS, Reason.NO_HEALTHY_REFERENCE)


def test_a_cut_propeller_raises_one_rotor() -> None:
    estimator = EffectivenessEstimator(with_reference(airframe(4), 0.6, 0.55, 0.6, 0.55))
    said = hover(estimator, (0.6, 0.55, 0.75, 0.55))
    assert [e.rotor for e in said if e.failure_probability > 0.9] == [2]
    found = estimator.estimates(14.0)
    assert [e.status for e in found] == [Status.VALID] * 4
    assert found[2].value == pytest.approx(0.64, abs=0.03)  # (.6 / .75)²
    assert found[0].value == pytest.approx(1.0, abs=0.05)
    assert found[0].failure_probability < 0.2
    # it lands, is armed again, and flies with a new propeller
    estimator.feed(FlightReading(15.0, False, True))
    hover(estimator, (0.6, 0.55, 0.61, 0.55), start=20.0)
    assert all(e.failure_probability < 0.2 for e in estimator.estimates(34.0))


def test_a_weight_near_a_rotor_is_no_damage() -> None:
    estimator = EffectivenessEstimator(with_reference(airframe(4), 0.6, 0.6, 0.6, 0.6))
    place = airframe(4).rotors
    near = 1
    square = sum(r.position[0] ** 2 + r.position[1] ** 2 for r in place) / 4
    along = [
        (1 + 2 * sum(a * b for a, b in zip(place[near].position, r.position, strict=True)) / square) / 4
        for r in place
    ]
    assert not [
        e
        for e in hover(estimator, tuple(math.sqrt(0.36 + 0.2 * share) for share in along))
        if e.failure_probability > 0.9
    ]
    for estimate in estimator.estimates(14.0):
        assert Reason.LOAD_SHIFTED in estimate.reasons
        assert estimate.status is Status.UNOBSERVABLE


def test_rotor_speeds_take_over() -> None:
    estimator = EffectivenessEstimator(with_reference(airframe(4), 0.6, 0.6, 0.6, 0.6))
    hover(estimator, (0.6, 0.6, 0.8, 0.6))
    assert estimator.without_speeds is not None
    estimator.feed(RotorReading(15.0, (HOVER,) * 4, (math.nan,) * 4, (math.nan,) * 4))
    assert estimator.without_speeds is None
