"""What every sink promises, each against a real other end."""

import logging
import math
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from recorded import FLIGHT
from sink_ends import (
    ENDS,
    End,
    wait_until,
)
from sink_events import START_US, alert, estimate, verdict

from gcs_health.cli import main
from gcs_health.errors import ConfigError
from gcs_health.record.events import (
    EVENT_TYPES,
    AlertEvent,
    AutopilotEvent,
    ConditionEvent,
    Event,
    SummaryEvent,
    VehicleEvent,
)
from gcs_health.sinks import REGISTRY, parse_sink
from gcs_health.sinks.outlet import Outlet

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:apprise")  # its own, of Python's imghdr


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_health.sinks.outlet.FIRST_DELAY", 0.05)
    logging.getLogger("apprise").setLevel(logging.CRITICAL)


@pytest.fixture(params=sorted(ENDS))
def end(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[End]:
    made = ENDS[request.param](tmp_path)
    made.start()
    yield made
    made.leave()


def test_every_sink_is_tested() -> None:
    assert set(ENDS) == set(REGISTRY)


def test_what_is_emitted_has_arrived(end: End) -> None:
    sink = parse_sink(end.spec)
    sink.open()
    for number in (1, 2, 3):
        sink.emit(alert(number))
    assert wait_until(lambda: end.count() == 3)
    sink.close()


def test_it_can_be_opened_again_and_closed_unopened(end: End) -> None:
    sink = parse_sink(end.spec)
    sink.close()
    for number in (1, 2):
        sink.open()
        sink.emit(alert(number))
        assert wait_until(lambda seen=number: end.count() == seen)  # type: ignore[misc]
        sink.close()
        sink.close()


def test_it_takes_what_it_says(end: End) -> None:
    sink = parse_sink(end.spec)
    events: list[Event] = [
        VehicleEvent(1.0, START_US, "7.1", "seen", "vehicle 7.1 seen"),
        estimate(2.0),
        estimate(3.0, value=math.nan, status="unobservable"),
        verdict(),
        verdict(kind="propeller_lost"),
        AutopilotEvent(3.0, START_US, "7.1", "motor_failure", (3,), "Motor failure", "agrees"),
        alert(),
        alert(state="escalated", code="PROPELLER_LOST"),
        alert(state="cleared", code="PROPELLER_LOST"),
        ConditionEvent(9.0, START_US, "7.1", ()),
        SummaryEvent(9.0, START_US, "7.1", 9.0, {}, {}, {}, (), (), ()),
    ]
    assert {type(event) for event in events} == EVENT_TYPES
    assert AlertEvent in sink.takes
    sink.open()
    for event in events:
        if type(event) in sink.takes:
            sink.emit(event)
    sink.close()


def test_its_name_hides_the_password(end: End) -> None:
    assert "hunter2" not in parse_sink(end.spec).name
    assert parse_sink(end.spec).name


def test_an_absent_end_is_told_once_and_gets_every_alert_when_it_is_back(end: End) -> None:
    if not end.can_be_absent:
        pytest.skip("a terminal that was there at the start is there")
    threads = threading.active_count()
    sink = parse_sink(end.spec)  # what is absent now was there when the command line was read
    end.stop()
    outlet = Outlet(sink)
    for number in (1, 2, 3):
        outlet.take([alert(number)])
    assert wait_until(lambda: outlet._failing)
    end.start()
    assert wait_until(lambda: end.count() == 3)
    assert wait_until(lambda: not outlet._failing)
    outlet.close()
    assert len(outlet.notices) == 2, outlet.notices
    assert outlet.notices[0].endswith("; trying again")
    assert outlet.notices[1] == f"{sink.name}: works again"
    assert wait_until(lambda: threading.active_count() <= threads)


@pytest.mark.parametrize(
    ("spec", "complaint"),
    [
        ("pigeon:coop", "no such sink; there are bell, jsonl:FILE"),
        ("bell", "there is no terminal to ring"),
        ("jsonl:", "expected jsonl:FILE"),
        ("jsonl:/absent/folder/x", "cannot be a file"),
        ("command:", "no program that can be found"),
        ("command:/absent/program", "is no program that can be found"),
        ("command:'", "No closing quotation"),
        ("syslog:host:port", "no address"),
        ("mqtt:", "the broker's host is missing"),
        ("mqtt://host:port", "expected mqtt://[USER[:PASSWORD]@]HOST"),
        ("mqtt://host/a/#", "no part of a topic"),
        ("prometheus:", "no port"),
        ("prometheus:99999", "no port"),
        ("apprise:nonsense", "Apprise knows no such URL"),
        ("mavlink:udpin:0.0.0.0:14550", "cannot be sent to"),
        ("mavlink:nowhere", "not an endpoint"),
    ],
)
def test_a_wrong_spelling_is_told_in_one_line(
    spec: str, complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(FLIGHT), "--sink", spec]) == 2
    shown = capsys.readouterr()
    assert complaint in shown.err
    assert shown.err.count("\n") == 1
    assert shown.out == ""


@pytest.mark.parametrize(
    ("spec", "package", "extra"),
    [
        ("mqtt://host", "paho.mqtt.client", "mqtt"),
        ("prometheus:9100", "prometheus_client", "metrics"),
        ("apprise:json://host", "apprise", "notify"),
    ],
)
def test_a_missing_package_is_told_with_its_extra(
    spec: str, package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(ConfigError, match=rf"pip install 'gcs-health\[{extra}\]'"):
        parse_sink(spec)
