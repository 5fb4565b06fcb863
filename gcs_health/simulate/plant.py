"""Six degrees of freedom on any number of rotors, in flight, on the ground and in between.

    J w'    = kappa_q i - kappa_tau etaQ w² - kappa_f w               each rotor, ESC speed loop behind it
    T       = kappa_T etaT ch w² (1 - c v_axial / (w r)),   M_z = s (kappa_q i - kappa_f w)
    m v'    = R (F_rotors + F_air) + m g + F_ground
    I W'    = M - W x (I W + e3 sum s J w)
    q'      = q W / 2

World axes north, east, down; body axes forward, right, down; the ground is at z = 0. Every value is a float
or a column of flights (`arithmetic.py`). Source: sheet 1 section 2, sheet 3 eqs. (5), (6), (8).
"""

from dataclasses import dataclass

from gcs_health.gate import GRAVITY
from gcs_health.simulate.arithmetic import Arithmetic, Value
from gcs_health.simulate.vehicle import SimVehicle

AIR_DENSITY = 1.225  # kg/m³
CENTRE = (0.0, 0.0, 0.0)
SINK = 0.004  # m that the legs give under the weight
SLIP = 15.0  # 1/s, how fast the ground stops sliding


@dataclass(slots=True)
class RotorState:
    """One rotor: its place, its state, and what faults have made of it.

    Attributes
    ----------
    x, y : its arm [m]. spin : 1 counter-clockwise. climb : c / r of the thrust lost in inflow [1/m].
    w, phase : speed [rad/s] and angle [rad].
    current : motor torque current [A].
    thrust, lift : kappa_T etaT and the force now [N].
    etaT, etaQ : effectiveness of thrust and of drag torque; 1 = healthy.
    churn : ch, factor on thrust in its own wake (`wake.py`).
    friction : factor on kappa_f. inertia : J now [kg m²].
    slowed : factor on the commanded speed. driven : 0 = no current. free : 0 = stuck.
    bus : voltage at the ESC now [V].
    imbalance : m_u r_u [kg m].
    """

    x: float
    y: float
    spin: float
    climb: float
    w: Value = 0.0
    phase: Value = 0.0
    acceleration: Value = 0.0
    current: Value = 0.0
    lift: Value = 0.0
    eta_t: Value = 1.0
    eta_q: Value = 1.0
    churn: Value = 1.0
    friction: Value = 1.0
    inertia: Value = 0.0
    slowed: Value = 1.0
    driven: Value = 1.0
    free: Value = 1.0
    imbalance: Value = 0.0


class Plant:
    """One vehicle, or one of a kind in many flights at once.

    Attributes
    ----------
    position, velocity : [m], [m/s] in the world.
    attitude : quaternion (w, x, y, z), body to world; rotation : its matrix, row by row.
    rates, turning : body rates [rad/s] and their derivatives [rad/s²].
    specific_force : of the centre of mass, body axes [m/s²].
    rotors : in order of motor number.
    leg, lever : feet below, IMU from the centre of mass [m]; levered : the IMU is not at it.
    bus : battery voltage under load [V]. used : charge [A h]. battery_current : [A].
    """

    def __init__(self, vehicle: SimVehicle, ops: Arithmetic, zero: Value = 0.0) -> None:
        self.vehicle = vehicle
        self.ops = ops
        self.position = [zero, zero, zero - vehicle.leg]
        self.velocity = [zero, zero, zero]
        self.attitude = [zero + 1.0, zero, zero, zero]
        self.rotation = rotation(self.attitude)
        self.rates = [zero, zero, zero]
        self.turning = [zero, zero, zero]
        self.specific_force = [zero, zero, zero - GRAVITY]
        m = vehicle.motor
        self.rotors = [
            RotorState(
                *rotor.position[:2],
                spin=float(rotor.spin),
                climb=m.inflow / (rotor.radius or 0.1),
                w=zero,
                phase=zero,
                inertia=zero + m.inertia,
            )
            for rotor in vehicle.rotors
        ]
        self.mass = zero + vehicle.mass
        self.inertia = [zero + value for value in vehicle.inertia]
        self.leg: Value = vehicle.leg
        self.lever: tuple[Value, Value, Value] = vehicle.lever
        self.levered = vehicle.lever != CENTRE
        self.thrust_scale = zero + 1.0
        self.bus = zero + vehicle.battery.voltage
        self.used = zero
        self.battery_current = zero
        self._arms: list[tuple[Value, Value, Value]] = [rotor.position for rotor in vehicle.rotors]
        # the ground is out of reach above this height, whatever the attitude
        self._low = -vehicle.leg - max((x * x + y * y) ** 0.5 for x, y, _ in self._arms)
        self._air = 0.5 * AIR_DENSITY * vehicle.drag_area
        # the speed loop: current that holds a goal, per square and per goal, and per speed lacking
        square, hold = m.torque / m.torque_constant, m.inertia * m.bandwidth / m.torque_constant
        self._loop = square, m.friction / m.torque_constant + hold, hold

    def recentre(self, shift: list[Value], mass: Value, inertia: list[Value]) -> None:
        """Move the centre of mass by `shift` [m, body axes]; new mass [kg] and inertia [kg m²]."""
        x, y, z = shift
        for rotor in self.rotors:
            rotor.x, rotor.y = rotor.x - x, rotor.y - y
        self._arms = [(a - x, b - y, c - z) for a, b, c in self._arms]
        a, b, c = self.lever
        self.lever, self.levered = (a - x, b - y, c - z), True
        self.leg = self.leg - z
        p, q, r = self.rates
        turning = (q * z - r * y, r * x - p * z, p * y - q * x)
        rows = [self.rotation[k : k + 3] for k in (0, 3, 6)]
        for k, (r1, r2, r3) in enumerate(rows):
            self.position[k] = self.position[k] + r1 * x + r2 * y + r3 * z
            self.velocity[k] = self.velocity[k] + r1 * turning[0] + r2 * turning[1] + r3 * turning[2]
        self.mass, self.inertia = mass, inertia

    def step(self, dt: float, wanted: list[Value], wind: tuple[Value, Value, Value]) -> None:
        """Advance by `dt` [s] with the rotor speeds `wanted` [rad/s] in a `wind` of the world [m/s]."""
        r11, r12, r13, r21, r22, r23, r31, r32, r33 = self.rotation
        vx, vy, vz = self.velocity
        wx, wy, wz = wind
        ax, ay, az = vx - wx, vy - wy, vz - wz
        u = r11 * ax + r21 * ay + r31 * az
        v = r12 * ax + r22 * ay + r32 * az
        w = r13 * ax + r23 * ay + r33 * az
        lift, roll, pitch, yaw, turn, in_plane = self._turn_rotors(dt, wanted, w)
        speed = self.ops.sqrt(u * u + v * v + w * w)
        held = self._air * speed
        across = -(held + in_plane)
        fx, fy, fz = across * u, across * v, -lift - held * w
        if self.ops.any(self.position[2] > self._low):
            gx, gy, gz, groll, gpitch = self._ground(self.rotation)
            fx, fy, fz, roll, pitch = fx + gx, fy + gy, fz + gz, roll + groll, pitch + gpitch
        share = 1.0 / self.mass
        sx, sy, sz = fx * share, fy * share, fz * share
        self.specific_force = [sx, sy, sz]
        vx = vx + dt * (r11 * sx + r12 * sy + r13 * sz)
        vy = vy + dt * (r21 * sx + r22 * sy + r23 * sz)
        vz = vz + dt * (r31 * sx + r32 * sy + r33 * sz + GRAVITY)
        self.velocity = [vx, vy, vz]
        x, y, z = self.position
        self.position = [x + dt * vx, y + dt * vy, z + dt * vz]
        self._rotate(dt, roll, pitch, yaw, turn)

    def _turn_rotors(self, dt: float, wanted: list[Value], axial: Value) -> tuple[Value, ...]:
        """Advance the rotors; return lift, roll, pitch and yaw moment, angular momentum and in-plane drag."""
        m, bounded, high = self.vehicle.motor, self.ops.bounded, self.ops.maximum
        # constants of the loop below, which runs for every rotor in every step
        kq, torque, wear, resistance = m.torque_constant, m.torque, m.friction, m.resistance
        limit, brake, (square, slope, hold) = m.current_limit, -m.brake_limit, self._loop
        most, back, half, rate = self.bus * (1.0 / resistance), kq / resistance, 0.5 * dt, 1.0 / dt
        thrust = m.thrust * self.thrust_scale
        lift = roll = pitch = yaw = turn = total = drawn = 0.0
        for rotor, goal in zip(self.rotors, wanted, strict=True):
            w, inertia, drag, spin = rotor.w, rotor.inertia, torque * rotor.eta_q, rotor.spin
            goal = goal * rotor.slowed
            # speed loop with the torque that holds the goal, less what volts and ESC can give
            asked = (square * goal + slope) * goal - hold * w
            rotor.current = current = bounded(asked, most - back * w, limit, brake) * rotor.driven
            rise = (kq * current - (drag * w + wear * rotor.friction) * w) / inertia
            rotor.w = now = high(w + dt * rise, 0.0) * rotor.free
            rotor.acceleration = acceleration = (now - w) * rate
            rotor.phase = rotor.phase + half * (w + now)
            rotor.lift = force = high(
                thrust * rotor.eta_t * rotor.churn * now * (now + rotor.climb * axial), 0.0
            )
            lift = lift + force
            roll = roll - rotor.y * force
            pitch = pitch + rotor.x * force
            yaw = yaw + spin * (inertia * acceleration + drag * now * now)
            turn = turn + spin * inertia * now
            total = total + now
            drawn = drawn + current * (resistance * current + kq * now)
        self._discharge(dt, drawn / self.bus)
        # turning counter-clockwise seen from above is about -z: the body's reaction about +z
        return lift, roll, pitch, yaw, -turn, m.drag * total

    def _discharge(self, dt: float, current: Value) -> None:
        b = self.vehicle.battery
        self.battery_current = current
        self.used = self.used + current * dt / 3600.0
        open_circuit = b.voltage - (b.voltage - b.empty_voltage) * self.used / b.capacity
        self.bus = open_circuit - b.resistance * current

    def _ground(self, r: tuple[Value, ...]) -> tuple[Value, ...]:
        """Return the ground's force on the legs, body axes, and its roll and pitch moment."""
        r11, r12, r13, r21, r22, r23, r31, r32, r33 = r
        high, where = self.ops.maximum, self.ops.where
        share = self.mass * GRAVITY / len(self._arms)
        stiffness, damping = share / SINK, 1.4 * share / (SINK * GRAVITY) ** 0.5
        p, q, _ = self.rates
        leg = self.leg
        fx = fy = fz = roll = pitch = 0.0
        for x, y, _ in self._arms:
            depth = self.position[2] + r31 * x + r32 * y + r33 * leg
            falling = self.velocity[2] + r31 * q * leg - r32 * p * leg + r33 * (p * y - q * x)
            touching = depth > 0.0
            up = where(touching, high(stiffness * depth + damping * falling, 0.0), 0.0)
            drag = where(touching, SLIP * self.mass / len(self._arms), 0.0)
            gx, gy, gz = -drag * self.velocity[0], -drag * self.velocity[1], -up
            bx = r11 * gx + r21 * gy + r31 * gz
            by = r12 * gx + r22 * gy + r32 * gz
            bz = r13 * gx + r23 * gy + r33 * gz
            fx, fy, fz = fx + bx, fy + by, fz + bz
            roll = roll + y * bz - leg * by
            pitch = pitch + leg * bx - x * bz
        return fx, fy, fz, roll, pitch

    def _rotate(self, dt: float, roll: Value, pitch: Value, yaw: Value, turn: Value) -> None:
        p, q, r = self.rates
        ix, iy, iz = self.inertia
        hx, hy, hz = ix * p, iy * q, iz * r + turn
        dp = (roll - (q * hz - r * hy)) / ix
        dq = (pitch - (r * hx - p * hz)) / iy
        dr = (yaw - (p * hy - q * hx)) / iz
        self.turning = [dp, dq, dr]
        p, q, r = p + dt * dp, q + dt * dq, r + dt * dr
        self.rates = [p, q, r]
        qw, qx, qy, qz = self.attitude
        half = 0.5 * dt
        nw = qw - half * (qx * p + qy * q + qz * r)
        nx = qx + half * (qw * p + qy * r - qz * q)
        ny = qy + half * (qw * q + qz * p - qx * r)
        nz = qz + half * (qw * r + qx * q - qy * p)
        scale = 1.0 / self.ops.sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
        self.attitude = [nw * scale, nx * scale, ny * scale, nz * scale]
        self.rotation = rotation(self.attitude)


def rotation(attitude: list[Value]) -> tuple[Value, ...]:
    """Return the matrix of a unit quaternion (w, x, y, z), body to world, row by row (9 values)."""
    w, x, y, z = attitude
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz = x * x2, y * y2, z * z2
    xy, xz, yz = x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return (
        *(1.0 - (yy + zz), xy - wz, xz + wy),
        *(xy + wz, 1.0 - (xx + zz), yz - wx),
        *(xz - wy, yz + wx, 1.0 - (xx + yy)),
    )
