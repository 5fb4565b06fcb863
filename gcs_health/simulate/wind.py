"""Mean wind and Dryden turbulence near the ground.

    H_u(s) = s_u sqrt(2 L_u / (pi V)) / (1 + (L_u / V) s)
    H_w(s) = s_w sqrt(L_w / (pi V)) (1 + sqrt(3) (L_w / V) s) / (1 + (L_w / V) s)²     likewise v with L_v
    s_w = .1 W20,  L_w = h,  L_u = L_v = h / (.177 + .000823 h)^1.2,  s_u = s_v = s_w / (...)^.4     h in feet

driven by white noise of one-sided density such that the variance is s². W20, the wind at 20 feet, grades
the turbulence: 15 knots low, 30 moderate, 45 severe. Source: MIL-F-8785C, low-altitude model.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gcs_health.simulate.arithmetic import Value

FOOT, KNOT = 0.3048, 0.514444  # m, m/s
GRADES = {"none": 0.0, "low": 15.0 * KNOT, "moderate": 30.0 * KNOT, "severe": 45.0 * KNOT}
SLOWEST_AIR = 1.0  # m/s past the vehicle, lest turbulence stand still in calm air
Array = NDArray[np.float64]


def scales(height: float, w20: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (sigma [m/s], length [m]) along (u and v) and vertical (w) at a height [m]."""
    feet = min(max(height / FOOT, 10.0), 1000.0)
    shape = 0.177 + 0.000823 * feet
    sigma_w = 0.1 * w20
    return (sigma_w / shape**0.4, feet / shape**1.2 * FOOT), (sigma_w, feet * FOOT)


class Dryden:
    """Turbulence of one or many flights, stepped at a fixed rate; exact discrete form of the filters.

    Parameters
    ----------
    rng : one generator a flight; floats come out of a single one, columns of several.
    step : [s]. height [m], airspeed [m/s] and w20 [m/s] hold for the flight.
    """

    def __init__(
        self, rng: list[np.random.Generator], step: float, height: float, airspeed: float, w20: float
    ) -> None:
        self._rng = rng
        self._columns = len(rng) > 1
        (sigma_u, length_u), (sigma_w, length_w) = scales(height, w20)
        v = max(airspeed, SLOWEST_AIR)
        # the lateral filter has twice its length scale in the newer MIL-HDBK-1797; 8785C as here
        self._u = math.exp(-step * v / length_u)
        self._sigma_u = sigma_u
        self._lateral = _second_order(length_u / v, sigma_u, step)
        self._vertical = _second_order(length_w / v, sigma_w, step)
        self._state: Array = np.zeros((5, len(rng)))
        self._at = 0
        for row, (_, _, spread) in ((1, self._lateral), (3, self._vertical)):
            self._state[row : row + 2] = spread @ np.stack([one.standard_normal(2) for one in rng], axis=1)
        self._state[0] = sigma_u * np.array([one.standard_normal() for one in rng])
        self._outputs: list[tuple[Value, Value, Value]] = []

    def step(self) -> tuple[Value, Value, Value]:
        """Return the next (u, v, w) [m/s]: along the mean wind, across it, down."""
        if self._at == len(self._outputs):
            self._outputs = self._next_block(256)
            self._at = 0
        self._at += 1
        return self._outputs[self._at - 1]

    def series(self, count: int) -> Array:
        """Return (count, 3) of the first flight, for looking at its spectrum."""
        return np.array([[float(np.ravel(value)[0]) for value in self.step()] for _ in range(count)])

    def _next_block(self, count: int) -> list[tuple[Value, Value, Value]]:
        """Noise in blocks: drawing numbers one by one costs more than the filters."""
        noise = np.stack([one.standard_normal((count, 5)) for one in self._rng], axis=2)
        fresh = self._sigma_u * math.sqrt(1.0 - self._u**2)
        u, *others = self._values(self._state)
        A, B, _ = (part.tolist() for part in self._lateral)
        C, D, _ = (part.tolist() for part in self._vertical)
        out = []
        for chance in noise if self._columns else noise[:, :, 0].tolist():
            u = self._u * u + fresh * chance[0]
            v, w = _turned(A, B, *others[:2], *chance[1:3]), _turned(C, D, *others[2:], *chance[3:5])
            others = [*v, *w]
            out.append((u, v[0], w[0]))
        self._state = np.array([u, *others]).reshape(self._state.shape)
        return out

    def _values(self, rows: Array) -> list[Value]:
        return list(rows) if self._columns else rows[:, 0].tolist()


def _turned(
    A: list[list[float]], B: list[list[float]], y: Value, x: Value, chance: Value, other: Value
) -> tuple[Value, Value]:
    """Return the next state of a filter of second order: A (y, x) + B (chance, other), B lower triangular."""
    return (
        A[0][0] * y + A[0][1] * x + B[0][0] * chance,
        A[1][0] * y + A[1][1] * x + B[1][0] * chance + B[1][1] * other,
    )


def _second_order(time: float, sigma: float, step: float) -> tuple[Array, Array, Array]:
    """Return transition, noise shaping and stationary spread of (1 + sqrt3 T s)/(1 + T s)².

    States: the output y and x = the double lag's input side; with white noise of unit density
    y = z1 + sqrt(3) (x - ...) is written as a cascade: x' = (-x + n)/T, and the output mixes x and its lag.
    """
    from scipy.linalg import cholesky, expm, solve_continuous_lyapunov

    # controllable form of the filter, then turned so that the first state is the output itself
    A = np.array([[0.0, 1.0], [-1.0 / time**2, -2.0 / time]])
    C = np.array([1.0, math.sqrt(3.0) * time]) / time**2
    turn = np.array([C, [0.0, 1.0]])
    A = turn @ A @ np.linalg.inv(turn)
    B = turn @ np.array([[0.0], [1.0]])
    P = solve_continuous_lyapunov(A, -B @ B.T)
    scale = sigma / math.sqrt(P[0, 0]) if sigma > 0.0 else 0.0
    F = expm(A * step)
    Q = P - F @ P @ F.T
    shaping = scale * np.linalg.cholesky(Q + 1e-12 * np.trace(P) * np.eye(2))
    spread = scale * cholesky(P, lower=True)
    return F, shaping, spread
