"""Flights as columns: what the estimators are fed, and what the controller knew."""

import numpy as np

from gcs_health.samples import CommandReading, RotorReading
from gcs_health.simulate.batch import fly_many
from gcs_health.simulate.scenario import load_scenario


def test_commands_come_when_asked_for_and_change_nothing_else() -> None:
    short = ["trajectory.height=1.5", "trajectory.duration=4", "trajectory.lands=false", "physics_rate=500"]
    flights = fly_many(load_scenario("healthy_quad", short), [1, 2], 100.0, 50.0)
    plain, full = list(flights.readings(1)), list(flights.readings(1, commands=True))
    assert not any(isinstance(reading, CommandReading) for reading in plain)
    others = [reading for reading in full if not isinstance(reading, CommandReading)]
    assert repr(others) == repr(plain)  # NaN is unequal to itself
    commands = [reading for reading in full if isinstance(reading, CommandReading)]
    assert len(commands) == len(flights.command_t) == sum(isinstance(r, RotorReading) for r in full)
    hover = flights.command[-20:, :, 1].mean()
    speed = flights.speed[-20:, :, 1].mean()
    np.testing.assert_allclose(hover * 1257.0, speed, rtol=0.01)  # a governed ESC: the top speed of bebop2
    lean, error, thrust, climb, yaw = flights.control[-20:, :, 1].mean(axis=0)
    assert 0.0 <= lean < 0.2
    assert 0.0 <= error < 0.2
    np.testing.assert_allclose(thrust, hover**2, rtol=0.02)
    assert abs(climb) < 1.0
    assert abs(yaw) < 0.2
