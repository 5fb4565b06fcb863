"""Which of several IMU streams the estimators see, and what filtering it has had."""

import math
from dataclasses import dataclass

from gcs_health.samples import Imu, ImuReading

HIGHRES_IMU, SCALED_IMU, RAW_IMU, SCALED_IMU2, SCALED_IMU3 = 105, 26, 27, 116, 129
# float and unfiltered before int16 and low-passed; the primary IMU before its spares
RANK = {HIGHRES_IMU: 0, SCALED_IMU: 1, RAW_IMU: 2, SCALED_IMU2: 3, SCALED_IMU3: 4}
NAME = {
    HIGHRES_IMU: "HIGHRES_IMU",
    SCALED_IMU: "SCALED_IMU",
    RAW_IMU: "RAW_IMU",
    SCALED_IMU2: "SCALED_IMU2",
    SCALED_IMU3: "SCALED_IMU3",
}
SILENT = 2.0  # s without the chosen stream until another is taken
FASTER = 2.0  # a lower-ranked stream must be so many times faster to be preferred
SETTLED = 20  # samples until a stream's rate is known
PX4, ARDUPILOT = 12, 3


@dataclass(slots=True)
class _Stream:
    rank: tuple[int, int]
    last: float = -math.inf
    count: int = 0
    interval: float = math.nan  # usual time between samples [s]

    def note(self, t: float) -> bool:
        """Take a sample's time; False for one that does not go on."""
        step = t - self.last
        if step <= 0.0:
            return False
        if self.count:
            usual = self.interval
            # a clipped mean: gaps do not slow it, a faster stream is followed
            self.interval = step if usual != usual else usual + 0.05 * (min(step, 3 * usual) - usual)
        self.last = t
        self.count += 1
        return True


class ImuSelection:
    """Chooses one stream and passes only its samples on; `describe` says which and why it may be trusted."""

    def __init__(self) -> None:
        self._streams: dict[tuple[int, int], _Stream] = {}
        self._chosen: tuple[int, int] | None = None
        self._parameters: dict[str, float] = {}
        self.switches = 0
        self.duplicates = 0

    def set_parameter(self, name: str, value: float) -> None:
        """Take a parameter that tells the filtering."""
        if name in ("IMU_INTEG_RATE", "INS_ACCEL_FILTER", "INS_GYRO_FILTER"):
            self._parameters[name] = value

    def feed(self, t: float, sample: Imu) -> ImuReading | None:
        """Return the reading if the sample is the chosen stream's and new, at vehicle time `t` [s]."""
        key = (sample.message, sample.sensor)
        stream = self._streams.get(key)
        if stream is None:
            stream = self._streams[key] = _Stream((RANK.get(sample.message, 9), sample.sensor))
        if not stream.note(t):
            self.duplicates += 1
            return None
        if key != self._chosen and not self._choose(t, key, stream):
            return None
        return ImuReading(t, sample.ax, sample.ay, sample.az, sample.p, sample.q, sample.r)

    def rate(self) -> float:
        """Rate of the chosen stream [Hz]; 0 before any."""
        if self._chosen is None:
            return 0.0
        interval = self._streams[self._chosen].interval
        return 1.0 / interval if interval > 0.0 else 0.0

    def describe(self, autopilot: int | None) -> str:
        """Say which stream is used, at what rate, and what filters it has passed."""
        if self._chosen is None:
            return "no accelerations and rates in the stream"
        message, sensor = self._chosen
        others = len(self._streams) - 1
        said = f"{NAME.get(message, message)} sensor {sensor} at {self.rate():.0f} Hz"
        if others:
            said += f" ({others} other IMU stream{'s' if others > 1 else ''} left aside)"
        return f"{said}; {self._filtering(message, autopilot)}"

    def _choose(self, t: float, key: tuple[int, int], stream: _Stream) -> bool:
        """Whether to take this stream instead of the chosen one."""
        if self._chosen is not None:
            chosen = self._streams[self._chosen]
            silent = t - chosen.last > SILENT
            settled = stream.count >= SETTLED and chosen.count >= SETTLED
            faster = settled and stream.interval * FASTER < chosen.interval
            better = stream.rank < chosen.rank and settled and stream.interval < chosen.interval * FASTER
            if not (silent or faster or better):
                return False
            self.switches += 1
        self._chosen = key
        return True

    def _filtering(self, message: int, autopilot: int | None) -> str:
        seen = self._parameters
        if autopilot == PX4 and message == HIGHRES_IMU:
            rate = seen.get("IMU_INTEG_RATE", 200.0)
            source = "IMU_INTEG_RATE" if "IMU_INTEG_RATE" in seen else "IMU_INTEG_RATE's default"
            return f"each a mean over {1e3 / max(rate, 1.0):.1f} ms ({source}), rotor lines may alias"
        if autopilot == ARDUPILOT:
            hertz = seen.get("INS_ACCEL_FILTER", 20.0)
            source = "INS_ACCEL_FILTER" if "INS_ACCEL_FILTER" in seen else "INS_ACCEL_FILTER's default"
            return f"low-passed at {hertz:.0f} Hz ({source}), rotor lines are attenuated"
        return "filtering on board not known"
