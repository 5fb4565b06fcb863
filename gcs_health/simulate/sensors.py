"""What the autopilot's sensors make of the truth: IMU and ESCs, noise and filters included.

Accelerometer, body axes, at the IMU's lever arm r:

    f + W' x r + W x (W x r)  +  sum over rotors (m_u r_u w² / m) (cos th, s sin th, 0)     unbalance
                              +  share of lift at cos 2 th, vertical                        blade pass
                              +  bias + noise, clipped to the range

PX4 publishes the mean over 1 / IMU_INTEG_RATE (HIGHRES_IMU takes the newest); ArduPilot low-passes with two
poles (INS_ACCEL_FILTER, INS_GYRO_FILTER). Source: mavlink.md section 5; sheet 2 section 5.
"""

import math
from collections import deque
from dataclasses import dataclass
from operator import add
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.simulate.arithmetic import Arithmetic, Value
from gcs_health.simulate.plant import Plant

BLOCK = 512  # random numbers drawn at once


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """How good the sensors are; SI.

    imu_integration_rate : PX4's IMU_INTEG_RATE [Hz]. imu_filter : ArduPilot's cut-off [Hz].
    accelerometer_noise, gyro_noise : standard deviation of one raw sample [m/s²], [rad/s].
    accelerometer_bias, gyro_bias : standard deviation over flights.
    accelerometer_range, gyro_range : where it clips.
    residual_unbalance : usual acceleration of a healthy propeller at hover speed [m/s²].
    esc_rate : how often an ESC is read [Hz]. esc_sequential : one after another, as serial telemetry is.
    esc_latency [s]; esc_rpm_step [rpm]; esc_current : "motor" or "battery" side; esc_current_noise [A];
    esc_current_step [A]. esc_dropouts : how often each ESC is not heard for a moment [1/min], for
    esc_dropout_length [s] on average; what is sent meanwhile is the autopilot's habit (zeros, or what it heard last).
    """

    imu_integration_rate: float = 200.0
    imu_filter: float = 20.0
    accelerometer_noise: float = 0.35
    gyro_noise: float = 0.012
    accelerometer_bias: float = 0.05
    gyro_bias: float = 0.002
    accelerometer_range: float = 157.0
    gyro_range: float = 34.9
    residual_unbalance: float = 0.15
    esc_rate: float = 100.0
    esc_sequential: bool = False
    esc_latency: float = 0.006
    esc_rpm_step: float = 10.0
    esc_current: str = "motor"
    esc_current_noise: float = 0.1
    esc_current_step: float = 0.01
    esc_dropouts: float = 0.0
    esc_dropout_length: float = 0.5


class Noise:
    """Normal numbers in blocks, a float each or a column of flights; `sigma` of each number of a row.

    `bias` (numbers, flights) is added to every row.
    """

    def __init__(
        self, rngs: list[np.random.Generator], sigma: list[float], bias: NDArray[np.float64] | None = None
    ) -> None:
        self._rngs = rngs
        self._sigma = np.array(sigma)
        self._bias = np.zeros((len(sigma), len(rngs))) if bias is None else bias
        self._rows: list[list[Value]] = []
        self._at = 0

    def __call__(self) -> list[Value]:
        """Return the next row."""
        if self._at == len(self._rows):
            size = (BLOCK, len(self._sigma))
            drawn = np.stack([rng.standard_normal(size) * self._sigma for rng in self._rngs], axis=2)
            drawn += self._bias
            self._rows = [list(row) for row in drawn] if len(self._rngs) > 1 else drawn[:, :, 0].tolist()
            self._at = 0
        row = self._rows[self._at]
        self._at += 1
        return row


class ImuSample(NamedTuple):
    """One published value: time [s], specific force [m/s²], rates [rad/s]."""

    t: float
    values: list[Value]  # ax, ay, az, p, q, r


class Imu:
    """Sampled with every physics step; `latest` is what the autopilot would send now, `gyro` is raw."""

    def __init__(
        self,
        config: SensorConfig,
        ops: Arithmetic,
        rngs: list[np.random.Generator],
        step: float,
        ardupilot: bool,
    ) -> None:
        self._ops = ops
        spread = np.array([config.accelerometer_bias] * 3 + [config.gyro_bias] * 3)
        bias = np.stack([rng.standard_normal(6) * spread for rng in rngs], axis=1)
        self._noise = Noise(rngs, [config.accelerometer_noise] * 3 + [config.gyro_noise] * 3, bias)
        self._ranges = config.accelerometer_range, config.gyro_range
        self._block = max(1, round(1.0 / (config.imu_integration_rate * step)))
        self._step = step
        self._poles = _two_poles(config.imu_filter, step) if ardupilot else None
        self._bias = _values(bias)
        self._history: list[tuple[Value, Value]] = [(b * 0.0, b * 0.0) for b in self._bias]
        self._sums: list[Value] = []  # of this interval, from its `_count` samples
        self._count = 0
        self.gyro: list[Value] = self._bias[3:]
        self.latest = ImuSample(0.0, [b * 0.0 for b in self._bias])

    def sample(self, t: float, plant: Plant) -> bool:
        """Take the plant as it is at t [s]; return whether `latest` is new."""
        raw = self._raw(plant)
        self.gyro = raw[3:]
        if self._poles is not None:
            self.latest = ImuSample(t, self._low_pass(raw))
            return True
        self._sums = list(map(add, self._sums, raw)) if self._count else raw
        self._count += 1
        if self._count < self._block:
            return False
        share = 1.0 / self._count
        # the mean belongs to the middle of its interval; autopilots stamp its end
        self.latest = ImuSample(t, [share * value for value in self._sums])
        self._count = 0
        return True

    def _raw(self, plant: Plant) -> list[Value]:
        p, q, r = plant.rates
        ax, ay, az = plant.specific_force
        if plant.levered:
            lx, ly, lz = self._levered(plant)
            ax, ay, az = ax + lx, ay + ly, az + lz
        cos, sin, clip3 = self._ops.cos, self._ops.sin, self._ops.clip3
        ahead = aside = beat = 0.0  # forces of unbalance [N], and half of the blade passes' over their share
        for rotor in plant.rotors:
            phase, w = rotor.phase, rotor.w
            c = cos(phase)
            shake = rotor.imbalance * w * w
            ahead = ahead + shake * c
            # counter-clockwise from above is about -z: from x towards -y
            aside = aside - rotor.spin * shake * sin(phase)
            beat = beat + rotor.lift * (c * c - 0.5)
        share = 1.0 / plant.mass
        ax, ay = ax + share * ahead, ay + share * aside
        az = az - 2.0 * plant.vehicle.motor.blade_pass * share * beat
        bx, by, bz, bp, bq, br = self._noise()
        most, fastest = self._ranges
        return clip3(ax + bx, ay + by, az + bz, most) + clip3(p + bp, q + bq, r + br, fastest)

    @staticmethod
    def _levered(plant: Plant) -> tuple[Value, Value, Value]:
        """Return W' x r + W x (W x r) at the IMU's place."""
        p, q, r = plant.rates
        dp, dq, dr = plant.turning
        x, y, z = plant.lever
        return (
            dq * z - dr * y + q * (p * y - q * x) - r * (r * x - p * z),
            dr * x - dp * z + r * (q * z - r * y) - p * (p * y - q * x),
            dp * y - dq * x + p * (r * x - p * z) - q * (q * z - r * y),
        )

    def _low_pass(self, raw: list[Value]) -> list[Value]:
        assert self._poles is not None
        b0, b1, b2, a1, a2 = self._poles
        out = []
        for k, value in enumerate(raw):  # transposed direct form II
            one, two = self._history[k]
            filtered = b0 * value + one
            self._history[k] = (b1 * value - a1 * filtered + two, b2 * value - a2 * filtered)
            out.append(filtered)
        return out


def _two_poles(cutoff: float, step: float) -> tuple[float, float, float, float, float]:
    """Return b0, b1, b2, a1, a2 of ArduPilot's LowPassFilter2p: a Butterworth of second order."""
    w = math.tan(math.pi * cutoff * step)
    c = 1.0 + 2.0 * math.cos(math.pi / 4.0) * w + w * w
    b0 = w * w / c
    return b0, 2.0 * b0, b0, 2.0 * (w * w - 1.0) / c, (1.0 - 2.0 * math.cos(math.pi / 4.0) * w + w * w) / c


class EscSample(NamedTuple):
    """One ESC read: time of the measurement [s], speed [rpm], V, A, deg C."""

    t: float
    rpm: Value
    voltage: Value
    current: Value
    temperature: Value


class Escs:
    """Reads every ESC at its rate; `known` is what has arrived, oldest delays included.

    In one flight the ESCs hold their samples for the latency; in columns too, since the times are common.
    """

    def __init__(
        self, config: SensorConfig, ops: Arithmetic, rngs: list[np.random.Generator], count: int
    ) -> None:
        self._config = config
        self._ops = ops
        self._noise = Noise(rngs, [config.esc_current_noise] * count)
        self._next = 0.0  # nothing is read, and nothing arrives, before
        self._period = 1.0 / config.esc_rate
        lag = self._period / count if config.esc_sequential else 0.0
        self._due = [k * lag for k in range(count)]
        self._coming: list[deque[EscSample]] = [deque() for _ in range(count)]
        self._heat: list[Value] = [25.0] * count
        self.known: list[EscSample | None] = [None] * count
        self.packets = [0] * count

    def sample(self, t: float, plant: Plant) -> None:
        """Read the ESCs that are due at t [s], and take what has arrived by then."""
        if t < self._next:
            return
        chances = self._noise() if t >= min(self._due) else []
        for k in range(len(self._due)):
            if t >= self._due[k]:
                self._due[k] += self._period
                self._coming[k].append(self._read(t, k, plant, chances[k]))
            coming = self._coming[k]
            while coming and coming[0].t + self._config.esc_latency <= t:
                self.known[k] = coming.popleft()
                self.packets[k] += 1
        arriving = [coming[0].t + self._config.esc_latency for coming in self._coming if coming]
        self._next = min(*self._due, *arriving)

    def _read(self, t: float, k: int, plant: Plant, chance: Value) -> EscSample:
        c, rotor = self._config, plant.rotors[k]
        rpm = self._ops.rint(rotor.w * (30.0 / math.pi) / c.esc_rpm_step) * c.esc_rpm_step
        current = rotor.current
        if c.esc_current == "battery":
            m = plant.vehicle.motor
            current = current * (m.resistance * current + m.torque_constant * rotor.w) / plant.bus
        warming = 0.02 * rotor.current * rotor.current - 0.05 * (self._heat[k] - 25.0)
        self._heat[k] = self._heat[k] + self._period * warming
        current = self._ops.rint((current + chance) / c.esc_current_step) * c.esc_current_step
        return EscSample(t, rpm, plant.bus, current, self._heat[k])


def _values(columns: np.ndarray) -> list[Value]:
    """Return rows as columns, or as floats where there is one flight."""
    return list(columns) if columns.shape[1] > 1 else columns[:, 0].tolist()
