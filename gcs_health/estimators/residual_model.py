"""One tick under "all rotors healthy": what is left over, and what each rotor would explain of it.

Rows 0 roll, 1 pitch, 2 yaw acceleration, 3 vertical specific force; n rotors.

    u_mean = (w0² + w0 w1 + w1²) / 3      mean of u over the tick, for a speed that moves linearly;
                                          the exact partner of a rate step. a_z takes u at its end
    h      = G u                          (4, n), signed
    e      = y - sum h_i                  (rotor acceleration taken off the yaw row)
    M      = sum h_i² (.02 + .5 |du_i| / u_i)²     what the thrust law and timing may be wrong by

The share of |du| in M is twice sheet 1's: it stands for some 4 ms by which rotor speeds and IMU may be
apart unknown to anyone; with half of it the healthy flights alarm when their stamps are moved.

`residual` runs with every tick and is in plain floats, which for so few rotors is faster than numpy;
`contributions` runs only when somebody wants to know, over all the ticks gathered until then.

Source: sheet 1 section 7, steps 1, 3 and 4.
"""

from collections.abc import Sequence
from operator import mul
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.calibration.control_effectiveness import ControlEffectiveness
from gcs_health.estimators.ticks import Tick

Array = NDArray[np.float64]
NAN = float("nan")


class Step(NamedTuple):
    """Two successive ticks: `tick` and the one before, `dt` [s] apart; `inflation` of R [-]."""

    tick: Tick
    before: Tick
    dt: float
    inflation: float


class Residual(NamedTuple):
    """One tick's raw residual, and the rotor speeds it was made with."""

    e: list[float]  # (4,) raw residual; NaN in a row not used
    w0: list[float]  # (n,) [rad/s] at the beginning
    w1: list[float]  # (n,) at the end
    mean: list[float]  # (n,) mean squared speed between them [(rad/s)²]


class Evidence(NamedTuple):
    """One tick as the fault bank takes it."""

    r: list[float]  # (4,) residual less its baseline; 0 in a row not used
    variances: list[float]  # (4,) of it, without the model error
    w0: list[float]
    w1: list[float]
    matrix: Array  # (4, n) gains G at that time


def residual(step: Step, w0: list[float], w1: list[float], gains: ControlEffectiveness) -> Residual:
    """Return the residual of one step, rotor speeds w0 and w1 (n,) [rad/s] at its ends.

    Without a yaw model the third row is NaN.
    """
    tick, before, dt, _ = step
    mean = [(a * a + a * b + b * b) / 3.0 for a, b in zip(w0, w1, strict=True)]
    roll = sum(map(mul, gains.roll, mean))
    pitch = sum(map(mul, gains.pitch, mean))
    turn = NAN
    if gains.has_yaw:
        spun = sum(map(mul, gains.spin, w1)) - sum(map(mul, gains.spin, w0))
        turn = (tick.r - before.r - gains.yaw_inertia * spun) / dt - sum(map(mul, gains.yaw, mean))
    lift = gains.thrust * sum(map(mul, w1, w1))
    return Residual(
        [(tick.p - before.p) / dt - roll, (tick.q - before.q) / dt - pitch, turn, tick.az + lift],
        w0,
        w1,
        mean,
    )


def evidence(left: Residual, offset: list[float], variances: list[float], matrix: Array) -> Evidence:
    """Return what a residual says against its baseline `offset` (4) with its `variances` (4)."""
    e = left.e
    turn = e[2] - offset[2]
    r = [e[0] - offset[0], e[1] - offset[1], turn if turn == turn else 0.0, e[3] - offset[3]]
    return Evidence(r, variances, left.w0, left.w1, matrix)


def contributions(ticks: Sequence[Evidence], error: tuple[float, float]) -> Array:
    """Return (k, 2n + 1) rows [n_1 .. n_n, d_1 .. d_n, q] of k ticks for the fault bank.

    `error` = (share, share per relative change of u) of a rotor's contribution that may be wrong.
    """
    *vectors, matrices = zip(*ticks, strict=True)
    r, variances, w0, w1 = (np.array(vector) for vector in vectors)
    # gains change seldom: mostly all ticks have the same
    matrix = np.array(matrices[:1] if all(one is matrices[0] for one in matrices) else matrices)
    n = w0.shape[1]
    u0, u1 = w0 * w0, w1 * w1
    mean = (u0 + u1 + w0 * w1) / 3.0
    h = matrix * mean[:, None, :]
    h[:, 3] = matrix[:, 3] * u1
    h2 = h * h
    share = np.abs(u1 - u0) / (mean + 1.0) * error[1] + error[0]
    model = (h2 * (share * share)[:, None, :]).sum(axis=2)
    weight = 1.0 / (variances + model)
    weighted = r * weight
    out = np.empty((len(ticks), 2 * n + 1))
    out[:, :n] = -(weighted[:, :, None] * h).sum(axis=1)
    out[:, n : 2 * n] = (weight[:, :, None] * h2).sum(axis=1)
    out[:, 2 * n] = (weighted * r).sum(axis=1)
    return out


def calm(e: list[float], offset: list[float], variances: list[float], sigmas: float) -> bool:
    """Whether no row is further than `sigmas` from its baseline: such a tick by itself accuses nobody."""
    limit = sigmas * sigmas
    for value, base, variance in zip(e, offset, variances, strict=True):
        d = value - base
        if d * d > limit * variance:
            return False
    return True
