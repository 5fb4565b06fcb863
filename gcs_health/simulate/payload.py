"""A load carried rigidly from the start and, if it is to be dropped, let go in flight.

    M = m0 + m,   d = p m / M                      where the common centre of mass lies
    I = I0 + (m0 m / M) (p² - p_i²)                on each axis; the plant knows principal axes alone

m0, I0 : the vehicle's own mass and inertia about its centre of mass; m, p : the load, a point, and its place.
"""

import math
from dataclasses import dataclass

from gcs_health.simulate.plant import Plant


@dataclass(frozen=True, slots=True)
class Payload:
    """A load: mass [kg], position [m, forward right down of the centre of mass], when it is dropped [s of flight]."""

    mass: float = 0.0
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    dropped_at: float = math.inf


class Load:
    """A payload on one plant, or one of a kind in many flights; `take` it before the flight, `drop` it when due."""

    def __init__(self, payload: Payload, plant: Plant) -> None:
        self._plant = plant
        self._own = plant.mass, list(plant.inertia)
        x, y, z = payload.position
        both = plant.mass + payload.mass
        self._shift = [payload.mass / both * one for one in (x, y, z)]
        reduced = plant.mass * payload.mass / both
        away = (y * y + z * z, x * x + z * z, x * x + y * y)
        more = [own + reduced * far for own, far in zip(plant.inertia, away, strict=True)]
        plant.recentre(self._shift, both, more)

    def drop(self) -> None:
        """Let go: the vehicle's own mass, inertia and centre again, at the speed that this point has."""
        self._plant.recentre([-one for one in self._shift], *self._own)
