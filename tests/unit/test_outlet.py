"""Between the monitor and a sink: what is thinned, what waits, what is told of failures."""

import logging
import threading

import pytest
from sink_ends import (
    wait_until,
)
from sink_events import alert, estimate

from gcs_health.record.events import (
    AlertEvent,
    EstimateEvent,
    Event,
)
from gcs_health.sinks.outlet import QUEUE, Outlet


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_health.sinks.outlet.FIRST_DELAY", 0.05)
    logging.getLogger("apprise").setLevel(logging.CRITICAL)


class Odd:
    """A sink that does as it is told."""

    name = "odd"
    takes: frozenset[type] = frozenset({AlertEvent, EstimateEvent})
    estimate_period = 1.0

    def __init__(self) -> None:
        self.got: list[Event] = []
        self.fails = False
        self.held = threading.Event()
        self.held.set()

    def open(self) -> None:
        """See `Sink.open`."""

    def emit(self, event: Event) -> None:
        self.held.wait(10)
        if self.fails:
            raise ZeroDivisionError("a bug of the sink's")
        self.got.append(event)

    def close(self) -> None:
        """See `Sink.close`."""


def test_estimates_are_thinned_and_alerts_never() -> None:
    sink = Odd()
    outlet = Outlet(sink)  # type: ignore[arg-type]
    for k in range(30):
        outlet.take([estimate(0.1 * k, motor) for motor in (1, 2)] + [alert(k)])
    outlet.close()
    assert sum(isinstance(event, AlertEvent) for event in sink.got) == 30
    assert [e.t for e in sink.got if isinstance(e, EstimateEvent) and e.motor == 1] == [0.0, 1.0, 2.0]


def test_a_sink_that_hangs_blocks_nobody_and_loses_estimates_before_alerts() -> None:
    sink = Odd()
    sink.held.clear()
    outlet = Outlet(sink)  # type: ignore[arg-type]
    for k in range(QUEUE):
        outlet.take([estimate(float(k))])
    outlet.take([alert(number) for number in range(600)])
    sink.held.set()
    outlet.close()
    assert [e.id for e in sink.got if isinstance(e, AlertEvent)] == [f"7.1-{k}" for k in range(600)]
    assert len(sink.got) in (QUEUE, QUEUE + 1)  # one may have been under way
    assert outlet.notices[-1] == f"odd: {QUEUE + 600 - len(sink.got)} events were not delivered"


def test_a_bug_in_a_sink_is_a_failure_like_any_other() -> None:
    sink = Odd()
    sink.fails = True
    outlet = Outlet(sink)  # type: ignore[arg-type]
    outlet.take([alert(1), alert(2)])
    assert wait_until(lambda: outlet._failing)
    outlet.close()
    assert outlet.notices == ["odd: a bug of the sink's; trying again", "odd: 2 events were not delivered"]


def test_a_replay_waits_for_a_slow_sink_and_not_for_one_that_is_gone() -> None:
    sink = Odd()
    outlet = Outlet(sink, patient=True)  # type: ignore[arg-type]
    outlet.take([alert(k) for k in range(3 * QUEUE)])
    outlet.close()
    assert len(sink.got) == 3 * QUEUE
    gone = Odd()
    gone.fails = True
    outlet = Outlet(gone, patient=True)  # type: ignore[arg-type]
    outlet.take([alert(k) for k in range(2 * QUEUE)])
    outlet.close()
    assert not gone.got
