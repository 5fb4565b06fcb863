"""The autopilot's texts and events of several generations: what they say, of which motor."""

import pytest
from wire import DIALECT

from gcs_health.fusion.autopilot_words import AutopilotWords, Opinion, event_id, understood
from gcs_health.mavlink.encoder import Encoder
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.messages import MessageDecoder
from gcs_health.samples import Sample


@pytest.mark.parametrize(
    ("text", "opinion", "motors"),
    [
        ("Potential Thrust Loss (3)", Opinion.THRUST_LOSS, (3,)),
        ("Yaw Imbalance 81%", Opinion.YAW_IMBALANCE, ()),
        ("Crash: Disarming: AngErr=52>30, Accel=1.2<3.0", Opinion.CRASH, ()),
        ("Crash: Disarming", Opinion.CRASH, ()),
        ("ESC1 ESC3 offline. Land now!\t", Opinion.ESC_OFFLINE, (1, 3)),
        ("ESC2: motor stall. Land now!", Opinion.MOTOR_STALL, (2,)),
        ("ESC4: over temperature. Reduce throttle", Opinion.OVERHEATING, (4,)),
        ("ESC4: motor critical temperature. Land now!", Opinion.OVERHEATING, (4,)),
        ("ESC1: over current. Reduce throttle", Opinion.OVERCURRENT, (1,)),
        ("ESC1: hardware failure. Land now!", Opinion.ESC_FAILURE, (1,)),
        ("Motor failure detected", Opinion.MOTOR_FAILURE, ()),
        ("Motor failure: Motor 6 undercurrent detected", Opinion.UNDERCURRENT, (6,)),
        ("Motor failure: Motor 2 overcurrent detected", Opinion.OVERCURRENT, (2,)),
        ("ESC failure: Not all ESCs are armed. Land now!", Opinion.ESC_FAILURE, ()),
        ("ESC telemetry missing", Opinion.ESC_OFFLINE, ()),
        ("Imbalanced propeller detected", Opinion.UNBALANCE, ()),
    ],
)
def test_a_text_is_understood(text: str, opinion: Opinion, motors: tuple[int, ...]) -> None:
    word = understood(text)
    assert word is not None
    assert (word.opinion, word.motors, word.before_arming) == (opinion, motors, False)


@pytest.mark.parametrize(
    "text", ["", "EKF variance", "Motors armed", "ESC calibration: restart board", "esc"]
)
def test_other_texts_say_nothing_of_motors(text: str) -> None:
    assert understood(text) is None


def test_a_check_before_arming_is_told_apart() -> None:
    word = understood("Preflight Fail: Imbalanced propeller detected")
    assert word is not None
    assert word.before_arming


def samples(*frames: bytes) -> list[Sample]:
    decoder, messages = FrameDecoder(DIALECT, stamped=False), MessageDecoder(DIALECT)
    return [s for frame in frames for s in messages.samples(decoder.feed(frame))]


def text(words: str, number: int = 0, chunk: int = 0) -> bytes:
    return Encoder(DIALECT).frame("STATUSTEXT", severity=2, text=words, id=number, chunk_seq=chunk)


def test_chunks_are_joined_and_a_lost_one_makes_no_sentence() -> None:
    whole = "Motor failure: Motor 6 undercurrent detected by the check of motors and of their currents"
    words = AutopilotWords()
    said = [words.feed(s) for s in samples(text(whole[:50], 7, 0), text(whole[50:], 7, 1))]
    assert said[0] is None
    assert said[1] is not None
    assert said[1].motors == (6,)
    assert said[1].text == whole
    assert AutopilotWords().feed(samples(text(whole[50:], 7, 1))[0]) is None


def test_an_event_is_known_by_the_hash_of_its_name() -> None:
    """FNV-1a of "a" is 0xE40C292C by its definition."""
    assert event_id("a") == 0x010C292C
    arguments = [0, 0, 0, 0, 9, 3] + [0] * 34
    frame = Encoder(DIALECT).frame("EVENT", id=event_id("check_escs_offline"), arguments=arguments)
    word = AutopilotWords().feed(samples(frame)[0])
    assert word is not None
    assert (word.opinion, word.motors) == (Opinion.ESC_OFFLINE, (3,))
    other = Encoder(DIALECT).frame("EVENT", id=event_id("check_gps"), arguments=arguments)
    assert AutopilotWords().feed(samples(other)[0]) is None
