"""Motor commands from output messages: unit, channels, and one stream at a time."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_health.motor_outputs import MotorOutputs
from gcs_health.samples import CommandReading, Outputs

NAN = math.nan


def quad() -> MotorOutputs:
    """Motor k + 1 on ESC k."""
    motors = MotorOutputs()
    motors.set_motors(((1, 0), (2, 1), (3, 2), (4, 3)))
    return motors


def outputs(values: tuple[float, ...], message: int = 375, port: int = 0) -> Outputs:
    return Outputs(1, 1, message, 0, 1, port, values)


def command(out: object) -> tuple[float, ...]:
    assert isinstance(out, CommandReading)
    return out.command


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        ([(0.0, 0.25, 0.5, 1.0)], (0.0, 0.25, 0.5, 1.0)),
        ([(900.0, 1000.0, 1500.0, 2000.0)], (0.0, 0.0, 0.5, 1.0)),
        ([(48.0, 500.0, 1000.0, 2000.0)], (0.024, 0.25, 0.5, 1.0)),
        ([(8191.0, 0.0, 0.0, 0.0), (0.0, 8191.0, 1000.0, 0.0)], (0.0, 1.0, 1000 / 8191, 0.0)),
        ([(48.0, 48.0, 48.0, 48.0), (1000.0, 1200.0, 1400.0, 1600.0)], (0.5, 0.6, 0.7, 0.8)),
        ([(1000.0, 1000.0, 1000.0, 1000.0), (0.0, 0.0, 0.0, 0.0)], (0.0, 0.0, 0.0, 0.0)),
        ([(1100.0, NAN, 1900.0, -1.0)], (0.1, NAN, 0.9, 0.0)),
        ([(0.5, 0.5)], (0.5, 0.5, NAN, NAN)),
    ],
)
def test_the_unit_of_commands_is_told_from_their_range(
    seen: list[tuple[float, ...]], expected: tuple[float, ...]
) -> None:
    motors = quad()
    for k, values in enumerate(seen):
        out = command(motors.feed(k * 0.1, outputs(values)))
    assert out == pytest.approx(expected, nan_ok=True)


@given(st.lists(st.tuples(*[st.floats(allow_nan=True, width=32)] * 4), min_size=1, max_size=20))
def test_commands_are_within_bounds_whatever_comes(rows: list[tuple[float, ...]]) -> None:
    motors = quad()
    for k, row in enumerate(rows):
        for value in command(motors.feed(k * 0.1, outputs(row))):
            assert 0.0 <= value <= 1.0 or math.isnan(value)


def test_channels_go_to_motors_as_told() -> None:
    motors = quad()
    motors.set_channels({1: 4, 2: 5, 3: 6, 4: 99})
    out = command(motors.feed(1.0, outputs((0.9, 0.9, 0.9, 0.9, 0.1, 0.2, 0.3, 0.4))))
    assert out == pytest.approx((0.1, 0.2, 0.3, NAN), nan_ok=True)


def test_one_stream_of_commands_until_it_is_silent() -> None:
    motors = quad()
    assert motors.feed(0.0, outputs((1500.0,) * 4, 36)) is not None
    assert motors.feed(0.1, outputs((0.5,) * 4, 375)) is None
    assert motors.feed(0.2, outputs((1500.0,) * 4, 36)) is not None
    assert motors.feed(2.1, outputs((0.5,) * 4, 375)) is None
    assert command(motors.feed(2.3, outputs((0.5,) * 4, 375))) == (0.5,) * 4


@pytest.mark.parametrize("sample", [outputs((0.5,) * 8, 140), outputs((1500.0,) * 8, 36, 1)])
def test_axis_controls_and_other_ports_are_no_motor_commands(sample: Outputs) -> None:
    assert quad().feed(1.0, sample) is None
