"""The app on a screen of its own, without a terminal, and its picture as SVG.

python tests/dashboard/screens.py      makes the golden pictures anew: look at what changed
"""

import asyncio
import re
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

import pictures as p
from textual.pilot import Pilot

from gcs_health.dashboard.app import Dashboard
from gcs_health.dashboard.commands import Command
from gcs_health.dashboard.snapshot import Snapshot

GOLDEN = Path(__file__).parent / "golden"
SIZES = ((80, 24), (160, 50))
PAGES = {"why": "enter", "rotor": "1", "link": "l", "alerts": "tab", "help": "question_mark", "request": "r"}
CASES = [(scene, frame, size) for scene in p.SCENES for frame in ("quad", "hexa", "octa") for size in SIZES]


class Still:
    """A pipeline that gives one picture, or those put into it, and keeps what it is asked for."""

    def __init__(self, *shown: Snapshot) -> None:
        self.done = False
        self.error: BaseException | None = None
        self.shown = list(shown)
        self.sent: list[Command] = []
        self.started = False

    def start(self) -> None:
        self.started = True

    def take(self) -> Snapshot | None:
        return self.shown.pop(0) if self.shown else None

    def send(self, command: Command) -> None:
        self.sent.append(command)


Act = Callable[[Dashboard, "Pilot[None]"], Awaitable[None]]


def on_screen(shown: Snapshot, act: Act, size: tuple[int, int] = (80, 24), theme: str = "dark") -> Still:
    """Show a picture, let `act` press keys, return the pipeline."""
    pipeline = Still(shown)

    async def run() -> None:
        app = Dashboard(pipeline, theme=theme)
        async with app.run_test(size=size) as pilot:
            app.look()
            await act(app, pilot)

    asyncio.run(run())
    return pipeline


def svg(shown: Snapshot, size: tuple[int, int], theme: str = "dark", keys: tuple[str, ...] = ()) -> str:
    """Return the screen as SVG, without the names that differ from run to run."""
    out: list[str] = []

    async def act(app: Dashboard, pilot: "Pilot[None]") -> None:
        await pilot.press(*keys)
        await pilot.pause()
        out.append(app.export_screenshot(title="gcs_health"))

    on_screen(shown, act, size, theme)
    bare = re.sub(r"@font-face \{.*?\}\s*", "", out[0], flags=re.DOTALL)  # fonts from elsewhere
    return re.sub(r"terminal-\d+", "terminal", bare)


def golden(scene: str, frame: str, size: tuple[int, int]) -> Path:
    """Return where the golden picture of a case lies."""
    return GOLDEN / f"{scene}-{frame}-{size[0]}x{size[1]}.svg"


if __name__ == "__main__":
    GOLDEN.mkdir(exist_ok=True)
    for scene, frame, size in CASES:
        golden(scene, frame, size).write_text(svg(p.SCENES[scene](frame), size), encoding="utf-8")
    for page, key in PAGES.items():
        golden(page, "quad", SIZES[0]).write_text(svg(p.failing(), SIZES[0], keys=(key,)), encoding="utf-8")
    sys.stdout.write(f"{len(CASES) + len(PAGES)} pictures in {GOLDEN}: look at them\n")
