"""The second way in: MAVSDK's messages give the frames, and the alerts, of the direct path."""

import json
import math
import random
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_health.errors import EndpointError
from gcs_health.mavlink.dialect import Message, default_dialect
from gcs_health.mavlink.encoder import pack, payload_of
from gcs_health.mavlink.message_table import TABLE
from gcs_health.mavlink.spellings import parse_endpoint

pytest.importorskip("mavsdk")

from test_simulate_live import COMMAND, free_port, run, simulated

from gcs_health.mavlink.mavsdk_link import MavsdkLinks, dialect_xml, url_of

DIALECT = default_dialect()
LIMITS = {"uint8_t": "B", "int8_t": "b", "uint16_t": "H", "int16_t": "h", "uint32_t": "I", "int32_t": "i"}


def any_value(kind: str, rng: random.Random) -> float | int | None:
    if kind in ("float", "double"):
        return rng.choice([None, 0.0, struct.unpack("<f", struct.pack("<f", rng.gauss(0, 100)))[0]])
    if kind in ("uint64_t", "int64_t"):
        return rng.randrange(1 << 62)
    size = 8 * struct.calcsize(LIMITS[kind])
    return (
        rng.randrange(1 << size) if kind.startswith("u") else rng.randrange(-(1 << size - 1), 1 << size - 1)
    )


def any_fields(message: Message, rng: random.Random) -> dict[str, object]:
    """Fields as MAVSDK's JSON has them: NaN is null, characters are text."""
    out: dict[str, object] = {}
    for name, kind, length in message.fields:
        if kind == "char":
            out[name] = "text"[: length or 1]
        else:
            out[name] = [any_value(kind, rng) for _ in range(length)] if length else any_value(kind, rng)
    return out


@pytest.fixture(scope="module")
def links() -> Iterator[MavsdkLinks]:
    with MavsdkLinks([]) as opened:
        yield opened


@pytest.mark.parametrize("id", [*TABLE, 410])
def test_every_message_of_ours_survives_the_way_through_json(links: MavsdkLinks, id: int) -> None:
    message = DIALECT.messages[id]
    fields = any_fields(message, random.Random(id))
    told = json.dumps({"message_id": id, "message_name": message.name, **fields})
    frame = links.frame(message.name, 1, 1, told)
    plain = {k: _nan(v) for k, v in fields.items()}
    expected = pack(message, payload_of(message, plain), frame[4], 1, 1)
    assert frame == expected


def _nan(value: object) -> object:
    if isinstance(value, list):
        return [_nan(item) for item in value]
    return math.nan if value is None else value


def test_what_our_dialect_does_not_have_is_counted(links: MavsdkLinks) -> None:
    assert links.frame("NO_SUCH_MESSAGE", 1, 1, "{}") == b""
    assert links.unknown["NO_SUCH_MESSAGE"] >= 1


def test_the_dialect_goes_with_the_package() -> None:
    assert 'name="ESC_STATUS"' in dialect_xml()


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpin:0.0.0.0:14550", "udpin://0.0.0.0:14550"),
        ("udpout://10.0.0.2:14551", "udpout://10.0.0.2:14551"),
        ("tcp:10.0.0.2:5760", "tcpout://10.0.0.2:5760"),
        ("/dev/ttyUSB0,57600", "serial:///dev/ttyUSB0:57600"),
    ],
)
def test_endpoints_are_spelt_as_mavsdk_does(text: str, url: str) -> None:
    assert url_of(parse_endpoint(text)) == url


def test_a_file_is_refused() -> None:
    with pytest.raises(EndpointError, match="gcs-health replay"):
        url_of(parse_endpoint(f"file://{__file__}"))


def test_the_same_flight_gives_the_same_alert_through_mavsdk_and_directly(tmp_path: Path) -> None:
    """Both listen to the same flight, each on its own port, at once."""
    said = {}
    ports = {"mavsdk": free_port(), "direct": free_port()}
    listeners = {
        backend: subprocess.Popen(
            [
                *(*COMMAND, "live", f"udpin://127.0.0.1:{port}", "--backend", backend, "--duration", "18"),
                "--request-rates",  # for the parameters: MAVSDK gives nothing before it has heard a heartbeat
                *(
                    "--jsonl",
                    str(tmp_path / f"{backend}.jsonl"),
                    "--record",
                    str(tmp_path / f"{backend}.tlog"),
                ),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for backend, port in ports.items()
    }
    with simulated(ports["mavsdk"], "demo"), simulated(ports["direct"], "demo"):
        for backend, listener in listeners.items():
            listener.wait(timeout=60)
            lines = [json.loads(line) for line in (tmp_path / f"{backend}.jsonl").read_text().splitlines()]
            said[backend] = [line for line in lines if line["type"] == "alert"]
    for backend in ports:
        (alert,) = said[backend]
        assert (alert["code"], alert["motor"], alert["state"]) == ("ROTOR_FAILED", 3, "raised")
    assert said["mavsdk"][0]["t"] == pytest.approx(said["direct"][0]["t"], abs=0.03)
    # what was recorded through MAVSDK replays to the same
    replayed = run("replay", str(tmp_path / "mavsdk.tlog"), "--jsonl", "-")
    again = [json.loads(line) for line in replayed.stdout.splitlines() if '"type":"alert"' in line]
    assert [(a["t"], a["motor"]) for a in again] == [(a["t"], a["motor"]) for a in said["mavsdk"]]


def test_a_port_in_use_gets_one_line() -> None:
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        refused = run("live", f"udpin://127.0.0.1:{port}", "--backend", "mavsdk", "--duration", "1")
    assert refused.returncode == 2
    assert f"{port}" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
