"""What the simulated autopilots say, read back by our own decoder and monitor."""

import math
from collections import Counter

import numpy as np
import pytest

from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.messages import MessageDecoder
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.samples import Attitude, AttitudeTarget, EscStatus, EscTelemetry, Imu, Parameter, Sample
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.link import Air
from gcs_health.simulate.scenario import Link, load_scenario
from gcs_health.vehicle_monitor import VehicleMonitor

DIALECT = default_dialect()
DECODER = MessageDecoder(DIALECT)
SHORT = ["trajectory.kind=hover", "trajectory.height=3", "trajectory.lands=false", "trajectory.duration=8"]


def flight(name: str, *changes: str) -> Flight:
    return Flight(load_scenario(name, [*SHORT, *changes]), DIALECT)


def frames_of(one: Flight) -> list[tuple[int, bytes]]:
    return list(one.run())


def samples_of(frames: list[tuple[int, bytes]]) -> list[Sample]:
    decoder = FrameDecoder(DIALECT, stamped=False)
    return [sample for stamp, frame in frames for sample in DECODER.samples(decoder.feed(frame, stamp))]


def watched(frames: list[tuple[int, bytes]]) -> VehicleMonitor:
    monitor = Monitor(MonitorConfig(stamped=True))
    monitor.feed(b"".join(record(stamp, frame) for stamp, frame in frames))
    monitor.finish()
    return monitor.vehicles()[0]


@pytest.mark.parametrize(
    ("autopilot", "words"),
    [
        ("px4_g1", "first generation"),
        ("px4_g2", "second or third generation|second generation"),
        ("px4_g3", "third generation"),
    ],
)
def test_each_generation_of_esc_status_is_told_by_the_monitor(autopilot: str, words: str) -> None:
    vehicle = watched(
        frames_of(flight("healthy_quad", "vehicle=octocopter", f"telemetry.autopilot={autopilot}"))
    )
    note = " ".join(vehicle.rotors.notes())
    assert any(word in note for word in words.split("|")), note


@pytest.mark.parametrize("name", ["bebop2", "ghalamchi_large", "octocopter"])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_parameters_tell_the_true_geometry(name: str, autopilot: str) -> None:
    changes = [f"vehicle={name}", f"telemetry.autopilot={autopilot}"]
    scenario = load_scenario(
        "ardupilot_quad", [*SHORT, *changes, "fault.0.at=7", "link.loss=0", "link.burst_loss=0"]
    )
    vehicle = watched(frames_of(Flight(scenario, DIALECT)))
    assert vehicle.airframe is not None
    assert vehicle.airframe.source.value == "parameters"
    mine = np.array([rotor.position[:2] for rotor in scenario.vehicle.rotors])
    seen = np.array([rotor.position[:2] for rotor in vehicle.airframe.rotors])
    # ArduPilot's tables have no scale, and know an X no longer than wide
    np.testing.assert_allclose(seen / np.abs(seen).max(), mine / np.abs(mine).max(), atol=0.25)
    assert [r.spin for r in vehicle.airframe.rotors] == [r.spin for r in scenario.vehicle.rotors]


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_hover_reads_as_hover(autopilot: str) -> None:
    one = flight("healthy_quad", f"telemetry.autopilot={autopilot}", "telemetry.rates={}", "spread.thrust=0")
    samples = samples_of(frames_of(one))
    imu = [sample for sample in samples if isinstance(sample, Imu)][-60:]
    assert np.mean([sample.az for sample in imu]) == pytest.approx(-9.8, abs=0.3)
    escs = [sample for sample in samples if isinstance(sample, EscStatus | EscTelemetry)][-20:]
    hover = one.scenario.vehicle.hover
    assert np.mean([sample.speed for sample in escs]) == pytest.approx(hover, rel=0.05)
    names = Counter(type(sample).__name__ for sample in samples)
    assert names["Heartbeat"] == pytest.approx(8, abs=1)
    assert names["LandedState"] >= 7


def esc_speeds(autopilot: str, fault: str) -> np.ndarray:
    """Speeds of motor 2's slot and of motor 3's over the flight, one row a message."""
    changes = [f"fault=[{{{fault}}}]", f"telemetry.autopilot={autopilot}", "telemetry.rates={}"]
    samples = samples_of(frames_of(flight("esc_telemetry_lost", *changes)))
    return np.array([s.speed for s in samples if isinstance(s, EscStatus | EscTelemetry)])


def test_lost_frozen_and_swapped_esc_telemetry() -> None:
    lost = esc_speeds("px4", "kind='esc_lost', motor=2, at=6.0")
    assert (lost[-10:, 1] == 0.0).all()
    assert (lost[-10:, [0, 2, 3]] > 100.0).all()
    frozen = esc_speeds("px4", "kind='esc_frozen', motor=2, at=6.0")
    assert len(set(frozen[-10:, 1])) == 1
    assert len(set(frozen[-10:, 2])) > 1
    silent = esc_speeds("ardupilot", "kind='esc_lost', motor=2, at=6.0")
    assert silent[-15, 1] > 100.0  # ArduPilot holds a speed for a second
    assert (silent[-4:, 1] == 0.0).all()
    straight = esc_speeds("px4", "kind='esc_lost', motor=4, at=7.9")
    swapped = esc_speeds("px4", "kind='esc_swapped', motor=2, size=3, at=0.0")
    np.testing.assert_array_equal(swapped[:60, [2, 1]], straight[:60, [1, 2]])


def test_what_a_ground_station_asks_is_answered() -> None:
    one = flight("healthy_quad", "telemetry.rates={}", "trajectory.duration=60", "trajectory.lands=true")
    station = Encoder(DIALECT, 255, 190)
    while one.world.t < 3.0:
        one.step()
    one.arrived()

    def answers(request: bytes, seconds: float = 1.0) -> list[Sample]:
        one.receive(request)
        until = one.world.t + seconds
        while one.world.t < until:
            one.step()
        return samples_of(one.arrived())

    def acknowledged(samples: list[Sample], command: int) -> int:
        return next(s.fields["result"] for s in samples if s.message == 77 and s.fields["command"] == command)

    everything = [
        s for s in answers(station.frame("PARAM_REQUEST_LIST", target_system=1)) if isinstance(s, Parameter)
    ]
    assert len({s.name for s in everything}) == len(everything) >= 20
    named = answers(station.frame("PARAM_REQUEST_READ", param_id="CA_ROTOR_COUNT", param_index=-1))
    (count,) = [s for s in named if isinstance(s, Parameter)]
    assert (count.name, count.number) == ("CA_ROTOR_COUNT", 4.0)

    def interval(message: int, us: float) -> bytes:
        return station.frame("COMMAND_LONG", target_system=1, command=511, param1=message, param2=us)

    faster = answers(interval(105, 5000.0))
    assert acknowledged(faster, 511) == 0
    assert sum(isinstance(s, Imu) for s in faster) == pytest.approx(200, abs=12)
    silent = answers(interval(105, -1.0), 0.5)
    assert sum(isinstance(s, Imu) for s in silent) <= 2
    usual = answers(interval(105, 0.0))
    assert acknowledged(usual, 511) == 0
    assert sum(isinstance(s, Imu) for s in usual) == pytest.approx(50, abs=3)
    assert acknowledged(answers(interval(9999, 1e5)), 511) == 4
    asked = station.frame("COMMAND_LONG", target_system=1, command=512, param1=244, param2=105)
    (told,) = [s.fields for s in answers(asked) if s.message == 244]
    assert (told["message_id"], told["interval_us"]) == (105, 20_000)
    elsewhere = station.frame("COMMAND_LONG", target_system=7, command=511, param1=105, param2=-1.0)
    silence = answers(elsewhere)
    assert not any(s.message == 77 for s in silence)
    assert sum(isinstance(s, Imu) for s in silence) > 40
    version = answers(station.frame("COMMAND_LONG", target_system=1, command=512, param1=148))
    assert acknowledged(version, 512) == 0
    assert any(s.message == 148 for s in version)
    assert acknowledged(answers(station.frame("COMMAND_LONG", command=400, param1=1)), 400) == 3


def sent_over(link: Link, count: int = 20_000) -> list[tuple[float, int]]:
    air = Air(link, np.random.default_rng(1))
    out = []
    for k in range(count):
        air.send(k * 0.01, k.to_bytes(4, "big"))
        out += air.arrived(k * 0.01)
    out += air.arrived(math.inf)
    return [(t, int.from_bytes(frame, "big")) for t, frame in out]


def test_a_plain_link_only_delays() -> None:
    got = sent_over(Link(), 100)
    assert [k for _, k in got] == list(range(100))
    assert got[5][0] == pytest.approx(0.05 + 0.004)


def test_a_poor_link_loses_delays_doubles_and_reorders_as_told() -> None:
    count = 20_000
    assert len(sent_over(Link(loss=0.1))) == pytest.approx(0.9 * count, rel=0.01)
    burst = [k for _, k in sent_over(Link(burst_loss=0.05, burst=10.0))]
    assert len(burst) == pytest.approx(0.95 * count, rel=0.02)
    gaps = np.diff(burst) - 1
    assert gaps[gaps > 0].mean() == pytest.approx(10.0, rel=0.15)
    assert len(sent_over(Link(duplicate=0.02))) == pytest.approx(1.02 * count, rel=0.005)
    jittered = sent_over(Link(jitter=0.01))
    assert [k for _, k in jittered] == list(range(count))
    mixed = np.array([k for _, k in sent_over(Link(reorder=0.05))])
    overtaken = np.count_nonzero(np.diff(mixed) < 0)
    assert overtaken == pytest.approx(0.05 * count, rel=0.15)


def test_an_unused_output_is_said_to_be_so_by_px4() -> None:
    for autopilot, unused in (("px4", 65535), ("ardupilot", 0)):
        one = flight("healthy_quad", f"telemetry.autopilot={autopilot}", "telemetry.rates={}")
        while one.world.t < 6.0:
            one.step()
        (frame,) = one._vehicle.telemetry.one("SERVO_OUTPUT_RAW")
        values = DIALECT.messages[36].layout.unpack(frame[10:-2].ljust(DIALECT.messages[36].size, b"\0"))
        at = [DIALECT.messages[36].positions[f"servo{k}_raw"][0] for k in range(1, 9)]
        assert [values[k] for k in at[4:]] == [unused] * 4
        assert all(1200 < values[k] < 1900 for k in at[:4])


def test_a_second_vehicle_on_the_port_is_another_vehicle() -> None:
    alone = samples_of(frames_of(flight("healthy_quad", "fault=[]")))
    both = samples_of(frames_of(flight("healthy_quad", "fault=[]", "link.second_system=true")))
    assert {s.system for s in both} == {1, 7}
    # the one flies and says what it would alone, the other as much of its own
    assert [s.speed for s in both if isinstance(s, EscStatus) and s.system == 1] == [
        s.speed for s in alone if isinstance(s, EscStatus)
    ]
    other = [s for s in both if s.system == 7]
    assert {type(s) for s in other} == {type(s) for s in alone}
    assert len(other) == pytest.approx(len(alone), rel=0.02)
    speeds = np.array([s.speed for s in other if isinstance(s, EscStatus)])
    assert speeds[-1].min() > 100.0
    assert speeds.tolist() != [list(s.speed) for s in alone if isinstance(s, EscStatus)]


def test_ardupilot_waits_to_be_asked_for_its_streams() -> None:
    one = flight(
        "ardupilot_quad", "telemetry.rates={}", "telemetry.requested=false", "trajectory.duration=60"
    )
    station = Encoder(DIALECT, 255, 190)

    def said(seconds: float) -> list[Sample]:
        until = one.world.t + seconds
        while one.world.t < until:
            one.step()
        return samples_of(one.arrived())

    assert {s.message for s in said(2.0)} == {0}

    def ask(stream: int, rate: int, start: int = 1) -> list[Sample]:
        one.receive(
            station.frame(
                "REQUEST_DATA_STREAM",
                target_system=1,
                req_stream_id=stream,
                req_message_rate=rate,
                start_stop=start,
            )
        )
        return said(2.0)

    raw = ask(1, 25)
    assert {s.message for s in raw} == {0, 27}
    assert sum(isinstance(s, Imu) for s in raw) == pytest.approx(50, abs=2)
    assert {s.message for s in ask(10, 4)} == {0, 27, 30, 11030}
    assert {s.message for s in ask(0, 2)} >= {0, 1, 2, 27, 30, 36, 147, 241, 11030}
    assert {s.message for s in ask(0, 0, 0)} <= {0, 27}  # the last ones were on their way


def test_px4_tells_what_its_onboard_stream_tells() -> None:
    samples = samples_of(frames_of(flight("healthy_quad", "telemetry.rates={}", "fault=[]")))
    span = 8.0
    for message, rate in ((105, 50.0), (83, 10.0), (241, 0.5), (111, 10.0), (291, 10.0), (245, 5.0)):
        count = sum(s.message == message for s in samples)
        assert count == pytest.approx(rate * span, rel=0.05, abs=1.0), message
    targets = [s for s in samples if isinstance(s, AttitudeTarget)]
    attitudes = [s for s in samples if isinstance(s, Attitude)]
    assert 0.2 < targets[-1].thrust < 0.9
    w, x, y, z = targets[-1].quaternion
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0, abs=1e-5)
    pitch = np.array([math.asin(2 * (s.quaternion[0] * s.quaternion[2])) for s in targets])
    flown = np.interp(
        [s.time_us for s in targets], [s.time_us for s in attitudes], [s.pitch for s in attitudes]
    )
    assert np.abs(pitch - flown)[-20:].max() < 0.2  # it follows what it is told


def test_frames_of_the_encoder_are_those_of_pymavlink() -> None:
    from pymavlink.dialects.v20 import all as stock

    ours = Encoder(DIALECT, 3, 4)
    theirs = stock.MAVLink(None, srcSystem=3, srcComponent=4)
    message = stock.MAVLink_attitude_message(5, 0.5, 0.25, -1.0, 0.0, 0.0, 2.0)
    fields = {"time_boot_ms": 5, "roll": 0.5, "pitch": 0.25, "yaw": -1.0, "yawspeed": 2.0}
    for seq in (0, 1):
        theirs.seq = seq
        assert ours.frame("ATTITUDE", **fields) == bytes(message.pack(theirs))
    text = stock.MAVLink_statustext_message(6, b"hello", 0, 0)
    theirs.seq = 2
    assert ours.frame("STATUSTEXT", severity=6, text="hello") == bytes(text.pack(theirs))
