"""How far each rotor is degraded, by the vibration that its speed leaves in the structure, or by the speed itself.

Dutta, Niemiec, Kopsaftopoulos, Gandhi, "Rotor fault diagnosis on a hexacopter via functionally pooled stochastic
models", 2023: one AR model a rotor whose coefficients are functions of the degradation k = 1 - W / W_cmd. For 3
to 12 rotors, in two modes:

``paper``         one signal, t-test, whiteness test and intervals as printed (`pooled_ar_paper.py`)
``recommended``   trained models that refuse what they were not trained for (`pooled_ar_watch.py`), and beside
                  them the rotor speeds (`speed_deficit.py`); who is surest answers, the others corroborate

Without a trained model (`pooled_ar_training.py`) the vibration says no value, and the reasons say so; from healthy
flights alone (`healthy_vibration.py`) it says that it has changed, of no rotor in particular. Of rotors that look
alike (a rotor and its opposite) none is named unless commands or the onset tell them apart.
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from gcs_health.airframe import Airframe
from gcs_health.errors import AirframeError, ConfigError
from gcs_health.estimators.arrival import ArrivalOrder
from gcs_health.estimators.contract import Estimate, Missing, Quantity, Reason, Status
from gcs_health.estimators.healthy_vibration import HealthyWatch
from gcs_health.estimators.pooled_ar_answers import Answer, ModelAlarm, by_speeds, by_vibration
from gcs_health.estimators.pooled_ar_model import PooledModel
from gcs_health.estimators.pooled_ar_paper import PaperConfig, PaperWatch
from gcs_health.estimators.pooled_ar_watch import ModelWatch, WatchConfig
from gcs_health.estimators.speed_deficit import SpeedConfig, SpeedDeficit
from gcs_health.estimators.speed_span import lookalikes
from gcs_health.samples import (
    BoomReading,
    CommandReading,
    FlightReading,
    ImuFilterReading,
    ImuReading,
    Reading,
    RotorReading,
)

__all__ = ["PooledArConfig", "PooledArEstimator"]

MIN_ROTORS, MAX_ROTORS = 3, 12
NAN = float("nan")
SUSPECT = 0.44  # failure probability of each of two rotors that look alike, at the alarm threshold


@dataclass(frozen=True, slots=True)
class PooledArConfig:
    """Mode, trained models and parameters.

    models : of this vehicle, one a regime and sensor chain; that which fits the air answers. The paper's mode
        takes the first.
    """

    mode: Literal["paper", "recommended"] = "recommended"
    models: tuple[PooledModel, ...] = ()
    watch: WatchConfig = field(default_factory=WatchConfig)
    speed: SpeedConfig = field(default_factory=SpeedConfig)
    paper: PaperConfig = field(default_factory=PaperConfig)
    absent_after: float = 2.0  # s of stream after which a missing input is called absent
    stale_after: float = 1.0  # s
    late_before_restart: int = 20  # late readings on end that mean that the clock was set back


class PooledArEstimator:
    """The estimator of the contract: feed readings in arrival order, ask for estimates.

    Parameters
    ----------
    airframe : 3 to 12 rotors.
    config : mode, trained models, parameters.

    Attributes
    ----------
    needs : what it needs without a trained model; with one, the signal that the model was trained on does.

    Raises
    ------
    AirframeError : too few or too many rotors, or a model of rotors that the airframe does not have.
    ConfigError : the mode is not known.

    Examples
    --------
    >>> from gcs_health.airframe import Airframe, AirframeSource, Rotor
    >>> arms = ((1.0, 1.0, 1), (-1.0, -1.0, 1), (1.0, -1.0, -1), (-1.0, 1.0, -1))
    >>> rotors = tuple(Rotor(i + 1, i, (x, y, 0.0), s) for i, (x, y, s) in enumerate(arms))
    >>> estimator = PooledArEstimator(Airframe("quad", rotors, AirframeSource.FILE, metric=False))
    >>> [reason.value for reason in estimator.estimates(0.0)[0].reasons]
    ['no_rotor_speeds', 'no_model']

    Source: Dutta et al. (2023); sheet 4.
    """

    name = "pooled_ar"
    Config = PooledArConfig
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity.DEGRADATION,)
    takes: ClassVar[frozenset[type]] = frozenset(
        {ImuReading, BoomReading, RotorReading, CommandReading, FlightReading, ImuFilterReading}
    )
    needs: ClassVar[dict[type, Missing]] = {
        RotorReading: Missing(Reason.NO_ROTOR_SPEEDS, Reason.ROTOR_SPEED_STALE),
    }

    def __init__(self, airframe: Airframe, config: PooledArConfig | None = None) -> None:
        self.airframe = airframe
        self.config = config or PooledArConfig()
        _check(airframe, self.config)
        self._alike = lookalikes(airframe)
        self.reset()

    @property
    def late(self) -> int:
        """Readings older than what came before them."""
        return self._order.late

    def reset(self) -> None:
        """Forget all that was learned in flight; equal to a new instance."""
        c = self.config
        self._order = ArrivalOrder(self.config.late_before_restart)
        self._suspect: frozenset[int] = frozenset()
        self._paper = PaperWatch(c.models[0], c.paper) if c.mode == "paper" and c.models else None
        recommended = c.mode == "recommended"
        self._watches = [ModelWatch(model, c.watch) for model in c.models] if recommended else []
        self._alarms = [ModelAlarm(c.watch.hold) for _ in self._watches]
        facts = next((model.speeds for model in c.models if model.speeds is not None), None)
        healthy = self.airframe.healthy_vibration if recommended else None
        self._healthy = None if healthy is None else HealthyWatch(healthy, c.watch)
        self._speeds = SpeedDeficit(self.airframe, c.speed, facts)

    def feed(self, reading: Reading) -> list[Estimate]:
        """Take one reading; return estimates of the rotors that are suspected, or no longer, with it."""
        if not self._in_order(reading.t):
            return []
        if not self._take(reading):
            return []
        t = reading.t
        chosen = [_surest(self._answers(t, i)[0]) for i in range(len(self.airframe.rotors))]
        suspect = frozenset(
            [i for i, one in enumerate(chosen) if one is not None and one.probability > SUSPECT]
        )
        changed, self._suspect = suspect ^ self._suspect, suspect
        return [self._estimate(t, i) for i in sorted(changed)]

    def estimates(self, t: float) -> list[Estimate]:
        """Return one estimate per rotor at vehicle time `t` [s]."""
        return [self._estimate(t, i) for i in range(len(self.airframe.rotors))]

    def _take(self, reading: Reading) -> bool:
        """Hand a reading to its parts; return whether there is a new answer."""
        if self._healthy is not None and isinstance(reading, ImuReading | FlightReading | ImuFilterReading):
            self._healthy.feed(reading)
        if isinstance(reading, (ImuReading, BoomReading)):
            new = self._paper is not None and self._paper.feed(reading)
            for watch, alarm in zip(self._watches, self._alarms, strict=True):
                if type(reading) is watch.takes and watch.feed(reading):
                    new = True
                    alarm.update(watch)
            return new
        if isinstance(reading, RotorReading):
            return self._speeds.speeds(reading)
        if isinstance(reading, CommandReading):
            return self._speeds.commands(reading)
        if isinstance(reading, FlightReading):
            self._speeds.landed = not reading.flies
        elif isinstance(reading, ImuFilterReading):
            for watch in self._watches:
                watch.filtered(reading.mean_over, reading.cutoff)
        return False

    def _in_order(self, t: float) -> bool:
        order = self._order
        if not order.takes(t):
            return False
        if order.set_back:
            self.reset()
            self._order = order.begins_anew(t)
        return True

    def _estimate(self, t: float, rotor: int) -> Estimate:
        answers, reasons = self._answers(t, rotor)
        changed, figures = self._healthy.told(t, self.config.stale_after) if self._healthy else ((), ())
        chosen = _surest(answers)
        if chosen is None:
            warming = t - self._order.first < self.config.absent_after
            status = Status.CONVERGING if warming else Status.UNOBSERVABLE
            reasons = (*changed, *reasons)
            return Estimate(
                t, self.name, rotor, Quantity.DEGRADATION, NAN, NAN, NAN, status, reasons, NAN, figures
            )
        status = Status.VALID if chosen.valid else Status.CONVERGING
        reasons = chosen.reasons if chosen.valid else tuple(dict.fromkeys((*chosen.reasons, *reasons)))
        return Estimate(
            t,
            self.name,
            rotor,
            Quantity.DEGRADATION,
            min(max(chosen.k, 0.0), 1.0),
            chosen.std,
            chosen.probability,
            status,
            (*changed, *reasons),
            chosen.detectable,
            (*self._evidence(chosen, answers), *figures),
        )

    def _evidence(self, chosen: Answer, answers: list[Answer]) -> tuple[tuple[str, float | str], ...]:
        """Say which path answered, what the others found, and which rotors it may be."""
        said: list[tuple[str, float | str]] = [
            ("by", chosen.source),
            ("probability_anywhere", chosen.anywhere),
        ]
        said += [(f"k_by_{one.source}", one.k) for one in answers]
        if len(chosen.candidates) > 1:
            motors = sorted(self.airframe.rotors[i].motor for i in chosen.candidates)
            said.append(("candidates", " or ".join(map(str, motors))))
        return tuple(said)

    def _answers(self, t: float, rotor: int) -> tuple[list[Answer], tuple[Reason, ...]]:
        """Return what each path says of a rotor, and why others are silent."""
        if self.config.mode == "paper":
            return self._paper_answer(t, rotor)
        answers: list[Answer] = []
        reasons = self._speeds_missing(t, rotor)
        view = self._speeds.views[rotor]
        if not reasons and view is not None:
            answers.append(by_speeds(self._speeds, rotor, view))
        for watch, alarm in zip(self._watches, self._alarms, strict=True):
            missing = watch.missing(t, self.config.stale_after)
            if not missing and watch.verdict is not None:
                missing = watch.verdict.blind
            answer = None if missing else by_vibration(watch, alarm, rotor, self._alike)
            reasons += missing
            if answer is not None:
                answers.append(answer)
            elif not missing:
                reasons.append(Reason.NO_MODEL)
        if not self._watches:
            reasons.append(Reason.NO_MODEL)
        return answers, tuple(dict.fromkeys(reasons))

    def _speeds_missing(self, t: float, rotor: int) -> list[Reason]:
        """Return why the speed path is silent about a rotor; empty = it answers."""
        s, stale = self._speeds, self.config.stale_after
        if s.speeds_at == -math.inf:
            return [Reason.NO_ROTOR_SPEEDS]
        if t - s.speeds_at > stale:
            return [Reason.ROTOR_SPEED_STALE]
        if s.speed_t[rotor] == -math.inf:
            return [Reason.ROTOR_NOT_REPORTED]
        if min(s.speed_t) == -math.inf:
            return [Reason.ROTOR_SPEEDS_INCOMPLETE]
        if s.views[rotor] is not None:
            return []
        if s.landed:
            return [Reason.ON_GROUND]
        if t - s.commands_at > stale and not s.span.shown[rotor]:
            return [Reason.NO_COMMANDS]
        return [Reason.ROTORS_BELOW_HOVER]

    def _paper_answer(self, t: float, rotor: int) -> tuple[list[Answer], tuple[Reason, ...]]:
        if self._paper is None:
            return [], (Reason.NO_MODEL,)
        missing = self._paper.missing(t, self.config.stale_after)
        view = None if missing else self._paper.views.get(rotor)
        if view is None:
            return [], missing or (Reason.NO_MODEL,)
        reasons = () if view.full else (Reason.FILLING,)
        p = self._paper.probability(rotor)
        white = tuple(one for one, other in self._paper.views.items() if other.white)
        answer = Answer(
            "vibration", view.k, view.std, p, float(self._paper.detected), NAN, white, reasons, view.full
        )
        return [answer], reasons


def _surest(answers: list[Answer]) -> Answer | None:
    """Return the answer of the least spread, of those fit to be told if any is; None where there is none."""
    if len(answers) < 2:
        return answers[0] if answers else None
    valid = [one for one in answers if one.valid]
    return min(valid or answers, key=lambda one: one.std)


def _check(airframe: Airframe, config: PooledArConfig) -> None:
    if config.mode not in ("paper", "recommended"):
        raise ConfigError(f"pooled_ar: mode: expected 'paper' or 'recommended', got {config.mode!r}")
    count = len(airframe.rotors)
    if not MIN_ROTORS <= count <= MAX_ROTORS:
        raise AirframeError(f"{airframe.name}: expected {MIN_ROTORS} to {MAX_ROTORS} rotors, got {count}")
    for model in config.models:
        if model.rotors and model.rotors[-1] >= count:
            raise AirframeError(f"{airframe.name}: a model of rotor {model.rotors[-1] + 1}, {count} rotors")
        if config.mode == "paper" and len(model.channels) > 1:
            raise ConfigError("pooled_ar: mode: the paper's takes a model of one signal")
