"""What one ESC has shown so far: when it gave news, whether it ever turned, ArduPilot's signs of life."""

import math

NAN = math.nan
LIVE_VOLTS = 0.5  # V; below, an ESC gives no voltage
ALIVE = 1.0  # s since count or volts moved within which ArduPilot's rpm 0 is a stopped rotor
HELD = 0.8  # s; ArduPilot holds a lost speed for 1 s, a speed that moved since was measured
# no motor stops within so many s that was so fast, of its fastest, and had spun for so many s
FALL, FAST, SPUN = 0.025, 0.3, 1.0
ANEW = 5.0  # s back in time that are another axis and not a late sample


class Timing:
    """When news came, of one ESC or of four that come together and are well."""

    __slots__ = ("interval", "news")

    def __init__(self) -> None:
        self.news = -math.inf  # when [s]
        self.interval = NAN  # usual time between news [s]

    def note(self, t: float) -> bool:
        """Take news; return whether they are newer than the last."""
        step = t - self.news
        if step > 0.0:
            usual = self.interval
            if step < math.inf:
                # a clipped mean: gaps do not slow it, a change of rate is followed
                self.interval = step if usual != usual else usual + 0.05 * (min(step, 3 * usual) - usual)
            self.news = t
            return True
        if step < -ANEW:
            self.news = t
            return True
        return False

    def copy(self) -> "Timing":
        """Return one that goes on by itself."""
        other = Timing()
        other.news, other.interval = self.news, self.interval
        return other


class Esc:
    """What one ESC index has shown so far."""

    __slots__ = (
        "changed",
        "count",
        "cut",
        "fastest",
        "moved",
        "packets",
        "raw",
        "speed",
        "spinning",
        "timing",
        "turned",
        "volts",
        "volts_seen",
        "zero",
    )

    def __init__(self) -> None:
        self.turned = False
        self.volts_seen = False
        self.speed = NAN  # last known [rad/s]; while four are well together, one of theirs
        self.timing = Timing()
        self.fastest = 0.0  # [rad/s], where it gives no volts; likewise
        self.spinning = math.inf  # since when [s]
        self.cut = False  # its speeds have become 0 faster than any motor stops
        # ArduPilot's alone
        self.count: int | None = None
        self.packets = False  # count has ever moved
        self.moved = -math.inf  # when count or volts last did [s]
        self.volts = self.raw = NAN  # as last sent
        self.changed = -math.inf  # when a speed above 0 last did [s]
        self.zero = -math.inf  # when the speed fell to 0, if it was measured until then

    def note(self, t: float, speed: float) -> None:
        """Take a known speed."""
        if self.timing.note(t):
            self.speed = speed
        if speed > 0.0:
            self.turned = True

    def lost(self, t: float, speed: float) -> bool:
        """Whether a speed of 0 without volts is no data: it came at once where the motor was fast just before."""
        if speed > 0.0:
            self.cut = False
            self.fastest = max(self.fastest, speed)
            self.spinning = min(self.spinning, t)
        elif not self.cut:
            fell = 0.0 < t - self.timing.news < FALL and self.speed > FAST * self.fastest
            self.cut = fell and t - self.spinning > SPUN
            self.spinning = math.inf
        return self.cut

    def stopped(self, t: float, speed: float, volts: float, count: int) -> bool:
        """Follow ArduPilot's signs of life; return whether a speed of 0 would be a stopped rotor."""
        moved = self.count is not None and count != self.count
        self.packets |= moved
        if moved or (volts != self.volts and self.volts == self.volts and volts > LIVE_VOLTS):
            self.moved = t
        if speed > 0.0:
            if speed != self.raw:
                self.changed = t
            self.zero = -math.inf
        elif self.raw > 0.0:
            self.zero = t if t - self.changed < HELD else -math.inf
        self.count, self.volts, self.raw = count, volts, speed
        return t - self.moved <= ALIVE or (not self.packets and t - self.zero <= ALIVE)
