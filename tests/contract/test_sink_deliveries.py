"""What each sink delivers at a real other end."""

import json
import logging
import math
from pathlib import Path

import pytest
from recorded import FLIGHT
from sink_ends import (
    AppriseEnd,
    CommandEnd,
    JsonLinesEnd,
    MavlinkEnd,
    MqttEnd,
    PrometheusEnd,
    SyslogEnd,
    wait_until,
)
from sink_events import START_US, alert, estimate, verdict

from gcs_health.cli import main
from gcs_health.sinks import parse_sink
from gcs_health.sinks.contract import Rejected, SinkError
from gcs_health.sinks.outlet import Outlet

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:apprise")  # its own, of Python's imghdr


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs_health.sinks.outlet.FIRST_DELAY", 0.05)
    logging.getLogger("apprise").setLevel(logging.CRITICAL)


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
