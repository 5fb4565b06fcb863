"""What is left of a rotor's 1/rev line on its way from the shaft to a high-passed telemetry sample.

    g(w) = w² |H_ap(w)| |H_hp(w)|      per unit of m_u r_u / m_b

H_ap  the autopilot: PX4's mean over 1 / IMU_INTEG_RATE, |sinc(f T)|; ArduPilot's two poles,
      1 / sqrt(1 + (f / fc)^4). Neither is a filter against aliasing: the line arrives at its alias.
H_hp  the estimator's own first-order high-pass, taken at exp(j w / f_s): at the alias, by itself.

Source: sheet 2 section 5; PX4 HIGHRES_IMU.hpp, ArduPilot LowPassFilter2p.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.samples import ImuFilterReading

Array = NDArray[np.float64]
NAN = math.nan


class ImuFilter(NamedTuple):
    """What the accelerations have passed on board: mean over [s], cut-off [Hz], NaN = not; who says so."""

    mean_over: float = NAN
    cutoff: float = NAN
    source: str = "not known"

    @classmethod
    def told(cls, reading: ImuFilterReading) -> "ImuFilter":
        """Take what the stream says; values that no filter has are not taken."""
        mean = reading.mean_over if 0.0 < reading.mean_over < 1.0 else NAN
        cutoff = reading.cutoff if 0.0 < reading.cutoff < 1e4 else NAN
        return cls(mean, cutoff, reading.source)

    def gain(self, omega: Array) -> Array:
        """Return |H_ap| at rotor speeds [rad/s]."""
        out = np.ones_like(omega)
        if self.mean_over == self.mean_over:
            out = np.abs(np.sinc(omega * (self.mean_over / (2.0 * math.pi))))
        if self.cutoff == self.cutoff:
            ratio = omega * (1.0 / (2.0 * math.pi * self.cutoff))
            out = out / np.sqrt(1.0 + ratio**4)
        return out


class HighPass:
    """First order, each axis, one sample after another at their own times.

    y[k] = a (y[k-1] + x[k] - x[k-1]),  a = 1 / (1 + 2 pi f dt)
    """

    def __init__(self, corner: float) -> None:
        self.corner = corner  # [Hz]
        self.restart()

    def restart(self) -> None:
        """Begin anew, as after a gap."""
        self._before: complex | None = None
        self._passed = 0j

    def feed(self, dt: float, x: float, y: float) -> complex:
        """Take a sample `dt` [s] after the one before; return it without what is slower than the corner."""
        return self.block([dt], [complex(x, y)])[0]

    def block(self, steps: list[float], samples: list[complex]) -> list[complex]:
        """Take samples x + j y, each so long after the one before [s]; an infinite step begins anew."""
        before, passed = self._before, self._passed
        if before is None:
            before = samples[0]
        slow, out = 2.0 * math.pi * self.corner, []
        for dt, now in zip(steps, samples, strict=True):
            passed = (passed + now - before) * (1.0 / (1.0 + slow * dt))
            before = now
            out.append(passed)
        self._before, self._passed = before, passed
        return out


def highpass_gain(omega: Array, corner: float, step: float) -> Array:
    """Return |H_hp| of `HighPass` at rotor speeds [rad/s], sampled each `step` [s].

    A line at a multiple of the sampling rate folds to zero frequency, where this has its zero.
    """
    a = 1.0 / (1.0 + 2.0 * math.pi * corner * step)
    c = np.cos(omega * step)
    gain: Array = a * np.sqrt((2.0 - 2.0 * c) / (1.0 + a * a - 2.0 * a * c))
    return gain
