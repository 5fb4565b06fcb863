"""The other end of each sink, a real one: it can be absent and come back, and counts the alerts that came.

`ENDS` maps a sink's name to the end's class; `spec` is what `--sink` is given.
"""

import contextlib
import http.server
import json
import os
import pty
import shutil
import socket
import subprocess
import sys
import threading
import time
import types
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gcs_health.sinks import bell


def wait_until(holds: Callable[[], bool], seconds: float = 15.0) -> bool:
    """Whether it comes to hold."""
    for _ in range(int(seconds * 100)):
        if holds():
            return True
        time.sleep(0.01)
    return holds()


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of this computer that nobody has."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class End:
    """One other end; `start` and `stop` may be called again and again."""

    can_be_absent = True

    def __init__(self, place: Path) -> None:
        self.place = place
        self.spec = ""

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def leave(self) -> None:
        """Let go of all."""
        self.stop()

    def count(self) -> int:
        """Alerts that came so far."""
        raise NotImplementedError


class BellEnd(End):
    """A pseudo terminal in the place of standard error."""

    can_be_absent = False

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        self.spec = "bell"
        self._rung = 0

    def start(self) -> None:
        self._master, slave = pty.openpty()
        os.set_blocking(self._master, False)
        self._terminal = os.fdopen(slave, "w")
        bell.sys = types.SimpleNamespace(stderr=self._terminal, stdout=sys.stdout)  # type: ignore[assignment]

    def stop(self) -> None:
        self.count()
        bell.sys = sys
        self._terminal.close()
        os.close(self._master)

    def count(self) -> int:
        with contextlib.suppress(OSError):
            self._rung += os.read(self._master, 4096).count(b"\a")
        return self._rung


class JsonLinesEnd(End):
    """A folder that is there or not."""

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        self._folder = place / "out"
        self._folder.mkdir()
        self.spec = f"jsonl:{self._folder / 'alerts.jsonl'}"

    def start(self) -> None:
        if self._folder.with_name("away").exists():
            self._folder.with_name("away").rename(self._folder)

    def stop(self) -> None:
        self._folder.rename(self._folder.with_name("away"))

    def lines(self) -> list[dict[str, Any]]:
        path = self._folder / "alerts.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    def count(self) -> int:
        return sum(line["type"] == "alert" for line in self.lines())


class CommandEnd(End):
    """A program that keeps its standard input, there or not."""

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        self._program, self.out = place / "tell", place / "told.jsonl"
        self._program.write_text(
            f'#!/bin/sh\ncat >> "{self.out}"\nprintf "%s\\n" "$@" > "{place}/arguments"\n'
        )
        self._program.chmod(0o755)
        self.spec = f"command:{self._program} 'two words' \"$(touch {place}/shell)\""

    def start(self) -> None:
        if self._program.with_name("away").exists():
            self._program.with_name("away").rename(self._program)

    def stop(self) -> None:
        self._program.rename(self._program.with_name("away"))

    def count(self) -> int:
        return len(self.out.read_text().splitlines()) if self.out.exists() else 0


class SyslogEnd(End):
    """The socket of a syslog daemon."""

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        self._path = place / "log"
        self.spec = f"syslog:{self._path}"
        self.said: list[bytes] = []

    def start(self) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self._path))
        self._socket.setblocking(False)

    def stop(self) -> None:
        self._socket.close()
        self._path.unlink()

    def count(self) -> int:
        with contextlib.suppress(BlockingIOError):
            while True:
                self.said.append(self._socket.recv(4096))
        return len(self.said)


class MqttEnd(End):
    """Debian's mosquitto, and a subscriber of its own."""

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        self._broker = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
        if self._broker is None:
            pytest.skip("no MQTT broker is installed (apt-get install mosquitto)")
        self._paho = pytest.importorskip("paho.mqtt.client")
        self.port = free_port()
        self.spec = f"mqtt://127.0.0.1:{self.port}/fleet/seven"
        self.messages: list[tuple[str, bytes]] = []

    def start(self) -> None:
        settings = self.place / "mosquitto.conf"
        settings.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\n")
        self._process = subprocess.Popen([self._broker, "-c", str(settings)], stderr=subprocess.DEVNULL)

        def listens() -> bool:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 0.2):
                return True
            return False

        assert wait_until(listens), "the broker does not listen"
        heard = threading.Event()
        self._client = self._paho.Client(self._paho.CallbackAPIVersion.VERSION2)
        self._client.on_message = lambda _c, _d, m: self.messages.append((m.topic, m.payload))
        self._client.on_subscribe = lambda *_: heard.set()
        self._client.connect("127.0.0.1", self.port)
        self._client.subscribe("#", qos=1)
        self._client.loop_start()
        assert heard.wait(10)

    def stop(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()
        self._process.terminate()
        self._process.wait(10)

    def count(self) -> int:
        return sum(topic.endswith("/alert") for topic, _ in self.messages)


class PrometheusEnd(End):
    """A scrape by HTTP, read as Prometheus' text format; absent: another program has the port."""

    labels = ("vehicle", "motor", "estimator", "quantity", "code", "kind")

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        pytest.importorskip("prometheus_client")
        self.port = free_port()
        self.spec = f"prometheus:{self.port}"
        self._other: socket.socket | None = None

    def start(self) -> None:
        if self._other is not None:
            self._other.close()
            self._other = None

    def stop(self) -> None:
        self._other = socket.create_server(("127.0.0.1", self.port))

    def leave(self) -> None:
        self.start()

    def scrape(self) -> dict[tuple[str, ...], float]:
        from prometheus_client.parser import text_string_to_metric_families

        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/metrics", timeout=5) as page:
            text = page.read().decode()
        return {
            (
                sample.name,
                *(sample.labels[name] for name in self.labels if name in sample.labels),
            ): sample.value
            for family in text_string_to_metric_families(text)
            for sample in family.samples
        }

    def count(self) -> int:
        with contextlib.suppress(OSError):
            return int(sum(v for k, v in self.scrape().items() if k[0] == "gcs_health_alerts_total"))
        return 0


class AppriseEnd(End):
    """A web server that is posted to."""

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        pytest.importorskip("apprise")
        self.port = free_port()
        self.spec = f"apprise:json://user:hunter2@127.0.0.1:{self.port}"
        self.posts: list[dict[str, Any]] = []

    def start(self) -> None:
        posts = self.posts

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                posts.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
                self.send_response(200)
                self.end_headers()

            def log_message(self, *_: object) -> None: ...

        self._server = http.server.HTTPServer(("127.0.0.1", self.port), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))
        self._thread.start()

    def stop(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def count(self) -> int:
        return len(self.posts)


class MavlinkEnd(End):
    """A ground station: pymavlink's mavutil, waiting for a TCP connection."""

    def __init__(self, place: Path) -> None:
        super().__init__(place)
        self.port = free_port()
        self.spec = f"mavlink:tcpout://127.0.0.1:{self.port}"
        self.texts: list[Any] = []

    def start(self) -> None:
        from pymavlink import mavutil

        self._station = mavutil.mavlink_connection(f"tcpin:127.0.0.1:{self.port}", source_system=255)

    def stop(self) -> None:
        self._station.close()
        self._station.listen.close()

    def count(self) -> int:
        while (message := self._station.recv_match(type="STATUSTEXT", blocking=False)) is not None:
            self.texts.append(message)
        self._await_the_next()
        return sum(text.chunk_seq == 0 for text in self.texts)

    def _await_the_next(self) -> None:
        """Mavutil itself never lets go of a connection that the other side has closed."""
        if self._station.port is not None:
            with contextlib.suppress(BlockingIOError):
                if not self._station.port.recv(1, socket.MSG_PEEK):
                    self._station.port.close()
                    self._station.port = None


ENDS: dict[str, type[End]] = {
    "bell": BellEnd,
    "jsonl": JsonLinesEnd,
    "command": CommandEnd,
    "syslog": SyslogEnd,
    "mqtt": MqttEnd,
    "prometheus": PrometheusEnd,
    "apprise": AppriseEnd,
    "mavlink": MavlinkEnd,
}
