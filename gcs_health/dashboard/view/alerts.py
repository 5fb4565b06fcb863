"""The list of alerts, newest first, and one of them in full: why."""

from gcs_health.dashboard.snapshot import Entry, Level, Snapshot, VehicleShot
from gcs_health.dashboard.state import State, chosen_entry, shown_entries
from gcs_health.dashboard.view.lines import Line, beside, fill, fit, line, title, wrap
from gcs_health.dashboard.view.trace import quarters
from gcs_health.dashboard.words import SEVERITY, UNIX, clock

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
