"""What every sink promises, each against a real other end; then what each delivers."""

import json
import logging
import math
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from recorded import FLIGHT
from sink_ends import (
    ENDS,
    AppriseEnd,
    CommandEnd,
    End,
    JsonLinesEnd,
    MavlinkEnd,
    MqttEnd,
    PrometheusEnd,
    SyslogEnd,
    wait_until,
)

from gcs_health.cli import main
from gcs_health.errors import ConfigError
from gcs_health.record.events import (
    EVENT_TYPES,
    AlertEvent,
    AutopilotEvent,
    EstimateEvent,
    Event,
    SummaryEvent,
    VehicleEvent,
    VerdictEvent,
)
from gcs_health.sinks import REGISTRY, parse_sink
from gcs_health.sinks.contract import Rejected, SinkError
from gcs_health.sinks.outlet import QUEUE, Outlet

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:apprise")  # its own, of Python's imghdr

START_US = 1_700_000_000_000_000


def alert(number: int = 1, state: str = "raised", code: str = "ROTOR_FAILED", t: float = 17.04) -> AlertEvent:
    text = "motor 3 (front left, CW): rotor lost its thrust, 99 % sure"
    stamp = START_US + int(t * 1e6)
    evidence = {"log_likelihood_ratio": 9.5}
    return AlertEvent(t, stamp, "7.1", f"7.1-{number}", code, 2, 3, state, 1, 0.99, text, evidence)


def estimate(t: float, motor: int = 3, value: float = 0.25, status: str = "valid") -> EstimateEvent:
    return EstimateEvent(
        t, START_US + int(t * 1e6), "7.1", "effectiveness", motor - 1, motor, "effectiveness", value, 0.05,
        0.9, status, (), math.nan,
    )  # fmt: skip


def verdict(t: float = 17.0, kind: str = "healthy", known: bool = True) -> VerdictEvent:
    return VerdictEvent(t, START_US + int(t * 1e6), "7.1", 2, 3, kind, 0.75, known, t, ("effectiveness",))


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


# -- what each delivers ----------------------------------------------------------------------------------


def test_json_lines_hold_every_event_and_go_on_after_a_restart(tmp_path: Path) -> None:
    end = JsonLinesEnd(tmp_path)
    for _ in range(2):
        assert main(["replay", str(FLIGHT), "--sink", end.spec, "--jsonl", str(tmp_path / "all.jsonl")]) == 0
    whole = [json.loads(line) for line in (tmp_path / "all.jsonl").read_text().splitlines()]
    assert end.lines() == whole + whole


def test_json_lines_are_never_torn_by_a_full_disk(tmp_path: Path) -> None:
    import resource

    end = JsonLinesEnd(tmp_path)
    sink = parse_sink(end.spec)
    sink.open()
    sink.emit(alert(1))
    size = (tmp_path / "out" / "alerts.jsonl").stat().st_size
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 20, before[1]))
    try:
        for _ in range(2):
            with pytest.raises(OSError, match="File too large"):
                sink.emit(alert(2))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    sink.close()
    sink.open()
    sink.emit(alert(2))
    sink.close()
    assert [line["id"] for line in end.lines()] == ["7.1-1", "7.1-2"]


def test_a_command_gets_the_alert_on_its_input_and_no_shell_sees_it(tmp_path: Path) -> None:
    end = CommandEnd(tmp_path)
    sink = parse_sink(end.spec)
    sink.emit(alert())
    (told,) = map(json.loads, end.out.read_text().splitlines())
    assert (told["schema"], told["code"], told["motor"]) == ("gcs_health.events/1", "ROTOR_FAILED", 3)
    assert (tmp_path / "arguments").read_text() == f"two words\n$(touch {tmp_path}/shell)\n"
    assert not (tmp_path / "shell").exists()


def test_a_command_that_fails_is_told_and_not_run_again(tmp_path: Path) -> None:
    sink = parse_sink("command:sh -c 'cat > /dev/null; echo no luck >&2; exit 4'")
    with pytest.raises(Rejected, match="ended with 4: no luck"):
        sink.emit(alert())
    outlet = Outlet(sink)
    outlet.take([alert(1), alert(2)])
    outlet.close()
    assert outlet.notices == ["command:sh: ended with 4: no luck"] * 2


def test_a_command_that_hangs_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_health.sinks.command.TIMEOUT", 0.1)
    with pytest.raises(SinkError, match="took longer"):
        parse_sink("command:sleep 60").emit(alert())


def test_syslog_gets_the_severity_as_it_is(tmp_path: Path) -> None:
    end = SyslogEnd(tmp_path)
    end.start()
    sink = parse_sink(end.spec)
    sink.open()
    sink.emit(alert()._replace(severity=4))
    sink.close()
    end.count()
    (said,) = end.said
    priority, text = said.decode().split(">", 1)
    assert int(priority[1:]) & 7 == 4
    assert text == f"gcs-health: vehicle 7.1 ROTOR_FAILED raised: {alert().text}"
    end.stop()


def test_syslog_by_udp() -> None:
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as daemon:
        daemon.bind(("127.0.0.1", 0))
        daemon.settimeout(5)
        sink = parse_sink(f"syslog:127.0.0.1:{daemon.getsockname()[1]}")
        sink.open()
        sink.emit(alert())
        assert b"ROTOR_FAILED" in daemon.recv(4096)
        sink.close()


def test_the_broker_s_password_is_hidden_too() -> None:
    assert parse_sink("mqtt://me:hunter2@host:1884/a/b").name == "mqtt://host:1884/a/b"


def test_mqtt_topics_and_the_broker_s_word_when_we_are_gone(tmp_path: Path) -> None:
    end = MqttEnd(tmp_path)
    end.start()
    sink = parse_sink(end.spec)
    sink.open()
    sink.emit(alert())
    sink.emit(estimate(1.0))
    sink.close()
    assert wait_until(lambda: len(end.messages) == 4)
    assert [topic for topic, _ in end.messages] == [
        "fleet/seven/status",
        "fleet/seven/7.1/alert",
        "fleet/seven/7.1/motor/3/effectiveness/effectiveness",
        "fleet/seven/status",
    ]
    assert [end.messages[k][1] for k in (0, 3)] == [b"online", b"offline"]
    assert json.loads(end.messages[1][1])["code"] == "ROTOR_FAILED"
    sink.open()
    sink._client._sock_close()  # type: ignore[attr-defined]  # as when the computer loses power
    assert wait_until(lambda: end.messages[-1][1] == b"offline" and len(end.messages) >= 6)
    sink.close()
    end.stop()


def test_a_scrape_shows_the_rotors_and_open_alerts(tmp_path: Path) -> None:
    end = PrometheusEnd(tmp_path)
    sink = parse_sink(end.spec)
    sink.open()
    sink.emit(estimate(1.0))
    sink.emit(estimate(1.0, motor=1, value=1.0, status="unobservable"))
    sink.emit(alert())
    for said in (verdict(), verdict(kind="propeller_lost")):
        sink.emit(said)
    sink.emit(alert(state="escalated", code="PROPELLER_LOST", t=18.0))
    shown = end.scrape()
    assert shown["gcs_health_rotor_verdict_probability", "7.1", "3", "propeller_lost"] == 0.75
    assert ("gcs_health_rotor_verdict_probability", "7.1", "3", "healthy") not in shown
    rotor = ("7.1", "3", "effectiveness", "effectiveness")
    assert shown["gcs_health_rotor_value", *rotor] == 0.25
    assert shown["gcs_health_rotor_std", *rotor] == 0.05
    assert shown["gcs_health_rotor_failure_probability", *rotor] == 0.9
    unknown = ("7.1", "1", "effectiveness", "effectiveness")
    assert math.isnan(shown["gcs_health_rotor_value", *unknown])  # not known is never shown as healthy
    assert shown["gcs_health_rotor_valid", *unknown] == 0.0
    assert shown["gcs_health_alerts_total", "7.1", "3", "ROTOR_FAILED"] == 1.0
    assert shown["gcs_health_alert_active", "7.1", "3", "ROTOR_FAILED"] == 0.0
    assert shown["gcs_health_alert_active", "7.1", "3", "PROPELLER_LOST"] == 1.0
    assert shown["gcs_health_vehicle_last_seconds", "7.1"] == START_US * 1e-6 + 18.0
    sink.emit(alert(state="cleared", code="PROPELLER_LOST", t=19.0))
    assert end.scrape()["gcs_health_alert_active", "7.1", "3", "PROPELLER_LOST"] == 0.0
    sink.close()


def test_apprise_gets_title_and_text(tmp_path: Path) -> None:
    end = AppriseEnd(tmp_path)
    end.start()
    sink = parse_sink(end.spec)
    sink.emit(alert())
    end.stop()
    (post,) = end.posts
    assert (post["title"], post["message"], post["type"]) == (
        "ROTOR_FAILED raised, vehicle 7.1",
        alert().text,
        "failure",
    )


def test_a_second_mavlink_client_reads_it_in_words_and_in_figures(tmp_path: Path) -> None:
    import socket

    from pymavlink.dialects.v20 import common

    from gcs_health.mavlink.generated import gcs_health as ours

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(5)
        sink = parse_sink(f"mavlink:udpout://127.0.0.1:{station.getsockname()[1]}")
        sink.open()
        sink.emit(estimate(17.0))
        sink.emit(alert())
        sink.emit(verdict(kind="propeller_lost"))
        heard = [station.recv(2048) for _ in range(6)]
        sink.close()
    stock, own = common.MAVLink(None), ours.MAVLink(None)
    beat, first, second = (stock.parse_char(heard[k]) for k in (0, 3, 4))
    health, told, believed = (own.parse_char(heard[k]) for k in (1, 2, 5))
    assert (beat.get_type(), beat.get_srcSystem(), beat.get_srcComponent()) == ("HEARTBEAT", 7, 191)
    assert (health.get_type(), health.motor, health.esc_index, health.time_usec) == (
        "ROTOR_HEALTH",
        3,
        2,
        17_000_000,
    )
    assert (health.value, health.quantity, health.status, health.estimator) == (0.25, 1, 3, "effectiveness")
    assert ours.enums["ROTOR_ESTIMATE_STATUS"][health.status].name == "ROTOR_ESTIMATE_STATUS_VALID"
    assert math.isnan(health.detectable)
    assert (told.code, told.motor, told.state, told.severity, told.id) == ("ROTOR_FAILED", 3, 1, 1, 1)
    assert (believed.kind, believed.motor, believed.known, believed.probability) == (
        "propeller_lost",
        3,
        1,
        0.75,
    )
    assert told.probability == pytest.approx(0.99)
    assert (first.severity, first.id, first.chunk_seq, second.chunk_seq) == (1, 1, 0, 1)
    assert first.text + second.text == f"ROTOR_FAILED raised: {alert().text}"


def test_a_text_that_ends_with_its_chunk_is_closed_by_an_empty_one() -> None:
    from gcs_health.mavlink.dialect import default_dialect
    from gcs_health.mavlink.encoder import Encoder
    from gcs_health.sinks.mavlink_out import MavlinkOut

    sink = MavlinkOut.of("udpout://127.0.0.1:14550")
    head = len("ROTOR_FAILED raised: ")
    for length, chunks in ((49 - head, 1), (50 - head, 2), (51 - head, 2), (100 - head, 3)):
        event = alert()._replace(text="x" * length)
        assert len(sink._status_texts(Encoder(default_dialect()), event)) == chunks


def test_mavlink_goes_out_only_where_asked(tmp_path: Path) -> None:
    end = MavlinkEnd(tmp_path)
    end.start()
    assert main(["replay", str(FLIGHT)]) == 0
    assert end.count() == 0
    assert main(["replay", str(FLIGHT), "--sink", end.spec]) == 0
    assert wait_until(lambda: end.count() == 2)
    assert end.texts[0].text.startswith("ROTOR_FAILED raised: motor 3")
    assert any(said.text.startswith("PROPELLER_LOST escalated: motor 3") for said in end.texts)
    end.stop()


# -- the outlet ------------------------------------------------------------------------------------------


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
