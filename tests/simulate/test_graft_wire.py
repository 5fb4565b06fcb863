"""What a graft writes: nothing it need not, commands and ESC_INFO with the rest, and no fault the log cannot show."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_health.cli import main
from gcs_health.errors import ConfigError
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.encoder import pack, pack_v2
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.samples import EscInfo, EscStatus, Outputs
from gcs_health.simulate.detect import DRAGS, SHAKES, SLOW_WINDOW, Course, faults, median_interval, moments
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.graft import Graft
from gcs_health.simulate.graft_commands import learned
from gcs_health.simulate.graft_fault import GraftFault, parse_fault
from gcs_health.simulate.recording import Flown, first_pass, read_frames, repacked, unpacked, with_times
from gcs_health.simulate.scenario import load_scenario
from gcs_health.vehicle_file import load_vehicle

DIALECT = default_dialect()
DATA = Path(__file__).parents[3] / "shared" / "data"
Frames = list[tuple[int, bytes]]


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> tuple[Frames, Flown, Path]:
    path = tmp_path_factory.mktemp("healthy") / "healthy.tlog"
    changes = ["trajectory.height=3", "trajectory.duration=26", "trajectory.lands=false"]
    frames = Flight(load_scenario("healthy_quad", changes)).run()
    path.write_bytes(b"".join(record(stamp, raw) for stamp, raw in frames))
    read = read_frames(str(path))
    return read, first_pass(str(path), read, None), path


def test_only_the_messages_that_a_loss_touches_are_edited(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, flown, _ = healthy
    edited = Graft(flown, parse_fault("rotor=3 effectiveness=0.5 at=15")).frames(frames)
    assert [stamp for stamp, _ in edited] == [stamp for stamp, _ in frames]
    names = set()
    for (_, before), (_, after) in zip(frames, edited, strict=True):
        assert after[4:10] == before[4:10]  # sequence, sender, message
        if before != after:
            names.add(DIALECT.name(before[7] | before[8] << 8))
    assert names == {"HIGHRES_IMU", "ATTITUDE", "ESC_STATUS", "SERVO_OUTPUT_RAW"}


def test_bytes_that_our_dialect_does_not_know_or_a_sender_does_not_cut_stay() -> None:
    message = DIALECT.messages[291]
    fields = {"time_usec": 7, "rpm": [1, 2, 3, 4], "index": 0}
    raw = pack(message, unpackable(fields), 9, 1, 1)
    body = unpackable(fields)
    for payload in (body + b"\x05\x06", body + b"\0\0", body):
        like = pack_v2(message, payload, raw)
        assert repacked(message, like, unpacked(message, like)) == like
        changed = unpacked(message, like)
        changed["rpm"][3] = 40
        after = repacked(message, like, changed)
        assert len(after) == len(like)
        assert unpacked(message, after)["rpm"] == [1, 2, 3, 40]
        assert after[10 + message.size : -2] == payload[message.size :]


def unpackable(fields: dict[str, object]) -> bytes:
    from gcs_health.mavlink.encoder import payload_of

    return payload_of(DIALECT.messages[291], fields)


def test_motor_outputs_follow_the_rotors(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, flown, _ = healthy
    (slope,) = [commands.slope for commands in learned(flown).values()]
    graft = Graft(flown, parse_fault("rotor=3 effectiveness=0.7 at=15"))
    edited = graft.frames(frames)
    before, after = (
        {r.t: r.sample for r in with_times(log, DIALECT) if isinstance(r.sample, Outputs)}
        for log in (frames, edited)
    )
    late = [t for t in before if t > flown.first_t + 18.0]
    raised = np.mean([after[t].value[2] - before[t].value[2] for t in late])
    speed = np.mean(flown.speed[flown.rotor_t > flown.first_t + 18.0, 2])
    assert raised == pytest.approx(slope * speed * (math.sqrt(1.0 / 0.7) - 1.0), rel=0.05)
    assert raised > 50.0  # PWM µs
    assert all(after[t] == before[t] for t in before if t < flown.first_t + 15.0)
    assert all(value <= 2000.0 for t in late for value in after[t].value if value == value)


def test_outputs_without_a_line_stay_and_it_is_said(healthy: tuple[Frames, Flown, Path]) -> None:
    flown = healthy[1]
    noise = np.random.default_rng(1).uniform(1100.0, 1900.0, (300, 4))
    blind = replace(flown, outputs={36: (np.linspace(flown.rotor_t[0], flown.rotor_t[-1], 300), noise)})
    assert learned(blind) == {}
    graft = Graft(blind, parse_fault("rotor=3 effectiveness=0.7 at=15"))
    assert any("motor outputs stay as recorded" in note for note in graft.notes)


def test_a_deep_loss_says_how_far_it_is_to_be_believed(healthy: tuple[Frames, Flown, Path]) -> None:
    notes = Graft(healthy[1], parse_fault("rotor=3 effectiveness=0.3 at=15")).notes
    assert any("first second" in note for note in notes)
    assert any("times the fastest speed" in note for note in notes)
    assert Graft(healthy[1], parse_fault("rotor=3 effectiveness=0.9 at=15")).notes == []


def test_what_the_log_does_not_hold_cannot_fail(healthy: tuple[Frames, Flown, Path]) -> None:
    flown = replace(healthy[1], powered=frozenset({0, 1}), reported=frozenset({0, 2}))
    for text, words in (
        ("rotor=3 drag=1.5 at=5", "drag: the log has no current of motor 3's ESC"),
        ("rotor=2 telemetry=lost at=5", "telemetry: the log has no ESC telemetry of motor 2"),
        ("rotor=1 telemetry=swapped with=4 at=5", "no ESC telemetry of motor 4"),
        ("rotor=1 telemetry=swapped with=9 at=5", "with: the vehicle has motors 1, 2, 3, 4, got 9"),
    ):
        with pytest.raises(ConfigError, match=words):
            Graft(flown, parse_fault(text))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rotor=3 effectiveness=0.6 at=5 until=4", "until: expected a time after at=5"),
        ("rotor=3 effectiveness=0.6 at=5 loop=3", "loop: expected the rate loop's time from 0.03 to 0.5"),
        ("rotor=3 drag=2 at=5 loop=0.1", "loop: only a loss of effectiveness"),
    ],
)
def test_times_that_make_no_sense_are_refused(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_fault(text)
    assert words in str(caught.value)


def test_a_signed_log_is_refused(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, flown, _ = healthy
    signed = []
    for stamp, raw in frames:
        body = bytes((raw[1], 1)) + raw[3:-2]
        extra = DIALECT.crc_extra[raw[7] | raw[8] << 8 | raw[9] << 16]
        signed.append((stamp, raw[:1] + body + crc(body, extra) + bytes(13)))
    with pytest.raises(ConfigError, match="the log is signed"):
        Graft(flown, parse_fault("rotor=3 effectiveness=0.6 at=15")).frames(signed)


def crc(body: bytes, extra: int) -> bytes:
    from fastcrc.crc16 import mcrf4xx

    return mcrf4xx(body + bytes((extra,))).to_bytes(2, "little")


def test_a_lost_esc_is_offline_and_comes_back(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, flown, _ = healthy
    edited = Graft(flown, parse_fault("rotor=2 telemetry=lost at=15 until=18")).frames(frames)
    for r, (_, before) in zip(with_times(edited, DIALECT), frames, strict=True):
        gone = 15.0 <= r.t - flown.first_t < 18.0
        if isinstance(r.sample, EscInfo):
            assert r.sample.online == (0b1101 if gone else 0b1111)
            assert gone or r.raw == before
        elif isinstance(r.sample, EscStatus):
            assert (r.sample.speed[1] == 0.0 and r.sample.voltage[1] == 0.0) is gone
            assert all(r.sample.speed[k] > 0.0 for k in (0, 2, 3)) or r.t < flown.first_t + 2.0
            assert gone or r.raw == before
        else:
            assert r.raw == before


def test_a_trial_is_what_replaying_the_whole_graft_gives(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, flown, path = healthy
    course = Course(str(path), frames, None)
    assert course.choose(2, np.random.default_rng(3)) == 2
    for start, at in enumerate(course.starts):
        fault = GraftFault(4, "effectiveness", at - flown.first_t, 0.4)
        monitor = Monitor(MonitorConfig())
        events = [e for stamp, raw in Graft(flown, fault).frames(frames) for e in monitor.feed(raw, stamp)]
        alert = next(e for e in events if isinstance(e, AlertEvent))
        trial = course.trial(start, fault)
        assert trial.named == alert.motor == 4
        assert trial.found
        assert trial.delay == pytest.approx(alert.t - at, abs=1e-9)
        assert course.trial(start, fault) == trial


def test_moments_need_an_open_gate_behind_them() -> None:
    opened = np.concatenate([np.arange(0.0, 2.0, 0.02), np.arange(3.0, 3.5, 0.02)])
    found = moments(opened)
    assert 1.2 < found.max() < 1.5
    assert len(moments(opened[:5])) == 0


def test_the_ladder_shakes_and_drags_too(healthy: tuple[Frames, Flown, Path]) -> None:
    frames, flown, path = healthy
    rungs = {(rung.effect, rung.size): rung for rung in faults(flown) if rung.effect in ("unbalance", "drag")}
    assert {size for effect, size in rungs if effect == "drag"} == set(DRAGS)
    assert {size for effect, size in rungs if effect == "unbalance"} == set(SHAKES)
    # sized by acceleration: a flight without a known mass shakes as much as one with any
    weighed = replace(flown, airframe=replace(flown.airframe, mass=2.0))
    usual = float(np.median(np.interp(flown.opened, flown.rotor_t, flown.speed.mean(axis=1))))
    fault = next(r for r in faults(weighed) if r.effect == "unbalance" and r.size == 2.0).faults[0]
    assert fault.size * usual**2 / 2.0 == pytest.approx(2.0)
    course = Course(str(path), frames, None)
    course.choose(1, np.random.default_rng(3))
    assert all(at + 0.9 * SLOW_WINDOW < flown.opened[-1] for at in course.slow_starts)
    assert course.starts_for("drag") is course.slow_starts
    assert course.starts_for("effectiveness") is course.starts


def test_the_medians_interval() -> None:
    assert math.isnan(median_interval([1.0] * 5)[0])
    assert median_interval([float(k) for k in range(10)]) == (1.0, 8.0)  # 97.9 %, the tables' ranks 2 and 9


def test_the_table_as_json_lines(
    healthy: tuple[Frames, Flown, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "d.jsonl"
    only = ["--trials", "1", "--only", "effectiveness", "--only", "telemetry"]
    assert main(["detectability", str(healthy[2]), *only, "--jsonl", str(out)]) == 0
    head, *rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert head["schema"] == "gcs_health.detectability/1"
    assert head["starts"] == 1
    row = next(r for r in rows if r["size"] == 0.4 and r["motor"] is None)
    assert (row["trials"], row["wrong"]) == (4, 0)
    assert row["found"] >= 3
    assert row["found_low"] < row["found"] / 4 <= row["found_high"] + 1e-9
    assert {r["fault"] for r in rows} == {
        "effectiveness",
        "telemetry lost",
        "telemetry frozen",
        "telemetry swapped",
    }
    assert "0.4 left" in capsys.readouterr().out
    assert main(["detectability", str(healthy[2]), *only, "--jsonl", "-"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out.splitlines()[0]) == head
    assert "0.4 left" in said.err


@pytest.mark.skipif(not DATA.is_dir(), reason="the real flights are not here")
@pytest.mark.parametrize(
    ("flight", "vehicle"), [("indiflight_00230", "indiflight"), ("nanodrone_square_run3", "nanodrone")]
)
def test_a_large_loss_in_a_real_flight_is_found_on_the_right_motor(flight: str, vehicle: str) -> None:
    path = DATA / f"{flight}.tlog"
    course = Course(str(path), read_frames(str(path)), load_vehicle(DATA / "vehicles" / f"{vehicle}.toml"))
    course.choose(2, np.random.default_rng(5))
    trials = [
        course.trial(start, GraftFault(motor, "effectiveness", 0.0, 0.4))
        for start in range(len(course.starts))
        for motor in (1, 2, 3, 4)
    ]
    assert sum(trial.found for trial in trials) >= 6
    assert all(trial.named in (0, trial.motor) for trial in trials)
    assert learned(course.flown)  # and its outputs follow its rotors


@pytest.mark.skipif(not DATA.is_dir(), reason="the real flights are not here")
def test_a_real_flight_without_current_cannot_show_drag() -> None:
    path = DATA / "indiflight_00258.tlog"
    vehicle = load_vehicle(DATA / "vehicles" / "indiflight.toml")
    flown = first_pass(str(path), read_frames(str(path)), vehicle)
    with pytest.raises(ConfigError, match="no current of motor 2"):
        Graft(flown, parse_fault("rotor=2 drag=2 at=5"))
