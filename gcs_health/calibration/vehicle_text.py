"""The vehicle file that a calibration writes: geometry as it was, what was learned beside it, in TOML."""

import math
from pathlib import Path

import tomlkit
from tomlkit.items import Table

from gcs_health.airframe import Airframe, AlarmLevel
from gcs_health.calibration.findings import Finding
from gcs_health.vehicle_file import SCHEMA

SPIN = {1: "ccw", -1: "cw"}
LISTS = ("hover_speed", "hover_command", "weight_offset", "unbalance")
DECIMALS = 6  # of AR coefficients: roots near the unit circle ask for more digits than were measured


def vehicle_text(airframe: Airframe, findings: list[Finding], origin: str) -> str:
    """Return the vehicle file; `origin` says from what it was made, in its first line.

    What was given in the airframe and not found anew stays as it was; trained models are to lie beside the file.
    """
    document = tomlkit.document()
    document.add(tomlkit.comment(origin))
    document.add("schema", tomlkit.item(SCHEMA))
    document.add("name", tomlkit.item(airframe.name))
    if airframe.mass is not None:
        document.add("mass", tomlkit.item(airframe.mass))
    if airframe.inertia is not None:
        document.add("inertia", tomlkit.item(list(airframe.inertia)))
    rotors = tomlkit.aot()
    for rotor in airframe.rotors:
        row = tomlkit.table()
        row.update({"motor": rotor.motor, "esc": rotor.esc, "position": list(rotor.position)})
        row["spin"] = SPIN[rotor.spin]
        if rotor.radius is not None:
            row["radius"] = rotor.radius
        if rotor.propeller_mass is not None:
            row["propeller_mass"] = rotor.propeller_mass
        rotors.append(row)
    document.add("rotor", rotors)
    for name in ("effectiveness", "motor", "telemetry", "baseline"):
        table = _table(name, airframe, [finding for finding in findings if finding.table == name])
        if len(table):
            document.add(name, table)
    vibration = _vibration(airframe, [finding for finding in findings if finding.table == "vibration"])
    if len(vibration):
        document.add("vibration", vibration)
    return tomlkit.dumps(document)


def _vibration(airframe: Airframe, findings: list[Finding]) -> Table:
    """Return models, the levels of their alarms, and the healthy baseline; `airframe` has them."""
    table = tomlkit.table()
    if airframe.vibration_models:
        table["models"] = [Path(name).name for name in airframe.vibration_models]
    why = {finding.key: finding.why for finding in findings}
    for finding in findings:
        if not finding.found:
            table.add(tomlkit.comment(f"{finding.key}: {finding.why}"))
    if airframe.vibration_alarms:
        alarms = tomlkit.table(is_super_table=True)
        for name, level in airframe.vibration_alarms:
            alarms[name] = _alarm(level, why.get(f"alarm.{name}", ""))
        table["alarm"] = alarms
    if airframe.healthy_vibration is not None:
        healthy = airframe.healthy_vibration
        row = _alarm(healthy.alarm, why.get("healthy", ""))
        row["rate"] = _rounded(healthy.rate)
        row.update({key: v for key in ("mean_over", "cutoff") if math.isfinite(v := getattr(healthy, key))})
        row["channels"] = list(healthy.channels)
        row["variances"] = [list(map(_rounded, pair)) for pair in healthy.variances]
        row["coefficients"] = [[round(a, DECIMALS) for a in each] for each in healthy.coefficients]
        table["healthy"] = row
    return table


def _alarm(level: AlarmLevel, why: str) -> Table:
    row = tomlkit.table()
    row["threshold"] = _rounded(level.threshold)
    row["threshold"].comment(why)
    row.update({key: _rounded(getattr(level, key)) for key in ("location", "scale", "every")})
    return row


def _table(name: str, airframe: Airframe, findings: list[Finding]) -> Table:
    table, spread = tomlkit.table(), tomlkit.table()
    for finding in findings:
        if not finding.found:
            table.add(tomlkit.comment(f"{finding.key}: {finding.why}"))
            continue
        table.add(finding.key, finding.word or _value(finding.key, finding.values))
        table[finding.key].comment(finding.why)
        if finding.word:
            continue
        spread.add(finding.key, _value(finding.key, finding.stds))
    found = {finding.key for finding in findings if finding.found}
    for key, value in _given(name, airframe).items():
        if key not in found:
            table.add(key, value)
            table[key].comment("as given")
    if len(spread):
        table.add("std", spread)
    return table


def _given(name: str, airframe: Airframe) -> dict[str, float | str]:
    """Return what the airframe already had in this table."""
    if name == "telemetry":
        return {} if airframe.rotor_delay is None else {"rotor_delay": airframe.rotor_delay}
    if name == "baseline":
        return {}  # of other flights than these
    part = airframe.effectiveness if name == "effectiveness" else airframe.motor
    values = {key: getattr(part, key) for key in part.__dataclass_fields__}
    return {key: value for key, value in values.items() if value is not None}


def _value(key: str, values: tuple[float, ...]) -> object:
    rounded = [_rounded(value) for value in values]
    return rounded if key in LISTS or len(rounded) > 1 else rounded[0]


def _rounded(value: float) -> float:
    """Four significant digits: more were never measured."""
    return 0.0 if value == 0.0 else round(value, 3 - math.floor(math.log10(abs(value))))
