"""The link: what comes, what each estimator needs, what could be asked for; where unbalance cannot be seen."""

from collections.abc import Sequence

from gcs_health.dashboard.snapshot import NeedShot, RotorShot, Snapshot, VehicleShot
from gcs_health.dashboard.view.lines import BLANK, Line, beside, fill, fit, line, title, wrap
from gcs_health.dashboard.words import RPM, size

BLIND_GAIN = 0.03  # `RecommendedConfig.blind`: below, the line is not observable
WEAK_GAIN = 0.2


def link_page(snapshot: Snapshot, vehicle: VehicleShot | None, cells: int, rows: int) -> list[Line]:
    """Return all about the link."""
    lines = [title("link", cells)]
    if vehicle is None:
        lines.append(line((f"   {snapshot.waiting}", "dim")))
        lines += _counters(snapshot, cells)
        return fill(lines, rows)
    wide = max(cells * 11 // 20, 30)
    right = [line(("messages, Hz", "title"))]
    right += [
        fit(line(f"{name:<26}{rate:>7.1f}"), cells - wide - 2) for name, rate in vehicle.messages[: rows - 3]
    ]
    lines += beside(_about(snapshot, vehicle, wide), wide, right)
    out = fill(lines, max(rows - 6, len(lines))) if rows < len(lines) + 6 else [*lines, BLANK]
    return fill([*out[: rows - 6], *blind_map(vehicle, cells), *_counters(snapshot, cells)], rows)


def _about(snapshot: Snapshot, vehicle: VehicleShot, cells: int) -> list[Line]:
    lines: list[Line] = []
    if len(vehicle.sources) > 1:
        lines += wrap(
            f"{vehicle.name} is spoken for by {len(vehicle.sources)} links at once, a duplicate system id: "
            + ", ".join(vehicle.sources),
            cells,
            "fail",
        )
    for path in snapshot.link.recording[-1:]:
        lines += wrap(f"recording {path}, {size(snapshot.link.recorded)}", cells, "bold", 2)
    lines += needs(vehicle, cells)
    if vehicle.requests:
        lines += wrap(f"r: ask for {vehicle.requests}", cells, "key", 3)
    lines += wrap(f"airframe {vehicle.airframe or 'not known yet'}", cells, "", 2)
    for text in (*vehicle.warnings, *vehicle.clock, vehicle.imu, *vehicle.telemetry):
        lines += wrap(text, cells, "dim", 2)
    for name, reason in vehicle.refused:
        lines += wrap(f"{name} does not run: {reason}", cells, "warn", 2)
    if not snapshot.link.recording and snapshot.replay is None:
        lines.append(line(("not recorded (--record)", "dim")))
    return lines


def needs(vehicle: VehicleShot, cells: int) -> list[Line]:
    """Return what each estimator needs against what comes: in a line where it has all, else what would mend it."""
    lines: list[Line] = []
    told: set[str] = set()
    for estimator in dict.fromkeys(need.estimator for need in vehicle.needs):
        mine = [need for need in vehicle.needs if need.estimator == estimator]
        missing = [need for need in mine if not need.met]
        head = f"! {estimator} lacks" if missing else f"ok {estimator}:"
        said = ", ".join(map(_rate, missing or mine))
        lines += wrap(f"{head.replace('_', ' ')} {said}", cells, _tone(missing), 3)
        for need in missing:
            if need.remedy not in told:
                told.add(need.remedy)
                lines += wrap(need.remedy, cells, "dim", 0, 3)
    return lines


def _tone(missing: Sequence[NeedShot]) -> str:
    return "warn" if missing else ""


def _rate(need: NeedShot) -> str:
    if need.rate != need.rate:
        return need.input
    return f"{need.input} {need.rate:.0f} of {need.wanted:.0f} Hz"


def blind_map(vehicle: VehicleShot, cells: int) -> list[Line]:
    """Return at which rotor speeds unbalance cannot be seen at this stream rate, and where the rotors are."""
    heading = title(f"unbalance by rotor speed, at {vehicle.imu_rate:.0f} Hz of accelerations", cells)
    if not vehicle.blind:
        return [heading, line(("   needs accelerations and rotor speeds", "dim"))]
    points = vehicle.blind
    shown = [points[k * len(points) // cells][1] for k in range(cells)]
    fastest = points[-1][0]
    bar = "".join("░" if gain < BLIND_GAIN else "▒" if gain < WEAK_GAIN else "█" for gain in shown)
    scale = f"{0:<6}{'█ seen  ▒ weak  ░ blind':^{max(cells - 16, 0)}}{fastest * RPM:>6.0f} rpm"
    return [
        heading,
        _markers(vehicle.rotors, fastest, cells),
        line((bar, "dim")),
        line((scale[:cells], "dim")),
    ]


def _markers(rotors: Sequence[RotorShot], fastest: float, cells: int) -> Line:
    marks = [" "] * cells
    for rotor in rotors:
        if rotor.speed == rotor.speed and rotor.speed > 0.0:
            at = min(int(rotor.speed / fastest * cells), cells - 1)
            while at < cells - 1 and marks[at] != " ":
                at += 1
            marks[at] = str(rotor.motor % 10)
    return line(("".join(marks), "bold"))


def _counters(snapshot: Snapshot, cells: int) -> list[Line]:
    said = "  ".join(f"{name.replace('_', ' ')} {count}" for name, count in snapshot.link.counters)
    return wrap(said, cells, "dim")


def link_line(snapshot: Snapshot, vehicle: VehicleShot | None) -> Line:
    """Return the link in half a line: received of wanted rates, signing."""
    if vehicle is None:
        return line((snapshot.waiting, "dim"))
    if vehicle.stale:
        return line((f"{vehicle.name} silent for {vehicle.silent:.0f} s", "warn"))
    parts: list[tuple[str, str]] = []
    told: set[str] = set()
    for short, name in (("IMU", "accelerations and rates"), ("ESC", "rotor speeds"), ("A", "motor currents")):
        for need in vehicle.needs:
            if need.input == name and name not in told:
                told.add(name)
                style = "dim" if need.met else "warn"
                parts.append((f"{short} {need.rate:.0f}/{need.wanted:.0f}  ", style))
    counters = dict(snapshot.link.counters)
    if len(vehicle.sources) > 1:
        parts.append(("DUPLICATE ID  ", "fail"))
    signed = "signed" if counters.get("signed") and not counters.get("unsigned") else "unsigned"
    parts.append((signed, "dim"))
    return tuple(parts)
