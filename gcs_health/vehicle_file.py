"""The vehicle file: TOML under `gcs_health.vehicle/1` to an `Airframe`, every error naming file and key."""

import difflib
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gcs_health.airframe import (
    Airframe,
    AirframeSource,
    AlarmLevel,
    Baseline,
    Effectiveness,
    HealthyVibration,
    Motor,
    Rotor,
)
from gcs_health.errors import AirframeError

SCHEMA = "gcs_health.vehicle/1"
MIN_ROTORS, MAX_ROTORS = 3, 12

_TOP = {"schema", "name", "mass", "inertia", "rotor", "effectiveness", "motor", "telemetry", "baseline"}
_TOP |= {"vibration"}
_ROTOR = {"motor", "esc", "position", "spin", "radius", "propeller_mass"}
_EFFECTIVENESS = {"roll", "pitch", "yaw", "yaw_inertia", "thrust"}
_STD = "std"  # sub-table of a table that `calibrate` wrote
_BASELINE = {"hover_speed", "hover_command", "vibration", "weight_offset", "unbalance", "vibration_level"}
_MOTOR = {"torque_constant", "torque", "friction", "inertia", "resistance", "current_lag", "current_side"}
_SIDES = ("motor", "battery")
_VIBRATION = {"models", "alarm", "healthy"}
_ALARM = ("threshold", "location", "scale", "every")
_HEALTHY = {"rate", "mean_over", "cutoff", "channels", "coefficients", "variances"}
_CHANNELS = ("ax", "ay", "az", "p", "q", "r")


def load_vehicle(path: str | Path) -> Airframe:
    """Read and check a vehicle file.

    Raises
    ------
    AirframeError : one line: "quad.toml: rotor[2].spin: expected 'cw' or 'ccw', got 'left'".
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        raise AirframeError(f"{path}: expected a vehicle file in TOML, this is not text") from None
    except OSError as error:
        raise AirframeError(f"{path}: cannot read the vehicle file: {error.strerror}") from None
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise AirframeError(f"{path}: not valid TOML: {error}") from None
    return _Reader(path).airframe(table)


class _Reader:
    """Checks a parsed file; `_at` names file and key in every complaint."""

    def __init__(self, path: Path) -> None:
        self._file = path.name
        self._folder = path.parent

    def airframe(self, table: dict[str, Any]) -> Airframe:
        self._keys(table, _TOP, "")
        if table.get("schema") != SCHEMA:
            self._fail("schema", f"expected {SCHEMA!r}, got {table.get('schema')!r}")
        name = table.get("name", self._file)
        if not isinstance(name, str):
            self._fail("name", f"expected text, got {name!r}")
        inertia = self._vector(table["inertia"], "inertia", positive=True) if "inertia" in table else None
        rotors = self._rotors(table.get("rotor"))
        vibration = table.get("vibration", {})
        models = self._models(vibration)
        return Airframe(
            name=name,
            rotors=rotors,
            source=AirframeSource.FILE,
            mass=self._optional(table, "mass", ""),
            inertia=inertia,
            effectiveness=self._effectiveness(table.get("effectiveness", {})),
            motor=self._motor(table.get("motor", {})),
            rotor_delay=self._telemetry(table.get("telemetry", {})),
            baseline=self._baseline(table.get("baseline", {}), len(rotors)),
            vibration_models=models,
            vibration_alarms=self._alarms(vibration.get("alarm", {}), models),
            healthy_vibration=self._healthy(vibration["healthy"]) if "healthy" in vibration else None,
        )

    def _rotors(self, rows: Any) -> tuple[Rotor, ...]:
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            self._fail("rotor", "expected one [[rotor]] table per rotor")
        if not MIN_ROTORS <= len(rows) <= MAX_ROTORS:
            self._fail("rotor", f"expected {MIN_ROTORS} to {MAX_ROTORS} rotors, got {len(rows)}")
        rotors = [self._rotor(row, f"rotor[{k}]") for k, row in enumerate(rows)]
        for key, value_of in _UNIQUE.items():
            values = [value_of(rotor) for rotor in rotors]
            for k, value in enumerate(values):
                if value in values[:k]:
                    first = values.index(value)
                    self._fail(f"rotor[{k}].{key}", f"{value} is already that of rotor[{first}]")
        if not any(rotor.position[0] for rotor in rotors) or not any(rotor.position[1] for rotor in rotors):
            self._fail("rotor", "the positions do not spread forward and right: no moment can be told")
        return tuple(sorted(rotors, key=lambda rotor: rotor.motor))

    def _rotor(self, row: dict[str, Any], at: str) -> Rotor:
        self._keys(row, _ROTOR, f"{at}.")
        for key in ("motor", "position", "spin"):
            if key not in row:
                self._fail(f"{at}.{key}", "is missing")
        motor = self._integer(row["motor"], f"{at}.motor", 1)
        spin = {"ccw": 1, "cw": -1}.get(row["spin"] if isinstance(row["spin"], str) else "")
        if spin is None:
            self._fail(f"{at}.spin", f"expected 'cw' or 'ccw', got {row['spin']!r}")
        return Rotor(
            motor=motor,
            esc=self._integer(row["esc"], f"{at}.esc", 0) if "esc" in row else motor - 1,
            position=self._vector(row["position"], f"{at}.position"),
            spin=spin,  # type: ignore[arg-type]
            radius=self._optional(row, "radius", f"{at}."),
            propeller_mass=self._optional(row, "propeller_mass", f"{at}."),
        )

    def _effectiveness(self, row: Any) -> Effectiveness:
        row = self._table(row, "effectiveness", _EFFECTIVENESS)
        return Effectiveness(**{key: self._optional(row, key, "effectiveness.") for key in row})

    def _motor(self, row: Any) -> Motor:
        row = self._table(row, "motor", _MOTOR)
        side = row.get("current_side")
        if side is not None and side not in _SIDES:
            self._fail("motor.current_side", f"expected 'motor' or 'battery', got {side!r}")
        numbers = {key: self._optional(row, key, "motor.") for key in row if key != "current_side"}
        return Motor(current_side=side, **numbers)

    def _telemetry(self, row: Any) -> float | None:
        row = self._table(row, "telemetry", {"rotor_delay"})
        return self._number(row["rotor_delay"], "telemetry.rotor_delay") if "rotor_delay" in row else None

    def _models(self, row: Any) -> tuple[str, ...]:
        names = self._table(row, "vibration", _VIBRATION).get("models", [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            self._fail("vibration.models", f"expected a list of file names, got {names!r}")
        for name in names:
            if name != Path(name).name or not (self._folder / name).is_file():
                self._fail("vibration.models", f"expected the names of files beside this one, got {name!r}")
        return tuple(str(self._folder / name) for name in names)

    def _alarms(self, row: Any, models: tuple[str, ...]) -> tuple[tuple[str, AlarmLevel], ...]:
        if not isinstance(row, dict):
            self._fail("vibration.alarm", "expected a table for each model")
        names = [Path(model).name for model in models]
        for name, level in row.items():
            if name not in names:
                self._fail(f"vibration.alarm.{name}", "is not among vibration.models")
            if isinstance(level, dict):
                self._keys(level, set(_ALARM), f"vibration.alarm.{name}.")
        return tuple((name, self._alarm(level, f"vibration.alarm.{name}")) for name, level in row.items())

    def _alarm(self, row: Any, at: str) -> AlarmLevel:
        self._whole(row, _ALARM, at)
        threshold, location, scale, every = (
            self._number(row[key], f"{at}.{key}", positive=key in ("scale", "every")) for key in _ALARM
        )
        return AlarmLevel(threshold, location, scale, every)

    def _healthy(self, row: Any) -> HealthyVibration:
        at = "vibration.healthy"
        required = _HEALTHY - {"mean_over", "cutoff"}
        self._whole(row, (*sorted(required), *_ALARM), at)
        self._keys(row, _HEALTHY | set(_ALARM), f"{at}.")
        channels = row["channels"]
        if not isinstance(channels, list) or not channels or any(each not in _CHANNELS for each in channels):
            self._fail(f"{at}.channels", f"expected some of {', '.join(_CHANNELS)}, got {channels!r}")
        count = len(channels)
        variances = [
            self._numbers(each, f"{at}.variances[{k}]", 2)
            for k, each in enumerate(self._items(row["variances"], f"{at}.variances", count))
        ]
        for k, (least, largest) in enumerate(variances):
            if not 0.0 < least <= largest:
                self._fail(f"{at}.variances[{k}]", f"expected [least, largest] above 0, got {variances[k]}")
        return HealthyVibration(
            rate=self._number(row["rate"], f"{at}.rate", positive=True),
            mean_over=self._optional(row, "mean_over", f"{at}.") or math.nan,
            cutoff=self._optional(row, "cutoff", f"{at}.") or math.nan,
            channels=tuple(channels),
            coefficients=tuple(
                self._numbers(each, f"{at}.coefficients[{k}]")
                for k, each in enumerate(self._items(row["coefficients"], f"{at}.coefficients", count))
            ),
            variances=tuple((least, largest) for least, largest in variances),
            alarm=self._alarm(row, at),
        )

    def _whole(self, row: Any, keys: tuple[str, ...], at: str) -> None:
        if not isinstance(row, dict):
            self._fail(at, "expected a table")
        for key in keys:
            if key not in row:
                self._fail(f"{at}.{key}", "is missing")

    def _items(self, value: Any, at: str, count: int = 0) -> list[Any]:
        """Check a list of so many; 0 = one or more."""
        if not isinstance(value, list) or not value or count not in (0, len(value)):
            self._fail(at, f"expected {count or 'a list of'} items, got {value!r}")
        return list(value)

    def _numbers(self, value: Any, at: str, count: int = 0) -> tuple[float, ...]:
        items = self._items(value, at, count)
        return tuple(self._number(item, f"{at}[{k}]") for k, item in enumerate(items))

    def _baseline(self, row: Any, rotors: int) -> Baseline:
        spreads = row.get(_STD, {}) if isinstance(row, dict) else {}
        row = self._table(row, "baseline", _BASELINE)
        return Baseline(
            hover_speed=self._list(row, "hover_speed", rotors),
            hover_command=self._list(row, "hover_command", rotors),
            vibration=self._optional(row, "vibration", "baseline."),
            weight_offset=self._list(row, "weight_offset", 2),
            unbalance=self._list(row, "unbalance", rotors),
            vibration_level=self._optional(row, "vibration_level", "baseline."),
            std=tuple((key, _tuple(value)) for key, value in sorted(spreads.items())),
        )

    def _table(self, row: Any, at: str, known: set[str]) -> dict[str, Any]:
        """Check a table of numbers and its standard deviations; return it without these."""
        if not isinstance(row, dict):
            self._fail(at, "expected a table")
        self._keys(row, known | {_STD}, f"{at}.")
        spreads = row.get(_STD, {})
        if not isinstance(spreads, dict):
            self._fail(f"{at}.{_STD}", "expected a table")
        self._keys(spreads, known, f"{at}.{_STD}.")
        for key, value in spreads.items():
            for item in _tuple(value):
                self._number(item, f"{at}.{_STD}.{key}")
        return {key: value for key, value in row.items() if key != _STD}

    def _list(self, row: dict[str, Any], key: str, count: int) -> tuple[float, ...]:
        if key not in row:
            return ()
        value = row[key]
        if not isinstance(value, list) or len(value) != count:
            self._fail(f"baseline.{key}", f"expected {count} numbers, got {value!r}")
        return tuple(self._number(item, f"baseline.{key}[{k}]") for k, item in enumerate(value))

    def _keys(self, table: dict[str, Any], known: set[str], at: str) -> None:
        for key in table:
            if key not in known:
                near = difflib.get_close_matches(key, known, 1)
                hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(sorted(known))}"
                self._fail(f"{at}{key}", f"unknown key; {hint}")

    def _optional(self, table: dict[str, Any], key: str, at: str) -> float | None:
        return self._number(table[key], f"{at}{key}", positive=True) if key in table else None

    def _number(self, value: Any, at: str, positive: bool = False) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            self._fail(at, f"expected a number, got {value!r}")
        if positive and value <= 0:
            self._fail(at, f"expected a number above 0, got {value!r}")
        return float(value)

    def _integer(self, value: Any, at: str, least: int) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            self._fail(at, f"expected a whole number from {least} on, got {value!r}")
        return int(value)

    def _vector(self, value: Any, at: str, positive: bool = False) -> tuple[float, float, float]:
        if not isinstance(value, list) or len(value) != 3:
            self._fail(at, f"expected three numbers [x, y, z], got {value!r}")
        x, y, z = (self._number(item, f"{at}[{k}]", positive) for k, item in enumerate(value))
        return x, y, z

    def _fail(self, at: str, what: str) -> Any:
        raise AirframeError(f"{self._file}: {at}: {what}")


def _tuple(value: Any) -> tuple[Any, ...]:
    return tuple(value) if isinstance(value, list) else (value,)


_UNIQUE: dict[str, Callable[[Rotor], Any]] = {
    "motor": lambda rotor: rotor.motor,
    "esc": lambda rotor: rotor.esc,
    "position": lambda rotor: rotor.position,
}
