"""The terminal's bell, at each alert that is raised or grows worse."""

import sys
from typing import Self, TextIO

from gcs_health.errors import ConfigError
from gcs_health.record.events import AlertEvent, Event

RINGS = frozenset({"raised", "escalated"})


class Bell:
    """Rings the terminal that standard error or output is."""

    name = "bell"
    takes: frozenset[type] = frozenset({AlertEvent})
    estimate_period = 0.0

    def __init__(self, terminal: TextIO) -> None:
        self._terminal = terminal

    @classmethod
    def of(cls, rest: str) -> Self:
        """See `Sink.of`."""
        terminal = next((stream for stream in (sys.stderr, sys.stdout) if stream.isatty()), None)
        if rest or terminal is None:
            raise ConfigError(f"{rest!r} is too much" if rest else "there is no terminal to ring")
        return cls(terminal)

    def open(self) -> None:
        """See `Sink.open`."""

    def emit(self, event: Event) -> None:
        """See `Sink.emit`."""
        if isinstance(event, AlertEvent) and event.state in RINGS:
            self._terminal.write("\a")
            self._terminal.flush()

    def close(self) -> None:
        """See `Sink.close`."""
