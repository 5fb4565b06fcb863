"""One tick under "all rotors healthy": what is left over, and what each rotor would explain of it.

Rows 0 roll, 1 pitch, 2 yaw acceleration, 3 vertical specific force; n rotors.

    u_mean = (w0² + w0 w1 + w1²) / 3      mean of u over the tick, for a speed that moves linearly;
                                          the exact partner of a rate step. a_z takes u at its end
    h      = G u                          (4, n), signed
    e      = y - sum h_i                  (rotor acceleration taken off the yaw row)
    M      = sum h_i² (.02 + .5 |du_i| / u_i)²     what the thrust law and timing may be wrong by

The share of |du| in M is twice sheet 1's: it stands for some 4 ms by which rotor speeds and IMU may be
apart unknown to anyone; with half of it the healthy flights alarm when their stamps are moved.

Source: sheet 1 section 7, steps 1, 3 and 4.
"""

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
    """One tick's raw residual and columns."""

    e: list[float]  # (4,) raw residual; NaN in a row not used
    h: Array  # (4, n) what each healthy rotor adds
    h2: Array  # (4, n) its square
    model: Array  # (4,) variance of the model error
    squares: Array  # (n,) mean squared speed [(rad/s)²]


def raw_residual(step: Step, w0: list[float], w1: list[float], gains: ControlEffectiveness) -> list[float]:
    """Return e (4,) alone, a third of the work of `residual`: enough to see that a tick is calm."""
    u0, u1 = np.array(w0), np.array(w1)
    mean = (u0 * u0 + u1 * u1 + u0 * u1) * (1.0 / 3.0)
    roll, pitch, yaw, _ = gains.matrix.dot(mean).tolist()
    thrust = float(gains.matrix[3].dot(u1 * u1))
    tick, before, dt, _ = step
    turn = NAN
    if gains.has_yaw:
        turn = (tick.r - before.r - float(gains.inertia.dot(u1 - u0))) / dt - yaw
    return [(tick.p - before.p) / dt - roll, (tick.q - before.q) / dt - pitch, turn, tick.az - thrust]


def residual(
    step: Step,
    w0: list[float],
    w1: list[float],
    gains: ControlEffectiveness,
    error: tuple[float, float],
) -> Residual:
    """Return the residual of one step, rotor speeds w0 and w1 (n,) [rad/s] at its ends.

    `error` = (share, share per relative change of u) of a rotor's contribution that may be wrong.
    Without a yaw model the third row is NaN and its columns 0.
    """
    tick, before, dt, _ = step
    a = np.array(w0)
    b = np.array(w1)
    u0 = a * a
    u1 = b * b
    mean = (u0 + u1 + a * b) * (1.0 / 3.0)
    h = gains.matrix * mean
    h[3] = gains.matrix[3] * u1
    h2 = h * h
    share = np.abs(u1 - u0)
    share *= error[1]
    share /= mean + 1.0
    share += error[0]
    share *= share
    roll, pitch, yaw, thrust = h.dot(gains.ones).tolist()
    turn = NAN
    if gains.has_yaw:
        turn = (tick.r - before.r - float(gains.inertia.dot(b - a))) / dt - yaw
    e = [(tick.p - before.p) / dt - roll, (tick.q - before.q) / dt - pitch, turn, tick.az - thrust]
    return Residual(e, h, h2, h2.dot(share), mean)


def contribution(left: Residual, offset: list[float], variances: list[float]) -> Array:
    """Return [n_1 .. n_n, d_1 .. d_n, q] of one tick for the fault bank.

    `offset` (4) and `variances` (4) are the residual's baseline at this age; the model error is added.
    """
    e, h, h2, model, squares = left
    n = len(squares)
    turn = e[2] - offset[2]
    r = np.array([e[0] - offset[0], e[1] - offset[1], turn if turn == turn else 0.0, e[3] - offset[3]])
    weight = 1.0 / (np.array(variances) + model)
    weighted = r * weight
    out = np.empty(2 * n + 1)
    out[:n] = -weighted.dot(h)
    out[n : 2 * n] = weight.dot(h2)
    out[2 * n] = weighted.dot(r)
    return out


def calm(e: list[float], offset: list[float], variances: list[float], sigmas: float) -> bool:
    """Whether no row is further than `sigmas` from its baseline: such a tick can wait to be judged."""
    limit = sigmas * sigmas
    for value, base, variance in zip(e, offset, variances, strict=True):
        d = value - base
        if d * d > limit * variance:
            return False
    return True
