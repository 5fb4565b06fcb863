"""A command of the user's, run for each step of an alert with the alert as JSON on its standard input."""

import shlex
import shutil
import subprocess
from typing import Self

from gcs_health.errors import ConfigError
from gcs_health.record.events import AlertEvent, Event, to_json
from gcs_health.sinks.contract import Rejected, SinkError

TIMEOUT = 30.0  # s


class Command:
    """Runs `argv`; never through a shell, and nothing of the alert ever becomes an argument."""

    takes: frozenset[type] = frozenset({AlertEvent})
    estimate_period = 0.0

    def __init__(self, argv: list[str]) -> None:
        self.name = f"command:{argv[0]}"
        self._argv = argv

    @classmethod
    def of(cls, rest: str) -> Self:
        """See `Sink.of`: words as a shell would part them."""
        try:
            argv = shlex.split(rest)
        except ValueError as error:
            raise ConfigError(f"{rest}: {error}") from None
        if not argv or shutil.which(argv[0]) is None:
            raise ConfigError(f"{argv[0] if argv else 'nothing'} is no program that can be found")
        return cls(argv)

    def open(self) -> None:
        """See `Sink.open`."""

    def emit(self, event: Event) -> None:
        """See `Sink.emit`: a command that ran and failed has had its say, one that hangs has not."""
        try:
            done = subprocess.run(
                self._argv,
                input=to_json(event, first=True).encode() + b"\n",
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                timeout=TIMEOUT,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise SinkError(f"took longer than {TIMEOUT:.0f} s") from None
        if done.returncode:
            said = done.stderr.decode(errors="replace").strip().splitlines()
            raise Rejected(f"ended with {done.returncode}{': ' + said[-1] if said else ''}")

    def close(self) -> None:
        """See `Sink.close`."""
