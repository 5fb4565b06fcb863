"""Vehicle clocks to one axis."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_health.clock import ClockNotice, Kind, VehicleClock
from gcs_health.samples import Attitude, EscStatus, Heartbeat, Imu, Outputs, Sample, SystemTime

PC = 1_700_000_000_000_000  # µs UNIX
NAN4 = (math.nan,) * 4


def imu(time_us: int | None, receive_us: int, sensor: int = 0) -> Imu:
    return Imu(1, 1, 105, receive_us, time_us, 0.0, 0.0, -9.81, 0.0, 0.0, 0.0, sensor, math.nan)


def attitude(time_us: int, receive_us: int) -> Attitude:
    return Attitude(1, 1, 30, receive_us, time_us, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def servo(time_us: int, receive_us: int) -> Outputs:
    return Outputs(1, 1, 36, receive_us, time_us % 2**32, 0, (1500.0,))


def heartbeat(receive_us: int) -> Heartbeat:
    return Heartbeat(1, 1, 0, receive_us, None, 2, 12, 128, 0, 4)


def run(samples: list[Sample]) -> tuple[list[float], list[ClockNotice], VehicleClock]:
    clock = VehicleClock()
    return [clock.time_of(s) for s in samples], clock.notices(), clock


def kinds(notices: list[ClockNotice]) -> list[Kind]:
    return [n.kind for n in notices]


def stream(start: int, receive: int, count: int, step: int = 20_000) -> list[Sample]:
    return [imu(start + k * step, receive + k * step) for k in range(count)]


@given(
    st.integers(1, 10**12),
    st.lists(st.tuples(st.integers(1, 900_000), st.integers(0, 50_000)), min_size=1, max_size=40),
)
def test_boot_stamps_are_the_axis_exactly(start: int, steps: list[tuple[int, int]]) -> None:
    samples: list[Sample] = []
    now = start
    for step, latency in steps:
        now += step
        samples.append(imu(now, PC + now - start + latency))
    times, notices, clock = run(samples)
    assert times == [s.time_us * 1e-6 for s in samples if s.time_us]
    assert notices == []
    assert clock.astray == clock.late == 0


def test_unix_stamps_that_equal_receive_time_leave_no_trace_of_the_provisional_axis() -> None:
    samples = [heartbeat(PC), *stream(PC + 10, PC + 10, 100), heartbeat(PC + 2_000_000)]
    times, notices, clock = run(samples)
    assert times == [s.receive_us * 1e-6 for s in samples]
    assert notices == []
    assert clock.quality()[0].startswith("the axis is the vehicle's UNIX time")


def test_the_axis_before_any_stamp_is_receive_time_and_the_change_is_said() -> None:
    times, _, clock = run([heartbeat(PC), heartbeat(PC + 1_000_000)])
    assert times == [PC * 1e-6, PC * 1e-6 + 1.0]
    assert not clock.settled
    assert clock.time_of(imu(5_000_000, PC + 1_500_000)) == 5.0
    assert clock.settled
    (notice,) = clock.notices()
    assert notice.kind is Kind.AXIS
    assert notice.t == 5.0
    assert clock.notices() == []


def test_what_has_no_stamp_is_placed_by_the_least_delay() -> None:
    latency = [30, 5, 60, 12, 45, 8, 90, 22]  # ms
    samples = [imu(k * 20_000 + 10**6, PC + k * 20_000 + ms * 1000) for k, ms in enumerate(latency)]
    _, _, clock = run(samples)
    t = clock.time_of(heartbeat(PC + 200_000 + 5_000))
    assert t == pytest.approx(1.2, abs=1e-6)


def test_estimates_do_not_run_backwards_when_a_quicker_message_lowers_the_least_delay() -> None:
    clock = VehicleClock()
    clock.time_of(imu(10**6, PC + 5_000))
    before = clock.time_of(heartbeat(PC + 10_000))
    clock.time_of(imu(10**6 + 2_000, PC + 10_500))
    clock.time_of(imu(10**6 + 20_000, PC + 11_000))
    assert clock.time_of(heartbeat(PC + 11_000)) >= before


@given(st.integers(0, 40), st.integers(-3_000_000, 3_000_000))
@settings(max_examples=40)
def test_the_u32_stamps_unwrap_beside_the_u64_one(wraps: int, around: int) -> None:
    start = max(wraps * 2**32 + around, 1)
    samples: list[Sample] = []
    for k in range(60):
        now, receive = start + k * 100_000, PC + k * 100_000
        samples += [imu(now, receive), servo(now, receive + 10)]
    times, notices, clock = run(samples)
    # a stamp of exactly 0 says nothing: it is placed by its 10 µs later arrival
    assert times == pytest.approx([(start + k // 2 * 100_000) * 1e-6 for k in range(120)], abs=1.1e-5)
    assert times[::2] == [(start + k * 100_000) * 1e-6 for k in range(60)]
    assert notices == []
    assert clock.astray == 0


@given(st.integers(0, 5_000), st.integers(1, 3))
def test_time_boot_ms_runs_on_past_its_wrap(before_ms: int, gap_s: int) -> None:
    wrap = 2**32
    start = wrap - before_ms
    at = [start + k * 100 + (gap_s * 1000 if k > 30 else 0) for k in range(80)]
    samples: list[Sample] = [attitude(ms % wrap * 1000, PC + (ms - start) * 1000) for ms in at]
    times, notices, _ = run(samples)
    if before_ms == 0:  # the first stamp is 0: no stamp; then the clock starts behind the wrap
        assert times[1:] == pytest.approx([(ms - wrap) * 1e-3 for ms in at[1:]])
    else:
        assert times == pytest.approx([ms * 1e-3 for ms in at])
    assert Kind.REBOOT not in kinds(notices)


def test_servo_output_stamps_alone_found_no_axis() -> None:
    times, _, clock = run([servo(10**6, PC), servo(2 * 10**6, PC + 10**6)])
    assert times == [PC * 1e-6, PC * 1e-6 + 1.0]
    assert not clock.settled


@given(st.integers(3_000_000, 10**11), st.integers(2, 200), st.integers(0, 10_000_000))
@settings(max_examples=50)
def test_after_a_reboot_the_axis_runs_on_by_receive_time(uptime: int, away_s: int, booted: int) -> None:
    away = away_s * 1_000_000
    booted = min(booted, away)
    old = stream(uptime, PC, 50)
    back = PC + 49 * 20_000 + away
    new = stream(max(booted, 1), back, 50)
    if booted >= uptime + 980_000 - 1_000_000:
        return  # the new boot is as old as the former: no way to tell
    times, notices, clock = run([*old, *new])
    assert times == sorted(times)
    assert clock.reboots == 1
    assert kinds(notices).count(Kind.REBOOT) == 1
    assert times[-1] - times[49] == pytest.approx(away_s + 49 * 0.02, abs=1e-3)
    assert times[60] - times[59] == pytest.approx(0.02)


@given(st.integers(1, 48), st.sampled_from([0, 1, 77, 10**9, 2**63, 2**64 - 1, PC * 3, 9 * 10**14]))
def test_one_garbage_stamp_is_replaced_and_counted(at: int, garbage: int) -> None:
    samples = stream(50_000_000, PC, 50)
    clean, _, _ = run(samples)
    samples[at] = samples[at]._replace(time_us=garbage)
    times, notices, clock = run(samples)
    assert times[:at] + times[at + 1 :] == clean[:at] + clean[at + 1 :]
    assert times[at] == pytest.approx(clean[at], abs=1e-3)
    assert notices == []
    assert clock.astray == (garbage != 0)


@pytest.mark.parametrize("garbage", [10**12, 9 * 10**14, 2**63])
def test_a_garbage_first_stamp_does_not_stay_the_origin(garbage: int) -> None:
    samples = [imu(garbage, PC - 20_000), *stream(50_000_000, PC, 50)]
    times, notices, clock = run(samples)
    assert times[-1] == (50_000_000 + 49 * 20_000) * 1e-6
    assert clock.reboots == 0
    assert Kind.REBOOT not in kinds(notices)


@given(st.permutations(range(12)))
@settings(max_examples=50)
def test_reordered_samples_keep_their_own_times(order: list[int]) -> None:
    head = stream(10**7, PC, 20)
    last = PC + 20 * 20_000
    tail: list[Sample] = [imu(10**7 + (20 + k) * 20_000, last + i * 20_000) for i, k in enumerate(order)]
    times, notices, clock = run([*head, *tail])
    assert times[20:] == [(10**7 + (20 + k) * 20_000) * 1e-6 for k in order]
    assert clock.late == sum(k < max(order[:i]) for i, k in enumerate(order) if i)
    assert notices == []


def test_interleaved_sensors_and_batches_are_not_late() -> None:
    samples: list[Sample] = []
    for k in range(20):
        now, receive = 10**7 + k * 40_000, PC + k * 40_000
        samples += [imu(now + 600, receive, 0), imu(now, receive, 1), imu(now - 300, receive, 2)]
        for index in (0, 4):
            samples.append(EscStatus(1, 1, 291, receive, now, index, NAN4, NAN4, NAN4))
    _, _, clock = run(samples)
    assert clock.late == 0


def test_one_sample_much_older_than_the_rest_changes_nothing_for_them() -> None:
    samples = stream(50_000_000, PC, 50)
    clean, _, _ = run(samples)
    samples.insert(30, imu(47_000_000, samples[30].receive_us))
    times, notices, _ = run(samples)
    assert times[:30] + times[31:] == clean
    assert notices == []


def test_a_gap_is_said_with_its_length() -> None:
    samples = [*stream(10**7, PC, 10), *stream(10**7 + 31_000_000, PC + 31_000_000, 10)]
    times, notices, clock = run(samples)
    (notice,) = notices
    assert notice.kind is Kind.GAP
    assert notice.size == pytest.approx(31 - 0.18)
    assert notice.t == times[10] == 41.0
    assert "1 gap of more than 1 s" in clock.quality()


@pytest.mark.parametrize("step_s", [-3600, -5, 5, 3600])
def test_a_step_of_the_pc_clock_moves_no_stamped_sample(step_s: int) -> None:
    before, after = stream(10**7, PC, 100), stream(10**7 + 2_000_000, PC + (2 + step_s) * 10**6, 200)
    times, notices, clock = run([*before, *after])
    assert times == [(10**7 + k * 20_000) * 1e-6 for k in range(300)]
    (notice,) = notices
    assert notice.kind is Kind.RECEIVE_STEP
    assert notice.size == pytest.approx(step_s, abs=0.05)
    assert clock.time_of(heartbeat(PC + (6 + step_s) * 10**6)) == pytest.approx(16.0, abs=0.05)


def test_a_stalled_link_is_no_step() -> None:
    before = stream(10**7, PC, 100)
    burst: list[Sample] = [imu(10**7 + (100 + k) * 20_000, PC + 7_000_000 + k * 100) for k in range(250)]
    after = stream(10**7 + 7_000_000, PC + 7_100_000, 200)
    times, notices, clock = run([*before, *burst, *after])
    assert times == sorted(times)
    assert notices == []
    assert clock.time_of(heartbeat(PC + 12_000_000)) == pytest.approx(22.0, abs=0.15)


def test_two_clocks_are_one_axis() -> None:
    """Boot ms and UNIX µs in one stream: the first seen is the axis, the other does not jitter."""
    boot, samples = 100_000_000, []
    for k in range(100):
        now = k * 40_000
        samples += [attitude(boot + now, PC + now + 3_000), imu(PC + now + 7_000, PC + now + 9_000)]
    times, notices, clock = run(samples)
    assert times[::2] == [(boot + k * 40_000) * 1e-6 for k in range(100)]
    assert notices == []
    assert all(b - a == pytest.approx(0.04) for a, b in zip(times[1::2], times[3::2], strict=False))
    assert times[1] == pytest.approx(100.007, abs=0.01)
    assert "its other clock is in use too, mapped by receive time" in clock.quality()


@pytest.mark.parametrize("boot_first", [True, False])
def test_system_time_maps_one_clock_to_the_other(boot_first: bool) -> None:
    boot, lead = 100_000_000, 5_000_000_000  # the vehicle's UNIX clock is far off the PC's
    unix = PC + lead
    first: list[Sample] = [attitude(boot, PC)] if boot_first else [imu(unix, PC)]
    pair = SystemTime(1, 1, 2, PC + 100_000, boot + 100_000, unix + 100_000)
    more: list[Sample] = [imu(unix + 200_000, PC + 200_000), attitude(boot + 200_000, PC + 280_000)]
    times, _, clock = run([*first, pair, *more])
    assert times[2] == pytest.approx(times[3], abs=1e-9)
    assert times[2] == pytest.approx((boot if boot_first else unix) * 1e-6 + 0.2, abs=1e-6)
    assert "its other clock is in use too, mapped by SYSTEM_TIME" in clock.quality()


def test_drift_between_the_clocks_is_followed() -> None:
    clock = VehicleClock()
    for k in range(0, 600_000, 100):  # 10 minutes, 100 ppm apart
        clock.time_of(imu(10**6 + k * 1000, PC + k * 1000 + k // 10))
    assert clock.time_of(heartbeat(PC + 600_000_000 + 60_000)) == pytest.approx(601.0, abs=0.005)


@given(st.lists(st.tuples(st.integers(0, 2**64 - 1), st.integers(0, 2**53), st.sampled_from([36, 30, 105]))))
def test_any_stamps_at_all_give_finite_times(wild: list[tuple[int, int, int]]) -> None:
    samples: list[Sample] = []
    for stamp, receive, message in wild:
        one = {
            36: servo(stamp, receive),
            30: attitude(stamp % 2**32 * 1000, receive),
            105: imu(stamp, receive),
        }
        samples += [one[message], heartbeat(receive)]
    times, _, clock = run([*samples, *stream(50_000_000, PC, 60)])
    assert all(map(math.isfinite, times))
    assert all(b - a == pytest.approx(0.02, abs=1e-4) for a, b in zip(times[-30:], times[-29:], strict=False))
    assert all(isinstance(line, str) for line in clock.quality())


def test_jitter_is_measured() -> None:
    samples = [imu(10**6 + k * 20_000, PC + k * 20_000 + (k * 7919 % 1000) * 20) for k in range(1000)]
    _, _, clock = run(samples)
    said = float(clock.quality()[0].rsplit(" ", 2)[1])
    assert said == pytest.approx(0.34 * 20, rel=0.25)  # uniform over 20 ms: half of 16 % to 84 %
