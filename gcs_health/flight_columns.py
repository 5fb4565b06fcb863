"""Events and readings of a flight as columns: one numpy array a field, one row a datum.

Rows are kept in flat arrays of doubles as they come: a tuple of seven floats takes 280 bytes, its seven
doubles 56.
"""

from array import array
from collections.abc import Iterable, Sequence
from typing import Any, get_type_hints

import numpy as np

from gcs_health.record.events import AlertEvent, AutopilotEvent, EstimateEvent, VehicleEvent, VerdictEvent
from gcs_health.samples import (
    BatteryReading,
    CommandReading,
    FlightReading,
    ImuReading,
    Reading,
    RotorReading,
    VibrationReading,
)

Columns = dict[str, np.ndarray[Any, np.dtype[Any]]]

NAN = float("nan")
# what of an event is no single value; evidence and airframes stay with the events
_LEFT_OUT = {"evidence", "airframe"}
EVENT_TABLES: dict[str, type[Any]] = {
    "alerts": AlertEvent,
    "autopilot": AutopilotEvent,
    "verdicts": VerdictEvent,
    "vehicle": VehicleEvent,
}


def event_columns(events: Iterable[Any], kind: type[Any]) -> Columns:
    """Return the events of one type as columns: numbers by their field's type, absent ones NaN, all else text."""
    rows = [event for event in events if type(event) is kind]
    return {
        name: _column([getattr(row, name) for row in rows], hint)
        for name, hint in get_type_hints(kind).items()
        if name not in _LEFT_OUT
    }


def _column(values: list[Any], hint: Any) -> np.ndarray[Any, Any]:
    if hint in (int, float, bool):
        return np.array(values, np.int64 if hint is int else hint)
    if hint in (int | None, bool | None):
        return np.array([NAN if value is None else value for value in values], float)
    return np.array([_text(value) for value in values], object)


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    return "" if value is None else str(value)


class EstimateColumns:
    """Estimates kept as they come.

    Parameters
    ----------
    every : of one rotor, estimator and quantity at most one is kept in so many seconds; 0 = all.
    """

    _NUMBERS = ("t", "t_unix_us", "rotor", "motor", "value", "std", "failure_probability", "detectable")

    def __init__(self, every: float = 0.0) -> None:
        self._every = every
        self._due: dict[tuple[str, int, str, str], float] = {}
        self._codes: dict[tuple[str, ...], int] = {}  # of what is said in words, few of them in a flight
        self._code = array("i")
        self._rows = array("d")
        self._stamps = array("q")  # UNIX µs need 51 bits and more: near the end of a double's

    def add(self, event: EstimateEvent) -> None:
        """Take one."""
        if self._every > 0.0:
            key = (event.vehicle, event.rotor, event.estimator, event.quantity)
            if event.t < self._due.get(key, -np.inf) and event.t > self._due[key] - 2.0 * self._every:
                return
            self._due[key] = event.t + self._every
        words = (event.vehicle, event.estimator, event.quantity, event.status, ", ".join(event.reasons))
        self._code.append(self._codes.setdefault(words, len(self._codes)))
        self._stamps.append(event.t_unix_us)
        self._rows.extend(
            (
                event.t,
                event.rotor,
                event.motor,
                event.value,
                event.std,
                event.failure_probability,
                event.detectable,
            )
        )

    def columns(self) -> Columns:
        """Return what was kept."""
        rows = np.array(self._rows, float).reshape(-1, 7)
        words = np.array([*self._codes], object).reshape(-1, 5)[np.array(self._code, np.intp)]
        t, rotor, motor, value, std, probability, detectable = rows.T.copy()
        vehicle, estimator, quantity, status, reasons = words.T
        return {
            "t": t,
            "t_unix_us": np.array(self._stamps, np.int64),
            "vehicle": vehicle,
            "estimator": estimator,
            "rotor": rotor.astype(np.int64),
            "motor": motor.astype(np.int64),
            "quantity": quantity,
            "value": value,
            "std": std,
            "failure_probability": probability,
            "status": status,
            "reasons": reasons,
            "detectable": detectable,
        }


_READINGS: dict[type, str] = {
    ImuReading: "imu",
    RotorReading: "rotors",
    CommandReading: "commands",
    BatteryReading: "battery",
    VibrationReading: "vibration",
    FlightReading: "phase",
}
READING_TABLES = tuple(_READINGS.values())


class ReadingColumns:
    """What reached one vehicle's estimators, kept as it came."""

    def __init__(self) -> None:
        # an airframe learned late may have another number of rotors: rows of each width apart
        self._rows: dict[tuple[str, int], array[float]] = {}

    def add(self, reading: Reading) -> None:
        """Take one."""
        kind = _READINGS.get(type(reading))
        if kind is None:
            return
        flat: Sequence[float]
        if isinstance(reading, RotorReading):
            flat = (reading.t, *reading.speed, *reading.current, *reading.voltage)
        elif isinstance(reading, CommandReading):
            flat = (reading.t, *reading.command)
        elif isinstance(reading, FlightReading):
            flat = (reading.t, _known(reading.armed), _known(reading.landed))
        else:
            flat = reading  # type: ignore[assignment]  # the others are floats throughout
        rows = self._rows.get((kind, len(flat)))
        if rows is None:
            rows = self._rows[kind, len(flat)] = array("d")
        rows.extend(flat)

    def columns(self, kind: str, motors: Sequence[int]) -> Columns:
        """Return one kind's columns; those of rotors are named by `motors`, as in speed_1 [rad/s]."""
        names = _names(kind, motors)
        rows = np.array(self._rows.get((kind, len(names)), ()), float).reshape(-1, len(names))
        return {name: column.copy() for name, column in zip(names, rows.T, strict=True)}


def _known(value: bool | None) -> float:
    return NAN if value is None else float(value)


def _names(kind: str, motors: Sequence[int]) -> list[str]:
    if kind == "rotors":
        return ["t", *(f"{what}_{n}" for what in ("speed", "current", "voltage") for n in motors)]
    if kind == "commands":
        return ["t", *(f"command_{n}" for n in motors)]
    return list({name: type_ for type_, name in _READINGS.items()}[kind]._fields)  # type: ignore[attr-defined]
