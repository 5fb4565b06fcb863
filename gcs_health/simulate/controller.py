"""A cascade of position, velocity, attitude and rate loops, as autopilots fly: enough to look like flight.

    v* = v_ff + k_p (x* - x);  a* = k_v (v* - v) + integral;  thrust axis from a* - g
    W* = k_a (z_b x z_b*);     M = I (k_r (W* - W) + integral);  thrusts = pinv(B) [F, M]

When a rotor is known to be lost its column leaves B (PX4's CA_FAILURE_MODE does the same), which is what
lets a hexacopter fly on.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.gate import GRAVITY
from gcs_health.simulate.arithmetic import Arithmetic, Value
from gcs_health.simulate.plant import Plant
from gcs_health.simulate.trajectory import Goal
from gcs_health.simulate.vehicle import SimVehicle

MOST_TRIM = 20.0  # rad/s², limit of the rate loops' integrals


@dataclass(frozen=True, slots=True)
class Gains:
    """Loop gains [1/s] and limits; the rate loop must be slower than the motors."""

    position: float = 1.0
    velocity: float = 2.2
    velocity_integral: float = 0.4
    attitude: float = 7.0
    rate: float = 16.0
    rate_integral: float = 10.0
    yaw: float = 2.0
    yaw_rate: float = 4.0
    fastest_turn: float = 5.0  # rad/s
    yaw_share: float = 0.12  # of hover thrust that yaw may take of one rotor
    gyro_cutoff: float = 250.0  # rad/s, low pass in front of the rate loop


class Controller:
    """Turns goal and state into rotor speeds; `allocate` takes a new set of rotors to use.

    `thrust_axis` is where body z should point, in the world; `turn` the wanted body rates [rad/s];
    `yaw_integral` the yaw rate loop's integral as a share of its limit.
    """

    def __init__(self, vehicle: SimVehicle, ops: Arithmetic, dt: float, zero: Value, gains: Gains) -> None:
        self.vehicle = vehicle
        self.ops = ops
        self.dt = dt
        self.gains = gains
        self._push = [zero, zero, zero]  # velocity integral [m/s²]
        self._trim = [zero, zero, zero]  # rate integral [rad/s²]
        self._gyro = [zero, zero, zero]
        self.wanted: list[Value] = [zero] * len(vehicle.rotors)
        self.thrust_axis: tuple[Value, Value, Value] = (zero, zero, zero + 1.0)
        self.turn: tuple[Value, Value, Value] = (zero, zero, zero)
        self.crashed = zero > 1.0  # False, or a column of it
        self._mix: list[list[Value]] = mixer(vehicle, np.ones(len(vehicle.rotors))).tolist()

    def allocate(self, usable: NDArray[np.float64]) -> None:
        """Use these rotors from now on: (n,) of 0 and 1, or (n, flights)."""
        if usable.ndim == 1:
            self._mix = mixer(self.vehicle, usable).tolist()
            return
        mixes = np.stack([mixer(self.vehicle, column) for column in usable.T], axis=2)
        self._mix = [list(row) for row in mixes]

    @property
    def yaw_integral(self) -> Value:
        """Of the yaw rate loop, share of its limit [-]."""
        return self._trim[2] / MOST_TRIM

    def update(self, plant: Plant, gyro: list[Value], goal: Goal) -> list[Value]:
        """Return the wanted rotor speeds [rad/s]."""
        g, ops = self.gains, self.ops
        # columns of the rotation matrix: body x, y and z in the world
        x1, y1, z1, x2, y2, z2, x3, y3, z3 = plant.rotation
        ax, ay, az = self._acceleration(plant, goal)
        az = ops.minimum(az - GRAVITY, -0.3 * GRAVITY)  # never ask to fall faster than it can right itself
        flat = ops.sqrt(ax * ax + ay * ay) + 1e-9
        limit = ops.minimum(1.0, goal.tilt * -az / flat)
        ax, ay = ax * limit, ay * limit
        size = ops.sqrt(ax * ax + ay * ay + az * az)
        lift = plant.mass * ops.maximum(-(ax * z1 + ay * z2 + az * z3), 0.2 * GRAVITY)
        self.thrust_axis = d1, d2, d3 = -ax / size, -ay / size, -az / size
        # z_b x z_b* is the turn that is missing, in the world
        e1, e2, e3 = z2 * d3 - z3 * d2, z3 * d1 - z1 * d3, z1 * d2 - z2 * d1
        roll = g.attitude * (e1 * x1 + e2 * x2 + e3 * x3)
        pitch = g.attitude * (e1 * y1 + e2 * y2 + e3 * y3)
        self.turn = roll, pitch, -g.yaw * x2
        thrusts = self._share(lift, self._moment(gyro, *self.turn))
        low_down = plant.position[2] > -1.0 - self.vehicle.leg
        self.crashed = self.crashed | (low_down & (z3 < 0.3))  # it lies on its side: motors off
        on = ops.where(self.crashed | goal.off, 0.0, 1.0)
        idle = self.vehicle.motor.idle
        scale = 1.0 / self.vehicle.motor.thrust
        flying = ops.where(goal.idle, 0.0, 1.0)
        high, sqrt, standing = ops.maximum, ops.sqrt, (1.0 - flying) * idle
        self.wanted = [on * (flying * high(sqrt(one * scale), idle) + standing) for one in thrusts]
        return self.wanted

    def _acceleration(self, plant: Plant, goal: Goal) -> list[Value]:
        g, where, clip = self.gains, self.ops.where, self.ops.clip
        gathered, speed, idle = g.velocity_integral * self.dt, goal.speed, goal.idle
        out = []
        for k, (at, ahead, x, v) in enumerate(
            zip(
                (goal.x, goal.y, goal.z),
                (goal.vx, goal.vy, goal.vz),
                plant.position,
                plant.velocity,
                strict=True,
            )
        ):
            error = ahead + clip(g.position * (at - x), speed) - v
            self._push[k] = push = where(idle, 0.0, clip(self._push[k] + gathered * error, 4.0))
            out.append(g.velocity * error + push)
        return out

    def _moment(self, gyro: list[Value], roll: Value, pitch: Value, yaw: Value) -> list[Value]:
        g, clip = self.gains, self.ops.clip
        keep = min(1.0, self.dt * g.gyro_cutoff)
        gathered = g.rate_integral * self.dt
        out = []
        for k, goal, gain, share, inertia in zip(
            (0, 1, 2),
            (roll, pitch, yaw),
            (g.rate, g.rate, g.yaw_rate),
            (1.0, 1.0, 0.3),
            self.vehicle.inertia,
            strict=True,
        ):
            rate = self._gyro[k]
            self._gyro[k] = rate = rate + keep * (gyro[k] - rate)
            error = clip(goal, g.fastest_turn) - rate
            self._trim[k] = trim = clip(self._trim[k] + gathered * share * error, MOST_TRIM)
            out.append(inertia * (gain * error + trim))
        return out

    def _share(self, lift: Value, moment: list[Value]) -> list[Value]:
        """Return the thrusts; saturation costs yaw first, then height, last roll and pitch."""
        m, low, high, clip = self.vehicle.motor, self.ops.minimum, self.ops.maximum, self.ops.clip
        top, least = m.thrust * m.top**2, m.thrust * m.idle**2
        most_yaw = self.gains.yaw_share * self.vehicle.mass * GRAVITY / len(self._mix)
        mx, my, mz = moment
        thrusts = [
            up * lift + roll * mx + pitch * my + clip(yaw * mz, most_yaw)
            for up, roll, pitch, yaw in self._mix
        ]
        over = thrusts[0]
        for one in thrusts[1:]:
            over = high(over, one)
        over = high(over - top, 0.0)
        return [low(high(one - over, least), top) for one in thrusts]


def mixer(vehicle: SimVehicle, usable: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 4): thrust of each rotor per lift, roll, pitch and yaw moment, least in squares."""
    yaw = vehicle.motor.torque / vehicle.motor.thrust
    rows = [[1.0, -rotor.position[1], rotor.position[0], rotor.spin * yaw] for rotor in vehicle.rotors]
    B = np.array(rows).T * usable
    return np.asarray(np.linalg.pinv(B, rcond=1e-6), dtype=np.float64)
