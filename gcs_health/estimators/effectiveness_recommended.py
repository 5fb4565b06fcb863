"""Recommended mode: a bank of single-fault hypotheses on the unfiltered residual, behind a gate.

    y   = ((p_n - p_(n-1)) / dt, likewise q and r, a_z) of ticks of some 8 ms
    r   = y - sum h_i - b
    R_t = R[age] x growth x kappa x (1 + |a_xy|²/4² + |Omega|²/4²)² + model error

Ticks later than the last rotor speeds are judged with those speeds held and the covariance of their
age, and once more when the next speeds arrive: a decision can fall on either message.

A second, slow Kalman filter on 40 ms means follows small, lasting losses for display.

Source: sheet 1 section 7, with the rules of sheet 5 section 3, which wins where they differ.
"""

import math
from collections import deque

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.calibration import geometry_check
from gcs_health.calibration.control_effectiveness import ControlEffectiveness, MomentRegression
from gcs_health.calibration.residual_noise import ResidualNoise
from gcs_health.calibration.time_shift import TimeShift
from gcs_health.estimators.effectiveness_config import RecommendedConfig
from gcs_health.estimators.fault_bank import NOTHING, FaultBank, Verdict
from gcs_health.estimators.residual_model import Residual, Step, calm, evidence, residual
from gcs_health.estimators.slow_effectiveness import SlowEffectiveness
from gcs_health.estimators.ticks import ImuBlocks, RotorTrack, Tick
from gcs_health.gate import GRAVITY, Closed, FlightGate
from gcs_health.samples import ImuReading, RotorReading


class RecommendedBank:
    """The whole recommended mode but its words; `effectiveness.py` turns it into estimates.

    Attributes
    ----------
    failed : rotor that the rules name, held for the flight; None.
    verdict : the evidence at that moment.
    open_time, flying_time : how much of the flight could be judged [s].
    contradicted : the rotors do not answer as the geometry says; nothing is named then.
    """

    def __init__(self, airframe: Airframe, config: RecommendedConfig) -> None:
        self.config = config
        n = self.rotors = len(airframe.rotors)
        self.assumed = airframe.source is AirframeSource.ASSUMED
        self.gains = ControlEffectiveness(airframe, config.prior)
        self.blocks = ImuBlocks(config.tick)
        self.track = RotorTrack(n)
        self.noise = ResidualNoise(config.noise)
        self.bank = FaultBank(n, 4 if self.gains.has_yaw else 3, config.bank)
        self.gate = FlightGate(n, config.gate)
        self.regression = MomentRegression(n, config.prior)
        self.shift = TimeShift(config.shift)
        self.slow = SlowEffectiveness(n, config.slow)
        self.failed: int | None = None
        self.verdict: Verdict = NOTHING
        self._failed_at = -math.inf
        self.contradicted = False
        self.open_time = 0.0  # s of open gate so far
        self.flying_time = 0.0  # s with fresh rotor speeds above 60 % of hover
        self._before: Tick | None = None
        self._speeds: list[float] = []  # at the last tick that is final
        self._pending: list[Step] = []  # ticks beyond the last rotor speeds
        self._held_speeds: list[list[float]] = []  # at each of them
        self._held_pass = (-math.inf, -1)  # last tick that passed on held speeds, and its rotor
        self._in_bank = 0  # pending ticks that the bank has seen
        self._newest_learned = -math.inf
        self._motion = [0.0] * 5  # a_x, a_y, p, q, r, low-passed
        self._row = (-1, 0)  # rotor and its successive ticks, provisional ones included
        self._final_row = (-1, 0)
        self._strikes = 0
        # what teaches where the rotors sit lags, lest a fault look like a wrong geometry
        self._regression_late: deque[tuple[float, float, list[float], float, float]] = deque()
        self._frozen_until = -math.inf
        self._frozen_since = math.nan
        self._checked = 0.0
        self._x_mean = [0.0, 0.0, 0.0, 0.0]  # high pass of predicted and measured roll, pitch

    @property
    def hover(self) -> float:
        """Hover speed [rad/s], infinite while thrust is not known."""
        thrust = self.gains.thrust
        return math.sqrt(GRAVITY / (self.rotors * thrust)) if thrust > 0.0 else math.inf

    @property
    def tick_length(self) -> float:
        """Usual time between ticks [s]."""
        return self.blocks.step * self.blocks.per_block

    def imu(self, reading: ImuReading) -> bool:
        """Take one message; return whether a verdict fell."""
        tick = self.blocks.feed(reading)
        if tick is None:
            return False
        before = self._before
        self._before = tick
        if before is None or self.track.covered == -math.inf:
            return False
        return self._advance(tick, before)

    def rotor_speeds(self, reading: RotorReading) -> bool:
        """Take one reading; return whether a verdict fell."""
        if self.track.feed(reading) and self._pending and self.gate.open:
            return self._evaluate()
        return False

    def rate_too_low(self) -> bool:
        """Whether a loss cannot be seen in time at these message rates."""
        c = self.config
        return self.tick_length > c.slowest_tick or self.track.interval > c.slowest_rotor_speeds

    def new_flight(self) -> None:
        """Begin a new flight: a failure named in the one before no longer holds."""
        self.failed = None
        self.verdict = NOTHING
        self._row = self._final_row = (-1, 0)
        self.bank.clear()
        self.slow.restart()

    def _advance(self, tick: Tick, before: Tick) -> bool:
        c = self.config
        dt = tick.t - before.t
        track = self.track
        speeds = track.at(tick.t - self.shift.shift)
        squares = 0.0
        for speed in speeds:
            squares += speed * speed
        if not self.gains.thrust_given and self.failed is None:
            self.gains.learn_thrust(dt, tick.az, squares)
        blocked = None
        if not self.gains.known:
            blocked = Closed.EFFECTIVENESS_UNKNOWN
        elif self.rate_too_low():
            blocked = Closed.RATE_TOO_LOW
        was_open = self.gate.open
        age = tick.t - track.covered
        is_open = self.gate.feed(tick.t, dt, speeds, age, track.interval, tick.az, self.gains.thrust, blocked)
        self._count_time(min(dt, 0.1), age, squares, is_open)
        gain = min(1.0, dt / c.motion_time)
        motion = self._motion
        motion[0] += gain * (tick.ax - motion[0])
        motion[1] += gain * (tick.ay - motion[1])
        motion[2] += gain * (tick.p - motion[2])
        motion[3] += gain * (tick.q - motion[3])
        motion[4] += gain * (tick.r - motion[4])
        if not is_open or not was_open:
            self._start_over(speeds, opened=is_open)
            return False
        push = (motion[0] ** 2 + motion[1] ** 2) / c.drag_scale**2
        spin = (motion[2] ** 2 + motion[3] ** 2 + motion[4] ** 2) / c.body_rate_scale**2
        step = Step(tick, before, dt, (1.0 + push + spin) ** 2)
        self._pending.append(step)
        self._held_speeds.append(speeds)
        if tick.t <= track.covered + self.shift.shift:
            return self._evaluate()
        if track.interval <= min(self.tick_length, c.wait) and age < 1.5 * track.interval:
            return False  # the next rotor speeds bracket this tick within less than a tick
        return self._provisional(len(self._pending) - 1)

    def _count_time(self, dt: float, age: float, squares: float, is_open: bool) -> None:
        if is_open:
            self.open_time += dt
        if age < 0.2 and squares > 0.36 * self.rotors * self.hover**2:
            self.flying_time += dt

    def _start_over(self, speeds: list[float], opened: bool) -> None:
        """No window, no block, no offset reaches across a closed gate."""
        if opened:
            squares = self.hover * self.hover
            self.noise.expect(max(self.gains.roll) * squares, max(self.gains.pitch) * squares)
            self.noise.restart()
            self.slow.restart()
            self._speeds = speeds
        if self.bank.ticks or self._pending:
            self.bank.clear()
            self._regression_late.clear()
            self.regression.gap()
            self.shift.gap()
            self._pending.clear()
            self._held_speeds.clear()
            self._in_bank = 0
        self._row = self._final_row = (-1, 0)

    def _evaluate(self) -> bool:
        """Rotor speeds came: make final what they bracket, judge the rest anew with the newest held."""
        covered = self.track.covered + self.shift.shift
        pending = self._pending
        self.bank.drop_provisional()
        self._in_bank = 0
        self._row = self._final_row
        done = 0
        fell = False
        for step in pending:
            if step.tick.t > covered:
                break
            fell = self._make_final(step) or fell
            done += 1
        del pending[:done]
        shift = self.shift.shift
        self._held_speeds = [self.track.at(step.tick.t - shift) for step in pending]
        for position in range(len(pending)):
            fell = self._provisional(position) or fell
        return fell

    def _make_final(self, step: Step) -> bool:
        t = step.tick.t
        speeds = self.track.at(t - self.shift.shift)
        left = residual(step, self._speeds, speeds, self.gains)
        self._speeds = speeds
        noise = self.noise
        variances = noise.variances(0, 0.0, step.inflation)
        look = self._suspects(t) or not calm(left.e, noise.offset, variances, self.config.calm)
        self.bank.add_final(evidence(left, noise.offset, variances, self.gains.matrix), -left.e[3])
        fell = self._judge(t, True, look)
        self._final_row = self._row
        if self.failed is None:
            fell = self._learn(step, left, variances) or fell
        return fell

    def _suspects(self, t: float) -> bool:
        """Whether a hypothesis is, or just was, half way: every tick counts then, calm or not."""
        return t <= self._frozen_until or self._row[1] > 0

    def _provisional(self, position: int) -> bool:
        """Judge a pending tick with the last rotor speeds held, unless it is calm and so can wait."""
        step = self._pending[position]
        t = step.tick.t
        left = self._held(position)
        noise = self.noise
        if t > self._newest_learned:
            self._newest_learned = t
            if t > self._frozen_until and self.failed is None:
                noise.learn_aged(position + 1, left.e, step.dt, self.gate.since_open, step.inflation)
        suspected = t <= self._frozen_until or self._in_bank == position > 0
        if not suspected and calm(left.e, noise.offset, self._variances(position), self.config.calm):
            return False
        for waited in range(self._in_bank, position + 1):
            left = self._held(waited)
            tick = evidence(left, noise.offset, self._variances(waited), self.gains.matrix)
            self.bank.add_provisional(tick, -left.e[3])
        self._in_bank = position + 1
        return self._judge(t, False)

    def _held(self, position: int) -> Residual:
        """Return the residual of a pending tick, with the last rotor speeds held."""
        before = self._held_speeds[position - 1] if position else self._speeds
        return residual(self._pending[position], before, self._held_speeds[position], self.gains)

    def _variances(self, position: int) -> list[float]:
        """Return the variances of a pending tick: its rotor speeds are held, and so the older the worse."""
        step = self._pending[position]
        late = max(0.0, step.tick.t - self.track.covered - self.shift.shift)
        return self.noise.variances(position + 1, late, step.inflation)

    def _judge(self, t: float, final: bool, look: bool = True) -> bool:
        """Judge the bank as it stands, if it is worth a `look`; return whether a verdict fell."""
        if self.failed is not None:
            self._refine(t)
            return False
        c = self.config
        verdict = NOTHING
        if look:
            verdict = self.bank.judge(self.tick_length, 0.5 * c.bank.llr, self.gate.excess_sigma)
        if verdict.llr > 0.5 * c.bank.llr:
            self._freeze(t)
        elif t > self._frozen_until:
            self._frozen_since = math.nan
        rotor, row = self._row
        slow = self.track.interval > c.slow_rotor_speeds
        if verdict.passes and self.gate.verdicts and not self.contradicted:
            row = row + 1 if verdict.rotor == rotor else 1
            if final and not slow and self._held_pass == (t, verdict.rotor):
                row += 1  # passed on held speeds, and again now that they are known
            if not final:
                self._held_pass = (t, verdict.rotor)
        else:
            row = 0
        self._row = (verdict.rotor, row)
        return row >= (c.ticks_slow if slow else c.ticks) and self._decide(verdict, t)

    def _decide(self, verdict: Verdict, t: float) -> bool:
        """Name the rotor, if the geometry bears it; return whether anything is decided."""
        g = self.config.geometry
        if self.regression.time < g.least_time:
            return False
        fits = self._fits()
        if geometry_check.doubtful(fits, g):
            self.contradicted = True
            return True
        if self.assumed and not geometry_check.supports(fits, g):
            return False  # a guess must be borne out before it names a rotor
        self.failed = verdict.rotor
        self.verdict = verdict
        self._failed_at = t
        return True

    def _refine(self, t: float) -> None:
        """Size the loss better: the window that names the rotor best still grows after the verdict."""
        c = self.config
        if t - self._failed_at > c.refine:
            return
        verdict = self.bank.judge(self.tick_length, 0.5 * c.bank.llr, self.gate.excess_sigma)
        if verdict.passes and verdict.rotor == self.failed and verdict.llr > self.verdict.llr:
            self.verdict = verdict

    def _freeze(self, t: float) -> None:
        """Stop learning while a hypothesis is half way, lest the fault become the baseline."""
        if self._frozen_since != self._frozen_since:
            self._frozen_since = t
        # but a baseline that is simply wrong must be able to mend itself
        if t - self._frozen_since < self.config.freeze_at_most:
            self._frozen_until = t + self.config.freeze

    def _learn(self, step: Step, left: Residual, variances: list[float]) -> bool:
        """Learn from a final tick; return whether the geometry became, or ceased to be, contradicted."""
        c = self.config
        tick, before, dt, inflation = step
        if tick.t > self._frozen_until:
            self.noise.learn(left.e, dt, self.gate.since_open, inflation)
        self.slow.feed(dt, left, variances, self.gains.matrix)
        roll = (tick.p - before.p) / dt
        pitch = (tick.q - before.q) / dt
        late = self._regression_late
        late.append((tick.t, dt, left.mean, roll, pitch))
        while tick.t - late[0][0] > c.geometry.delay:
            self.regression.feed(*late.popleft()[1:])
        predicted = (roll - left.e[0], pitch - left.e[1])
        mean = self._x_mean
        gain = min(1.0, dt / c.prior.high_pass)
        mean[0] += gain * (predicted[0] - mean[0])
        mean[1] += gain * (predicted[1] - mean[1])
        mean[2] += gain * (roll - mean[2])
        mean[3] += gain * (pitch - mean[3])
        x = (predicted[0] - mean[0], predicted[1] - mean[1])
        if self.track.interval < c.shift_rotor_speeds and self.tick_length < c.shift_rotor_speeds:
            moved = self.shift.feed(dt, x, (roll - mean[2], pitch - mean[3]))
            if moved:  # what was gathered paired rates with the wrong speeds
                self.regression = MomentRegression(self.rotors, c.prior)
                late.clear()
        self._checked += dt
        if self._checked >= c.check_every:
            self._checked = 0.0
            return self._check()
        return False

    def _check(self) -> bool:
        """Twice a second: gains that are not given, and whether the geometry holds."""
        was = self.contradicted
        if self.gains.learns:
            self.gains.learn_moments(
                self.regression.axis(0, self.gains.roll),
                self.regression.axis(1, self.gains.pitch),
                self.regression.time,
            )
        fits = self._fits()
        g = self.config.geometry
        if self.regression.time > g.strong_time and geometry_check.contradicted(fits, g):
            self._strikes += 1
            if self._strikes >= self.config.strikes:
                self.contradicted = True
        else:
            self._strikes = 0
            if self.contradicted and geometry_check.agrees(fits, g):
                self.contradicted = False
        return self.contradicted != was

    def _fits(self) -> list[geometry_check.AxisFit]:
        if self.regression.time < self.config.geometry.least_time:
            return []
        interval = self.track.interval
        block = max(self.config.prior.block, self.tick_length, interval if interval == interval else 0.0)
        found = (
            geometry_check.fit_axis(self.regression, 0, self.gains.roll, block),
            geometry_check.fit_axis(self.regression, 1, self.gains.pitch, block),
        )
        return [fit for fit in found if fit is not None]
