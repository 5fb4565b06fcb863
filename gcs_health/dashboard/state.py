"""What the operator has chosen, and what a key makes of it: state + key + snapshot → state and commands."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from gcs_health.dashboard import commands as c
from gcs_health.dashboard.snapshot import Entry, ReplayShot, Snapshot


class Page(StrEnum):
    """What fills the screen below the verdict."""

    OVERVIEW = "overview"
    ALERTS = "alerts"
    ROTOR = "rotor"
    LINK = "link"
    WHY = "why"


class Overlay(StrEnum):
    """What lies over it and takes the keys."""

    NONE = ""
    HELP = "help"
    REQUEST = "request"
    QUIT = "quit"
    SEEK = "seek"
    FILTER = "filter"


ROUND = (Page.OVERVIEW, Page.ALERTS, Page.ROTOR, Page.LINK)  # of tab
THEMES = ("dark", "light", "high contrast", "colour-blind", "no colour")


@dataclass(frozen=True, slots=True)
class State:
    """The operator's choices.

    Attributes
    ----------
    vehicle, entry, motor : chosen by name, key and number.
    before : the page that `why` was opened from.
    text : what is being typed. said : the answer to the last key, shown until the next.
    """

    page: Page = Page.OVERVIEW
    before: Page = Page.OVERVIEW
    vehicle: str = ""
    entry: str = ""
    motor: int = 1
    filter: str = ""
    overlay: Overlay = Overlay.NONE
    text: str = ""
    said: str = ""
    theme: str = THEMES[0]
    quit: bool = False


Result = tuple[State, tuple[c.Command, ...]]


def shown_entries(snapshot: Snapshot, state: State) -> list[Entry]:
    """Return the entries that pass the filter: all its words must be in what is shown of them."""
    words = state.filter.lower().split()
    return [entry for entry in snapshot.entries if all(word in _searched(entry) for word in words)]


def _searched(entry: Entry) -> str:
    grave = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")[entry.severity]
    return f"{grave} {entry.kind} {entry.vehicle} {entry.code} motor {entry.motor} {entry.text}".lower()


def chosen_entry(snapshot: Snapshot, state: State) -> Entry | None:
    """Return the entry that keys act on: the chosen one, else the gravest open alert, else the newest alert."""
    found = next((entry for entry in snapshot.entries if entry.key == state.entry), None)
    if found is not None:
        return found
    vehicle = snapshot.vehicle(state.vehicle)
    alerts = [entry for entry in snapshot.entries if entry.kind == "alert"]
    opened = [
        entry for entry in alerts if entry.open and vehicle is not None and entry.vehicle == vehicle.name
    ]
    return min(opened, key=lambda e: (e.acknowledged, e.severity, e.t), default=alerts[0] if alerts else None)


def press(state: State, key: str, snapshot: Snapshot) -> Result:
    """Return what a key, by Textual's name, makes of the state."""
    state = replace(state, said="")
    if key == "ctrl+c":
        return replace(state, quit=True), ()
    if state.overlay in (Overlay.SEEK, Overlay.FILTER):
        return _typed(state, key, snapshot)
    if state.overlay is Overlay.REQUEST:
        vehicle = snapshot.vehicle(state.vehicle)
        state = replace(state, overlay=Overlay.NONE)
        if key == "y" and vehicle is not None:
            return replace(state, said=f"asked {vehicle.name}"), (c.RequestRates(vehicle.name),)
        return replace(state, said="nothing was sent"), ()
    if state.overlay is Overlay.QUIT:
        return replace(state, overlay=Overlay.NONE, quit=key in ("y", "q")), ()
    if state.overlay is Overlay.HELP:
        return replace(state, overlay=Overlay.NONE), ()
    act = KEYS.get(key)
    if act is not None:
        return act(state, snapshot)
    if key.isdigit() and key != "0":
        return replace(state, motor=int(key), page=Page.ROTOR), ()
    return state, ()


def choose(state: State, key: str) -> State:
    """Return the state with an entry chosen."""
    return replace(state, entry=key)


def _typed(state: State, key: str, snapshot: Snapshot) -> Result:
    filtering = state.overlay is Overlay.FILTER
    if key == "escape":
        return replace(state, overlay=Overlay.NONE, text="", filter="" if filtering else state.filter), ()
    if key == "enter":
        done = replace(state, overlay=Overlay.NONE, text="")
        if filtering:
            return done, ()
        us = seek_time(state.text, snapshot.replay)
        if us is None:
            return replace(done, said=f"not a time: {state.text!r}; as in 2:30, +10, -5 or 50%"), ()
        return done, (c.Seek(us),)
    text = state.text
    if key == "backspace":
        text = text[:-1]
    elif key == "space":
        text += " "
    else:
        text += SIGNS.get(key, key) if len(SIGNS.get(key, key)) == 1 else ""
    return replace(state, text=text, filter=text if filtering else state.filter), ()


SIGNS = {
    "colon": ":", "plus": "+", "minus": "-", "percent_sign": "%", "full_stop": ".", "underscore": "_", "slash": "/",
}  # fmt: skip


def seek_time(text: str, replay: ReplayShot | None) -> int | None:
    """Return the UNIX µs meant by "2:30", "150", "+10", "-5" (s) or "50%"; None if that is no time."""
    if replay is None:
        return None
    text = text.strip()
    sign = {"+": 1, "-": -1}.get(text[:1], 0)
    try:
        if text.endswith("%"):
            part = float(text[:-1]) / 100.0
            return replay.start_us + int(part * (replay.end_us - replay.start_us))
        seconds = 0.0
        for field in (text[1:] if sign else text).split(":"):
            seconds = 60.0 * seconds + float(field)
    except ValueError:
        return None
    if not seconds < 1e9:
        return None
    return (replay.at_us if sign else replay.start_us) + (sign or 1) * int(seconds * 1e6)


# -- what keys do ---------------------------------------------------------------------------------------


def _tab(step: int) -> Callable[[State, Snapshot], Result]:
    def act(state: State, snapshot: Snapshot) -> Result:
        page = state.before if state.page is Page.WHY else state.page
        return replace(state, page=ROUND[(ROUND.index(page) + step) % len(ROUND)]), ()

    return act


def _to(page: Page) -> Callable[[State, Snapshot], Result]:
    return lambda state, snapshot: (replace(state, page=page), ())


def _over(overlay: Overlay) -> Callable[[State, Snapshot], Result]:
    def act(state: State, snapshot: Snapshot) -> Result:
        text = state.filter if overlay is Overlay.FILTER else ""
        if overlay is Overlay.SEEK and snapshot.replay is None:
            return replace(state, said="only a replay can be moved in time"), ()
        if overlay is Overlay.REQUEST:
            vehicle = snapshot.vehicle(state.vehicle)
            if snapshot.replay is not None or snapshot.ended:
                return replace(state, said="nobody is there to be asked"), ()
            if vehicle is None or not vehicle.requests:
                return replace(state, said="all that can be asked for comes already"), ()
        return replace(state, overlay=overlay, text=text), ()

    return act


def _escape(state: State, snapshot: Snapshot) -> Result:
    page = state.before if state.page is Page.WHY else Page.OVERVIEW
    return replace(state, page=page, filter="" if state.page is Page.OVERVIEW else state.filter), ()


def _why(state: State, snapshot: Snapshot) -> Result:
    entry = chosen_entry(snapshot, state)
    if entry is None:
        return replace(state, said="no alert to explain"), ()
    if state.page is Page.WHY:
        return replace(state, page=state.before), ()
    vehicle = entry.vehicle or state.vehicle  # of whom the rest of the screen speaks, too
    return replace(state, before=state.page, page=Page.WHY, entry=entry.key, vehicle=vehicle), ()


def _move(step: int) -> Callable[[State, Snapshot], Result]:
    def act(state: State, snapshot: Snapshot) -> Result:
        if state.page is Page.ROTOR:
            return _rotor(state, snapshot, step)
        entries = shown_entries(snapshot, state)
        keys = [entry.key for entry in entries]
        if not keys:
            return state, ()
        at = keys.index(state.entry) + step if state.entry in keys else 0
        return replace(state, entry=keys[min(max(at, 0), len(keys) - 1)]), ()

    return act


def _rotor(state: State, snapshot: Snapshot, step: int) -> Result:
    vehicle = snapshot.vehicle(state.vehicle)
    motors = [rotor.motor for rotor in vehicle.rotors] if vehicle is not None else []
    if not motors:
        return state, ()
    at = motors.index(state.motor) + step if state.motor in motors else 0
    return replace(state, motor=motors[at % len(motors)]), ()


def _acknowledge(state: State, snapshot: Snapshot) -> Result:
    entry = chosen_entry(snapshot, state)
    if entry is None or entry.kind != "alert" or not entry.open:
        return replace(state, said="no open alert to acknowledge"), ()
    if entry.acknowledged:
        return replace(state, said=f"{entry.code} was acknowledged already"), ()
    return replace(
        state, said=f"acknowledged {entry.code}" + (f" of motor {entry.motor}" if entry.motor else "")
    ), (c.Acknowledge(entry.key),)


def _shelve(state: State, snapshot: Snapshot) -> Result:
    entry = chosen_entry(snapshot, state)
    if entry is None or entry.kind != "alert" or not entry.open:
        return replace(state, said="no open alert to shelve"), ()
    vehicle = next((v for v in snapshot.vehicles if v.name == entry.vehicle), None)
    if vehicle is not None and entry.shelved(vehicle.t):
        return replace(state, said=f"{entry.code} is heard of again"), (c.Shelve(entry.key, 0.0),)
    said = f"{entry.code} shelved for {c.SHELVE_FOR / 60.0:.0f} min, unless it gets graver; s again ends it"
    return replace(state, said=said), (c.Shelve(entry.key, c.SHELVE_FOR),)


def _vehicle(state: State, snapshot: Snapshot) -> Result:
    names = [vehicle.name for vehicle in snapshot.vehicles]
    if len(names) < 2:
        return replace(state, said="there is one vehicle" if names else "there is no vehicle yet"), ()
    now = snapshot.vehicle(state.vehicle)
    at = names.index(now.name) if now is not None else -1
    return replace(state, vehicle=names[(at + 1) % len(names)], entry=""), ()


def _theme(state: State, snapshot: Snapshot) -> Result:
    theme = THEMES[(THEMES.index(state.theme) + 1) % len(THEMES)]
    return replace(state, theme=theme, said=f"theme: {theme}"), ()


def _jump(
    forward: bool, of: Callable[[ReplayShot], list[int]], what: str
) -> Callable[[State, Snapshot], Result]:
    def act(state: State, snapshot: Snapshot) -> Result:
        if snapshot.replay is None:
            return _next_alert(state, snapshot, forward) if what == "alert" else (state, ())
        at, slack = snapshot.replay.at_us, 600_000  # what was just jumped to is passed
        times = sorted(of(snapshot.replay))
        found = [us for us in times if (us > at + slack if forward else us < at - slack)]
        if not found:
            read = snapshot.replay.scanned
            so_far = "" if read >= 1.0 else f" in the {100 * read:.0f} % read so far"
            return replace(state, said=f"no {'later' if forward else 'earlier'} {what}{so_far}"), ()
        us = found[0] if forward else found[-1]
        return replace(state, said=""), (c.Seek(us + 200_000),)

    return act


def _next_alert(state: State, snapshot: Snapshot, forward: bool) -> Result:
    """Choose the next alert in the list: live there is nowhere to go."""
    keys = [entry.key for entry in snapshot.entries if entry.kind == "alert"]
    if not keys:
        return replace(state, said="no alert so far"), ()
    at = (keys.index(state.entry) + (1 if forward else -1)) % len(keys) if state.entry in keys else 0
    return replace(state, entry=keys[at]), ()


def _player(command: c.Command) -> Callable[[State, Snapshot], Result]:
    def act(state: State, snapshot: Snapshot) -> Result:
        if snapshot.replay is None:
            return replace(state, said="only a replay can be moved in time"), ()
        return state, (command,)

    return act


def _end(last: bool) -> Callable[[State, Snapshot], Result]:
    def act(state: State, snapshot: Snapshot) -> Result:
        if snapshot.replay is None:
            return state, ()
        return state, (c.Seek(snapshot.replay.end_us if last else snapshot.replay.start_us),)

    return act


def _quit(state: State, snapshot: Snapshot) -> Result:
    """Leave; ask first where that would end the watch over a vehicle that is armed."""
    live = snapshot.replay is None and not snapshot.ended
    if live and any(vehicle.armed and not vehicle.stale for vehicle in snapshot.vehicles):
        return replace(state, overlay=Overlay.QUIT), ()
    return replace(state, quit=True), ()


def _alerts(replay: ReplayShot) -> list[int]:
    return [us for us, _ in replay.marks]


def _armings(replay: ReplayShot) -> list[int]:
    return [us for us, _ in replay.armings]


KEYS: dict[str, Callable[[State, Snapshot], Result]] = {
    "q": _quit,
    "question_mark": _over(Overlay.HELP),
    "h": _over(Overlay.HELP),
    "tab": _tab(1),
    "shift+tab": _tab(-1),
    "o": _to(Page.OVERVIEW),
    "l": _to(Page.LINK),
    "escape": _escape,
    "enter": _why,
    "up": _move(-1),
    "down": _move(1),
    "k": _move(-1),
    "j": _move(1),
    "a": _acknowledge,
    "s": _shelve,
    "slash": _over(Overlay.FILTER),
    "v": _vehicle,
    "t": _theme,
    "r": _over(Overlay.REQUEST),
    "g": _over(Overlay.SEEK),
    "n": _jump(True, _alerts, "alert"),
    "N": _jump(False, _alerts, "alert"),
    "m": _jump(True, _armings, "arming"),
    "M": _jump(False, _armings, "arming"),
    "space": _player(c.Pause()),
    "left": _player(c.Step(-1)),
    "right": _player(c.Step(1)),
    "left_square_bracket": _player(c.Speed(-1)),
    "right_square_bracket": _player(c.Speed(1)),
    "b": _player(c.Reverse()),
    "home": _end(False),
    "end": _end(True),
}
