"""A rotor that lost a part of its thrust: named, sized, with an interval that holds; healthy flight is silent."""

from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_flight import Scenario, airframe, fly

from gcs_health.estimators.contract import Estimate, Status
from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.estimators.partial_loss import PartialConfig, PartialLoss
from gcs_health.gate import Closed


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


@pytest.mark.parametrize(("lift", "named"), [(-0.03, True), (0.15, False)])
def test_a_dropped_load_is_no_loss_although_it_turns_the_vehicle_as_one_would(
    lift: float, named: bool
) -> None:
    gains = np.array([[-6.0, 6.0, 6.0, -6.0], [6.0, -6.0, 6.0, -6.0], [0.0] * 4, [-2.4] * 4]) / 250_000.0
    squares = np.full((20, 4), 250_000.0)
    rng = np.random.default_rng(1)
    partial = PartialLoss(4, PartialConfig())
    seen = []
    for k in range(60):
        e = rng.normal(0.0, 0.3, (20, 4))
        if k >= 25:  # after 10 s
            e -= 0.12 * 250_000.0 * gains[:, 2]
            e[:, 3] = -lift * 9.6
        lesson = SimpleNamespace(
            length=0.4,
            dt=np.full(20, 0.02),
            e=e,
            variances=np.full((20, 4), 0.1),
            squares=squares,
            last_squares=squares,
        )
        partial.feed(lesson, gains)
        seen.append(partial.rotor)
    assert seen[:25] == [None] * 25
    lasted = sum(rotor is not None for rotor in seen)
    assert {rotor for rotor in seen if rotor is not None} <= {2}
    assert lasted > 30 if named else lasted * 0.4 < 1.5  # s; and then it is not told


@pytest.mark.parametrize("closed", [0.2, 4.0])
def test_a_gate_closed_for_a_moment_by_the_loss_does_not_swallow_it(closed: float) -> None:
    scenario = Scenario(4, duration=14.0, at=7.0, lost=1, left=0.7, imu_hz=100.0, esc_hz=50.0, seed=4)
    estimator = EffectivenessEstimator(airframe(4))
    bank = estimator.bank
    assert bank is not None
    first = None
    for reading in fly(scenario):
        estimator.feed(reading)
        if 7.05 < reading.t < 7.05 + closed:
            bank.gate.close(Closed.CONTACT)
        elif first is None and bank.partial.rotor is not None:
            first = reading.t
    if closed > 3.0:  # who knows what it carries now
        assert first is None
        return
    assert first is not None
    assert first < 7.05 + closed + bank.config.gate.open_after + 1.7
    assert bank.partial.rotor == 1
    assert abs(bank.partial.theta - 0.3) < 2.0 * bank.partial.std


def test_a_large_loss_named_at_once_is_sized_better_a_second_later() -> None:
    scenario = Scenario(4, duration=9.0, at=6.0, lost=2, left=0.4, imu_hz=100.0, esc_hz=50.0, seed=4)
    estimator = EffectivenessEstimator(airframe(4))
    spreads = []
    for reading in fly(scenario):
        estimator.feed(reading)
        if estimator.bank is not None and estimator.bank.failed == 2:
            estimate = estimator.estimates(reading.t)[2]
            assert estimate.failure_probability > 0.9
            assert abs(estimate.value - 0.4) < 3.0 * estimate.std
            spreads.append(estimate.std)
    assert spreads[-1] < 0.8 * spreads[0]
