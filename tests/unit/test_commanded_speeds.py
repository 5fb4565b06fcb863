"""Rotor speeds between slow samples, as the commands say they move."""

import math

import pytest

from gcs_health.estimators.commanded_speeds import CommandConfig, CommandedSpeeds
from gcs_health.samples import CommandReading

LAG, GAIN = 0.035, 1200.0  # s, rad/s per full command


def flown(seconds: float, config: CommandConfig | None = None) -> tuple[CommandedSpeeds, float, list[float]]:
    """Rotors that follow a wavy command with the lag: commands at 100 Hz, speeds at 10 Hz."""
    model = CommandedSpeeds(2, config or CommandConfig(lag=LAG))
    lagged = [0.5, 0.5]
    keep = math.exp(-0.01 / LAG)
    t = 0.0
    for k in range(round(seconds * 100)):
        t = k * 0.01
        command = (0.5 + 0.1 * math.sin(9.0 * t), 0.5 - 0.08 * math.sin(5.0 * t + 1.0))
        model.command(CommandReading(t, command))
        if k % 10 == 0:
            model.learn(t, [GAIN * each for each in lagged])
        lagged = [c + keep * (x - c) for c, x in zip(command, lagged, strict=True)]
    return model, t + 0.01, [GAIN * each for each in lagged]


def test_speeds_move_as_the_commands_have_borne_out() -> None:
    model, t, _ = flown(5.0)
    assert model.r2 > 0.95
    moved = model.moved(t, t - 0.1)
    assert moved is not None
    _, _, before = flown(4.9)
    _, _, now = flown(5.0)
    for got, a, b in zip(moved, before, now, strict=True):
        assert got == pytest.approx(b - a, abs=0.1 * GAIN * 0.1)


def test_commands_that_explain_nothing_are_not_believed() -> None:
    model = CommandedSpeeds(2, CommandConfig())
    for k in range(300):
        t = k * 0.01
        model.command(CommandReading(t, (0.5 + 0.1 * math.sin(9.0 * t), 0.5)))
        if k % 10 == 0:
            model.learn(t, [600.0 + 50.0 * math.sin(40.0 * t), 600.0])
    assert not model.trusted
    assert model.moved(3.0, 2.9) is None


def test_old_commands_hold_no_longer() -> None:
    model, t, _ = flown(5.0)
    assert model.moved(t + 1.0, t) is None


@pytest.mark.parametrize("command", [(0.5,), (0.5, math.nan), (0.5, math.inf)])
def test_incomplete_commands_are_dropped(command: tuple[float, ...]) -> None:
    model, t, _ = flown(5.0)
    expected = model.moved(t + 0.05, t)
    model.command(CommandReading(t + 0.01, command))
    assert model.moved(t + 0.05, t) == expected


@pytest.mark.parametrize(("command_hz", "tell"), [(100, True), (25, True), (10, False)])
def test_seldom_commands_do_not_tell_of_orders_between_slow_speeds(command_hz: int, tell: bool) -> None:
    model = CommandedSpeeds(1, CommandConfig())
    for k in range(500):
        t = k * 0.01
        level = 0.5 + 0.1 * math.sin(t)
        if k % (100 // command_hz) == 0:
            model.command(CommandReading(t, (level,)))
        if k % 10 == 0:
            model.learn(t, [GAIN * level])
    assert model.trusted
    assert model.interval == pytest.approx(1.0 / command_hz)
    assert model.tell_orders(0.1) is tell
    unknown = CommandedSpeeds(1, CommandConfig()).bend(0.1, 0.02)
    assert unknown == pytest.approx(1.1 * 0.1**2 / (8 * 0.04 * 0.02))
    told = model.bend(0.1, 0.02)
    assert told < 0.4 * unknown if tell and command_hz > 50 else 0.3 * unknown < told <= 1.01 * unknown
    assert model.bend(0.01, 0.02) == 0.0  # speeds in every tick hide nothing
