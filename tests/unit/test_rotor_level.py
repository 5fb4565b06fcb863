"""When rotors fly, and when a level of speed is another beginning."""

from gcs_health.estimators.rotor_level import LevelConfig, RotorLevel
from gcs_health.samples import FlightReading


def run(course: list[tuple[float, float]], level: RotorLevel | None = None) -> tuple[RotorLevel, list[float]]:
    """Play (seconds, speed) one after another at 50 Hz; return when it began anew."""
    level = level or RotorLevel(LevelConfig())
    begun, t = [], 0.0
    for seconds, speed in course:
        for _ in range(round(50 * seconds)):
            t += 0.02
            if level.speeds(t, speed):
                begun.append(t)
    return level, begun


def test_the_take_off_is_another_beginning_and_gusts_are_not() -> None:
    gusts = [(0.5, 550.0 * factor) for factor in (1.0, 1.25, 0.9, 1.2, 0.8, 1.25)] * 6
    level, begun = run([(5.0, 150.0), (6.0, 550.0), *gusts])
    assert any(5.0 < t < 7.5 for t in begun)
    assert not any(t > 7.5 for t in begun)
    assert level.airborne


def test_landed_keeps_an_idle_from_being_flight_and_a_take_off_ends_it() -> None:
    level = RotorLevel(LevelConfig())
    level.flight(FlightReading(0.0, True, True))
    run([(5.0, 150.0)], level)
    assert not level.airborne
    run([(5.0, 150.0), (3.0, 550.0)], level)
    assert level.airborne


def test_disarming_ends_the_flight() -> None:
    level, _ = run([(5.0, 550.0)])
    level.flight(FlightReading(5.0, True, False))
    assert level.airborne
    assert level.flight(FlightReading(6.0, False, True))
    assert not level.airborne


def test_rotors_that_stand_for_long_end_the_flight() -> None:
    level, _ = run([(5.0, 550.0), (3.0, 0.0)])
    assert not level.airborne
    assert level.value == 0.0
