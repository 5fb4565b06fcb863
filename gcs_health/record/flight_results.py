"""Events of a session to what is kept of each flight: per rotor the results, and the alerts.

A vehicle's flight begins when it arms, or with the first word of it where arming was not seen, and lasts
until it arms again. A vehicle that stays disarmed has flown nothing.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from gcs_health.condition.indicators import Indicator
from gcs_health.record.events import (
    AlertEvent,
    ConditionEvent,
    EstimateEvent,
    Event,
    SummaryEvent,
    VehicleEvent,
)

VALID = "valid"


class RotorResult(NamedTuple):
    """One quantity of one rotor over one flight.

    Attributes
    ----------
    value : mean of the valid estimates, NaN if there was none; in the quantity's own unit, SI.
    std : root mean square of their own standard deviations: of one estimate, not of the mean, since
        estimates on end are not independent.
    spread : standard deviation of the valid estimates among themselves.
    samples, valid : estimates; those of them that were valid.
    status : of the last one.
    worst, worst_t, worst_probability : the estimate with the highest failure probability.
    balance_quality : ISO 21940-11's G of an unbalance [mm/s], mean of those valid estimates that have one.
    """

    motor: int
    rotor: int
    estimator: str
    quantity: str
    value: float
    std: float
    spread: float
    samples: int
    valid: int
    status: str
    worst: float
    worst_t: float
    worst_probability: float
    balance_quality: float = math.nan


class FlightRecord(NamedTuple):
    """What is kept of one flight of one vehicle.

    Attributes
    ----------
    vehicle : "sysid.compid". uid : of its autopilot, None if unheard. name : in its vehicle file, "" without one.
    started_us : first stamp [UNIX µs], 0 without stamps. started_t : on the vehicle's clock [s].
    duration : on the vehicle's clock [s].
    alerts : the last step of each.
    condition : each rotor's indicators by regime.
    """

    vehicle: str
    uid: str | None
    name: str
    autopilot: int | None
    vehicle_type: int | None
    started_us: int
    started_t: float
    duration: float
    results: tuple[RotorResult, ...]
    alerts: tuple[AlertEvent, ...]
    condition: tuple[Indicator, ...] = ()

    @property
    def identity(self) -> str:
        """What tells this flight from the vehicle's others: its first stamp, else its first time."""
        return f"us:{self.started_us}" if self.started_us else f"t:{self.started_t:.3f}"

    @property
    def vehicle_identity(self) -> str:
        """The autopilot's uid; else system id and name."""
        return self.uid or f"{self.vehicle} {self.name}".rstrip()


class FlightCollector:
    """Events in, a record out whenever a flight ends; a flight that goes on after all is told anew."""

    def __init__(self) -> None:
        self._vehicles: dict[str, _Flying] = {}

    def feed(self, events: Iterable[Event]) -> list[FlightRecord]:
        """Take events; return the flights that ended with them."""
        ended = []
        for event in events:
            flying = self._vehicles.get(event.vehicle)
            if flying is None:
                flying = self._vehicles[event.vehicle] = _Flying(event)
            record = flying.feed(event)
            if record is not None:
                ended.append(record)
            if isinstance(event, SummaryEvent):  # the end of this input
                del self._vehicles[event.vehicle]
        return ended


class _Flying:
    """One vehicle's flight so far."""

    def __init__(self, event: Event) -> None:
        self._about: VehicleEvent | None = None
        self._begin(event)

    def _begin(self, event: Event) -> None:
        self._first = self._last = event
        self._armed: bool | None = None
        self._sums: dict[tuple[int, str, str], _Sum] = {}
        self._alerts: dict[str, AlertEvent] = {}
        self._condition: tuple[Indicator, ...] = ()

    def feed(self, event: Event) -> FlightRecord | None:
        if isinstance(event, VehicleEvent):
            return self._vehicle(event)
        if isinstance(event, SummaryEvent):
            return self._record()
        if isinstance(event, AlertEvent):
            self._alerts[event.id] = event
        elif isinstance(event, ConditionEvent):
            self._condition = tuple(Indicator(**each) for each in event.indicators)  # type: ignore[arg-type]
        elif (
            isinstance(event, EstimateEvent) and self._armed is not False
        ):  # what is said on the ground is no result of a flight
            self._last = event
            key = (event.motor, event.estimator, event.quantity)
            if key not in self._sums:
                self._sums[key] = _Sum(event.rotor)
            self._sums[key].add(event)
        return None

    def _vehicle(self, event: VehicleEvent) -> FlightRecord | None:
        self._about = event
        before = self._armed
        if event.armed and before is False:
            self._begin(event)
        self._armed = event.armed
        return self._record() if before and event.armed is False else None

    def _record(self) -> FlightRecord | None:
        if not (self._sums or self._alerts):
            return None
        about = self._about
        airframe = about.airframe if about is not None and about.airframe is not None else {}
        return FlightRecord(
            self._first.vehicle,
            about.uid if about is not None else None,
            str(airframe["name"]) if airframe.get("source") == "file" else "",
            about.autopilot if about is not None else None,
            about.vehicle_type if about is not None else None,
            self._first.t_unix_us,
            self._first.t,
            max(self._last.t - self._first.t, 0.0),
            tuple(total.result(*key) for key, total in sorted(self._sums.items())),
            tuple(self._alerts.values()),
            self._condition,
        )


@dataclass(slots=True)
class _Sum:
    """Running sums of one rotor, estimator and quantity."""

    rotor: int
    samples: int = 0
    valid: int = 0
    mean: float = 0.0
    squares: float = 0.0  # of the differences from the mean (Welford 1962)
    variances: float = 0.0
    status: str = ""
    worst: EstimateEvent | None = field(default=None)
    qualities: float = 0.0  # sum of balance qualities [mm/s]
    graded: int = 0

    def add(self, event: EstimateEvent) -> None:
        self.samples += 1
        self.status = event.status
        p = event.failure_probability
        if p == p and (self.worst is None or p > self.worst.failure_probability):
            self.worst = event
        if event.status != VALID or not math.isfinite(event.value):
            return
        self.valid += 1
        step = event.value - self.mean
        self.mean += step / self.valid
        self.squares += step * (event.value - self.mean)
        if math.isfinite(event.std):
            self.variances += event.std**2
        if math.isfinite(event.balance_quality):
            self.qualities += event.balance_quality
            self.graded += 1

    def result(self, motor: int, estimator: str, quantity: str) -> RotorResult:
        n, worst = self.valid, self.worst
        return RotorResult(
            motor,
            self.rotor,
            estimator,
            quantity,
            self.mean if n else math.nan,
            math.sqrt(self.variances / n) if n else math.nan,
            math.sqrt(self.squares / (n - 1)) if n > 1 else math.nan,
            self.samples,
            n,
            self.status,
            worst.value if worst is not None else math.nan,
            worst.t if worst is not None else math.nan,
            worst.failure_probability if worst is not None else math.nan,
            self.qualities / self.graded if self.graded else math.nan,
        )
