"""Many flights side by side, as columns: what campaigns feed to the estimators without MAVLink between.

The same physics as one flight, a column of flights in place of every float; a step costs little more for
some hundred flights than for one. Each flight depends on its own seed alone, whoever flies beside it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.samples import CommandReading, FlightReading, ImuReading, Reading, RotorReading
from gcs_health.simulate.arithmetic import Value
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import Scenario
from gcs_health.simulate.telemetry import BOOTED
from gcs_health.simulate.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Flights:
    """What the sensors gave in each of `count` flights; times are since boot, common to all.

    Attributes
    ----------
    imu_t (k,) [s]; imu (k, 6, count): ax, ay, az [m/s²], p, q, r [rad/s].
    rotor_t (m,) [s]; speed (m, n, count) [rad/s]; current (m, n, count) [A].
    command_t (m,) [s]; command (m, n, count) [-]: speed wanted of each rotor, share of the top speed.
    control (m, 5, count), at `command_t`: target lean, attitude error [rad], collective thrust as a share of
    the most [-], climb rate [m/s], integral of the yaw rate loop as a share of its limit [-].
    height (k, count) [m]: the truth.
    flying_from [s].
    """

    imu_t: Array
    imu: Array
    rotor_t: Array
    speed: Array
    current: Array
    command_t: Array
    command: Array
    control: Array
    height: Array
    flying_from: float

    @property
    def count(self) -> int:
        """Number of flights."""
        return int(self.imu.shape[2])

    def readings(self, flight: int, commands: bool = False) -> Iterator[Reading]:
        """Yield one flight's readings in the order in which they arrived; `commands` among them or not."""
        imu = self.imu[:, :, flight].tolist()
        speed, current = self.speed[:, :, flight].tolist(), self.current[:, :, flight].tolist()
        command = self.command[:, :, flight].tolist() if commands else []
        rotor_t, command_t = self.rotor_t.tolist(), self.command_t.tolist()
        volts = (float("nan"),) * self.speed.shape[1]
        taken = told = 0
        flew = False
        for t, values, height in zip(self.imu_t.tolist(), imu, self.height[:, flight].tolist(), strict=True):
            while told < len(command) and command_t[told] <= t:
                yield CommandReading(command_t[told], tuple(command[told]))
                told += 1
            while taken < len(rotor_t) and rotor_t[taken] <= t:
                yield RotorReading(rotor_t[taken], tuple(speed[taken]), tuple(current[taken]), volts)
                taken += 1
            if (height > 0.1) is not flew:
                flew = height > 0.1
                yield FlightReading(t, True, not flew)
            yield ImuReading(t, *values)


def fly_many(
    scenario: Scenario,
    seeds: list[int],
    imu_rate: float,
    esc_rate: float,
    faults: tuple[Fault, ...] | None = None,
    *,
    payload: Value = 1.0,
    used: Value = 0.0,
) -> Flights:
    """Fly a scenario once for each seed, telemetry at `imu_rate` and `esc_rate` [Hz].

    `faults` replace the scenario's; their rotor, at and size may be columns, one value a flight. So may `payload`,
    factor on the mass, and `used`, what has gone of the battery's charge before [A h].
    """
    world = World(scenario, seeds, faults)
    world.plant.mass = world.plant.mass * payload
    world.plant.used = world.plant.used + used
    steps = round(scenario.trajectory.duration / world.dt)
    imu_every = max(1, round(1.0 / (imu_rate * world.dt)))
    esc_every = max(1, round(1.0 / (esc_rate * world.dt)))
    shape = len(seeds)
    top = scenario.vehicle.motor.top
    imu, speed, current, height = [], [], [], []
    imu_t, rotor_t = [], []
    command_t, command, control = [], [], []
    for k in range(1, steps + 1):
        world.step()
        if k % imu_every == 0:
            sample = world.imu.latest
            imu_t.append(BOOTED + sample.t)
            imu.append([np.broadcast_to(value, shape) for value in sample.values])
            height.append(np.broadcast_to(-world.plant.position[2] - scenario.vehicle.leg, shape))
        known = world.escs.known
        if k % esc_every == 0 and all(sample is not None for sample in known):
            told = [sample for sample in known if sample is not None]
            rotor_t.append(BOOTED + told[0].t)
            speed.append([np.broadcast_to(sample.rpm * (np.pi / 30.0), shape) for sample in told])
            current.append([np.broadcast_to(sample.current, shape) for sample in told])
            command_t.append(BOOTED + world.t)
            command.append([np.broadcast_to(one, shape) / top for one in world.controller.wanted])
            control.append([np.broadcast_to(one, shape) for one in _control(world, command[-1])])
    return Flights(
        np.array(imu_t),
        np.array(imu),
        np.array(rotor_t),
        np.array(speed),
        np.array(current),
        np.array(command_t),
        np.array(command),
        np.array(control),
        np.array(height),
        BOOTED + scenario.trajectory.flying_from,
    )


def _control(world: World, command: list[Array]) -> tuple[Value, ...]:
    """Return a row of `Flights.control`."""
    _, _, z1, _, _, z2, _, _, z3 = world.plant.rotation
    d1, d2, d3 = world.controller.thrust_axis
    error = np.arccos(np.clip(z1 * d1 + z2 * d2 + z3 * d3, -1.0, 1.0))
    thrust = sum(one * one for one in command) / len(command)
    lean = np.arccos(np.clip(d3, -1.0, 1.0))
    return lean, error, thrust, -world.plant.velocity[2], world.controller.yaw_integral
