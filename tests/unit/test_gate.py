"""The flight gate: what closes it, what must not."""

import math

import pytest

from gcs_health.estimators.contract import Reason
from gcs_health.gate import GRAVITY, Closed, FlightGate

THRUST = GRAVITY / 4 / 700.0**2


def run(
    gate: FlightGate,
    seconds: float,
    speeds: tuple[float, ...] = (700.0,) * 4,
    az: float = -GRAVITY,
    start: float = 0.0,
    dt: float = 0.008,
    age: float = 0.002,
    interval: float = 0.01,
) -> float:
    """Feed constant ticks; return the time after the last."""
    count = round(seconds / dt)
    for k in range(count):
        gate.feed(start + k * dt, dt, list(speeds), age, interval, az, THRUST)
    return start + count * dt


def opened() -> tuple[FlightGate, float]:
    gate = FlightGate(4)
    return gate, run(gate, 2.0)


def test_opens_half_a_second_after_all_is_well_and_judges_half_a_second_later() -> None:
    gate = FlightGate(4)
    t = run(gate, 0.48)
    assert not gate.open
    assert gate.reason is Closed.SETTLING
    t = run(gate, 0.1, start=t)
    assert gate.open
    assert not gate.verdicts
    run(gate, 0.6, start=t)
    assert gate.verdicts
    assert gate.reason is None


@pytest.mark.parametrize(
    ("speeds", "reason"),
    [
        ((0.0,) * 4, Closed.ON_GROUND),
        ((200.0,) * 4, Closed.ROTORS_BELOW_HOVER),
        ((700.0, 700.0, 250.0, 250.0), Closed.ROTORS_BELOW_HOVER),
    ],
)
def test_slow_rotors_close_it(speeds: tuple[float, ...], reason: Closed) -> None:
    gate, t = opened()
    run(gate, 0.2, speeds, start=t)
    assert not gate.open
    assert gate.reason is reason
    assert Reason(reason.value)


def test_one_stopped_rotor_and_free_fall_leave_it_open() -> None:
    gate, t = opened()
    t = run(gate, 0.3, (0.0, 800.0, 800.0, 800.0), az=-7.0, start=t)
    assert gate.open
    run(gate, 0.5, az=-0.2, start=t)  # no lift although the rotors turn: that is the fault itself
    assert gate.open
    assert gate.verdicts


def test_a_push_up_closes_it_and_a_short_knock_stops_verdicts_for_a_tenth_of_a_second() -> None:
    gate, t = opened()
    t = run(gate, 0.06, az=-3.0 * GRAVITY, start=t)
    assert not gate.open
    assert gate.reason is Closed.CONTACT
    gate, t = opened()
    gate.feed(t, 0.008, [700.0] * 4, 0.0, 0.01, -GRAVITY - 9.0, THRUST)
    assert gate.open
    assert not gate.verdicts
    assert gate.reason is Closed.CONTACT
    t = run(gate, 0.08, start=t + 0.008)
    assert not gate.verdicts
    run(gate, 0.05, start=t)
    assert gate.verdicts


PUSHED = -2.5 * GRAVITY


def test_after_a_gust_in_the_midst_of_flight_it_judges_at_once_and_teaches_as_ever() -> None:
    gate, t = opened()
    t = run(gate, 0.07, az=PUSHED, start=t)
    assert not gate.open
    t = run(gate, 0.25, start=t)
    assert gate.after_gust
    assert gate.verdicts
    assert not gate.teaches
    run(gate, 0.4, start=t)
    assert gate.teaches


@pytest.mark.parametrize(
    ("flown", "push"),
    [(1.2, 0.07), (2.0, 0.3)],
    ids=["soon after the take-off", "longer than a gust: a touchdown"],
)
def test_a_push_that_may_be_the_ground_waits_as_usual(flown: float, push: float) -> None:
    gate = FlightGate(4)
    t = run(gate, flown)
    assert gate.verdicts
    t = run(gate, push, az=PUSHED, start=t)
    assert not gate.open
    t = run(gate, 0.9, start=t)
    assert not gate.after_gust
    assert not gate.verdicts
    run(gate, 0.3, start=t)
    assert gate.verdicts


def test_stale_rotor_speeds_and_imu_gaps_close_it() -> None:
    gate, t = opened()
    run(gate, 0.008, start=t, age=0.09)
    assert gate.reason is Closed.ROTOR_SPEED_STALE
    gate, t = opened()
    run(gate, 0.008, start=t, age=0.09, interval=0.05)  # slow ones may be that old
    assert gate.open
    gate, t = opened()
    gate.feed(t + 0.12, 0.128, [700.0] * 4, 0.0, 0.01, -GRAVITY, THRUST)
    assert gate.reason is Closed.IMU_STALE


def test_a_gap_of_the_whole_link_below_the_limit_is_not_stale_telemetry() -> None:
    gate, t = opened()
    gate.feed(t + 0.07, 0.078, [700.0] * 4, 0.085, 0.02, -GRAVITY, THRUST)
    assert gate.open


def test_noise_alone_does_not_close_it() -> None:
    gate = FlightGate(4)
    for k in range(2000):  # aliased vibration of 6 m/s²
        gate.feed(0.02 * k, 0.02, [700.0] * 4, 0.0, 0.02, -GRAVITY + 6.0 * math.sin(2.4 * k), THRUST)
        if k > 500:
            assert gate.open


def test_every_way_of_being_closed_is_a_reason() -> None:
    assert {closed.value for closed in Closed} <= {reason.value for reason in Reason}
