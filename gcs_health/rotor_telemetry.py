"""What an ESC's numbers mean: fresh, stale, stopped or never reported; which ESC is which rotor.

Zeros and repeats mean different things on the two autopilots (mavlink notes):

PX4 ESC_STATUS     rpm 0 at 0 V where volts were seen = no data; with volts = stopped; where an ESC never
                   gave volts a zero is a stopped rotor once it has turned, else nobody there; but no
                   motor is fast and stands 25 ms later: then its data is lost.
                   Older PX4 repeats ESC 0-3 in every batch (PX4#23596): a copy is no ESC of its own.
ArduPilot          a dead ESC keeps its last V and A while a group mate lives; only rpm goes to 0, after
ESC_TELEMETRY_x    a second. `count` moves with each telemetry packet: frozen, V and A are stale. rpm 0
                   is a stopped rotor while count or volts move; under a count that never moved
                   (rpm-only DShot) for a second after speeds that were moving until then.
"""

import math
from enum import StrEnum

from gcs_health.airframe import Airframe
from gcs_health.esc_batches import BatchJoin, Known
from gcs_health.esc_life import LIVE_VOLTS, Esc, Timing
from gcs_health.motor_outputs import MotorOutputs
from gcs_health.samples import (
    CommandReading,
    EscInfo,
    EscStatus,
    EscTelemetry,
    Four,
    Outputs,
    RotorReading,
    RotorRpm,
    Sample,
    new_tuple,
)

NAN = math.nan
IMPOSSIBLE = 30000.0  # rad/s, 286 000 rpm: no propeller turns so fast
MOST_ESCS = 12  # as ESC_INFO.count
Batch = tuple[int | None, Four, Four, Four]  # stamp, speeds, volts and amperes of an ESC_STATUS
STALE_AFTER = 2.5  # usual intervals without news, but at least ...
STALE_LEAST = 1.0  # ... so many s
GENUINE = 3  # batches from slot 4 on that differ from ESC 0-3 before they are believed


class RotorState(StrEnum):
    """What is known of one rotor's telemetry now."""

    NOT_REPORTED = "not reported"
    FRESH = "fresh"
    STALE = "stale"
    STOPPED = "stopped"


class RotorTelemetry:
    """Turns ESC and output samples of one vehicle into readings in the airframe's rotor order.

    Attributes
    ----------
    escs : what each ESC index has shown.
    repeats : ESC_STATUS batches that were copies of ESC 0-3.
    gives_current : whether any ESC has told a current.
    temperatures : last known of each ESC index [°C].
    """

    def __init__(self) -> None:
        self.escs: dict[int, Esc] = {}
        self.repeats = 0
        self.gives_current = False
        self.temperatures: dict[int, float] = {}
        self._rotor_of: dict[int, int] = {}  # by ESC index
        self._in_order: tuple[int, ...] = ()  # ESC index of each rotor
        self._last_batch: dict[int, Batch] = {}
        self._genuine = 0
        self._outputs = MotorOutputs()
        self._count = 0  # ESC_INFO.count
        self._online_high = self._info_high = False
        self._px4 = self._ardupilot = self._rpm_only = False
        self._join = BatchJoin()
        self._well: dict[int, Timing] = {}  # of four ESCs that are well, by the first's index

    def set_airframe(self, airframe: Airframe) -> None:
        """Take the order of rotors and which ESC is whose."""
        self._rotor_of = {rotor.esc: k for k, rotor in enumerate(airframe.rotors)}
        self._in_order = tuple(rotor.esc for rotor in airframe.rotors)
        self._outputs.set_motors(tuple((rotor.motor, rotor.esc) for rotor in airframe.rotors))

    def set_output_channels(self, channels: dict[int, int]) -> None:
        """Take which output channel (from 0) drives which motor (from 1); without it a motor's ESC index."""
        self._outputs.set_channels(channels)

    @property
    def output_channels(self) -> tuple[int, ...]:
        """The output channel, from 0, of each rotor."""
        return self._outputs.channels

    def feed(self, t: float, sample: Sample) -> RotorReading | CommandReading | None:
        """Return what is new of the rotors at vehicle time `t` [s]; None if nothing or no airframe is."""
        if isinstance(sample, EscStatus):
            return self._esc_status(t, sample)
        if isinstance(sample, Outputs):
            return self._outputs.feed(t, sample)
        if isinstance(sample, EscTelemetry):
            return self._esc_telemetry(t, sample)
        if isinstance(sample, EscInfo):
            self._px4 = True
            self._note_temperatures(sample)
            if self._count < sample.count <= MOST_ESCS:
                self._count = sample.count
            if sample.index >= 4:
                self._info_high |= sample.online != 0
                self._online_high |= sample.online >> 4 != 0
        elif isinstance(sample, RotorRpm):
            self._rpm_only = True
        return None

    def esc_indices(self) -> tuple[int, ...]:
        """Return the ESCs that are there: turned or gave volts, or counted by ESC_INFO."""
        there = {k for k, esc in self.escs.items() if esc.turned or esc.volts_seen}
        return tuple(sorted(there.union(range(self._count)) if there else there))

    def esc_count(self) -> int:
        """Return the highest ESC index that is there, plus one."""
        return max(self.esc_indices(), default=-1) + 1

    def state(self, esc: int, t: float) -> RotorState:
        """Return the state of ESC index `esc` at time `t` [s]."""
        known = self.escs.get(esc)
        if known is None or known.timing.news == -math.inf:
            return RotorState.NOT_REPORTED
        limit = STALE_AFTER * known.timing.interval
        if t - known.timing.news > (limit if limit > STALE_LEAST else STALE_LEAST):
            return RotorState.STALE
        return RotorState.STOPPED if known.speed == 0.0 else RotorState.FRESH

    def age(self, esc: int, t: float) -> float:
        """Return how long ago ESC index `esc` gave news [s]; infinite if it never did."""
        known = self.escs.get(esc)
        return t - known.timing.news if known is not None else math.inf

    def _note_temperatures(self, sample: EscInfo | EscTelemetry) -> None:
        for slot, value in enumerate(sample.temperature_degc):
            if value == value and value != 0.0:  # an ESC without a sensor sends 0
                self.temperatures[sample.index + slot] = value

    def rate(self, esc: int) -> float:
        """Return how often ESC index `esc` gives news [Hz]; 0 if it does not."""
        known = self.escs.get(esc)
        return 1.0 / known.timing.interval if known is not None and known.timing.interval > 0.0 else 0.0

    def fastest(self) -> float:
        """Return the highest rate of the rotors' ESCs [Hz], of all while no airframe is known; 0 without news."""
        return max((self.rate(esc) for esc in self._in_order or self.escs), default=0.0)

    def notes(self) -> tuple[str, ...]:
        """Say what kind of telemetry this is and what it cannot tell."""
        said = []
        if self._ardupilot:
            said.append("ArduPilot ESC_TELEMETRY by servo output channel")
            bare = [k for k, esc in sorted(self.escs.items()) if esc.turned and esc.count == 0]
            if bare:
                said.append(f"speed alone, no volts or amperes, from ESC {', '.join(map(str, bare))}")
        if self._px4:
            said.append(self._generation())
            turned = [esc for esc in self.escs.values() if esc.turned]
            if turned and not any(esc.volts_seen for esc in turned):
                said.append(
                    "no ESC gives volts: a speed of 0 is taken for a stopped rotor, it may be lost data"
                )
        if self._rpm_only and not self.escs:
            said.append("RPM or RAW_RPM alone: speed sensors that name no rotor, not used")
        return tuple(said)

    def _generation(self) -> str:
        if self._repeating():
            return (
                "PX4 ESC_STATUS of the first generation (to about 1.15): every batch repeats ESC 0-3, "
                "rotors from 5 on are not reported"
            )
        if self._online_high:
            return "PX4 ESC_STATUS of the second generation (about 1.16): slots in driver order"
        if self._info_high and self._genuine >= GENUINE:
            return "PX4 ESC_STATUS of the third generation (after 1.16): slot = motor number - 1"
        if self._genuine >= GENUINE:
            return (
                "PX4 ESC_STATUS of the second or third generation: without ESC_INFO it cannot be told which"
            )
        return "PX4 ESC_STATUS: from one batch of four its generation cannot be told"

    def _repeating(self) -> bool:
        """Whether the batches from slot 4 on are copies; lost frames make some look genuine."""
        return self.repeats > 0 and self._genuine <= 2 * self.repeats

    def _is_copy(self, batch: Batch) -> bool:
        """Whether a batch from slot 4 on is ESC 0-3 again, or may be for all that is known yet."""
        time_us, speed4, voltage4, _ = batch
        first = self._last_batch.get(0)
        if any(speed4) or any(voltage4):
            if first is not None and first[1:] == batch[1:]:
                self.repeats += 1
                return True
            same_moment = first is not None and first[0] == time_us
            self._genuine += GENUINE if same_moment else 1
        return self._genuine < GENUINE or self._repeating()

    def _esc_status(self, t: float, sample: EscStatus) -> RotorReading | None:
        _, _, _, _, time_us, first, speed4, voltage4, current4 = sample
        batch = (time_us, speed4, voltage4, current4)
        if time_us and self._last_batch.get(first) == batch:
            return None  # a duplicate is not news
        self._last_batch[first] = batch
        self._px4 = True
        if first >= 4 and self._is_copy(batch):
            return None
        live = sum(speed4) + sum(voltage4)  # NaN hides from min and max, not from this
        if live == live and min(speed4) > 0.0 and max(speed4) < IMPOSSIBLE and min(voltage4) > LIVE_VOLTS:
            self._note_well(t, first, speed4)
            known = new_tuple(Known, (tuple(range(first, first + 4)), speed4, current4, voltage4))
        else:
            known = self._sort_out(t, sample)
        joined = self._join.feed(t, first, known)
        return self._reading(*joined) if joined is not None else None

    def _note_well(self, t: float, first: int, speed4: Four) -> None:
        """Note four ESCs that all turn and have volts, by far the most frequent case: once for all."""
        timing = self._well.get(first)
        if timing is not None:
            timing.note(t)
            return
        escs = [self.escs.setdefault(index, Esc()) for index in range(first, first + 4)]
        for esc, speed in zip(escs, speed4, strict=True):
            esc.volts_seen = True
            esc.note(t, speed)
        timing = escs[0].timing
        if all(esc.timing.news == timing.news and esc.timing.interval == timing.interval for esc in escs):
            self._well[first] = timing
            for esc in escs:
                esc.timing = timing

    def _sort_out(self, t: float, sample: EscStatus) -> Known:
        """Note each of four ESCs for itself; return what is known of them."""
        indices = range(sample.index, sample.index + 4)
        if self._well.pop(sample.index, None) is not None:
            for index in indices:
                self.escs[index].timing = self.escs[index].timing.copy()
        known = []
        for index, speed, voltage, current in zip(
            indices, sample.speed, sample.voltage, sample.current, strict=True
        ):
            speed = abs(speed)
            esc = self.escs.get(index)
            if esc is None:
                esc = self.escs[index] = Esc()
            if voltage > LIVE_VOLTS:
                esc.volts_seen = True
            else:
                if esc.lost(t, speed) or (speed == 0.0 and (esc.volts_seen or not esc.turned)):
                    continue
                voltage = NAN
                if not current:
                    current = NAN
            if not speed < IMPOSSIBLE:
                continue
            esc.note(t, speed)
            known.append((index, speed, current, voltage))
        return Known.of(known)

    def _esc_telemetry(self, t: float, sample: EscTelemetry) -> RotorReading | None:
        self._ardupilot = True
        self._note_temperatures(sample)
        known = []
        for j in range(4):
            index = sample.index + j
            esc = self.escs.get(index)
            if esc is None:
                esc = self.escs[index] = Esc()
            speed, voltage, current = abs(sample.speed[j]), sample.voltage[j], sample.current[j]
            count = esc.count
            stopped = esc.stopped(t, speed, voltage, sample.count[j])
            if voltage > LIVE_VOLTS:
                esc.volts_seen = True
            if not speed < IMPOSSIBLE or (speed == 0.0 and not stopped):
                continue
            if speed == 0.0 and not (esc.turned or esc.volts_seen):
                continue
            esc.note(t, speed)
            if count is None or count == sample.count[j]:  # nothing but the speed is new
                voltage = current = NAN
            known.append((index, speed, current, voltage))
        return self._reading(t, Known.of(known))

    def _reading(self, t: float, known: Known) -> RotorReading | None:
        """Put what is known of ESCs in rotor order."""
        if known.escs and known.escs == self._in_order:  # all of them, and in the rotors' order already
            if not self.gives_current:
                self.gives_current = any(current > 0.0 for current in known.current)
            return new_tuple(RotorReading, (t, *known[1:]))
        n = len(self._in_order)
        speeds, currents, volts, any_known = [NAN] * n, [NAN] * n, [NAN] * n, False
        for index, speed, current, voltage in zip(*known, strict=True):
            rotor = self._rotor_of.get(index)
            if rotor is not None:
                speeds[rotor], currents[rotor], volts[rotor], any_known = speed, current, voltage, True
                if current > 0.0:
                    self.gives_current = True
        return RotorReading(t, tuple(speeds), tuple(currents), tuple(volts)) if any_known else None
