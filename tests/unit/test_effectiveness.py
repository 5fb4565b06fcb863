"""The recommended mode on synthetic flights of 3 to 12 rotors with a known truth."""

import math
from dataclasses import replace

import pytest
from synthetic_flight import Scenario, airframe, fly

from gcs_health.airframe import Airframe
from gcs_health.errors import AirframeError, ConfigError
from gcs_health.estimators.contract import Estimate, Reason, Status
from gcs_health.estimators.effectiveness import EffectivenessConfig, EffectivenessEstimator
from gcs_health.samples import CommandReading, FlightReading, ImuReading, RotorReading

SHAPES = [(n, False) for n in (3, 4, 5, 6, 8, 12)] + [(6, True), (8, True)]


def decisions(scenario: Scenario, known: Airframe | None = None) -> list[Estimate]:
    """Return all that `feed` says of a flight."""
    craft = known or scenario.craft or airframe(scenario.rotors, scenario.coaxial)
    estimator = EffectivenessEstimator(craft)
    return [estimate for reading in fly(scenario) for estimate in estimator.feed(reading)]


@pytest.mark.parametrize(("rotors", "coaxial"), SHAPES)
def test_a_lost_propeller_is_named_fast_once_and_right(rotors: int, coaxial: bool) -> None:
    lost = rotors // 2
    told = decisions(Scenario(rotors, coaxial, duration=8.0, lost=lost))
    assert [estimate.rotor for estimate in told] == [lost]
    (estimate,) = told
    assert 7.0 < estimate.t < 7.15
    assert estimate.failure_probability > 0.9
    assert estimate.status is Status.VALID
    assert estimate.value < 0.4
    assert dict(estimate.evidence)["llr"] > 20.0


@pytest.mark.parametrize(("rotors", "coaxial"), [(3, False), (4, False), (8, True)])
def test_a_healthy_flight_is_silent_and_seen_as_healthy(rotors: int, coaxial: bool) -> None:
    estimator = EffectivenessEstimator(airframe(rotors, coaxial))
    for reading in fly(Scenario(rotors, coaxial, seed=11, jitter=0.3)):
        assert estimator.feed(reading) == []
    for estimate in estimator.estimates(10.0):
        assert estimate.status is Status.VALID
        assert estimate.reasons == ()
        assert estimate.failure_probability < 0.01
        assert abs(estimate.value - 1.0) < 3.0 * estimate.std + 0.1
        assert 0.0 < estimate.std < 0.3
        assert estimate.detectable == pytest.approx(0.5, abs=0.3)


@pytest.mark.parametrize(("imu_hz", "esc_hz"), [(500, 500), (250, 50), (100, 50), (50, 50), (50, 10)])
def test_any_rate_finds_it(imu_hz: float, esc_hz: float) -> None:
    told = decisions(Scenario(4, duration=8.0, imu_hz=imu_hz, esc_hz=esc_hz, lost=1))
    assert [estimate.rotor for estimate in told] == [1]
    assert 7.0 < told[0].t < 7.0 + 0.08 + 2.0 / esc_hz


def test_without_known_gains_they_are_learned_and_the_loss_is_found() -> None:
    unknown = airframe(4, known=False)
    told = decisions(Scenario(4, duration=8.0, lost=2), known=unknown)
    assert [estimate.rotor for estimate in told] == [2]
    estimator = EffectivenessEstimator(unknown)
    for reading in fly(Scenario(4, seed=3)):
        assert estimator.feed(reading) == []
    truth = airframe(4).effectiveness
    bank = estimator.bank
    assert bank is not None
    assert bank.gains.thrust == pytest.approx(truth.thrust, rel=0.05)
    assert max(bank.gains.roll) == pytest.approx(truth.roll, rel=0.25)
    assert max(bank.gains.pitch) == pytest.approx(truth.pitch, rel=0.25)


def test_a_mirrored_airframe_is_said_and_no_rotor_is_named() -> None:
    craft = airframe(4)
    mirrored = replace(
        craft,
        rotors=tuple(
            replace(rotor, position=(rotor.position[0], -rotor.position[1], 0.0)) for rotor in craft.rotors
        ),
    )
    told = decisions(Scenario(4, duration=12.0, lost=1, at=9.0), known=mirrored)
    assert told
    assert {estimate.status for estimate in told} == {Status.DIVERGED}
    assert {estimate.reasons[0] for estimate in told} == {Reason.GEOMETRY_CONTRADICTED}
    assert all(math.isnan(estimate.failure_probability) for estimate in told)


def test_mirrored_data_with_its_own_file_gives_the_mirrored_answer() -> None:
    craft = airframe(6)
    mirrored = replace(
        craft,
        rotors=tuple(
            replace(rotor, position=(rotor.position[0], -rotor.position[1], 0.0), spin=-rotor.spin)
            for rotor in craft.rotors
        ),
    )
    estimator = EffectivenessEstimator(mirrored)
    told = []
    for reading in fly(Scenario(6, duration=8.0, lost=2)):
        if isinstance(reading, ImuReading):
            reading = reading._replace(ay=-reading.ay, p=-reading.p, r=-reading.r)
        told += estimator.feed(reading)
    assert [estimate.rotor for estimate in told] == [2]


def test_a_stopped_motor_has_its_own_rule_and_its_effectiveness_is_unknown() -> None:
    told = decisions(Scenario(6, duration=8.0, stopped=4))
    assert [(estimate.rotor, estimate.reasons) for estimate in told] == [(4, (Reason.MOTOR_STOPPED,))]
    assert told[0].failure_probability > 0.9
    assert told[0].status is Status.UNOBSERVABLE
    assert math.isnan(told[0].value)
    assert told[0].t < 7.0 + 0.55  # without commands: a hard roll idles a rotor for a quarter of a second


def test_a_motor_commanded_to_turn_that_does_not_is_named_at_once() -> None:
    estimator = EffectivenessEstimator(airframe(6))
    told = []
    for reading in fly(Scenario(6, duration=8.0, stopped=4)):
        estimator.feed(CommandReading(reading.t, (0.5,) * 6))
        told += estimator.feed(reading)
    assert [(estimate.rotor, estimate.reasons) for estimate in told] == [(4, (Reason.MOTOR_STOPPED,))]
    assert told[0].t < 7.0 + 0.15


def test_a_motor_that_fell_before_it_was_ordered_off_has_failed() -> None:
    """A fault-tolerant controller gives up a motor that it sees failing: no order, but a consequence."""
    estimator = EffectivenessEstimator(airframe(6))
    told = []
    for reading in fly(Scenario(6, duration=8.0, stopped=4)):
        ordered = 0.0 if reading.t > 7.02 else 0.5
        estimator.feed(CommandReading(reading.t, (0.5, 0.5, 0.5, 0.5, ordered, 0.5)))
        told += estimator.feed(reading)
    assert [(estimate.rotor, estimate.reasons) for estimate in told] == [(4, (Reason.MOTOR_STOPPED,))]


def test_a_command_from_before_a_motor_slowed_down_does_not_accuse_it() -> None:
    """Where commands come seldom, the order that slowed it may be on its way."""
    estimator = EffectivenessEstimator(airframe(6))
    for reading in fly(Scenario(6, duration=7.35, stopped=4)):
        if reading.t < 7.0:
            estimator.feed(CommandReading(reading.t, (0.5,) * 6))
        assert estimator.feed(reading) == []
    estimator.feed(CommandReading(7.35, (0.5,) * 6))
    told = [e for reading in fly(Scenario(6, stopped=4, duration=7.5)) for e in estimator.feed(reading)]
    assert [(estimate.rotor, estimate.reasons) for estimate in told] == [(4, (Reason.MOTOR_STOPPED,))]


def test_a_motor_ordered_to_stop_is_no_failure() -> None:
    estimator = EffectivenessEstimator(airframe(6))
    for reading in fly(Scenario(6, duration=8.0, stopped=4)):
        if reading.t > 7.0:
            estimator.feed(CommandReading(reading.t, (0.5, 0.5, 0.5, 0.5, 0.0, 0.5)))
        assert estimator.feed(reading) == []


def test_only_one_fault_a_flight_and_a_new_flight_starts_clean() -> None:
    estimator = EffectivenessEstimator(airframe(6))
    told = [e for reading in fly(Scenario(6, duration=8.0, lost=3)) for e in estimator.feed(reading)]
    assert [estimate.rotor for estimate in told] == [3]
    for estimate in estimator.estimates(8.0):
        if estimate.rotor == 3:
            assert estimate.failure_probability > 0.9  # held
        else:
            assert estimate.reasons == (Reason.ANOTHER_ROTOR_FAILED,)
    # it lands, is disarmed, and flies again with a new propeller
    absent = (math.nan,) * 6
    for k in range(100):
        estimator.feed(RotorReading(8.0 + 0.05 * k, (0.0,) * 6, absent, absent))
    estimator.feed(FlightReading(13.0, False, True))
    again = []
    for reading in fly(Scenario(6, duration=8.0, seed=5)):
        again += estimator.feed(reading._replace(t=reading.t + 20.0))
    assert [(estimate.rotor, estimate.failure_probability < 0.5) for estimate in again] == [(3, True)]
    assert all(estimate.status is Status.VALID for estimate in estimator.estimates(28.0))


def test_what_is_missing_is_named() -> None:
    craft = airframe(4)
    for without, reason in ((ImuReading, Reason.NO_IMU), (RotorReading, Reason.NO_ROTOR_SPEEDS)):
        estimator = EffectivenessEstimator(craft)
        for reading in fly(Scenario(4, duration=4.0)):
            if not isinstance(reading, without):
                assert estimator.feed(reading) == []
        for estimate in estimator.estimates(4.0):
            assert reason in estimate.reasons
            assert estimate.status is Status.UNOBSERVABLE
    estimator = EffectivenessEstimator(craft)
    for reading in fly(Scenario(4, duration=8.0, silent=(2,), lost=1)):
        assert estimator.feed(reading) == []
    reasons = [estimate.reasons[0] for estimate in estimator.estimates(8.0)]
    assert reasons == [
        Reason.ROTOR_SPEEDS_INCOMPLETE,
        Reason.ROTOR_SPEEDS_INCOMPLETE,
        Reason.ROTOR_NOT_REPORTED,
        Reason.ROTOR_SPEEDS_INCOMPLETE,
    ]


def test_rates_that_are_too_low_promise_nothing() -> None:
    estimator = EffectivenessEstimator(airframe(4))
    for reading in fly(Scenario(4, duration=9.0, imu_hz=8.0, esc_hz=3.0, lost=0)):
        assert estimator.feed(reading) == []
    assert all(estimate.reasons == (Reason.RATE_TOO_LOW,) for estimate in estimator.estimates(9.0))


def test_what_the_method_cannot_do_fails_at_construction() -> None:
    for rotors in (2, 13):
        with pytest.raises(AirframeError, match="3 to 12"):
            EffectivenessEstimator(replace(airframe(6), rotors=airframe(13).rotors[:rotors]))
    flat = replace(
        airframe(4), rotors=tuple(replace(r, position=(0.0, r.position[1], 0.0)) for r in airframe(4).rotors)
    )
    with pytest.raises(AirframeError, match="forward"):
        EffectivenessEstimator(flat)
    with pytest.raises(ConfigError, match="paper"):
        EffectivenessEstimator(airframe(4), EffectivenessConfig(mode="best"))  # type: ignore[arg-type]
