"""What an ESC's numbers mean."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_health.airframe import Airframe, AirframeSource, Rotor
from gcs_health.rotor_telemetry import RotorState, RotorTelemetry
from gcs_health.samples import (
    CommandReading,
    EscInfo,
    EscStatus,
    EscTelemetry,
    Outputs,
    RotorReading,
    RotorRpm,
)

NAN = math.nan
NAN4 = (NAN, NAN, NAN, NAN)
Four = tuple[float, float, float, float]
TURNING: Four = (500.0, 510.0, 520.0, 530.0)
VOLTS: Four = (16.0, 16.0, 16.0, 16.0)
AMPS: Four = (5.0, 5.0, 5.0, 5.0)
ZERO: Four = (0.0, 0.0, 0.0, 0.0)


def craft(escs: tuple[int, ...]) -> Airframe:
    """Motor k + 1 on ESC escs[k]; positions are of no interest here."""
    rotors = tuple(Rotor(k + 1, esc, (0.0, 0.0, 0.0), 0) for k, esc in enumerate(escs))
    return Airframe("test", rotors, AirframeSource.FILE)


def telemetry(*escs: int) -> RotorTelemetry:
    rotors = RotorTelemetry()
    rotors.set_airframe(craft(escs or (0, 1, 2, 3)))
    return rotors


def px4(t: float, speed: Four, volts: Four = VOLTS, amps: Four = AMPS, index: int = 0) -> EscStatus:
    return EscStatus(1, 1, 291, 0, int(t * 1e6), index, speed, volts, amps)


def ardupilot(
    speed: Four, count: tuple[int, int, int, int], volts: Four = VOLTS, amps: Four = AMPS, index: int = 0
) -> EscTelemetry:
    return EscTelemetry(1, 1, 11030 + index // 4, 0, None, index, speed, volts, amps, ZERO, count, NAN4)


def info(index: int, online: int, count: int) -> EscInfo:
    return EscInfo(1, 1, 290, 0, 1, index, count, 1, 0, online, (0, 0, 0, 0), (0, 0, 0, 0), NAN4)


def reading(out: object) -> RotorReading:
    assert isinstance(out, RotorReading)
    return out


def same(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return len(a) == len(b) and all(x == y or (x != x and y != y) for x, y in zip(a, b, strict=True))


def with_one(four: Four, at: int, value: float) -> Four:
    a, b, c, d = (value if k == at else x for k, x in enumerate(four))
    return a, b, c, d


# -- PX4 ------------------------------------------------------------------------------------------


@given(st.permutations(range(4)))
def test_readings_are_in_rotor_order(order: list[int]) -> None:
    out = reading(telemetry(*order).feed(1.0, px4(1.0, TURNING, (1.0, 2.0, 3.0, 4.0), (5.0, 6.0, 7.0, 8.0))))
    assert out.t == 1.0
    assert out.speed == tuple(TURNING[esc] for esc in order)
    assert out.voltage == tuple(esc + 1.0 for esc in order)
    assert out.current == tuple(esc + 5.0 for esc in order)


def test_reverse_is_a_speed_and_impossible_speeds_are_none() -> None:
    out = reading(telemetry().feed(1.0, px4(1.0, (-500.0, 31000.0, NAN, math.inf))))
    assert same(out.speed, (500.0, NAN, NAN, NAN))


def test_without_an_airframe_nothing_comes_out_but_is_observed() -> None:
    rotors = RotorTelemetry()
    assert rotors.feed(1.0, px4(1.0, TURNING)) is None
    assert rotors.esc_indices() == (0, 1, 2, 3)
    assert rotors.state(2, 1.1) is RotorState.FRESH
    assert "cannot be told" in rotors.notes()[0]


@pytest.mark.parametrize("at", range(4))
def test_px4_zero_speed_at_zero_volts_is_no_data(at: int) -> None:
    rotors = telemetry()
    for k in range(20):
        rotors.feed(k * 0.1, px4(k * 0.1, TURNING))
    lost = px4(2.0, with_one(TURNING, at, 0.0), with_one(VOLTS, at, 0.0), with_one(AMPS, at, 0.0))
    out = reading(rotors.feed(2.0, lost))
    for values in (out.speed, out.voltage, out.current):
        assert [v != v for v in values] == [k == at for k in range(4)]
    assert rotors.state(at, 2.0) is RotorState.FRESH  # 0.1 s old
    assert rotors.state(at, 4.0) is RotorState.STALE
    assert rotors.state(at, 4.0) is not RotorState.STOPPED


@pytest.mark.parametrize("at", range(4))
def test_px4_zero_speed_under_volts_is_a_stopped_rotor(at: int) -> None:
    rotors = telemetry()
    rotors.feed(1.0, px4(1.0, TURNING))
    out = reading(rotors.feed(1.1, px4(1.1, with_one(TURNING, at, 0.0))))
    assert out.speed == with_one(TURNING, at, 0.0)
    assert rotors.state(at, 1.1) is RotorState.STOPPED


@pytest.mark.parametrize(("step", "lost"), [(0.01, True), (0.1, False)])
def test_px4_without_volts_a_zero_that_no_motor_can_reach_is_lost_data(step: float, lost: bool) -> None:
    rotors = telemetry()
    for k in range(120):
        rotors.feed(1.0 + step * k, px4(1.0 + step * k, TURNING, ZERO, ZERO))
    t = 1.0 + step * 120
    for k in range(5):
        speeds = (500.0, 0.0, 520.0 + k, 530.0)
        told = reading(rotors.feed(t + step * k, px4(t + step * k, speeds, ZERO, ZERO)))
        assert math.isnan(told.speed[1]) == lost
    told = reading(rotors.feed(t + step * 5, px4(t + step * 5, TURNING, ZERO, ZERO)))
    assert told.speed == TURNING  # it is back


def test_px4_without_volts_a_motor_that_runs_down_is_stopped() -> None:
    rotors = telemetry()
    for k, speed in enumerate((500.0, 480.0, 300.0, 160.0, 90.0, 30.0, 0.0, 0.0)):
        t = 1.0 + 0.01 * k
        told = reading(rotors.feed(t, px4(t, (500.0, speed, 520.0 + k, 530.0), ZERO, ZERO)))
        assert told.speed[1] == speed


def test_px4_without_volts_a_zero_is_true_once_the_esc_has_turned() -> None:
    rotors = telemetry()
    assert rotors.feed(0.9, px4(0.9, ZERO, ZERO, ZERO)) is None
    assert rotors.state(0, 1.0) is RotorState.NOT_REPORTED
    first = reading(rotors.feed(1.0, px4(1.0, (500.0, 500.0, 500.0, 0.0), ZERO, ZERO)))
    assert same(first.speed, (500.0, 500.0, 500.0, NAN))
    assert same(first.voltage, NAN4)
    assert same(first.current, NAN4)
    second = reading(rotors.feed(1.1, px4(1.1, (0.0, 500.0, 500.0, 0.0), ZERO, ZERO)))
    assert same(second.speed, (0.0, 500.0, 500.0, NAN))
    assert rotors.state(0, 1.1) is RotorState.STOPPED
    assert rotors.state(3, 1.1) is RotorState.NOT_REPORTED
    assert any("no ESC gives volts" in note for note in rotors.notes())


def test_px4_duplicates_are_not_news() -> None:
    rotors = telemetry()
    sample = px4(1.0, TURNING)
    assert rotors.feed(1.0, sample) is not None
    assert rotors.feed(1.0, sample) is None
    later = px4(1.1, TURNING)  # the same speeds at another time are news
    assert rotors.feed(1.1, later) is not None


def test_a_late_batch_passes_with_its_time() -> None:
    rotors = telemetry()
    for t in (1.0, 1.1, 1.3):
        rotors.feed(t, px4(t, TURNING))
    assert reading(rotors.feed(1.2, px4(1.2, (1.0, 2.0, 3.0, 4.0)))).t == 1.2
    assert rotors.state(0, 1.4) is RotorState.FRESH


def hexa(t: float, k: int) -> tuple[EscStatus, EscStatus]:
    low: Four = (500.0 + k, 510.0 + k, 520.0 + k, 530.0 + k)
    return px4(t, low), px4(t, (540.0 + k, 550.0 + k, 0.0, 0.0), (16.0, 16.0, 0.0, 0.0), index=4)


def test_px4_hexa_has_six_escs_in_two_batches() -> None:
    rotors = telemetry(0, 1, 2, 3, 4, 5)
    for k in range(10):
        low, high = hexa(k * 0.1, k)
        first = rotors.feed(k * 0.1, low)
        second = reading(rotors.feed(k * 0.1, high))
        if k == 0:  # that there are two batches is not known yet
            assert same(reading(first).speed, (*low.speed, NAN, NAN))
            assert same(second.speed, (*NAN4, *high.speed[:2]))
        else:  # one moment, one reading
            assert first is None
            assert same(second.speed, (*low.speed, *high.speed[:2]))
    assert rotors.esc_indices() == (0, 1, 2, 3, 4, 5)
    assert rotors.esc_count() == 6
    assert rotors.repeats == 0


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=12, max_size=60))
def test_px4_first_generation_has_four_escs_whatever_frames_are_lost(kept: list[tuple[bool, bool]]) -> None:
    """Every batch repeats ESC 0-3; frames of the lower batch are lost, so that the copy finds no equal."""
    kept = [(True, True)] * 20 + [(low or k % 3 > 0, high) for k, (low, high) in enumerate(kept)]
    rotors = telemetry(0, 1, 2, 3, 4, 5)
    for k, (low, high) in enumerate(kept):
        t, speed = k * 0.1, (500.0 + k, 510.0 + k, 520.0 + k, 530.0 + k)
        if low:
            assert same(reading(rotors.feed(t, px4(t, speed))).speed, (*speed, NAN, NAN))
        if high:
            assert rotors.feed(t, px4(t, speed, index=4)) is None
    assert rotors.esc_indices() == (0, 1, 2, 3)
    assert "first generation" in rotors.notes()[0]


def test_px4_send_times_differ_between_batches_of_the_third_generation() -> None:
    rotors = telemetry(0, 1, 2, 3, 4, 5)
    passed = []
    for k in range(10):
        low, high = hexa(k * 0.1, k)
        rotors.feed(k * 0.1, low)
        passed.append(rotors.feed(k * 0.1 + 0.001, high._replace(time_us=int(k * 1e5) + 1000)) is not None)
        rotors.feed(k * 0.1, info(0, 0b1111, 6))
        rotors.feed(k * 0.1, info(4, 0b11, 6))
    assert passed == [False, False] + [True] * 8
    assert "third generation" in rotors.notes()[0]


def test_px4_second_generation_is_told_by_absolute_online_bits() -> None:
    rotors = telemetry(0, 1, 2, 3, 4, 5)
    for k in range(10):
        for sample in hexa(k * 0.1, k):
            rotors.feed(k * 0.1, sample)
        rotors.feed(k * 0.1, info(4, 0b111111, 6))
    assert "second generation" in rotors.notes()[0]


def test_a_rotor_that_never_turned_counts_where_esc_info_counts_it() -> None:
    rotors = RotorTelemetry()
    rotors.feed(1.0, px4(1.0, (500.0, 500.0, 500.0, 0.0), ZERO, ZERO))
    assert rotors.esc_indices() == (0, 1, 2)
    rotors.feed(1.0, info(0, 0b1111, 4))
    assert rotors.esc_indices() == (0, 1, 2, 3)
    rotors.feed(1.0, info(0, 0b1111, 200))
    assert rotors.esc_count() == 4


# -- ArduPilot ------------------------------------------------------------------------------------


def counts(k: int) -> tuple[int, int, int, int]:
    return (k % 65536,) * 4


def moving(k: int) -> Four:
    return (500.0 + k, 510.0 + k, 520.0 + k, 530.0 + k)


@pytest.mark.parametrize("start", [1, 65530])
def test_ardupilot_speeds_volts_and_amperes(start: int) -> None:
    rotors = telemetry()
    for k in range(20):
        out = reading(rotors.feed(k * 0.1, ardupilot(moving(k), counts(start + k))))
        assert out.speed == moving(k)
        if k:
            assert out.voltage == VOLTS
            assert out.current == AMPS
    assert rotors.rate(0) == pytest.approx(10.0)


def test_ardupilot_frozen_count_means_stale_volts_beside_live_speed() -> None:
    rotors = telemetry()
    for k in range(20):
        rotors.feed(k * 0.1, ardupilot(moving(k), counts(k)))
    for k in range(20, 50):
        out = reading(rotors.feed(k * 0.1, ardupilot(moving(k), (19, k, k, k))))
        assert out.speed == moving(k)
        assert same(out.voltage, (NAN, 16.0, 16.0, 16.0))
        assert same(out.current, (NAN, 5.0, 5.0, 5.0))


def test_ardupilot_zero_while_the_count_moves_is_a_stopped_rotor() -> None:
    rotors = telemetry()
    for k in range(20):
        rotors.feed(k * 0.1, ardupilot(moving(k), counts(k)))
    for k in range(20, 60):
        out = reading(rotors.feed(k * 0.1, ardupilot(with_one(moving(k), 2, 0.0), counts(k))))
        assert out.speed[2] == 0.0
    assert rotors.state(2, 5.9) is RotorState.STOPPED


def test_ardupilot_lost_telemetry_never_reads_as_a_stopped_rotor() -> None:
    """The autopilot holds the last values; after a second the speed goes to 0, volts stay."""
    rotors = telemetry()
    for k in range(20):
        rotors.feed(k * 0.1, ardupilot(moving(k), counts(k)))
    for k in range(20, 60):
        speed = with_one(moving(k), 1, 529.0 if k < 31 else 0.0)
        out = reading(rotors.feed(k * 0.1, ardupilot(speed, (k, 19, k, k))))
        assert out.speed[1] != 0.0
    assert out.speed[1] != out.speed[1]
    assert rotors.state(1, 5.9) is RotorState.STALE
    assert rotors.state(0, 5.9) is RotorState.FRESH


def test_ardupilot_speed_alone() -> None:
    rotors = telemetry()
    zero = (0, 0, 0, 0)
    for k in range(20):
        out = reading(rotors.feed(k * 0.1, ardupilot(moving(k), zero, ZERO, ZERO)))
        assert out.speed == moving(k)
        assert same(out.voltage, NAN4)
    stop = reading(rotors.feed(2.0, ardupilot(with_one(moving(20), 3, 0.0), zero, ZERO, ZERO)))
    assert stop.speed[3] == 0.0  # it was moving until now: measured
    later = reading(rotors.feed(3.5, ardupilot(with_one(moving(35), 3, 0.0), zero, ZERO, ZERO)))
    assert math.isnan(later.speed[3])
    assert any("speed alone" in note for note in rotors.notes())


def test_ardupilot_speed_alone_held_and_then_zero_is_lost_data() -> None:
    rotors = telemetry()
    zero = (0, 0, 0, 0)
    for k in range(60):
        held = moving(k)[0] if k < 20 else moving(19)[0] if k < 31 else 0.0
        out = reading(rotors.feed(k * 0.1, ardupilot(with_one(moving(k), 0, held), zero, ZERO, ZERO)))
        assert out.speed[0] != 0.0


def test_ardupilot_motors_on_servo_9_to_12() -> None:
    rotors = telemetry(8, 9, 10, 11)
    assert rotors.feed(1.0, ardupilot(ZERO, (0, 0, 0, 0), ZERO, ZERO)) is None
    assert reading(rotors.feed(1.0, ardupilot(moving(0), counts(1), index=8))).speed == moving(0)
    assert rotors.esc_indices() == (8, 9, 10, 11)
    assert rotors.state(0, 1.0) is RotorState.NOT_REPORTED


def test_speed_sensors_that_are_no_escs_are_only_said() -> None:
    rotors = telemetry()
    assert rotors.feed(1.0, RotorRpm(1, 1, 226, 0, None, 0, (500.0, 500.0))) is None
    assert "name no rotor" in rotors.notes()[0]


four = st.tuples(*[st.floats(allow_nan=True)] * 4)
byte = st.integers(0, 255)


@given(
    st.lists(
        st.one_of(
            st.builds(px4, st.floats(0, 100), four, four, four, byte),
            st.builds(ardupilot, four, st.tuples(*[st.integers(0, 65535)] * 4), four, four, byte),
            st.builds(info, byte, byte, byte),
        ),
        max_size=40,
    ),
    st.permutations(range(8)),
)
def test_any_content_gives_sane_readings(
    samples: list[EscStatus | EscTelemetry | EscInfo], escs: list[int]
) -> None:
    rotors = telemetry(*escs)
    for k, sample in enumerate(samples):
        out = rotors.feed(k * 0.1, sample)
        if out is not None:
            speeds = reading(out).speed
            assert len(speeds) == 8
            assert all(0.0 <= s < 30000.0 or math.isnan(s) for s in speeds)
            assert not all(map(math.isnan, speeds))
    assert all(rotors.state(esc, 4.0) in RotorState for esc in range(8))
    assert all(rotors.rate(esc) >= 0.0 for esc in range(8))
    assert all(isinstance(note, str) for note in rotors.notes())


def test_before_the_airframe_is_known_nothing_is_read() -> None:
    rotors = RotorTelemetry()
    silent = EscTelemetry(1, 1, 11030, 0, None, 0, ZERO, ZERO, ZERO, ZERO, (0,) * 4, NAN4)
    assert rotors.feed(1.0, silent) is None
    assert rotors.feed(1.1, EscStatus(1, 1, 291, 0, 1, 0, TURNING, VOLTS, AMPS)) is None


def test_commands_come_by_the_channels_that_were_given() -> None:
    rotors = telemetry()
    rotors.set_output_channels({1: 4, 2: 5, 3: 6, 4: 7})
    out = rotors.feed(1.0, Outputs(1, 1, 375, 0, 1, 0, (0.9, 0.9, 0.9, 0.9, 0.1, 0.2, 0.3, 0.4)))
    assert isinstance(out, CommandReading)
    assert out.command == pytest.approx((0.1, 0.2, 0.3, 0.4))
    assert rotors.output_channels == (4, 5, 6, 7)
