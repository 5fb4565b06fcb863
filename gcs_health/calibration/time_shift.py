"""How far the rotor speeds' stamps are off the IMU's: found where the rates answer them best.

    y[m]   measured, x[m] predicted angular acceleration of tick m, roll and pitch
    S[k] = sum y[m] x[m - k]      for lags of -30 .. +50 ms
    R²[k] = S[k]² / (sum x² sum y²), roll and pitch weighted by the inverse noise

Stamps of ESC values may be late (telemetry polls one ESC after another) or early (a filtered IMU), so
both signs are tried; 0 stays where no lag wins clearly: in hover nothing does.

Source: sheet 5 section 1 (nanodrone: rotor speeds 8 and 20 ms ahead of the IMU).
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class ShiftConfig:
    """When a shift is believed."""

    earliest: float = -0.03  # s
    latest: float = 0.05  # s
    memory: float = 20.0  # s
    settle: float = 3.0  # s of data before the first verdict
    every: float = 1.0  # s between verdicts
    least_r2: float = 0.2
    gain: float = 0.1  # share of what lag 0 leaves unexplained that the best lag must explain
    least_change: float = 0.003  # s
    agree: int = 2  # verdicts on end that must agree; this project
    agree_within: float = 0.004  # s


class TimeShift:
    """Learns the time to add to rotor speed stamps; `shift` [s] is 0 until one wins clearly."""

    def __init__(self, config: ShiftConfig | None = None) -> None:
        self.config = config or ShiftConfig()
        self.shift = 0.0
        self._last_found = math.inf
        self._agreeing = 0
        self.r2 = 0.0  # of the best lag
        self._tick = math.nan
        self._start_over(0.01)

    def _start_over(self, tick: float) -> None:
        c = self.config
        self._tick = tick
        self._ahead = max(1, math.ceil(-c.earliest / tick - 0.01))
        behind = max(1, math.ceil(c.latest / tick - 0.01))
        lags = self._ahead + behind + 1
        self._x: deque[tuple[float, float]] = deque(maxlen=lags)
        self._y: deque[tuple[float, float]] = deque(maxlen=self._ahead + 1)
        self._sxy = [[0.0] * lags, [0.0] * lags]
        self._sxx = [0.0, 0.0]
        self._syy = [0.0, 0.0]
        self._seen = 0.0
        self._since_verdict = 0.0
        self._phase = 0

    def gap(self) -> None:
        """Ticks are missing: no lag reaches across."""
        self._x.clear()
        self._y.clear()

    def feed(self, dt: float, x: tuple[float, float], y: tuple[float, float]) -> bool:
        """Take one tick of high-passed predicted x and measured y [rad/s²]; return whether `shift` moved."""
        c = self.config
        if not 0.6 < dt / self._tick < 1.6:
            if self._seen == 0.0 or dt < 0.6 * self._tick:
                self._start_over(dt)
            self.gap()
            return False
        self._x.append(x)
        self._y.append(y)
        self._seen += dt
        self._since_verdict += dt
        self._phase = (self._phase + 1) % 3
        if self._phase or len(self._x) < (self._x.maxlen or 0):
            return self._verdict() if self._since_verdict >= c.every else False
        keep = math.exp(-3.0 * dt / c.memory)
        past = self._y[0]  # x of this tick has `ahead` later ones in the buffer
        window = zip(*self._x, strict=True)
        self._sxy = [
            [keep * total + x * y for total, x in zip(sums, row, strict=True)]
            for sums, row, y in zip(self._sxy, window, past, strict=True)
        ]
        middle = self._x[len(self._x) - 1 - self._ahead]
        for axis in range(2):
            self._sxx[axis] = keep * self._sxx[axis] + middle[axis] * middle[axis]
            self._syy[axis] = keep * self._syy[axis] + past[axis] * past[axis]
        return self._verdict() if self._since_verdict >= c.every else False

    def _verdict(self) -> bool:
        c = self.config
        self._since_verdict = 0.0
        if self._seen < c.settle or min(self._sxx) <= 0.0 or min(self._syy) <= 0.0:
            return False
        share = np.maximum(np.array(self._sxy).T, 0.0) ** 2 / (np.array(self._sxx) * np.array(self._syy))
        r2 = share.mean(axis=1)[::-1]  # index 0 = the latest x: lag -ahead
        best = int(r2.argmax())
        self.r2 = float(r2[best])
        if self.r2 < c.least_r2 or 1.0 - self.r2 > (1.0 - c.gain) * (1.0 - float(r2[self._ahead])):
            return False
        offset = 0.0
        if 0 < best < len(r2) - 1:
            left, middle, right = (float(r2[best + k]) for k in (-1, 0, 1))
            bend = left - 2.0 * middle + right
            offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
        total = self.shift + (best - self._ahead + offset) * self._tick
        total = min(max(total, c.earliest), c.latest)
        if abs(total - self.shift) < c.least_change:
            self._agreeing = 0
            return False
        # a single manoeuvre can look late; only what a second look confirms is believed
        self._agreeing = self._agreeing + 1 if abs(total - self._last_found) < c.agree_within else 1
        self._last_found = total
        if self._agreeing < c.agree:
            return False
        self.shift = total
        self._start_over(self._tick)
        return True
