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
from gcs_health.estimators.lesson import Lesson

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SlowConfig:
    """Times and spreads of the slow filter."""

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
        self._diagonal = np.diag_indices(rotors)
        self.restart()

    def restart(self) -> None:
        """Forget the losses and the offset: the gate opened."""
        n = self.rotors
        self.x: Array = np.zeros(n)
        self.P: Array = self.config.prior**2 * np.eye(n)
        self.offset = [0.0] * ROWS
        self.time = 0.0  # s since the restart

    def feed(self, lesson: Lesson, matrix: Array) -> None:
        """Take the final ticks of one block, with the gains G (4, n)."""
        c = self.config
        length = lesson.length
        self.time += length
        keep = math.exp(-length / c.memory)
        x = keep * self.x
        P = keep * keep * self.P
        P[self._diagonal] += (1.0 - keep * keep) * c.prior**2
        gain = min(1.0, length / min(c.offset_memory, max(self.time, 0.5)))
        weights = lesson.dt / length
        e, variance = (weights @ lesson.e).tolist(), (weights @ lesson.variances).tolist()
        columns = matrix * (weights @ lesson.squares)
        columns[3] = matrix[3] * (weights @ lesson.last_squares)
        for row in range(ROWS):
            h = -columns[row]
            if not h.any():
                continue
            noise = variance[row] / len(lesson.dt) * c.correlated
            value = e[row]
            limit = c.clip * math.sqrt(noise)
            innovation = min(max(value - self.offset[row] - float(h.dot(x)), -limit), limit)
            Ph = P.dot(h)
            K = Ph / (float(h.dot(Ph)) + noise)
            x += K * innovation
            P -= K[:, None] * Ph
            self.offset[row] += gain * min(max(value - self.offset[row], -limit), limit)
        self.x, self.P = x, 0.5 * (P + P.T)

    def effectiveness(self, rotor: int) -> float:
        """Return k = 1 - loss, within 0 .. 1.5 [-]."""
        return min(max(1.0 - float(self.x[rotor]), 0.0), 1.5)

    def std(self, rotor: int) -> float:
        """Return its standard deviation [-]."""
        return math.sqrt(max(float(self.P[rotor, rotor]), 0.0))
