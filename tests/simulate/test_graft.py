"""Faults put into recorded flights: edits exact where they can be, honest where they are a model, else refused."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from gcs_health.cli import main
from gcs_health.cli.detectability import wilson
from gcs_health.errors import ConfigError, LogError
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.samples import EscStatus, EscTelemetry, Imu
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.graft import Graft
from gcs_health.simulate.graft_fault import parse_fault
from gcs_health.simulate.recording import (
    Flown,
    first_pass,
    is_signed,
    read_frames,
    repacked,
    unpacked,
    with_times,
)
from gcs_health.simulate.scenario import load_scenario

DIALECT = default_dialect()
SHORT = ["trajectory.height=3", "trajectory.duration=26", "trajectory.lands=false"]
DATA = Path(__file__).parents[3] / "shared" / "data"
Frames = list[tuple[int, bytes]]


def flown(tmp: Path, *changes: str) -> tuple[Frames, Flown, Path]:
    path = tmp / "healthy.tlog"
    scenario = load_scenario("healthy_quad", [*SHORT, *changes])
    path.write_bytes(b"".join(record(stamp, frame) for stamp, frame in Flight(scenario).run()))
    frames = read_frames(str(path))
    return frames, first_pass(str(path), frames, None), path


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> tuple[Frames, Flown, Path]:
    return flown(tmp_path_factory.mktemp("healthy"))


def samples(frames: Frames, kind: type) -> list[tuple[float, object]]:
    return [(r.t, r.sample) for r in with_times(frames, DIALECT) if isinstance(r.sample, kind)]


def test_unpacking_and_packing_a_frame_changes_nothing(healthy: tuple[Frames, Flown, Path]) -> None:
    for _, raw in healthy[0][:3000]:
        message = DIALECT.messages[raw[7] | raw[8] << 8 | raw[9] << 16]
        assert repacked(message, raw, unpacked(message, raw)) == raw
        assert not is_signed(raw)


def test_a_mavlink_1_frame_stays_one() -> None:
    from pymavlink.dialects.v20 import all as stock

    link = stock.MAVLink(None, srcSystem=1, srcComponent=1)
    raw = bytes(stock.MAVLink_raw_imu_message(1, *range(9)).pack(link, force_mavlink1=True))
    message = DIALECT.messages[27]
    assert repacked(message, raw, unpacked(message, raw)) == raw


@pytest.mark.parametrize("healthy_fault", ["rotor=2 effectiveness=1 at=15", "rotor=2 drag=1 at=15"])
def test_no_fault_is_no_edit(healthy: tuple[Frames, Flown, Path], healthy_fault: str) -> None:
    frames, known, _ = healthy
    graft = Graft(known, parse_fault(healthy_fault))
    assert graft.frames(frames) == frames
    assert graft.edited == 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rotor=3 effectiveness=0.2 at=5", "effectiveness: expected what is left, from 0.3 to 1"),
        ("rotor=3 effectiveness=0.2 at=5", "gcs-health simulate can fly it"),
        ("effectiveness=0.6 at=5", "rotor: is missing"),
        ("rotor=3 effectiveness=0.6", "at: is missing"),
        ("rotor=0 effectiveness=0.6 at=5", "rotor: expected a motor number from 1 on"),
        ("rotor=3 at=5", "expected one of effectiveness, unbalance, drag, telemetry, got none"),
        ("rotor=3 drag=2 unbalance=3 at=5", "got unbalance, drag"),
        ("rotor=3 effectivness=0.6 at=5", "did you mean effectiveness?"),
        ("rotor=3 effectiveness=lots at=5", "effectiveness: expected a number"),
        ("rotor=3 effectiveness=0.6 at=-5", "at: expected a number from 0 on"),
        ("rotor=3 rotor=2 effectiveness=0.6 at=5", "rotor: given twice"),
        ("rotor=3 telemetry=gone at=5", "telemetry: expected one of lost, frozen, swapped"),
        ("rotor=3 telemetry=swapped at=5", "with: is missing"),
        ("rotor=3 telemetry=swapped with=3 at=5", "cannot be swapped with itself"),
        ("rotor=3 drag=0.5 at=5", "drag: expected a factor"),
        ("rotor=3 drag=2 with=4 at=5", "with: only telemetry=swapped"),
        ("rotor=3 telemetry=lost ramp=3 at=5", "ramp: telemetry is there or it is not"),
        ("nonsense", "expected key=value"),
    ],
)
def test_a_fault_that_cannot_be_grafted_is_refused_in_one_line(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_fault(text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_does_not_fit_the_flight_is_refused(healthy: tuple[Frames, Flown, Path]) -> None:
    _, known, _ = healthy
    for text, words in (
        ("rotor=5 effectiveness=0.6 at=5", "motors 1, 2, 3, 4, got 5"),
        ("rotor=1 effectiveness=0.6 at=500", "after the end, the flight lasts 26 s"),
        ("rotor=1 unbalance=20 at=5", "needs the mass"),
    ):
        with pytest.raises(ConfigError, match=words):
            Graft(known, parse_fault(text))


def test_a_flight_with_an_alarm_or_without_geometry_is_no_ground_to_graft_on(tmp_path: Path) -> None:
    path = tmp_path / "lost.tlog"
    path.write_bytes(b"".join(record(a, b) for a, b in Flight(load_scenario("demo")).run()))
    with pytest.raises(LogError, match="not a healthy flight"):
        first_pass("lost.tlog", read_frames(str(path)), None)
    frames = [(a, b) for a, b in read_frames(str(path)) if b[7] != 22]  # no PARAM_VALUE
    with pytest.raises(LogError, match=r"geometry is only assumed|no vehicle whose geometry"):
        first_pass("bare.tlog", frames[:1200], None)


def test_the_controllers_answer_is_that_of_a_simulated_one(tmp_path: Path) -> None:
    """Grafted and simulated from the same seed: a second later the rotors turn alike."""
    calm = ["trajectory.kind=hover", "wind.speed=0", "wind.turbulence=none", "fault=[]"]
    frames, known, _ = flown(tmp_path, *calm)
    grafted = Graft(known, parse_fault("rotor=3 effectiveness=0.7 at=14.9")).frames(frames)
    fault = "fault=[{kind='effectiveness', motor=3, at=15.0, size=0.7}]"
    scenario = load_scenario("healthy_quad", [*SHORT, *calm[:3], fault])
    simulated = list(Flight(scenario).run())

    def settled(log: Frames) -> np.ndarray:
        speeds = [sample.speed for t, sample in samples(log, EscStatus) if 22.0 < t < 26.0]
        return np.mean(speeds, axis=0)

    healthy_speed = settled(frames)
    assert settled(simulated)[2] > 1.1 * healthy_speed[2]
    np.testing.assert_allclose(settled(grafted), settled(simulated), rtol=0.02)


def test_a_large_graft_is_found_on_the_right_motor(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, known, _ = healthy
    for motor in (1, 2, 3, 4):
        at = float(known.opened[len(known.opened) // 2])
        fault = parse_fault(f"rotor={motor} effectiveness=0.4 at={at - known.first_t}")
        monitor = Monitor(MonitorConfig())
        events = [e for stamp, raw in Graft(known, fault).frames(frames) for e in monitor.feed(raw, stamp)]
        (alert, *_) = [event for event in events if isinstance(event, AlertEvent)]
        assert alert.motor == motor
        assert 0.0 < alert.t - at < 1.5


def test_an_unbalance_turns_with_its_rotor(tmp_path: Path) -> None:
    """m_u r_u w² / m through PX4's mean of 5 ms, at the rotor's own phase."""
    frames, known, _ = flown(tmp_path, "telemetry.rates.HIGHRES_IMU=200")
    from dataclasses import replace

    known = replace(known, airframe=replace(known.airframe, mass=0.5))
    graft = Graft(known, parse_fault("rotor=2 unbalance=3 at=12"))
    edited = graft.frames(frames)
    before, after = (samples(log, Imu) for log in (frames, edited))
    pairs = [(t, a.ax - b.ax, a.ay - b.ay) for (t, b), (_, a) in zip(before, after, strict=True)]
    late = np.array([(x, y) for t, x, y in pairs if t > known.first_t + 12.0])
    speed = np.mean(known.speed[known.rotor_t > known.first_t + 12.0, 1])
    half = 0.5 * speed / 200.0
    expected = 3e-6 * speed**2 / 0.5 * math.sin(half) / half
    assert np.hypot(*late.T).mean() == pytest.approx(expected, rel=0.02)
    assert expected > 0.5
    early = [(x, y) for t, x, y in pairs if t < known.first_t + 12.0]
    assert not np.any(early)
    assert abs(graft.response(125.0, 27)) == pytest.approx(1 / math.sqrt(2), abs=0.01)  # 20 Hz, ArduPilot


def test_drag_raises_the_current_of_that_motor_alone(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, known, _ = healthy
    edited = Graft(known, parse_fault("rotor=4 drag=1.5 at=15 ramp=2")).frames(frames)
    for (t, a), (_, b) in zip(samples(frames, EscStatus), samples(edited, EscStatus), strict=True):
        since = t - known.first_t - 15.0
        factor = 1.0 + 0.5 * min(max(since / 2.0, 0.0), 1.0)
        assert b.current[3] == pytest.approx(factor * a.current[3], abs=0.02)
        assert b.current[:3] == a.current[:3]
        assert b.speed == a.speed


def test_telemetry_faults_are_exact(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, known, _ = healthy
    at = known.first_t + 15.0

    def speeds(fault: str) -> list[tuple[float, tuple[float, ...]]]:
        edited = Graft(known, parse_fault(fault)).frames(frames)
        return [(t, sample.speed) for t, sample in samples(edited, EscStatus)]

    truth = [(t, sample.speed) for t, sample in samples(frames, EscStatus)]
    last = [speed for t, speed in truth if t < at][-1]
    for (t, true), (_, lost), (_, frozen), (_, swapped) in zip(
        truth,
        speeds("rotor=2 telemetry=lost at=15"),
        speeds("rotor=2 telemetry=frozen at=15"),
        speeds("rotor=2 telemetry=swapped with=3 at=15"),
        strict=True,
    ):
        a, b, c, d = true
        assert lost == (true if t < at else (a, 0.0, c, d))
        assert frozen == (true if t < at else (a, last[1], c, d))
        assert swapped == (true if t < at else (a, c, b, d))


def test_ardupilot_holds_a_lost_escs_speed_for_a_second(tmp_path: Path) -> None:
    changes = ["telemetry.autopilot=ardupilot", "telemetry.rates={}", "vehicle=ghalamchi_medium"]
    frames, known, _ = flown(tmp_path, *changes)
    edited = Graft(known, parse_fault("rotor=2 telemetry=lost at=15")).frames(frames)
    after = [(t, s) for t, s in samples(edited, EscTelemetry) if t > known.first_t + 15.0]
    assert all(s.speed[1] > 100.0 for t, s in after if t < known.first_t + 15.9)
    assert all(s.speed[1] == 0.0 for t, s in after if t > known.first_t + 16.2)
    assert len({s.count[1] for _, s in after}) == 1
    assert len({s.count[0] for _, s in after}) > 10


def test_the_commands(
    healthy: tuple[Frames, Flown, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = healthy[2], tmp_path / "faulty.tlog"
    assert main(["graft", str(path), "--fault", "rotor=3 effectiveness=0.4 at=18", "-o", str(out)]) == 0
    assert "frames edited" in capsys.readouterr().out
    truth = json.loads((tmp_path / "faulty.truth.json").read_text())["truth"]
    assert truth["rotor"] == 3
    assert truth["label_time_s"] == pytest.approx(18.0, abs=0.1)
    assert main(["replay", str(out)]) == 0
    assert "raised: motor 3" in capsys.readouterr().out
    assert main(["graft", str(path), "--fault", "rotor=3 effectiveness=0.1 at=18", "-o", str(out)]) == 2
    assert main(["graft", str(path), "--fault", "rotor=3 effectiveness=0.4 at=18", "-o", str(path)]) == 2
    assert main(["graft", str(tmp_path / "no.tlog"), "--fault", "rotor=3 drag=2 at=1", "-o", str(out)]) == 2
    capsys.readouterr()
    assert main(["detectability", str(path), "--trials", "2", "--only", "effectiveness"]) == 0
    table = capsys.readouterr().out
    row = next(line for line in table.splitlines() if line.startswith("0.4"))
    assert "8/8" in row


def test_wilsons_interval() -> None:
    assert wilson(8, 8) == pytest.approx((0.676, 1.0), abs=1e-3)
    assert wilson(0, 40) == pytest.approx((0.0, 0.0876), abs=1e-3)
    assert wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-3)
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.skipif(not DATA.is_dir(), reason="the real flights are not here")
def test_a_graft_into_a_real_flight_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = str(DATA / "vehicles" / "indiflight.toml")
    out = tmp_path / "g.tlog"
    flight = str(DATA / "indiflight_00230.tlog")
    assert (
        main(
            [
                "graft",
                flight,
                "--vehicle",
                vehicle,
                "--fault",
                "rotor=2 effectiveness=0.4 at=12",
                "-o",
                str(out),
            ]
        )
        == 0
    )
    capsys.readouterr()
    assert main(["replay", str(out), "--vehicle", vehicle]) == 0
    assert "raised: motor 2" in capsys.readouterr().out
