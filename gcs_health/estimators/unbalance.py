"""How unbalanced each propeller is, from the accelerometer and the rotor speeds.

Ghalamchi, Jia, Mueller, "Real-time vibration-based propeller fault diagnosis for multicopters", 2019; for 3 to
12 rotors, in two modes:

``paper``         the authors' extended Kalman filter on power, from speeds or commands (`unbalance_paper.py`)
``recommended``   order-tracked block powers, bounded fits, a verdict (`unbalance_recommended.py`)

The estimate is m_u r_u [kg m] where the airframe has a mass, else m_u r_u / m_b [m], under its own quantity.
In the evidence are g mm, milligrams at the tip where the propeller's radius is known, and the balance quality grade
where its mass is (`gcs_health.balance`). All of them carry the structure's gain between shaft and IMU, which may
be threefold: rank rotors, watch change.

Where no rotor speed is known no rotor's unbalance can be seen: `vibration_level.py` then compares the shaking
with a healthy baseline of the same configuration, and the probability of damage is shared among all rotors.
"""

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.balance import figures
from gcs_health.errors import AirframeError, ConfigError
from gcs_health.estimators.amplitude_model import ImuFilter
from gcs_health.estimators.arrival import ArrivalOrder
from gcs_health.estimators.contract import Estimate, Missing, Quantity, Reason, Status
from gcs_health.estimators.input_recency import InputRecency
from gcs_health.estimators.ticks import FASTEST, MOST
from gcs_health.estimators.unbalance_config import Baseline, UnbalanceConfig
from gcs_health.estimators.unbalance_paper import PaperUnbalance
from gcs_health.estimators.unbalance_recommended import Answer, RecommendedTracker
from gcs_health.estimators.unbalance_verdict import Finding, logistic
from gcs_health.estimators.vibration_level import VibrationLevel
from gcs_health.samples import (
    CommandReading,
    FlightReading,
    ImuFilterReading,
    ImuReading,
    Reading,
    RotorReading,
    VibrationReading,
)

__all__ = ["Baseline", "UnbalanceConfig", "UnbalanceEstimator"]

MIN_ROTORS, MAX_ROTORS = 3, 12
NAN = math.nan
Evidence = tuple[tuple[str, float | str], ...]


class UnbalanceEstimator:
    """The estimator of the contract: feed readings in arrival order, ask for estimates.

    Parameters
    ----------
    airframe : 3 to 12 rotors with known spin.
    config : mode, what is damage, the baseline, parameters.

    Attributes
    ----------
    late : readings older than what came before them.

    Raises
    ------
    AirframeError : the rotors cannot be used.
    ConfigError : the mode is not known, or the baseline is another airframe's.

    Examples
    --------
    >>> from gcs_health.airframe import Airframe, AirframeSource, Rotor
    >>> arms = ((1.0, 1.0, 1), (-1.0, -1.0, 1), (1.0, -1.0, -1), (-1.0, 1.0, -1))
    >>> rotors = tuple(Rotor(i + 1, i, (x, y, 0.0), s) for i, (x, y, s) in enumerate(arms))
    >>> estimator = UnbalanceEstimator(Airframe("quad", rotors, AirframeSource.FILE, metric=False))
    >>> estimator.estimates(0.0)[0].quantity.value  # no mass: relative to it
    'unbalance_relative'

    Source: Ghalamchi et al. (2019); sheets 2 and 5.
    """

    name = "unbalance"
    Config = UnbalanceConfig
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity.UNBALANCE,)
    takes: ClassVar[frozenset[type]] = frozenset(
        {ImuReading, RotorReading, CommandReading, FlightReading, ImuFilterReading, VibrationReading}
    )
    needs: ClassVar[dict[type, Missing]] = {
        ImuReading: Missing(Reason.NO_IMU, Reason.IMU_STALE),
        RotorReading: Missing(Reason.NO_ROTOR_SPEEDS, Reason.ROTOR_SPEED_STALE),
    }

    def __init__(self, airframe: Airframe, config: UnbalanceConfig | None = None) -> None:
        self.airframe = airframe
        self.config = config or UnbalanceConfig()
        if self.config.baseline is None:
            self.config = replace(self.config, baseline=Baseline.of(airframe))
        _check(airframe, self.config)
        self._mass = airframe.mass if airframe.mass else 1.0
        self._quantity = Quantity.UNBALANCE if airframe.mass else Quantity.UNBALANCE_RELATIVE
        self.quantities = (self._quantity,)  # type: ignore[misc]  # of this airframe
        self.reset()

    @property
    def late(self) -> int:
        """Readings older than what came before them."""
        return self._order.late

    def reset(self) -> None:
        """Forget all that was learned in flight; equal to a new instance."""
        n = self._rotors = len(self.airframe.rotors)
        c = self.config
        self._order = ArrivalOrder(c.late_before_restart)
        self._paper = PaperUnbalance(self.airframe, c.paper) if c.mode == "paper" else None
        damage = c.damage / self._mass if c.damage is not None else None
        self._recommended = RecommendedTracker(self.airframe, c.recommended, damage, c.baseline)
        self._level = VibrationLevel(n, c.level)
        self._inputs = InputRecency(n, c.stale_after)
        self._speeds_known = False
        self._armed: bool | None = None
        self._airborne = True
        self._was: tuple[str, int] = ("", -1)

    def feed(self, reading: Reading) -> list[Estimate]:
        """Take one reading; return estimates where a decision about a rotor changed with it."""
        t = reading.t
        order = self._order
        if not order.takes(t):
            return []
        if order.set_back:
            self.reset()
            self._order = order.begins_anew(t)
        kind = type(reading)
        if kind is RotorReading:
            self._take_speeds(reading)  # type: ignore[arg-type]
        elif kind is not ImuReading:
            self._take_other(reading)
        elif self._take_imu(reading):  # type: ignore[arg-type]
            answer = self._recommended.answer
            now = (answer.verdict.finding.value, answer.verdict.rotor) if answer is not None else ("", -1)
            if now != self._was:
                self._was = now
                return self.estimates(t)
        return []

    def estimates(self, t: float) -> list[Estimate]:
        """Return one estimate per rotor at vehicle time `t` [s]."""
        missing = self._inputs.missing(t)
        if self._paper is not None:
            return self._paper_estimates(self._paper, t, missing)
        if Reason.NO_ROTOR_SPEEDS in missing:
            return self._level_estimates(t, missing)
        answer = self._recommended.answer
        if missing or self._inputs.incomplete:
            return [self._unknown(t, i, self._inputs.reasons(i, missing)) for i in range(self._rotors)]
        if answer is None:
            reasons = [self._recommended.gate or Reason.SETTLING]
            return [self._unknown(t, i, reasons) for i in range(self._rotors)]
        return self._answer_estimates(answer, t)

    @property
    def answer(self) -> Answer | None:
        """The recommended mode's last solution; None before any, and in paper mode."""
        return self._recommended.answer

    def baseline(self) -> Baseline:
        """Return what this flight showed, to be given as `Config(baseline=...)` once it is known healthy."""
        answer, flight = self._recommended.answer, self.config.level.flight
        return Baseline(
            tuple(float(s) ** 0.5 for s in answer.s()) if answer is not None else (),
            self._level.level(flight),
            self._level.autopilots(flight),
            self._level.commanded(flight),
            float(answer.speed.mean()) if answer is not None else NAN,
        )

    # -- readings -----------------------------------------------------------------------------------

    def _take_imu(self, reading: ImuReading) -> bool:
        """Hand on one sample; return whether the recommended mode has a new answer."""
        t, ax, ay, _, _, _, _ = reading
        if not (-MOST < ax < MOST and -MOST < ay < MOST):
            return False
        airborne = self._airborne
        if t > self._inputs.imu_t:
            self._inputs.imu_t = t
        if self._paper is not None:
            self._paper.imu(t, ax, ay, airborne)
            return False
        if not self._speeds_known:  # where they are, the rotors' own unbalances are the better baseline
            self._level.imu(t, ax, ay, airborne)
        return self._recommended.imu(t, ax, ay, airborne)

    def _take_speeds(self, reading: RotorReading) -> None:
        t = reading.t
        last, tracks = self._inputs.speed_t, self._recommended.tracker.tracks
        new = [NAN] * self._rotors
        for i, speed in enumerate(reading.speed[: self._rotors]):
            if -FASTEST < speed < FASTEST and t >= last[i]:
                last[i] = t
                new[i] = speed = abs(speed)
                tracks[i].add(t, speed)
                self._speeds_known = True
        if self._paper is not None:
            self._paper.speeds(np.array(new))

    def _take_other(self, reading: Reading) -> None:
        if isinstance(reading, CommandReading):
            self._level.commands(reading.t, reading.command)
            if self._paper is not None and len(reading.command) == self._rotors:
                self._paper.commands(np.array(reading.command))
        elif isinstance(reading, FlightReading):
            if self._armed is False and reading.armed:  # another flight, perhaps with other propellers
                self._recommended.forget()
                self._level.forget()
            self._armed = reading.armed
            self._airborne = reading.flies
        elif isinstance(reading, ImuFilterReading):
            self._recommended.set_filter(ImuFilter.told(reading))
        elif isinstance(reading, VibrationReading):
            self._level.vibration(reading.t, reading.x, reading.y, self._airborne)

    # -- estimates ----------------------------------------------------------------------------------

    def _make(
        self,
        t: float,
        rotor: int,
        value: float,
        std: float,
        p: float,
        status: Status,
        reasons: list[Reason],
        detectable: float = NAN,
        evidence: Evidence = (),
        speed: float = NAN,
    ) -> Estimate:
        """Return an estimate; value, std and detectable as m_u r_u / m_b [m]; `speed` [rad/s] is the usual one."""
        if self.airframe.mass and value == value:
            told = self.airframe.rotors[rotor]
            balance = figures(value * self._mass, told.radius, told.propeller_mass, speed)
            evidence = (*balance, *evidence)
        return Estimate(
            t,
            self.name,
            rotor,
            self._quantity,
            value * self._mass,
            std * self._mass,
            p,
            status,
            tuple(reasons),
            detectable * self._mass,
            evidence,
        )

    def _unknown(
        self, t: float, rotor: int, reasons: list[Reason], p: float = NAN, evidence: Evidence = ()
    ) -> Estimate:
        warming = t - self._order.first < self.config.absent_after
        status = Status.CONVERGING if warming or reasons == [Reason.SETTLING] else Status.UNOBSERVABLE
        return self._make(t, rotor, NAN, NAN, p, status, reasons, NAN, evidence)

    def _answer_estimates(self, answer: Answer, t: float) -> list[Estimate]:
        """Return what the last solution says."""
        tracker = self._recommended.tracker
        verdict = answer.verdict
        of_all: Evidence = (
            ("filter", tracker.filter.source),
            ("imu_hz", 1.0 / tracker.step),
            ("window_s", answer.window),
            ("block_s", answer.length),
            ("cost_of_none", verdict.present),
            ("cost_of_another", verdict.alone),
            ("leak", answer.leak),
            ("largest", self._motors(answer.largest)),
            ("spins", "opposite to the airframe's" if answer.flipped else "as the airframe's"),
        )
        s, std, seen = answer.s().tolist(), answer.std().tolist(), answer.seen.tolist()
        out = []
        for i, (speed, gain) in enumerate(zip(answer.speed.tolist(), answer.gain.tolist(), strict=True)):
            evidence: Evidence = (
                ("finding", verdict.finding.value),
                ("amplitude_m_s2", math.sqrt(s[i]) * speed**2),
                ("line_hz", speed / (2.0 * math.pi)),
                ("gain", gain),
                *of_all,
            )
            if gain < self.config.recommended.blind:
                out.append(self._unknown(t, i, [Reason.LINE_NOT_IN_TELEMETRY], NAN, evidence))
            else:
                out.append(self._estimate(answer, t, i, _root(s[i], std[i]), seen[i], evidence))
        return out

    def _estimate(
        self,
        answer: Answer,
        t: float,
        rotor: int,
        found: tuple[float, float],
        seen: float,
        evidence: Evidence,
    ) -> Estimate:
        """Return what the last solution says of one rotor that it sees; `found` = value and its spread."""
        verdict = answer.verdict
        reasons = []
        group = next((each for each in answer.together if rotor in each), None)
        if group is not None:
            joint = math.sqrt(float(answer.s()[list(group)].sum())) * self._mass
            evidence = (*evidence, ("one_of_motors", self._motors(group)), ("joint", joint))
            return self._unknown(t, rotor, [Reason.NOT_IDENTIFIABLE], verdict.probability[rotor], evidence)
        if verdict.finding is Finding.PRESENT:
            reasons.append(Reason.NOT_IDENTIFIABLE)
        elif self.config.damage is None and self.config.baseline is None:
            evidence = (*evidence, ("judged_by", "being an outlier: no baseline, no known damage"))
        p = verdict.probability[rotor]
        if p != p:
            reasons.append(Reason.LITTLE_EXCITATION)
        if t - answer.t > self.config.old_after:
            reasons.append(self._recommended.gate or Reason.SETTLING)
        status = Status.CONVERGING if reasons else Status.VALID
        speed = float(answer.speed[rotor])
        return self._make(t, rotor, *found, p, status, reasons, seen, evidence, speed)

    def _motors(self, rotors: tuple[int, ...]) -> str:
        return " ".join(str(self.airframe.rotors[i].motor) for i in rotors)

    def _level_estimates(self, t: float, missing: list[Reason]) -> list[Estimate]:
        """Return what the level of vibration says: of the vehicle, not of a rotor, but where a line follows."""
        n = self._rotors
        baseline = self.config.baseline
        level, window = self._level, self.config.level.window
        evidence: Evidence = (
            ("level_m_s2", level.level(window)),
            ("vibration_m_s2", level.autopilots(window)),
        )
        reasons = [*missing, Reason.NOT_IDENTIFIABLE]
        p = [NAN] * n
        ratio, odds = level.excess(baseline) if baseline is not None else (NAN, NAN)
        if ratio != ratio:
            reasons.append(Reason.NO_BASELINE)
        else:
            present = logistic(odds)
            rotor, r, lead = level.follower()
            evidence = (*evidence, ("over_baseline", ratio), ("present", present))
            p = [present / n] * n
            if rotor >= 0 and odds >= math.log(9.0):
                p = [present if i == rotor else 0.003 for i in range(n)]
                evidence = (*evidence, ("line_follows_r", r), ("lead", lead))
        return [self._unknown(t, i, reasons, p[i], evidence) for i in range(n)]

    def _paper_estimates(self, core: PaperUnbalance, t: float, missing: list[Reason]) -> list[Estimate]:
        n = self._rotors
        if Reason.NO_ROTOR_SPEEDS in missing and core.flown > 0.0:
            missing = [reason for reason in missing if reason is not Reason.NO_ROTOR_SPEEDS]
        if missing or self._inputs.incomplete:
            return [self._unknown(t, i, self._inputs.reasons(i, missing)) for i in range(n)]
        value, std = core.unbalance(), core.std()
        c = self.config.paper
        b = int(np.argmax(value))
        named = value[b] > c.named * np.delete(value, b).max() and value[b] > c.start
        reasons = [Reason.SETTLING] if core.flown < c.settle else []
        status = Status.CONVERGING if reasons else Status.VALID
        evidence: Evidence = (("nis", core.nis), ("noise", c.noise * math.exp(float(core.x[-1]))))
        out = []
        for i in range(n):
            p = (0.9 if named and i == b else 0.05) if not reasons else NAN
            out.append(self._make(t, i, float(value[i]), float(std[i]), p, status, reasons, NAN, evidence))
        return out


def _root(s: float, std: float) -> tuple[float, float]:
    """Return sqrt(s) and its standard deviation; near zero the linear rule would give infinity."""
    value = math.sqrt(s)
    return value, math.sqrt(s + std) - value if std > s else std / (2.0 * value)


def _check(airframe: Airframe, config: UnbalanceConfig) -> None:
    n = len(airframe.rotors)
    if not MIN_ROTORS <= n <= MAX_ROTORS:
        raise AirframeError(f"{airframe.name}: unbalance needs {MIN_ROTORS} to {MAX_ROTORS} rotors, got {n}")
    if any(rotor.spin == 0 for rotor in airframe.rotors):
        raise AirframeError(f"{airframe.name}: unbalance needs to know which way each rotor spins")
    if config.mode not in ("paper", "recommended"):
        raise ConfigError(f"unbalance: mode: expected 'paper' or 'recommended', got {config.mode!r}")
    if config.damage is not None and not config.damage > 0.0:
        raise ConfigError(f"unbalance: damage: expected a number above 0, got {config.damage!r}")
    baseline = config.baseline
    if baseline is not None and len(baseline.unbalance) not in (0, n):
        raise ConfigError(
            f"unbalance: baseline.unbalance: expected {n} values, got {len(baseline.unbalance)}"
        )
