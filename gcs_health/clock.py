"""Vehicle clocks to one axis: every sample gets a time in seconds on the vehicle's own clock.

Three clocks meet: the receive stamp (a PC's UNIX time) and the vehicle's two, since boot and UNIX, sent
as u64 µs, u32 ms or u32 µs. The axis is the clock of the first stamped sample, exactly as the vehicle
says it, until that clock starts anew; from then on an integer shift keeps the axis running on. The
vehicle's other clock has a shift too: from SYSTEM_TIME, which pairs the two, else from receive time.

What carries no stamp, or one that cannot be, is placed at receive time less the least delay seen in the
last 10 to 20 s: a window and not a slope, so it follows drift and forgets a step of the PC's clock.
Before the first stamp the axis is receive time; the change of axis is a notice of its own.

All inside is integer µs: no rounding, so no dependence on the order of sums.
"""

from dataclasses import dataclass
from enum import StrEnum

from gcs_health.samples import Imu, Sample, SystemTime

US = 1_000_000  # µs in a second
UNIX_FROM = 10**15  # µs; stamps above are UNIX time, below time since boot (mavlink notes)
UNIX_TO = 41 * 10**14  # µs; the year 2099
BOOT_TO = 3 * 10**14  # µs; nine years of uptime
SERVO_OUTPUT_RAW = 36  # the one message whose stamp is u32 µs: wraps every 71.6 minutes
# 49.7 days for time_boot_ms, of every message that any sample is made of
WRAPS = {m: 2**32 * 1000 for m in (2, 26, 30, 31, 83, 116, 129)} | {SERVO_OUTPUT_RAW: 2**32}

GAP = US  # µs of silence that are told; also what a stamp may be off before it is doubted
WINDOW = 10 * US  # µs of one half of the least-delay window
SETTLED = (
    2 * US
)  # µs of receive time after which a delay that grew at once was the PC's clock and not a stalled link
LOST = 60 * US  # µs that a stamp may lead while the delay is unknown
COINCIDE = 20_000  # µs by which the two vehicle clocks may disagree before their shift is made anew
REBOOTED, STEPPED = 2, 5  # stamps in a row that bear out a new boot, or any other step
FEW = 3  # accepted stamps below which a clock's start is thrown away instead of continued


class Kind(StrEnum):
    """What happened to time."""

    GAP = "gap"  # nothing at all came
    REBOOT = "reboot"
    VEHICLE_STEP = "vehicle_step"  # the vehicle's clock was set
    RECEIVE_STEP = "receive_step"  # the PC's clock was set
    AXIS = "axis"  # the axis is no longer receive time but the vehicle's


@dataclass(frozen=True, slots=True)
class ClockNotice:
    """One thing that happened at `t` [s] on the axis, of `size` [s], negative = backwards."""

    t: float
    kind: Kind
    size: float


class _LeastDelay:
    """Least of receive - axis [µs] over the last one to two windows."""

    __slots__ = ("current", "guess", "known", "older", "until", "value")

    def __init__(self) -> None:
        self.known = self.guess = False
        self.value = self.older = self.current = self.until = 0

    def restart(self, delay: int, axis: int, guess: bool = False) -> None:
        self.known, self.guess = True, guess
        self.value = self.older = self.current = delay
        self.until = axis + WINDOW

    def note(self, delay: int, axis: int) -> None:
        if self.guess or not self.known:
            self.restart(delay, axis)
        elif axis >= self.until:
            self.older = self.current if axis < self.until + WINDOW else delay
            self.current = delay
            self.until = axis + WINDOW
            self.value = min(self.older, delay)
        elif delay < self.current:
            self.current = delay
            if delay < self.value:
                self.value = delay


class _VehicleClock:
    """One of the vehicle's clocks: since boot, or UNIX."""

    __slots__ = ("astray", "count", "delay", "last", "paired", "previous", "receive", "returned", "shift")

    def __init__(self) -> None:
        self.count = 0  # stamps believed
        self.last = self.receive = 0  # newest stamp believed [µs, unwrapped], and when it came
        self.shift = 0  # axis - stamp [µs]
        self.previous: int | None = None  # shift before the last new start
        self.returned = 0  # stamps in a row that fit the shift before
        self.paired = False  # the shift comes from SYSTEM_TIME
        self.delay = _LeastDelay()  # of this clock, where it is not the axis
        self.astray: tuple[int, int, int] | None = None  # stamp, receive, how many in a row


class VehicleClock:
    """The clock of one (system, component); `time_of` is called once for every sample as it arrives.

    Attributes
    ----------
    late : samples older than the one before of their stream.
    astray : stamps that could not be; their samples got estimated times.
    reboots, gaps, steps : starts of the autopilot, silences over 1 s, steps of the ground's clock.
    news : what happened since `notices` was last called.
    """

    def __init__(self) -> None:
        self._boot, self._unix = _VehicleClock(), _VehicleClock()
        self._primary: _VehicleClock | None = None
        self._delay = _LeastDelay()
        self._last_delay = 0
        self._stalled: tuple[int, int, int] | None = None  # receive, delay before, size of a sudden delay
        self._receive: int | None = None
        self._newest: int | None = None
        self._estimated: int | None = None  # newest time given to what has no stamp
        self._streams: dict[int, int] = {}
        self._excess = [0] * 160  # histogram of delay over the least, four bins an octave of µs
        self.news: list[ClockNotice] = []
        self.late = self.astray = self.reboots = self.gaps = self.steps = 0

    @property
    def settled(self) -> bool:
        """Whether the axis is the vehicle's; receive time until then."""
        return self._primary is not None

    def time_of(self, sample: Sample) -> float:
        """Return the sample's time on the vehicle's axis [s]; a late sample's lies before the last one's."""
        receive = sample.receive_us
        before = self._receive
        if before is not None and receive < before - GAP:
            self._receive_stepped_back(receive, receive - before)
        self._receive = receive
        stamp = sample.time_us
        axis = self._from_stamp(sample, stamp, receive) if stamp else None
        if axis is None:
            axis = self._estimate(receive)
        newest = self._newest
        if newest is None or axis > newest:
            # who stamps nothing sends heartbeats, a second apart: three missing are a gap
            if newest is not None and axis - newest > (GAP if self._primary is not None else 3 * GAP):
                self.gaps += 1
                self._say(axis, Kind.GAP, axis - newest)
            self._newest = axis
        return axis * 1e-6

    def notices(self) -> list[ClockNotice]:
        """Return what happened since the last call."""
        said, self.news = self.news, []
        return said

    def quality(self) -> tuple[str, ...]:
        """Say in sentences which clock this is and how good."""
        if self._primary is None:
            said = ["no message carries a vehicle time stamp: the axis is receive time"]
        else:
            base = "UNIX time" if self._primary is self._unix else "time since boot"
            said = [f"the axis is the vehicle's {base}; arrival jitter {self._jitter_ms():.1f} ms"]
            other = self._boot if self._primary is self._unix else self._unix
            if other.count:
                how = "by SYSTEM_TIME" if other.paired else "by receive time"
                said.append(f"its other clock is in use too, mapped {how}")
        for count, one, more in (
            (self.late, "sample came late or out of order", "samples came late or out of order"),
            (self.astray, "stamp could not be and was replaced", "stamps could not be and were replaced"),
            (self.reboots, "reboot", "reboots"),
            (self.steps, "step of the ground station's clock", "steps of the ground station's clock"),
            (self.gaps, "gap of more than 1 s", "gaps of more than 1 s"),
        ):
            if count:
                said.append(f"{count} {one if count == 1 else more}")
        return tuple(said)

    def _say(self, axis: int, kind: Kind, size: int) -> None:
        self.news.append(ClockNotice(axis * 1e-6, kind, size * 1e-6))

    def _jitter_ms(self) -> float:
        """Half the distance between the 16 % and 84 % quantiles of the delay [ms]: σ if it were normal."""
        total, seen, low, high = sum(self._excess), 0, 0, 0
        for k, count in enumerate(self._excess):
            middle = (9 + 2 * (k & 3)) << ((k >> 2) - 3) >> 1 if k >= 12 else k >> 1
            if seen <= 0.16 * total:
                low = middle
            if seen <= 0.84 * total:
                high = middle
            seen += count
        return (high - low) / 2 * 1e-3

    def _from_stamp(self, sample: Sample, stamp: int, receive: int) -> int | None:
        """Return the axis time of a stamp [µs], None where it is not to be believed."""
        unix = stamp > UNIX_FROM
        clock = self._unix if unix else self._boot
        message = sample.message
        if message in WRAPS:
            if message == SERVO_OUTPUT_RAW and not clock.count:
                return None  # which of its 71.6 minutes, nothing has told yet
            stamp = self._unwrapped(clock, stamp, receive, WRAPS[message])
        if not clock.count and not self._begin(clock, stamp, receive, UNIX_TO if unix else BOOT_TO):
            return None
        ahead = stamp - clock.last
        if not -GAP <= ahead <= GAP and not self._goes_on(clock, stamp, receive, ahead):
            return self._doubtful(clock, stamp, receive, message)
        if message != SERVO_OUTPUT_RAW:
            clock.astray = None
            clock.returned = 0
        clock.count += 1
        if ahead >= 0:
            clock.last, clock.receive = stamp, receive
        if type(sample) is SystemTime and sample.unix_us is not None:
            self._pair(sample.unix_us - stamp)
        axis = stamp + clock.shift
        # the sensors of one message are streams of their own
        stream = message | sample.sensor << 24 if type(sample) is Imu else message
        if axis < self._streams.get(stream, axis):
            self.late += 1
        else:
            self._streams[stream] = axis
        if ahead >= 0:
            self._note_delay(clock, receive - axis, axis)
        return axis

    def _unwrapped(self, clock: _VehicleClock, stamp: int, receive: int, wrap: int) -> int:
        """Add the wraps that bring a u32 stamp to where the clock must be by now, if any do."""
        if not clock.count:
            return stamp
        expected = clock.last + max(receive - clock.receive, 0)
        unwrapped = stamp + wrap * ((expected - stamp + wrap // 2) // wrap)
        return unwrapped if abs(unwrapped - expected) < LOST else stamp

    def _goes_on(self, clock: _VehicleClock, stamp: int, receive: int, ahead: int) -> bool:
        """Whether a stamp far ahead is a gap: not later than anything received by now can be."""
        if ahead < 0:
            return False
        leads = stamp + clock.shift - (receive - self._delay.value)
        return leads <= (LOST if self._delay.guess else GAP)

    def _begin(self, clock: _VehicleClock, stamp: int, receive: int, latest: int) -> bool:
        """Take the first stamp of a clock: it founds the axis, or is mapped to it through receive time."""
        if stamp > latest:
            self.astray += 1
            return False
        if self._primary is None:
            self._primary = clock
            self._change_axis(stamp, receive)
        elif not clock.paired:
            clock.shift = receive - self._delay.value - stamp
        clock.last, clock.receive = stamp, receive
        return True

    def _change_axis(self, axis: int, receive: int) -> None:
        if self._newest is not None and abs(axis - self._newest) > GAP:
            self._say(axis, Kind.AXIS, axis - self._newest)
        self._newest = self._estimated = axis
        self._delay.restart(receive - axis, axis)
        self._last_delay = receive - axis
        self._streams.clear()

    def _doubtful(self, clock: _VehicleClock, stamp: int, receive: int, message: int) -> int | None:
        """Hold a stamp that does not go on from the last one until others bear it out."""
        now = receive - self._delay.value
        if clock.previous is not None and abs(stamp + clock.previous - now) < GAP:
            return self._of_previous_boot(clock, stamp, receive)
        if message == SERVO_OUTPUT_RAW:  # its wraps fit too much to bear anything out
            self.astray += 1
            return None
        held, count = clock.astray, 1
        if held is not None:
            advanced = stamp - held[0]
            if advanced > 0 and abs(advanced - (receive - held[1])) < GAP:
                count = held[2] + 1
        clock.astray = (stamp, receive, count)
        # a boot began after the last word of the boot before, so it cannot be older than that silence
        reboot = clock is self._boot and stamp < clock.last
        young = stamp < receive - clock.receive + 2 * GAP
        if count < (REBOOTED if reboot and young else STEPPED):
            self.astray += 1
            return None
        self.astray -= count - 1
        return self._start_anew(clock, stamp, receive, reboot)

    def _of_previous_boot(self, clock: _VehicleClock, stamp: int, receive: int) -> int | None:
        """Place a stamp from before the last new start: late; or, two in a row, the start was none."""
        assert clock.previous is not None
        axis = stamp + clock.previous
        self.late += 1
        clock.returned += 1
        if clock.returned >= REBOOTED:
            clock.shift, clock.previous = clock.previous, clock.shift
            clock.last, clock.receive, clock.returned, clock.astray = stamp, receive, 0, None
        return axis

    def _start_anew(self, clock: _VehicleClock, stamp: int, receive: int, reboot: bool) -> int:
        """Go on with a clock that was set or began again: the axis runs on by what passed on the ground."""
        step = stamp - clock.last
        founded_on_garbage = clock is self._primary and clock.count < FEW
        if founded_on_garbage:
            self.astray += clock.count
            clock.shift, clock.previous = 0, None
            self._change_axis(stamp, receive)
        else:
            last = clock.last + clock.shift
            axis = max(last + max(receive - clock.receive, 0), self._newest or 0)
            clock.previous, clock.shift = clock.shift, axis - stamp
            self.reboots += reboot
            self._say(axis, Kind.REBOOT if reboot else Kind.VEHICLE_STEP, step)
            self._newest = axis
            if clock is self._primary:
                self._delay.restart(receive - axis, axis)
                self._last_delay = receive - axis
        clock.last, clock.receive, clock.astray, clock.returned = stamp, receive, None, 0
        clock.delay, clock.paired = _LeastDelay(), False
        clock.count += 1
        self._streams.clear()
        return stamp + clock.shift

    def _pair(self, difference: int) -> None:
        """Map one vehicle clock to the other by SYSTEM_TIME; `difference` is UNIX - boot [µs]."""
        boot, unix = self._boot, self._unix
        if not UNIX_FROM < difference < UNIX_TO:
            return
        if self._primary is boot:
            other, shift = unix, boot.shift - difference
        else:
            other, shift = boot, unix.shift + difference
        if not other.paired or abs(other.shift - shift) > COINCIDE:
            other.shift = shift
        other.paired = True

    def _note_delay(self, clock: _VehicleClock, delay: int, axis: int) -> None:
        """Learn the least delay from the axis' own clock; hold the other clock to it."""
        least = self._delay
        if clock is not self._primary:
            if not clock.paired:
                clock.delay.note(delay + clock.shift, axis)
                off = clock.delay.value - clock.shift - least.value
                if abs(off) > COINCIDE:
                    clock.shift += off
            return
        if delay - self._last_delay > GAP:
            self._stalled = (axis + delay, least.value, delay - self._last_delay)
            least.restart(delay, axis)
            self._boot.delay, self._unix.delay = _LeastDelay(), _LeastDelay()
            self._newest = self._estimated = axis  # what had no stamp has run ahead meanwhile
        elif delay < least.current or axis >= least.until or least.guess:  # else there is nothing new
            least.note(delay, axis)
        self._last_delay = delay
        if self._stalled is not None:
            self._judge_stall(delay, axis)
        over = delay - least.value
        bits = over.bit_length()
        self._excess[min((bits << 2 | (over >> (bits - 3) & 3)) if bits > 2 else over << 1, 159)] += 1

    def _judge_stall(self, delay: int, axis: int) -> None:
        """Tell a link that stalled (the delay comes back) from a PC's clock set forward (it stays)."""
        assert self._stalled is not None
        at, before, size = self._stalled
        if delay < before + GAP:
            self._stalled = None
        elif axis + delay > at + SETTLED:
            self.steps += 1
            self._say(axis, Kind.RECEIVE_STEP, size)
            self._stalled = None

    def _estimate(self, receive: int) -> int:
        """Place what has no stamp: receive time less the least delay, never before the last such."""
        axis = receive - self._delay.value
        if self._estimated is not None and axis < self._estimated:
            axis = self._estimated
        self._estimated = axis
        return axis

    def _receive_stepped_back(self, receive: int, size: int) -> None:
        """Keep the axis where it is and guess the new delay until a stamp tells it."""
        newest = self._newest if self._newest is not None else receive
        self.steps += 1
        self._say(newest, Kind.RECEIVE_STEP, size)
        self._stalled = None
        self._delay.restart(receive - newest, newest, guess=True)
        self._last_delay = receive - newest
        for clock in (self._boot, self._unix):
            clock.receive = receive
            clock.astray = None
            clock.delay = _LeastDelay()
