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

    `thrust_axis` is where body z should point, in the world; `yaw_integral` the yaw rate loop's integral
    as a share of its limit.
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
        qw, qx, qy, qz = plant.attitude
        # third and first column of the rotation matrix: body z and body x in the world
        z1, z2, z3 = 2 * (qx * qz + qw * qy), 2 * (qy * qz - qw * qx), 1 - 2 * (qx * qx + qy * qy)
        ax, ay, az = self._acceleration(plant, goal)
        az = ops.minimum(az - GRAVITY, -0.3 * GRAVITY)  # never ask to fall faster than it can right itself
        flat = ops.sqrt(ax * ax + ay * ay) + 1e-9
        limit = ops.minimum(1.0, goal.tilt * -az / flat)
        ax, ay = ax * limit, ay * limit
        size = ops.sqrt(ax * ax + ay * ay + az * az)
        lift = plant.mass * ops.maximum(-(ax * z1 + ay * z2 + az * z3), 0.2 * GRAVITY)
        self.thrust_axis = d1, d2, d3 = -ax / size, -ay / size, -az / size
        # z_b x z_b* is the turn that is missing, in the world; its body components need body x and y
        e1, e2, e3 = z2 * d3 - z3 * d2, z3 * d1 - z1 * d3, z1 * d2 - z2 * d1
        x1, x2, x3 = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qw * qz), 2 * (qx * qz - qw * qy)
        y1, y2, y3 = 2 * (qx * qy - qw * qz), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz + qw * qx)
        roll = g.attitude * (e1 * x1 + e2 * x2 + e3 * x3)
        pitch = g.attitude * (e1 * y1 + e2 * y2 + e3 * y3)
        thrusts = self._share(lift, self._moment(gyro, roll, pitch, -g.yaw * x2))
        low_down = plant.position[2] > -1.0 - self.vehicle.leg
        self.crashed = self.crashed | (low_down & (z3 < 0.3))  # it lies on its side: motors off
        on = ops.where(self.crashed | goal.off, 0.0, 1.0)
        idle = self.vehicle.motor.idle
        scale = 1.0 / self.vehicle.motor.thrust
        flying = ops.where(goal.idle, 0.0, 1.0)
        self.wanted = [
            on * (flying * ops.maximum(ops.sqrt(one * scale), idle) + (1.0 - flying) * idle)
            for one in thrusts
        ]
        return self.wanted

    def _acceleration(self, plant: Plant, goal: Goal) -> list[Value]:
        g, ops = self.gains, self.ops
        out = []
        for k, (at, ahead) in enumerate(((goal.x, goal.vx), (goal.y, goal.vy), (goal.z, goal.vz))):
            wanted = ahead + ops.minimum(
                ops.maximum(g.position * (at - plant.position[k]), -goal.speed), goal.speed
            )
            error = wanted - plant.velocity[k]
            push = self._push[k] + g.velocity_integral * self.dt * error
            self._push[k] = ops.where(goal.idle, 0.0, ops.minimum(ops.maximum(push, -4.0), 4.0))
            out.append(g.velocity * error + self._push[k])
        return out

    def _moment(self, gyro: list[Value], roll: Value, pitch: Value, yaw: Value) -> list[Value]:
        g, ops = self.gains, self.ops
        keep = min(1.0, self.dt * g.gyro_cutoff)
        out = []
        for k, goal in enumerate((roll, pitch, yaw)):
            self._gyro[k] = rate = self._gyro[k] + keep * (gyro[k] - self._gyro[k])
            gain = g.rate if k < 2 else g.yaw_rate
            error = ops.minimum(ops.maximum(goal, -g.fastest_turn), g.fastest_turn) - rate
            trim = self._trim[k] + g.rate_integral * self.dt * error * (1.0 if k < 2 else 0.3)
            self._trim[k] = ops.minimum(ops.maximum(trim, -MOST_TRIM), MOST_TRIM)
            out.append(self.vehicle.inertia[k] * (gain * error + self._trim[k]))
        return out

    def _share(self, lift: Value, moment: list[Value]) -> list[Value]:
        """Return the thrusts; saturation costs yaw first, then height, last roll and pitch."""
        m, ops = self.vehicle.motor, self.ops
        top, least = m.thrust * m.top**2, m.thrust * m.idle**2
        most_yaw = self.gains.yaw_share * self.vehicle.mass * GRAVITY / len(self._mix)
        thrusts = []
        for up, roll, pitch, yaw in self._mix:
            turn = ops.minimum(ops.maximum(yaw * moment[2], -most_yaw), most_yaw)
            thrusts.append(up * lift + roll * moment[0] + pitch * moment[1] + turn)
        over = thrusts[0]
        for one in thrusts[1:]:
            over = ops.maximum(over, one)
        over = ops.maximum(over - top, 0.0)
        return [ops.minimum(ops.maximum(one - over, least), top) for one in thrusts]


def mixer(vehicle: SimVehicle, usable: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 4): thrust of each rotor per lift, roll, pitch and yaw moment, least in squares."""
    yaw = vehicle.motor.torque / vehicle.motor.thrust
    rows = [[1.0, -rotor.position[1], rotor.position[0], rotor.spin * yaw] for rotor in vehicle.rotors]
    B = np.array(rows).T * usable
    return np.asarray(np.linalg.pinv(B, rcond=1e-6), dtype=np.float64)
