"""Motor and propeller constants from what flies: appendix C of the thesis, from a staircase and from flight.

*Staircase* (the thesis): without propeller kappa_q i = kappa_f w gives the friction, with it
kappa_tau w² = kappa_q i - kappa_f w the drag of each step, and the transients between steps the inertia.

*Flight*: the same equation over intervals, i = a w² + f w + c w', all three at once by least squares with
priors. Drag and friction separate only as far as speed spreads, det sum [w^4 w^3; w^3 w^2]: an idle on
the ground does it, hover does not, so friction keeps near its prior unless something speaks against it.
The noise of w' would bias c low: its power is subtracted.

Everything is in amperes (see `torque_balance`): times kappa_q it is SI.

Source: Melczer (2019), appendix C; sheet 3, recommended mode, steps 7 and 8.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from operator import mul
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.estimators.torque_balance import Constants

Array = NDArray[np.floating[Any]]
UNIT = 500.0  # rad/s, only to keep the normal equations' entries alike
SCALE = np.array([[UNIT**-2], [1.0 / UNIT], [1.0 / UNIT], [1.0], [1.0], [1.0]])  # of an interval's figures


@dataclass(frozen=True, slots=True)
class IdentificationConfig:
    """Priors and memory; sheet 3 unless said otherwise."""

    memory: float = 120.0  # s; the sheet's 30 s follow the wind too much for the drag
    known_drag: float = 0.10  # prior spread of a, where the vehicle file gives one; this project
    known_friction: float = 0.20  # likewise f
    inertia: float = 0.5  # prior spread of c
    inertia_range: tuple[float, float] = (0.4, 2.5)  # of the prior, kept within; this project
    usual_friction: float = 0.06  # of the drag's current at the flight's level, where nothing is known
    usual_inertia: float = 0.2  # s: J / (kappa_tau w) at the flight's level, likewise; this project
    share: float = 0.5  # of an interval's information that counts: errors of neighbours are alike
    fastest: float = 0.03  # s; longer intervals of snapshots bias the inertia, it keeps its prior


class Identified(NamedTuple):
    """Constants in amperes with their standard deviations; `separable` 0..1: drag from friction."""

    a: float  # [A s²]
    f: float  # [A s]
    c: float  # [A s²]
    a_std: float
    f_std: float
    c_std: float
    separable: float

    @property
    def constants(self) -> Constants:
        """The three constants."""
        return Constants(self.a, self.f, self.c)


class FlightIdentification:
    """Least squares with forgetting for one rotor."""

    def __init__(self, prior: Constants, config: IdentificationConfig) -> None:
        self.config = config
        self.prior = prior
        self._sums = np.zeros((3, 4))  # of w², w, w' over the same and the current
        self.time = 0.0  # of the intervals taken in [s]

    def take(self, rows: list[tuple[float, ...]], speed_variance: float, inertia: bool) -> None:
        """Take intervals: mean w², mean w, w', mean i, variance of the balance [A²], length [s].

        `speed_variance` [(rad/s)²] of one sample; `inertia` = the intervals may teach the inertia.
        """
        table = np.array(rows).T * SCALE  # w², w, w' in their units
        if not inertia:
            table = table[:, np.abs(table[2]) < 0.3 * table[1]]
            table[2] = 0.0
        noise, dt = table[4], table[5]
        weight = self.config.share / noise
        span = float(dt.sum())
        keep = math.exp(-span / self.config.memory)
        products = (weight * table[:3]) @ table[:4].T  # over w², w, w' and the current
        if inertia:
            noise_power = 2.0 * speed_variance / UNIT**2 * float((weight / (dt * dt)).sum())
            # where nothing accelerates all is noise: never take off more than half, or c runs away
            products[2, 2] -= min(noise_power, 0.5 * float(products[2, 2]))
        self._sums = keep * self._sums + products
        self.time += span

    def solve(self, level: float) -> Identified | None:
        """Return the constants; `level` [rad/s] is the flight's usual speed. None without data."""
        c = self.config
        xx = self._sums.tolist()
        xy = [row.pop() for row in xx]
        if not (xx[0][0] > 0.0 and xy[0] > 0.0 and level > 0.0):
            return None
        separable = 1.0 - xx[0][1] ** 2 / max(xx[0][0] * xx[1][1], 1e-12)
        crude = xy[0] / xx[0][0]  # of the drag, friction and all
        given = [self.prior.a * UNIT**2, self.prior.f * UNIT, self.prior.c * UNIT]
        for k, spread in enumerate((c.known_drag, c.known_friction, c.inertia)):
            if given[k] > 0.0:
                xx[k][k] += (spread * given[k]) ** -2
                xy[k] += given[k] * (spread * given[k]) ** -2
        ratio = level / UNIT
        for k, usual in ((1, c.usual_friction * ratio), (2, c.usual_inertia * ratio)):
            if not given[k] > 0.0:  # theta_k = usual theta_0, as sure as it is large
                sure = (usual * crude) ** -2
                xx[0][0] += usual * usual * sure
                xx[k][k] += sure
                xx[0][k] -= usual * sure
                xx[k][0] = xx[0][k]
        covariance = _inverse(xx)
        if covariance is None:
            return None
        theta = [sum(map(mul, row, xy)) for row in covariance]
        # least current that a constant may stand for: no negative friction or inertia
        theta = list(map(max, theta, (0.3 * crude, 0.0, 0.0)))
        if given[2] > 0.0:
            low, high = c.inertia_range
            theta[2] = min(max(theta[2], low * given[2]), high * given[2])
        sa, sf, sc = (math.sqrt(covariance[k][k]) for k in range(3))
        return Identified(
            theta[0] / UNIT**2,
            theta[1] / UNIT,
            theta[2] / UNIT,
            sa / UNIT**2,
            sf / UNIT,
            sc / UNIT,
            separable,
        )


def _inverse(m: list[list[float]]) -> list[list[float]] | None:
    """Return the inverse of a symmetric (3, 3) matrix by its Cholesky factor; None if it is not positive definite."""
    (a, b, c), (_, d, e), (_, _, f) = m
    if not a > 0.0:
        return None
    p, q = b / a, c / a
    d -= b * p
    if not d > 0.0:
        return None
    e -= c * p
    r = e / d
    f -= c * q + e * r
    if not f > 0.0:
        return None
    # M = L D L', so that M^-1 = L^-T D^-1 L^-1 with L^-1 = [1; -p 1; s -r 1]
    s = p * r - q
    ab, ac, bc = -p / d - s * r / f, s / f, -r / f
    return [[1.0 / a + p * p / d + s * s / f, ab, ac], [ab, 1.0 / d + r * r / f, bc], [ac, bc, 1.0 / f]]


class Staircase(NamedTuple):
    """What appendix C reads off a staircase; SI."""

    speed: Array  # (k,) steady speed of each step with propeller [rad/s]
    torque: Array  # (k,) kappa_tau of each step [N m s²]
    friction: float  # kappa_f [N m s]
    inertia: Array  # (k-1,) J of each transient [kg m²]
    schedule: tuple[float, float]  # kappa_tau = first + second w


def staircase(
    bare: tuple[Array, Array, Array],
    loaded: tuple[Array, Array, Array],
    edges: Array,
    torque_constant: float,
    settle: float = 1.0,
) -> Staircase:
    """Identify one motor by the thesis's staircase.

    Parameters
    ----------
    bare, loaded : time [s], speed [rad/s] and current [A] without and with the propeller.
    edges : (k+1,) times at which a step begins, and the end [s]; the same for both.
    torque_constant : kappa_q [N m/A].
    settle : s after an edge before a step counts as steady.

    Source: Melczer (2019), appendix C; Table 1.
    """
    t, w, i = bare
    steady = np.zeros(len(t), dtype=bool)
    for low, high in pairwise(edges):
        steady |= (t >= low + settle) & (t < high)
    friction = float(w[steady] @ (torque_constant * i[steady]) / (w[steady] @ w[steady]))
    t, w, i = loaded
    speeds, torques = [], []
    for low, high in pairwise(edges):
        step = (t >= low + settle) & (t < high)
        rest = torque_constant * i[step] - friction * w[step]
        squares = w[step] ** 2
        speeds.append(float(w[step].mean()))
        torques.append(float(squares @ rest / (squares @ squares)))
    rise = np.gradient(w, t)
    inertias = []
    schedule = np.polyfit(speeds, torques, 1)
    for low in edges[1:-1]:
        step = (t >= low) & (t < low + 0.5 * settle)
        drag = np.polyval(schedule, w[step]) * w[step] ** 2
        rest = torque_constant * i[step] - drag - friction * w[step]
        inertias.append(float(rise[step] @ rest / (rise[step] @ rise[step])))
    line = (float(schedule[1]), float(schedule[0]))
    return Staircase(np.array(speeds), np.array(torques), friction, np.array(inertias), line)
