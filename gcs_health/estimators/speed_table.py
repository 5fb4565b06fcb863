"""What a slowed rotor does to the steady speeds of all, and back: speed deficit to degradation.

    d_i = 1 - share_i / healthy share_i,      share_i = W_i / mean W

A degraded rotor turns at (1 - k) of its command, and the controller answers until lift and moments balance:

    B (L (1 + M u))² = B 1        L = diag(1 - k_i), M = B+, u four controls, speeds over hover speed

Three or four rotors have no freedom left: their steady speeds stay as they were, whatever k, and only the
command shows it. Six have one number, the same for a rotor and its opposite (sheet 4 section 4).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe

Array = NDArray[np.float64]
LEVELS = np.linspace(0.0, 0.9, 10)
LEAST_SLOPE = 0.05  # deficit per degradation below which speeds alone say nothing


@dataclass(frozen=True, slots=True, eq=False)
class SpeedTable:
    """Deficit of a rotor by its degradation, and how far healthy shares are alike.

    Attributes
    ----------
    levels : (l,) degradation. deficit : (n, l); NaN of a rotor of which nothing is known.
    healthy : (n,) shares. between : their standard deviation over vehicles of the kind.
    drift : of one vehicle's share in a flight, as learned. error : of k, from levels not trained on.
    trained : from flights; False = from the geometry alone.
    """

    levels: Array
    deficit: Array
    healthy: Array
    between: float
    drift: float
    error: float
    trained: bool

    def shows(self, rotor: int) -> bool:
        """Whether the speeds alone show this rotor's degradation."""
        return bool(self.slope(rotor, 0.0) > LEAST_SLOPE)

    def degradation(self, rotor: int, deficit: float) -> float:
        """Return k, continued as a line below zero and above the table."""
        d, levels = self.deficit[rotor], self.levels
        if not d[0] < deficit < d[-1]:
            low = deficit <= d[0]
            near, other = (0, 1) if low else (-1, -2)
            rise = max((d[other] - d[near]) / (levels[other] - levels[near]), LEAST_SLOPE)
            return float(levels[near] + (deficit - d[near]) / rise)
        return float(np.interp(deficit, d, levels))

    def slope(self, rotor: int, k: float) -> float:
        """Return the deficit per degradation about k."""
        d = self.deficit[rotor]
        if not np.isfinite(d).all():
            return 0.0
        at = int(np.clip(np.searchsorted(self.levels, k, side="right"), 1, len(self.levels) - 1))
        return float((d[at] - d[at - 1]) / (self.levels[at] - self.levels[at - 1]))


def from_geometry(airframe: Airframe, between: float, drift: float, error: float) -> SpeedTable:
    """Return the table of a vehicle that nobody has trained; all spreads are the caller's."""
    n = len(airframe.rotors)
    deficit = np.full((n, len(LEVELS)), np.nan)
    for i in range(n):
        speeds = steady_speeds(airframe, i, LEVELS)
        shares = speeds / speeds.mean(axis=1, keepdims=True)
        deficit[i] = 1.0 - shares[:, i]
        if not (np.diff(deficit[i]) > 0.0).all():
            deficit[i] = np.nan
    return SpeedTable(LEVELS, deficit, np.ones(n), between, drift, error, trained=False)


def steady_speeds(airframe: Airframe, rotor: int, levels: Array) -> Array:
    """Return (levels, n): speeds over hover speed in which the vehicle is again at rest.

    Newton's method from level to level; NaN from where the controls no longer reach.
    """
    x, y = (np.array([r.position[axis] for r in airframe.rotors]) for axis in (0, 1))
    reach = max(float(np.hypot(x, y).max()), 1e-9)
    spin = np.array([float(r.spin) for r in airframe.rotors])
    B = np.stack([np.ones(len(x)), -y / reach, x / reach, spin])
    M = np.linalg.pinv(B, rcond=1e-6)
    u, out = np.zeros(4), np.full((len(levels), len(x)), np.nan)
    left = np.ones(len(x))
    for row, k in enumerate(levels):
        left[rotor] = 1.0 - k
        for _ in range(30):
            speeds = left * (1.0 + M @ u)
            rest = B @ speeds**2 - B.sum(axis=1)
            u = u - np.linalg.pinv(B @ (2.0 * (speeds * left)[:, None] * M), rcond=1e-9) @ rest
        speeds = left * (1.0 + M @ u)
        if not (np.abs(B @ speeds**2 - B.sum(axis=1)).max() < 1e-6 and (speeds >= 0.0).all()):
            break
        out[row] = speeds
    return out


def lookalikes(airframe: Airframe) -> tuple[tuple[int, ...], ...]:
    """Return of each rotor those that steady flight cannot tell from it: itself, its arm's, its opposites."""
    places = [(r.position[0], r.position[1]) for r in airframe.rotors]
    near = 0.2 * max(math.hypot(x, y) for x, y in places)
    return tuple(
        tuple(
            j
            for j, (a, b) in enumerate(places)
            if math.hypot(a - x, b - y) < near or math.hypot(a + x, b + y) < near
        )
        for x, y in places
    )
