"""Events and surveys as text for people: plain columns, no colour needed."""

import math
import shutil
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from gcs_health.balance import grade
from gcs_health.fusion.detectable import sentence
from gcs_health.needs import Need
from gcs_health.record.events import AlertEvent, SummaryEvent, VehicleEvent
from gcs_health.survey import Survey, SystemSurvey, VehicleSurvey

SEVERITY = ("EMERGENCY", "ALERT", "CRITICAL", "ERROR", "WARNING", "NOTICE", "INFO", "DEBUG")
AUTOPILOT = {3: "ArduPilot", 12: "PX4"}
VEHICLE_TYPE = {2: "quadrotor", 13: "hexarotor", 14: "octorotor", 15: "tricopter", 29: "dodecarotor"}
# by quantity: factor from SI, and what it then is
UNIT = {
    "unbalance": (1e6, "g mm"),
    "unbalance_relative": (1e6, "g mm per kg"),
    "effectiveness": (1.0, ""),
    "drag": (1.0, ""),
    "degradation": (1.0, ""),
}
_UNIX = 1e9  # s; vehicle times above are UNIX time: shown from the flight's start instead


def clock(t: float) -> str:
    """Render a vehicle time: mm:ss.mmm since boot, or hh:mm:ss.mmm UTC for UNIX time."""
    if not math.isfinite(t):
        return "--:--"
    milliseconds = round((t % 86400.0 if t > _UNIX else t) * 1000)
    minutes, rest = divmod(milliseconds, 60_000)
    seconds = f"{rest / 1000:06.3f}"
    if t > _UNIX:
        return f"{minutes // 60:02d}:{minutes % 60:02d}:{seconds} UTC"
    return f"{minutes:02d}:{seconds}"


def alert_line(event: AlertEvent) -> str:
    """One alert, one line."""
    return f"{clock(event.t)}  {SEVERITY[event.severity]}  {event.code} {event.state}: {event.text}"


def notice_line(event: VehicleEvent) -> str:
    """What became known of a vehicle, one line; warnings of an airframe below it."""
    line = f"{clock(event.t)}  {event.vehicle}  {event.text}"
    warnings = (event.airframe or {}).get("warnings") if event.change == "airframe" else None
    for warning in warnings if isinstance(warnings, tuple) else ():
        line += f"\n           {warning}"
    return line


def summary_text(event: SummaryEvent) -> str:
    """One vehicle's flight: what was received, each rotor's state, each alert."""
    lines = [f"vehicle {event.vehicle}, {event.duration:.1f} s"]
    lines.append("  rates     " + _rates(event.rates))
    gaps = event.gaps
    if gaps["count"]:
        lines.append(
            f"  gaps      {gaps['count']}, longest {_number(gaps['longest'], 1)} s, "
            f"{_number(gaps['total'], 1)} s in all"
        )
    lines.append("  frames    " + ", ".join(f"{k} {v}" for k, v in event.counters.items()))
    for note in event.notes:
        lines += _entry("note", note)
    if event.rotors:
        lines += ["", *_rotor_table(event.rotors)]
    lines.append("")
    if not event.alerts:
        lines.append("  no alert")
    lines += [f"  {clock(_f(a['t']))}  {a['code']} {a['state']}: {a['text']}" for a in _dicts(event.alerts)]
    for row in _dicts(event.maintenance):
        lines += _wrapped(f"  {clock(_f(row['t']))}  {maintenance(row)}", 12)
    return "\n".join(lines) + "\n"


def maintenance(row: Mapping[str, Any]) -> str:
    """Say in words what grew within a flight: an indicator that does, see `condition.indicators.Indicator`."""
    factor, unit = UNIT[row["quantity"]]
    value, slope, low, high = (f"{row[name] * factor:.3g}" for name in ("value", "slope", "low", "high"))
    due = f"at its limit after {row['due']:.2g} h more of it" if row["due"] else "past its limit"
    return (
        f"maintenance: motor {row['motor']}: {row['quantity']} {row['balance'] or f'{value} {unit}'.rstrip()}"
        + f" grew within the flight by {slope} ({low} to {high}) {unit}".rstrip()
        + f" an hour; {due} ({row['regime']}, {row['seconds']:.0f} s)"
    )


def _entry(label: str, text: str) -> list[str]:
    return _wrapped(f"  {label:<10}{text}", 12)


def _wrapped(line: str, indent: int) -> list[str]:
    """Break a line at the terminal's width, what follows under its text."""
    width = max(shutil.get_terminal_size((100, 24)).columns, 40)
    return textwrap.wrap(line, width, subsequent_indent=" " * indent, break_on_hyphens=False)


def _rotor_table(rotors: tuple[Any, ...]) -> list[str]:
    rows = _dicts(rotors)
    others = [column for column in _COLUMNS if any(_of(rotor, column.quantities) for rotor in rows)]
    names = [f"{rotor['motor']} {rotor['seat']}" for rotor in rows]
    width = max(len(name) for name in names) + 2
    head = "".join(f"{column.title:<{column.width}}" for column in others)
    lines = [f"  {'motor':<{width}}{'effectiveness':<15}{'P(failed)':<11}{'worst':<7}{head}state"]
    for name, rotor in zip(names, rows, strict=True):
        shown = _of(rotor, ("effectiveness",)) or rotor
        final, worst = shown["final"], shown["worst"]
        state = final["status"] + (f": {final['why']}" if final["why"] else "")
        if rotor["telemetry"] != "fresh":
            state += f" (telemetry {rotor['telemetry']})"
        cells = "".join(f"{column.cell(_of(rotor, column.quantities)):<{column.width}}" for column in others)
        lines.append(
            f"  {name:<{width}}{_spread(final, 2, 1.0):<15}{_number(final['failure_probability'], 2):<11}"
            f"{_number(worst['failure_probability'], 2):<7}{cells}{state}"
        )
    seen = sentence(_detectable(rows))
    if seen:
        lines.append(f"  smallest fault of a rotor that would be seen: {seen}")
    return lines


def _detectable(rotors: list[dict[str, Any]]) -> Iterator[tuple[str, str, float]]:
    """Yield what would be seen of each quantity, at the end and at its worst."""
    for rotor in rotors:
        for each in rotor.get("estimates", ()):
            for when in (each["final"], each["worst"]):
                yield each["estimator"], each["quantity"], when["detectable"]


class _Column(NamedTuple):
    """One more quantity: which, under what title, its unit in SI, digits and width."""

    quantities: tuple[str, ...]
    title: str
    unit: float
    digits: int
    width: int

    def cell(self, row: dict[str, Any] | None) -> str:
        """Return the last value that was known, with its spread; a dash where there is none."""
        if row is None:
            return "-"
        known = row["final"] if _finite(row["final"]["value"]) else row["worst"]
        mark = " !" if _finite(known["failure_probability"]) and known["failure_probability"] > 0.9 else ""
        quality = known["balance_quality"]
        named = f" {grade(quality).replace(' ', '')}" if _finite(quality) else ""
        return _spread(known, self.digits, self.unit) + named + mark


_COLUMNS = (
    _Column(("unbalance",), "unbal. g mm", 1e-6, 1, 21),
    _Column(("unbalance_relative",), "unbal. um", 1e-6, 1, 15),
    _Column(("drag",), "drag", 1.0, 2, 15),
    _Column(("degradation",), "degrad.", 1.0, 2, 15),
)


def _of(rotor: dict[str, Any], quantities: tuple[str, ...]) -> dict[str, Any] | None:
    """Return the first estimate of these quantities that says anything."""
    found = [each for each in rotor.get("estimates", ()) if each["quantity"] in quantities]
    if quantities == ("effectiveness",):
        return found[0] if found else None
    known = (each for each in found if _finite(each["final"]["value"]) or _finite(each["worst"]["value"]))
    return next(known, None)


def _spread(state: dict[str, Any], digits: int, unit: float) -> str:
    if not _finite(state["value"]):
        return "-"
    value = f"{state['value'] / unit:.{digits}f}"
    return value + (f" ± {state['std'] / unit:.{digits}f}" if _finite(state["std"]) else "")


def _rates(rates: dict[str, Any]) -> str:
    wanted = [f"{name} {rate:.1f} Hz" for name, rate in rates.items() if _finite(rate) and name in _TOLD]
    others = len(rates) - len(wanted)
    return ", ".join(wanted) + (
        f" and {others} more" if wanted and others else f"{others} messages" * bool(others)
    )


_TOLD = frozenset(
    [
        "HIGHRES_IMU",
        "RAW_IMU",
        "SCALED_IMU",
        "SCALED_IMU2",
        "SCALED_IMU3",
        "ESC_STATUS",
        "ESC_INFO",
        "ESC_TELEMETRY_1_TO_4",
        "ESC_TELEMETRY_5_TO_8",
        "ESC_TELEMETRY_9_TO_12",
        "SERVO_OUTPUT_RAW",
        "ACTUATOR_OUTPUT_STATUS",
    ]
)


def survey_text(name: str, survey: Survey) -> str:
    """What is in a log."""
    lines = [name]
    if survey.first_us is not None and survey.last_us is not None:
        lines.append(f"  {(survey.last_us - survey.first_us) * 1e-6:.1f} s by receive time")
    lines.append("  " + ", ".join(f"{k} {v}" for k, v in survey.counters))
    for vehicle in survey.vehicles:
        lines += ["", *_vehicle(vehicle)]
    for system in survey.systems:
        lines += ["", *_system(system)]
    return "\n".join(lines) + "\n"


def _vehicle(vehicle: VehicleSurvey) -> list[str]:
    autopilot = AUTOPILOT.get(vehicle.autopilot or -1, f"autopilot {vehicle.autopilot}")
    kind = VEHICLE_TYPE.get(vehicle.vehicle_type or -1, f"MAV_TYPE {vehicle.vehicle_type}")
    lines = [f"vehicle {vehicle.vehicle}: {autopilot}, {kind}"]
    frame = vehicle.airframe
    if frame is None:
        lines.append("  airframe  not known")
    else:
        lines.append(f"  airframe  {frame.name} from {frame.source.value}")
        seats = ", ".join(f"{rotor.motor} {frame.seat(k)}" for k, rotor in enumerate(frame.rotors))
        lines.append(f"            {seats}")
        for warning in frame.warnings:
            lines += _entry("", warning)
    for label, said in (
        *(("clock", said) for said in vehicle.clock),
        ("IMU", vehicle.imu),
        *(("ESCs", said) for said in vehicle.rotor_telemetry),
    ):
        lines += _entry(label, said)
    lines += [f"  gap       {length:.1f} s before {clock(t)}" for t, length in vehicle.gaps[:10]]
    if len(vehicle.gaps) > 10:
        lines.append(f"            and {len(vehicle.gaps) - 10} more gaps")
    for estimator, needs in vehicle.needs.items():
        lines.append(f"  {estimator.replace('_', ' ')} needs")
        for need in needs:
            lines += _wrapped(f"    {need_text(need)}", 13)
    return lines


def need_text(need: Need) -> str:
    """One input of an estimator: what there is of it, and what would give it."""
    have = "" if need.rate != need.rate else f" {need.rate:.1f} Hz" if need.rate else " none"
    if need.met:
        return f"ok       {need.input.value}{have}"
    return f"missing  {need.input.value}{have}: {need.remedy}"


def _system(system: SystemSurvey) -> list[str]:
    lines = [
        f"system {system.system}.{system.component} ({system.role}): {system.frames} frames, {system.lost} lost"
    ]
    for message in system.messages:
        rate = f"{message.rate:9.2f} Hz" if _finite(message.rate) else " " * 12
        gap = f"longest gap {message.longest_gap:.2f} s" if message.count > 1 else ""
        lines.append(f"  {message.message:>6} {message.name:<28}{message.count:>8}{rate}  {gap}".rstrip())
    return lines


def _dicts(rows: tuple[Any, ...]) -> list[dict[str, Any]]:
    return list(rows)


def _f(value: Any) -> float:
    return float(value)


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _number(value: Any, digits: int) -> str:
    return f"{value:.{digits}f}" if _finite(value) else "-"
