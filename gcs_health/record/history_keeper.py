"""Events of a session into the history store, out of the way of the estimators: the store may be slow."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

from gcs_health.errors import ConfigError
from gcs_health.record.events import Event
from gcs_health.record.flight_results import FlightCollector, FlightRecord

if TYPE_CHECKING:
    from gcs_health.record.history import History

RETRY_US = 10_000_000


class StoreError(Exception):
    """The store cannot be reached or refuses, now; another time it may not."""


class HistoryKeeper:
    """Stores each flight when it ends; what the store refuses is tried again.

    Parameters
    ----------
    opens : opens the store; called in a thread, again after it failed.

    Attributes
    ----------
    notices : what is to be told; whoever tells it empties the list.
    """

    def __init__(self, opens: "Callable[[], History]") -> None:
        self.notices: list[str] = []
        self._opens = opens
        self._store: History | None = None
        self._collector = FlightCollector()
        self._waiting: dict[tuple[str, str], FlightRecord] = {}
        self._worker = ThreadPoolExecutor(1, "history")
        self._work: Future[tuple[list[FlightRecord], str]] | None = None
        self._failed = ""
        self._tried_us = 0

    def take(self, events: Sequence[Event]) -> None:
        """Collect; hand on what has ended."""
        for record in self._collector.feed(events):
            self._waiting[record.vehicle_identity, record.identity] = record
        if self._waiting and not self._failed:
            self._start()

    def poll(self, now_us: int) -> None:
        """Hear how storing went, and try again what failed."""
        self._hear(wait=False)
        if self._failed and not 0 <= now_us - self._tried_us < RETRY_US:
            self._tried_us = now_us
            self._start()

    def close(self) -> None:
        """Store the rest, or tell what could not be."""
        self._hear(wait=True)
        self._start()
        self._hear(wait=True)
        if self._waiting:
            self.notices.append(f"{len(self._waiting)} flights are not in the history")
        self._worker.submit(self._let_go)
        self._worker.shutdown(wait=True)

    def _start(self) -> None:
        if self._work is None and self._waiting:
            self._work = self._worker.submit(self._store_all, list(self._waiting.values()))

    def _hear(self, *, wait: bool) -> None:
        if self._work is None or not (wait or self._work.done()):
            return
        (stored, failed), self._work = self._work.result(), None
        for record in stored:
            key = (record.vehicle_identity, record.identity)
            if self._waiting.get(key) is record:  # else more of this flight has come meanwhile
                del self._waiting[key]
        if failed and not self._failed:
            self.notices.append(f"history: {failed}; trying again")
        elif self._failed and not failed:
            self.notices.append("history: stored again")
        self._failed = failed
        if self._waiting and not failed:
            self._start()

    def _store_all(self, records: list[FlightRecord]) -> tuple[list[FlightRecord], str]:
        """Store records; return those stored, and why the next was not, empty if all were."""
        stored: list[FlightRecord] = []
        try:
            if self._store is None:
                self._store = self._opens()
            for record in records:
                self._store.store(record)
                stored.append(record)
        except (StoreError, ConfigError) as error:
            return stored, str(error)
        return stored, ""

    def _let_go(self) -> None:
        if self._store is not None:
            self._store.close()
