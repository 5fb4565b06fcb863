"""The level that healthy flights pass once in a stated time, from their largest values in 10 s.

    x_T = location - scale ln(-ln(1 - 10 s / T))       Gumbel's law, by moments
    std(x_T) = s sqrt((1 + 1.1396 K + 1.1 K²) / n)     K = (x_T - mean) / s, of n blocks
    n = N / (1 + (N / F - 1) rho)                      rho: what the blocks of one of F flights have in common

The threshold is the upper end of the one-sided 95 % interval, so that so few minutes do not promise more than they
showed, and never below the blocks' own quantile. Beyond the time flown it is an extrapolation: n blocks without an
alarm bound the rate by 3 / T alone (`false_alarms.most`). Source: Chow, Maidment, Mays
(1988), Applied Hydrology, 12.5; Kish (1965), Survey Sampling, 5.4.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import AlarmLevel
from gcs_health.calibration.false_alarms import BLOCK

LEAST_BLOCKS = 12  # two minutes
STEPS = round(BLOCK / 0.1)  # answers that make a block
EULER = 0.5772156649  # mean of the standard Gumbel law
UPPER = 1.645  # of a standard deviation: 95 % below


class Fitted(NamedTuple):
    """A level, its standard deviation, and the healthy flight behind it [s]."""

    level: AlarmLevel
    std: float
    time: float


def block_maxima(values: Sequence[float]) -> list[float]:
    """Return the largest of every 10 s of one flight's values, 0.1 s apart; what is left over does not count."""
    whole = len(values) // STEPS
    return [max(values[k * STEPS : (k + 1) * STEPS]) for k in range(whole)]


def fit_level(by_flight: Sequence[Sequence[float]], every: float) -> Fitted | None:
    """Return the level passed once in `every` [s], from each flight's blocks; None where they are too few."""
    flights = [np.asarray(maxima, dtype=np.float64) for maxima in by_flight if len(maxima)]
    x = np.concatenate([np.zeros(0), *flights])
    if len(x) < LEAST_BLOCKS:
        return None
    location, scale = gumbel(x)
    share = 1.0 - min(BLOCK / every, 0.5)
    at = location - scale * math.log(-math.log(share))
    s = max(float(x.std()), 1e-12)
    K = (at - float(x.mean())) / s
    std = s * math.sqrt(max(1.0 + 1.1396 * K + 1.1 * K * K, 0.0) / _independent(flights))
    threshold = max(at + UPPER * std, float(np.quantile(x, share)))
    return Fitted(AlarmLevel(threshold, location, scale, every), std, len(x) * BLOCK)


def _independent(flights: Sequence[NDArray[np.float64]]) -> float:
    """Return how many independent blocks they are worth: one a flight, where a flight is all of one piece."""
    sizes = np.array([len(flight) for flight in flights], dtype=np.float64)
    n, count = float(sizes.sum()), len(flights)
    if count < 2 or n <= count:
        return n
    means = np.array([flight.mean() for flight in flights])
    between = float(sizes @ (means - sizes @ means / n) ** 2) / (count - 1)
    within = sum(float(((flight - flight.mean()) ** 2).sum()) for flight in flights) / (n - count)
    usual = (n - float(sizes @ sizes) / n) / (count - 1)
    rho = (between - within) / max(between + (usual - 1.0) * within, 1e-300)
    return n / (1.0 + (n / count - 1.0) * min(max(rho, 0.0), 1.0))


def gumbel(maxima: NDArray[np.float64]) -> tuple[float, float]:
    """Return location and scale by moments."""
    scale = max(float(maxima.std()) * math.sqrt(6.0) / math.pi, 1e-3)
    return float(maxima.mean()) - EULER * scale, scale
