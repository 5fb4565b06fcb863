"""What lies over the page: help, the question before something is sent, the prompts."""

from gcs_health.dashboard.snapshot import Snapshot
from gcs_health.dashboard.state import Overlay, State
from gcs_health.dashboard.view.lines import Line, cut, fit, line, wrap

HELP = (
    ("enter", "why: evidence of the chosen alert", "?", "help; any key closes it"),
    ("↑ ↓", "choose an alert, or a rotor", "tab", "the next page"),
    ("a", "acknowledge: seen, no longer loud", "1-9", "all about one motor"),
    ("s", "shelve for 10 min; again: end it", "o l esc", "overview, link, back"),
    ("/", "filter the list by words", "v", "next vehicle"),
    ("n N", "next, previous alert", "t", "theme"),
    ("r", "request message rates: asks first", "ctrl+p", "commands by name"),
    ("", "", "q", "quit; ctrl+c: at once"),
)
REPLAY_HELP = (
    ("space", "pause, play", "g", "go to 2:30 +10 -5 50%"),
    ("← →", "a tenth of a second back, on", "n N", "next, previous alert"),
    ("[ ]", "slower, faster: 0.1x to max", "m M", "next, previous arming"),
    ("b", "backwards, or on again", "home end", "start, end"),
)
SIGNS = ("╭╮ ok    ┌┐? unknown    ┏┓! look at it    ╔╗✗ failed    ↺ ↻ spin, from above",)


def overlay(snapshot: Snapshot, state: State, cells: int) -> list[Line]:
    """Return the box that lies over the page; empty for none."""
    if state.overlay is Overlay.HELP:
        return _box("keys", _help(snapshot), min(cells - 2, 78))
    if state.overlay is Overlay.REQUEST:
        vehicle = snapshot.vehicle(state.vehicle)
        assert vehicle is not None
        wide = min(cells - 2, 74)
        lines = wrap(f"Send to {vehicle.name}: commands that ask it for {vehicle.requests}.", wide - 4)
        lines += wrap(
            "This transmits on the link. The vehicle then sends these messages so often; nothing else of it changes.",
            wide - 4,
            "dim",
        )
        lines.append(line(("y", "key"), " send     ", ("any other key", "key"), " do not"))
        return _box("request message rates", lines, wide)
    if state.overlay is Overlay.QUIT:
        recorded = " and its recording" if snapshot.link.recording else ""
        asked = line(f"A vehicle is armed. End the watch over it{recorded}?")
        keys = line(("y", "key"), ", ", ("q", "key"), " quit     ", ("any other key", "key"), " stay")
        return _box("quit", [asked, keys], min(cells - 2, 64))
    if state.overlay is Overlay.SEEK:
        text = line("to: ", (state.text, "bold"), ("▏", "pick"), ("   2:30  +10  -5  50%", "dim"))
        return _box("go to a time", [text], min(cells - 2, 50))
    if state.overlay is Overlay.FILTER:
        text = line("/ ", (state.text, "bold"), ("▏", "pick"), ("   words; esc: all", "dim"))
        return _box("filter the alerts", [text], min(cells - 2, 50))
    return []


def _help(snapshot: Snapshot) -> list[Line]:
    rows = (*HELP, *(REPLAY_HELP if snapshot.replay is not None else ()))
    lines = [
        line((f"{key:<6}", "key"), f"{what:<35}", (f"{other:<9}", "key"), said)
        for key, what, other, said in rows
    ]
    return [*lines, *(line((text, "dim")) for text in SIGNS)]


def _box(name: str, lines: list[Line], wide: int) -> list[Line]:
    top = line((f"╭─ {name} ".ljust(wide - 1, "─") + "╮", "title"))
    body = [(("│ ", "title"), *fit(each, wide - 4), (" │", "title")) for each in lines]
    return [top, *body, line(("╰" + "─" * (wide - 2) + "╯", "title"))]


def laid_over(page: list[Line], box: list[Line], cells: int) -> list[Line]:
    """Return the page with the box in its middle."""
    if not box:
        return page
    wide = sum(len(text) for text, _ in box[0])
    left, top = max((cells - wide) // 2, 0), max((len(page) - len(box)) // 2, 0)
    out = list(page)
    for k, each in enumerate(box[: len(page)]):
        under = fit(page[top + k], cells)
        out[top + k] = (*cut(under, 0, left), *each, *cut(under, left + wide, cells))
    return out
