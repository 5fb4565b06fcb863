"""The Textual app, thin: keys and clicks go into `state`, the lines that changed come out.

One widget that draws lines, because a table with sparklines costs ten times as much (benchmarks/dashboard.md); only
lines that changed are drawn again, so that nothing flickers and little goes over SSH.
"""

import asyncio
import os
import signal
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

from rich.segment import Segment
from textual import events
from textual.app import App, ComposeResult, SystemCommand
from textual.geometry import Region
from textual.screen import Screen
from textual.strip import Strip
from textual.widget import Widget

from gcs_health.dashboard.commands import Command, Seek
from gcs_health.dashboard.snapshot import EMPTY, Snapshot
from gcs_health.dashboard.state import KEYS, THEMES, Overlay, Page, State, press
from gcs_health.dashboard.themes import style_of
from gcs_health.dashboard.view.lines import Line
from gcs_health.dashboard.view.screen import Frame, Zone, render
from gcs_health.dashboard.view.timeline import time_at

PICTURES = 0.1  # s between looks for a new picture
NO_COLOUR = THEMES[-1]

# for the command palette: key and what it does
NAMED = (
    ("question_mark", "Help", "all keys"),
    ("o", "Overview", "airframe, rotors, alerts"),
    ("l", "Link", "rates, needs, blind bands"),
    ("enter", "Why", "the evidence of the chosen alert"),
    ("a", "Acknowledge", "the chosen alert was seen"),
    ("s", "Shelve", "silence on the chosen alert for 10 minutes, or end it"),
    ("slash", "Filter", "the list of alerts by words"),
    ("v", "Next vehicle", "choose the next vehicle"),
    ("r", "Request rates", "ask the vehicle for what is missing, after a confirmation"),
    ("g", "Go to a time", "in a replay"),
    ("space", "Pause or play", "a replay"),
    ("b", "Backwards", "play a replay the other way"),
    ("n", "Next alert", "in a replay or in the list"),
    ("m", "Next arming", "in a replay"),
)


class Pipeline(Protocol):
    """What the screen needs of the pipeline: `interface.Worker`, or a stand-in."""

    done: bool
    error: BaseException | None

    def start(self) -> None:
        """Begin."""
        ...

    def take(self) -> Snapshot | None:
        """Return the newest picture, once."""
        ...

    def send(self, command: Command) -> None:
        """Ask for something."""
        ...


class Canvas(Widget, can_focus=True):
    """The lines of a frame; `resized` is called when it has another size."""

    def __init__(self, resized: Callable[[], object]) -> None:
        super().__init__()
        self._resized = resized
        self.frame_shown = Frame((), ())
        self.theme_shown = THEMES[0]
        self._strips: list[Strip] = []

    def show(self, frame: Frame, theme: str) -> int:
        """Draw the lines that changed; return how many."""
        before = self.frame_shown.lines
        anew = theme != self.theme_shown or len(before) != len(frame.lines)
        changed = [y for y, line in enumerate(frame.lines) if anew or line != before[y]]
        self.frame_shown, self.theme_shown = frame, theme
        if anew:
            self._strips = [Strip([])] * len(frame.lines)
        for y in changed:
            self._strips[y] = strip_of(frame.lines[y], theme)
        if changed:
            width = self.size.width
            self.refresh(*(Region(0, y, width, 1) for y in changed))
        return len(changed)

    def on_resize(self) -> None:
        """See Textual."""
        self._resized()

    def render_line(self, y: int) -> Strip:
        """See Textual."""
        if y < len(self._strips):
            return self._strips[y]
        return Strip.blank(
            self.size.width, style_of(self.theme_shown, "")
        )  # a bare one breaks under NO_COLOR


def strip_of(line: Line, theme: str) -> Strip:
    """Return a line as Textual draws it."""
    return Strip([Segment(text, style_of(theme, style)) for text, style in line])


class Dashboard(App[None]):
    """The screen of one session.

    Parameters
    ----------
    pipeline : started once the first picture is on the screen.
    theme : the first one; "no colour" wherever NO_COLOR is set.
    first : the picture until there is another. leaves : whether to quit when the pipeline is done.
    """

    CSS = "Screen { overflow: hidden; } Canvas { width: 100%; height: 100%; }"
    ENABLE_COMMAND_PALETTE = True
    BINDINGS = []  # noqa: RUF012 (Textual's own; every key goes through `state.press`)

    def __init__(
        self,
        pipeline: Pipeline,
        first: Snapshot = EMPTY,
        theme: str = THEMES[0],
        leaves: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__()
        self.pipeline = pipeline
        self.snapshot = first
        self.state = State(theme=NO_COLOUR if os.environ.get("NO_COLOR") else theme)
        self.canvas = Canvas(self.draw)
        self.interrupted = False
        self._leaves = leaves

    def compose(self) -> ComposeResult:
        """See Textual."""
        yield self.canvas

    def on_mount(self) -> None:
        """Draw, and only then let the pipeline begin: what it imports takes longer than the first picture."""
        self._tell_textual()
        self.canvas.focus()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            with suppress(NotImplementedError, RuntimeError, ValueError):
                loop.add_signal_handler(number, self._interrupt)
        self.call_after_refresh(self._begin)

    def _begin(self) -> None:
        self.draw()
        self.pipeline.start()
        self.set_interval(PICTURES, self.look)

    def look(self) -> None:
        """Take a new picture, if there is one."""
        done = self.pipeline.done
        snapshot = self.pipeline.take()
        if snapshot is not None:
            self.snapshot = snapshot
            self.draw()
        if done and (self.pipeline.error is not None or self._leaves()):
            self.exit()

    def draw(self) -> int:
        """Draw what changed; return how many lines."""
        width, height = self.canvas.size
        if not width or not height:
            return 0
        return self.canvas.show(render(self.snapshot, self.state, width, height), self.state.theme)

    def press_key(self, key: str) -> None:
        """Do what a key means."""
        theme = self.state.theme
        self.state, commands = press(self.state, key, self.snapshot)
        for command in commands:
            self.pipeline.send(command)
        if self.state.theme != theme:
            self._tell_textual()
        if self.state.quit:
            self.interrupted |= key == "ctrl+c"
            self.exit()
            return
        self.draw()

    # -- what comes from Textual --------------------------------------------------------------------

    async def on_event(self, event: events.Event) -> None:
        """Take every key but those of the command palette before Textual does."""
        if isinstance(event, events.Key) and len(self.screen_stack) == 1:
            key = event.character if event.character and event.character.isupper() else event.key
            if key != "ctrl+p":
                self.press_key(key)
                return
        await super().on_event(event)

    def on_click(self, event: events.Click) -> None:
        """Choose what was clicked; a second click on an alert opens it."""
        if self.state.overlay is not Overlay.NONE:
            self.press_key("escape")
            return
        zone = zone_at(self.canvas.frame_shown, event.screen_x, event.screen_y)
        if zone is None:
            return
        if zone.kind == "key":
            self.press_key(zone.value)
        elif zone.kind == "motor":
            self.state = replace(self.state, motor=int(zone.value), page=Page.ROTOR)
        elif zone.kind == "entry":
            if self.state.entry == zone.value:
                self.press_key("enter")
            else:
                self.state = replace(self.state, entry=zone.value)
        elif self.snapshot.replay is not None:
            us = time_at(self.snapshot.replay, event.screen_x, self.canvas.size.width)
            if us is not None:
                self.pipeline.send(Seek(us))
        self.draw()

    def on_mouse_scroll_down(self) -> None:
        """Move on in the list."""
        self.press_key("down")

    def on_mouse_scroll_up(self) -> None:
        """Move back in the list."""
        self.press_key("up")

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Offer all that keys do, and the themes by name."""
        for key, name, what in NAMED:
            assert key in KEYS
            yield SystemCommand(name, what, lambda key=key: self.press_key(key))
        for theme in THEMES:
            yield SystemCommand(f"Theme: {theme}", "colours", lambda theme=theme: self._choose_theme(theme))
        yield SystemCommand("Quit", "end the session", lambda: self.press_key("q"))

    def _choose_theme(self, theme: str) -> None:
        self.state = replace(self.state, theme=theme)
        self._tell_textual()
        self.draw()

    def _tell_textual(self) -> None:
        """Let the command palette be light or dark as the rest is."""
        self.theme = "textual-light" if self.state.theme == "light" else "textual-dark"

    def _interrupt(self) -> None:
        self.interrupted = True
        self.exit()


def zone_at(frame: Frame, x: int, y: int) -> Zone | None:
    """Return what lies at a cell, the last drawn first."""
    return next((z for z in reversed(frame.zones) if z.left <= x < z.right and z.top <= y < z.bottom), None)
