"""What a partial loss of one rotor does to a recorded flight, and what its controller answers.

In units of the rotor's squared speed u_i, b_i its column of geometry B (roll, pitch, yaw, lift):

    d(t)  = theta(t) (u_i + du_i)          the disturbance: what the rotor no longer gives
    a     = d - q                          what is not answered yet, row by row
    q     = 2 v / tau + s / tau²           rate loops: v = integral of a, s = integral of v
    q'    = (d - q) / tau                  height loop
    du    = pinv(B) (b_i q)                what the mixer, which knows of no loss, asks of the rotors

so that the vehicle shows -G_i v in its rates and -G_i a in a_z, whose sum with the rotors' G du is exactly
the missing wrench; once all is answered G diag(k) (u + du) = G u. Nothing jumps but a_z, whatever theta does.

The loops' times are those of the simulator's controller, within what its rates show of a loss
(tests/simulate/test_graft_loss.py).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.gate import GRAVITY
from gcs_health.simulate.graft_fault import GraftFault
from gcs_health.simulate.recording import Flown

Array = NDArray[np.float64]
GRID = 0.001  # s
HEIGHT_LOOP, YAW_LOOP = 2.5, 3.3  # times slower than roll and pitch
IDLE = 0.25  # of hover lift; below, as on the ground, nothing answers and nothing turns
FORGET = 0.05  # s, then


@dataclass(frozen=True)
class Loss:
    """The loss on a grid of a millisecond.

    t : (k,) [s]. rates : (3, k) what p, q, r gain [rad/s]. lift : (k,) what a_z gains [m/s²].
    change : (n, k) what each squared speed gains [(rad/s)²]. share : (k,) theta.
    """

    t: Array
    rates: Array
    lift: Array
    change: Array
    share: Array


def loss_of(flown: Flown, rotor: int, fault: GraftFault) -> Loss:
    """Return what the loss of `fault` on rotor number `rotor`, from 0, does to the flight."""
    at = flown.first_t + fault.at
    t = np.arange(at, flown.last_t + GRID, GRID)
    squares = np.array([np.interp(t, flown.rotor_t, w) for w in flown.speed.T]) ** 2
    theta = (1.0 - fault.size) * np.array([fault.grown(since) for since in (t - at).tolist()])
    hover = GRAVITY / max(-flown.matrix[3, rotor], 1e-12)  # of all rotors together
    B = geometry(flown.airframe)
    mixer = np.linalg.pinv(B)
    answer = mixer[rotor] * B[:, rotor]  # how much of each row's answer is this rotor's own
    turned, unlifted, answered = _closed_loop(
        theta, squares[rotor], squares.sum(axis=0) > IDLE * hover, answer, fault.loop
    )
    return Loss(
        t,
        -flown.matrix[:3, rotor, None] * turned,
        -flown.matrix[3, rotor] * unlifted,
        mixer @ (B[:, rotor, None] * answered),
        theta,
    )


def geometry(airframe: Airframe) -> Array:
    """Return B (4, n): what one unit of squared speed does in roll, pitch, yaw and lift, each in its own unit."""
    rotors = airframe.rotors
    rows = [[-r.position[1] for r in rotors], [r.position[0] for r in rotors]]
    B = np.array([*rows, [float(r.spin) for r in rotors], [1.0] * len(rotors)])
    out: Array = B / np.maximum(np.abs(B).max(axis=1, keepdims=True), 1e-12)
    return out


def _closed_loop(
    theta: Array, squares: Array, flies: NDArray[np.bool_], answer: Array, loop: float
) -> tuple[Array, Array, Array]:
    """Return v of roll, pitch, yaw (3, k), a of the height (k,), and q of all four rows (4, k)."""
    yaw_loop, height_loop = YAW_LOOP * loop, HEIGHT_LOOP * loop
    own_turn, own_yaw, own_lift = float(answer[0] + answer[1]), float(answer[2]), float(answer[3])
    forget = math.exp(-GRID / FORGET)
    v = s = v_yaw = s_yaw = lift = 0.0
    out = np.zeros((len(theta), 6))
    for k, (share, u, free) in enumerate(zip(theta.tolist(), squares.tolist(), flies.tolist(), strict=True)):
        q = 2.0 * v / loop + s / loop**2
        q_yaw = 2.0 * v_yaw / yaw_loop + s_yaw / yaw_loop**2
        if not free:
            v, s, v_yaw, s_yaw, lift = (forget * state for state in (v, s, v_yaw, s_yaw, lift))
            out[k] = v, v_yaw, 0.0, q, q_yaw, lift
            continue
        missing = share * max(u + own_turn * q + own_yaw * q_yaw + own_lift * lift, 0.0)
        out[k] = v, v_yaw, missing - lift, q, q_yaw, lift
        v += GRID * (missing - q)
        s += GRID * v
        v_yaw += GRID * (missing - q_yaw)
        s_yaw += GRID * v_yaw
        lift += GRID * (missing - lift) / height_loop
    turned, yawed, unlifted, q_turn, q_yawed, lifted = out.T
    return np.array([turned, turned, yawed]), unlifted, np.array([q_turn, q_turn, q_yawed, lifted])
