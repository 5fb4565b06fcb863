"""A replay that can be moved in time: a forerunner reads the flight once and leaves checkpoints, a player shows it.

The forerunner is what `replay` is without a screen: its events are the session's. It leaves a copy of all estimators
every ten seconds. The player goes on from the nearest copy before the moment wanted; backwards it plays a film of the
stretch from there.
"""

import math
import threading
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from gcs_health.dashboard.commands import Command, Pause, Reverse, Seek, Speed, Step
from gcs_health.dashboard.interface import PICTURE_US, Worker
from gcs_health.dashboard.model import Model
from gcs_health.dashboard.snapshot import ReplayShot, Snapshot
from gcs_health.dashboard.tape import Tape
from gcs_health.dashboard.watch import RawTap, obey
from gcs_health.monitor_config import Tap
from gcs_health.pipeline import Monitor
from gcs_health.record.events import AlertEvent, Event, VehicleEvent

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, math.inf)
FASTEST_BACK = 16.0
CHECKPOINT_US = 10_000_000
CHECKPOINTS = 48  # kept at most; then every other one goes
PIECE = 1 << 15  # bytes fed at once when time does not matter
BUSY = 0.08  # s of a picture's time that reading as fast as possible may take

Make = Callable[[Tap, RawTap | None], Monitor]
Take = Callable[[list[Event]], None]


@dataclass
class Reading:
    """One reading of the tape: the monitor, what the screen remembers, and how far it is."""

    tape: Tape
    monitor: Monitor
    model: Model
    at: int = 0
    us: int = 0  # of what was read last
    next_us: int = 0  # of what comes next

    @classmethod
    def begin(cls, tape: Tape, make: Make, name: str, raw_tap: RawTap | None = None) -> "Reading":
        """Return one that has read nothing yet."""
        model = Model((name,))

        def frames(batch) -> None:  # type: ignore[no-untyped-def]
            if raw_tap is not None:
                raw_tap(batch)
            model.frames(batch)

        model.monitor = make(model.tap, frames)
        return cls(tape, model.monitor, model, us=tape.start_us, next_us=tape.start_us)

    def copy(self) -> "Reading":
        """Return one that goes on by itself."""
        monitor = self.monitor.copy()
        model = self.model.copy(monitor)
        monitor.set_taps(model.tap, model.frames)
        return replace(self, monitor=monitor, model=model)

    @property
    def over(self) -> bool:
        """Whether all has been read."""
        return self.at >= len(self.tape.data)

    def read(self, us: int, most: int = PIECE) -> list[Event]:
        """Read what came until `us`, at most so many bytes."""
        end, self.next_us = self.tape.until(self.at, us, most)
        if end == self.at:
            return []
        events = self.monitor.feed(self.tape.data[self.at : end])
        self.at = end
        self.model.take(events)
        self.us = max(self.us, self._now()) if self.tape.stamped else self._now()
        return events

    def read_until(self, us: int, go_on: Callable[[], bool] = lambda: True) -> None:
        """Read all that came until `us`, unless told to stop."""
        while not self.over and go_on():
            before = self.at
            self.read(us)
            if self.at == before or (not self.tape.stamped and self.us >= us):
                return

    def snapshot(self, us: int) -> Snapshot:
        """Return the picture at `us`."""
        return self.model.snapshot(us if self.tape.stamped else 0)

    def _now(self) -> int:
        vehicles = self.monitor.vehicles()
        if self.tape.stamped:
            return max((vehicle.last_us for vehicle in vehicles), default=0)
        known = [vehicle.last_t for vehicle in vehicles if math.isfinite(vehicle.last_t)]
        return int(max(known, default=0.0) * 1e6)


@dataclass
class Forerunner:
    """Reads the flight once, as fast as it may, and leaves checkpoints, marks and the session's events."""

    reading: Reading
    take: Take
    checkpoints: list[Reading] = field(default_factory=list)
    marks: list[tuple[int, int]] = field(default_factory=list)
    armings: list[tuple[int, bool]] = field(default_factory=list)
    done: bool = False
    error: BaseException | None = None
    halted: bool = False
    every_us: int = CHECKPOINT_US

    @property
    def scanned(self) -> float:
        """How much of the flight has been read."""
        return 1.0 if self.done else self.reading.at / max(len(self.reading.tape.data), 1)

    def run(self) -> None:
        """Read to the end, or until halted."""
        try:
            self.checkpoints.append(self.reading.copy())
            while not self.reading.over and not self.halted:
                self._note(self.reading.read(1 << 62))
                if self.reading.us - self.checkpoints[-1].us >= self.every_us:
                    self.checkpoints.append(self.reading.copy())
                    if len(self.checkpoints) > CHECKPOINTS:
                        self.checkpoints = self.checkpoints[::2]
                        self.every_us *= 2
            if self.reading.over:
                self._note(self.reading.monitor.finish())
                self.done = True
        except BaseException as error:
            self.error = error

    def before(self, us: int) -> Reading:
        """Return a reading of one's own from the last checkpoint before a moment."""
        known = self.checkpoints
        at = bisect_right([checkpoint.us for checkpoint in known], us) - 1
        return known[max(at, 0)].copy()

    def _note(self, events: list[Event]) -> None:
        for event in events:
            us = event.t_unix_us or int(event.t * 1e6)
            if isinstance(event, AlertEvent) and event.state == "raised":
                self.marks.append((us, event.severity))
            elif isinstance(event, VehicleEvent) and event.change == "flight" and event.armed is not None:
                self.armings.append((us, event.armed))
        self.take(events)


class Player:
    """Shows the flight, at whatever speed and in whichever direction."""

    def __init__(self, worker: Worker, name: str, forerunner: Forerunner) -> None:
        self._worker, self._name, self._fore = worker, name, forerunner
        self._tape = forerunner.reading.tape
        self._reading = forerunner.before(0)
        self.now = float(self._tape.start_us)
        self.playing, self.backwards = True, False
        self._speed = SPEEDS.index(1.0)
        self._film: list[tuple[int, Snapshot]] = []

    @property
    def speed(self) -> float:
        """Times real time."""
        return SPEEDS[self._speed]

    @property
    def end_us(self) -> int:
        """Where the flight ends, as far as that is known."""
        return self._tape.end_us or self._fore.reading.us

    def turn(self, elapsed: float) -> Snapshot:
        """Do what was asked for, go on by so many seconds of the operator's, return the picture."""
        target = self._obey()
        if target is not None:
            self._go_to(target)
        elif self.playing and self.backwards:
            self._back(elapsed)
        elif self.playing:
            self._forward(elapsed)
        return self._picture()

    def _picture(self) -> Snapshot:
        shown = self._framed() if self.backwards and self._film else self._reading.snapshot(int(self.now))
        replay = ReplayShot(
            self._name,
            self._tape.start_us or (self._fore.checkpoints[1].us if len(self._fore.checkpoints) > 1 else 0),
            self.end_us,
            int(self.now),
            self.playing,
            self.backwards,
            self.speed,
            self._fore.scanned,
            tuple(self._fore.marks),
            tuple(self._fore.armings),
        )
        ended = "the end of the flight" if self._reading.over and not self.backwards else ""
        return replace(shown, replay=replay, ended=ended)

    def _obey(self) -> float | None:
        """Do what was asked for; return the moment to go to, if that was asked."""
        target: float | None = None
        for command in self._worker.commands():
            now = self.now if target is None else target
            if isinstance(command, Seek):
                target = float(command.us)
            elif isinstance(command, Step):
                self.playing = False
                target = now + command.count * PICTURE_US
            else:
                self._set(command)
        return target

    def _set(self, command: Command) -> None:
        if isinstance(command, Pause):
            self.playing = not self.playing
        elif isinstance(command, Speed):
            self._speed = min(max(self._speed + command.change, 0), len(SPEEDS) - 1)
        elif isinstance(command, Reverse):
            self.backwards = not self.backwards
            if not self.backwards:
                self._go_to(self.now)
        else:
            self._reading.model.take(obey(self._reading.model, command))

    def _go_to(self, target: float) -> None:
        self.now = min(max(target, float(self._tape.start_us)), float(max(self.end_us, self._tape.start_us)))
        self._film = []
        us = int(self.now)
        ahead = us - self._reading.us
        if not 0 <= ahead < CHECKPOINT_US:
            self._reading = self._fore.before(us)
        self._reading.read_until(us, lambda: not self._worker.stopping)

    def _forward(self, elapsed: float) -> None:
        if self._reading.over:
            self.now = float(self.end_us)
            return
        if math.isinf(self.speed):
            self._rush()
            return
        if not self._tape.stamped and self.now == 0.0:  # time begins where the vehicle's does
            self._reading.read(0)
            self.now = float(self._reading.us)
            return
        self.now += elapsed * 1e6 * self.speed
        self._reading.read_until(int(self.now), lambda: not self._worker.stopping)

    def _rush(self) -> None:
        """Read as much as a picture's time allows."""
        from time import monotonic

        until = monotonic() + BUSY
        while monotonic() < until and not self._reading.over:
            self._reading.read(1 << 62)
        self.now = float(self._reading.us)

    def _back(self, elapsed: float) -> None:
        self.now = max(self.now - elapsed * 1e6 * min(self.speed, FASTEST_BACK), float(self._tape.start_us))
        if not self._film or self.now < self._film[0][0]:
            self._make_film()

    def _make_film(self) -> None:
        """Play from the checkpoint before now to now, and keep the pictures."""
        reading = self._fore.before(max(int(self.now) - PICTURE_US, 0))
        step = PICTURE_US * max(int(min(self.speed, FASTEST_BACK)), 1)
        us = max(reading.us, self._tape.start_us)
        film = []
        while us <= self.now and not self._worker.stopping:
            reading.read_until(us)
            film.append((us, reading.snapshot(us)))
            us += step
        self._film = film or [(int(self.now), reading.snapshot(int(self.now)))]

    def _framed(self) -> Snapshot:
        at = bisect_right([us for us, _ in self._film], self.now) - 1
        return self._film[max(at, 0)][1]


def play(worker: Worker, tape: Tape, make: Make, name: str, take: Take, raw_tap: RawTap | None) -> Forerunner:
    """Show a flight until the operator has had enough; return the forerunner, which may not have come to the end."""
    from time import monotonic

    fore = Forerunner(Reading.begin(tape, make, name, raw_tap), take)
    runs = threading.Thread(target=fore.run, name="forerunner", daemon=True)
    runs.start()
    while not fore.checkpoints and fore.error is None:
        worker.rest(0.005)
    player = Player(worker, name, fore)
    before = monotonic()
    while not worker.stopping and fore.error is None:
        now = monotonic()
        worker.publish(player.turn(now - before))
        before = now
        worker.rest(max(PICTURE_US * 1e-6 - (monotonic() - now), 0.005))
    fore.halted = True
    runs.join()
    if fore.error is not None:
        raise fore.error
    return fore
