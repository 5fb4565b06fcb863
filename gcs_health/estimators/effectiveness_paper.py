"""Paper-exact mode: Strack van Schijndel et al. (2023), as the authors' released code has it.

In the paper's order:
    low-pass   H(s) = wn² / (s² + 2 zeta wn s + wn²) on p, q, a_z and every rotor speed
    (10)       dOmega_f/dt, backward difference of the filtered rates; the first one is 0
    (11)       x = k, effectiveness of each rotor
    (12)       H = omega_f² times the columns of the geometry, rows p, q, a_z
    Alg. 1     P + Q, gain, x + K y clamped to [0, 1.5], P
    (15)       P_fail = P(k < k_thr) = 1/2 [1 + erf((k_thr - k) / (sigma sqrt 2))]
    (16)       failed where P_fail > P_thr

Departures from the print, each proved in sheet 1: (15) prints "1 -" and sigma² where the left tail and
sigma belong; Q is .01 a step; steps are 1/500 s whatever the stamps; x starts at 1, P at 3 I; the
filter is armed once the mean rotor speed exceeds 700 rad/s; a rotor is cleared when P(k > k_thr) > .9.

Source: doi 10.1109/ICUAS57906.2023.10156464; SihaoSun/INDI_Quadrotor_FTC; sheet 1 section 12.
"""

import math
from dataclasses import dataclass, replace

from gcs_health.airframe import Airframe
from gcs_health.estimators import kalman
from gcs_health.estimators.ticks import FASTEST, plausible
from gcs_health.samples import ImuReading, RotorReading


@dataclass(frozen=True, slots=True)
class PaperConfig:
    """Table II as the released code has it. None in a gain: the airframe's, else the paper's."""

    roll: float | None = None  # G_p [(rad/s²)/(rad/s)²]
    pitch: float | None = None  # G_q
    thrust: float | None = None  # G_az [(m/s²)/(rad/s)²]
    Q: float = 0.01  # added per step
    R: float = 1.0  # (rad/s²)², (m/s²)²
    P0: float = 3.0
    k_threshold: float = 0.25
    p_threshold: float = 0.9
    p_clear: float = 0.9
    clamp: tuple[float, float] = (0.0, 1.5)
    natural_frequency: float = 50.0  # rad/s
    damping: float = 0.55
    step: float = 0.002  # s
    arm_speed: float = 700.0  # rad/s, mean of the rotors
    exact_rates: tuple[float, float] = (350.0, 700.0)  # Hz; outside, steps and Q follow the stamps
    # two remedies that are not the paper's, off by default (sheet 1, sections 5 and 8)
    variance_cap: float = math.inf  # of P_ii; bounds what the null direction (+, -, +, -) / u lets grow
    single_fault_check: bool = False  # the one rotor whose loss explains the residual best is the one to name


PAPER_GAINS = (100e-6, 100e-6, 5e-6)


def parameter_sets() -> dict[str, PaperConfig]:
    """Return the 19 sets of the paper's sensitivity analysis: the base, and one change at a time."""
    base = PaperConfig(roll=100e-6, pitch=100e-6, thrust=5e-6)
    sets = {"base": base}
    for value in (80e-6, 120e-6):
        sets[f"G_p {value:.0e}"] = replace(base, roll=value)
        sets[f"G_q {value:.0e}"] = replace(base, pitch=value)
    for value in (4e-6, 6e-6):
        sets[f"G_az {value:.0e}"] = replace(base, thrust=value)
    for value in (0.0025, 0.005, 0.02, 0.04):
        sets[f"Q {value}"] = replace(base, Q=value)
    for value in (0.15, 0.20, 0.30, 0.35):
        sets[f"k_thr {value}"] = replace(base, k_threshold=value)
    for value in (0.86, 0.88, 0.92, 0.94):
        sets[f"P_thr {value}"] = replace(base, p_threshold=value)
    return sets


class LowPass:
    """Exact discretisation of H(s) for an input held over each step; many channels at once."""

    def __init__(self, channels: int, natural_frequency: float, damping: float) -> None:
        self.wn = natural_frequency
        self.damping = damping
        self.value = [0.0] * channels
        self.rate = [0.0] * channels
        self._step = math.nan
        self._coefficients = (0.0, 0.0, 0.0, 0.0)
        self.started = False

    def feed(self, inputs: list[float], step: float) -> list[float]:
        """Advance every channel by `step` s with its input held; returns the filtered values."""
        if not self.started:
            self.value = list(inputs)
            self.started = True
        if step != self._step:
            self._discretise(step)
        a, b, c, d = self._coefficients
        value, rate = self.value, self.rate
        for k, held in enumerate(inputs):
            y = value[k] - held
            v = rate[k]
            value[k] = held + a * y + b * v
            rate[k] = c * y + d * v
        return value

    def _discretise(self, dt: float) -> None:
        a = self.damping * self.wn
        w = self.wn * math.sqrt(1.0 - self.damping**2)
        e = math.exp(-a * dt)
        cos, sin = math.cos(w * dt), math.sin(w * dt)
        self._coefficients = (
            e * (cos + a / w * sin),
            e * sin / w,
            -e * self.wn**2 / w * sin,
            e * (cos - a / w * sin),
        )
        self._step = dt


class PaperFilter:
    """Algorithm 1 on a stream. An IMU message waits for rotor speeds of the same stamp, no longer."""

    def __init__(self, airframe: Airframe, config: PaperConfig) -> None:
        self.config = config
        rotors = airframe.rotors
        self.rotors = len(rotors)
        given = airframe.effectiveness
        roll = config.roll or given.roll or PAPER_GAINS[0]
        pitch = config.pitch or given.pitch or PAPER_GAINS[1]
        self.thrust = config.thrust or given.thrust or PAPER_GAINS[2]
        reach_x = max(abs(rotor.position[0]) for rotor in rotors) or 1.0
        reach_y = max(abs(rotor.position[1]) for rotor in rotors) or 1.0
        self.roll = [-roll * rotor.position[1] / reach_y for rotor in rotors]
        self.pitch = [pitch * rotor.position[0] / reach_x for rotor in rotors]
        n = self.rotors
        self.x = [1.0] * n
        self.P = [[config.P0 if i == j else 0.0 for j in range(n)] for i in range(n)]
        self.armed = False
        self.failed: int | None = None
        self.steps = 0  # of the armed filter
        self._filter = LowPass(3 + n, config.natural_frequency, config.damping)
        self._speeds = [math.nan] * n
        self._stamps = [-math.inf] * n
        self._waiting: ImuReading | None = None
        self._rates: tuple[float, float] | None = None
        self._last_t = -math.inf
        self._usual_step = config.step

    def imu(self, reading: ImuReading) -> bool:
        """Take one message; return whether the failed rotor changed."""
        changed = self._run() if self._waiting is not None else False
        t = reading.t
        if t > self._last_t and plausible(reading):
            self._waiting = reading
            if min(self._stamps) >= t:
                changed = self._run() or changed
        return changed

    def rotor_speeds(self, reading: RotorReading) -> bool:
        """Take one reading; return whether the failed rotor changed."""
        changed = False
        if self._waiting is not None and reading.t > self._waiting.t:
            changed = self._run()
        for i, speed in enumerate(reading.speed[: self.rotors]):
            if -FASTEST < speed < FASTEST:
                self._speeds[i] = speed
                self._stamps[i] = reading.t
        if self._waiting is not None and min(self._stamps) >= self._waiting.t:
            changed = self._run() or changed
        return changed

    def failure_probability(self, rotor: int) -> float:
        """(15), left tail."""
        sigma = math.sqrt(max(self.P[rotor][rotor], 1e-12))
        z = (self.config.k_threshold - self.x[rotor]) / (sigma * math.sqrt(2.0))
        return 0.5 * (1.0 + math.erf(z))

    def std(self, rotor: int) -> float:
        """(14), square root of the variance."""
        return math.sqrt(max(self.P[rotor][rotor], 0.0))

    def _run(self) -> bool:
        reading = self._waiting
        self._waiting = None
        if reading is None or not all(speed == speed for speed in self._speeds):
            return False
        c = self.config
        step, share = self._step_of(reading.t)
        was = self._rates
        filtered = self._filter.feed([reading.p, reading.q, reading.az, *self._speeds], step)
        p, q, az = filtered[:3]
        self._rates = (p, q)
        speeds = filtered[3:]
        if not self.armed:
            self.armed = sum(speeds) / self.rotors > c.arm_speed
            if not self.armed:
                return False
        roll, pitch = ((p - was[0]) / step, (q - was[1]) / step) if was else (0.0, 0.0)
        z = (roll, pitch, az)
        self._update(speeds, z, c.Q * share)
        return self._decide(self._single_fault(speeds, z) if c.single_fault_check else None)

    def _step_of(self, t: float) -> tuple[float, float]:
        """Return the step [s] and the share of Q: the authors' own at their rate, else from the stamps."""
        c = self.config
        dt = t - self._last_t
        self._last_t = t
        if dt < math.inf:
            clipped = min(max(dt, 0.5 * self._usual_step), 2.0 * self._usual_step)
            self._usual_step += 0.05 * (clipped - self._usual_step)
        low, high = c.exact_rates
        if dt == math.inf or low <= 1.0 / self._usual_step <= high:
            return c.step, 1.0
        return dt, min(dt / c.step, 500.0)

    def _update(self, speeds: list[float], z: tuple[float, float, float], q: float) -> None:
        x = self.x
        P = [list(row) for row in self.P]
        for i in range(self.rotors):
            P[i][i] += q
        for value, h in zip(z, self._rows(speeds), strict=True):
            x, P, _, _ = kalman.update_scalar(x, P, value, h, self.config.R)
        low, high = self.config.clamp
        self.x = [min(max(value, low), high) for value in x]
        self.P = P if self.config.variance_cap == math.inf else _capped(P, self.config.variance_cap)
        self.steps += 1

    def _rows(self, speeds: list[float]) -> tuple[list[float], ...]:
        """H of (12)."""
        u = [speed * speed for speed in speeds]
        return (
            [g * v for g, v in zip(self.roll, u, strict=True)],
            [g * v for g, v in zip(self.pitch, u, strict=True)],
            [-self.thrust * v for v in u],
        )

    def _single_fault(self, speeds: list[float], z: tuple[float, float, float]) -> int:
        """Return the rotor whose loss alone leaves least of z - H 1; R is the same for all rows."""
        rows = self._rows(speeds)
        lack = [sum(h) - value for value, h in zip(z, rows, strict=True)]
        explained = []
        for i in range(self.rotors):
            along = sum(value * h[i] for value, h in zip(lack, rows, strict=True))
            explained.append(max(along, 0.0) ** 2 / max(sum(h[i] * h[i] for h in rows), 1e-12))
        return max(range(self.rotors), key=explained.__getitem__)

    def _decide(self, alone: int | None) -> bool:
        """(16); `alone`: the one rotor that may be named, None = the one with the largest P_fail."""
        c = self.config
        probabilities = [self.failure_probability(i) for i in range(self.rotors)]
        worst = max(range(self.rotors), key=probabilities.__getitem__) if alone is None else alone
        was = self.failed
        if probabilities[worst] > c.p_threshold and (
            was is None or probabilities[worst] > probabilities[was]
        ):
            self.failed = worst
        elif was is not None and 1.0 - probabilities[was] > c.p_clear:
            self.failed = None
        return self.failed != was


def _capped(P: list[list[float]], cap: float) -> list[list[float]]:
    """Scale the rows and columns whose variance exceeds `cap`; correlations stay."""
    scale = [math.sqrt(min(1.0, cap / max(P[i][i], 1e-12))) for i in range(len(P))]
    return [
        [value * a * b for value, b in zip(row, scale, strict=True)] for row, a in zip(P, scale, strict=True)
    ]
