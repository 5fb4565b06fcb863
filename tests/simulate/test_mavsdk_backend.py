"""The second way in, through MAVSDK: its spellings, and the alerts of the direct path on a live flight."""

import json
import socket
import subprocess
import time
from pathlib import Path

import pytest

from gcs_health.errors import EndpointError
from gcs_health.mavlink.spellings import parse_endpoint

pytest.importorskip("mavsdk")

from test_simulate_live import COMMAND, free_port, run, simulated

from gcs_health.mavlink.mavsdk_link import dialect_xml, url_of


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


def is_bound(port: int) -> bool:
    """Whether somebody listens there: then a socket of our own cannot."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        try:
            other.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def test_the_same_flight_gives_the_same_alert_through_mavsdk_and_directly(tmp_path: Path) -> None:
    """Both listen to the same flight, each on its own port, at once."""
    said = {}
    ports = {"mavsdk": free_port(), "direct": free_port()}
    listeners = {
        backend: subprocess.Popen(
            [
                *(*COMMAND, "live", f"udpin://127.0.0.1:{port}", "--backend", backend, "--duration", "300"),
                "--request-rates",  # for the parameters: MAVSDK gives nothing before it has heard a heartbeat
                *("--jsonl", str(tmp_path / f"{backend}.jsonl")),
                *("--record", str(tmp_path / f"{backend}.tlog")),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for backend, port in ports.items()
    }
    until = time.monotonic() + 60.0
    while time.monotonic() < until and not all(is_bound(port) for port in ports.values()):
        time.sleep(0.1)
    fast = "--speed", "1.5"
    try:
        with (
            simulated(ports["mavsdk"], "demo", *fast) as one,
            simulated(ports["direct"], "demo", *fast) as other,
        ):
            one.wait(timeout=120)
            other.wait(timeout=120)
        time.sleep(1.0)
    finally:
        for listener in listeners.values():
            listener.terminate()
    for backend, listener in listeners.items():
        listener.wait(timeout=60)
        lines = [json.loads(line) for line in (tmp_path / f"{backend}.jsonl").read_text().splitlines()]
        said[backend] = [line for line in lines if line["type"] == "alert"]
    for backend in ports:
        alert, *_ = said[backend]
        assert (alert["code"], alert["motor"], alert["state"]) == ("ROTOR_FAILED", 3, "raised")
    assert said["mavsdk"][0]["t"] == pytest.approx(said["direct"][0]["t"], abs=0.06)
    # what was recorded through MAVSDK replays to the same
    replayed = run("replay", str(tmp_path / "mavsdk.tlog"), "--jsonl", "-")
    again = [json.loads(line) for line in replayed.stdout.splitlines() if '"type":"alert"' in line]
    assert [(a["t"], a["motor"]) for a in again] == [(a["t"], a["motor"]) for a in said["mavsdk"]]


def test_a_port_in_use_gets_one_line() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        refused = run("live", f"udpin://127.0.0.1:{port}", "--backend", "mavsdk", "--duration", "1")
    assert refused.returncode == 2
    assert f"{port}" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
