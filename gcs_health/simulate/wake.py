"""A vehicle that sinks into its own downwash: each rotor loses thrust, unsteadily and on its own.

    v_h = sqrt(m g / (2 rho A)),   A all discs          induced velocity in hover
    b   = max(0, 1 - |s - 1| / .7) / (1 + (u / v_h)²)²   s = sinking through the air / v_h, u = speed across
    factor on thrust = 1 - wake b (1 + n(t))            n: unit variance, 1 / (1 + T s), T = .2 s

The shape is the vortex ring state's as textbooks draw it: between some .3 and 1.7 of v_h, worst near v_h, gone with
forward speed. The size is the scenario's own: no measured model of small propellers stands behind it.
"""

import math

import numpy as np

from gcs_health.gate import GRAVITY
from gcs_health.simulate.arithmetic import Arithmetic, Value
from gcs_health.simulate.plant import AIR_DENSITY, Plant
from gcs_health.simulate.sensors import Noise

REACH, MEMORY = 0.7, 0.2  # of v_h on both sides of the worst, s
USUAL_RADIUS = 0.1  # m, where the vehicle file has none


class Wake:
    """Sets every rotor's `churn`; `strength` = mean loss and standard deviation at the worst, shares of thrust."""

    def __init__(
        self, strength: float, plant: Plant, ops: Arithmetic, rngs: list[np.random.Generator], step: float
    ) -> None:
        self._strength, self._plant, self._ops = strength, plant, ops
        area = sum(math.pi * (rotor.radius or USUAL_RADIUS) ** 2 for rotor in plant.vehicle.rotors)
        self._induced = ops.sqrt(plant.mass * GRAVITY / (2.0 * AIR_DENSITY * area))
        self._keep = math.exp(-step / MEMORY)
        count = len(plant.rotors)
        self._noise = Noise(rngs, [math.sqrt(1.0 - self._keep**2)] * count)
        self._state: list[Value] = [0.0] * count

    def step(self, wind: tuple[Value, Value, Value]) -> None:
        """Advance by `step` [s] in a `wind` of the world [m/s]."""
        bump = self._strength * self._depth(wind)
        for k, (rotor, chance) in enumerate(zip(self._plant.rotors, self._noise(), strict=True)):
            self._state[k] = now = self._keep * self._state[k] + chance
            rotor.churn = self._ops.maximum(1.0 - bump * (1.0 + now), 0.0)

    def _depth(self, wind: tuple[Value, Value, Value]) -> Value:
        """Return how deep in the ring state it is, 0 .. 1."""
        r11, r12, r13, r21, r22, r23, r31, r32, r33 = self._plant.rotation
        ax, ay, az = (speed - air for speed, air in zip(self._plant.velocity, wind, strict=True))
        u = (r11 * ax + r21 * ay + r31 * az) / self._induced
        v = (r12 * ax + r22 * ay + r32 * az) / self._induced
        sinking = (r13 * ax + r23 * ay + r33 * az) / self._induced
        near = self._ops.maximum(1.0 - abs(sinking - 1.0) / REACH, 0.0)
        across = 1.0 + u * u + v * v
        return near / (across * across)
