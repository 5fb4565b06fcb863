"""How effective each rotor is, and whether one has failed, from rotor speeds and the IMU.

Strack van Schijndel, Sun, de Visser, "Fast Loss of Effectiveness Detection on a Quadrotor Using
Onboard Sensors and a Kalman Estimation Approach", ICUAS 2023, doi 10.1109/ICUAS57906.2023.10156464;
for 3 to 12 rotors, in two modes:

``paper``         the authors' own filter and rules (`effectiveness_paper.py`)
``recommended``   a bank of single-fault hypotheses behind a flight gate (`effectiveness_recommended.py`)

A motor that stands still makes its own effectiveness unobservable; it is found from its speed
(`stopped_motor.py`). Single faults only: after the first one no other rotor is judged in that flight.
"""

import math
from typing import ClassVar

from gcs_health.airframe import Airframe
from gcs_health.errors import AirframeError, ConfigError
from gcs_health.estimators import effectiveness_words as words
from gcs_health.estimators.arrival import ArrivalOrder
from gcs_health.estimators.contract import Estimate, Missing, Quantity, Reason
from gcs_health.estimators.effectiveness_config import EffectivenessConfig
from gcs_health.estimators.effectiveness_inputs import Inputs
from gcs_health.estimators.effectiveness_paper import PaperFilter
from gcs_health.estimators.effectiveness_recommended import RecommendedBank
from gcs_health.estimators.stopped_motor import StoppedMotor
from gcs_health.estimators.without_speeds import WithoutSpeeds
from gcs_health.gate import GRAVITY, Closed
from gcs_health.samples import CommandReading, FlightReading, ImuReading, Reading, RotorReading

__all__ = ["EffectivenessConfig", "EffectivenessEstimator"]

MIN_ROTORS, MAX_ROTORS = 3, 12
NAN = float("nan")


class EffectivenessEstimator:
    """The estimator of the contract: feed readings in arrival order, ask for estimates.

    Parameters
    ----------
    airframe : 3 to 12 rotors with arms in both axes.
    config : mode and parameters.

    Raises
    ------
    AirframeError : the geometry cannot be used.
    ConfigError : the mode is not known.

    Examples
    --------
    >>> from gcs_health.airframe import Airframe, AirframeSource, Rotor
    >>> arms = ((1.0, 1.0, 1), (-1.0, -1.0, 1), (1.0, -1.0, -1), (-1.0, 1.0, -1))
    >>> rotors = tuple(Rotor(i + 1, i, (x, y, 0.0), s) for i, (x, y, s) in enumerate(arms))
    >>> estimator = EffectivenessEstimator(Airframe("quad", rotors, AirframeSource.FILE, metric=False))
    >>> [estimate.reasons[0].value for estimate in estimator.estimates(0.0)][:1]
    ['no_imu']

    Source: Strack van Schijndel et al. (2023); sheets 1 and 5.
    """

    name = "effectiveness"
    Config = EffectivenessConfig
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity.EFFECTIVENESS,)
    takes: ClassVar[frozenset[type]] = frozenset({ImuReading, RotorReading, CommandReading, FlightReading})
    needs: ClassVar[dict[type, Missing]] = {
        ImuReading: Missing(Reason.NO_IMU, Reason.IMU_STALE),
        RotorReading: Missing(Reason.NO_ROTOR_SPEEDS, Reason.ROTOR_SPEED_STALE),
    }

    def __init__(self, airframe: Airframe, config: EffectivenessConfig | None = None) -> None:
        self.airframe = airframe
        self.config = config or EffectivenessConfig()
        _check(airframe, self.config)
        self.reset()

    @property
    def late(self) -> int:
        """Readings older than what came before them."""
        return self._order.late

    def reset(self) -> None:
        """Forget all that was learned in flight; equal to a new instance."""
        n = len(self.airframe.rotors)
        self._order = ArrivalOrder(self.config.late_before_restart)
        self._core: PaperFilter | RecommendedBank
        if self.config.mode == "paper":
            self._core = PaperFilter(self.airframe, self.config.paper)
        else:
            self._core = RecommendedBank(self.airframe, self.config.recommended)
        self._stopped_rule = StoppedMotor(n, self.config.stopped)
        self._stopped: int | None = None
        self._stopped_ratio = NAN
        self._bare: WithoutSpeeds | None = None
        if self.config.mode == "recommended":
            self._bare = WithoutSpeeds(self.airframe, self.config.contradiction, self.config.trim)
        self._inputs = Inputs(n, self.config.stale_after)
        self._speeds = self._inputs.speeds
        self._told: tuple[int | None, bool] = (None, False)  # what was decided when last something was said
        self._armed: bool | None = None
        self._still_since = NAN
        self._flight_over = False

    def feed(self, reading: Reading) -> list[Estimate]:
        """Take one reading; return estimates of the rotors about which a decision changed with it."""
        t = reading.t
        order = self._order
        if order.newest <= t < math.inf and not order.late_row:
            order.newest = t
        elif not self._in_order(t):
            return []
        kind = type(reading)
        if kind is ImuReading:
            self._inputs.imu_t = t
            changed = self._core.imu(reading)  # type: ignore[arg-type]
            if self._bare is not None:
                changed = self._bare.imu(reading) or changed  # type: ignore[arg-type]
        elif kind is RotorReading:
            changed = self._take_speeds(reading)  # type: ignore[arg-type]
        else:
            changed = self._take_seldom(reading)
        if self._flight_over and self._flies():
            self._new_flight()
            changed = True
        if not changed:
            return []
        was, doubted = self._told
        now, doubtful = self._told = (self._failed(), self._contradicted())
        estimates = self.estimates(t)
        if doubtful != doubted:
            return estimates
        return [estimate for estimate in estimates if now != was and estimate.rotor in (was, now)]

    @property
    def bank(self) -> RecommendedBank | None:
        """What the recommended mode knows; None in paper mode."""
        return self._core if isinstance(self._core, RecommendedBank) else None

    @property
    def without_speeds(self) -> WithoutSpeeds | None:
        """What commands and rates tell; None once rotor speeds have come, and in paper mode."""
        return self._bare

    def _take_seldom(self, reading: Reading) -> bool:
        """Hand on what is neither IMU nor rotor speeds; return whether a decision changed."""
        if isinstance(reading, CommandReading):
            self._inputs.take_commands(reading)
            if isinstance(self._core, RecommendedBank):
                self._core.commands(reading)
            return self._bare is not None and self._bare.commands(reading)
        if isinstance(reading, FlightReading):
            self._take_flight(reading)
        return False

    def estimates(self, t: float) -> list[Estimate]:
        """Return one estimate per rotor at vehicle time `t` [s]."""
        common = self._inputs.missing(t)
        failed = self._failed()
        bare = self._bare
        if bare is not None and bare.heard and Reason.NO_ROTOR_SPEEDS in common:
            return [bare.estimate(t, i, common) for i in range(len(self._speeds))]
        core = self._core
        warming = t - self._order.first < self.config.absent_after
        if isinstance(core, PaperFilter):
            return [self._of_paper(core, t, i, common, warming) for i in range(len(self._speeds))]
        if failed is not None:
            return [self._after_failure(core, t, i, failed) for i in range(len(self._speeds))]
        likelihoods, information = core.standing
        probabilities = words.probabilities(core, likelihoods)
        return [
            words.healthy(
                core,
                t,
                i,
                self._inputs.reasons(i, common),
                probabilities[i],
                information[i],
                self._speeds[i],
                warming,
            )
            for i in range(len(self._speeds))
        ]

    def _after_failure(self, core: RecommendedBank, t: float, rotor: int, failed: int) -> Estimate:
        if rotor != failed:
            return words.missing(t, rotor, [Reason.ANOTHER_ROTOR_FAILED], False)
        if self._stopped is not None:
            return words.stopped(t, rotor, self._stopped_ratio)
        return words.lost(core, t, rotor)

    def _of_paper(
        self, core: PaperFilter, t: float, rotor: int, common: list[Reason], warming: bool
    ) -> Estimate:
        if self._stopped == rotor:
            return words.stopped(t, rotor, self._stopped_ratio)
        reasons = self._inputs.reasons(rotor, common)
        return words.missing(t, rotor, reasons, warming) if reasons else words.of_paper(core, t, rotor)

    def _in_order(self, t: float) -> bool:
        order = self._order
        if not order.takes(t):
            return False
        if order.set_back:
            self.reset()
            self._order = order.begins_anew(t)
        return True

    def _take_speeds(self, reading: RotorReading) -> bool:
        self._bare = None  # rotor speeds come: they tell more
        slowest = self._inputs.take_speeds(reading)
        changed = self._core.rotor_speeds(reading, slowest > 0.0)
        hover = self._hover()
        if slowest > self.config.flight_over_speed * hover:
            self._still_since = NAN
        else:
            self._watch_flight_end(reading.t, hover)
        if self._stopped is None and self._core.failed is None:
            told = self._inputs.commands, self._inputs.commands_t
            stopped = self._stopped_rule.feed(
                reading.t, self._speeds, hover, *told, self._would_name(reading.t)
            )
            if stopped is not None:
                self._stopped = stopped
                self._stopped_ratio = self._speeds[stopped] / hover
                return True
        return changed

    def _would_name(self, t: float) -> bool:
        """Whether a lost propeller would have been named by now."""
        if t - self._inputs.imu_t > self.config.stale_after:
            return False
        if isinstance(self._core, RecommendedBank):
            return self._core.gate.open and not self._core.contradicted
        return self._core.armed

    def _take_flight(self, reading: FlightReading) -> None:
        if self._armed and reading.armed is False:
            self._end_flight()
        if self._bare is not None and reading.armed and not self._armed:
            self._bare.restart()  # another flight
        if reading.armed is not None:
            self._armed = reading.armed
        if isinstance(self._core, RecommendedBank):
            self._core.gains.set_airborne(reading.landed is False and reading.armed is not False)

    def _watch_flight_end(self, t: float, hover: float) -> None:
        limit = self.config.flight_over_speed * hover
        still = hover < math.inf and not any([speed >= limit for speed in self._speeds])
        if not still:
            self._still_since = NAN
        elif self._still_since != self._still_since:
            self._still_since = t
        elif t - self._still_since > self.config.flight_over_after:
            self._end_flight()

    def _end_flight(self) -> None:
        self._flight_over = True
        if isinstance(self._core, RecommendedBank):
            self._core.gate.close(Closed.ON_GROUND)

    def _flies(self) -> bool:
        if isinstance(self._core, RecommendedBank):
            return self._core.gate.open
        known = [speed for speed in self._speeds if speed == speed]
        return bool(known) and sum(known) > self.config.stopped.others * self._hover() * len(known)

    def _new_flight(self) -> None:
        self._flight_over = False
        self._stopped = None
        if isinstance(self._core, RecommendedBank):
            self._core.new_flight()
        else:
            self._core = PaperFilter(self.airframe, self.config.paper)

    def _hover(self) -> float:
        if isinstance(self._core, RecommendedBank):
            return self._core.hover
        return math.sqrt(GRAVITY / (len(self._speeds) * self._core.thrust))

    def _failed(self) -> int | None:
        if self._bare is not None:
            return self._bare.failed
        return self._core.failed if self._stopped is None else self._stopped

    def _contradicted(self) -> bool:
        return isinstance(self._core, RecommendedBank) and self._core.contradicted


def _check(airframe: Airframe, config: EffectivenessConfig) -> None:
    rotors = airframe.rotors
    if not MIN_ROTORS <= len(rotors) <= MAX_ROTORS:
        raise AirframeError(
            f"{airframe.name}: {len(rotors)} rotors; effectiveness needs {MIN_ROTORS} to {MAX_ROTORS}"
        )
    for axis, word in ((0, "forward"), (1, "right")):
        reach = [rotor.position[axis] for rotor in rotors]
        if not max(reach) - min(reach) > 0.0:
            raise AirframeError(f"{airframe.name}: all rotors are equally far {word}: no moment to see")
    if config.mode not in ("paper", "recommended"):
        raise ConfigError(f"mode: expected 'paper' or 'recommended', got '{config.mode}'")
