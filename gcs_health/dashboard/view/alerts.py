"""The list of alerts, newest first, and one of them in full: why."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from functools import lru_cache

from gcs_health.dashboard.snapshot import Entry, Level, Row, Snapshot, VehicleShot
from gcs_health.dashboard.state import State, chosen_entry, shown_entries
from gcs_health.dashboard.view.lines import BLANK, Line, beside, fill, fit, line, title, wrap
from gcs_health.dashboard.view.plot import GUTTER, plot
from gcs_health.dashboard.words import RPM, SEVERITY, UNIX, clock, percent

AFTER = 10.0  # s; `alerts_model` keeps so much behind an alert


def alert_list(
    snapshot: Snapshot, state: State, cells: int, rows: int, t: float
) -> tuple[list[Line], list[str]]:
    """Return heading and entries in so many rows, and the key of the entry on each row ("" for none)."""
    entries = shown_entries(snapshot, state)
    hidden = len(snapshot.entries) - len(entries)
    name = f"alerts   / {state.filter}   {hidden} hidden" if state.filter else "alerts"
    room = rows - 1
    chosen = next((k for k, entry in enumerate(entries) if entry.key == state.entry), 0)
    first = min(max(chosen - room + 1, 0), max(len(entries) - room, 0)) if room > 0 else 0
    visible = entries[first : first + max(room, 0)]
    several = len(snapshot.vehicles) > 1
    lines = [title(name if first == 0 else f"{name}   {first} newer above", cells)]
    lines += [_entry(entry, entry.key == state.entry, several, cells, t) for entry in visible]
    if not entries and room > 0:
        lines.append(line(("   none" + (" that match the filter" if state.filter else " so far"), "dim")))
    return fill(lines, rows), ["", *(entry.key for entry in visible)]


def _entry(entry: Entry, chosen: bool, several: bool, cells: int, t: float) -> Line:
    loud = entry.kind == "alert" and entry.open and not entry.acknowledged and not entry.shelved(t)
    style = {Level.FAILED: "fail", Level.WARN: "warn"}.get(entry.level, "dim") if loud else "dim"
    if entry.kind == "autopilot":
        style = "warn"
    marks = ""
    if entry.kind == "alert":
        sign = "✗" if entry.level is Level.FAILED else "!"
        said = ""
        if not entry.open:
            said = "over: "
        elif entry.shelved(t):
            said = "shelved: "
        elif entry.acknowledged:
            said = "seen: "
        marks = f"{sign} {said}"
    when = clock(entry.t, 0 if entry.t > UNIX else 1)
    head = f"{when:<8} {SEVERITY[entry.severity]:<9} "
    who = f"{entry.vehicle} " if several and entry.vehicle else ""
    return fit(
        line(
            ("▸" if chosen else " ", "pick"), (head, style), (who, style), (marks, style), (entry.text, style)
        ),
        cells,
    )


def why(snapshot: Snapshot, state: State, cells: int, rows: int) -> list[Line]:
    """Return all about the chosen entry: what, the evidence over time, the numbers, others' words, what to do."""
    entry = chosen_entry(snapshot, state)
    if entry is None:
        return fill([title("why", cells), line(("   no alert is chosen", "dim"))], rows)
    vehicle = snapshot.vehicle(entry.vehicle)
    lines = [title(f"why   {clock(entry.t, 3)}  {entry.code.replace('_', ' ')}", cells)]
    style = {Level.FAILED: "fail", Level.WARN: "warn"}.get(entry.level, "")
    lines += wrap(entry.text, cells, style)
    if entry.advice:
        lines += wrap(f"do: {entry.advice}", cells, "bold", 4)
    if entry.kind != "alert":
        return fill(lines, rows)
    words = [part for t, text in entry.words[-4:] for part in wrap(f"{clock(t)}  {text}", cells // 2, "", 9)]
    said = words or [line(("the autopilot says nothing of motors", "dim"))]
    left = [line(("evidence", "title")), *_numbers(entry, cells // 2 - 2)]
    right = [line(("what happened", "title"))]
    right += [line(f"{clock(t, 2)}  {what}") for t, what in entry.steps[-6:]]
    right += [line(("autopilot", "title")), *said]
    high = max(min(rows - len(lines) - 8, rows * 3 // 5), 0)
    if vehicle is not None and high >= 4:
        lines += evidence_plots(entry, vehicle, cells, high)
    lines += beside(left, cells // 2 - 2, right)
    return fill(lines, rows)


def _numbers(entry: Entry, cells: int) -> list[Line]:
    if not entry.figures:
        return [line(("no figures", "dim"))]
    wide = min(max(len(name) for name, _ in entry.figures) + 2, cells - 9)
    return [
        line((f"{name[: wide - 1]:<{wide}}", "dim"), value[: cells - wide]) for name, value in entry.figures
    ]


def evidence_plots(entry: Entry, vehicle: VehicleShot, cells: int, rows: int) -> list[Line]:
    """Return four plots, two by two, of the seconds around an alert; two where there is less room."""
    concerned = next((k for k, rotor in enumerate(vehicle.rotors) if rotor.motor == entry.motor), -1)
    trace = entry.trace
    if not trace:
        return [line(("   the seconds around it are no longer kept", "dim"))]
    ends = (trace[0].t, max(trace[-1].t, entry.t + AFTER / 5))
    return quarters(trace, concerned, cells, rows, ends, entry.t)


def quarters(
    trace: Sequence[Row], concerned: int, cells: int, rows: int, ends: tuple[float, float], mark: float
) -> list[Line]:
    """Return effectiveness, speed, failure probability and lift of these rows; one rotor before the others.

    What is newer than the last whole column of dots waits for the next: the plots are drawn anew once a column.
    """
    length = round(ends[1] - ends[0], 3)  # the same from picture to picture, whatever the times' last digits
    column = length / (2 * max((cells - 2) // 2 - GUTTER - 1, 4))
    end = math.floor(ends[1] / column) * column if column > 0.0 else ends[1]
    ends = (end - length, end)
    first = bisect_left(trace, ends[0], key=_time)
    last = bisect_right(trace, ends[1], key=_time)
    return list(_panels(_Rows(tuple(trace[first:last])), concerned, cells, rows, ends, mark))


def _time(row: Row) -> float:
    return row.t


class _Rows:
    """Rows that are the same if their ends are: one vehicle's, in order."""

    def __init__(self, rows: tuple[Row, ...]) -> None:
        self.rows = rows
        self._key = (len(rows), rows[0], rows[-1]) if rows else ()

    def __hash__(self) -> int:
        return hash((len(self.rows), self.rows[-1].t if self.rows else 0.0))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Rows) and self._key == other._key


@lru_cache(maxsize=16)
def _panels(
    of: _Rows, concerned: int, cells: int, rows: int, ends: tuple[float, float], mark: float
) -> tuple[Line, ...]:
    trace = of.rows
    times = [row.t for row in trace]
    wide = (cells - 2) // 2
    high = (rows - 2) // 2 if rows >= 10 else rows - 1

    def rotors(name: str, factor: float = 1.0) -> list[tuple[list[float], str]]:
        columns = list(zip(*(getattr(row, name) for row in trace), strict=False))
        order = sorted(range(len(columns)), key=lambda k: k == concerned)
        return [([v * factor for v in columns[k]], "curve" if k == concerned else "dim") for k in order]

    def panel(name: str, drawn: list[Line]) -> list[Line]:
        return [line((f"{' ' * 7}{name}", "dim")), *drawn]

    effectiveness = plot(times, rotors("effectiveness"), wide, high, ends, (-0.2, 1.2), mark)
    speeds = plot(times, rotors("speed", RPM), wide, high, ends, None, mark, 0)
    out = beside(panel("effectiveness", effectiveness), wide, panel("rotor speed, rpm", speeds))
    if rows < 10:
        return tuple(out)
    chances = plot(times, rotors("failed"), wide, high, ends, (0.0, 1.0), mark)
    lift = [([row.expected for row in trace], "dim"), ([row.lift for row in trace], "curve")]
    lifts = plot(times, lift, wide, high, ends, None, mark)
    lifted = panel("lift m/s²: measured, faint: as if healthy", lifts)
    return tuple(out + beside(panel("failure probability", chances), wide, lifted))


def rotor_page(vehicle: VehicleShot, motor: int, cells: int, rows: int) -> list[Line]:
    """Return all that is known of one rotor."""
    rotor = next(
        (r for r in vehicle.rotors if r.motor == motor), vehicle.rotors[0] if vehicle.rotors else None
    )
    if rotor is None:
        return fill([title("rotor", cells), line(("   the airframe is not known yet", "dim"))], rows)
    style = {Level.FAILED: "fail", Level.WARN: "warn", Level.UNKNOWN: "unknown"}.get(rotor.level, "ok")
    lines = [title(f"motor {rotor.motor}   {rotor.seat}", cells)]
    sources = f"  by {', '.join(rotor.sources)}" if rotor.sources else ""
    lines.append(
        line((f"{rotor.state} {percent(rotor.probability)}", style), f"  since {clock(rotor.since)}{sources}")
    )
    if rotor.why:
        lines += wrap(f"why: {rotor.why}", cells, "dim", 5)
    others = sorted(rotor.posterior, key=lambda each: -each[1])[:5]
    lines.append(fit(line(("   ".join(f"{kind} {p:.3f}" for kind, p in others), "dim")), cells))
    lines += [BLANK, _telemetry(rotor.telemetry, rotor.age, rotor.voltage, rotor.temperature_degc)]
    head = f"{'estimator':<15}{'quantity':<18}{'value':>8}{'spread':>8}{'P(fault)':>9}{'seen at':>9}  state"
    lines += [BLANK, fit(line((head, "dim")), cells)]
    for figure in rotor.figures:
        unit = 1e6 if figure.quantity.startswith("unbalance") else 1.0
        cell = [f"{v * unit:.2f}" if v == v else "–" for v in (figure.value, figure.std)]
        detectable = f"{figure.detectable * unit:.2f}" if figure.detectable == figure.detectable else "–"
        p = (
            f"{figure.failure_probability:.3f}"
            if figure.failure_probability == figure.failure_probability
            else "–"
        )
        name = figure.quantity.replace("unbalance_relative", "unbalance, µm").replace("_", " ")
        name = "unbalance, g mm" if figure.quantity == "unbalance" else name
        text = (
            f"{figure.estimator:<15}{name:<18}{cell[0]:>8}{cell[1]:>8}{p:>9}{detectable:>9}  {figure.status}"
        )
        lines.append(fit(line(text), cells))
        if figure.why:
            lines += wrap(figure.why, cells, "dim", 0, 4)
    room = rows - len(lines)
    if room >= 7 and vehicle.rows:
        concerned = vehicle.rotors.index(rotor)
        ends = (vehicle.rows[-1].t - 60.0, vehicle.rows[-1].t)
        lines += [BLANK, *quarters(vehicle.rows, concerned, cells, room - 1, ends, math.nan)]
    return fill(lines, rows)


def _telemetry(state: str, age: float, volts: float, degc: float) -> Line:
    old = f", {age:.1f} s old" if age < 1e6 else ""
    more = "".join(f"   {v:.1f} {unit}" for v, unit in ((volts, "V"), (degc, "°C")) if v == v)
    return line(f"telemetry {state}{old}{more}")
