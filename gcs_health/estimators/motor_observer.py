"""What is left of each propeller, from rotor speed and motor current alone.

Melczer, "Actuator Fault Detection and Diagnosis for Multirotor Unmanned Aerial Vehicles" (MSc thesis, TU Delft,
2019), whose adaptive observer makes of speed and current the effectiveness of each rotor; for 3 to 12 rotors,
in two modes:

``paper``         the thesis's observer and rule (`adaptive_observer.py`, `motor_observer_paper.py`)
``recommended``   the balance of torques over intervals, with a sequential test (`motor_observer_recommended.py`)

Two quantities of each rotor: EFFECTIVENESS is what is left of its drag now, and its failure probability that of
a lost propeller; DRAG is its drag against its own healthy level and its neighbours', slowly, and its
failure probability that of a partial loss or a rise. A motor that is not driven is neither: it is said as such.
"""

import math
from typing import ClassVar

from gcs_health.airframe import Airframe
from gcs_health.errors import AirframeError, ConfigError
from gcs_health.estimators.arrival import ArrivalOrder
from gcs_health.estimators.contract import Estimate, Missing, Quantity, Reason, Status
from gcs_health.estimators.motor_observer_config import MotorObserverConfig
from gcs_health.estimators.motor_observer_paper import PaperObserver
from gcs_health.estimators.motor_observer_recommended import RecommendedObserver
from gcs_health.estimators.motor_observer_report import (
    Report,
    currents_evidence,
    report_paper,
    report_recommended,
)
from gcs_health.samples import (
    BatteryReading,
    CommandReading,
    FlightReading,
    ImuReading,
    Reading,
    RotorReading,
)

__all__ = ["MotorObserver", "MotorObserverConfig"]

MIN_ROTORS, MAX_ROTORS = 3, 12


class MotorObserver:
    """The estimator of the contract: feed readings in arrival order, ask for estimates.

    Parameters
    ----------
    airframe : 3 to 12 rotors; `airframe.motor` as far as it is known, the rest is learned in flight.
    config : mode and parameters.

    Raises
    ------
    AirframeError : it cannot work on this airframe.
    ConfigError : the mode is not known.

    Examples
    --------
    >>> from gcs_health.airframe import Airframe, AirframeSource, Rotor
    >>> arms = ((1.0, 1.0, 1), (-1.0, -1.0, 1), (1.0, -1.0, -1), (-1.0, 1.0, -1))
    >>> rotors = tuple(Rotor(i + 1, i, (x, y, 0.0), s) for i, (x, y, s) in enumerate(arms))
    >>> observer = MotorObserver(Airframe("quad", rotors, AirframeSource.FILE, metric=False))
    >>> [estimate.reasons[0].value for estimate in observer.estimates(0.0)][:1]
    ['no_rotor_speeds']

    Source: Melczer (2019); sheets 3 and 5.
    """

    name = "motor_observer"
    Config = MotorObserverConfig
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity.EFFECTIVENESS, Quantity.DRAG)
    takes: ClassVar[frozenset[type]] = frozenset(
        {RotorReading, FlightReading, BatteryReading, CommandReading, ImuReading}
    )
    needs: ClassVar[dict[type, Missing]] = {
        RotorReading: Missing(Reason.NO_ROTOR_SPEEDS, Reason.ROTOR_SPEED_STALE),
    }

    def __init__(self, airframe: Airframe, config: MotorObserverConfig | None = None) -> None:
        self.airframe = airframe
        self.config = config or MotorObserverConfig()
        if not MIN_ROTORS <= len(airframe.rotors) <= MAX_ROTORS:
            raise AirframeError(
                f"{airframe.name}: {len(airframe.rotors)} rotors; the motor observer needs "
                f"{MIN_ROTORS} to {MAX_ROTORS}"
            )
        if self.config.mode not in ("paper", "recommended"):
            raise ConfigError(f"mode: expected 'paper' or 'recommended', got '{self.config.mode}'")
        self.reset()

    @property
    def late(self) -> int:
        """Readings older than what came before them."""
        return self._order.late

    def reset(self) -> None:
        """Forget all that was learned in flight; equal to a new instance."""
        self.core: PaperObserver | RecommendedObserver
        if self.config.mode == "paper":
            self.core = PaperObserver(self.airframe, self.config.paper, self.config.level)
        else:
            self.core = RecommendedObserver(self.airframe, self.config.recommended, self.config.level)
        self._order = ArrivalOrder(self.config.late_before_restart)
        self._imu_t = -math.inf
        self._speed_t = [-math.inf] * len(self.airframe.rotors)

    def feed(self, reading: Reading) -> list[Estimate]:
        """Take one reading; return estimates of all rotors where a decision changed with it."""
        kind = type(reading)
        if kind is ImuReading:  # by far the most frequent, and of use to the coupled form alone
            if reading.t < self._imu_t:
                self._order.late += 1
                return []
            self._imu_t = reading.t
            if isinstance(self.core, PaperObserver) and self.core.coupled is not None:
                self.core.imu(reading)  # type: ignore[arg-type]
            return []
        if not self._in_order(reading.t):
            return []
        if isinstance(reading, RotorReading):
            changed = self._take_rotors(reading)
            return self.estimates(reading.t) if changed else []
        if isinstance(reading, FlightReading):
            self.core.flight(reading)
        elif isinstance(self.core, RecommendedObserver):
            if isinstance(reading, BatteryReading):
                self.core.battery(reading)
            elif isinstance(reading, CommandReading):
                self.core.commands(reading)
        return []

    def _take_rotors(self, reading: RotorReading) -> bool:
        for k, speed in enumerate(reading.speed[: len(self._speed_t)]):
            if 0.0 <= speed < math.inf:
                self._speed_t[k] = reading.t
        return self.core.rotors(reading)

    def estimates(self, t: float) -> list[Estimate]:
        """Return effectiveness of every rotor, then drag of every rotor, at vehicle time `t` [s]."""
        core, out = self.core, []
        missing = [self._missing(t, rotor) for rotor in range(len(self._speed_t))]
        currents = () if isinstance(core, PaperObserver) else currents_evidence(core)
        for quantity in self.quantities:
            for rotor, reasons in enumerate(missing):
                if isinstance(core, PaperObserver):
                    report = report_paper(core, rotor, quantity, reasons)
                else:
                    report = report_recommended(core, t, rotor, quantity, reasons, currents)
                out.append(self._estimate(t, rotor, quantity, report))
        return out

    def _estimate(self, t: float, rotor: int, quantity: Quantity, report: Report) -> Estimate:
        status = report.status
        if status is Status.UNOBSERVABLE and t - self._order.first < self.config.absent_after:
            status = Status.CONVERGING
        return Estimate(
            t,
            self.name,
            rotor,
            quantity,
            report.value,
            report.std,
            report.probability,
            status,
            report.reasons,
            report.detectable,
            report.evidence,
        )

    def _missing(self, t: float, rotor: int) -> list[Reason]:
        """Return which inputs of a rotor are missing at t [s]."""
        newest = max(self._speed_t)
        given = self.core.inputs[rotor]
        stale = self.config.stale_after
        if self.config.stale_intervals * given.interval > stale:  # not so for NaN
            stale = self.config.stale_intervals * given.interval
        if newest == -math.inf:
            return [Reason.NO_ROTOR_SPEEDS]
        if t - newest > stale:
            return [Reason.ROTOR_SPEED_STALE]
        if self._speed_t[rotor] == -math.inf:
            return [Reason.ROTOR_NOT_REPORTED]
        if not any([each.currents for each in self.core.inputs]):
            return [Reason.NO_CURRENTS]
        if t - given.t > stale:
            return [Reason.CURRENT_STALE]
        return []

    def _in_order(self, t: float) -> bool:
        order = self._order
        if not order.takes(t):
            return False
        if order.set_back:
            self.reset()
            self._order = order.begins_anew(t)
        return True
