"""The recommended mode: every rotor's torque balance, and all that has to be known before it can be trusted.

    speeds, currents -> which side's current -> how it lies in time -> balance of each rotor -> verdicts
                                                     |
                                        constants, from the vehicle file or from flight

Source: Melczer (2019); sheet 3, recommended mode; sheet 5, section 6.
"""

import math

from gcs_health.airframe import Airframe
from gcs_health.estimators.current_side import CurrentSide, battery_witness, motor_current
from gcs_health.estimators.current_timing import SNAPSHOT, CurrentTiming, Lag, Timing
from gcs_health.estimators.drag_ratio import DragRatio, SlowMean
from gcs_health.estimators.motor_identification import FlightIdentification, Identified
from gcs_health.estimators.motor_observer_config import RecommendedConfig
from gcs_health.estimators.rotor_input import FASTEST, MOST_CURRENT, RotorInput
from gcs_health.estimators.rotor_level import LevelConfig, RotorLevel, mean_of_known
from gcs_health.estimators.torque_balance import Constants, RotorBalance
from gcs_health.estimators.undriven_motor import UndrivenMotor
from gcs_health.samples import BatteryReading, CommandReading, FlightReading, RotorReading

NAN = math.nan


class RecommendedObserver:
    """One vehicle's rotors.

    Attributes
    ----------
    inputs, balances, fits : one for each rotor.
    level : how fast rotors turn in flight. side, timing : what the currents are.
    measured_on : "motor", "battery" or None while it is not known.
    contradicted : whether the vehicle file's side is not what the flight shows.
    ratio, undriven : slow damage; motors without drive.
    """

    def __init__(self, airframe: Airframe, config: RecommendedConfig, level: LevelConfig) -> None:
        n = len(airframe.rotors)
        self.airframe = airframe
        self.config = config
        self.prior = in_amperes(airframe)
        self.inputs = [RotorInput() for _ in range(n)]
        self.balances = [RotorBalance(config.balance, Constants(NAN, 0.0, 0.0)) for _ in range(n)]
        self.fits = [FlightIdentification(self.prior, config.identification) for _ in range(n)]
        self.level = RotorLevel(level)
        self.side = CurrentSide(config.side)
        self.timing = CurrentTiming(n, config.timing)
        self.ratio = DragRatio(n, config.ratio)
        self.undriven = UndrivenMotor(n, config.undriven)
        self.contradicted = False
        self.measured_on = airframe.motor.current_side
        self.witness = ""  # what the battery's own sensor says of the side
        self._slow = [SlowMean(config.ratio.slow_time) for _ in range(n)]
        self._lag = 0.0  # s
        self._lags: list[Lag | None] = [None] * n
        self._last = [(-math.inf, 0.0)] * n  # time and speed before, where braking matters
        self._look = [-math.inf] * n  # when a steady moment is looked for next
        self._noted: list[tuple[float, float] | None] = [None] * n  # time and speed last looked at
        self._seen = [NAN] * n  # latest speeds
        self._currents = [NAN] * n
        self._commands = [NAN] * n
        self._battery_volts = NAN
        lag = airframe.motor.current_lag
        if lag is not None:
            self._set_timing(Timing(lag=lag))
        if self.measured_on is not None:
            self._know_constants()

    # -- readings -----------------------------------------------------------------------------------

    def flight(self, reading: FlightReading) -> None:
        """Take what the autopilot says of the flight."""
        if self.level.flight(reading):
            self._begin_anew()

    def battery(self, reading: BatteryReading) -> None:
        """Take the battery's own voltage and current; a second witness of the side."""
        if 0.5 < reading.voltage < 1000.0:
            self._battery_volts = reading.voltage
        total = sum(self._currents)
        if self.level.airborne and reading.current > 0.0 and total == total:
            self.witness = battery_witness(total, reading.current, self.config.side)

    def commands(self, reading: CommandReading) -> None:
        """Take the commands that are known."""
        for k, command in enumerate(reading.command[: len(self._commands)]):
            if command == command:
                self._commands[k] = command

    def rotors(self, reading: RotorReading) -> bool:
        """Take speeds and currents; return whether a decision about a rotor changed."""
        t = reading.t
        seen, amperes, inputs = self._seen, self._currents, self.inputs
        level = self.level
        judged = level.judged(t)
        slowest = level.config.turning * level.value
        changed = False
        for k, (w, i, u) in enumerate(zip(reading.speed, reading.current, reading.voltage, strict=False)):
            if k < len(seen) and 0.0 <= w < FASTEST:
                seen[k] = w
                if -MOST_CURRENT < i < MOST_CURRENT:
                    dt = inputs[k].take(t, w, i, u)
                    if dt > 0.0:
                        amperes[k] = i
                        changed |= self._rotor(k, inputs[k], dt, judged, slowest)
        mean = sum(seen) / len(seen)
        if mean != mean:  # a rotor that has not reported
            mean = mean_of_known(seen)
        if mean == mean and level.speeds(t, mean):
            return self._begin_anew()
        return self._compare(t, judged) or changed

    def _rotor(self, k: int, given: RotorInput, dt: float, judged: bool, slowest: float) -> bool:
        """Take one rotor's new speed and current; return whether it was lost or found again."""
        t, w, i, side = given.t, given.speed, given.current, self.measured_on
        if t >= self._look[k]:
            self._note_steady(k, given)
            side = self.measured_on
        if side == "battery":
            i = self._converted(k, given)
        fast = not given.interval > self.config.slowest
        if judged and (not fast or i != i):
            self._note_slow(k, dt, w, given)
        balance = self.balances[k]
        if i != i:
            balance.skip()
            return False
        if w < slowest or not slowest > 0.0 or self.undriven.undriven[k]:
            balance.skip()
            self._lags[k] = None
            return False
        if self.timing.decided is None and judged and self.timing.note(k, t, w, i):
            self._set_timing(self.timing.decided or SNAPSHOT)
            self._grain()
        squares = w * w
        if self._lag:
            w, squares = self._lagged(k, dt, w, squares)
        was = balance.lost
        testable = judged and fast and side is not None
        if balance.sample(t, w, squares, i, testable) and len(balance.rows) >= self.config.rows:
            self._look_at_constants(k, balance, given)
        return balance.lost is not was

    # -- what the currents are ----------------------------------------------------------------------

    def _note_steady(self, k: int, given: RotorInput) -> None:
        """Show steady moments to the recognition of the side, and act on what it finds."""
        c = self.config.side
        level, t = self.level.value, given.t
        before = self._noted[k]
        self._noted[k] = t, given.speed
        done = self.measured_on is not None and self.side.news >= c.look_at
        self._look[k] = math.inf if done else t + c.every
        if before is None or t - before[0] > 1.0 or not given.speed > c.slowest * level > 0.0:
            return
        if abs(given.speed - before[1]) * level > c.steady * given.speed**2 * (t - before[0]):
            return
        self.side.note(given.speed, given.current)
        if self.side.news % c.decide_every == 0:
            self._decide_side()

    def _decide_side(self) -> None:
        found = self.side.decide()
        if found is None:
            return
        if self.measured_on is None:
            self.measured_on = found
            self._know_constants()
        elif self.airframe.motor.current_side is not None:
            self.contradicted = found != self.measured_on

    def _lagged(self, k: int, dt: float, w: float, squares: float) -> tuple[float, float]:
        """Put speed and its square behind the lag of the current."""
        lag = self._lags[k]
        if lag is None or dt > self.config.balance.gap:
            self._lags[k] = Lag(self._lag, w, squares)
            return w, squares
        return lag.step(dt, w, squares)

    def _converted(self, k: int, given: RotorInput) -> float:
        """Return the motor's current of a battery-side one; NaN where it cannot be told."""
        if self._brakes(k, given):
            return NAN
        motor = self.airframe.motor
        volts = given.volts if given.volts > 0.5 else self._battery_volts
        if motor.torque_constant is None or motor.resistance is None or not volts > 0.5:
            return NAN
        i = motor_current(given.speed, given.current, volts, motor.torque_constant, motor.resistance)
        # di/dI_b: at low duty a battery's ampere is worth several of the motor's, noise included
        worth = volts / max(motor.torque_constant * given.speed + 2.0 * motor.resistance * i, 0.05 * volts)
        self.balances[k].current_noise = self.config.balance.current_noise * max(worth, 1.0)
        return i

    def _brakes(self, k: int, given: RotorInput) -> bool:
        """Whether the rotor may be braked: a battery-side current has no sign then."""
        t, w = self._last[k]
        self._last[k] = given.t, given.speed
        c, now = self.config.side, given.speed
        if not w - now > c.braking * self.level.value * (given.t - t):
            return False
        healthy = (self.airframe.motor.torque or 0.0) * now**3  # W
        return given.current * given.volts < c.braking_current * healthy or not healthy

    @property
    def convertible(self) -> bool:
        """Whether a battery-side current could be converted with what is known."""
        motor = self.airframe.motor
        volts = self._battery_volts > 0.5 or any([given.volts > 0.5 for given in self.inputs])
        return motor.torque_constant is not None and motor.resistance is not None and volts

    def _note_slow(self, k: int, dt: float, w: float, given: RotorInput) -> None:
        """Add to the mean over a minute: of the current, or of the electric torque u I / w on the battery's side."""
        if w > self.level.config.turning * self.level.value > 0.0 and dt < math.inf:
            battery = self.measured_on == "battery" and given.volts > 0.5
            drive = given.current * given.volts / w if battery else given.current - self.prior.f * w
            self._slow[k].note(dt, w, drive)

    def _set_timing(self, timing: Timing) -> None:
        self.timing.decided = timing
        self._lag = timing.lag
        self._lags = [None] * len(self._lags)
        for balance in self.balances:
            balance.set_timing(timing.mean)
            balance.skip()
        if timing.mean or timing.lag:  # what was identified under another timing is wrong
            self.fits = [FlightIdentification(self.prior, self.config.identification) for _ in self.fits]
            for balance in self.balances:
                balance.relearn()

    def _grain(self) -> None:
        """Take the step of the telemetry into the noise of a speed."""
        noise = self.config.balance.speed_noise**2 + self.timing.speed_step**2 / 12.0
        for balance in self.balances:
            balance.speed_variance = noise

    # -- constants ----------------------------------------------------------------------------------

    def _know_constants(self) -> None:
        """Begin the balances with the vehicle file's constants, as far as it has them."""
        for balance in self.balances:
            balance.constants = Constants(self.prior.a, self.prior.f, self.prior.c)
            balance.rows.clear()
        self.fits = [FlightIdentification(self.prior, self.config.identification) for _ in self.fits]

    def _look_at_constants(self, k: int, balance: RotorBalance, given: RotorInput) -> None:
        """Identify from the latest intervals; take an unknown drag once it is sure, and the inertia always."""
        c = self.config
        rows = balance.rows[:]
        balance.rows.clear()
        balance.threshold = c.balance.threshold(given.interval)
        balance.full = (c.ratio.full * self.level.value) ** 2
        fit = self.fits[k]
        if balance.lost or balance.llr > c.balance.suspicion or not self.level.judged(given.t):
            return
        means = self.timing.decided is not None and self.timing.decided.mean
        teaches = means or given.interval < c.identification.fastest
        fit.take(rows, balance.speed_variance, teaches)
        if self.measured_on is None:
            return
        found = fit.solve(self.level.value)
        if found is None:
            return
        constants = balance.constants
        if constants.a != constants.a:
            flown = given.t - self.level.began
            sure = found.a_std < c.drag_known * found.a
            if sure and flown > c.learn_unknown and self.timing.decided is not None:
                balance.constants = found.constants
                balance.relearn()
                balance.inertia_error = self._inertia_error(found)
        elif fit.time > c.learn:
            constants.c = found.c
            balance.inertia_error = self._inertia_error(found)

    def _inertia_error(self, found: Identified) -> float:
        """Return what share of the inertial current may be wrong; where nothing taught the inertia, more."""
        c = self.config.balance
        spread = found.c_std / found.c if found.c > 0.0 else math.inf
        return min(max(spread, c.inertia_error), c.inertia_unproven)

    def identified(self, rotor: int) -> Identified | None:
        """Return what flight has taught of one rotor's constants, in amperes."""
        return self.fits[rotor].solve(self.level.value)

    # -- verdicts -----------------------------------------------------------------------------------

    def _compare(self, t: float, judged: bool) -> bool:
        """Hold the rotors against one another; return whether a verdict changed."""
        level = self.level.value
        changed = judged and self.undriven.feed(t, self._seen, self._currents, level, self._commands)
        for k, balance in enumerate(self.balances if changed else ()):
            if balance.lost:  # switched off since: its own verdict stands
                self.undriven.undriven[k] = False
        if not judged or not self.ratio.due(t):
            return changed
        if self.by_minutes:
            return self.ratio.feed(t, [mean.value for mean in self._slow], True) or changed
        ratios = []
        for k, balance in enumerate(self.balances):
            gone = balance.lost or self.undriven.undriven[k]
            self._learn_reference(balance, self.ratio.ratio[k])
            ratios.append(NAN if gone else balance.slow / balance.reference)
        return self.ratio.feed(t, ratios) or changed

    def _learn_reference(self, balance: RotorBalance, rho: float) -> None:
        """Keep a rotor's healthy level: a mean over the first seconds, refined for a while if nothing is odd."""
        c = self.config
        if balance.reference != balance.reference:
            if balance.learned >= c.learn:
                balance.reference = balance.baseline
        elif balance.learned < c.refine and abs(rho - 1.0) < c.refine_within:
            balance.reference += c.ratio.every / balance.learned * (balance.slow - balance.reference)

    @property
    def by_minutes(self) -> bool:
        """Whether only means over a minute can be had: telemetry too slow, or a current not convertible."""
        if self.measured_on == "battery" and not self.convertible:
            return True
        intervals = [given.interval for given in self.inputs if given.interval == given.interval]
        return bool(intervals) and min(intervals) > self.config.slowest

    def _begin_anew(self) -> bool:
        """Forget the healthy levels: another flight, or the take-off from an idle; say if a verdict went with it."""
        stood = any(self.undriven.undriven) or any(self.ratio.verdict)
        stood |= any([balance.lost for balance in self.balances])
        for balance in self.balances:
            balance.restart()
            if self.prior.a != self.prior.a:
                balance.constants.a = NAN
        n = len(self.balances)
        self._slow = [SlowMean(self.config.ratio.slow_time) for _ in range(n)]
        self.ratio = DragRatio(n, self.config.ratio)
        self.undriven = UndrivenMotor(n, self.config.undriven)
        return stood


def in_amperes(airframe: Airframe) -> Constants:
    """Return the vehicle file's constants divided by the torque constant; a NaN, f and c 0 where unknown."""
    motor = airframe.motor
    kq = motor.torque_constant
    if kq is None:
        return Constants(NAN, 0.0, 0.0)
    return Constants(
        NAN if motor.torque is None else motor.torque / kq,
        0.0 if motor.friction is None else motor.friction / kq,
        0.0 if motor.inertia is None else motor.inertia / kq,
    )
