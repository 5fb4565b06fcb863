"""A sink's thread: a bounded queue before it, growing delays behind its failures, each failure told once.

Nothing a sink does or fails to do reaches the estimators: they put events into the queue and go on.
"""

import threading
from collections import deque
from collections.abc import Sequence
from queue import SimpleQueue

from gcs_health.record.events import EstimateEvent, Event
from gcs_health.sinks.contract import Rejected, Sink

QUEUE = 1000  # events
FIRST_DELAY, LONGEST_DELAY = 0.5, 60.0  # s between attempts, doubled each time
CLOSING = 5.0  # s that the end of the session waits for a sink


class Outlet:
    """Runs one sink.

    Parameters
    ----------
    patient : wait for room in the queue while the sink works, as a replay does that outruns it; else
        what does not fit is left out, estimates first.

    Attributes
    ----------
    notices : what is to be told; whoever tells it empties the list.
    """

    def __init__(self, sink: Sink, *, patient: bool = False) -> None:
        self.notices: list[str] = []
        self._sink = sink
        self._patient = patient
        self._queue: deque[Event] = deque()
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._failing = False
        self._left_out = 0
        self._said: SimpleQueue[str] = SimpleQueue()
        self._last: dict[tuple[str, int, str, str], float] = {}
        self._thread = threading.Thread(target=self._run, name=sink.name, daemon=True)
        self._thread.start()

    def take(self, events: Sequence[Event]) -> None:
        """Queue the events that this sink takes."""
        wanted = [event for event in events if type(event) in self._sink.takes and self._due(event)]
        if not wanted:
            return
        with self._changed:
            for event in wanted:
                if self._patient:
                    self._changed.wait_for(lambda: len(self._queue) < QUEUE or self._failing)
                self._put(event)
                self._changed.notify_all()  # each time: the thread must not sleep while we wait for room

    def poll(self, now_us: int) -> None:
        """Take over what the thread has to tell."""
        while not self._said.empty():
            self.notices.append(self._said.get())

    def close(self) -> None:
        """Deliver what is queued, at the first attempt, within `CLOSING` seconds; tell what was not."""
        with self._changed:
            self._closing.set()
            self._changed.notify_all()
        self._thread.join(CLOSING)
        self.poll(0)
        missing = len(self._queue) + self._thread.is_alive()
        if missing or self._left_out:
            self.notices.append(f"{self._sink.name}: {missing + self._left_out} events were not delivered")

    def _due(self, event: Event) -> bool:
        if not isinstance(event, EstimateEvent):
            return True
        key = (event.vehicle, event.motor, event.estimator, event.quantity)
        before = self._last.get(key)
        if before is not None and 0.0 <= event.t - before < self._sink.estimate_period:
            return False
        self._last[key] = event.t
        return True

    def _put(self, event: Event) -> None:
        if len(self._queue) >= QUEUE:
            self._left_out += 1
            if isinstance(event, EstimateEvent):
                return
            estimate = next((k for k, e in enumerate(self._queue) if isinstance(e, EstimateEvent)), 0)
            del self._queue[estimate]
        self._queue.append(event)

    def _run(self) -> None:
        delay, opened = FIRST_DELAY, False
        event: Event | None = None
        while True:
            try:
                if not opened:
                    self._sink.open()
                    opened = True
                if event is not None:
                    self._deliver(event)
            except Exception as error:  # whatever a library raises must stay here
                self._close_sink()
                opened = False
                self._fails(error)
                if self._closing.is_set():
                    break
                self._closing.wait(delay)  # the end of the session gives it one last attempt at once
                delay = min(2.0 * delay, LONGEST_DELAY)
                continue
            if self._failing:
                self._said.put(f"{self._sink.name}: works again")
            self._failing, delay = False, FIRST_DELAY
            event = self._next()
            if event is None:
                break
        if event is not None:
            self._left_out += 1
        if opened:
            self._close_sink()

    def _deliver(self, event: Event) -> None:
        try:
            self._sink.emit(event)
        except Rejected as error:
            self._said.put(f"{self._sink.name}: {error}")

    def _next(self) -> Event | None:
        """Wait for an event; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closing.is_set())
            event = self._queue.popleft() if self._queue else None
            self._changed.notify_all()
            return event

    def _fails(self, error: Exception) -> None:
        if not self._failing:
            why = " ".join(str(error).split()) or type(error).__name__
            self._said.put(f"{self._sink.name}: {why}; trying again")
        with self._changed:
            self._failing = True
            self._changed.notify_all()

    def _close_sink(self) -> None:
        try:
            self._sink.close()
        except Exception as error:
            self._fails(error)
