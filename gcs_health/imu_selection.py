"""Which of several IMU streams the estimators see, at what rate, and what filtering it has had.

A stream is one message of one sensor: an octocopter may send HIGHRES_IMU of three sensors in turn,
ArduPilot three messages of three. Mixed, they would be a signal that no sensor measured.
"""

import math
from collections.abc import Callable

from gcs_health.samples import Imu, ImuFilterReading, ImuReading, new_tuple

HIGHRES_IMU, SCALED_IMU, RAW_IMU, SCALED_IMU2, SCALED_IMU3 = 105, 26, 27, 116, 129
NAME = {
    HIGHRES_IMU: "HIGHRES_IMU",
    SCALED_IMU: "SCALED_IMU",
    RAW_IMU: "RAW_IMU",
    SCALED_IMU2: "SCALED_IMU2",
    SCALED_IMU3: "SCALED_IMU3",
}
# floats before 1 mG and 1 mrad/s steps; the first IMU before its spares
RANK = {message: rank for rank, message in enumerate(NAME)}
PX4, ARDUPILOT = 12, 3  # MAV_AUTOPILOT
FILTER_PARAMETERS = ("IMU_INTEG_RATE", "INS_ACCEL_FILTER", "INS_GYRO_FILTER")

SILENT = 2.0  # s without the chosen stream until another is taken
WINDOW = 2.0  # s over which a rate is measured
PAUSE = 1.0  # s; a longer interval is a gap and no part of the rate
SLOW = 0.5  # a better stream slower than so much of another's rate gives way ...
RECOVERED = 0.7  # ... and comes back from so much on: the distance keeps two streams from taking turns
ANEW = 5.0  # s back in time that are another axis and not a late sample


class _Stream:
    """One message of one sensor."""

    __slots__ = ("count", "last", "measured", "name", "rank", "rate", "since")

    def __init__(self, message: int, sensor: int, t: float) -> None:
        self.rank = (RANK.get(message, len(RANK)), sensor)
        self.name = f"{NAME.get(message, f'message {message}')} sensor {sensor}"
        self.rate = 0.0  # [Hz]
        self.measured = False  # over a whole window
        self.last = self.since = t
        self.count = 0

    def note(self, t: float, step: float) -> None:
        """Take a sample `step` [s] after the one before."""
        self.last = t
        if not 0.0 < step <= PAUSE:
            if step > PAUSE and not self.measured:
                self.rate = 1.0 / step
            elif step > SILENT or step < 0.0:
                self.measured = False
            self.since, self.count = t, 0
            return
        self.count += 1
        span = t - self.since
        if span >= WINDOW:
            self.rate, self.measured = self.count / span, True
            self.since, self.count = t, 0
        elif not self.measured:
            self.rate = self.count / span


class ImuSelection:
    """Chooses one stream and passes its samples alone; `describe` says which, and how it was filtered.

    Attributes
    ----------
    switches : changes of the chosen stream once it was settled.
    duplicates : samples dropped because their stream had one of the same time.
    news : whether what filtered the chosen stream may have changed since `filtering` was last asked.
    """

    def __init__(self) -> None:
        self.switches = 0
        self.duplicates = 0
        self.news = True
        self._streams: dict[int, _Stream] = {}
        self._chosen: _Stream | None = None
        self._message = 0  # of the chosen stream
        self._first = math.nan
        self._last_switch = ""
        self._parameters: dict[str, float] = {}

    def set_parameter(self, name: str, value: float) -> None:
        """Take a parameter; those that tell the filtering are kept."""
        if name in FILTER_PARAMETERS and math.isfinite(value):
            self._parameters[name] = value
            self.news = True

    def feed(self, t: float, sample: Imu) -> ImuReading | None:
        """Return the reading if the sample is the chosen stream's, at vehicle time `t` [s].

        Late samples pass, with their time; duplicates, and samples without a single value, do not.
        """
        _, _, message, _, _, ax, ay, az, p, q, r, sensor, _ = sample
        key = message << 8 | sensor
        stream = self._streams.get(key)
        if az != az and r != r and ax != ax and ay != ay and p != p and q != q:
            return None
        if stream is None:
            stream = self._streams[key] = _Stream(message, sensor, t)
            if self._first != self._first:
                self._first = t
        else:
            step = t - stream.last
            if step > 0.0:
                stream.note(t, step)
            elif step == 0.0:
                self.duplicates += 1
                return None
            elif step < -ANEW:
                stream.note(t, step)
                self._first = min(self._first, t)
        if stream is not self._chosen and not self._take(t, stream, message):
            return None
        return new_tuple(ImuReading, (t, ax, ay, az, p, q, r))

    def rate(self) -> float:
        """Return the rate of the chosen stream [Hz]; 0 before any."""
        return self._chosen.rate if self._chosen is not None else 0.0

    def describe(self, autopilot: int | None = None) -> str:
        """Say which stream is used, at what rate, and which filters it has passed on board.

        Parameters
        ----------
        autopilot : MAV_AUTOPILOT; None = told from the parameters, if they tell.
        """
        if self._chosen is None:
            return "no accelerations and rates in the stream"
        said = [f"{self._chosen.name} at {self._chosen.rate:.0f} Hz"]
        others = len(self._streams) - 1
        if others:
            said[0] += f" ({others} other IMU stream{'s' if others > 1 else ''} left aside)"
        if self.switches:
            said.append(
                f"changed {self.switches} time{'s' if self.switches > 1 else ''}, {self._last_switch}"
            )
        said.append(self._filtering(autopilot))
        return "; ".join(said)

    def filtering(self, t: float, autopilot: int | None) -> ImuFilterReading:
        """Return what the accelerations of the chosen stream have passed on board, and who says so."""
        self.news = False
        autopilot = self._told(autopilot)
        if autopilot == PX4 and self._message == HIGHRES_IMU:
            rate, origin = self._parameter("IMU_INTEG_RATE", 200.0)
            return ImuFilterReading(t, 1.0 / max(rate, 1.0), math.nan, origin)
        if autopilot == ARDUPILOT:
            hertz, origin = self._parameter("INS_ACCEL_FILTER", 20.0)
            return ImuFilterReading(t, math.nan, hertz if hertz > 0.0 else math.nan, origin)
        return ImuFilterReading(t, math.nan, math.nan, "not known")

    def _take(self, t: float, stream: _Stream, message: int) -> bool:
        """Make a stream the chosen one if there is a reason to."""
        chosen = self._chosen
        if chosen is not None:
            why = self._reason(t, chosen, stream)
            if why is None:
                return False
            if why:
                self.switches += 1
                self._last_switch = f"last at {t:.1f} s from {chosen.name}, {why}"
        self._chosen, self._message = stream, message
        self.news = True
        return True

    def _reason(self, t: float, chosen: _Stream, stream: _Stream) -> str | None:
        """Return why `stream` should take over: "" while still settling, None = it should not."""
        better = stream.rank < chosen.rank
        if t - chosen.last > SILENT:
            return "which fell silent"
        if t < chosen.last - ANEW:
            return ""  # the axis began anew and the chosen stream has not come back to it
        if better and t - self._first <= WINDOW:
            return ""
        if not (stream.measured and chosen.measured):
            return None
        if better and stream.rate >= RECOVERED * chosen.rate:
            return "the lesser one"
        if not better and chosen.rate < SLOW * stream.rate:
            return "the slower one"
        return None

    def _filtering(self, autopilot: int | None) -> str:
        autopilot = self._told(autopilot)
        describe: Callable[[], str] | None = None
        if autopilot == PX4 and self._message == HIGHRES_IMU:
            describe = self._px4_highres
        elif autopilot == ARDUPILOT:
            describe = self._ardupilot
        return describe() if describe is not None else "what filtered it on board is not known"

    def _told(self, autopilot: int | None) -> int | None:
        """Which autopilot it is, from the parameters if nobody said."""
        if autopilot is not None:
            return autopilot
        return next((PX4 if n == "IMU_INTEG_RATE" else ARDUPILOT for n in self._parameters), None)

    def _px4_highres(self) -> str:
        rate, origin = self._parameter("IMU_INTEG_RATE", 200.0)
        return (
            f"each sample a mean over {1e3 / max(rate, 1.0):.1f} ms ({origin}), then sent without a filter "
            "against what lies above half the message rate: rotor lines alias (PX4 HIGHRES_IMU.hpp)"
        )

    def _ardupilot(self) -> str:
        parts = []
        for what, name in (("accelerations", "INS_ACCEL_FILTER"), ("rates", "INS_GYRO_FILTER")):
            hertz, origin = self._parameter(name, 20.0)
            how = f"low-passed at {hertz:.0f} Hz" if hertz > 0.0 else "not low-passed"
            parts.append(f"{what} {how} ({origin})")
        return ", ".join(parts) + ": rotor lines are attenuated (ArduPilot GCS_Common.cpp)"

    def _parameter(self, name: str, default: float) -> tuple[float, str]:
        value = self._parameters.get(name)
        return (default, f"{name} by default") if value is None else (value, name)
