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

from gcs_health.mavlink.endpoints import now_us

COMMAND = [sys.executable, "-m", "gcs_health"]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def run(*arguments: str, timeout: float = 60.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=timeout, check=False
    )


@contextmanager
def simulated(port: int, *arguments: str) -> Iterator[None]:
    vehicle = subprocess.Popen([*COMMAND, "simulate", *arguments, "--to", f"udpout:127.0.0.1:{port}"])
    try:
        yield
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
            system = station.first_autopilot(8.0)
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
            time.sleep(2.0)
            direct.unsubscribe_message(handle)
            assert telemetry.in_air()
            assert telemetry.armed()
            assert len(seen) > 200  # 100 Hz before it was asked for 200
            assert sum(seen) / len(seen) == pytest.approx(-9.8, abs=1.0)
            assert len(status) > 50
            assert all(3000 < rpm < 12000 for rpm in status[-1]["rpm"])  # type: ignore[attr-defined]
    finally:
        station.destroy()


def test_the_demo_names_the_motor_within_a_second_and_ends_with_0(tmp_path: Path) -> None:
    lines = tmp_path / "demo.jsonl"
    started = now_us()
    done = run("demo", "--jsonl", str(lines), "--set", "trajectory.duration=15.0")
    assert done.returncode == 0, done.stderr
    assert "ROTOR_FAILED raised: motor 3 (front left, CW)" in done.stdout
    events = [json.loads(line) for line in lines.read_text().splitlines()]
    (alert,) = [event for event in events if event["type"] == "alert"]
    assert 0.0 < alert["t"] - 19.0 < 1.0
    assert "right" in done.stdout.splitlines()[-1]
    # the first estimate came within 5 s of the command: receive stamps are of this computer's clock
    estimates = [event for event in events if event["type"] == "estimate" and event["value"] is not None]
    assert estimates[0]["t_unix_us"] - started < 5_000_000


def test_live_hears_a_flight_faster_than_real_time() -> None:
    port = free_port()
    with simulated(port, "lost_propeller", "--speed", "4"):
        done = run("live", f"udpin://127.0.0.1:{port}", "--duration", "6.5", "--jsonl", "-")
    alerts = [json.loads(line) for line in done.stdout.splitlines() if '"type":"alert"' in line]
    assert [(alert["code"], alert["motor"]) for alert in alerts] == [("ROTOR_FAILED", 3)]


def test_simulate_lists_writes_and_refuses(tmp_path: Path) -> None:
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
    for arguments, words in (
        (("simulate",), "which scenario?"),
        (("simulate", "lost_propeller"), "where to?"),
        (("simulate", "gone", "-o", str(out)), "neither a file nor one of"),
        (("simulate", "lost_propeller", "-o", str(tmp_path / "no" / "x.tlog")), "cannot write"),
        (("simulate", "lost_propeller", "--to", "carrier-pigeon:1"), "carrier-pigeon"),
        (("simulate", "lost_propeller", *short, "-o", str(out), "--signals", str(out)), "no booms"),
        (("demo", "nothing"), "neither a file nor one of"),
    ):
        refused = run(*arguments)
        assert refused.returncode == 2, arguments
        assert words in refused.stderr
        assert len(refused.stderr.splitlines()) == 1
        assert "Traceback" not in refused.stderr


def test_boom_tips_are_written_beside_the_log(tmp_path: Path) -> None:
    np = pytest.importorskip("numpy")
    signals = tmp_path / "booms.npz"
    short = ("trajectory.duration=4", "trajectory.height=1", "trajectory.lands=false", "fault=[]")
    changes = [part for change in short for part in ("--set", change)]
    done = run(
        "simulate", "degraded_rotor", *changes, "-o", str(tmp_path / "b.tlog"), "--signals", str(signals)
    )
    assert done.returncode == 0, done.stderr
    tips = np.load(signals)
    assert tips["boom_tip_acceleration"].shape == (40_000, 6)
    assert float(tips["rate"]) == 10_000.0
