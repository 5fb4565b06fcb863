"""What is in a stream: who speaks, how often, what is missing. The facts behind `gcs-health info`."""

from dataclasses import dataclass, field

from gcs_health.airframe import Airframe
from gcs_health.needs import Need


@dataclass(frozen=True, slots=True)
class MessageSurvey:
    """One message of one system: how many, how often, the longest silence."""

    message: int
    name: str
    count: int
    rate: float  # [Hz], over the time between its first and last; NaN for fewer than two
    longest_gap: float  # [s], by receive time


@dataclass(frozen=True, slots=True)
class SystemSurvey:
    """One (system, component) that spoke."""

    system: int
    component: int
    role: str
    messages: tuple[MessageSurvey, ...]
    frames: int
    lost: int  # by sequence numbers
    first_us: int
    last_us: int


@dataclass(frozen=True, slots=True)
class VehicleSurvey:
    """What is known of one vehicle, and what its estimators would need."""

    vehicle: str  # "sysid.compid"
    autopilot: int | None
    vehicle_type: int | None
    airframe: Airframe | None
    clock: tuple[str, ...]  # sentences
    imu: str
    rotor_telemetry: tuple[str, ...]
    gaps: tuple[tuple[float, float], ...]  # (vehicle clock [s], length [s])
    needs: tuple[Need, ...]


@dataclass(frozen=True, slots=True)
class Survey:
    """The whole stream."""

    first_us: int | None
    last_us: int | None
    systems: tuple[SystemSurvey, ...]
    vehicles: tuple[VehicleSurvey, ...]
    counters: tuple[tuple[str, int], ...]  # frames and bytes, kept and dropped, by reason


@dataclass(slots=True)
class Tally:
    """Running count of one message of one system."""

    count: int = 0
    first_us: int = 0
    last_us: int = 0
    longest_us: int = 0

    def add(self, receive_us: int) -> None:
        """Count one arrival."""
        if self.count:
            silence = receive_us - self.last_us
            if silence > self.longest_us:
                self.longest_us = silence
        else:
            self.first_us = receive_us
        self.count += 1
        self.last_us = receive_us

    @property
    def rate(self) -> float:
        """Arrivals a second [Hz] between the first and the last; NaN for fewer than two."""
        span = self.last_us - self.first_us
        return (self.count - 1) * 1e6 / span if self.count > 1 and span > 0 else float("nan")


@dataclass(slots=True)
class Census:
    """Counts every sample by who sent it and what it was."""

    tallies: dict[tuple[int, int, int], Tally] = field(default_factory=dict)

    def add(self, system: int, component: int, message: int, receive_us: int) -> None:
        """Count one sample."""
        key = (system, component, message)
        tally = self.tallies.get(key)
        if tally is None:
            tally = self.tallies[key] = Tally()
        tally.add(receive_us)

    def rate(self, system: int, component: int, messages: tuple[int, ...]) -> float:
        """Rate of the most frequent of `messages` [Hz], 0 where none came."""
        rates = [t.rate for m in messages if (t := self.tallies.get((system, component, m))) is not None]
        return max((r for r in rates if r == r), default=0.0)
