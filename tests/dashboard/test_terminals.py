"""In a real tmux, and in a real browser: what no pilot sees."""

import asyncio
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
import zlib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
FLIGHT = ROOT / "replay" / "lost_propeller.tlog"
GCS = f"{sys.executable} -m gcs_health"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


class Tmux:
    """A tmux of its own, 80 x 24."""

    def __init__(self, folder: Path) -> None:
        self._base = ["tmux", "-u", "-S", str(folder / "tmux"), "-f", "/dev/null"]
        self._folder = folder

    def run(self, *arguments: str) -> str:
        environment = {k: v for k, v in os.environ.items() if k not in ("TMUX", "NO_COLOR")}
        environment |= {"LC_ALL": "C.UTF-8", "XDG_DATA_HOME": str(self._folder)}
        done = subprocess.run(
            [*self._base, *arguments],
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
            env=environment,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def start(self, command: str) -> None:
        """Run a command; its exit code and what it printed stay on the screen."""
        self.run("new-session", "-d", "-x", "80", "-y", "24", f"cd {ROOT}; {command}; echo EXIT $?; sleep 60")

    def keys(self, *keys: str) -> None:
        self.run("send-keys", *keys)

    def screen(self) -> str:
        return self.run("capture-pane", "-p")

    def until(self, pattern: str, seconds: float = 30.0) -> str:
        end = time.monotonic() + seconds
        while not re.search(pattern, shown := self.screen()):
            assert time.monotonic() < end, shown
            time.sleep(0.1)
        return shown


def free_port() -> int:
    """Return a port that neither UDP nor TCP has."""
    with socket.socket() as tcp, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        tcp.bind(("127.0.0.1", 0))
        port = int(tcp.getsockname()[1])
        udp.bind(("127.0.0.1", port))
        return port


@pytest.fixture
def tmux(tmp_path: Path) -> Iterator[Tmux]:
    if shutil.which("tmux") is None:
        pytest.skip("tmux is not installed")
    terminal = Tmux(tmp_path)
    yield terminal
    subprocess.run([*terminal._base, "kill-server"], capture_output=True, check=False, timeout=10)


def test_a_replay_in_tmux_from_the_command_to_a_clean_end(tmux: Tmux) -> None:
    tmux.start(f"{GCS} replay {FLIGHT} --dashboard")
    shown = tmux.until(r"1\.1 PX4 4 rotors[\s\S]*100 %|00:13 ")
    assert len(shown.splitlines()) == 24
    tmux.until("✗─|✗ ")  # the forerunner has found the alert
    tmux.keys("n")
    shown = tmux.until("PROPELLER LOST")
    assert "motor 3 front left" in shown
    assert "╔═════════╗" in shown
    tmux.keys("Enter")
    tmux.until("what happened")
    tmux.keys("Escape")
    tmux.until("── airframe")
    tmux.keys("q")
    shown = tmux.until(r"EXIT \d+")
    assert "EXIT 0" in shown
    assert "Traceback" not in shown


def test_live_in_tmux_without_colour_ends_with_ctrl_c_and_closes_its_recording(
    tmux: Tmux, tmp_path: Path
) -> None:
    port = free_port()
    record = tmp_path / "flight.tlog"
    tmux.start(f"NO_COLOR=1 {GCS} live udpin://127.0.0.1:{port} --record {record} --history none")
    tmux.until("listening")
    tmux.keys("C-c")
    shown = tmux.until(r"EXIT \d+")
    assert "EXIT 130" in shown
    assert "Traceback" not in shown
    assert record.exists()


@pytest.mark.parametrize("number", ["TERM", "HUP"])
def test_a_signal_ends_it_as_cleanly(tmux: Tmux, tmp_path: Path, number: str) -> None:
    record = tmp_path / "flight.tlog"
    where = f"udpin://127.0.0.1:{free_port()}"
    command = f"exec {GCS} live {where} --record {record} --history none"
    tmux.start(f"sh -c 'echo $$ > {tmp_path}/pid; {command}'")
    tmux.until("listening")
    os.kill(int((tmp_path / "pid").read_text()), getattr(signal, f"SIG{number}"))
    shown = tmux.until(r"EXIT \d+")
    assert "Traceback" not in shown
    assert record.exists()


def test_plain_on_a_terminal_is_lines_of_text(tmux: Tmux) -> None:
    tmux.start(f"{GCS} live file://{FLIGHT} --plain --history none")
    assert "ROTOR_FAILED raised" in tmux.until(r"EXIT \d+")
    assert "airframe ──" not in tmux.screen()


@pytest.fixture
def browser() -> str:
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip("no chromium is installed")
    if find_spec("textual_serve") is None:
        pytest.skip("textual-serve is not installed: pip install 'gcs-health[web]'")
    return found


def test_the_dashboard_in_a_browser(browser: str, tmp_path: Path) -> None:
    """Set GCS_HEALTH_PICTURES to a folder to keep what the browser showed: look at it."""
    from dashboard_browser import pictures

    port = free_port()
    server = subprocess.Popen(
        [sys.executable, "-m", "gcs_health", "replay", str(FLIGHT), "--web", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
    )
    try:
        wait_for(port)
        assert not answers(other_address(), port)  # nobody else's computer
        url = f"http://127.0.0.1:{port}/"
        for attempt in range(3):  # a browser on a busy machine may lose its page
            try:
                profile = tmp_path / f"profile{attempt}"
                shots = asyncio.run(pictures(browser, url, profile, "n", shows_alarm))
            except (TimeoutError, OSError):
                continue
            if shows_alarm(shots[2]):
                break
    finally:
        server.terminate()
        server.wait(timeout=10)
    folder = Path(os.environ.get("GCS_HEALTH_PICTURES", tmp_path))
    for name, shot in zip(("begun-top", "begun", "alert-top", "alert"), shots, strict=True):
        (folder / f"web-{name}.png").write_bytes(shot)
    assert not shows_alarm(shots[0])  # the banner's red is there with the alert, and not before
    assert shows_alarm(shots[2])


def wait_for(port: int) -> None:
    end = time.monotonic() + 20.0
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=2.0):
                return
        except OSError:
            assert time.monotonic() < end
            time.sleep(0.1)


def answers(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), timeout=0.5).close()
    except OSError:
        return False
    return True


def other_address() -> str:
    """Return an address of this computer that is not loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # sends nothing
        return str(probe.getsockname()[0])


def shows_alarm(png: bytes) -> bool:
    """Whether a good part of a small 8-bit RGB picture has the alarm's red."""
    packed, at, wide, colours = b"", 8, 0, 3
    while at < len(png):
        length = int.from_bytes(png[at : at + 4], "big")
        body = png[at + 8 : at + 8 + length]
        if png[at + 4 : at + 8] == b"IHDR":
            wide, colours = int.from_bytes(body[:4], "big"), {2: 3, 6: 4}[body[9]]
        elif png[at + 4 : at + 8] == b"IDAT":
            packed += body
        at += 12 + length
    rows = unfiltered(zlib.decompress(packed), wide * colours, colours)
    red = np.abs(rows.reshape(-1, colours)[:, :3].astype(int) - (0xC8, 0x1E, 0x1E)).max(axis=1) < 12
    return bool(red.mean() > 0.2)


def unfiltered(data: bytes, length: int, step: int) -> np.ndarray:  # type: ignore[type-arg]
    """Return (rows, length) bytes of a picture: PNG's five filters undone (its specification, section 9)."""
    before = np.zeros(length, int)
    out = []
    for start in range(0, len(data), length + 1):
        kind, row = data[start], np.frombuffer(data[start + 1 : start + 1 + length], np.uint8).astype(int)
        if kind == 2:
            row = row + before
        elif kind:
            for k in range(length):
                left, up = (row[k - step] if k >= step else 0), before[k]
                corner = before[k - step] if k >= step else 0
                guess = left + up - corner
                nearest = min((left, up, corner), key=lambda value: abs(guess - value))
                row[k] = (row[k] + (left, 0, (left + up) // 2, nearest)[kind - 1]) & 0xFF
        before = row & 0xFF
        out.append(before)
    return np.array(out)
