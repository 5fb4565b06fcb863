"""Recommended mode: a bank of single-fault hypotheses on the unfiltered residual, behind a gate.

    y   = ((p_n - p_(n-1)) / dt, likewise q and r, a_z) of ticks of some 8 ms
    r   = y - sum h_i - b
    R_t = R[age] x growth x kappa x motion + model error

Ticks later than the last rotor speeds are judged with those speeds held and the covariance of their
age, and once more when the next speeds arrive: a decision can fall on either message.

Small, lasting losses are found by `partial_loss.py`; a slow Kalman filter follows all rotors for display.

Source: sheet 1 section 7, with the rules of sheet 5 section 3, which wins where they differ.
"""

import math
from collections.abc import Sequence
from operator import mul

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.calibration.control_effectiveness import ControlEffectiveness
from gcs_health.calibration.residual_noise import ResidualNoise
from gcs_health.estimators.commanded_speeds import CommandedSpeeds
from gcs_health.estimators.effectiveness_config import RecommendedConfig
from gcs_health.estimators.fault_bank import NOTHING, FaultBank, Verdict
from gcs_health.estimators.lesson import Freeze, Lesson, NextLesson
from gcs_health.estimators.moment_learning import MomentLearning
from gcs_health.estimators.motion import Motion
from gcs_health.estimators.partial_loss import PartialLoss
from gcs_health.estimators.residual_model import Evidence, Push, Step, calm, push, residual, step_between
from gcs_health.estimators.short_order import may_be_order
from gcs_health.estimators.slow_effectiveness import SlowEffectiveness
from gcs_health.estimators.ticks import ImuBlocks, RotorTrack, Tick
from gcs_health.gate import Closed, FlightGate
from gcs_health.samples import CommandReading, ImuReading, RotorReading, new_tuple


class RecommendedBank:
    """The whole recommended mode but its words; `effectiveness.py` turns it into estimates.

    Attributes
    ----------
    failed : rotor that the rules name, held for the flight; None.
    verdict : the evidence at that moment.
    standing : of each rotor the largest log likelihood ratio and the information D, as `FaultBank.standing`;
        renewed with every lesson and whenever a hypothesis is half way, for else it says the same for long.
    open_time, flying_time : how much of the flight could be judged [s].
    """

    def __init__(self, airframe: Airframe, config: RecommendedConfig) -> None:
        self.config = config
        n = self.rotors = len(airframe.rotors)
        self.assumed = airframe.source is AirframeSource.ASSUMED
        self.gains = ControlEffectiveness(airframe, config.prior)
        self.blocks = ImuBlocks(config.tick)
        self.track = RotorTrack(n)
        self.commanded = CommandedSpeeds(n, config.commands)
        self.noise = ResidualNoise(config.noise)
        self.motion = Motion(config.motion)
        self.bank = FaultBank(n, 4 if self.gains.has_yaw else 3, config.bank)
        self.gate = FlightGate(n, config.gate)
        self.moments = MomentLearning(self.gains, config)
        self.shift = self.moments.shift
        self.slow = SlowEffectiveness(n, config.slow)
        self.partial = PartialLoss(n, config.partial)
        self._calm_limit = config.calm * config.calm
        self.failed: int | None = None
        self.verdict: Verdict = NOTHING
        self.standing = ([0.0] * n, [0.0] * n)
        self._failed_at = -math.inf
        self.open_time = 0.0  # s of open gate so far
        self.flying_time = 0.0  # s with fresh rotor speeds above 60 % of hover
        self._opened_until = -math.inf  # when the gate was last open [s]
        self._before: Tick | None = None
        self._push: Push | None = None  # at the last tick that is final
        self._pending: list[Step] = []  # ticks beyond the last rotor speeds
        self._held_speeds: list[Sequence[float]] = []  # at each of them
        self._held_push: Push | None = None  # with the last rotor speeds
        self._held_pass = (-math.inf, -1)  # last tick that passed on held speeds, and its rotor
        self._in_bank = 0  # pending ticks that the bank has seen
        self._newest_learned = -math.inf
        self._row = (-1, 0)  # rotor and its successive ticks, provisional ones included
        self._final_row = (-1, 0)
        self._next = NextLesson()
        self._freeze = Freeze(config.freeze, config.freeze_at_most)
        self._checked = 0.0

    @property
    def hover(self) -> float:
        """Hover speed [rad/s], infinite while thrust is not known."""
        return self.gains.hover

    @property
    def contradicted(self) -> bool:
        """Whether the rotors do not answer as the geometry says; nothing is named then."""
        return self.moments.contradicted

    @property
    def tick_length(self) -> float:
        """Usual time between ticks [s]."""
        return self.blocks.tick_length

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

    def rotor_speeds(self, reading: RotorReading, whole: bool = False) -> bool:
        """Take one reading, known to be complete if `whole`; return whether a verdict fell."""
        moved = self.track.feed(reading, whole)
        if whole and not self.track.interval <= self.config.slow_rotor_speeds:
            self.commanded.learn(reading.t, reading.speed)
        if moved and self._pending and self.gate.open:
            return self._evaluate()
        return False

    def commands(self, reading: CommandReading) -> None:
        """Take the motor commands: they tell how speeds move between slow samples."""
        self.commanded.command(reading)

    def rate_too_low(self) -> bool:
        """Whether a loss cannot be seen in time at these message rates."""
        c = self.config
        return self.blocks.tick_length > c.slowest_tick or self.track.interval > c.slowest_rotor_speeds

    def new_flight(self) -> None:
        """Begin a new flight: a failure named in the one before no longer holds."""
        self.failed = None
        self.verdict = NOTHING
        self._row = self._final_row = (-1, 0)
        self.bank.clear()
        self.standing = self.bank.standing(self.tick_length)
        self.slow.restart()
        self.partial.restart()

    def _advance(self, tick: Tick, before: Tick) -> bool:
        t = tick.t
        dt = t - before.t
        track = self.track
        shift = self.shift.shift
        speeds = self._speeds_at(t - shift)
        gains = self.gains
        if not gains.thrust_given and self.failed is None:
            gains.learn_thrust(dt, tick.az, sum(map(mul, speeds, speeds)))
        blocked = None
        if not gains.known:
            blocked = Closed.EFFECTIVENESS_UNKNOWN
            self._opened_until = -math.inf  # what was learned belongs to other gains
        elif self.rate_too_low():
            blocked = Closed.RATE_TOO_LOW
        gate = self.gate
        was_open = gate.open
        age = t - track.covered
        is_open = gate.feed(t, dt, speeds, age, track.interval, tick.az, gains.thrust, blocked)
        self._count_time(dt if dt < 0.1 else 0.1, age, is_open)
        inflation = self.motion.inflation(tick, dt)
        if not is_open or not was_open:
            self._start_over(speeds, opened=is_open, closed_for=t - self._opened_until)
            return False
        self._opened_until = t
        self._pending.append(step_between(before, tick, dt, inflation))
        self._held_speeds.append(speeds)
        if t <= track.covered + shift:
            return self._evaluate()
        if track.interval <= min(self.blocks.tick_length, self.config.wait) and age < 1.5 * track.interval:
            return False  # the next rotor speeds bracket this tick within less than a tick
        return self._provisional(len(self._pending) - 1)

    def _count_time(self, dt: float, age: float, is_open: bool) -> None:
        if is_open:
            self.open_time += dt
        if age < 0.2 and self.gate.mean_speed > 0.6 * self.gains.hover:
            self.flying_time += dt

    def _start_over(self, speeds: Sequence[float], opened: bool, closed_for: float) -> None:
        """No window, no block, no offset reaches across a closed gate."""
        if opened:
            squares = self.hover * self.hover
            if not self.gate.after_gust:
                self.noise.expect(max(self.gains.roll) * squares, max(self.gains.pitch) * squares)
                self.noise.restart()
            self.slow.restart()
            self.partial.go_on(closed_for)
            self._push = push(speeds, self.gains)
        if self.bank.ticks or self._pending:
            self.bank.clear()
            self.standing = self.bank.standing(self.tick_length)
            self._next.clear()
            self.moments.gap()
            self._pending.clear()
            self._held_speeds.clear()
            self._held_push = None
            self._in_bank = 0
        self._row = self._final_row = (-1, 0)

    def _evaluate(self) -> bool:
        """Rotor speeds came: make final what they bracket, judge the rest anew with the newest held."""
        shift = self.shift.shift
        covered = self.track.covered + shift
        pending = self._pending
        self.bank.drop_provisional()
        self._in_bank = 0
        self._row = self._final_row
        done = 0
        fell = False
        for step in pending:
            if step.t > covered:
                break
            fell = self._make_final(step) or fell
            done += 1
        del pending[:done]
        self._held_push = None
        if pending:
            self._held_speeds = [self._speeds_at(step.t - shift) for step in pending]
            for position in range(len(pending)):
                fell = self._provisional(position) or fell
        else:
            self._held_speeds.clear()
        return fell

    def _make_final(self, step: Step) -> bool:
        t = step.t
        gains, noise = self.gains, self.noise
        before = self._push
        assert before is not None
        now = self._push = push(self._speeds_at(t - self.shift.shift), gains)
        e = residual(step, before, now, gains.has_yaw)
        error = noise.offset, noise.variances(0), step.inflation
        bend = self.commanded.bend(self.track.interval, step.dt)
        tick = new_tuple(Evidence, (e, *error, before.speeds, now.speeds, gains.matrix, gains.doubt, bend))
        suspected = t <= self._freeze.until or self._row[1] > 0  # then every tick counts
        self.bank.add_final(tick, -e[3])
        fell = False
        if suspected or self.failed is not None or not calm(tick, self._calm_limit):
            fell = self._judge(t, True)
        else:
            self._freeze.quiet(t)
            self._row = (-1, 0)
        self._final_row = self._row
        if self.gate.teaches:
            self._next.add(step, tick, t > self._freeze.until)
        if self._next.time >= self.config.lesson:
            fell = self._learn(t) or fell
        return fell

    def _speeds_at(self, t: float) -> Sequence[float]:
        """Return the rotor speeds at time t [s]: between and beyond slow samples, moving as commanded."""
        speeds = self.track.at(t)
        if not self.commanded.trusted or self.track.interval <= self.config.slow_rotor_speeds:
            return speeds
        return self.commanded.corrected(speeds, t, *self.track.around(t))

    def _provisional(self, position: int) -> bool:
        """Judge a pending tick with the last rotor speeds held, unless it is calm and so can wait."""
        tick = self._held(position)
        step = self._pending[position]
        t = step.t
        if t > self._newest_learned:
            self._newest_learned = t
            if t > self._freeze.until and self.failed is None and self.gate.teaches:
                self._next.aged.append((position + 1, tick.e, step.dt, step.inflation))
        suspected = t <= self._freeze.until or self._in_bank == position > 0
        if not suspected and calm(tick, self._calm_limit):
            return False
        for waited in range(self._in_bank, position + 1):
            tick = self._held(waited)
            self.bank.add_provisional(tick, -tick.e[3])
        self._in_bank = position + 1
        return self._judge(t, False)

    def _held(self, position: int) -> Evidence:
        """Return a pending tick with the last rotor speeds held: the older they are, the worse."""
        step = self._pending[position]
        speeds = self._held_speeds
        same = position > 0 and speeds[position - 1] is speeds[position]
        before = self._push_at(position - (not same))
        now = before if same else self._push_at(position)
        late = step.t - self.track.covered - self.shift.shift
        gains, noise = self.gains, self.noise
        e = residual(step, before, now, gains.has_yaw)
        inflation = step.inflation * noise.growth(late if late > 0.0 else 0.0)
        error = noise.offset, noise.variances(position + 1), inflation
        return new_tuple(Evidence, (e, *error, before.speeds, now.speeds, gains.matrix, gains.doubt, 0.0))

    def _push_at(self, position: int) -> Push:
        """Return what the rotors do at a pending tick; mostly the same as at the one before."""
        if position < 0:
            assert self._push is not None
            return self._push
        speeds = self._held_speeds[position]
        held = self._held_push
        if held is None or held.speeds is not speeds:
            held = self._held_push = push(speeds, self.gains)
        return held

    def _judge(self, t: float, final: bool) -> bool:
        """Judge the bank as it stands; return whether a verdict fell."""
        if self.failed is not None:
            self._refine(t)
            return False
        c = self.config
        slow = self.track.interval > c.slow_rotor_speeds
        least = c.short_order.ticks if slow and not self.commanded.tell_orders(self.track.interval) else 0
        verdict = self.bank.judge(self.tick_length, 0.5 * c.bank.llr, self.gate.excess_sigma, least)
        if verdict.llr > 0.5 * c.bank.llr:
            self._freeze.half_way(t)
            self.standing = self.bank.standing(self.tick_length)
        else:
            self._freeze.quiet(t)
        rotor, row = self._row
        turns = self.track.last_two(verdict.rotor)[1] >= c.slowest_named * self.hover
        passes = verdict.passes and turns and self.gate.verdicts and not self.contradicted
        if passes and not (slow and self._may_be_order(verdict)):
            row = row + 1 if verdict.rotor == rotor else 1
            if final and not slow and self._held_pass == (t, verdict.rotor):
                row += 1  # passed on held speeds, and again now that they are known
            if not final:
                self._held_pass = (t, verdict.rotor)
        else:
            row = 0
        self._row = (verdict.rotor, row)
        return row >= (c.ticks_slow if slow else c.ticks) and self._decide(verdict, t)

    def _may_be_order(self, verdict: Verdict) -> bool:
        """Whether what looks like a loss may be an order that slow speeds do not show."""
        c, tick, interval = self.config, self.tick_length, self.track.interval
        if self.commanded.tell_orders(interval):
            return False
        speeds = self.track.last_two(verdict.rotor)
        return may_be_order(c.short_order, verdict, tick, c.bank.window - 1.5 * tick, interval, speeds)

    def _decide(self, verdict: Verdict, t: float) -> bool:
        """Name the rotor, if the geometry bears it; return whether anything is decided."""
        if not self._bears_a_name():
            return self.moments.doubtful(self.track.interval, self.tick_length)
        self.failed = verdict.rotor
        self.verdict = verdict
        self._failed_at = t
        self._next.clear()
        self.partial.size(verdict.rotor)
        return True

    def _bears_a_name(self) -> bool:
        return self.moments.bears_a_name(self.track.interval, self.tick_length, self.assumed)

    def _refine(self, t: float) -> None:
        """Size the loss better: the window that names the rotor best still grows after the verdict."""
        c = self.config
        if t - self._failed_at > c.refine:
            return
        verdict = self.bank.judge(self.tick_length, 0.5 * c.bank.llr, self.gate.excess_sigma)
        if verdict.passes and verdict.rotor == self.failed and verdict.llr > self.verdict.llr:
            self.verdict = verdict

    def _learn(self, t: float) -> bool:
        """Learn from the final ticks gathered; return whether the geometry became, or ceased to be, wrong."""
        c = self.config
        lesson, calm_ticks = self._next.begin()
        if self.failed is not None:
            self.partial.feed(lesson, self.gains.matrix)
            return False
        self._learn_noise(lesson, calm_ticks)
        self.standing = self.bank.standing(self.tick_length)
        self.slow.feed(lesson, self.gains.matrix)
        self.partial.feed(lesson, self.gains.matrix)
        self.moments.feed(lesson, self.track.interval, self.tick_length)
        if self.partial.rotor is not None and not self._bears_a_name():
            self.partial.rotor = None
        self._checked += lesson.length
        if self._checked >= c.check_every:
            self._checked = 0.0
            changed = self.moments.check(self.track.interval, self.tick_length)
            self.bank.exchange_cost = self.moments.exchange_cost
            return changed
        return False

    def _learn_noise(self, lesson: Lesson, calm: NDArray[np.bool_]) -> None:
        since_open = self.gate.since_open
        if self._next.aged:
            ages, e, dt, inflation = zip(*self._next.aged, strict=True)
            self.noise.learn_aged(list(ages), np.array(e), np.array(dt), np.array(inflation), since_open)
            self._next.aged.clear()
        if calm.all():
            self.noise.learn(lesson.e, lesson.dt, lesson.inflation, since_open)
        elif calm.any():
            self.noise.learn(lesson.e[calm], lesson.dt[calm], lesson.inflation[calm], since_open)
