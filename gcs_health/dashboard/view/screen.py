"""The whole screen: snapshot, state and size → a frame of lines, and what a click on them means."""

import math
from typing import NamedTuple

from gcs_health.dashboard.snapshot import Snapshot, VehicleShot
from gcs_health.dashboard.state import ROUND, Page, State
from gcs_health.dashboard.view import airframe, alerts, link, rotors
from gcs_health.dashboard.view.lines import BLANK, Line, beside, fill, fit, line, sides, title, width
from gcs_health.dashboard.view.overlays import laid_over, overlay
from gcs_health.dashboard.view.rotor_page import rotor_page
from gcs_health.dashboard.view.timeline import timeline
from gcs_health.dashboard.view.top import banner, head, strip
from gcs_health.dashboard.view.trace import quarters

SMALLEST = (40, 12)  # columns and rows below which only the verdict is shown
WIDE, TALL = 120, 34  # from here on plots and the blind-band map find room
MAP = 24  # cells of the airframe on a small screen


class Zone(NamedTuple):
    """Cells that can be clicked: `kind` is "entry", "motor", "key" or "timeline", `value` which."""

    left: int
    top: int
    right: int
    bottom: int
    kind: str
    value: str


class Frame(NamedTuple):
    """Exactly as many lines as the screen has, each exactly as wide."""

    lines: tuple[Line, ...]
    zones: tuple[Zone, ...]


def render(snapshot: Snapshot, state: State, cells: int, rows: int) -> Frame:
    """Return the frame."""
    vehicle = snapshot.vehicle(state.vehicle)
    name = vehicle.name if vehicle is not None else ""
    zones: list[Zone] = []
    top = [head(snapshot, vehicle, cells)]
    if len(snapshot.vehicles) > 1:
        top.append(strip(snapshot, name, cells))
        zones.append(Zone(0, 1, cells, 2, "key", "v"))
    zones.append(Zone(0, len(top), cells, len(top) + 1, "key", "enter"))
    top.append(banner(snapshot, vehicle, cells))
    bottom = [_footer(snapshot, state, vehicle, cells)]
    if snapshot.replay is not None:
        bottom.insert(0, timeline(snapshot.replay, cells))
        zones.append(Zone(0, rows - 2, cells, rows - 1, "timeline", ""))
    room = max(rows - len(top) - len(bottom), 0)
    if cells < SMALLEST[0] or rows < SMALLEST[1]:
        body = fill([], room)
    else:
        body, found = _body(snapshot, state, vehicle, cells, room)
        zones += [zone._replace(top=zone.top + len(top), bottom=zone.bottom + len(top)) for zone in found]
    body = laid_over(body, overlay(snapshot, state, cells), cells)
    lines = [*top, *body, *bottom][-rows:] if rows < len(top) + len(bottom) else [*top, *body, *bottom]
    zones += _hint_zones(snapshot, state, vehicle, cells, rows)
    return Frame(tuple(fit(each, cells) for each in lines), tuple(zones))


def _body(
    snapshot: Snapshot, state: State, vehicle: VehicleShot | None, cells: int, rows: int
) -> tuple[list[Line], list[Zone]]:
    if state.page is Page.WHY:
        return alerts.why(snapshot, state, cells, rows), []
    if state.page is Page.LINK:
        return link.link_page(snapshot, vehicle, cells, rows), []
    if state.page is Page.ALERTS:
        return _alerts(snapshot, state, vehicle, cells, rows)
    if vehicle is None:
        return _nobody(snapshot, cells, rows)
    if state.page is Page.ROTOR:
        return rotor_page(vehicle, state.motor, cells, rows), []
    return _overview(snapshot, state, vehicle, cells, rows)


def _nobody(snapshot: Snapshot, cells: int, rows: int) -> tuple[list[Line], list[Zone]]:
    lines = [BLANK, line(f"   {snapshot.waiting}"), BLANK]
    lines += [line((f"   {endpoint}", "bold")) for endpoint in snapshot.link.endpoints]
    if snapshot.waiting == "listening":
        lines += [
            BLANK,
            line(("   Is the vehicle sending here, and does no other program hold the port?", "dim")),
        ]
    return fill(lines, rows), []


def _alerts(
    snapshot: Snapshot, state: State, vehicle: VehicleShot | None, cells: int, rows: int, top: int = 0
) -> tuple[list[Line], list[Zone]]:
    lines, keys = alerts.alert_list(snapshot, state, cells, rows, vehicle.t if vehicle is not None else 0.0)
    zones = [Zone(0, top + k, cells, top + k + 1, "entry", key) for k, key in enumerate(keys) if key]
    return lines, zones


def _overview(
    snapshot: Snapshot, state: State, vehicle: VehicleShot, cells: int, rows: int
) -> tuple[list[Line], list[Zone]]:
    """Return airframe and table side by side, the list below; on large screens plots and the blind-band map."""
    large = cells >= WIDE and rows >= TALL
    n = len(vehicle.rotors)
    wide = MAP if cells < 100 else min(cells // 3, 52)
    right = cells - wide - 2
    listed = max(rows // 4, 4)
    high = rows - listed - (5 if large else 0)
    below = n + 1 <= high - (n + 3)  # the sparklines have a place of their own
    block = rotors.table(vehicle.rotors, right, not below)
    if large and high - len(block) >= 8 and vehicle.rows:
        ends = (vehicle.rows[-1].t - 60.0, vehicle.rows[-1].t)
        worst = max(range(n), key=lambda k: vehicle.rotors[k].level) if n else -1
        concerned = worst if n and vehicle.rotors[worst].level > 1 else -1
        block += [title("last minute", right)]
        block += quarters(vehicle.rows, concerned, right, high - len(block), ends, math.nan)
    elif below:
        block += rotors.sparklines(vehicle.rotors, right)
    used = max(min(max(len(block), 14), high), min(len(block), rows - 2))
    left = [title("airframe", wide), *airframe.airframe_map(vehicle.rotors, wide, used - 1)]
    lines = fill(beside(left, wide, block), used)
    zones = [
        Zone(x0, y0 + 1, x1, y1 + 1, "motor", str(motor))
        for x0, y0, x1, y1, motor in airframe.zones(vehicle.rotors, wide, used - 1)
    ]
    zones += [
        Zone(wide + 2, 2 + k, cells, 3 + k, "motor", str(rotor.motor))
        for k, rotor in enumerate(vehicle.rotors)
    ]
    if large:
        lines += [*fill(link.blind_map(vehicle, cells), 4)]
    found, more = _alerts(snapshot, state, vehicle, cells, rows - len(lines), len(lines))
    return lines + found, zones + more


def _hints(snapshot: Snapshot, state: State) -> list[tuple[str, str, str]]:
    """Return (key, shown key, what it does), the least needed first: they go where there is no room."""
    hints = [("tab", "tab", _next_page(state).value), ("question_mark", "?", "help"), ("q", "q", "quit")]
    if state.page is Page.WHY:
        hints = [("a", "a", "ack"), ("s", "s", "shelve"), ("escape", "esc", "back"), *hints[1:]]
    elif snapshot.replay is not None:
        hints = [
            ("n", "n", "next alert"),
            ("space", "space", "play" if _paused(snapshot) else "pause"),
            *hints,
        ]
    elif any(entry.kind == "alert" and entry.open for entry in snapshot.entries):
        hints = [("a", "a", "ack"), *hints]
    return hints


def _next_page(state: State) -> Page:
    page = state.before if state.page is Page.WHY else state.page
    return ROUND[(ROUND.index(page) + 1) % len(ROUND)]


def _paused(snapshot: Snapshot) -> bool:
    return snapshot.replay is not None and not snapshot.replay.playing


def _left(snapshot: Snapshot, state: State, vehicle: VehicleShot | None) -> Line:
    said = state.said or snapshot.ended
    return line((said, "bold")) if said else link.link_line(snapshot, vehicle)


def _shown_hints(
    snapshot: Snapshot, state: State, vehicle: VehicleShot | None, cells: int
) -> list[tuple[str, str, str]]:
    """Return the hints that fit beside what is said at the left, at least the last three."""
    hints = _hints(snapshot, state)
    room = cells - width(_left(snapshot, state, vehicle)) - 2
    while len(hints) > 3 and sum(len(shown) + len(what) + 2 for _, shown, what in hints) > room:
        hints = hints[1:]
    return hints


def _footer(snapshot: Snapshot, state: State, vehicle: VehicleShot | None, cells: int) -> Line:
    hints: list[tuple[str, str]] = []
    for _, shown, what in _shown_hints(snapshot, state, vehicle, cells):
        hints += [(shown, "key"), (f":{what} ", "dim")]
    return sides(_left(snapshot, state, vehicle), tuple(hints), cells)


def _hint_zones(
    snapshot: Snapshot, state: State, vehicle: VehicleShot | None, cells: int, rows: int
) -> list[Zone]:
    zones, at = [], cells
    for key, shown, what in reversed(_shown_hints(snapshot, state, vehicle, cells)):
        left = at - len(shown) - len(what) - 2
        zones.append(Zone(left, rows - 1, at, rows, "key", key))
        at = left
    return zones
