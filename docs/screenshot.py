"""Make the README's picture: the demo's flight on the dashboard, a moment after its propeller is lost.

python docs/screenshot.py
"""

import asyncio
import re
import sys
from pathlib import Path

from gcs_health.dashboard.app import Dashboard
from gcs_health.dashboard.commands import Command
from gcs_health.dashboard.player import Reading
from gcs_health.dashboard.snapshot import Snapshot
from gcs_health.dashboard.tape import Tape
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.scenario import load_scenario

PICTURE = Path(__file__).parent / "dashboard.svg"
SIZE = (96, 27)
AFTER_US = 500_000  # µs behind the alert


class Still:
    """A pipeline of one picture."""

    done, error = False, None

    def __init__(self, shown: Snapshot) -> None:
        self._shown: list[Snapshot] = [shown]

    def start(self) -> None:
        """See `app.Pipeline`."""

    def take(self) -> Snapshot | None:
        """Return the picture, once."""
        return self._shown.pop() if self._shown else None

    def send(self, command: Command) -> None:
        """See `app.Pipeline`."""


def flown() -> Snapshot:
    """Fly the demo; return what the dashboard shows a moment after its alert."""
    flight = Flight(load_scenario("demo", []))
    tape = Tape(b"".join(record(stamp, frame) for stamp, frame in flight.run()), stamped=True)
    reading = Reading.begin(
        tape, lambda tap, raw: Monitor(MonitorConfig(stamped=True, tap=tap, raw_tap=raw)), "demo"
    )
    us = tape.start_us
    while not reading.over:
        us += 100_000
        said = reading.read(us, 1 << 30)
        if any(isinstance(event, AlertEvent) for event in said):
            reading.read_until(us + AFTER_US)
            break
    return reading.snapshot(us + AFTER_US)


async def drawn(shown: Snapshot) -> str:
    """Return the screen as SVG; without the fonts that it would fetch from elsewhere."""
    app = Dashboard(Still(shown))
    async with app.run_test(size=SIZE):
        app.look()
        svg = app.export_screenshot(title="gcs-health demo")
    return re.sub(r"terminal-\d+", "terminal", re.sub(r"@font-face \{.*?\}\s*", "", svg, flags=re.DOTALL))


if __name__ == "__main__":
    PICTURE.write_text(asyncio.run(drawn(flown())), encoding="utf-8")
    sys.stdout.write(f"{PICTURE}\n")
