"""Alerts to desktop, mail or chat, by any URL that the library Apprise knows."""

from typing import Any, Self
from urllib.parse import urlsplit

from gcs_health.errors import ConfigError
from gcs_health.record.events import AlertEvent, Event
from gcs_health.sinks.contract import SinkError

CRITICAL, WARNING = 2, 4  # MAV_SEVERITY


class AppriseUrl:
    """Notifies `url`."""

    takes: frozenset[type] = frozenset({AlertEvent})
    estimate_period = 0.0

    def __init__(self, url: str) -> None:
        import apprise

        self.name = f"apprise:{urlsplit(url).scheme}"  # the rest holds tokens and passwords
        self._apprise: Any = apprise.Apprise()
        if not self._apprise.add(url):
            raise ConfigError(f"{urlsplit(url).scheme or url}: Apprise knows no such URL")

    @classmethod
    def of(cls, rest: str) -> Self:
        """See `Sink.of`."""
        try:
            return cls(rest)
        except ModuleNotFoundError:
            raise ConfigError("needs Apprise: pip install 'gcs-health[notify]'") from None

    def open(self) -> None:
        """See `Sink.open`."""

    def emit(self, event: Event) -> None:
        """See `Sink.emit`."""
        assert isinstance(event, AlertEvent)
        kind = "failure" if event.severity <= CRITICAL else "warning" if event.severity <= WARNING else "info"
        title = f"{event.code} {event.state}, vehicle {event.vehicle}"
        if not self._apprise.notify(title=title, body=event.text, notify_type=kind):
            raise SinkError("not delivered")

    def close(self) -> None:
        """See `Sink.close`."""
