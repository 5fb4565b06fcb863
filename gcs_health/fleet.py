"""Many logs to tables: one log is one task, `analyse(job)`; what comes back are rows, not columns of samples.

    flights    a row for each flight of each vehicle, and one for a log that could not be used
    rotors     a row for each quantity of each rotor and flight, with the regime it was flown in
    events     alerts, verdicts, what the autopilot said and what became known of a vehicle

A worker's memory is the log's block, the estimators, and one estimate a quantity, rotor and `EVERY` seconds.
"""

import hashlib
import math
import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from gcs_health import __version__
from gcs_health.errors import ConfigError, GcsHealthError, LogError
from gcs_health.flight import FINDINGS, HEALTHY, NOT_JUDGED, Flight, replay
from gcs_health.pipeline import MonitorConfig
from gcs_health.record.events import (
    AlertEvent,
    AutopilotEvent,
    Event,
    VehicleEvent,
    VerdictEvent,
    to_json,
)
from gcs_health.record.flight_results import FlightRecord
from gcs_health.samples import Reading, RotorReading

UNUSABLE = "unusable"
OUTCOMES = (FINDINGS, HEALTHY, NOT_JUDGED, UNUSABLE)
EVERY = 30.0  # s between estimates kept: the results have all of them, in sums
LOG_SUFFIXES = (".tlog", ".rlog", ".raw", ".ulg", ".bin")
PACKED = (".gz", ".xz", ".zst")
TURNING = 100.0  # rad/s; below, a rotor idles or stands

Row = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """One log to do: where it lies, its size and time, and with which configuration.

    `aircraft` says whose it is; empty = what the log says, the autopilot's uid or system id and name.
    """

    log: str
    size: int
    mtime_ns: int
    config: MonitorConfig
    aircraft: str = ""

    @property
    def key(self) -> str:
        """What this result is a function of: the log as it is, this version, the configuration."""
        parts = (self.log, self.size, self.mtime_ns, __version__, config_digest(self.config), self.aircraft)
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:24]


class Analysed(NamedTuple):
    """What comes back of one log."""

    flights: list[Row]
    rotors: list[Row]
    events: list[Row]
    records: list[FlightRecord]

    @property
    def outcome(self) -> str:
        """Of the whole log."""
        return str(self.flights[0]["outcome"])


def config_digest(config: MonitorConfig) -> str:
    """Return what tells configurations apart; keys are secret and change nothing that is judged of a good log."""
    rules = [(c.vehicle, c.code, c.key, c.value) for c in config.rules.changes]
    models = [(m.vehicle, m.regime, m.bias, m.threshold, m.tail, m.facts) for m in config.vibration_models]
    # models count by what is in them, not by where they lie
    airframe = config.airframe and replace(config.airframe, vibration_models=(), vibration_alarms=())
    plain = (airframe, config.estimators, config.mode, config.estimate_rate, rules, models)
    return hashlib.sha256(repr(plain).encode()).hexdigest()[:16]


def find_logs(places: Iterable[str], config: MonitorConfig, *, by_folder: bool = False) -> list[Job]:
    """Return every log named, and those in every folder named, each once.

    Parameters
    ----------
    by_folder : the folder that a log lies in is named after its aircraft.

    Raises
    ------
    ConfigError : a folder holds none, or a URL cannot be listed.
    """
    found: dict[str, Job] = {}
    for place in places:
        jobs = list(_remote(place, config) if "://" in place else _local(Path(place), config))
        if not jobs:
            raise ConfigError(f"{place}: no log in it (looked for {', '.join(LOG_SUFFIXES)}, packed or not)")
        found |= {job.log: job for job in jobs}
    if by_folder:
        return [
            replace(job, aircraft=job.log.replace("\\", "/").split("/")[-2:][0]) for job in found.values()
        ]
    return list(found.values())


def is_log(name: str) -> bool:
    """Whether a file is called like a log."""
    stem = name.lower()
    for suffix in PACKED:
        stem = stem.removesuffix(suffix)
    return stem.endswith(LOG_SUFFIXES)


def _local(place: Path, config: MonitorConfig) -> Iterator[Job]:
    paths = (
        sorted(p for p in place.rglob("*") if is_log(p.name) and p.is_file()) if place.is_dir() else [place]
    )
    for path in paths:
        try:
            stat = path.stat()
            yield Job(str(path), stat.st_size, stat.st_mtime_ns, config)
        except OSError:
            yield Job(str(path), 0, 0, config)  # the worker will say what is wrong with it


def _remote(place: str, config: MonitorConfig) -> Iterator[Job]:
    try:
        import fsspec
    except ModuleNotFoundError:
        raise ConfigError(f"{place}: a URL needs fsspec: pip install 'gcs-health[fleet]'") from None
    try:
        system, path = fsspec.core.url_to_fs(place)
        files = system.find(path, detail=True) if system.isdir(path) else {path: system.info(path)}
    except Exception as error:  # each of fsspec's file systems has errors of its own
        raise ConfigError(f"{place}: cannot list it: {error}") from None
    for name, about in sorted(files.items()):
        if is_log(name) or len(files) == 1:
            yield Job(system.unstrip_protocol(name), int(about.get("size") or 0), 0, config)


def analyse(job: Job) -> Analysed:
    """Replay one log and return its rows; a log that cannot be used is a row that says why."""
    begun = time.perf_counter()
    regime = _Regime()
    head = {
        "log": job.log,
        "key": job.key,
        "version": __version__,
        "config": config_digest(job.config),
        "size": job.size,
    }
    try:
        with _fetched(job.log) as path:
            flight = replay(path, replace(job.config, tap=regime), readings=False, estimates_every=EVERY)
    except GcsHealthError as error:
        row = head | {"outcome": UNUSABLE, "error": str(error), "seconds": time.perf_counter() - begun}
        return Analysed([row], [], [], [])
    head["seconds"] = time.perf_counter() - begun
    if job.aircraft:
        records = tuple(record._replace(uid=job.aircraft) for record in flight.records)
        flight = replace(flight, records=records)
    return Analysed(
        _flight_rows(flight, head),
        _rotor_rows(flight, job, regime),
        _event_rows(flight, job),
        list(flight.records),
    )


@contextmanager
def _fetched(log: str) -> Iterator[str]:
    """Give a log as a local file: what lies behind a URL is fetched for as long as it is needed."""
    if "://" not in log:
        yield log
        return
    import fsspec

    with tempfile.TemporaryDirectory() as place:
        path = os.path.join(place, log.rsplit("/", 1)[-1] or "log")
        try:
            system, remote = fsspec.core.url_to_fs(log)
            system.get_file(remote, path)
        except Exception as error:
            raise LogError(f"{log}: cannot fetch it: {error}") from None
        yield path


class _Regime:
    """A tap that keeps each rotor's mean speed while it turns, and nothing else."""

    def __init__(self) -> None:
        self._sums: dict[str, list[tuple[int, float]]] = {}

    def __call__(self, vehicle: str, reading: Reading) -> None:
        if not isinstance(reading, RotorReading):
            return
        sums = self._sums.get(vehicle, [])
        if len(sums) != len(reading.speed):  # another airframe was learned
            sums = [(0, 0.0)] * len(reading.speed)
        self._sums[vehicle] = [
            (n + 1, total + speed) if speed > TURNING else (n, total)
            for (n, total), speed in zip(sums, reading.speed, strict=True)
        ]

    def speeds(self, vehicle: str) -> list[float]:
        """Return each rotor's mean speed [rad/s], NaN if it never turned."""
        return [total / n if n else math.nan for n, total in self._sums.get(vehicle, [])]


def _flight_rows(flight: Flight, head: Row) -> list[Row]:
    about = head | {"outcome": flight.outcome, "error": ""}
    rows = []
    for record in flight.records:
        rows.append(
            about
            | {
                "vehicle": record.vehicle,
                "aircraft": record.vehicle_identity,
                "name": record.name,
                "flight": record.identity,
                "autopilot": record.autopilot,
                "vehicle_type": record.vehicle_type,
                "started_us": record.started_us,
                "duration": record.duration,
                "alerts": len(record.alerts),
                "why": _why(flight, record.vehicle),
            }
        )
    if not rows:  # vehicles, but nothing flown
        rows = [
            about
            | {"vehicle": s.vehicle, "duration": s.duration, "alerts": 0, "why": _why(flight, s.vehicle)}
            for s in flight.summaries
        ]
    return rows


def _why(flight: Flight, vehicle: str) -> str:
    """Return what could not be judged for: the needs that were not met, each once."""
    if flight.outcome != NOT_JUDGED:
        return ""
    lacking = {
        need.input.value
        for survey in flight.survey.vehicles
        if survey.vehicle == vehicle
        for needs in survey.needs.values()
        for need in needs
        if not need.met
    }
    return "lacks " + ", ".join(sorted(lacking)) if lacking else "nothing valid was known of every rotor"


def _rotor_rows(flight: Flight, job: Job, regime: _Regime) -> list[Row]:
    rows = []
    for record in flight.records:
        speeds = dict(zip(flight.motors.get(record.vehicle, ()), regime.speeds(record.vehicle), strict=False))
        known = [speed for speed in speeds.values() if speed == speed]
        for result in record.results:
            rows.append(
                {
                    "log": job.log,
                    "vehicle": record.vehicle,
                    "aircraft": record.vehicle_identity,
                    "flight": record.identity,
                    "started_us": record.started_us,
                    "rotors": len(speeds),
                    "rotor_speed": speeds.get(result.motor, math.nan),
                    "mean_speed": sum(known) / len(known) if known else math.nan,
                }
                | result._asdict()
            )
    return rows


def _event_rows(flight: Flight, job: Job) -> list[Row]:
    rows = []
    for event in flight.events:
        if isinstance(event, AlertEvent | VerdictEvent | AutopilotEvent | VehicleEvent):
            rows.append(_event_row(event, job.log))
    return rows


def _event_row(event: Event, log: str) -> Row:
    row: Row = {"log": log, "t": event.t, "t_unix_us": event.t_unix_us, "vehicle": event.vehicle}
    row |= {"type": type(event).__name__.removesuffix("Event").lower(), "line": to_json(event)}
    if isinstance(event, AlertEvent):
        row |= {"motor": event.motor, "kind": event.code, "state": event.state, "severity": event.severity}
        row |= {"probability": event.probability, "text": event.text}
    elif isinstance(event, VerdictEvent):
        row |= {"motor": event.motor, "kind": event.kind, "probability": event.probability}
    elif isinstance(event, AutopilotEvent):
        row |= {"kind": event.opinion, "state": event.relation, "text": event.text}
    elif isinstance(event, VehicleEvent):
        row |= {"kind": event.change, "text": event.text}
    return row
