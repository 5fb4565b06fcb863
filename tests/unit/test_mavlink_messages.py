"""Every message at every length against pymavlink; every sample both ways; the table's rows by hand."""

import math
import random
import struct

import numpy as np
import pytest
from wire import DIALECT, START_US, log, pymavlinks, v1, v2

from gcs_health import samples as s
from gcs_health.mavlink.dialect import Message
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.message_table import TABLE
from gcs_health.mavlink.messages import MessageDecoder

DECODER = MessageDecoder(DIALECT)
NAN = math.nan
INTEGERS = {"int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H"}
INTEGERS |= {"int32_t": "i", "uint32_t": "I", "int64_t": "q", "uint64_t": "Q"}
FLOATS = [0.0, -0.0, 1.5, -2.25, 1e-30, 3.4e38, math.inf, -math.inf, NAN]


def payload_of(message: Message, rng: random.Random) -> bytes:
    """Random field values, the ends of each range and what is not a number among them."""
    values: list[object] = []
    for _, kind, length in message.fields:
        if kind == "char":
            values.append(bytes(rng.choice(b"AZaz_09\0") for _ in range(length or 1)))
            continue
        for _ in range(length or 1):
            if kind in INTEGERS:
                bits = 8 * struct.calcsize(INTEGERS[kind])
                low = 0 if kind[0] == "u" else -(1 << bits - 1)
                high = low + (1 << bits) - 1
                values.append(rng.choice([0, low, high, rng.randint(low, high)]))
            else:
                values.append(rng.choice([*FLOATS, rng.uniform(-1e3, 1e3)]))
    return message.layout.pack(*values)


def cut(payload: bytes, rng: random.Random) -> bytes:
    """Set the last bytes to zero and leave them out, as a MAVLink 2 sender does."""
    kept = payload[: rng.randint(1, len(payload))] if rng.random() < 0.7 else payload
    return kept[:1] + kept[1:].rstrip(b"\0")


def theirs(message: int, frame: bytes) -> object:
    return pymavlinks(message).MAVLink(None).decode(bytearray(frame))


def agree(mine: object, other: object, kind: str) -> bool:
    if kind == "char":
        return bytes(mine).split(b"\0")[0] == str(other).encode().split(b"\0")[0]  # type: ignore[call-overload]
    return np.array_equal(np.asarray(mine, dtype=float), np.asarray(other, dtype=float), equal_nan=True)


@pytest.mark.parametrize("version", [1, 2])
def test_all_messages_in_one_log_agree_with_pymavlink_at_any_length(version: int) -> None:
    """Read by columns, payloads of all lengths side by side; pymavlink reads them one at a time."""
    rng = random.Random(20 + version)
    ids = [id for id in DIALECT.messages if version == 2 or id < 256] * 4
    rng.shuffle(ids)
    frames = []
    for id in ids:
        payload = payload_of(DIALECT.messages[id], rng)
        if version == 1:  # knows no extension fields: pymavlink cuts them off, and fills them with zeros
            base = pymavlinks(id).mavlink_map[id]
            payload = payload[: base.unpacker.size]
        frames.append(v1(id, payload) if version == 1 else v2(id, cut(payload, rng)))
    batch = FrameDecoder(DIALECT, stamped=True).feed(log(frames))
    assert [frame.message for frame in batch] == ids
    columns = DECODER.columns(batch)
    checked = 0
    for id, gathered in columns.items():
        assert [ids[k] for k in gathered.at] == [id] * len(gathered.at)
        for k, wire, stamp in zip(gathered.at, gathered.wire, gathered.receive_us, strict=True):
            assert stamp == START_US + 1000 * k
            message = theirs(id, frames[k])
            for name, kind, _ in DIALECT.messages[id].fields:
                assert agree(wire[name], getattr(message, name), kind), (id, name)
                checked += 1
    assert checked > (4000 if version == 1 else 10_000)


@pytest.mark.parametrize("id", [*sorted(TABLE), 77, 111, 148, 410])
def test_samples_one_by_one_and_by_columns_are_the_same_to_the_last_bit(id: int) -> None:
    rng = random.Random(id)
    message = DIALECT.messages[id]
    frames = [v2(id, cut(payload_of(message, rng), rng), k & 0xFF) for k in range(150)]
    by_columns = DECODER.samples(FrameDecoder(DIALECT, stamped=True).feed(log(frames)))
    singly = []
    decoder = FrameDecoder(DIALECT, stamped=True)
    for k, frame in enumerate(frames):
        singly += DECODER.samples(decoder.feed(log([frame], START_US + 1000 * k)))
    assert [repr(sample) for sample in by_columns] == [repr(sample) for sample in singly]
    assert len(singly) == 150
    assert {type(value) for sample in by_columns for value in sample if not isinstance(value, dict)} <= {
        *(int, float, str, tuple, type(None)),
    }  # numpy's own numbers would reach JSON


def test_a_message_too_rare_for_columns_keeps_its_place() -> None:
    frames = [v2(0, bytes(9)) if k in (3, 77) else v2(30, bytes([1] * 28)) for k in range(200)]
    samples = DECODER.samples(FrameDecoder(DIALECT, stamped=True).feed(log(frames)))
    assert [k for k, sample in enumerate(samples) if isinstance(sample, s.Heartbeat)] == [3, 77]
    assert [sample.receive_us for sample in samples] == [START_US + 1000 * k for k in range(200)]


def test_columns_of_wanted_messages_only() -> None:
    frames = [v2(0, bytes(9)), v2(30, bytes(28)), v2(987_654, b"x")] * 40
    batch = FrameDecoder(DIALECT, stamped=True).feed(log(frames))
    assert set(DECODER.columns(batch, frozenset({30}))) == {30}
    assert set(DECODER.columns(batch)) == {0, 30}
    assert DECODER.columns(FrameDecoder(DIALECT, stamped=True).feed(b"")) == {}


def one(message: int, *values: object) -> s.Sample:
    """One sample from a message's values in wire order."""
    payload = DIALECT.messages[message].layout.pack(*values)
    (sample,) = DECODER.samples(FrameDecoder(DIALECT, stamped=False).feed(v2(message, payload), START_US))
    assert sample[:4] == (1, 1, message, START_US)
    return sample


def behind_the_head(sample: s.Sample) -> tuple[object, ...]:
    return tuple(sample)[4:]


# One row of the table each: message, wire values in wire order, the sample behind its head worked by hand.
EXAMPLES: list[tuple[str, int, tuple[object, ...], tuple[object, ...]]] = [
    ("heartbeat", 0, (50_593_792, 2, 12, 0b10000001, 4, 3), (None, 2, 12, 129, 50_593_792, 4)),
    (
        "battery of SYS_STATUS: mV, cA, %",
        1,
        (0, 0, 0, 500, 15_800, 1234, *[0] * 6, 87, 0, 0, 0),
        (None, 0, 15.8, 12.34, 0.87, NAN),
    ),
    (
        "battery of SYS_STATUS, not measured",
        1,
        (0, 0, 0, 500, 65_535, -1, *[0] * 6, -1, 0, 0, 0),
        (None, 0, NAN, NAN, NAN, NAN),
    ),
    ("time", 2, (1_700_000_000_123_456, 98_765), (98_765_000, 1_700_000_000_123_456)),
    (
        "SCALED_IMU2: mG, mrad/s, cdegC",
        116,
        (12, 1000, 0, -500, 2000, -1, 0, 0, 0, 0, -1050),
        (12_000, 9.80665, 0.0, -4.903325, 2.0, -0.001, 0.0, 1, -10.5),
    ),
    (
        "SCALED_IMU3 without a temperature",
        129,
        (12, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        (12_000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2, NAN),
    ),
    (
        "HIGHRES_IMU, nothing measured",
        105,
        (5, *[1.0] * 13, 0, 2),
        (5, NAN, NAN, NAN, NAN, NAN, NAN, 2, NAN),
    ),
    (
        "HIGHRES_IMU, temperature and z of both",
        105,
        (5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, *[0.0] * 6, 21.5, 4096 | 32 | 4, 0),
        (5, NAN, NAN, 3.0, NAN, NAN, 6.0, 0, 21.5),
    ),
    (
        "attitude",
        30,
        (1500, 0.5, -0.25, 3.0, 0.125, 0.0, -1.0),
        (1_500_000, 0.5, -0.25, 3.0, 0.125, 0.0, -1.0),
    ),
    (
        "attitude as a quaternion: 90° of yaw",
        31,
        (7, math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5), 0.5, 0.25, 0.0, 0, 0, 0, 0),
        (7000, 0.0, 0.0, math.pi / 2, 0.5, 0.25, 0.0),
    ),
    (
        "attitude as a quaternion: 60° of roll",
        31,
        (7, math.cos(math.pi / 6), math.sin(math.pi / 6), 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0, 0),
        (7000, math.pi / 3, 0.0, 0.0, 0.0, 0.0, 0.0),
    ),
    (
        "a quaternion that is none",
        31,
        (7, NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0, 0),
        (7000, NAN, NAN, NAN, 0.0, 0.0, 0.0),
    ),
    (
        "outputs 9 and 10; 0 beyond 8 and 65535 anywhere are no outputs",
        36,
        (4_294_967_295, *[1100] * 7, 65_535, 1, 1900, 1200, *[0] * 5, 65_535),
        (4_294_967_295, 1, (*[1100.0] * 7, NAN, 1900.0, 1200.0)),
    ),
    (
        "attitude target",
        83,
        (9, 1.0, 0.0, 0.0, 0.0, 0.5, -0.5, 0.25, 0.625, 7),
        (9000, (1.0, 0.0, 0.0, 0.0), 0.5, -0.5, 0.25, 0.625, 7),
    ),
    (
        "controls",
        140,
        (11, 0.5, -0.5, 0.25, 0.75, 0.0, 0.0, 0.0, 1.0, 3),
        (11, 3, (0.5, -0.5, 0.25, 0.75, 0.0, 0.0, 0.0, 1.0)),
    ),
    (
        "battery: four cells of 4 V, 10 A, 55 %, 30 °C",
        147,
        (900, 0, 3000, *[4000] * 4, *[65_535] * 6, 1000, 1, 0, 0, 55, 0, 0, 0, 0, 0, 0, 0, 0),
        (None, 1, 16.0, 10.0, 0.55, 30.0),
    ),
    (
        "battery without any cell",
        147,
        (-1, -1, 32_767, *[65_535] * 10, -1, 0, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0, 0),
        (None, 0, NAN, NAN, NAN, NAN),
    ),
    ("rpm of two sensors", 226, (3000.0, -1.0), (None, 0, (100 * math.pi, -math.pi / 30))),
    ("rpm of one sensor", 339, (6000.0, 3), (None, 3, (200 * math.pi,))),
    ("vibration", 241, (8, 1.5, 2.5, 30.0, 1, 2, 3), (8, 1.5, 2.5, 30.0, (1, 2, 3))),
    ("in the air", 245, (0, 2), (None, 2, 0)),
    (
        "text of all fifty characters, no NUL",
        253,
        (4, b"x" * 50, 7, 1),
        (None, 4, "x" * 50, 7, 1),
    ),
    (
        "text that is not UTF-8",
        253,
        (4, b"25 \xb0C\0", 0, 0),
        (None, 4, "25 \ufffdC", 0, 0),
    ),
    (
        "ESC_STATUS of ESCs 4 to 7, one in reverse",
        291,
        (12, 30, -30, 0, 9000, 16.5, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, -6.0, 4),
        (12, 4, (math.pi, -math.pi, 0.0, 300 * math.pi), (16.5, 0.0, 1.0, 2.0), (3.0, 4.0, 5.0, -6.0)),
    ),
    (
        "ESC_INFO with PX4's own failure bits and a missing temperature",
        290,
        (13, 1, 2, 3, 4, 99, 0, 128, 512, 0, 4150, 32_767, -1000, 0, 0, 4, 5, 0b1011),
        (13, 0, 4, 99, 5, 11, (0, 128, 512, 0), (1, 2, 3, 4), (41.5, NAN, -10.0, 0.0)),
    ),
    (
        "output status, counted",
        375,
        (14, 4, 0.25, 0.5, 0.75, 1.0, *[0.0] * 28),
        (14, 0, (0.25, 0.5, 0.75, 1.0)),
    ),
    (
        "output status, counted, the last at zero",
        375,
        (14, 4, 0.25, 0.5, 0.75, 0.0, *[0.0] * 28),
        (14, 0, (0.25, 0.5, 0.75, 0.0)),
    ),
    (
        "output status, a mask beyond any count",
        375,
        (14, 0b111111, *[0.5] * 6, *[0.0] * 26),
        (14, 0, (0.5,) * 6),
    ),
]


@pytest.mark.parametrize(("id", "values", "told"), [e[1:] for e in EXAMPLES], ids=[e[0] for e in EXAMPLES])
def test_a_row_worked_by_hand(id: int, values: tuple[object, ...], told: tuple[object, ...]) -> None:
    sample = behind_the_head(one(id, *values))
    assert len(sample) == len(told)
    for mine, other in zip(sample, told, strict=True):
        assert type(mine) is type(other)
        if isinstance(other, (float, tuple)):
            assert mine == pytest.approx(other, rel=1e-6, abs=1e-7, nan_ok=True)
        else:
            assert mine == other


@pytest.mark.parametrize(
    ("id", "index"),
    [(11030, 0), (11031, 4), (11032, 8), (11040, 12), (11041, 16), (11042, 20), (11043, 24), (11044, 28)],
)
def test_esc_telemetry_of_every_four(id: int, index: int) -> None:
    wire = {
        "temperature": (0, 40, 255, 1),
        "voltage": (0, 1480, 1481, 65535),
        "current": (0, 1234, 0, 0),
        "totalcurrent": (0, 1000, 0, 0),
        "rpm": (0, 6000, 30, 65535),
        "count": (65535, 0, 7, 8),
    }
    names = [name for name, _, _ in DIALECT.messages[id].fields]
    sample = one(id, *[value for name in names for value in wire[name]])
    assert isinstance(sample, s.EscTelemetry)
    assert (sample.time_us, sample.index, sample.count) == (None, index, (65535, 0, 7, 8))
    assert sample.speed == pytest.approx((0, 200 * math.pi, math.pi, 65535 * math.pi / 30))
    assert sample.voltage == pytest.approx((0, 14.8, 14.81, 655.35))
    assert sample.current == pytest.approx((0, 12.34, 0, 0))
    assert sample.consumed == pytest.approx((0, 3600.0, 0, 0))
    assert sample.temperature_degc == (0.0, 40.0, 255.0, 1.0)


@pytest.mark.parametrize("value", [0, 1, -1, 4, 65_535, 8_388_607, -2_147_483_648])
def test_the_bits_of_an_integer_parameter_survive_the_float(value: int) -> None:
    payload = struct.pack("<iHH", value, 900, 3) + b"CA_ROTOR_COUNT\0\0\x06"
    for frames in (1, 300):
        batch = FrameDecoder(DIALECT, stamped=True).feed(log([v2(22, payload)] * frames))
        sample = DECODER.samples(batch)[0]
        assert isinstance(sample, s.Parameter)
        assert (sample.name, sample.bits, sample.kind) == ("CA_ROTOR_COUNT", value, 6)
        assert (sample.index, sample.count) == (3, 900)


def test_a_timesync_longer_than_the_release_knows() -> None:
    payload = struct.pack("<qqBB", 0, 5, 255, 190)
    sample = DECODER.samples(FrameDecoder(DIALECT, stamped=False).feed(v2(111, payload), START_US))[0]
    assert isinstance(sample, s.Other)
    assert (sample.fields["tc1"], sample.fields["ts1"]) == (0, 5)
    batch = FrameDecoder(DIALECT, stamped=True).feed(log([v2(111, payload)] * 300))
    assert DECODER.columns(batch)[111].wire["ts1"].tolist() == [5] * 300
