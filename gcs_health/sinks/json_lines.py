"""Events as JSON lines, appended to a file; a full disk leaves no torn line behind."""

from io import FileIO
from pathlib import Path
from typing import Self

from gcs_health.errors import ConfigError
from gcs_health.record.events import EVENT_TYPES, Event, to_json


class JsonLines:
    """Appends to `path`; the first line of each session names the schema."""

    takes: frozenset[type] = EVENT_TYPES
    estimate_period = 0.0

    def __init__(self, path: Path) -> None:
        self.name = f"jsonl:{path}"
        self._path = path
        self._file: FileIO | None = None
        self._first = True
        self._rest = b""

    @classmethod
    def of(cls, rest: str) -> Self:
        """See `Sink.of`."""
        if not rest or Path(rest).is_dir() or not Path(rest).parent.is_dir():
            raise ConfigError(f"{rest!r} cannot be a file")
        return cls(Path(rest))

    def open(self) -> None:
        """See `Sink.open`."""
        self._file = self._path.open("ab", buffering=0)

    def emit(self, event: Event) -> None:
        """See `Sink.emit`: after a failure it goes on at the byte where the line was cut."""
        assert self._file is not None
        if not self._rest:
            self._rest = f"{to_json(event, self._first)}\n".encode()
        while self._rest:
            self._rest = self._rest[self._file.write(self._rest) :]
        self._first = False

    def close(self) -> None:
        """See `Sink.close`."""
        if self._file is not None:
            self._file.close()
            self._file = None
