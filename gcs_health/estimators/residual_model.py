"""One tick under "all rotors healthy": what is left over, and what each rotor would explain of it.

Rows 0 roll, 1 pitch, 2 yaw acceleration, 3 vertical specific force; n rotors.

    u      = w²                           at the ticks; over a tick it is taken to move linearly, whose
                                          mean is the exact partner of a rate step. a_z takes u at its end
    h      = G u                          (4, n), signed
    e      = y - sum h_i                  (rotor acceleration taken off the yaw row)
    M      = sum h_i² (.02 + .5 |du_i| / u_i)²     what the thrust law and timing may be wrong by
             + (s sum h_i)²               roll, pitch: what gains not yet learned may be wrong by, all rotors
                                          alike; s is their relative standard deviation, 0 if given

The share of |du| in M is twice sheet 1's: it stands for some 4 ms by which rotor speeds and IMU may be
apart unknown to anyone; with half of it the healthy flights alarm when their stamps are moved.

`push` runs once a tick, in plain floats, which for so few rotors is faster than numpy; all else that is
worked out with every tick does not depend on the number of rotors. `contributions` runs only when somebody
wants to know, over all the ticks gathered until then.

Source: sheet 1 section 7, steps 1, 3 and 4.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from operator import mul
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.calibration.control_effectiveness import ControlEffectiveness
from gcs_health.estimators.ticks import Tick
from gcs_health.samples import new_tuple

Array = NDArray[np.float64]


class Push(NamedTuple):
    """What the rotors do together at one moment, all healthy."""

    speeds: Sequence[float]  # (n,) [rad/s]
    roll: float  # [rad/s²]
    pitch: float
    yaw: float
    lift: float  # upward specific force [m/s²]
    spun: float  # yaw rate that the rotors' spin takes from the body [rad/s]


class Step(NamedTuple):
    """From one tick to the next: what was measured."""

    t: float  # of the later tick [s]
    dt: float  # [s]
    roll: float  # angular acceleration [rad/s²]
    pitch: float
    yaw: float
    az: float  # specific force at the later tick [m/s²]
    inflation: float  # of the residual's variance, by the vehicle's motion [-]


class Evidence(NamedTuple):
    """One step's residual against its baseline, as the fault bank takes it."""

    e: tuple[float, float, float, float]  # raw residual; 0 in a row not used
    offset: list[float]  # (4,) its baseline
    variances: list[float]  # (4,) of it, before inflation and without the model error
    inflation: float
    w0: Sequence[float]  # (n,) rotor speeds at the beginning [rad/s]
    w1: Sequence[float]  # and at the end
    matrix: Array  # (4, n) gains G at that time
    doubt: tuple[float, float] = (0.0, 0.0)  # relative standard deviations of roll and pitch gains
    bend: float = 0.0  # share per relative change of u: what a straight line between speeds may miss


def push(speeds: Sequence[float], gains: ControlEffectiveness) -> Push:
    """Return what healthy rotors do at these speeds (n,) [rad/s]."""
    squares = list(map(mul, speeds, speeds))
    yaw = spun = 0.0
    if gains.has_yaw:
        yaw = sum(map(mul, gains.yaw, squares))
        spun = gains.yaw_inertia * sum(map(mul, gains.spin, speeds))
    roll, pitch = sum(map(mul, gains.roll, squares)), sum(map(mul, gains.pitch, squares))
    return new_tuple(Push, (speeds, roll, pitch, yaw, gains.thrust * sum(squares), spun))


def step_between(before: Tick, tick: Tick, dt: float, inflation: float) -> Step:
    """Return the step from one tick to the next, `dt` [s] apart."""
    _, _, _, _, p0, q0, r0 = before
    t, _, _, az, p, q, r = tick
    return new_tuple(Step, (t, dt, (p - p0) / dt, (q - q0) / dt, (r - r0) / dt, az, inflation))


def residual(step: Step, before: Push, now: Push, has_yaw: bool) -> tuple[float, float, float, float]:
    """Return what the rotors, pushing so at both ends of the step, do not explain of it (4,)."""
    turn = 0.0
    if has_yaw:
        turn = step.yaw - (now.spun - before.spun) / step.dt - 0.5 * (before.yaw + now.yaw)
    return (
        step.roll - 0.5 * (before.roll + now.roll),
        step.pitch - 0.5 * (before.pitch + now.pitch),
        turn,
        step.az + now.lift,
    )


def calm(tick: Evidence, limit: float) -> bool:
    """Whether no row is further from its baseline than sqrt(limit) sigmas: by itself it accuses nobody."""
    e, offset, variances, inflation = tick[:4]
    limit *= inflation
    d = e[0] - offset[0]
    if d * d > limit * variances[0]:
        return False
    d = e[1] - offset[1]
    if d * d > limit * variances[1]:
        return False
    d = e[2] - offset[2]
    if d * d > limit * variances[2]:
        return False
    d = e[3] - offset[3]
    return d * d <= limit * variances[3]


def contributions(ticks: Sequence[Evidence], error: tuple[float, float]) -> Array:
    """Return (k, 2n + 5) rows [n_1 .. n_n, d_1 .. d_n, q, then n and d of roll's and pitch's gains] of k ticks.

    `error` = (share, share per relative change of u) of a rotor's contribution that may be wrong.
    """
    n = len(ticks[0].w0)
    _, _, h, r, weight = _parts(ticks, error)
    net = np.add.reduce(h[:, :2], axis=2)
    weighted = r * weight
    out = np.empty((len(ticks), 2 * n + 5))
    out[:, :n] = -np.add.reduce(weighted[:, :, None] * h, axis=1)
    out[:, n : 2 * n] = np.add.reduce(weight[:, :, None] * (h * h), axis=1)
    out[:, 2 * n] = np.add.reduce(weighted * r, axis=1)
    out[:, 2 * n + 1 : 2 * n + 3] = weighted[:, :2] * net
    out[:, 2 * n + 3 :] = weight[:, :2] * net * net
    return out


def exchange(ticks: Sequence[Evidence], error: tuple[float, float], most: float, cost: Array) -> float:
    """Return the log likelihood ratio of "no rotor, but two sit in each other's seats" of the best pair.

    With seats i and j exchanged the residual is  m (g_j - g_i) (u_i - u_j),  g the seats' gains, m in 0 .. `most`
    for gains that are not learned. `cost` (pairs,) : what the flight before says against each.
    """
    matrix, mean, _, r, weight = _parts(ticks, error)
    one, other = np.triu_indices(mean.shape[1], 1)
    d = (matrix[:, :, other] - matrix[:, :, one]) * (mean[:, one] - mean[:, other])[:, None, :]
    N = np.add.reduce((r * weight)[:, :, None] * d, axis=(0, 1))
    D = np.add.reduce(weight[:, :, None] * (d * d), axis=(0, 1))
    m = np.minimum(np.maximum(N / (D + 1e-12), 0.0), most)
    return float(np.maximum.reduce(m * (N - 0.5 * m * D) - cost))


def _parts(ticks: Sequence[Evidence], error: tuple[float, float]) -> tuple[Array, Array, Array, Array, Array]:
    """Return gains (k or 1, 4, n), mean squared speeds (k, n), pushes (k, 4, n), residuals and weights (k, 4)."""
    n = len(ticks[0].w0)
    given = [(*e, *b, *v, *s, up, bend, *w0, *w1) for e, b, v, up, w0, w1, _, s, bend in ticks]
    table = rows(given, 16 + 2 * n)
    e, offset, variances, doubt = table[:, :4], table[:, 4:8], table[:, 8:12], table[:, 12:14]
    inflation, bend, w0, w1 = table[:, 14:15], table[:, 15:16], table[:, 16 : 16 + n], table[:, 16 + n :]
    # gains change seldom: mostly all ticks have the same
    first = ticks[0].matrix
    same = all([tick.matrix is first for tick in ticks])
    matrix = first[None] if same else np.array([tick.matrix for tick in ticks])
    u0, u1 = w0 * w0, w1 * w1
    mean = 0.5 * (u0 + u1)
    h = matrix * mean[:, None, :]
    h[:, 3] = matrix[:, 3] * u1
    share = np.abs(u1 - u0) / (mean + 1.0) * (error[1] + bend) + error[0]
    model = np.add.reduce((h * h) * (share * share)[:, None, :], axis=2)
    model[:, :2] += (doubt * np.add.reduce(h[:, :2], axis=2)) ** 2
    return matrix, mean, h, e - offset, 1.0 / (variances * inflation + model)


def rows(values: Iterable[Sequence[float]], width: int) -> Array:
    """Return (k, width) of k rows of floats, in half the time of np.array, which looks into each for what it is."""
    return np.fromiter(chain.from_iterable(values), float).reshape(-1, width)
