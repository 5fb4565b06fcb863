"""Which IMU stream is used."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_health.imu_selection import ARDUPILOT, PX4, ImuSelection
from gcs_health.samples import Imu, ImuReading

HIGHRES, SCALED, RAW, SCALED2, SCALED3 = 105, 26, 27, 116, 129
NAN = math.nan


def imu(message: int, sensor: int = 0, ax: float = 0.0, az: float = -9.81, rest: float = 0.0) -> Imu:
    return Imu(1, 1, message, 0, None, ax, rest, az, rest, rest, rest, sensor, NAN)


def play(
    streams: list[tuple[int, int, float, float, float]], choice: ImuSelection | None = None
) -> tuple[ImuSelection, list[tuple[float, int]]]:
    """Feed streams of (message, sensor, rate, from, to); return what passed: message * 10 + id."""
    choice = choice or ImuSelection()
    due = []
    for message, sensor, rate, start, end in streams:
        due += [
            (start + k / rate, message, sensor)
            for k in range(int(rate * (end - start)))
            if k / rate < end - start
        ]
    passed = []
    for t, message, sensor in sorted(due):
        reading = choice.feed(t, imu(message, sensor, ax=message * 10.0 + sensor))
        if reading is not None:
            assert reading.t == t
            passed.append((t, int(reading.ax)))
    return choice, passed


def test_the_reading_is_the_sample() -> None:
    sample = Imu(1, 1, HIGHRES, 0, 7, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0, 20.0)
    assert ImuSelection().feed(12.5, sample) == ImuReading(12.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


@given(st.permutations([HIGHRES, SCALED, RAW, SCALED2, SCALED3]), st.integers(2, 5))
def test_the_best_message_is_used_whatever_the_order(order: list[int], n: int) -> None:
    present = order[:n]
    streams = [(message, 0, 50.0, 0.001 * k, 6.0) for k, message in enumerate(present)]
    _, passed = play(streams)
    best = min(present, key=[HIGHRES, SCALED, RAW, SCALED2, SCALED3].index)
    assert {source for t, source in passed if t > 0.1} == {best * 10}


@given(st.permutations([0, 1, 2]))
def test_of_interleaved_sensors_the_lowest_is_used_alone(order: list[int]) -> None:
    choice, passed = play([(HIGHRES, sensor, 25.0, 0.0006 * k, 8.0) for k, sensor in enumerate(order)])
    assert {source for t, source in passed if t > 0.1} == {HIGHRES * 10}
    assert choice.switches == 0
    assert choice.rate() == pytest.approx(25.0, rel=0.03)


def test_a_much_faster_stream_is_preferred_and_said() -> None:
    choice, passed = play([(HIGHRES, 0, 10.0, 0.0, 10.0), (RAW, 0, 50.0, 0.001, 10.0)])
    assert {source for t, source in passed if t > 5.0} == {RAW * 10}
    assert choice.switches == 1
    assert "from HIGHRES_IMU sensor 0, the slower one" in choice.describe()
    assert choice.rate() == pytest.approx(50.0, rel=0.05)


def test_a_somewhat_faster_stream_is_not() -> None:
    choice, passed = play([(HIGHRES, 0, 30.0, 0.0, 10.0), (RAW, 0, 50.0, 0.001, 10.0)])
    assert {source for _, source in passed} == {HIGHRES * 10}
    assert choice.switches == 0


def test_silence_hands_over_after_two_seconds_and_the_better_comes_back() -> None:
    streams = [(HIGHRES, 0, 50.0, 0.0, 5.0), (HIGHRES, 0, 50.0, 15.0, 25.0), (RAW, 0, 50.0, 0.001, 25.0)]
    choice, passed = play(streams)
    raw = [t for t, source in passed if source == RAW * 10]
    assert raw[0] == pytest.approx(6.98, abs=0.05)
    assert raw[-1] == pytest.approx(17.0, abs=0.1)  # the better one's rate is measured anew first
    assert choice.switches == 2
    assert passed[-1][1] == HIGHRES * 10


def test_after_silence_one_stream_at_a_time() -> None:
    _, passed = play(
        [(HIGHRES, 0, 50.0, 0.0, 5.0), (HIGHRES, 1, 50.0, 0.001, 12.0), (RAW, 0, 50.0, 0.002, 12.0)]
    )
    times = [t for t, _ in passed]
    assert times == sorted(set(times))
    assert {source for t, source in passed if t > 8.0} == {HIGHRES * 10 + 1}


def test_duplicates_are_dropped_and_late_samples_pass() -> None:
    choice = ImuSelection()
    given_ = [choice.feed(t, imu(HIGHRES)) is not None for t in (1.0, 1.02, 1.02, 1.04, 1.03, 1.06)]
    assert given_ == [True, True, False, True, True, True]
    assert choice.duplicates == 1


@pytest.mark.parametrize("sample", [imu(HIGHRES, ax=NAN), imu(HIGHRES, az=NAN), imu(HIGHRES, rest=NAN)])
def test_rows_with_a_value_pass(sample: Imu) -> None:
    assert ImuSelection().feed(1.0, sample) is not None


def test_a_stream_without_a_value_is_never_chosen() -> None:
    choice = ImuSelection()
    empty = imu(HIGHRES, ax=NAN, az=NAN, rest=NAN)
    out = [choice.feed(k * 0.02, s) for k in range(200) for s in (empty, imu(RAW))]
    assert sum(reading is not None for reading in out) == 200
    assert choice.describe().startswith("RAW_IMU sensor 0 at 50 Hz;")


def test_a_gap_is_no_part_of_the_rate() -> None:
    choice, _ = play([(HIGHRES, 0, 100.0, 0.0, 5.0), (HIGHRES, 0, 100.0, 36.0, 37.0)])
    assert choice.rate() == pytest.approx(100.0, rel=0.02)


def test_the_rate_follows_a_change() -> None:
    choice, _ = play([(HIGHRES, 0, 50.0, 0.0, 5.0), (HIGHRES, 0, 200.0, 5.0, 12.0)])
    assert choice.rate() == pytest.approx(200.0, rel=0.02)


def test_an_axis_that_begins_anew_is_not_late_for_ever() -> None:
    choice, _ = play([(HIGHRES, 0, 50.0, 1.7e9, 1.7e9 + 3)])
    choice, passed = play([(HIGHRES, 0, 50.0, 100.0, 110.0), (RAW, 0, 50.0, 100.001, 110.0)], choice)
    assert {source for _, source in passed} == {HIGHRES * 10}
    assert len(passed) == 500
    assert choice.rate() == pytest.approx(50.0, rel=0.02)


@pytest.mark.parametrize(
    ("message", "autopilot", "parameters", "said"),
    [
        (HIGHRES, PX4, {}, "mean over 5.0 ms (IMU_INTEG_RATE by default)"),
        (HIGHRES, PX4, {"IMU_INTEG_RATE": 400.0}, "mean over 2.5 ms (IMU_INTEG_RATE)"),
        (HIGHRES, None, {"IMU_INTEG_RATE": 250.0}, "mean over 4.0 ms"),
        (RAW, ARDUPILOT, {}, "accelerations low-passed at 20 Hz (INS_ACCEL_FILTER by default)"),
        (RAW, ARDUPILOT, {"INS_GYRO_FILTER": 60.0}, "rates low-passed at 60 Hz (INS_GYRO_FILTER)"),
        (RAW, None, {"INS_ACCEL_FILTER": 0.0}, "accelerations not low-passed (INS_ACCEL_FILTER)"),
        (HIGHRES, None, {"BAT_LOW_THR": 0.1}, "not known"),
        (SCALED, PX4, {}, "not known"),
    ],
)
def test_filtering_is_said(
    message: int, autopilot: int | None, parameters: dict[str, float], said: str
) -> None:
    choice = ImuSelection()
    for name, value in parameters.items():
        choice.set_parameter(name, value)
    choice.feed(1.0, imu(message))
    assert said in choice.describe(autopilot)


def test_nothing_seen() -> None:
    choice = ImuSelection()
    assert choice.rate() == 0.0
    assert choice.describe() == "no accelerations and rates in the stream"
