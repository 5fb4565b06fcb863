"""Linear Kalman filter steps as functions of values.

    x  state (n,)              P  its covariance (n, n)
    F  transition (n, n)       Q  process noise of the step (n, n)
    z  measurement (m,)        H  measurement model (m, n)      R  its noise (m, m)
    y = z - H x  innovation    S = H P H' + R  its covariance   K = P H' S^-1  gain

Two spellings of the same thing: numpy for any shape, and one scalar row at a time in plain floats,
which for four to eight states and a diagonal R is some five times faster (`benchmarks/`), needs no
inverse, and gives the same result.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Prediction(NamedTuple):
    """State (n,) and covariance (n, n) before the measurement."""

    x: Array
    P: Array


class Update(NamedTuple):
    """State and covariance after the measurement, with what tells whether they are consistent.

    `innovation` (k,) and `S` (k, k) cover the k rows that were present; `nis` = y' S^-1 y [-] has a
    chi-square distribution with k degrees of freedom where the model holds.
    """

    x: Array
    P: Array
    innovation: Array
    S: Array
    nis: float


def predict(x: Array, P: Array, F: Array, Q: Array) -> Prediction:
    """Move the state one step on: x = F x, P = F P F' + Q (Q per step, not per second).

    Parameters
    ----------
    x : (n,) state.
    P : (n, n) covariance.
    F : (n, n) transition.
    Q : (n, n) noise added in this step, in squared units of x.

    Returns
    -------
    Prediction : new arrays; P is exactly symmetric.

    Source: any textbook; the random walk of Strack van Schijndel et al. (2023), eq. 11, has F = I.
    """
    P_next = F @ P @ F.T + Q
    return Prediction(F @ x, 0.5 * (P_next + P_next.T))


def update(x: Array, P: Array, z: Array, H: Array, R: Array) -> Update:
    """Fold one measurement in; rows of z that are not finite are skipped.

    Parameters
    ----------
    x : (n,) state.
    P : (n, n) covariance.
    z : (m,) measurement, NaN where a sensor said nothing.
    H : (m, n) measurement model.
    R : (m, m) measurement noise.

    Returns
    -------
    Update : new arrays; P in Joseph form, (I - K H) P (I - K H)' + K R K', exactly symmetric.

    Raises
    ------
    numpy.linalg.LinAlgError : S is singular (R must be positive definite).

    Source: Strack van Schijndel et al. (2023), algorithm 1; Joseph form added.
    """
    present = np.isfinite(z)
    if not present.any():
        empty = np.zeros(0)
        return Update(x.copy(), P.copy(), empty, np.zeros((0, 0)), 0.0)
    H = H[present]
    R = R[np.ix_(present, present)]
    innovation = z[present] - H @ x
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T  # S and P are symmetric
    A = np.eye(len(x)) - K @ H
    P_next = A @ P @ A.T + K @ R @ K.T
    nis = float(innovation @ np.linalg.solve(S, innovation))
    return Update(x + K @ innovation, 0.5 * (P_next + P_next.T), innovation, S, nis)


def update_scalar(
    x: list[float], P: list[list[float]], z: float, h: list[float], r: float
) -> tuple[list[float], list[list[float]], float, float]:
    """Fold in one scalar measurement z = h x + noise of variance r, in plain floats.

    Parameters
    ----------
    x : n states; P : n rows of n, symmetric. Neither is changed.
    z : measurement; not finite = skipped.
    h : n coefficients of the row.
    r : noise variance, > 0, in the squared unit of z.

    Returns
    -------
    (x, P, innovation, S) : new lists, P exactly symmetric; innovation and S are NaN when skipped.

    Rows with independent noise folded in one after another equal one joint update. P - K S K' is used
    rather than the Joseph form: with r well above rounding (here r >= .04 against S <= 1e5) the two
    differ by 1e-12, and this one costs a third.
    """
    if z - z != 0.0:  # NaN or infinite
        return x, P, float("nan"), float("nan")
    n = len(x)
    Ph = [0.0] * n
    innovation = z
    S = r
    for i in range(n):
        row = P[i]
        total = 0.0
        for j in range(n):
            total += row[j] * h[j]
        Ph[i] = total
        innovation -= h[i] * x[i]
        S += h[i] * total
    inverse = 1.0 / S
    x_next = [x[i] + Ph[i] * inverse * innovation for i in range(n)]
    P_next = [[0.0] * n for _ in range(n)]
    for i in range(n):
        gain = Ph[i] * inverse
        row = P[i]
        out = P_next[i]
        for j in range(i, n):
            out[j] = P_next[j][i] = row[j] - gain * Ph[j]
    return x_next, P_next, innovation, S
