"""What an ESC's numbers mean: fresh, stale, stopped or never reported; which ESC is which rotor.

Zeros and repeats mean different things on the two autopilots (mavlink.md sections 3 and 4):

PX4 ESC_STATUS     rpm 0 with 0 V where volts were seen = no data; with volts = stopped; where no ESC
                   ever gave volts a zero is a stopped rotor once it has turned.
                   Older PX4 repeats ESC 0-3 in every batch (PX4#23596): a copy is no ESC of its own.
ArduPilot          a dead ESC keeps its last V and A while a group mate lives, only rpm goes to 0, after
ESC_TELEMETRY_x    1 s; `count` moves with each telemetry packet. Count frozen = V and A stale; rpm 0
                   under a frozen count = unknown, not stopped.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum

from gcs_health.airframe import Airframe
from gcs_health.samples import (
    CommandReading,
    EscInfo,
    EscStatus,
    EscTelemetry,
    Four,
    Outputs,
    RotorReading,
    Sample,
)

NAN = math.nan
IMPOSSIBLE = 20000.0  # rad/s, 190 000 rpm: no propeller turns so fast
LIVE_VOLTS = 1.0  # V; below, an ESC gives no voltage
STALE_AFTER = 2.5  # usual intervals without news
COMMAND_SILENT = 2.0  # s until another output stream is taken
ACTUATOR_OUTPUT_STATUS, SERVO_OUTPUT_RAW = 375, 36


class RotorState(StrEnum):
    """What is known of one rotor's telemetry now."""

    NOT_REPORTED = "not reported"
    FRESH = "fresh"
    STALE = "stale"
    STOPPED = "stopped"


@dataclass(slots=True)
class _Esc:
    """What one ESC index has shown so far."""

    turned: bool = False
    volts_seen: bool = False
    speed: float = NAN  # last known [rad/s]
    news: float = -math.inf  # when [s]
    interval: float = NAN
    count: int | None = None  # ArduPilot's packet counter

    def note(self, t: float, speed: float) -> None:
        step = t - self.news
        if 0.0 < step < math.inf:
            usual = self.interval
            self.interval = step if usual != usual else usual + 0.05 * (min(step, 3 * usual) - usual)
        self.news = max(t, self.news)
        self.speed = speed


@dataclass(slots=True)
class _Unit:
    """The unit of one output stream, told from the largest value it has shown; it only grows."""

    last: float = -math.inf
    offset: float = 0.0
    span: float = 1.0

    def learn(self, largest: float) -> None:
        if largest <= 1.001 or largest <= self.offset + self.span:
            return
        if largest <= 2200.0 and largest >= 800.0:
            self.offset, self.span = 1000.0, 1000.0  # PWM µs
        elif largest <= 2047.0:
            self.offset, self.span = 0.0, 2000.0  # DShot
        elif largest > 2200.0:
            self.offset, self.span = 0.0, 8191.0  # UAVCAN raw

    def command(self, value: float) -> float:
        if value != value:
            return NAN
        return min(max((value - self.offset) / self.span, 0.0), 1.0)


@dataclass(slots=True)
class RotorTelemetry:
    """Turns ESC and output samples of one vehicle into readings in the airframe's rotor order."""

    escs: dict[int, _Esc] = field(default_factory=dict)
    repeats: int = 0  # batches that copied ESC 0-3
    _rotor_of: dict[int, int] = field(default_factory=dict)
    _channel_of: tuple[int, ...] = ()  # output channel of each rotor
    _count: int = 0
    _last_batch: dict[int, tuple[int | None, Four, Four, Four]] = field(default_factory=dict)
    _units: dict[tuple[int, int], _Unit] = field(default_factory=dict)
    _outputs: tuple[int, int] | None = None
    _online_high: bool = False
    _info_batches: set[int] = field(default_factory=set)
    _ardupilot: bool = False

    def set_airframe(self, airframe: Airframe) -> None:
        """Take the order of rotors and which ESC is whose."""
        self._count = len(airframe.rotors)
        self._rotor_of = {rotor.esc: k for k, rotor in enumerate(airframe.rotors)}
        self._channel_of = tuple(rotor.esc for rotor in airframe.rotors)

    def feed(self, t: float, sample: Sample) -> RotorReading | CommandReading | None:
        """Return what is new of the rotors at vehicle time `t` [s]; None if nothing is."""
        if isinstance(sample, EscStatus):
            return self._esc_status(t, sample)
        if isinstance(sample, EscTelemetry):
            return self._esc_telemetry(t, sample)
        if isinstance(sample, Outputs):
            return self._command(t, sample)
        if isinstance(sample, EscInfo):
            self._info_batches.add(sample.index)
            self._online_high |= sample.index >= 4 and bool(sample.online >> 4)
        return None

    def esc_count(self) -> int:
        """Return how many ESCs have reported: the highest index that ever turned or gave volts, plus one."""
        return max((k + 1 for k, esc in self.escs.items() if esc.turned or esc.volts_seen), default=0)

    def state(self, esc: int, t: float) -> RotorState:
        """Return the state of ESC index `esc` at time `t` [s]."""
        known = self.escs.get(esc)
        if known is None or known.news == -math.inf:
            return RotorState.NOT_REPORTED
        if t - known.news > max(1.0, STALE_AFTER * known.interval):
            return RotorState.STALE
        return RotorState.STOPPED if known.speed == 0.0 else RotorState.FRESH

    def rate(self, esc: int) -> float:
        """Return how often an ESC gives news [Hz]; 0 if it does not."""
        known = self.escs.get(esc)
        return 1.0 / known.interval if known is not None and known.interval > 0.0 else 0.0

    def notes(self) -> tuple[str, ...]:
        """Say what kind of telemetry this is."""
        if self._ardupilot:
            return ("ArduPilot ESC_TELEMETRY by servo output channel; a frozen count means stale V and A",)
        if not self.escs:
            return ()
        if self.repeats:
            return (
                "PX4 ESC_STATUS of the first generation (to 1.15): every batch repeats ESC 0-3, "
                "rotors from 5 on are not reported",
            )
        if len(self.escs) <= 4 or not any(index >= 4 for index in self._info_batches):
            return ("PX4 ESC_STATUS; the generation cannot be told from one batch of four",)
        if self._online_high:
            return ("PX4 ESC_STATUS of the second generation (about 1.16): slots in driver order",)
        return ("PX4 ESC_STATUS of the third generation (after 1.16): slot = motor number - 1",)

    def _esc_status(self, t: float, sample: EscStatus) -> RotorReading | None:
        batch = (sample.time_us, sample.speed, sample.voltage, sample.current)
        if self._last_batch.get(sample.index) == batch:
            return None  # a duplicate is not news
        self._last_batch[sample.index] = batch
        if sample.index >= 4 and any(sample.speed):
            first = self._last_batch.get(0)
            if first is not None and first[1:] == batch[1:]:
                self.repeats += 1
                return None
        speeds, currents, volts = [NAN] * self._count, [NAN] * self._count, [NAN] * self._count
        for j in range(4):
            index = sample.index + j
            esc = self.escs.get(index)
            if esc is None:
                esc = self.escs[index] = _Esc()
            speed = abs(sample.speed[j])
            voltage = sample.voltage[j]
            if voltage > LIVE_VOLTS:
                esc.volts_seen = True
            elif speed == 0.0 and (esc.volts_seen or not esc.turned):
                continue  # zeros where there were volts: no data; zeros from the start: nobody there
            if not speed < IMPOSSIBLE:
                continue
            esc.turned |= speed > 0.0
            esc.note(t, speed)
            rotor = self._rotor_of.get(index)
            if rotor is not None:
                speeds[rotor] = speed
                if esc.volts_seen:
                    currents[rotor], volts[rotor] = sample.current[j], voltage
        return self._reading(t, speeds, currents, volts)

    def _esc_telemetry(self, t: float, sample: EscTelemetry) -> RotorReading | None:
        self._ardupilot = True
        speeds, currents, volts = [NAN] * self._count, [NAN] * self._count, [NAN] * self._count
        for j in range(4):
            index = sample.index + j
            esc = self.escs.get(index)
            if esc is None:
                esc = self.escs[index] = _Esc()
            speed, count = sample.speed[j], sample.count[j]
            moved = esc.count is not None and count != esc.count
            esc.count = count
            esc.volts_seen |= sample.voltage[j] > LIVE_VOLTS
            if speed == 0.0 and not moved:
                continue
            if not speed < IMPOSSIBLE:
                continue
            esc.turned |= speed > 0.0
            esc.note(t, speed)
            rotor = self._rotor_of.get(index)
            if rotor is not None:
                speeds[rotor] = speed
                if moved:
                    currents[rotor], volts[rotor] = sample.current[j], sample.voltage[j]
        return self._reading(t, speeds, currents, volts)

    def _reading(
        self, t: float, speeds: list[float], currents: list[float], volts: list[float]
    ) -> RotorReading | None:
        if all(speed != speed for speed in speeds):
            return None
        return RotorReading(t, tuple(speeds), tuple(currents), tuple(volts))

    def _command(self, t: float, sample: Outputs) -> CommandReading | None:
        stream = (sample.message, sample.port)
        if sample.message not in (ACTUATOR_OUTPUT_STATUS, SERVO_OUTPUT_RAW) or sample.port:
            return None
        unit = self._units.setdefault(stream, _Unit())
        unit.learn(max((v for v in sample.value if v == v), default=0.0))
        unit.last = t
        if self._outputs != stream:
            if self._outputs is not None and t - self._units[self._outputs].last < COMMAND_SILENT:
                return None
            self._outputs = stream
        value = sample.value
        commands = [unit.command(value[c]) if c < len(value) else NAN for c in self._channel_of]
        return CommandReading(t, tuple(commands)) if commands else None
