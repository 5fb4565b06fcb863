"""Where the vehicle is asked to be: arm, take off, fly one of six ways, land."""

import math
from dataclasses import dataclass

import numpy as np

from gcs_health.simulate.arithmetic import Value

KINDS = ("hover", "random", "circle", "aggressive", "forward", "descents")
PATHS = ("circle", "forward")  # whose goal moves; the others' holds for a while
ARM, CLIMB, CLIMB_RATE, SINK_RATE = 0.5, 2.0, 1.5, 0.8  # s, s, m/s, m/s
PATH_ACCELERATION = 3.0  # m/s², gathering and losing speed along circle and straight


@dataclass(slots=True)
class Goal:
    """One moment's goal, world axes [m, m/s]; `tilt` = largest tangent of the lean."""

    x: Value
    y: Value
    z: Value
    vx: Value = 0.0
    vy: Value = 0.0
    vz: Value = 0.0
    speed: float = 2.0
    tilt: float = 0.6
    idle: bool = False
    off: bool = False


@dataclass(frozen=True, slots=True)
class Trajectory:
    """What a scenario says of the flight.

    kind : one of `KINDS`. height [m]; speed [m/s] of circle, forward flight, climbs and descents; radius [m] of
    the circle; every [s] between new goals; lands : the last seconds are a landing. duration [s].
    """

    kind: str = "hover"
    height: float = 15.0
    speed: float = 1.0
    radius: float = 1.0
    every: float = 2.0
    lands: bool = True
    duration: float = 60.0

    @property
    def flying_from(self) -> float:
        """When the height is reached [s]."""
        return CLIMB + self.height / CLIMB_RATE

    @property
    def landing_from(self) -> float:
        """When the descent begins [s]; never, if it does not land."""
        return self.duration - self.height / SINK_RATE - 3.0 if self.lands else math.inf


class Pilot:
    """Gives the goal at each time of one flight, or of many side by side."""

    def __init__(self, plan: Trajectory, rngs: list[np.random.Generator]) -> None:
        self.plan = plan
        count = math.ceil(plan.duration / plan.every) + 1
        reach = {"random": (3.0, 3.0, 1.5), "aggressive": (8.0, 8.0, 4.0)}.get(plan.kind, (0.0, 0.0, 0.0))
        points = np.stack([rng.uniform(-1.0, 1.0, (count, 3)) for rng in rngs], axis=2)
        points *= np.array(reach)[:, None]
        self._flying_from, self._landing_from = plan.flying_from, plan.landing_from
        self._leg, self._held = -1, Goal(0.0, 0.0, 0.0)  # the goal that holds until the next, and its number
        # floats for one flight: numpy scalars would slow every formula after
        self._points = points if len(rngs) > 1 else points[:, :, 0].tolist()

    def goal(self, t: float) -> Goal:
        """Return the goal at flight time t [s]."""
        p = self.plan
        if t < CLIMB:
            return Goal(0.0, 0.0, 0.0, idle=True, off=t < ARM)
        if t < self._flying_from:
            climbed = CLIMB_RATE * (t - CLIMB)
            return Goal(0.0, 0.0, -climbed, vz=-CLIMB_RATE)
        if t < self._landing_from:
            leg = int((t - self._flying_from) / p.every)
            if leg != self._leg or p.kind in PATHS:
                self._leg, self._held = leg, self._cruise(t)
            return self._held
        x, y, *_ = self._along(self._landing_from)
        sunk = SINK_RATE * (t - self._landing_from)
        # below the ground: the legs find it, and the loops then ask for less than hover
        down = min(sunk - p.height, 0.5)
        over = sunk > p.height + 1.0
        return Goal(x, y, down, vz=SINK_RATE, idle=over, off=sunk > p.height + 1.6)

    def _cruise(self, t: float) -> Goal:
        p, wild = self.plan, self.plan.kind == "aggressive"
        x, y, z, vx, vy = self._along(t)
        fast = 8.0 if wild else max(2.0, p.speed)
        return Goal(x, y, z - p.height, vx, vy, speed=fast, tilt=1.2 if wild else 0.6)

    def _travelled(self, since: float) -> tuple[float, float]:
        """Return path [m] and speed [m/s]: it stands at both ends, as pilots and autopilots fly.

        A goal that jumps to its speed, or stops dead, asks a jerk that no autopilot's trajectory asks.
        """
        p = self.plan
        whole = p.landing_from - p.flying_from
        ramp = min(p.speed / PATH_ACCELERATION, 0.5 * whole)
        gathering = min(since, ramp)
        braking = max(since - (whole - ramp), 0.0)
        cruising = max(since - ramp - braking, 0.0)
        top = PATH_ACCELERATION * ramp
        path = 0.5 * PATH_ACCELERATION * (gathering**2 - braking**2) + top * (cruising + braking)
        return path, PATH_ACCELERATION * (gathering - braking)

    def _along(self, t: float) -> tuple[Value, Value, Value, Value, Value]:
        p = self.plan
        since = t - p.flying_from
        if p.kind == "circle":
            path, speed = self._travelled(since)
            s, c = math.sin(path / p.radius), math.cos(path / p.radius)
            return p.radius * s, p.radius * (1.0 - c), 0.0, speed * c, speed * s
        if p.kind == "forward":
            path, speed = self._travelled(since)
            return path, 0.0, 0.0, speed, 0.0
        if p.kind == "hover":
            return 0.0, 0.0, 0.0, 0.0, 0.0
        if p.kind == "descents":  # down to a third of the height, and up again
            return 0.0, 0.0, 2.0 / 3.0 * p.height * (int(since / p.every) % 2), 0.0, 0.0
        x, y, z = self._points[int(since / p.every)]
        return x, y, z, 0.0, 0.0
