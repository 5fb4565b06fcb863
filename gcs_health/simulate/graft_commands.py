"""Motor outputs that go with edited rotor speeds, by what the recording itself shows of the two.

Over 0.3 s means, which the motor's lag does not blur, an output is close to a straight line of speed
(R² .93 .. .97 on the flights of sheet 5). Where this flight shows none, the commands stay as recorded.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.simulate.recording import Flown

Array = NDArray[np.float64]
MEAN = 0.3  # s
LEAST_R2, LEAST_MEANS = 0.8, 20
TURNING = 0.2  # of the usual speed
SERVO_OUTPUT_RAW = 36


@dataclass(frozen=True)
class Commands:
    """How one output message follows the rotors: `slope` in its unit per rad/s, `top` its full scale."""

    slope: float
    top: float

    def fields(self, fields: dict[str, object], message: int, channel: int, change: float) -> None:
        """Change the output `channel`, from 0, of a message's fields as for `change` of speed [rad/s]."""
        if message == SERVO_OUTPUT_RAW:
            name = f"servo{channel + 1}_raw"
            before = fields.get(name)
            if isinstance(before, int) and before:
                fields[name] = round(self._moved(before, change))
            return
        values = fields.get("actuator")
        if isinstance(values, list) and channel < len(values):
            values[channel] = self._moved(values[channel], change)

    def _moved(self, before: float, change: float) -> float:
        # an output already beyond its scale stays there
        return min(before + self.slope * change, max(self.top, before))


def learned(flown: Flown) -> dict[int, Commands]:
    """Return how each output message of a flight follows its rotors, of those that do."""
    out = {}
    for message, (t, raw) in flown.outputs.items():
        inside = (t > flown.rotor_t[0]) & (t < flown.rotor_t[-1]) & np.isfinite(raw).all(axis=1)
        fit = _line(t[inside], raw[inside], flown) if inside.any() else None
        if fit is not None:
            out[message] = Commands(fit, _top(float(np.nanmax(raw))))
    return out


def _line(t: Array, raw: Array, flown: Flown) -> float | None:
    """Return the slope of output over speed, all rotors together; None if they are not on a line."""
    _, block = np.unique(((t - t[0]) / MEAN).astype(np.int64), return_inverse=True)
    count = np.bincount(block)
    speed, output = (
        np.array([np.bincount(block, column) / count for column in columns])
        for columns in ([np.interp(t, flown.rotor_t, w) for w in flown.speed.T], raw.T)
    )
    turning = (speed > TURNING * np.median(flown.speed)).all(axis=0)
    if turning.sum() < LEAST_MEANS:
        return None
    x, y = speed[:, turning].ravel(), output[:, turning].ravel()
    x, y = x - x.mean(), y - y.mean()
    xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
    if xx <= 0.0 or yy <= 0.0 or xy <= 0.0 or xy * xy < LEAST_R2 * xx * yy:
        return None
    return xy / xx


def _top(largest: float) -> float:
    """Return full scale of the unit: 0..1, UAVCAN raw, PWM µs or DShot, as rotor_telemetry tells them."""
    if largest <= 1.001:
        return 1.0
    return 8191.0 if largest > 2200.0 else 2000.0
