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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.estimators.torque_balance import Constants

Array = NDArray[np.floating[Any]]
UNIT = 500.0  # rad/s, only to keep the normal equations' entries alike


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
        self._xx = np.zeros((3, 3))
        self._xy = np.zeros(3)
        self.time = 0.0  # of the intervals taken in [s]

    def take(self, rows: list[tuple[float, ...]], speed_variance: float, inertia: bool) -> None:
        """Take intervals: mean w², mean w, w', mean i, variance of the balance [A²], length [s].

        `speed_variance` [(rad/s)²] of one sample; `inertia` = the intervals may teach the inertia.
        """
        squares, turning, rise, current, noise, dt = np.array(rows).T
        x = np.stack([squares / UNIT**2, turning / UNIT, rise / UNIT], axis=1)
        y = current
        if not inertia:
            calm = np.abs(x[:, 2]) < 0.3 * x[:, 1]
            x, y, noise, dt = x[calm] * np.array([1.0, 1.0, 0.0]), y[calm], noise[calm], dt[calm]
        weight = self.config.share / noise
        span = float(dt.sum())
        keep = math.exp(-span / self.config.memory)
        xx = x.T @ (weight[:, None] * x)
        if inertia:
            noise_power = float((weight * 2.0 * speed_variance / (dt * UNIT) ** 2).sum())
            # where nothing accelerates all is noise: never take off more than half, or c runs away
            xx[2, 2] -= min(noise_power, 0.5 * float(xx[2, 2]))
        self._xx = keep * self._xx + xx
        self._xy = keep * self._xy + x.T @ (weight * y)
        self.time += span

    def solve(self, level: float) -> Identified | None:
        """Return the constants; `level` [rad/s] is the flight's usual speed. None without data."""
        c = self.config
        xx, xy = self._xx.copy(), self._xy.copy()
        if not (xx[0, 0] > 0.0 and xy[0] > 0.0 and level > 0.0):
            return None
        crude = float(xy[0] / xx[0, 0])  # of the drag, friction and all
        scale = np.array([UNIT**2, UNIT, UNIT])
        given = np.array([self.prior.a, self.prior.f, self.prior.c]) * scale
        spread = np.array([c.known_drag, c.known_friction, c.inertia]) * np.abs(given)
        for k in range(3):
            if given[k] > 0.0:
                xx[k, k] += spread[k] ** -2
                xy[k] += given[k] * spread[k] ** -2
        ratio = level / UNIT
        for k, usual in ((1, c.usual_friction * ratio), (2, c.usual_inertia * ratio)):
            if not given[k] > 0.0:  # theta_k = usual theta_0, as sure as it is large
                line = np.zeros(3)
                line[0], line[k] = -usual, 1.0
                xx += np.outer(line, line) * (usual * crude) ** -2
        if np.linalg.eigvalsh(xx)[0] <= 0.0:
            return None
        theta = np.linalg.solve(xx, xy)
        # least current that a constant may stand for: no negative friction or inertia
        theta = np.maximum(theta, [0.3 * crude, 0.0, 0.0])
        if given[2] > 0.0:
            low, high = c.inertia_range
            theta[2] = min(max(theta[2], low * given[2]), high * given[2])
        covariance = np.linalg.inv(xx)
        std = np.sqrt(np.diag(covariance))
        data = self._xx
        separable = 1.0 - data[0, 1] ** 2 / max(data[0, 0] * data[1, 1], 1e-12)
        a, f, inertia = (float(value) for value in theta / scale)
        sa, sf, sc = (float(value) for value in std / scale)
        return Identified(a, f, inertia, sa, sf, sc, float(separable))


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
