"""What is in a stream: who speaks, how often, what is missing. The facts behind `gcs-health info`."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.needs import Need

if TYPE_CHECKING:
    from gcs_health.mavlink.batch import FrameBatch


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
    needs: dict[str, tuple[Need, ...]]  # by estimator


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
    """Running count of one message of one sender; times in UNIX µs."""

    count: int = 0
    first_us: int = 0
    last_us: int = 0
    longest_us: int = 0

    def add(self, first_us: int, last_us: int, count: int = 1, longest_us: int = 0) -> None:
        """Count arrivals from `first_us` to `last_us`, `longest_us` the longest silence among them."""
        if self.count:
            self.longest_us = max(self.longest_us, longest_us, first_us - self.last_us)
        else:
            self.first_us, self.longest_us = first_us, longest_us
        self.count += count
        self.last_us = last_us

    @property
    def rate(self) -> float:
        """Arrivals a second [Hz] between the first and the last; NaN for fewer than two."""
        span = self.last_us - self.first_us
        return (self.count - 1) * 1e6 / span if self.count > 1 and span > 0 else float("nan")


@dataclass(slots=True)
class Census:
    """Counts every frame by who sent it and what it was."""

    tallies: dict[tuple[int, int, int], Tally] = field(default_factory=dict)

    def add(self, batch: "FrameBatch") -> None:
        """Count the frames of a batch."""
        if batch.few:
            for frame in batch.frames:
                self._tally(frame.system, frame.component, frame.message).add(
                    frame.receive_us, frame.receive_us
                )
            return
        columns = batch.columns
        keys = columns.message << 16 | columns.system.astype(int) << 8 | columns.component
        order = np.argsort(keys, kind="stable")
        for part in np.split(order, np.flatnonzero(np.diff(keys[order])) + 1):
            key, at = int(keys[part[0]]), columns.receive_us[part]
            silence = int(np.diff(at).max()) if len(at) > 1 else 0
            tally = self._tally(key >> 8 & 0xFF, key & 0xFF, key >> 16)
            tally.add(int(at[0]), int(at[-1]), len(at), max(silence, 0))

    def senders(self) -> list[tuple[int, int]]:
        """Return every (system, component) that spoke, in order."""
        return sorted({(system, component) for system, component, _ in self.tallies})

    def rates(self, system: int, component: int) -> dict[int, float]:
        """Return the rate of each message of one sender [Hz], by message id."""
        return {m: t.rate for (s, c, m), t in sorted(self.tallies.items()) if (s, c) == (system, component)}

    def rates_until(self, system: int, component: int, now_us: int) -> dict[int, float]:
        """Return arrivals a second of each message of one sender, from its first frame to `now_us`."""
        mine = {m: t for (s, c, m), t in self.tallies.items() if (s, c) == (system, component)}
        span = now_us - min((tally.first_us for tally in mine.values()), default=now_us)
        return {m: tally.count * 1e6 / span for m, tally in mine.items()} if span > 0 else {}

    def span(self) -> tuple[int | None, int | None]:
        """Return the first and the last arrival [UNIX µs]; None where nothing came."""
        tallies = self.tallies.values()
        return (
            min((t.first_us for t in tallies), default=None),
            max((t.last_us for t in tallies), default=None),
        )

    def system(
        self, sender: tuple[int, int], role: str, lost: int, name_of: Callable[[int], str]
    ) -> SystemSurvey:
        """Return what one sender sent."""
        mine = {m: t for (s, c, m), t in sorted(self.tallies.items()) if (s, c) == sender}
        return SystemSurvey(
            system=sender[0],
            component=sender[1],
            role=role,
            messages=tuple(
                MessageSurvey(m, name_of(m), t.count, t.rate, t.longest_us * 1e-6) for m, t in mine.items()
            ),
            frames=sum(t.count for t in mine.values()),
            lost=lost,
            first_us=min(t.first_us for t in mine.values()),
            last_us=max(t.last_us for t in mine.values()),
        )

    def _tally(self, system: int, component: int, message: int) -> Tally:
        key = (system, component, message)
        tally = self.tallies.get(key)
        if tally is None:
            tally = self.tallies[key] = Tally()
        return tally
