"""The level that healthy flights pass once in a stated time, from their largest values in 10 s.

    x_T = location - scale ln(-ln(1 - 10 s / T))       Gumbel's law, by moments
    std(x_T) = s sqrt((1 + 1.1396 K + 1.1 K²) / n)     K = (x_T - mean) / s, of n blocks

The threshold is the upper end of the one-sided 95 % interval, so that so few minutes do not promise more than they
showed, and never below the blocks' own quantile. Beyond the time flown it is an extrapolation: n blocks without an
alarm bound the rate by 3 / T alone (`false_alarms.most`). Source: Chow, Maidment, Mays
(1988), Applied Hydrology, 12.5.
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


def fit_level(maxima: Sequence[float], every: float) -> Fitted | None:
    """Return the level passed once in `every` [s]; None where the blocks are too few."""
    x = np.asarray(maxima, dtype=np.float64)
    n = len(x)
    if n < LEAST_BLOCKS:
        return None
    location, scale = gumbel(x)
    share = 1.0 - min(BLOCK / every, 0.5)
    at = location - scale * math.log(-math.log(share))
    s = max(float(x.std()), 1e-12)
    K = (at - float(x.mean())) / s
    std = s * math.sqrt(max(1.0 + 1.1396 * K + 1.1 * K * K, 0.0) / n)
    threshold = max(at + UPPER * std, float(np.quantile(x, share)))
    return Fitted(AlarmLevel(threshold, location, scale, every), std, n * BLOCK)


def gumbel(maxima: NDArray[np.float64]) -> tuple[float, float]:
    """Return location and scale by moments."""
    scale = max(float(maxima.std()) * math.sqrt(6.0) / math.pi, 1e-3)
    return float(maxima.mean()) - EULER * scale, scale
