"""What is left of one propeller's drag, from the balance of torques over intervals; and whether it is gone.

Divided by the torque constant everything is in amperes, so that ratios need no torque constant:

    i     motor current [A]                        a = kappa_tau / kappa_q   drag     [A s²]
    w     rotor speed [rad/s]                      f = kappa_f / kappa_q     friction [A s]
    eta   what is left of the drag, 1 healthy      c = J / kappa_q           inertia  [A s²]

    c w' = i - a eta w² - f w                                                                      (5), (8)

Over an interval from (t0, w0) to (t1, w1), with the mean current I from all samples in it:

    m = I - f (w0 + w1)/2 - c (w1 - w0)/dt      what drives the drag
    h = a (w0² + w0 w1 + w1²)/3                 what it would be at eta = 1
    m = eta h + noise of variance S             a scalar Kalman filter, one quick and one for slow damage

A lost propeller is tested sequentially: r0 = m - b h if healthy (b: the rotor's own baseline), r1 = max(m, 0)
if lost, both heavy-tailed, since manoeuvres and wind leave outliers.

Source: Melczer (2019), eqs. (5), (8); sheet 3, recommended mode, steps 3 to 6.
"""

import math
from bisect import bisect_left
from dataclasses import dataclass
from itertools import pairwise

STUDENT = 5.0  # degrees of freedom of the residuals' tails; the exponent (5 + 1)/2 is 3


@dataclass(frozen=True, slots=True)
class BalanceConfig:
    """Figures of the balance and of the sequential test; sheet 3 unless said otherwise."""

    interval: float = 0.010  # s, the shortest; faster samples are joined
    gap: float = 0.5  # s without a sample after which the balance starts anew
    current_noise: float = 0.2  # A
    speed_noise: float = 0.5  # rad/s, without the step of the telemetry
    inertia_error: float = 0.3  # share of the inertial current, once flight has taught the inertia
    inertia_unproven: float = 1.0  # before: the vehicle file may have half of it; this project
    drag_error: float = 0.12  # share of the drag: wind and what else is not modelled
    quick: float = 0.3  # 1/s, how fast eta may wander
    slow: float = 0.02  # 1/s, for slow damage
    slow_inertial: float = 0.3  # share of the drag, above which an interval tells nothing slow; this project
    baseline_time: float = 8.0  # s
    baseline_range: tuple[float, float] = (0.7, 1.3)
    scale_time: float = 5.0  # s
    scale_range: tuple[float, float] = (1.0, 6.0)
    pull: float = 0.15  # off every step of the log-likelihood ratio
    pull_above: float = 0.45  # where the drag is more than healthy
    suspicion: float = 2.0  # log-likelihood ratio from which baseline and scale are not learned
    outlier: float = 9.0  # r0² / (c S), likewise
    freeze_at_most: float = 2.0  # s on end without an alarm; this project
    single_from: float = 0.05  # s; intervals as long as that take the single reading into account
    no_load_noise: float = 0.7  # A
    single_range: tuple[float, float] = (-6.0, 3.0)
    # alarm above, by interval [s]: measured in benchmarks/motor_observer.md
    thresholds: tuple[tuple[float, float], ...] = ((0.010, 7.0), (0.020, 10.0), (0.050, 9.0), (0.100, 5.0))
    cap: float = 4.0  # the ratio stops growing so far above the threshold; this project
    clear_after: float = 1.0  # s with a ratio of 0 until a lost propeller is taken back; this project

    def threshold(self, interval: float) -> float:
        """Return the log-likelihood ratio that raises an alarm at the usual interval [s]."""
        rows = self.thresholds
        if not interval > rows[0][0]:
            return rows[0][1]
        for (low, first), (high, second) in pairwise(rows):
            if interval <= high:
                return first + (second - first) * (interval - low) / (high - low)
        return rows[-1][1]


@dataclass(slots=True)
class Constants:
    """Motor and propeller in amperes: a [A s²], f [A s], c [A s²]; a NaN = not yet known."""

    a: float = math.nan
    f: float = 0.0
    c: float = 0.0


class RotorBalance:
    """Balance, filters and test of one rotor.

    Attributes
    ----------
    eta, variance : quick estimate of what is left of the drag and its variance, before the reference.
    slow, slow_variance : the estimate for slow damage.
    baseline : b, the healthy level that the test believes in. scale : c, what the noise model is short of.
    llr : the sequential log-likelihood ratio. lost : whether it has raised an alarm.
    learned : time spent learning [s]. reference : eta when learning ended, NaN before.
    current_noise : of one sample [A]. full : w² from which an interval counts for slow damage [rad²/s²].
    inertia_error : share of the inertial current that may be wrong.
    rows : the latest intervals for `motor_identification`: mean w², mean w, w', mean i, S, dt.
    """

    __slots__ = (
        "_area",
        "_calm_since",
        "_currents",
        "_frozen",
        "_i",
        "_means",
        "_n",
        "_ripple",
        "_since",
        "_single",
        "_squares0",
        "_t",
        "_w",
        "_w0",
        "baseline",
        "config",
        "constants",
        "current_noise",
        "eta",
        "full",
        "h",
        "inertia_error",
        "learned",
        "llr",
        "lost",
        "noise",
        "reference",
        "rows",
        "scale",
        "slow",
        "slow_variance",
        "speed_variance",
        "threshold",
        "variance",
    )

    def __init__(self, config: BalanceConfig, constants: Constants) -> None:
        self.config = config
        self.constants = constants
        self.threshold = config.thresholds[0][1]
        self.speed_variance = config.speed_noise**2
        self.current_noise = config.current_noise
        self.full = 0.0
        self.inertia_error = config.inertia_unproven
        self._means = False  # whether a current is the mean since the last one
        self.rows: list[tuple[float, ...]] = []
        self._t = self._since = math.nan
        self._w0 = self._squares0 = self._i = self._area = self._ripple = 0.0
        self._n = 0
        self.restart()

    def restart(self) -> None:
        """Forget what was learned of this rotor, its constants excepted."""
        self.eta = self.slow = self.baseline = self.scale = 1.0
        self.variance = self.slow_variance = 0.04
        self.llr = self.learned = 0.0
        self.lost = False
        self.reference = math.nan
        self.h = self.noise = math.nan
        self._single = 4.0
        self._frozen = 0.0
        self._calm_since = math.nan
        self._open(math.nan, 0.0, 0.0, 0.0)

    def set_timing(self, means: bool) -> None:
        """Say whether a current is the mean since the last one, or of the moment."""
        self._means = means

    def skip(self) -> None:
        """Let no interval span this moment."""
        self._open(math.nan, 0.0, 0.0, 0.0)

    def relearn(self) -> None:
        """Forget what was learned under other constants or another timing; a verdict stays."""
        lost = self.lost
        self.restart()
        self.lost = lost
        self.inertia_error = self.config.inertia_unproven

    def sample(self, t: float, w: float, squares: float, i: float, judged: bool) -> bool:
        """Take speed, its square and current [rad/s, rad²/s², A] at t [s]; return whether an interval ended.

        `squares` is w² unless both are filtered. `judged` = the sequential test may run.
        """
        dt = t - self._t
        config = self.config
        if not 0.0 < dt <= config.gap:
            if dt != dt or dt > 0.0 or dt < -config.gap:
                self._open(t, w, squares, i)
            return False
        if self._means:
            self._area += i * dt
        else:
            step = i - self._i
            self._area += (i - 0.5 * step) * dt
            self._ripple += step * step * dt * dt
        self._n += 1
        self._t, self._i = t, i
        if t - self._since < config.interval - 1e-4:
            return False
        self._close(t, w, squares, i, judged)
        self._since, self._w0, self._squares0 = t, w, squares
        self._area = self._ripple = 0.0
        self._n = 0
        return True

    def _open(self, t: float, w: float, squares: float, i: float) -> None:
        self._t = self._since = t
        self._w0, self._squares0, self._i = w, squares, i
        self._area = self._ripple = 0.0
        self._n = 0

    def _close(self, t: float, w: float, last: float, i: float, judged: bool) -> None:
        c = self.config
        k = self.constants
        w0 = self._w0
        dt = t - self._since
        squares = (self._squares0 + w0 * w + last) / 3.0
        turning = 0.5 * (w0 + w)
        rise = (w - w0) / dt
        mean = self._area / dt
        h = k.a * squares
        inertial = k.c * rise
        tenth = self.inertia_error * inertial
        model = c.drag_error * h
        noise = (
            self.current_noise * self.current_noise / (self._n + (0 if self._means else 1))
            + self._ripple / (12.0 * dt * dt)
            + 2.0 * self.speed_variance * (k.c / dt) ** 2
            + tenth * tenth
            + model * model
        )
        self.rows.append((squares, turning, rise, mean, noise if noise == noise else 1.0, dt))
        if h != h:  # drag not yet known: nothing but rows for its identification
            return
        m = mean - k.f * turning - inertial
        self.h, self.noise = h, noise
        p = self.variance + c.quick * dt
        gain = p * h / (p * h * h + noise)
        self.eta += gain * (m - h * self.eta)
        self.variance = p * (1.0 - gain * h)
        if last >= self.full and abs(inertial) < c.slow_inertial * h:
            p = self.slow_variance + c.slow * dt
            gain = p * h / (p * h * h + noise)
            self.slow += gain * (m - h * self.slow)
            self.slow_variance = p * (1.0 - gain * h)
        healthy = m - self.baseline * h
        if judged:
            self._test(t, dt, m, healthy, h, noise, i - k.f * w, k.a * last)
        else:
            self.llr = 0.0
        self._learn(dt, m, healthy, h, noise, i - k.f * w, k.a * last)

    def _test(
        self, t: float, dt: float, m: float, healthy: float, h: float, noise: float, now: float, now_h: float
    ) -> None:
        """Step the sequential log-likelihood ratio of "lost" over "healthy"."""
        c = self.config
        tail = STUDENT * self.scale * noise
        lost = m if m > 0.0 else 0.0
        s = 3.0 * math.log((tail + healthy * healthy) / (tail + lost * lost))
        if healthy > 0.0:
            s = (s if s < 0.0 else 0.0) - c.pull_above
        else:
            s -= c.pull
            if dt > c.single_from:
                s += self._single_reading(now, now_h)
        llr = self.llr + s
        most = self.threshold + c.cap
        self.llr = llr = 0.0 if llr < 0.0 else llr if llr < most else most
        if llr > self.threshold:
            self.lost = True
        if self.lost:
            if llr > 0.0:
                self._calm_since = math.nan
            elif self._calm_since != self._calm_since:
                self._calm_since = t
            elif t - self._calm_since > c.clear_after:
                self.lost = False
                self._calm_since = math.nan

    def _single_reading(self, now: float, now_h: float) -> float:
        """Log-ratio of the latest current alone: no load against the baseline with its learned spread."""
        c = self.config
        spread = self._single + c.no_load_noise**2
        off = now - self.baseline * now_h
        ratio = 0.5 * (
            math.log(spread / c.no_load_noise**2) + off * off / spread - (now / c.no_load_noise) ** 2
        )
        low, high = c.single_range
        return low if ratio < low else high if ratio > high else ratio

    def _learn(
        self, dt: float, m: float, healthy: float, h: float, noise: float, now: float, now_h: float
    ) -> None:
        """Follow baseline and scale, unless something is suspected; both are the adaptive threshold."""
        c = self.config
        odd = healthy * healthy / noise
        if self.lost:
            return
        if self.llr > c.suspicion or odd > c.outlier * self.scale:
            self._frozen += dt
            if self._frozen < c.freeze_at_most or self.llr > c.suspicion:
                return
        else:
            self._frozen = 0.0
        self.learned += dt
        # a running mean at first, then with forgetting; weighted by how much the interval tells
        span = self.learned if self.learned < c.baseline_time else c.baseline_time
        # full weight where the noise is the drag's own alone
        weight = (c.drag_error * h) ** 2 / noise * dt / (span + dt)
        low, high = c.baseline_range
        b = self.baseline + weight * (m / h - self.baseline)
        self.baseline = low if b < low else high if b > high else b
        share = dt / c.scale_time
        low, high = c.scale_range
        most = c.outlier * high
        scale = self.scale + share * ((odd if odd < most else most) - self.scale)
        self.scale = low if scale < low else high if scale > high else scale
        off = now - self.baseline * now_h
        self._single += share * (off * off - self._single)

    def detectable(self, interval: float, within: float = 1.0) -> float:
        """Return the smallest sudden loss that would be named within so many s; NaN if none would.

        `interval` : usual time between samples [s].
        """
        h, c = self.h, self.config
        if not h > 0.0:
            return math.nan
        step = max(interval, c.interval)
        per_step = self.threshold / max(1.0, math.floor(within / step))
        tail = STUDENT * self.scale * self.noise

        def shows(percent: int) -> bool:
            r0 = 0.01 * percent * self.baseline * h
            r1 = (1.0 - 0.01 * percent) * self.baseline * h
            return 3.0 * math.log((tail + r0 * r0) / (tail + r1 * r1)) - c.pull > per_step

        steps = range(50, 101, 2)  # a larger loss shows more
        first = bisect_left(steps, True, key=shows)
        return 0.01 * steps[first] if first < len(steps) else math.nan
