"""By how much the vehicle's own motion raises the variance of the residual: drag and fast turns are not modelled.

    (1 + |a_xy|² / 4² + |Omega|² / 4²)²     of horizontal specific force and body rates, both low-passed

Source: sheet 5 section 3 rule 5.
"""

from dataclasses import dataclass

from gcs_health.estimators.ticks import Tick


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """Scales, each from one small craft (sheet 5)."""

    drag: float = 4.0  # m/s²
    body_rate: float = 4.0  # rad/s
    time: float = 0.2  # s, low pass of both, so that a fault does not blind itself


class Motion:
    """Fed ticks."""

    def __init__(self, config: MotionConfig) -> None:
        self.config = config
        self._slow = (0.0,) * 5  # a_x, a_y, p, q, r, low-passed

    def inflation(self, tick: Tick, dt: float) -> float:
        """Take a tick `dt` [s] after the one before; return the factor of the variance [-]."""
        c = self.config
        gain = dt / c.time
        if gain > 1.0:
            gain = 1.0
        ax, ay, p, q, r = self._slow
        ax += gain * (tick.ax - ax)
        ay += gain * (tick.ay - ay)
        p += gain * (tick.p - p)
        q += gain * (tick.q - q)
        r += gain * (tick.r - r)
        self._slow = (ax, ay, p, q, r)
        push = (ax * ax + ay * ay) / c.drag**2
        spin = (p * p + q * q + r * r) / c.body_rate**2
        return (1.0 + push + spin) ** 2
