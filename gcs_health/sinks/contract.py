"""What every sink promises, and the two ways in which it may fail."""

from typing import Protocol, Self

from gcs_health.record.events import Event


class SinkError(Exception):
    """It cannot be delivered now: the sink is closed, opened and given the same event again, later."""


class Rejected(SinkError):  # noqa: N818 (the delivery failed, not the sink)
    """It was delivered and refused: told, not tried again."""


class Sink(Protocol):
    """Where events go. It lives in a thread of its own (`outlet.Outlet`) and may block there.

    Attributes
    ----------
    name : for messages; no password in it.
    takes : types of event that it is given.
    estimate_period : at most one estimate of a rotor and quantity in so many seconds of vehicle time.

    It may raise anything: whatever it is, it is told once, and tried again with growing delays.
    """

    name: str
    takes: frozenset[type]
    estimate_period: float

    @classmethod
    def of(cls, rest: str) -> Self:
        """Make one of what follows its scheme and colon in `--sink`; nothing is opened yet.

        Raises
        ------
        ConfigError : that is not how this sink is spelled, or a package is missing.
        """
        ...

    def open(self) -> None:
        """Get ready; called before the first event, and after a failure."""
        ...

    def emit(self, event: Event) -> None:
        """Deliver one event; returning means that it is delivered."""
        ...

    def close(self) -> None:
        """Let go; also after a failed `open`."""
        ...
