"""One tick under "all rotors healthy": what is left over, and what each rotor would explain of it.

Rows 0 roll, 1 pitch, 2 yaw acceleration, 3 vertical specific force.

    u_mean = (w0² + w0 w1 + w1²) / 3      mean of u over the tick, for a speed that moves linearly;
                                          the exact partner of a rate step. a_z takes u at its end
    e      = y - sum h_i                  (rotor acceleration taken off the yaw row)
    M      = sum h_i² (.02 + .25 |du_i| / u_i)²     what the thrust law and timing may be wrong by

Plain floats: for 4 to 8 rotors faster than numpy on (4, n).
Source: sheet 1 section 7, steps 1, 3 and 4.
"""

from typing import NamedTuple

from gcs_health.calibration.control_effectiveness import ControlEffectiveness
from gcs_health.calibration.residual_noise import ROWS
from gcs_health.estimators.ticks import Tick

NAN = float("nan")


class Step(NamedTuple):
    """Two successive ticks: `tick` and the one before, `dt` [s] apart; `inflation` of R [-]."""

    tick: Tick
    before: Tick
    dt: float
    inflation: float


class Residual(NamedTuple):
    """Raw residual (4), each rotor's columns (4 rows of n), model error variance (4), mean u (n)."""

    e: list[float]
    h: tuple[list[float], list[float], list[float], list[float]]
    model: list[float]
    squares: list[float]


def residual(
    step: Step, w0: list[float], w1: list[float], gains: ControlEffectiveness, error: tuple[float, float]
) -> Residual:
    """Return the raw residual of one step, rotor speeds w0 and w1 [rad/s] at its ends.

    `error` = (share, share per relative change of u) of a rotor's contribution that may be wrong.
    Without a yaw model the third row is NaN.
    """
    tick, before, dt, _ = step
    base, moving = error
    yaw = gains.has_yaw
    roll = (tick.p - before.p) / dt
    pitch = (tick.q - before.q) / dt
    turn = (tick.r - before.r) / dt
    az = tick.az
    m0 = m1 = m2 = m3 = 0.0
    h0: list[float] = []
    h1: list[float] = []
    h2: list[float] = []
    h3: list[float] = []
    squares: list[float] = []
    thrust = gains.thrust
    for a, b, gp, gq, gr, gi in zip(w0, w1, gains.roll, gains.pitch, gains.yaw, gains.inertia, strict=True):
        u0 = a * a
        u1 = b * b
        mean = (u0 + a * b + u1) / 3.0
        share = base + moving * abs(u1 - u0) / (mean + 1.0)
        share *= share
        p = gp * mean
        q = gq * mean
        z = -thrust * u1
        roll -= p
        pitch -= q
        az -= z
        m0 += p * p * share
        m1 += q * q * share
        m3 += z * z * share
        if yaw:
            r = gr * mean
            turn -= r + gi * (b - a) / dt
            m2 += r * r * share
            h2.append(r)
        h0.append(p)
        h1.append(q)
        h3.append(z)
        squares.append(mean)
    return Residual([roll, pitch, turn if yaw else NAN, az], (h0, h1, h2, h3), [m0, m1, m2, m3], squares)


def contribution(left: Residual, offset: list[float], variances: list[float]) -> list[float]:
    """Return [n_1 .. n_n, d_1 .. d_n, q] of one tick for the fault bank.

    `offset` (4) and `variances` (4) are the residual's baseline at this age; the model error is added.
    """
    e, h, model, squares = left
    n = len(squares)
    N = [0.0] * n
    D = [0.0] * n
    total = 0.0
    for row in range(ROWS):
        column = h[row]
        if not column:
            continue
        r = e[row] - offset[row]
        weight = 1.0 / (variances[row] + model[row])
        rw = r * weight
        total += r * rw
        for i in range(n):
            v = column[i]
            N[i] -= v * rw
            D[i] += v * v * weight
    return [*N, *D, total]
