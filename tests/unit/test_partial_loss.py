"""A rotor that lost a part of its thrust: named, sized, with an interval that holds; healthy flight is silent."""

import pytest
from synthetic_flight import Scenario, airframe, fly

from gcs_health.estimators.contract import Estimate, Status
from gcs_health.estimators.effectiveness import EffectivenessEstimator


def last(scenario: Scenario) -> list[Estimate]:
    estimator = EffectivenessEstimator(airframe(scenario.rotors))
    for reading in fly(scenario):
        estimator.feed(reading)
    return estimator.estimates(scenario.duration)


@pytest.mark.parametrize(("rotors", "loss"), [(4, 0.2), (4, 0.4), (6, 0.2), (6, 0.4), (8, 0.3)])
def test_a_partial_loss_is_sized_within_its_interval(rotors: int, loss: float) -> None:
    lost = rotors - 1
    found = last(
        Scenario(rotors, duration=8.0, at=6.0, lost=lost, left=1.0 - loss, imu_hz=100.0, esc_hz=50.0, seed=4)
    )
    for estimate in found:
        truth = 1.0 - loss if estimate.rotor == lost else 1.0
        assert estimate.status is Status.VALID
        assert abs(estimate.value - truth) < 2.0 * estimate.std
        assert estimate.std < 0.1
        assert estimate.failure_probability < 0.9  # damaged, but it has not failed
    assert dict(found[lost].evidence)["rule"] == "partial_loss"


def test_a_large_partial_loss_is_more_likely_a_failure_than_a_small_one() -> None:
    small, large = (
        last(Scenario(4, duration=8.0, at=6.0, lost=2, left=left, imu_hz=100.0, esc_hz=50.0))[2]
        for left in (0.85, 0.6)
    )
    assert small.failure_probability < 0.2 < 0.8 < large.failure_probability


@pytest.mark.parametrize("rotors", [4, 6])
def test_a_healthy_flight_shows_no_loss(rotors: int) -> None:
    estimator = EffectivenessEstimator(airframe(rotors))
    bank = estimator.bank
    assert bank is not None
    for reading in fly(Scenario(rotors, imu_hz=100.0, esc_hz=50.0, seed=12)):
        estimator.feed(reading)
        assert bank.partial.rotor is None
    assert bank.partial.time > 5.0
