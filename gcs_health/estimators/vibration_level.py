"""Without rotor speeds: how much it shakes against its own healthy self, and whose command moves with the line.

No threshold in m/s² carries over from craft to craft, and no rotor follows from a level: only the ratio to the
baseline of the same configuration does. A rotor is named only where the frequency of the strongest line follows
one rotor's command (through the motors' first-order lag) and no other's. Spin from the line's direction of
turning is not usable: on real frames the wrong side wins as often.

Source: sheet 5 section 5 (ratios 1.8 and 3, r > 0.7, lead > 0.2); paper eq. (23) for the lag.
"""

import math
from collections import deque

import numpy as np

from gcs_health.estimators.amplitude_model import Array
from gcs_health.estimators.unbalance_config import Baseline, LevelConfig

NAN = math.nan
MOST_SAMPLES = 4096


class VibrationLevel:
    """Level above the corner, VIBRATION and the strongest line, in blocks of a second.

    Attributes
    ----------
    rate : of the IMU in the last block [Hz].
    """

    def __init__(self, rotors: int, config: LevelConfig) -> None:
        self.config = config
        self.rate = NAN
        self._levels: deque[float] = deque(maxlen=config.flight)
        self._vibration: deque[float] = deque(maxlen=config.flight)
        self._lines: deque[tuple[float, ...]] = deque(maxlen=config.window)  # frequency, commands
        self._commands: deque[float] = deque(maxlen=config.flight)
        self._t: list[float] = []
        self._a: list[complex] = []
        self._end = NAN
        self._vibration_sum, self._vibration_count, self._vibration_end = 0.0, 0, NAN
        self._command = [NAN] * rotors
        self._lag = [NAN] * rotors
        self._command_t = NAN
        self._sum, self._count = [0.0] * rotors, 0

    def imu(self, t: float, ax: float, ay: float, flying: bool) -> None:
        """Take one sample."""
        if not t < self._end + self.config.block or len(self._t) > MOST_SAMPLES:
            self._restart(t)
        elif t >= self._end:
            if flying:
                self._block()
            self._restart(self._end)
        self._t.append(t)
        self._a.append(complex(ax, ay))

    def commands(self, t: float, command: tuple[float, ...]) -> None:
        """Take commands [-]; each is followed with the motors' lag."""
        dt = t - self._command_t
        share = 1.0 - math.exp(-dt / self.config.motor_lag) if dt > 0.0 else 0.0
        self._command_t = t
        for i, value in enumerate(command[: len(self._command)]):
            if self._lag[i] != self._lag[i]:
                self._lag[i] = value
            elif self._command[i] == self._command[i]:
                self._lag[i] += share * (self._command[i] - self._lag[i])
            if value == value:
                self._command[i] = value
            self._sum[i] += self._lag[i]
        self._count += 1

    def vibration(self, t: float, x: float, y: float, flying: bool) -> None:
        """Take the autopilot's own level; means over a block count."""
        level = math.hypot(x, y)
        if not level < 1e4 or not flying:
            return
        if not t < self._vibration_end:
            if self._vibration_count:
                self._vibration.append(self._vibration_sum / self._vibration_count)
            self._vibration_sum, self._vibration_count = 0.0, 0
            self._vibration_end = t + self.config.block
        self._vibration_sum += level
        self._vibration_count += 1

    def forget(self) -> None:
        """Another flight."""
        for past in (self._levels, self._vibration, self._lines, self._commands):
            past.clear()

    def commanded(self, blocks: int) -> float:
        """Return the mean command over the last blocks [-]; NaN without any."""
        return float(np.mean(list(self._commands)[-blocks:])) if self._commands else NAN

    def level(self, blocks: int) -> float:
        """Return the horizontal level above the corner over the last blocks, rms [m/s²]; NaN while unknown."""
        return self._median(self._levels, blocks)

    def autopilots(self, blocks: int) -> float:
        """Return the horizontal VIBRATION over the last blocks [m/s²]; NaN while unknown."""
        return self._median(self._vibration, blocks)

    def excess(self, baseline: Baseline) -> tuple[float, float]:
        """Return the largest ratio to the baseline, and log odds of a damaged propeller; NaN = not known."""
        c = self.config
        best = (NAN, NAN)
        known = self.commanded(c.window)
        if (
            baseline.command == baseline.command
            and abs(known - baseline.command) > c.another * baseline.command
        ):
            return best
        for now, then, limit in (
            (self.level(c.window), baseline.level, c.ratio),
            (self.autopilots(c.window), baseline.vibration, c.vibration_ratio),
        ):
            if now == now and then > 0.0:
                odds = math.log(9.0) + math.log(max(now / then, 1e-9) / limit) / c.spread
                if not odds < best[1]:
                    best = (now / then, odds)
        return best

    def follower(self) -> tuple[int, float, float]:
        """Return the rotor whose command moves with the strongest line (-1 = none), its r and its lead."""
        c = self.config
        if len(self._lines) < c.least:
            return -1, NAN, NAN
        rows = np.array(self._lines)
        line, command = rows[:, 0], rows[:, 1:]
        if not np.isfinite(rows).all():
            return -1, NAN, NAN
        moves = command.std(axis=0)
        if line.std() <= 0.0 or moves.min() < c.least_moves * command.mean():
            return -1, NAN, NAN
        r = (command - command.mean(axis=0)).T @ (line - line.mean()) / (len(line) * moves * line.std())
        b = int(np.argmax(r))
        lead = float(r[b] - np.delete(r, b).max())
        return (b if r[b] > c.correlation and lead > c.lead else -1), float(r[b]), lead

    def _median(self, past: deque[float], blocks: int) -> float:
        return float(np.median(list(past)[-blocks:])) if len(past) >= self.config.least else NAN

    def _restart(self, start: float) -> None:
        self._t.clear()
        self._a.clear()
        self._end = start + self.config.block
        self._sum, self._count = [0.0] * len(self._sum), 0

    def _block(self) -> None:
        """Take the block's power above the corner, both directions of turning, and its strongest line."""
        count = len(self._t)
        if count < 8:
            self.rate = count / self.config.block
            return
        step = (self._t[-1] - self._t[0]) / (count - 1)
        self.rate = 1.0 / step
        mean_command = [total / self._count if self._count else NAN for total in self._sum]
        if self._count:
            self._commands.append(float(np.mean(mean_command)))
            if not min(mean_command) > self.config.least_command:
                return
        frequency = np.abs(np.fft.fftfreq(count, step))
        above = frequency > self.config.corner
        if self.rate < 2.2 * self.config.corner or not above.any():
            return
        a = np.array(self._a)
        hann = np.hanning(count)
        spectrum = np.fft.fft((a - a.mean()) * hann)
        power: Array = spectrum.real**2 + spectrum.imag**2
        # Parseval; the factor gives back what the window took from the power
        self._levels.append(math.sqrt(float(power[above].sum()) / (count * float(hann @ hann))))
        half = (count - 1) // 2
        both = power[1 : half + 1] + power[-1 : -half - 1 : -1]
        both[frequency[1 : half + 1] <= self.config.corner] = 0.0
        self._lines.append((_peak(both) / (count * step), *mean_command))


def _peak(power: Array) -> float:
    """Return where the largest bin lies, between bins by a parabola; bin 0 is frequency 1."""
    k = int(np.argmax(power))
    if 0 < k < len(power) - 1:
        left, top, right = np.sqrt(power[k - 1 : k + 2])
        bend = left - 2.0 * top + right
        if bend < 0.0:
            return k + 1.0 + 0.5 * float((left - right) / bend)
    return k + 1.0
