"""A replay moved in time shows, wherever it is moved to, what reading straight up to there shows."""

import random
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_health.dashboard import commands as c
from gcs_health.dashboard.interface import Worker
from gcs_health.dashboard.player import Forerunner, Player, Reading, play
from gcs_health.dashboard.snapshot import Level, Snapshot
from gcs_health.dashboard.tape import Tape
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, Event, lines

FLIGHT = (Path(__file__).parents[2] / "replay" / "lost_propeller.tlog").read_bytes()
LOST_AT = 12.0  # s after the log's start, about
STEP = 1_000_000


def make(stamped: bool = True):  # type: ignore[no-untyped-def]
    return lambda tap, raw: Monitor(MonitorConfig(stamped=stamped, tap=tap, raw_tap=raw))


def idle(_: Worker) -> None:
    """Stand in for the thread: the test turns the player itself."""


class Session:
    """A player whose forerunner has read all, with a checkpoint every two seconds."""

    def __init__(self, data: bytes = FLIGHT, stamped: bool = True) -> None:
        self.tape = Tape(data, stamped)
        self.events: list[Event] = []
        self.worker = Worker(idle)
        reading = Reading.begin(self.tape, make(stamped), "flight")
        self.fore = Forerunner(reading, self.events.extend, every_us=2_000_000)
        self.fore.run()
        self.player = Player(self.worker, "flight", self.fore)

    def do(self, *commands: c.Command, elapsed: float = 0.0) -> Snapshot:
        for command in commands:
            self.worker.send(command)
        return self.player.turn(elapsed)


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


def straight(tape: Tape, us: int) -> Snapshot:
    reading = Reading.begin(tape, make(), "flight")
    reading.read_until(us)
    return reading.snapshot(us)


def told(shown: Snapshot) -> tuple:  # type: ignore[type-arg]
    """All of a picture that depends on the moment alone; NaN equals NaN by its repr."""
    craft = shown.vehicles[0]
    rest = replace(
        craft, messages=(), loss=0.0, needs=(), clock=(), imu="", telemetry=()
    )  # counted once a second
    return repr(rest), repr([replace(entry, trace=()) for entry in shown.entries])


def test_stamps_are_read_without_decoding() -> None:
    tape = Tape(FLIGHT, True)
    batch = FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT)
    stamps = [stamp for stamp, _ in batch.raw()]
    assert (tape.start_us, tape.end_us) == (stamps[0], stamps[-1])
    middle = stamps[len(stamps) // 2]
    end, following = tape.until(0, middle, len(FLIGHT))
    read = FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT[:end])
    assert [stamp for stamp, _ in read.raw()] == [stamp for stamp in stamps if stamp <= middle]
    assert following == next(stamp for stamp in stamps if stamp > middle)


def test_a_damaged_tape_is_read_over() -> None:
    tape = Tape(FLIGHT[:40_000] + b"\xfd\xfe\x00" * 50 + FLIGHT[40_000:-7], True)
    at, counts = 0, 0
    while at < len(tape.data):
        end, _ = tape.until(at, 1 << 62, 5000)
        assert end > at
        at, counts = end, counts + 1
    assert counts > 10
    assert 0 < tape.end_us - tape.start_us < 20_000_000


def test_the_forerunner_says_what_a_plain_replay_says(session: Session) -> None:
    plain = Monitor(MonitorConfig(stamped=True))
    assert list(lines(session.events)) == list(lines(plain.feed(FLIGHT) + plain.finish()))
    assert [severity for _, severity in session.fore.marks] == [1]
    assert [armed for _, armed in session.fore.armings] == [True]
    assert session.fore.scanned == 1.0
    assert len(session.fore.checkpoints) >= 5


def test_wherever_one_goes_it_looks_as_if_one_had_come_straight(session: Session) -> None:
    rng = random.Random(5)
    for _ in range(3):
        us = session.tape.start_us + int(rng.uniform(1.0, 13.5) * STEP)
        assert told(session.do(c.Seek(us))) == told(straight(session.tape, us))


def test_backwards_looks_as_forwards_did(session: Session) -> None:
    session.player.playing, session.player.backwards = True, False
    start = session.tape.start_us
    session.do(c.Seek(start + 9 * STEP))
    session.do(c.Reverse())
    for k in range(3):
        shown = session.do(elapsed=1.0)
        assert shown.replay is not None
        assert shown.replay.at_us == start + (8 - k) * STEP
        assert shown.replay.backwards
        seen = shown.vehicles[0].us
        assert 0 <= shown.replay.at_us - seen < 250_000
    forward = session.do(c.Reverse())
    assert told(forward) == told(straight(session.tape, start + 6 * STEP))


def test_pause_step_speed_and_ends(session: Session) -> None:
    start = session.tape.start_us
    session.player.playing, session.player.backwards = True, False
    shown = session.do(c.Seek(start + 5 * STEP), c.Pause())
    assert shown.replay is not None
    assert not shown.replay.playing
    assert told(session.do(elapsed=1.0)) == told(shown)
    for commands, at in (([c.Step(1)], 5.1), ([c.Step(-1), c.Step(-1), c.Step(-1)], 4.8)):
        stepped = session.do(*commands).replay
        assert stepped is not None
        assert stepped.at_us == start + round(at * STEP)
    for _ in range(12):
        session.do(c.Speed(1))
    assert session.player.speed == float("inf")
    for _ in range(12):
        session.do(c.Speed(-1))
    assert session.player.speed == 0.1
    session.do(c.Speed(1), c.Speed(1), c.Speed(1))
    ended = session.do(c.Seek(start + 1000 * STEP))
    assert ended.ended == "the end of the flight"
    assert ended.replay is not None
    assert ended.replay.at_us == session.tape.end_us
    again = session.do(c.Seek(0)).replay
    assert again is not None
    assert again.at_us == start


def test_to_the_alert_and_acknowledged_there(session: Session) -> None:
    session.player.backwards = False
    us, _ = session.fore.marks[0]
    shown = session.do(c.Seek(us + 200_000))
    alert = shown.entries[0]
    assert (alert.code, alert.motor, alert.open, alert.level) == ("PROPELLER_LOST", 3, True, Level.FAILED)
    assert next(r for r in shown.vehicles[0].rotors if r.motor == 3).level is Level.FAILED
    assert alert.trace[0].t < alert.t < alert.trace[-1].t
    assert alert.figures
    seen = session.do(c.Acknowledge(alert.key))
    assert seen.entries[0].acknowledged
    shelved = session.do(c.Shelve(alert.key, 600.0))
    assert shelved.entries[0].shelved(shelved.vehicles[0].t)
    heard = session.do(c.Shelve(alert.key, 0.0))
    assert not heard.entries[0].shelved(heard.vehicles[0].t)
    assert session.do(c.Seek(us - 2_000_000)).vehicles[0].rotors[2].level < Level.FAILED


def test_a_raw_stream_without_stamps_plays_by_the_vehicles_clock() -> None:
    frames = FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT).raw()
    raw = Session(b"".join(frame for _, frame in frames), stamped=False)
    assert [severity for _, severity in raw.fore.marks] == [1]
    raw.do()
    begun = raw.player.now
    raw.do(elapsed=1.0)
    assert raw.player.now == begun + 1e6
    us, _ = raw.fore.marks[0]
    assert raw.do(c.Seek(us + 500_000)).entries[0].code == "PROPELLER_LOST"


def test_a_silence_on_the_tape_is_a_silence_on_the_screen() -> None:
    frames = list(FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT).raw())
    start = frames[0][0]
    kept = [(s, f) for s, f in frames if not start + 6 * STEP < s < start + 9 * STEP]
    gap = Session(b"".join(s.to_bytes(8, "big") + f for s, f in kept))
    during = gap.do(c.Seek(start + 8 * STEP)).vehicles[0]
    assert during.silent == pytest.approx(2.0, abs=0.1)
    assert {rotor.level for rotor in during.rotors} == {Level.UNKNOWN}
    assert "nothing heard for 2 s" in during.rotors[0].why
    after = gap.do(c.Seek(start + 10 * STEP)).vehicles[0]
    assert after.silent < 0.2


def until(true: Callable[[], bool], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_in_its_thread_it_publishes_and_ends_when_told() -> None:
    events: list[Event] = []
    done: list[Forerunner] = []

    def job(worker: Worker) -> None:
        done.append(play(worker, Tape(FLIGHT, True), make(), "flight", events.extend, None))

    worker = Worker(job)
    worker.start()
    shown: list[Snapshot] = []

    def seen() -> bool:
        shown.extend(filter(None, [worker.take()]))
        return bool(shown and shown[-1].replay is not None and shown[-1].replay.scanned == 1.0)

    until(seen)
    worker.send(c.Seek(1 << 62))
    until(lambda: seen() and bool(shown[-1].ended))
    worker.stop()
    assert worker.error is None
    assert done[0].done
    assert any(isinstance(event, AlertEvent) for event in events)


def test_what_the_pipeline_raises_reaches_whoever_started_it() -> None:
    def job(worker: Worker) -> None:
        raise OSError("gone")

    worker = Worker(job)
    worker.start()
    worker.stop()
    assert isinstance(worker.error, OSError)


def test_the_mailbox_drops_pictures_never_commands() -> None:
    worker = Worker(idle)
    for us in range(5):
        worker.publish(Snapshot(us))
        worker.send(c.Step(us))
    taken = worker.take()
    assert taken is not None
    assert (taken.us, worker.take(), worker.dropped) == (4, None, 4)
    assert list(worker.commands()) == [c.Step(us) for us in range(5)]
