"""A small multirotor that flies by itself: readings for tests, from the model plus noise.

Rates follow the rotors' moments through a rate loop, motors lag by 25 ms, the vehicle takes off at 1 s,
hovers and answers random rate commands. No aerodynamics: what tests want is a known truth.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from gcs_health.airframe import Airframe, AirframeSource, Effectiveness, Motor, Rotor
from gcs_health.samples import FlightReading, ImuFilterReading, ImuReading, Reading, RotorReading

GRAVITY = 9.80665
HOVER = 600.0  # rad/s
MASS, RADIUS = 1.5, 0.13  # kg, m
MOTOR = Motor(
    torque_constant=0.01, torque=3e-7, friction=1e-5, inertia=4e-5, resistance=0.1, current_side="motor"
)
VOLTS = 12.0


def airframe(rotors: int, coaxial: bool = False, known: bool = True) -> Airframe:
    """Return a regular multirotor of `rotors`, arms .3 m; coaxial = pairs on half as many arms."""
    arms = rotors // 2 if coaxial else rotors
    made = []
    for i in range(rotors):
        arm = i % arms
        angle = 2.0 * math.pi * (arm + 0.5) / arms
        spin = 1 if (arm + (i // arms if coaxial else 0)) % 2 else -1
        made.append(Rotor(i + 1, i, (0.3 * math.cos(angle), 0.3 * math.sin(angle), 0.0), spin, RADIUS))
    thrust = GRAVITY / rotors / HOVER**2
    gains = Effectiveness(
        roll=160.0 / rotors / HOVER**2,
        pitch=160.0 / rotors / HOVER**2,
        yaw=12.0 / rotors / HOVER**2 if rotors > 3 else None,  # three rotors cannot hold their yaw
        thrust=thrust,
    )
    return Airframe(
        f"synthetic {rotors}",
        tuple(made),
        AirframeSource.FILE,
        mass=MASS,
        motor=MOTOR if known else Motor(),
        effectiveness=gains if known else Effectiveness(),
    )


def columns(craft: Airframe) -> np.ndarray:
    """Return the (4, n) model of the craft's own gains: roll, pitch, yaw, a_z per squared speed."""
    gains = (
        airframe(len(craft.rotors)).effectiveness if craft.effectiveness.roll is None else craft.effectiveness
    )
    x = np.array([rotor.position[0] for rotor in craft.rotors])
    y = np.array([rotor.position[1] for rotor in craft.rotors])
    spin = np.array([rotor.spin for rotor in craft.rotors], dtype=float)
    return np.array(
        [
            -gains.roll * y / abs(y).max(),
            gains.pitch * x / abs(x).max(),
            (gains.yaw or 0.0) * spin,
            np.full(len(x), -gains.thrust),
        ]
    )


@dataclass(frozen=True)
class Scenario:
    """What happens; times in s, rotors from 0."""

    rotors: int = 4
    coaxial: bool = False
    duration: float = 10.0
    imu_hz: float = 250.0
    esc_hz: float = 125.0
    lost: int | None = None  # loses its propeller at `at` ...
    left: float = 0.0  # ... but for this share of its thrust
    stopped: int | None = None  # its motor stops at `at`
    at: float = 7.0
    seed: int = 1
    jitter: float = 0.0  # share of the step
    loop: float = 0.002  # s
    craft: Airframe | None = None
    noise: tuple[float, float] = (0.01, 0.4)  # rad/s, m/s²
    silent: tuple[int, ...] = field(default=())  # rotors without telemetry
    unbalance: tuple[float, ...] = ()  # m_u r_u of each rotor [kg m]


def fly(scenario: Scenario) -> Iterator[Reading]:
    """Yield readings in order of time; IMU before rotor speeds of the same time."""
    s = scenario
    craft = s.craft or airframe(s.rotors, s.coaxial)
    n = len(craft.rotors)
    rng = np.random.default_rng(s.seed)
    G = columns(craft)
    inverse = np.linalg.pinv(G, rcond=1e-9)
    rate = np.zeros(3)
    wanted = np.zeros(3)
    speed = np.zeros(n)
    healthy = np.ones(n)
    next_imu = next_esc = 0.0
    volts = (VOLTS,) * n
    other = np.random.default_rng(s.seed + 10_000)  # what came later leaves the flight as it was
    phase = other.uniform(0.0, 2.0 * math.pi, n)
    spin = np.array([rotor.spin for rotor in craft.rotors])
    uneven = np.array(s.unbalance or (0.0,) * n) / MASS
    before = speed.copy()
    yield FlightReading(0.0, True, True)
    yield ImuFilterReading(0.0, float("nan"), float("nan"), "none, by definition")
    for k in range(round(s.duration / s.loop)):
        t = k * s.loop
        if k % round(0.4 / s.loop) == 0:
            wanted = rng.normal(0.0, (0.5, 0.5, 0.2))
        if t >= s.at and s.lost is not None:
            healthy[s.lost] = s.left
        flying = t > 1.0
        lift = -GRAVITY * (1.0 + 0.05 * math.sin(3.0 * t))
        command = inverse @ np.array([*(12.0 * (wanted - rate)), lift]) if flying else np.full(n, 1e4)
        target = np.sqrt(np.clip(command, (0.15 * HOVER) ** 2, (1.6 * HOVER) ** 2))
        if t >= s.at and s.stopped is not None:
            target[s.stopped] = 0.0
        speed += (target - speed) * min(1.0, s.loop / 0.025)
        if s.stopped is not None and t >= s.at and speed[s.stopped] < 60.0:
            speed[s.stopped] = 0.0
        phase += speed * s.loop
        push = G @ (healthy * speed**2)
        az = push[3] if flying else -GRAVITY
        if flying:
            rate = rate + s.loop * (push[:3] + rng.normal(0.0, 3.0, 3))
        if t >= next_imu:
            next_imu += (1.0 / s.imu_hz) * (1.0 + s.jitter * rng.uniform(-1.0, 1.0))
            p, q, r = rate + rng.normal(0.0, s.noise[0], 3)
            ax, ay, dz = rng.normal(0.0, s.noise[1], 3)
            # a force that turns with its rotor: clockwise from above is positive about z down
            ax += float(np.sum(uneven * speed**2 * np.cos(phase)))
            ay -= float(np.sum(uneven * speed**2 * spin * np.sin(phase)))
            yield ImuReading(t, *map(float, (ax, ay, az + dz, p, q, r)))
        if t >= next_esc:
            next_esc += 1.0 / s.esc_hz
            seen = [
                float("nan") if i in s.silent else max(0.0, w + rng.normal(0.0, 1.0)) if w else 0.0
                for i, w in enumerate(speed)
            ]
            torque = MOTOR.torque * healthy * speed**2 + MOTOR.friction * speed
            torque += MOTOR.inertia * (speed - before) / s.loop
            current = torque / MOTOR.torque_constant + other.normal(0.0, 0.1, n)
            amps = [float("nan") if i in s.silent else i_ for i, i_ in enumerate(map(float, current))]
            yield RotorReading(t, tuple(map(float, seen)), tuple(amps), volts)
        before = speed.copy()
