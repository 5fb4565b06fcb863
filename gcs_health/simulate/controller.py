"""A cascade of position, velocity, attitude and rate loops, as autopilots fly: enough to look like flight.

    v* = v_ff + k_p (x* - x);  a* = k_v (v* - v) + integral;  thrust axis from a* - g
    W* = k_a (z_b x z_b*);     M = I (k_r (W* - W) + integral);  thrusts = pinv(B) [F, M]

When a rotor is known to be lost its column leaves B (PX4's CA_FAILURE_MODE does the same), which is what
lets a hexacopter fly on.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.gate import GRAVITY
from gcs_health.simulate.arithmetic import Arithmetic, Value
from gcs_health.simulate.plant import Plant
from gcs_health.simulate.trajectory import Goal
from gcs_health.simulate.vehicle import SimVehicle

MOST_PUSH = 4.0  # m/s², limit of the velocity loops' integrals
MOST_TRIM = 20.0  # rad/s², limit of the rate loops' integrals
YAW_TRIM = 0.3  # the yaw loop's integral gathers more slowly by this


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
    `yaw_integral` the yaw rate loop's integral as a share of its limit; `mass` what it took off with [kg].
    """

    def __init__(self, vehicle: SimVehicle, ops: Arithmetic, dt: float, zero: Value, gains: Gains) -> None:
        self.vehicle = vehicle
        self.ops = ops
        self.dt = dt
        self.gains = gains
        self._push = [zero, zero, zero]  # velocity integral [m/s²]
        self._trim = [zero, zero, zero]  # rate integral [rad/s²]
        self._gyro = [zero, zero, zero]
        self.mass = zero + vehicle.mass
        self.wanted: list[Value] = [zero] * len(vehicle.rotors)
        self.thrust_axis: tuple[Value, Value, Value] = (zero, zero, zero + 1.0)
        self.turn: tuple[Value, Value, Value] = (zero, zero, zero)
        self.crashed = zero > 1.0  # False, or a column of it
        self._mix: list[list[Value]] = mixer(vehicle, np.ones(len(vehicle.rotors))).tolist()
        m = vehicle.motor
        self._thrusts = m.thrust * m.idle**2, m.thrust * m.top**2  # least and most of one rotor [N]
        self._most_yaw = gains.yaw_share * vehicle.mass * GRAVITY / len(vehicle.rotors)

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
        lift = self.mass * ops.maximum(-(ax * z1 + ay * z2 + az * z3), 0.2 * GRAVITY)
        self.thrust_axis = d1, d2, d3 = -ax / size, -ay / size, -az / size
        # z_b x z_b* is the turn that is missing, in the world
        e1, e2, e3 = z2 * d3 - z3 * d2, z3 * d1 - z1 * d3, z1 * d2 - z2 * d1
        roll = g.attitude * (e1 * x1 + e2 * x2 + e3 * x3)
        pitch = g.attitude * (e1 * y1 + e2 * y2 + e3 * y3)
        self.turn = roll, pitch, -g.yaw * x2
        thrusts = self._share(lift, *self._moment(gyro, *self.turn))
        low_down = plant.position[2] > -1.0 - self.vehicle.leg
        self.crashed = self.crashed | (low_down & (z3 < 0.3))  # it lies on its side: motors off
        idle, scale, sqrt = self.vehicle.motor.idle, 1.0 / self.vehicle.motor.thrust, ops.sqrt
        if goal.idle:
            speeds = [idle] * len(thrusts)
        else:
            speeds = ops.within([sqrt(one * scale) for one in thrusts], idle, math.inf)
        stopped = self.crashed | goal.off
        self.wanted = [ops.where(stopped, 0.0, one) for one in speeds] if ops.any(stopped) else speeds
        return self.wanted

    def _acceleration(self, plant: Plant, goal: Goal) -> list[Value]:
        g, clip3 = self.gains, self.ops.clip3
        x, y, z = plant.position
        vx, vy, vz = plant.velocity
        back, damp, gathered = g.position, g.velocity, g.velocity_integral * self.dt
        tx, ty, tz = clip3(back * (goal.x - x), back * (goal.y - y), back * (goal.z - z), goal.speed)
        ex, ey, ez = goal.vx + tx - vx, goal.vy + ty - vy, goal.vz + tz - vz
        if goal.idle:
            self._push = [0.0, 0.0, 0.0]
        else:
            px, py, pz = self._push
            self._push = clip3(px + gathered * ex, py + gathered * ey, pz + gathered * ez, MOST_PUSH)
        px, py, pz = self._push
        return [damp * ex + px, damp * ey + py, damp * ez + pz]

    def _moment(self, gyro: list[Value], roll: Value, pitch: Value, yaw: Value) -> tuple[Value, ...]:
        g, clip3 = self.gains, self.ops.clip3
        keep = min(1.0, self.dt * g.gyro_cutoff)
        (gp, gq, gr), (p, q, r) = gyro, self._gyro
        p, q, r = p + keep * (gp - p), q + keep * (gq - q), r + keep * (gr - r)
        self._gyro = [p, q, r]
        roll, pitch, yaw = clip3(roll, pitch, yaw, g.fastest_turn)
        ep, eq, er = roll - p, pitch - q, yaw - r
        gathered = g.rate_integral * self.dt
        tp, tq, tr = self._trim
        self._trim = tp, tq, tr = clip3(
            tp + gathered * ep, tq + gathered * eq, tr + gathered * YAW_TRIM * er, MOST_TRIM
        )
        ix, iy, iz = self.vehicle.inertia
        return ix * (g.rate * ep + tp), iy * (g.rate * eq + tq), iz * (g.yaw_rate * er + tr)

    def _share(self, lift: Value, mx: Value, my: Value, mz: Value) -> list[Value]:
        """Return the thrusts; saturation costs yaw first, then height, last roll and pitch."""
        ops, (least, top) = self.ops, self._thrusts
        clip, most_yaw = ops.clip, self._most_yaw
        thrusts = [
            up * lift + roll * mx + pitch * my + clip(yaw * mz, most_yaw)
            for up, roll, pitch, yaw in self._mix
        ]
        over = ops.maximum(ops.largest(thrusts) - top, 0.0)
        if ops.any(over):
            thrusts = [one - over for one in thrusts]
        return ops.within(thrusts, least, top)


def mixer(vehicle: SimVehicle, usable: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 4): thrust of each rotor per lift, roll, pitch and yaw moment, least in squares."""
    yaw = vehicle.motor.torque / vehicle.motor.thrust
    rows = [[1.0, -rotor.position[1], rotor.position[0], rotor.spin * yaw] for rotor in vehicle.rotors]
    B = np.array(rows).T * usable
    return np.asarray(np.linalg.pinv(B, rcond=1e-6), dtype=np.float64)
