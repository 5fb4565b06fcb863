"""The simulator over real sockets: our own `live`, a real MAVSDK, and the commands around them."""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs_health.cli import main

COMMAND = [sys.executable, "-m", "gcs_health"]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def run(*arguments: str, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=timeout, check=False
    )


@contextmanager
def simulated(port: int, *arguments: str) -> Iterator["subprocess.Popen[bytes]"]:
    vehicle = subprocess.Popen([*COMMAND, "simulate", *arguments, "--to", f"udpout:127.0.0.1:{port}"])
    try:
        yield vehicle
    finally:
        vehicle.terminate()
        vehicle.wait()


def test_a_real_mavsdk_reads_telemetry_parameters_and_esc_status() -> None:
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.mavlink_direct import MavlinkDirect
    from mavsdk.plugins.param import Param
    from mavsdk.plugins.telemetry import Telemetry

    port = free_port()
    kind = mavsdk.ComponentType.GROUND_STATION
    station = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
    try:
        station.add_any_connection(f"udpin://127.0.0.1:{port}")
        with simulated(port, "healthy_quad", "--skip", "4"):
            system = station.first_autopilot(40.0)
            assert system is not None
            assert system.is_connected()
            direct, telemetry, parameters = MavlinkDirect(system), Telemetry(system), Param(system)
            status: list[dict[str, object]] = []
            handle = direct.subscribe_message(
                "ESC_STATUS", lambda message, _: status.append(json.loads(message.fields_json))
            )
            assert parameters.get_param_int("CA_ROTOR_COUNT") == 4
            assert parameters.get_param_float("CA_ROTOR0_PX") == pytest.approx(0.0875)
            seen: list[float] = []
            telemetry.subscribe_imu(lambda imu, _: seen.append(imu.acceleration_frd.down_m_s2))
            telemetry.set_rate_imu(200.0)  # acknowledged, or it raises
            until = time.monotonic() + 30.0
            while (len(seen) < 400 or len(status) < 60) and time.monotonic() < until:
                time.sleep(0.1)
            direct.unsubscribe_message(handle)
            assert telemetry.in_air()
            assert telemetry.armed()
            assert len(seen) >= 400
            assert sum(seen) / len(seen) == pytest.approx(-9.8, abs=1.0)
            assert len(status) > 50
            assert all(3000 < rpm < 12000 for rpm in status[-1]["rpm"])  # type: ignore[attr-defined]
    finally:
        station.destroy()


def test_the_demo_names_the_motor_within_a_second_and_ends_with_0(tmp_path: Path) -> None:
    lines = tmp_path / "demo.jsonl"
    done = run("demo", "--jsonl", str(lines), "--set", "trajectory.duration=15.0", "--speed", "1.5")
    assert done.returncode == 0, done.stderr
    assert "ROTOR_FAILED raised: motor 3 (front left, CW)" in done.stdout
    events = [json.loads(line) for line in lines.read_text().splitlines()]
    alert, *_ = [event for event in events if event["type"] == "alert"]
    assert 0.0 < alert["t"] - 19.0 < 1.0
    assert "right" in done.stdout.splitlines()[-1]
    # the first estimate is there after 3 s of flight; the command's own start is benchmarks/demo.py's
    estimates = [event for event in events if event["type"] == "estimate"]
    first = next(event for event in estimates if event["value"] is not None)
    assert first["t"] - estimates[0]["t"] < 3.0


@pytest.mark.parametrize(
    ("size", "speed", "expected"),
    [("0.97", "8", "no alert: it is smaller than this telemetry shows"), ("0.0", "500", "ms later, right")],
)
def test_the_demo_says_why_there_was_no_alert_and_a_hasty_one_loses_nothing(
    size: str, speed: str, expected: str
) -> None:
    fault = f'fault=[{{kind="effectiveness", motor=3, at=9.0, size={size}}}]'
    done = run("demo", "--set", fault, "--set", "trajectory.duration=12.0", "--speed", speed)
    assert done.returncode == 0, done.stderr
    assert expected in done.stdout.splitlines()[-1], done.stdout


def test_live_hears_a_flight_faster_than_real_time() -> None:
    port = free_port()
    listen = [*COMMAND, "live", f"udpin://127.0.0.1:{port}", "--duration", "60", "--jsonl", "-"]
    listener = subprocess.Popen(listen, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert listener.stdout is not None
    try:
        with simulated(port, "lost_propeller", "--speed", "4"):
            told = next(line for line in listener.stdout if '"type":"alert"' in line)
    finally:
        listener.terminate()
        rest = listener.communicate(timeout=60)[0]
    alert = json.loads(told)
    assert (alert["code"], alert["motor"], alert["state"]) == ("ROTOR_FAILED", 3, "raised")
    assert not [x for x in rest.splitlines() if '"type":"alert"' in x and '"state":"raised"' in x]


def test_simulate_lists_writes_and_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    listed = run("simulate", "--list")
    assert listed.returncode == 0
    names = [line.split()[0] for line in listed.stdout.splitlines()]
    assert "lost_propeller" in names
    out = tmp_path / "flight.tlog"
    short = ("--set", "trajectory.duration=12.5", "--set", "fault.0.at=12")
    wrote = run("simulate", "lost_propeller", *short, "-o", str(out))
    assert wrote.returncode == 0, wrote.stderr
    assert out.stat().st_size > 50_000
    told = json.loads((tmp_path / "flight.truth.json").read_text())
    assert told["truth"]["rotor"] == 3
    capsys.readouterr()
    for arguments, words in (
        (("simulate",), "which scenario?"),
        (("simulate", "lost_propeller"), "where to?"),
        (("simulate", "gone", "-o", str(out)), "neither a file nor one of"),
        (("simulate", "lost_propeller", "-o", str(tmp_path / "no" / "x.tlog")), "cannot write"),
        (("simulate", "lost_propeller", "--to", "carrier-pigeon:1"), "carrier-pigeon"),
        (("simulate", "lost_propeller", *short, "-o", str(out), "--signals", str(out)), "no booms"),
        (("simulate", "lost_propeller", "-o", str(out), "--skip", "99"), "the flight lasts 14 s"),
        (("demo", "nothing"), "neither a file nor one of"),
    ):
        assert main(list(arguments)) == 2, arguments
        said = capsys.readouterr().err
        assert words in said
        assert len(said.splitlines()) == 1


def test_boom_tips_are_written_beside_the_log(tmp_path: Path) -> None:
    np = pytest.importorskip("numpy")
    signals = tmp_path / "booms.npz"
    short = ("trajectory.duration=3", "trajectory.height=1", "trajectory.lands=false", "fault=[]")
    short += ("physics_rate=4000",)
    changes = [part for change in short for part in ("--set", change)]
    done = run(
        "simulate", "degraded_rotor", *changes, "-o", str(tmp_path / "b.tlog"), "--signals", str(signals)
    )
    assert done.returncode == 0, done.stderr
    tips = np.load(signals)
    assert tips["boom_tip_acceleration"].shape == (12_000, 6)
    assert float(tips["rate"]) == 4000.0
