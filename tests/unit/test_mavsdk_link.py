"""The way through MAVSDK: fields as its JSON has them, and a real MAVSDK on a recorded flight."""

import json
import math
import random
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as stock

from gcs_health.errors import EndpointError
from gcs_health.mavlink.dialect import Message, default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.generated import esc, gcs_health
from gcs_health.mavlink.messages import MessageDecoder
from gcs_health.mavlink.spellings import parse_endpoint
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, Event

try:
    import mavsdk  # noqa: F401
except (ImportError, OSError) as error:
    pytest.skip(f"libcmavsdk cannot be loaded here: {error}", allow_module_level=True)

from gcs_health.mavlink.mavsdk_link import MavsdkLinks

DIALECT = default_dialect()
FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"
INTEGERS = {"uint8_t": 8, "int8_t": 8, "uint16_t": 16, "int16_t": 16, "uint32_t": 32, "int32_t": 32}
INTEGERS |= {"uint64_t": 64, "int64_t": 64}
ALERT_TIME = 0.005  # s
NOT_OF_THE_FLIGHT = (0, 77)  # heartbeats before and after it, acknowledgements of what MAVSDK asks


@pytest.fixture(scope="module")
def closed() -> Iterator[MavsdkLinks]:
    """Return links to nowhere, for what needs no vehicle."""
    with MavsdkLinks([]) as links:
        yield links


def single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def any_value(kind: str, rng: random.Random) -> Any:
    if kind == "char":
        return rng.randrange(32, 127)
    if kind == "float":
        return rng.choice([math.nan, 0.0, single(rng.gauss(0.0, 100.0)), single(3.4e38), single(1e-42)])
    if kind == "double":
        return rng.choice([math.nan, rng.gauss(0.0, 1.0)])
    bits, signed = INTEGERS[kind], kind[0] != "u"
    least, most = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    return rng.choice([least, most, rng.randint(least, most)])


def any_fields(message: Message, rng: random.Random) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, kind, length in message.fields:
        values = [any_value(kind, rng) for _ in range(length or 1)]
        out[name] = bytes(values) if kind == "char" else values if length else values[0]
    return out


def as_mavsdk_says(message: Message, fields: dict[str, Any], nan: str | None) -> str:
    """Fields as MAVSDK's JSON has them: text for characters, numbers where they are many."""

    def plain(value: Any) -> Any:
        if isinstance(value, list):
            return [plain(item) for item in value]
        if isinstance(value, bytes):
            return list(value) if len(value) > 100 else value.decode()
        return nan if isinstance(value, float) and math.isnan(value) else value

    said = {name: plain(value) for name, value in fields.items()}
    return json.dumps({"message_id": message.id, "message_name": message.name, **said})


def by_pymavlink(message: Message, fields: dict[str, Any]) -> bytes:
    source = next(each for each in (esc, gcs_health, stock) if message.id in each.mavlink_map)
    cls = source.mavlink_map[message.id]
    packed = cls(*(fields[name] for name in cls.fieldnames))
    return bytes(packed.pack(source.MAVLink(None, srcSystem=1, srcComponent=1)))


@pytest.mark.parametrize("nan", [None, "NaN"])
def test_every_message_of_the_dialect_gives_the_frame_and_samples_of_pymavlink(
    closed: MavsdkLinks, nan: str | None
) -> None:
    rng = random.Random(7)
    decoder = MessageDecoder(DIALECT)
    for message in DIALECT.messages.values():
        fields = any_fields(message, rng)
        if message.name == "PARAM_VALUE":
            fields["param_value"] = 1e-42  # an integer's bits; NaN has a test of its own
        got = closed.frame(message.name, 1, 1, as_mavsdk_says(message, fields, nan))
        expected = by_pymavlink(message, fields)
        assert got[10:-2] == expected[10:-2], message.name
        # frame by frame through our own decoder: the CRC holds, and the samples are the same
        seen = [FrameDecoder(DIALECT, stamped=False).feed(frame, 5) for frame in (got, expected)]
        assert [len(batch) for batch in seen] == [1, 1], message.name
        assert repr(decoder.samples(seen[0])) == repr(decoder.samples(seen[1]))


def test_each_sender_has_a_sequence_of_its_own(closed: MavsdkLinks) -> None:
    told = json.dumps({"type": 2})
    first, other, second = (closed.frame("HEARTBEAT", system, 7, told)[4] for system in (90, 91, 90))
    assert second == first + 1
    assert other == first == 0


@pytest.mark.parametrize(
    "told",
    [
        "",
        "null",
        "[1]",
        '{"rpm": 5}',
        '{"rpm": [1, 2, 3, 99999999999]}',
        '{"rpm": [1, null, 3, 4]}',
        '{"index": [1]}',
        '{"index": "one"}',
        '{"index": -1}',
        '{"voltage": [1e300, 0, 0, 0]}',
    ],
)
def test_values_that_do_not_fit_are_skipped_and_counted(closed: MavsdkLinks, told: str) -> None:
    before = closed.unusable.get("ESC_STATUS", 0)
    assert closed.frame("ESC_STATUS", 1, 1, told) == b""
    assert closed.unusable["ESC_STATUS"] == before + 1


def test_an_integer_parameter_that_mavsdk_took_for_nan_is_not_made_into_another(closed: MavsdkLinks) -> None:
    """PX4's INT32 -1 has the bits of a NaN: those of the one NaN we could pack are 2143289344."""
    assert closed.frame("PARAM_VALUE", 1, 1, '{"param_id": "RC_CHAN", "param_value": null}') == b""
    assert closed.unusable["PARAM_VALUE"] == 1


def test_a_message_that_our_dialect_does_not_have_is_skipped_and_counted(closed: MavsdkLinks) -> None:
    for _ in range(2):
        assert closed.frame("NOBODYS_MESSAGE", 1, 1, "{}") == b""
    assert closed.unknown["NOBODYS_MESSAGE"] == 2


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class FakeVehicle(threading.Thread):
    """Sends heartbeats until a ground station answers and is settled, then `frames` at their (s) times."""

    def __init__(self, port: int, frames: list[tuple[float, bytes]], system: int = 1) -> None:
        super().__init__(daemon=True)
        self.acknowledges = True
        self.heard: list[tuple[str, dict[str, Any]]] = []  # what was sent to it
        self.sent_all = threading.Event()
        self._stop_now = threading.Event()
        self._frames = frames
        self._encoder = Encoder(DIALECT, system)
        self._ear = FrameDecoder(DIALECT, stamped=False)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.settimeout(0.002)

    def __enter__(self) -> "FakeVehicle":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop_now.set()
        self.join()
        self._socket.close()

    def run(self) -> None:
        beat, at = 0.0, 0
        started: float | None = None
        while not self._stop_now.is_set():
            now = time.monotonic()
            if now >= beat and (started is None or at == len(self._frames)):
                beat = now + 0.5
                self.send(
                    self._encoder.frame(
                        "HEARTBEAT", type=2, autopilot=12, base_mode=81, system_status=4, mavlink_version=3
                    )
                )
            if started is None and self.heard:
                started = now + 0.5  # by then it has subscribed
            while started is not None and at < len(self._frames) and now >= started + self._frames[at][0]:
                self.send(self._frames[at][1])
                at += 1
            if at == len(self._frames):
                self.sent_all.set()
            self._listen()

    def send(self, frame: bytes) -> None:
        try:
            self._socket.send(frame)
        except OSError:  # nobody there yet
            time.sleep(0.01)

    def _listen(self) -> None:
        try:
            data = self._socket.recv(4096)
        except OSError:
            return
        for _, _, _, id, _, payload in self._ear.feed(data):
            message = DIALECT.messages[id]
            values = message.layout.unpack(payload.ljust(message.size, b"\0"))
            fields = {name: values[at] for name, (at, _) in message.positions.items()}
            self.heard.append((message.name, fields))
            if message.name == "COMMAND_LONG" and self.acknowledges:
                self.send(
                    self._encoder.frame(
                        "COMMAND_ACK", command=fields["command"], target_system=245, target_component=190
                    )
                )


@contextmanager
def connected(*vehicles: int, frames: list[tuple[float, bytes]] | None = None) -> Iterator[Any]:
    """Open MAVSDK's end and vehicles of these system ids; give (links, vehicles)."""
    port = free_port()
    with MavsdkLinks([parse_endpoint(f"udpin://127.0.0.1:{port}")]) as links:
        flying = [FakeVehicle(port, frames or [], system) for system in vehicles]
        for vehicle in flying:
            vehicle.start()
        try:
            yield links, flying
        finally:
            for vehicle in flying:
                vehicle.__exit__()


def recorded(speed: float) -> list[tuple[float, bytes]]:
    """Return (seconds from the start, frame) of the recorded flight."""
    raw: list[tuple[int, bytes]] = []
    monitor = Monitor(MonitorConfig(stamped=True, raw_tap=lambda batch: raw.extend(batch.raw())))
    with open_log(str(FLIGHT)) as log:
        for block in log.blocks():
            monitor.feed(block, 0)
    return [((stamp - raw[0][0]) / 1e6 / speed, frame) for stamp, frame in raw]


def alerts(events: list[Event]) -> list[AlertEvent]:
    return [event for event in events if isinstance(event, AlertEvent)]


def test_a_recorded_flight_gives_the_same_alerts_through_mavsdk_as_directly() -> None:
    frames = recorded(speed=2.0)
    direct, through = Monitor(MonitorConfig(stamped=False)), Monitor(MonitorConfig(stamped=False))
    expected: list[Event] = []
    for at, frame in frames:
        expected += direct.feed(frame, 1_700_000_000_000_000 + round(at * 1e6))
    expected += direct.finish()
    events: list[Event] = []
    kept = 0
    with connected(1, frames=frames) as (links, (vehicle,)):
        after = None
        for packet in links.packets(0.05):
            if packet.data:
                kept += packet.data[7] not in NOT_OF_THE_FLIGHT
                events += through.feed(packet.data, packet.receive_us)
            if vehicle.sent_all.is_set():
                after = after or time.monotonic()
                if time.monotonic() - after > 0.5:
                    break
    events += through.finish()
    assert kept == sum(frame[7] not in NOT_OF_THE_FLIGHT for _, frame in frames)  # nothing lost on the way
    assert (links.unknown, links.unusable) == ({}, {})
    got, wanted = alerts(events), alerts(expected)
    assert [(a.code, a.rotor, a.motor, a.state) for a in wanted] == [
        ("ROTOR_FAILED", 2, 3, "raised"),
        ("PROPELLER_LOST", 2, 3, "escalated"),
    ]
    assert [(a.code, a.rotor, a.motor, a.state) for a in got] == [
        (a.code, a.rotor, a.motor, a.state) for a in wanted
    ]
    for ours, theirs in zip(got, wanted, strict=True):
        assert ours.t == pytest.approx(theirs.t, abs=ALERT_TIME)


def test_a_request_goes_to_the_vehicle_addressed_alone_and_its_answer_is_told() -> None:
    ask = Encoder(DIALECT, 255, 190).frame(
        "COMMAND_LONG", command=511, param1=291, param2=100_000, target_system=2, target_component=1
    )
    with connected(1, 2) as (links, (first, second)):
        ends, asked, notices = time.monotonic() + 8.0, False, []
        for packet in links.packets(0.05):
            if not asked and first.sent_all.is_set() and len(links._directs) == 2:
                links.send(ask)
                asked = True
            notices += links.notices
            links.notices.clear()
            if notices or time.monotonic() > ends:
                break
            assert packet.source in ("mavsdk", "")
    assert notices == ["the vehicle will send ESC_STATUS every 100 ms"]

    def requests(vehicle: FakeVehicle) -> list[dict[str, Any]]:
        return [f for name, f in vehicle.heard if name == "COMMAND_LONG" and f["command"] == 511]

    assert {f["target_system"] for f in requests(second)} == {2}
    assert len(requests(second)) == 1
    assert all(f["target_system"] == 2 for f in requests(first))


def test_no_autopilot_ends_the_wait_with_one_line() -> None:
    port = free_port()
    endpoint = parse_endpoint(f"udpin://127.0.0.1:{port}")
    with (
        MavsdkLinks([endpoint], patience=0.5) as links,
        pytest.raises(EndpointError, match=f"{port}: MAVSDK heard no autopilot for 0.5 s; does"),
    ):
        for _ in links.packets(0.05):
            pass


def live(port: int, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "gcs_health", "live", f"udpin://127.0.0.1:{port}", "--backend", "mavsdk"]
    return subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace"
    )


def test_standard_output_holds_json_lines_alone() -> None:
    """Not even of a text that is not UTF-8, which MAVSDK's own log callback stumbles over."""
    text = Encoder(DIALECT).frame("STATUSTEXT", severity=2, text=b"gr\xfc\xdfe")
    status = Encoder(DIALECT).frame("ESC_STATUS", time_usec=1_000_000, rpm=[5000] * 4)
    port = free_port()
    listener = live(port, "--jsonl", "-", "--duration", "3")
    with FakeVehicle(port, [(0.1 * k, frame) for k in range(10) for frame in (text, status)]):
        out, complaints = listener.communicate(timeout=30)
    assert listener.returncode == 0, complaints
    assert len(out.splitlines()) > 2
    for line in out.splitlines():
        assert json.loads(line)["type"]
    assert "log callback" not in complaints


def test_ctrl_c_ends_the_wait_for_an_autopilot() -> None:
    listener = live(free_port())
    for line in iter(listener.stderr.readline, ""):  # type: ignore[union-attr]
        if "nothing heard" in line:
            break
    listener.send_signal(signal.SIGINT)
    _, complaints = listener.communicate(timeout=10)
    assert listener.returncode == 130
    assert "Traceback" not in complaints


def test_a_vehicle_that_never_answers_keeps_nobody_from_ending() -> None:
    port = free_port()
    listener = live(port, "--request-rates", "--duration", "4")
    with FakeVehicle(port, []) as vehicle:
        vehicle.acknowledges = False
        _, complaints = listener.communicate(timeout=20)
    assert listener.returncode == 0, complaints
    assert "gcs-health: asked 1.1 for ESC_STATUS 10 Hz" in complaints
    assert "object at 0x" not in complaints
