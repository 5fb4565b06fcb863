"""One log to all that is said of it: what notebooks, reports and the fleet command call.

    flight = replay("flight.tlog")

The log goes through the same `Monitor` as a live link, block by block; what is kept of it is columns.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from typing import TYPE_CHECKING

import numpy as np

from gcs_health.errors import ConfigError, LogError
from gcs_health.flight_columns import (
    EVENT_TABLES,
    READING_TABLES,
    Columns,
    EstimateColumns,
    ReadingColumns,
    event_columns,
)
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, EstimateEvent, Event, SummaryEvent
from gcs_health.record.flight_results import FlightCollector, FlightRecord, RotorResult
from gcs_health.samples import Reading
from gcs_health.survey import Survey

if TYPE_CHECKING:
    import pandas

HEALTHY, FINDINGS, NOT_JUDGED = "healthy", "findings", "not judged"
TABLES = ("estimates", "results", *EVENT_TABLES, *READING_TABLES)


@dataclass(frozen=True)
class Flight:
    """What a log said.

    Attributes
    ----------
    log : its name. config : with which it was replayed.
    events : all but the estimates, in their order.
    estimates : as columns, see `columns`.
    records : what the history keeps of each flight in the log.
    survey : what was in the log, message by message.
    motors : the motor numbers of each vehicle, in the airframe's order; empty where that stayed unknown.
    """

    log: str
    config: MonitorConfig
    events: tuple[Event, ...]
    estimates: Columns
    records: tuple[FlightRecord, ...]
    survey: Survey
    motors: dict[str, tuple[int, ...]]
    _readings: dict[str, ReadingColumns]

    @property
    def summaries(self) -> tuple[SummaryEvent, ...]:
        """One for each vehicle in the log."""
        return tuple(event for event in self.events if isinstance(event, SummaryEvent))

    @property
    def vehicles(self) -> tuple[str, ...]:
        """The vehicles in the log, each as "sysid.compid"."""
        return tuple(summary.vehicle for summary in self.summaries)

    @property
    def alerts(self) -> tuple[AlertEvent, ...]:
        """Every step of every alert."""
        return tuple(event for event in self.events if isinstance(event, AlertEvent))

    @property
    def outcome(self) -> str:
        """In one word: "findings" if an alert was raised, "healthy", or "not judged".

        Healthy is a vehicle of whose every rotor some estimator knew something valid, without an alert.
        Silence alone is not health.
        """
        if self.alerts:
            return FINDINGS
        return HEALTHY if self.vehicles and all(map(self._judged, self.vehicles)) else NOT_JUDGED

    def columns(self, table: str, vehicle: str | None = None) -> Columns:
        """Return one table as numpy columns of equal length, by name.

        Parameters
        ----------
        table : one of `TABLES`: "estimates", "results" (one row a rotor, estimator, quantity and flight),
            "alerts", "verdicts", "autopilot", "vehicle" (the events of those types), and of one vehicle what
            reached its estimators: "imu" [m/s², rad/s], "rotors" [rad/s, A, V], "commands" [0..1], "battery",
            "vibration", "phase". `t` is seconds on the vehicle's clock, rotors are named by motor number.
        vehicle : "sysid.compid", of the last six; None = the log's first.

        Raises
        ------
        ConfigError : there is no such table or vehicle.
        """
        if table == "estimates":
            return self.estimates
        if table == "results":
            return self._results()
        if table in EVENT_TABLES:
            return event_columns(self.events, EVENT_TABLES[table])
        if table not in READING_TABLES:
            raise ConfigError(f"expected a table of {', '.join(TABLES)}, got {table!r}")
        vehicle = vehicle or next(iter(self.vehicles), None)
        if vehicle not in self.motors:
            raise ConfigError(f"{self.log}: no vehicle {vehicle} in it; it holds {', '.join(self.vehicles)}")
        return self._readings.get(vehicle, ReadingColumns()).columns(table, self.motors[vehicle])

    def frame(self, table: str, vehicle: str | None = None) -> "pandas.DataFrame":
        """Return one table as a `pandas.DataFrame`; see `columns`.

        Raises
        ------
        ConfigError : as `columns`, or pandas is not installed.
        """
        try:
            import pandas
        except ModuleNotFoundError:
            raise ConfigError("a DataFrame needs pandas: pip install pandas") from None
        return pandas.DataFrame(self.columns(table, vehicle))

    def _judged(self, vehicle: str) -> bool:
        known = {
            result.motor
            for record in self.records
            if record.vehicle == vehicle
            for result in record.results
            if result.valid
        }
        return bool(self.motors[vehicle]) and known.issuperset(self.motors[vehicle])

    def _results(self) -> Columns:
        rows = [(record, result) for record in self.records for result in record.results]
        heads = {
            "vehicle": np.array([record.vehicle for record, _ in rows], object),
            "flight": np.array([record.identity for record, _ in rows], object),
            "started_us": np.array([record.started_us for record, _ in rows], np.int64),
        }
        return heads | event_columns([result for _, result in rows], RotorResult)


def replay(
    log: str | PathLike[str],
    config: MonitorConfig | None = None,
    *,
    readings: bool = True,
    estimates_every: float = 0.0,
    receivers: Sequence[Callable[[Sequence[Event]], None]] = (),
) -> Flight:
    """Run a recorded flight through the monitor; return what it said.

    Parameters
    ----------
    log : a file, a .zip with one in it, a folder of them; "-" is standard input. Formats: see `docs/howto/logs.md`.
    config : what the user may choose; None = all estimators as recommended, the airframe from the log.
        Its `stamped` is set here, and with `readings` its `tap`.
    readings : keep what reached the estimators too (the IMU's part grows with the log: 56 bytes a sample).
    estimates_every : of one rotor, estimator and quantity keep one estimate in so many seconds; 0 = all of
        them. What is judged does not change.
    receivers : called with all events as they come.

    Raises
    ------
    LogError : the log cannot be read, or there is no vehicle in it.
    """
    kept: dict[str, ReadingColumns] = {}

    def tap(vehicle: str, reading: Reading) -> None:
        kept.setdefault(vehicle, ReadingColumns()).add(reading)

    events: list[Event] = []
    estimates, collector = EstimateColumns(estimates_every), FlightCollector()
    records: dict[tuple[str, str], FlightRecord] = {}

    def take(news: list[Event]) -> None:
        for event in news:
            if isinstance(event, EstimateEvent):
                estimates.add(event)
            else:
                events.append(event)
        for record in collector.feed(news):  # a flight that goes on after all is told anew
            records[record.vehicle, record.identity] = record
        for receiver in receivers:
            receiver(news)

    with open_log(fspath(log)) as opened:
        config = config or MonitorConfig()
        chosen = replace(config, stamped=opened.stamped, tap=tap if readings else config.tap)
        monitor = Monitor(chosen)
        for block in opened.blocks():
            take(monitor.feed(block))
        take(monitor.finish())
    motors = {
        vehicle.vehicle: tuple(rotor.motor for rotor in vehicle.airframe.rotors) if vehicle.airframe else ()
        for vehicle in monitor.vehicles()
    }
    survey = monitor.survey()
    if not motors:
        systems = ", ".join(f"{s.system}.{s.component} ({s.role})" for s in survey.systems)
        raise LogError(f"{opened.name}: no vehicle in this log; it holds {systems or 'no checked frame'}")
    return Flight(
        opened.name,
        replace(chosen, tap=None),
        tuple(events),
        estimates.columns(),
        tuple(records.values()),
        survey,
        motors,
        kept,
    )
