"""Vehicle clocks to one axis: every sample gets a time in seconds on the vehicle's own clock.

Three clocks meet: the receive stamp (a PC's UNIX time), and the vehicle's stamps, since boot or UNIX,
as u64 µs, u32 ms or u32 µs. The axis is the base of the first stamped sample, exactly as the vehicle
says it; the other base is mapped through receive time. What carries no stamp is placed by receive
time less the least delay seen. After a reboot the axis runs on: t never steps back.
"""

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

from gcs_health.samples import Sample

UNIX_FROM = 10**15  # µs; u64 stamps above are UNIX time, below boot time (mavlink.md section 7)
WRAP_MS_US = 2**32 * 1000  # time_boot_ms wraps after 49.7 days
WRAP_US = 2**32  # SERVO_OUTPUT_RAW.time_usec is u32 µs: 71.6 minutes
# messages whose stamp is u32 milliseconds; SERVO_OUTPUT_RAW is the one in u32 microseconds
BOOT_MS_MESSAGES = frozenset({2, 26, 30, 31, 83, 116, 129, 410})
SERVO_OUTPUT_RAW = 36

GAP = 1.0  # s of silence that are told
REBOOT = 1.0  # s; a boot stamp further back than that, twice in a row, is a new boot
ASTRAY = 60.0  # s; a stamp further than that off what receive time says is not believed ...
BELIEVED = 5  # ... until so many in a row agree with one another
JUST_BOOTED, BELIEVED_AT_BOOT = 60.0, 2  # s; a clock back near zero needs fewer to be believed
DRIFT = 2e-4  # the least delay may creep up by so much a second: quartz against quartz, 100 ppm each


class Kind(StrEnum):
    """What happened to time."""

    GAP = "gap"
    REBOOT = "reboot"
    RECEIVE_STEP = "receive_step"  # the ground station's clock was set


@dataclass(frozen=True, slots=True)
class ClockNotice:
    """One thing that happened at vehicle time `t` [s], of `size` [s]."""

    t: float
    kind: Kind
    size: float


class _Base:
    """One kind of stamp (boot or UNIX): unwrapped, and its offset to receive time."""

    def __init__(self) -> None:
        self.last = math.nan  # s, unwrapped, newest believed
        self.last_receive = math.nan
        self.offset = math.nan  # receive - vehicle, least delay [s]
        self.shift = 0.0  # s added to what the vehicle says: earlier boots
        self.astray: deque[tuple[float, float]] = deque(maxlen=BELIEVED)

    def note(self, stamp: float, receive: float) -> float:
        """Take a believed stamp; return its delay over the least seen [s]."""
        self.astray.clear()
        self.last, self.last_receive = stamp, receive
        delay = receive - stamp
        if not delay - self.offset < ASTRAY:  # NaN at first
            self.offset = delay
        elif delay < self.offset:
            self.offset = delay
        else:
            self.offset += min(delay - self.offset, DRIFT * 0.02)
        return delay - self.offset


class VehicleClock:
    """One vehicle's clock; `time_of` is called once for every sample, in arrival order."""

    def __init__(self) -> None:
        self._boot, self._unix = _Base(), _Base()
        self._primary: _Base | None = None
        self._provisional = math.nan
        self._newest = -math.inf
        self._receive = math.nan
        self._unstamped = -math.inf
        self._notices: list[ClockNotice] = []
        self._jitter = 0.0
        self._last_of: dict[int, float] = {}
        self.late = self.astray = self.reboots = self.gaps = self.unstamped = self.stamped = 0

    def time_of(self, sample: Sample) -> float:
        """Return the sample's time on the vehicle's axis [s]."""
        receive = sample.receive_us * 1e-6
        if receive < self._receive - GAP:
            self._step(receive)
        self._receive = receive
        stamp = sample.time_us
        t = self._unstamped_time(receive) if not stamp else self._stamped_time(sample.message, stamp, receive)
        if t > self._newest:
            if t - self._newest > GAP and self._newest > -math.inf:
                self.gaps += 1
                self._notices.append(ClockNotice(t, Kind.GAP, t - self._newest))
            self._newest = t
        return t

    def notices(self) -> list[ClockNotice]:
        """Return what happened since the last call."""
        said, self._notices = self._notices, []
        return said

    def quality(self) -> tuple[str, ...]:
        """Say in sentences which clock this is and how good."""
        if self._primary is None:
            return ("no message carries a vehicle time stamp: receive time is used",)
        base = "UNIX time" if self._primary is self._unix else "time since boot"
        said = [f"{base}; messages arrive within ±{1e3 * self._jitter:.1f} ms of their stamps"]
        for count, what in (
            (self.late, "came late or out of order"),
            (self.astray, "carried a stamp that cannot be"),
            (self.reboots, "reboots"),
            (self.gaps, f"gaps of more than {GAP:.0f} s"),
        ):
            if count:
                said.append(f"{count} {what}")
        return tuple(said)

    def _stamped_time(self, message: int, stamp_us: int, receive: float) -> float:
        base = self._unix if stamp_us > UNIX_FROM else self._boot
        stamp = self._unwrapped(base, message, stamp_us)
        if not self._believed(base, stamp, receive):
            return self._unstamped_time(receive)
        self.stamped += 1
        stamp += base.shift
        if stamp < self._last_of.get(message, stamp):
            self.late += 1
        else:
            self._last_of[message] = stamp
        if stamp < base.last:  # another stream's latency: no news of the offset
            base.astray.clear()
        else:
            delay = base.note(stamp, receive)
            # a robust mean deviation, for the report alone
            self._jitter += 0.01 * (min(delay, 10 * self._jitter + 1e-3) - self._jitter)
        if self._primary is None:
            self._primary = base
            self._newest = -math.inf  # the provisional axis was receive time: another origin
        if base is self._primary:
            return stamp
        return stamp + (base.offset - self._primary.offset)

    def _unwrapped(self, base: _Base, message: int, stamp_us: int) -> float:
        wrap = WRAP_US if message == SERVO_OUTPUT_RAW else WRAP_MS_US if message in BOOT_MS_MESSAGES else 0
        if base is self._boot and wrap and not math.isnan(base.last):
            expected = int((base.last - base.shift) * 1e6)
            stamp_us += wrap * round((expected - stamp_us) / wrap)
        return stamp_us * 1e-6

    def _believed(self, base: _Base, stamp: float, receive: float) -> bool:
        """Whether a stamp goes on from the last one; if not it must be borne out by others."""
        if math.isnan(base.last):
            return True
        ahead = stamp + base.shift - base.last - (receive - base.last_receive)
        back = base is self._boot and stamp + base.shift < base.last - REBOOT
        if abs(ahead) < ASTRAY and not back:
            return True
        base.astray.append((stamp, receive))
        first_stamp, first_receive = base.astray[0]
        agree = abs((stamp - first_stamp) - (receive - first_receive)) < REBOOT
        if not agree:
            base.astray.clear()
            base.astray.append((stamp, receive))
        if len(base.astray) < (BELIEVED_AT_BOOT if back and stamp < JUST_BOOTED else BELIEVED):
            self.astray += 1
            return False
        if back or base is self._unix:
            self._run_on(base, stamp, receive)
        base.offset = math.nan
        return True

    def _run_on(self, base: _Base, stamp: float, receive: float) -> None:
        """The vehicle's clock was set, or it booted: the axis goes on by what passed on the ground."""
        now = base.last + max(receive - base.last_receive, 0.0)
        self._notices.append(ClockNotice(now, Kind.REBOOT, base.last - base.shift - stamp))
        base.shift = now - stamp
        self.reboots += 1
        self.astray -= len(base.astray) - 1
        self._last_of.clear()

    def _unstamped_time(self, receive: float) -> float:
        """Place what carries no stamp: receive time less the least delay, never before the last such."""
        self.unstamped += 1
        if self._primary is None:
            return receive
        if math.isnan(self._primary.offset):
            return max(self._newest, self._unstamped)
        self._unstamped = max(receive - self._primary.offset, self._unstamped)
        return self._unstamped

    def _step(self, receive: float) -> None:
        """The ground's clock was set back: offsets are learned anew."""
        self._notices.append(ClockNotice(self._newest, Kind.RECEIVE_STEP, receive - self._receive))
        for base in (self._boot, self._unix):
            base.offset = math.nan
            base.last_receive = receive
        self._unstamped = -math.inf
