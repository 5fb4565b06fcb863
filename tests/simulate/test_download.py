"""Logs on board, fetched through a real MAVSDK from a vehicle on loopback that serves them."""

import contextlib
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mavsdk")

from test_simulate_live import free_port, run

from gcs_health.errors import EndpointError
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.mavsdk_logs import OnboardLogs
from gcs_health.mavlink.spellings import parse_endpoint

DIALECT = default_dialect()
AT_ONCE = 90  # bytes of a LOG_DATA
LOGS = {1: (1_700_000_000, bytes(range(256)) * 150 + b"end"), 2: (1_700_000_500, b"newest"), 3: (0, b"")}


class Keeper(threading.Thread):
    """A vehicle with logs; it forgets every `forgets`-th LOG_DATA."""

    def __init__(
        self, port: int, logs: dict[int, tuple[int, bytes]], autopilot: int = 12, forgets: int = 1 << 30
    ) -> None:
        super().__init__(daemon=True)
        self._logs, self._autopilot, self._forgets = logs, autopilot, forgets
        self._sent = 0
        self._encoder, self._ear = Encoder(DIALECT), FrameDecoder(DIALECT, stamped=False)
        self._stop_now = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.settimeout(0.01)

    def __enter__(self) -> "Keeper":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop_now.set()
        self.join()
        self._socket.close()

    def run(self) -> None:
        beat = 0.0
        while not self._stop_now.is_set():
            if time.monotonic() >= beat:
                beat = time.monotonic() + 0.2
                self.send("HEARTBEAT", type=2, autopilot=self._autopilot, mavlink_version=3)
            try:
                asked = self._ear.feed(self._socket.recv(4096))
            except (TimeoutError, ConnectionError):
                continue
            for _, _, _, id, _, payload in asked:
                message = DIALECT.messages[id]
                values = message.layout.unpack(payload.ljust(message.size, b"\0")[: message.size])
                self.answer(message.name, {name: values[at] for name, (at, _) in message.positions.items()})

    def send(self, name: str, **fields: Any) -> None:
        with contextlib.suppress(ConnectionError):  # nobody listens yet
            self._socket.send(self._encoder.frame(name, **fields))

    def answer(self, name: str, fields: dict[str, Any]) -> None:
        if name == "LOG_REQUEST_LIST":
            count, last = len(self._logs), max(self._logs, default=0)
            for id, (began, data) in self._logs.items() or [(0, (0, b""))]:
                told = {"id": id, "time_utc": began, "size": len(data)}
                self.send("LOG_ENTRY", num_logs=count, last_log_num=last, **told)
        elif name == "LOG_REQUEST_DATA":
            data = self._logs[fields["id"]][1]
            for at in range(fields["ofs"], min(fields["ofs"] + fields["count"], len(data)), AT_ONCE):
                self._sent += 1
                if self._sent % self._forgets:
                    piece = data[at : at + AT_ONCE]
                    self.send(
                        "LOG_DATA", id=fields["id"], ofs=at, count=len(piece), data=piece.ljust(AT_ONCE)
                    )


def download(port: int, *arguments: str) -> str:
    done = run("download", f"udpin://127.0.0.1:{port}", *arguments)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_logs_are_listed_and_fetched_whole(tmp_path: Path) -> None:
    port = free_port()
    with Keeper(port, LOGS, forgets=40):
        listed = download(port).splitlines()
        assert [line.split()[0] for line in listed] == ["1", "2", "3"]
        assert listed[0].split()[1:] == ["2023-11-14T22:13:20Z", "38,403", "bytes"]
        download(port, "-o", str(tmp_path))
        (newest,) = tmp_path.iterdir()
        assert newest.name == "log_2_2023-11-14T22-21-40Z.ulg"
        told = download(port, "-o", str(tmp_path), "--all")
    assert "log_2_2023-11-14T22-21-40Z.ulg: is here already" in told
    fetched = {int(path.name.split("_")[1].split(".")[0]): path.read_bytes() for path in tmp_path.iterdir()}
    assert fetched == {id: data for id, (_, data) in LOGS.items()}


def test_an_ardupilots_logs_are_dataflash_and_what_is_not_there_gets_a_line(tmp_path: Path) -> None:
    port = free_port()
    with Keeper(port, {1: LOGS[2]}, autopilot=3):
        told = download(port, "-o", str(tmp_path), "--log", "1")
        assert told.split()[0].endswith("log_1_2023-11-14T22-21-40Z.bin:")
        missing = run("download", f"udpin://127.0.0.1:{port}", "-o", str(tmp_path), "--log", "9")
        assert (missing.returncode, missing.stderr) == (2, "gcs-health: --log 9: the vehicle has 1\n")
        next(tmp_path.iterdir()).write_bytes(b"older")
        held = run("download", f"udpin://127.0.0.1:{port}", "-o", str(tmp_path))
        assert held.returncode == 2
        assert "move it away" in held.stderr


def test_a_vehicle_without_logs(tmp_path: Path) -> None:
    port = free_port()
    with Keeper(port, {}):
        assert download(port) == "MAVSDK tells of no logs on board\n"
        assert download(port, "-o", str(tmp_path)) == "MAVSDK tells of no logs on board\n"


def test_nobody_there_and_nowhere_to_put_it() -> None:
    with pytest.raises(EndpointError, match="heard no autopilot"):
        OnboardLogs(parse_endpoint(f"udpin://127.0.0.1:{free_port()}"), patience=0.5)
    refused = run("download", "udpin://127.0.0.1:14550", "--all")
    assert (refused.returncode, refused.stderr) == (2, "gcs-health: where to? -o DIR takes the logs\n")
