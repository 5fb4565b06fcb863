"""How far the rotor speeds' stamps are off the IMU's: found where the rates answer them best.

    y[m]   measured, x[m] predicted angular acceleration of tick m, roll and pitch
    S[k] = sum y[m] x[m - k]      for lags of -30 .. +50 ms
    R²[k] = S[k]² / (sum x² sum y²), roll and pitch weighted by the inverse noise

Stamps of ESC values may be late (telemetry polls one ESC after another) or early (a filtered IMU), so
both signs are tried; 0 stays where no lag wins clearly: in hover nothing does.

Source: sheet 5 section 1 (nanodrone: rotor speeds 8 and 20 ms ahead of the IMU).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
        self._lags = self._ahead + behind + 1
        self._sxy: Array = np.zeros((2, self._lags))
        self._sxx: Array = np.zeros(2)
        self._syy: Array = np.zeros(2)
        self._seen = 0.0
        self._since_verdict = 0.0
        self._x: list[Array] = []  # since the last gap, (k, 2) each
        self._y: list[Array] = []

    def gap(self) -> None:
        """Ticks are missing: no lag reaches across."""
        if len(self._x) > 1:
            self._work_off()
        self._x.clear()
        self._y.clear()

    def feed(self, dt: Array, x: Array, y: Array) -> bool:
        """Take k ticks of high-passed predicted x and measured y (k, 2) [rad/s²].

        Return whether `shift` moved.
        """
        c = self.config
        usual = sorted(dt.tolist())[len(dt) // 2]
        if not 0.6 < usual / self._tick < 1.6:
            if self._seen > 0.0 and usual > self._tick:
                self.gap()
                return False
            self._start_over(usual)
        if dt.min() <= 0.6 * self._tick or dt.max() >= 1.6 * self._tick:
            self.gap()
            return False
        self._x.append(x)
        self._y.append(y)
        self._since_verdict += float(np.add.reduce(dt))
        if self._since_verdict < c.every:
            return False
        self._work_off()
        return self._verdict()

    def _work_off(self) -> None:
        """Take what was gathered since the last gap or verdict into the sums."""
        x, y = np.concatenate(self._x), np.concatenate(self._y)
        lags = self._lags
        count = len(x) - lags + 1
        if count > 0:
            last = lags - 1 - self._ahead
            windows = sliding_window_view(x, lags, axis=0)  # (count, 2, lags), newest x last
            middle = x[last : last + count]
            past = y[last : last + count]  # has `ahead` later x in each window
            keep = math.exp(-count * self._tick / self.config.memory)
            self._sxy = keep * self._sxy + (windows * past[:, :, None]).sum(axis=0)
            self._sxx = keep * self._sxx + (middle * middle).sum(axis=0)
            self._syy = keep * self._syy + (past * past).sum(axis=0)
            self._seen += count * self._tick
        self._x, self._y = [x[max(count, 0) :]], [y[max(count, 0) :]]

    def _verdict(self) -> bool:
        c = self.config
        self._since_verdict = 0.0
        if self._seen < c.settle or min(self._sxx.min(), self._syy.min()) <= 0.0:
            return False
        share = np.maximum(self._sxy.T, 0.0) ** 2 / (self._sxx * self._syy)
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
