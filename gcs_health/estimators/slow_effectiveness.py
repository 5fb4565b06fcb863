"""Each rotor's effectiveness on the scale of seconds, with its standard deviation: for display.

    x    loss of each rotor, 1 - k          e    raw residual, mean over 100 ms
    H    -h, columns of the rotors          b    offset with a memory of 25 s
    e - b = H x + noise,  x pulled towards 0 within `memory`, P_ii <= `prior`²

The pull is what bounds the null direction of the paper's filter: three equations cannot hold four
unknowns apart in hover (sheet 1 section 5). The slow offset takes part of a lasting loss with it, so
small losses read low; aerodynamic residuals last, hence the noise floor.

Source: sheet 1 sections 5, 7.7 and 7.9; sheet 5 section 3, partial loss.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.calibration.residual_noise import ROWS
from gcs_health.estimators import kalman
from gcs_health.estimators.residual_model import Residual


@dataclass(frozen=True, slots=True)
class SlowConfig:
    """Times and spreads of the slow filter."""

    block: float = 0.1  # s
    memory: float = 1.5  # s, of x
    offset_memory: float = 25.0  # s
    prior: float = 0.2  # [-]
    clip: float = 3.5  # sigmas
    correlated: float = 6.0  # variance of a block mean over that of white noise


class SlowEffectiveness:
    """Information-light Kalman filter over all rotors at once, one update a block."""

    def __init__(self, rotors: int, config: SlowConfig) -> None:
        self.config = config
        self.rotors = rotors
        self.restart()

    def restart(self) -> None:
        """Forget the losses and the offset: the gate opened."""
        n = self.rotors
        variance = self.config.prior**2
        self.x = [0.0] * n
        self.P = [[variance if i == j else 0.0 for j in range(n)] for i in range(n)]
        self.offset = [0.0] * ROWS
        self.time = 0.0  # s since the restart
        self._clear_block()

    def _clear_block(self) -> None:
        self._length = 0.0
        self._ticks = 0
        self._e = [0.0] * ROWS
        self._variance = [0.0] * ROWS
        self._mean: list[list[float]] = []  # mean and last squared speeds of every tick
        self._last: list[list[float]] = []

    def feed(self, dt: float, left: Residual, variances: list[float], matrix: NDArray[np.float64]) -> None:
        """Take one final tick: its residual, variances (4) and the gains G (4, n)."""
        self._length += dt
        self._ticks += 1
        e = left.e
        for row in range(ROWS):
            self._e[row] += e[row]
            self._variance[row] += variances[row]
        self._mean.append(left.mean)
        self._last.append(left.w1)
        if self._length >= self.config.block:
            self._update(matrix)

    def _columns(self, matrix: NDArray[np.float64]) -> list[list[float]]:
        """Return the sums of h over the block, a list of n for each row."""
        last = np.array(self._last)
        columns = matrix * np.array(self._mean).sum(axis=0)
        columns[3] = matrix[3] * (last * last).sum(axis=0)
        out: list[list[float]] = columns.tolist()
        return out

    def _update(self, matrix: NDArray[np.float64]) -> None:
        c = self.config
        length, share = self._length, 1.0 / self._ticks
        self.time += length
        n = self.rotors
        keep = math.exp(-length / c.memory)
        added = (1.0 - keep * keep) * c.prior**2
        x = [keep * value for value in self.x]
        P = [[keep * keep * value for value in row] for row in self.P]
        for i in range(n):
            P[i][i] += added
        gain = min(1.0, length / min(c.offset_memory, max(self.time, 0.5)))
        columns = self._columns(matrix)
        for row in range(ROWS):
            column = columns[row]
            if not any(column):
                continue
            noise = self._variance[row] * share * share * c.correlated
            value = self._e[row] * share
            limit = c.clip * math.sqrt(noise)
            h = [-entry * share for entry in column]
            z = value - self.offset[row]
            expected = sum([h[i] * x[i] for i in range(n)])
            z = expected + min(max(z - expected, -limit), limit)
            x, P, _, _ = kalman.update_scalar(x, P, z, h, noise)
            self.offset[row] += gain * min(max(value - self.offset[row], -limit), limit)
        self.x, self.P = x, P
        self._clear_block()

    def effectiveness(self, rotor: int) -> float:
        """Return k = 1 - loss, within 0 .. 1.5 [-]."""
        return min(max(1.0 - self.x[rotor], 0.0), 1.5)

    def std(self, rotor: int) -> float:
        """Return its standard deviation [-]."""
        return math.sqrt(max(self.P[rotor][rotor], 0.0))
