"""What the current of a rotor that has failed tells of the kind."""

import math

import pytest

from gcs_health.fusion.commanded import Commanded
from gcs_health.fusion.kinds import Kind
from gcs_health.fusion.load import Load
from gcs_health.fusion.verdicts import Evidence
from gcs_health.samples import CommandReading, RotorReading

SPEED, CURRENT = 600.0, 8.0


def reading(t: float, speed: float = SPEED, current: float = CURRENT) -> RotorReading:
    """Four rotors, of which the third is at `speed` [rad/s] and draws `current` [A]."""
    return RotorReading(
        t, (SPEED, SPEED, speed, SPEED), (CURRENT, CURRENT, current, CURRENT), (math.nan,) * 4
    )


def followed(speed: float, current: float) -> dict[Kind, float]:
    load = Load(4)
    for k in range(50):
        load.learn(reading(0.1 * k))
    said: Evidence | None = None
    for k in range(5):
        said = load.follow(reading(5.0 + 0.1 * k, speed, current), 2) or said
    return dict(said.odds) if said is not None else {}


@pytest.mark.parametrize(
    ("current", "stuck"),
    [(30.0, True), (13.0, True), (0.1, False), (-0.3, False), (2.5, None), (math.nan, None)],
)
def test_a_rotor_that_stands_is_blocked_under_current_and_not_driven_without(
    current: float, stuck: bool | None
) -> None:
    odds = followed(0.0, current)
    if stuck is None:
        assert odds == {}  # neither: nothing can be said
    else:
        assert (odds[Kind.MOTOR_STUCK] > 0.0) is stuck
        assert (odds[Kind.MOTOR_STOPPED] < 0.0) is stuck


def test_a_rotor_that_turns_without_load_has_lost_its_propeller() -> None:
    odds = followed(900.0, 0.7)
    assert odds[Kind.PROPELLER_LOST] > 3.0
    assert odds[Kind.PROPELLER_SLIPPING] < odds[Kind.PROPELLER_LOST]
    assert Kind.MOTOR_STUCK not in odds


@pytest.mark.parametrize(("current", "told"), [(0.1, True), (-2.5, False)])
def test_a_slow_rotor_without_current_is_stopped_but_not_one_that_brakes(current: float, told: bool) -> None:
    commanded = Commanded(4)
    said: list[Evidence] = []
    for k in range(300):
        t = 0.01 * k
        commanded.command(CommandReading(t, (0.5,) * 4))
        fails = t > 2.8
        said += commanded.rotors(
            reading(t, 0.7 * SPEED if fails else SPEED, current if fails else CURRENT), True
        )
    assert bool(said) is told
    assert all(each.rotor == 2 for each in said)


@pytest.mark.parametrize(("obeys", "told"), [(True, False), (False, True)])
def test_a_rotor_that_brakes_through_no_current_is_not_stopped_before_its_order_is_heard(
    obeys: bool, told: bool
) -> None:
    """Commands come at 10 Hz; the third rotor slows down between two of them, ordered to or not."""
    commanded = Commanded(4)
    said: list[Evidence] = []
    for k in range(320):
        t = 0.01 * k
        slows = t > 3.001
        if k % 10 == 0:
            commanded.command(CommandReading(t, (0.5, 0.5, 0.3 if slows and obeys else 0.5, 0.5)))
        speed = max(SPEED - 8000.0 * (t - 3.001), 0.6 * SPEED) if slows else SPEED
        said += commanded.rotors(reading(t, speed, 0.1 if slows else CURRENT), True)
    assert bool(said) is told


@pytest.mark.parametrize(
    ("orders", "told"), [((0.44, 0.29), False), ((0.5, 0.5), True)], ids=["down", "kept"]
)
def test_a_rotor_whose_command_falls_from_one_to_the_next_is_not_stopped(
    orders: tuple[float, float], told: bool
) -> None:
    """Speeds and commands at 10 Hz: it runs ahead of the commands that are heard, through no current."""
    commanded = Commanded(4)
    said: list[Evidence] = []
    for k in range(32):
        t = 0.1 * k
        own = 0.5 if k < 30 else orders[k - 30]
        commanded.command(CommandReading(t - 0.09, (0.5, 0.5, own, 0.5)))
        speed = SPEED if k < 30 else (0.65, 0.4)[k - 30] * SPEED
        said += commanded.rotors(reading(t, speed, CURRENT if k < 30 else 0.1), True)
    commanded.command(CommandReading(3.11, (0.5, 0.5, orders[1], 0.5)))
    said += commanded.rotors(reading(3.2, 0.38 * SPEED, 0.1), True)
    assert bool(said) is told


def test_a_command_that_falls_for_all_rotors_makes_none_of_them_slow() -> None:
    commanded = Commanded(4)
    said: list[Evidence] = []
    for k in range(400):
        t = 0.01 * k
        commanded.command(CommandReading(t, (0.5 if t < 3.0 else 0.25,) * 4))
        slow, quick = (max(SPEED - rate * max(t - 3.0, 0.0), 0.5 * SPEED) for rate in (1500.0, 5000.0))
        current = CURRENT if t < 3.0 else 0.1
        said += commanded.rotors(
            RotorReading(t, (slow, slow, quick, slow), (current,) * 4, (math.nan,) * 4), True
        )
    assert said == []
