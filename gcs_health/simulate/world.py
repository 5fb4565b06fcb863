"""The vehicle in its air under its pilot: one flight, or many side by side, step by step."""

import math
from dataclasses import replace

import numpy as np

from gcs_health.simulate.arithmetic import COLUMNS, FLOATS, Value
from gcs_health.simulate.controller import Controller, Gains
from gcs_health.simulate.faults import Fault, PlantFaults
from gcs_health.simulate.payload import Load
from gcs_health.simulate.plant import Plant
from gcs_health.simulate.scenario import Scenario
from gcs_health.simulate.sensors import Escs, Imu
from gcs_health.simulate.trajectory import Goal, Pilot
from gcs_health.simulate.wake import Wake
from gcs_health.simulate.wind import GRADES, Dryden

CONTROL_STEP, WIND_STEP = 0.002, 0.01  # s
PROPELLER_MASS = 0.5  # kg/m² of disc: some 8 g for a propeller of 0.13 m
LOST = ("propeller_lost", "motor_stopped", "motor_stuck")
FAULT_TOLERANT = 6  # rotors from which the controller flies on without one


class World:
    """Physics, controller and sensors of a scenario; `step` advances by one physics step.

    Attributes
    ----------
    t : flight time [s]. dt : physics step [s].
    plant, imu, escs, controller, goal : as they are now; floats for one seed, columns for several.
    imu_is_new : a new IMU value was published in the last step.
    """

    def __init__(self, scenario: Scenario, seeds: list[int], faults: tuple[Fault, ...] | None = None) -> None:
        self.scenario = scenario
        vehicle = scenario.vehicle
        count = len(seeds)
        self.ops = ops = FLOATS if count == 1 else COLUMNS
        zero: Value = 0.0 if count == 1 else np.zeros(count)
        self.dt = 1.0 / scenario.physics_rate
        self.t = 0.0
        self._k = 0
        # a part's chance depends on its own stream alone: more noise here moves nothing there
        streams = [np.random.SeedSequence(seed).spawn(6) for seed in seeds]
        rngs = [[np.random.default_rng(parts[k]) for parts in streams] for k in range(6)]
        self.plant = Plant(vehicle, ops, zero)
        self._vary(rngs[0], count)
        self._load = Load(scenario.payload, self.plant) if scenario.payload.mass else None
        self._drop_at = scenario.payload.dropped_at
        self.faults = scenario.faults if faults is None else faults
        self._plant_faults = PlantFaults(
            list(self.faults), ops, PROPELLER_MASS * (vehicle.rotors[0].radius or 0.1) ** 2 * math.pi
        )
        self._control_every = max(1, round(CONTROL_STEP / self.dt))
        self._wind_every = max(1, round(WIND_STEP / self.dt))
        step = self._control_every * self.dt
        aggressive = scenario.trajectory.kind == "aggressive"
        gains = replace(Gains(), position=1.6, velocity=3.0) if aggressive else Gains()
        self.controller = Controller(vehicle, ops, step, zero, gains)
        self.controller.mass = self.plant.mass
        self._pilot = Pilot(scenario.trajectory, rngs[1])
        self.goal: Goal = self._pilot.goal(0.0)
        plan, wind = scenario.trajectory, scenario.wind
        past = max(wind.speed, plan.speed if plan.kind in ("forward", "circle") else 0.0)
        self._gusts = Dryden(rngs[2], self._wind_every * self.dt, plan.height, past, GRADES[wind.turbulence])
        angle = math.radians(wind.direction)
        self._mean_wind = (-wind.speed * math.cos(angle), -wind.speed * math.sin(angle))
        self._heading = (math.cos(angle), math.sin(angle))
        self._wind: tuple[Value, Value, Value] = (0.0, 0.0, 0.0)
        ardupilot = scenario.telemetry.autopilot == "ardupilot"
        self.imu = Imu(scenario.sensors, ops, rngs[3], self.dt, ardupilot)
        self.escs = Escs(scenario.sensors, ops, rngs[4], len(vehicle.rotors))
        strength, often = wind.wake, self._wind_every * self.dt
        self._wake = Wake(strength, self.plant, ops, rngs[5], often) if strength else None
        self.imu_is_new = False
        self._lost_at = self._losses(count)

    def _vary(self, rngs: list[np.random.Generator], count: int) -> None:
        """Draw this vehicle from its kind: mass, thrust, inertia, and each rotor a little."""
        s, plant = self.scenario.spread, self.plant
        n = len(plant.rotors)
        draws = np.stack([rng.standard_normal(5 + 3 * n) for rng in rngs], axis=1)
        values = [float(row[0]) for row in draws] if count == 1 else list(draws)
        plant.mass = plant.mass * (1.0 + s.mass * values[0])
        plant.thrust_scale = 1.0 + s.thrust * values[1]
        plant.inertia = [
            value * (1.0 + s.inertia * chance)
            for value, chance in zip(plant.inertia, values[2:5], strict=True)
        ]
        vehicle = self.scenario.vehicle
        usual = self.scenario.sensors.residual_unbalance * vehicle.mass / vehicle.hover**2
        for i, rotor in enumerate(plant.rotors):
            thrust, torque, shake = values[5 + 3 * i : 8 + 3 * i]
            rotor.eta_t = 1.0 + s.rotor * thrust
            rotor.eta_q = 1.0 + s.rotor * torque
            rotor.imbalance = usual * abs(shake)

    def _losses(self, count: int) -> list[tuple[float, np.ndarray]]:
        """Return when the controller learns that a rotor is gone, and which rotors it has then."""
        n = len(self.scenario.vehicle.rotors)
        if n < FAULT_TOLERANT:
            return []
        events = []
        for fault in self.faults:
            if fault.kind in LOST:
                at = np.broadcast_to(fault.at, count)
                rotor = np.broadcast_to(fault.rotor, count)
                events += [(float(at[k]) + self.scenario.reaction, k, int(rotor[k])) for k in range(count)]
        usable = np.ones((n, count))
        out = []
        for known_at, flight, lost in sorted(events):
            usable[lost, flight] = 0.0
            out.append((known_at, usable.copy() if count > 1 else usable[:, 0].copy()))
        return out

    def step(self) -> None:
        """Advance by `dt`."""
        t = self.t
        self._plant_faults.apply(self.plant, t)
        if t >= self._drop_at and self._load is not None:
            self._load.drop()
            self._load = None
        if self._k % self._wind_every == 0:
            self._blow()
        if self._k % self._control_every == 0:
            while self._lost_at and t >= self._lost_at[0][0]:
                self.controller.allocate(self._lost_at.pop(0)[1])
            self.goal = self._pilot.goal(t)
            self.controller.update(self.plant, self.imu.gyro, self.goal)
        self.plant.step(self.dt, self.controller.wanted, self._wind)
        self._k += 1
        self.t = t = self._k * self.dt
        self.imu_is_new = self.imu.sample(t, self.plant)
        self.escs.sample(t, self.plant)

    def _blow(self) -> None:
        """Mean wind and gusts, in the world; less and less of both near the ground."""
        u, v, w = self._gusts.step()
        c, s = self._heading
        near = self.ops.minimum(self.ops.maximum(-self.plant.position[2] / 3.0, 0.0), 1.0)
        mean_x, mean_y = self._mean_wind
        self._wind = (near * (mean_x - u * c + v * s), near * (mean_y - u * s - v * c), near * w)
        if self._wake is not None:
            self._wake.step(self._wind)
