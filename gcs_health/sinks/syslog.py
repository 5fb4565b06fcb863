"""Alerts into the system's log, or another machine's by UDP. MAV_SEVERITY is syslog's own scale."""

import logging
from logging.handlers import SysLogHandler
from typing import Self

from gcs_health.errors import ConfigError
from gcs_health.record.events import AlertEvent, Event

LOCAL = "/dev/log"
PORT = 514
PRIORITY = ("emerg", "alert", "crit", "err", "warning", "notice", "info", "debug")  # RFC 5424, 6.2.1


class _Handler(SysLogHandler):
    ident = "gcs-health: "
    append_nul = False

    def mapPriority(self, levelName: str) -> str:  # noqa: N802 (the library's name)
        return levelName

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        raise


class Syslog:
    """Sends to `address`: a socket's path, or (host, port)."""

    takes: frozenset[type] = frozenset({AlertEvent})
    estimate_period = 0.0

    def __init__(self, address: str | tuple[str, int]) -> None:
        self.name = "syslog:" + (address if isinstance(address, str) else f"{address[0]}:{address[1]}")
        self._address = address
        self._handler: _Handler | None = None

    @classmethod
    def of(cls, rest: str) -> Self:
        """See `Sink.of`."""
        if not rest or rest.startswith("/"):
            return cls(rest or LOCAL)
        host, _, port = rest.rpartition(":") if ":" in rest else (rest, "", str(PORT))
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise ConfigError(f"{rest}: no address")
        return cls((host, int(port)))

    def open(self) -> None:
        """See `Sink.open`."""
        self._handler = _Handler(self._address)

    def emit(self, event: Event) -> None:
        """See `Sink.emit`."""
        assert self._handler is not None
        assert isinstance(event, AlertEvent)
        text = f"vehicle {event.vehicle} {event.code} {event.state}: {event.text}"
        self._handler.emit(logging.makeLogRecord({"msg": text, "levelname": PRIORITY[event.severity]}))

    def close(self) -> None:
        """See `Sink.close`."""
        if self._handler is not None:
            self._handler.close()
            self._handler = None
