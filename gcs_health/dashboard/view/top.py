"""The first lines: who flies, the other vehicles, and the verdict, always at the same place."""

from collections.abc import Sequence

from gcs_health.dashboard.snapshot import Entry, Level, RotorShot, Snapshot, VehicleShot
from gcs_health.dashboard.view.lines import Line, fit, line, sides
from gcs_health.dashboard.words import SHORT, clock, percent, size, span


def head(snapshot: Snapshot, vehicle: VehicleShot | None, cells: int) -> Line:
    """Return who flies, how, for how long; recording and loss at the right."""
    right: list[tuple[str, str]] = []
    if snapshot.link.recording:
        right.append((f"REC {size(snapshot.link.recorded)}  ", "bold"))
    if vehicle is None:
        return fit(line(("gcs_health", "bold"), "  ", ("  ".join(snapshot.link.endpoints), "dim")), cells)
    if vehicle.loss == vehicle.loss and not vehicle.stale:
        right.append((f"loss {100.0 * vehicle.loss:.1f} %", "warn" if vehicle.loss > 0.1 else "dim"))
    armed = {True: ("ARMED", "bold"), False: ("disarmed", "dim"), None: ("", "")}[vehicle.armed]
    where = ""
    if vehicle.landed is True:
        where = "on ground"
    elif vehicle.since == vehicle.since:
        where = f"IN AIR {span(vehicle.t - vehicle.since)}" if vehicle.landed is False else "armed "
    left = line(
        (vehicle.name, "bold"),
        " ",
        vehicle.title,
        "  ",
        (vehicle.mode, ""),
        "  ",
        armed,
        "  ",
        (where.strip(), ""),
    )
    if snapshot.replay is not None:
        right.insert(0, ("REPLAY  ", "bold"))
    return sides(tuple(part for part in left if part[0]), tuple(right), cells)


def strip(snapshot: Snapshot, chosen: str, cells: int) -> Line:
    """Return all vehicles, each with the worst of it, the chosen one marked."""
    parts: list[tuple[str, str]] = []
    for vehicle in snapshot.vehicles:
        level, said = worst_of(snapshot, vehicle)
        alarm = first_alarm(snapshot.entries, vehicle.name, vehicle.t)
        loud = level is Level.FAILED and alarm is not None and not alarm.acknowledged
        style = {Level.FAILED: "fail", Level.WARN: "warn", Level.UNKNOWN: "unknown", Level.OK: ""}[level]
        style = "alarm" if loud else style
        mark = "▸" if vehicle.name == chosen else " "
        parts += [
            (f"{mark}{vehicle.name} ", "pick" if vehicle.name == chosen else ""),
            (f" {said} ", style),
            ("  ", ""),
        ]
    return fit(tuple(parts), cells)


def worst_of(snapshot: Snapshot, vehicle: VehicleShot) -> tuple[Level, str]:
    """Return the worst that is known of a vehicle, in words."""
    alarm = first_alarm(snapshot.entries, vehicle.name, vehicle.t)
    if vehicle.stale and alarm is None:
        return Level.UNKNOWN, f"silent {vehicle.silent:.0f} s"
    if alarm is not None:
        sign = "✗" if alarm.level is Level.FAILED else "!"
        return alarm.level, f"{sign} {alarm.code} {_whose(alarm)}"
    level = max((rotor.level for rotor in vehicle.rotors), default=Level.UNKNOWN)
    return level, {Level.OK: "ok", Level.UNKNOWN: "? unknown", Level.WARN: "! look", Level.FAILED: "✗"}[level]


def first_alarm(entries: Sequence[Entry], vehicle: str, t: float) -> Entry | None:
    """Return the open alert that matters most: the gravest, and of those the first."""
    found = [
        entry
        for entry in entries
        if entry.kind == "alert" and entry.open and entry.vehicle == vehicle and not entry.shelved(t)
    ]
    return min(found, key=lambda entry: (entry.acknowledged, entry.severity, entry.t), default=None)


def banner(snapshot: Snapshot, vehicle: VehicleShot | None, cells: int) -> Line:
    """Return the verdict: one thing, loud where it must be."""
    if vehicle is None:
        return fit(line((f" {snapshot.waiting}… ", "unknown")), cells)
    alarm = first_alarm(snapshot.entries, vehicle.name, vehicle.t)
    silent = f"link silent {vehicle.silent:.0f} s" if vehicle.stale else ""
    if alarm is not None:
        return _alarm(alarm, vehicle, silent, cells)
    if silent:
        text = f" ? NOTHING HEARD FOR {vehicle.silent:.0f} s ▐ nothing is known of any rotor now"
        return fit(line((text, "stale")), cells, "stale")
    if snapshot.ended and not vehicle.rotors:
        return fit(line((f" {snapshot.ended} ", "unknown")), cells)
    return _calm(vehicle, cells)


def _alarm(alarm: Entry, vehicle: VehicleShot, silent: str, cells: int) -> Line:
    seat = next((rotor.seat for rotor in vehicle.rotors if rotor.motor == alarm.motor), "").split(",")[0]
    name = alarm.code.replace("_", " ")
    loud = "acked" if alarm.acknowledged else "alarm" if alarm.level is Level.FAILED else "caution"
    sign = "✗" if alarm.level is Level.FAILED else "!"
    seen = "seen  " if alarm.acknowledged else "▌ "
    left = line((f" {sign} {name} {seen}{_whose(alarm)} {seat}  {percent(alarm.probability)}", loud))
    left += line((f"  since {clock(alarm.t)}", loud))
    right = line((f"{silent}  " if silent else "", loud), ("enter: why ", loud))
    filled = fit(left, cells - sum(len(text) for text, _ in right), loud)
    return (*filled, *right)


def _whose(alarm: Entry) -> str:
    return f"motor {alarm.motor}" if alarm.motor else "one of the motors"


def _calm(vehicle: VehicleShot, cells: int) -> Line:
    rotors = vehicle.rotors
    if vehicle.unusable:
        return fit(line((f" ? {vehicle.unusable}", "unknown")), cells)
    if not rotors:
        return fit(line((" ? rotors unknown: the airframe is not known yet", "unknown")), cells)
    unknown = [rotor for rotor in rotors if rotor.level is Level.UNKNOWN]
    odd = [rotor for rotor in rotors if rotor.level > Level.UNKNOWN]
    if odd:  # no alert is open: it is short of one, or the operator shelved it
        words = ", ".join(f"motor {rotor.motor} {SHORT.get(rotor.state, rotor.state)}" for rotor in odd)
        return fit(line((f" ! {words}: no alert (yet), or shelved", "warn")), cells)
    if len(unknown) == len(rotors):
        return fit(line((f" ? rotors unknown: {common_reason(unknown)}", "unknown")), cells)
    if unknown:
        motors = ", ".join(str(rotor.motor) for rotor in unknown)
        text = f" ? {len(rotors) - len(unknown)} rotors ok, motor {motors} unknown: {common_reason(unknown)}"
        return fit(line((text, "unknown")), cells)
    return fit(line((f" all {len(rotors)} rotors ok", "ok"), (f"   {seen_now(rotors)}", "dim")), cells)


def common_reason(rotors: Sequence[RotorShot]) -> str:
    """Return what keeps most of them unknown."""
    reasons = [rotor.why.split("; ")[0] for rotor in rotors if rotor.why]
    return max(reasons, key=reasons.count) if reasons else "no evidence yet"


def seen_now(rotors: Sequence[RotorShot]) -> str:
    """Say which sudden loss of thrust would be seen now, on whichever rotor."""
    losses = []
    for rotor in rotors:
        figure = rotor.figure("effectiveness")
        losses.append(figure.detectable if figure is not None else float("nan"))
    if not losses or any(loss != loss for loss in losses):
        return "which loss would be seen now is not known"
    return f"a loss of {100.0 * max(losses):.0f} % would be seen now"
