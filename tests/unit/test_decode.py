"""The decoder against pymavlink, field by field, and against logs whose true frames are known."""

import hashlib
import math
import random
import struct
from collections.abc import Iterable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as stock
from wire import pymavlinks

from gcs_health import samples as s
from gcs_health.mavlink.batch import Frame
from gcs_health.mavlink.dialect import Message, default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.generated import esc
from gcs_health.mavlink.messages import MessageDecoder

DIALECT = default_dialect()
DECODER = MessageDecoder(DIALECT)
START_US = 1_700_000_000_000_000
CLASSES = {**stock.mavlink_map, **esc.mavlink_map}


def crc(data: bytes, extra: int) -> bytes:
    value = 0xFFFF
    for byte in (*data, extra):
        step = (byte ^ value) & 0xFF
        step ^= step << 4 & 0xFF
        value = (value >> 8 ^ step << 8 ^ step << 3 ^ step >> 4) & 0xFFFF
    return value.to_bytes(2, "little")


def v2(message: int, payload: bytes, seq: int = 0, system: int = 1, flags: int = 0, compat: int = 0) -> bytes:
    """A frame made by hand, payload as given."""
    body = bytes([len(payload), flags, compat, seq, system, 1]) + message.to_bytes(3, "little") + payload
    return b"\xfd" + body + crc(body, DIALECT.crc_extra.get(message, 0))


def v1(message: int, payload: bytes, seq: int = 0, system: int = 1) -> bytes:
    body = bytes([len(payload), seq, system, 1, message]) + payload
    return b"\xfe" + body + crc(body, DIALECT.crc_extra[message])


def stamped(frames: Iterable[bytes], start: int = START_US, step: int = 1000) -> bytes:
    return b"".join((start + k * step).to_bytes(8, "big") + frame for k, frame in enumerate(frames))


def decode(data: bytes, chunk: int = 1 << 18, **options: object) -> tuple[list[Frame], FrameDecoder]:
    decoder = FrameDecoder(DIALECT, **{"stamped": True, **options})  # type: ignore[arg-type]
    frames = [f for at in range(0, len(data), chunk) for f in decoder.feed(data[at : at + chunk], START_US)]
    return frames + list(decoder.finish()), decoder


def payload_of(message: Message, rng: random.Random) -> bytes:
    """A payload whose floats are ordinary numbers, so that equality means something."""
    values: list[object] = []
    for _, kind, length in message.fields:
        if kind == "char":
            values.append(bytes(rng.choice(b"ABCxyz019_") for _ in range(length or 1)))
            continue
        for _ in range(length or 1):
            if kind in ("float", "double"):
                values.append(rng.choice([0.0, -1.5, 3.25, rng.uniform(-1e3, 1e3)]))
            else:
                bits = 8 * struct.calcsize(message_code(kind))
                low = 0 if kind.startswith("u") else -(1 << bits - 1)
                values.append(
                    rng.choice([0, low, low + (1 << bits) - 1, rng.randrange(low, low + (1 << bits))])
                )
    return message.layout.pack(*values)


def message_code(kind: str) -> str:
    return {"8": "b", "16": "h", "32": "i", "64": "q"}[kind.strip("uint_")]


@pytest.mark.parametrize("version", [1, 2])
def test_every_message_agrees_with_pymavlink_field_by_field(version: int) -> None:
    rng = random.Random(version)
    checked = 0
    for id, message in DIALECT.messages.items():
        if version == 1 and id > 255:
            continue
        payload = payload_of(message, rng)
        if version == 2:
            payload = payload[: rng.choice([len(payload), len(payload), max(1, len(payload) - 3)])]
            payload = payload[:1] + payload[1:].rstrip(b"\0")  # as senders cut
        frames, _ = decode(stamped([(v1 if version == 1 else v2)(id, payload)]), stamped=True)
        assert len(frames) == 1, message.name
        theirs = pymavlinks(id).MAVLink(None).decode(bytearray((v1 if version == 1 else v2)(id, payload)))
        decoder = FrameDecoder(DIALECT, stamped=True)
        batch = decoder.feed(stamped([(v1 if version == 1 else v2)(id, payload)]))
        wire = DECODER.columns(batch)[id].wire[0]
        for name, kind, length in message.fields:
            mine, other = wire[name], getattr(theirs, name)
            if kind == "char":
                assert bytes(mine).split(b"\0")[0].decode() == str(other).rstrip("\0"), (message.name, name)
            else:
                assert (list(mine) if length else [mine.item()]) == (list(other) if length else [other]), (
                    message.name,
                    name,
                )
            checked += 1
    assert checked > (1000 if version == 1 else 2500)


def one(message: int, *values: object, trim: bool = True) -> s.Sample:
    """Decode one message from its values in wire order, by the scalar way and by columns alike."""
    payload = DIALECT.messages[message].layout.pack(*values)
    payload = payload[:1] + payload[1:].rstrip(b"\0") if trim else payload
    decoder = FrameDecoder(DIALECT, stamped=False)
    (sample,) = DECODER.samples(decoder.feed(v2(message, payload), START_US))
    many = FrameDecoder(DIALECT, stamped=True).feed(
        stamped([v2(message, payload, k & 0xFF) for k in range(300)], step=0)
    )
    assert len(many) == 300
    assert {repr(other) for other in DECODER.samples(many)} == {repr(sample)}
    return sample


def test_imu_messages_come_in_si_and_what_was_not_measured_is_nan() -> None:
    scaled = one(26, 5000, 100, -200, -1000, 1500, -2500, 0, 0, 0, 0, 2150)
    assert isinstance(scaled, s.Imu)
    assert scaled.time_us == 5_000_000
    assert (scaled.ax, scaled.az) == pytest.approx((0.980665, -9.80665))
    assert (scaled.p, scaled.q) == (1.5, -2.5)
    assert scaled.temperature_degc == pytest.approx(21.5)
    full = one(105, 77, 1.0, 2.0, -9.8, 0.1, 0.2, 0.3, *[0.0] * 7, 0b111111, 1)
    assert isinstance(full, s.Imu)
    assert (full.time_us, full.sensor) == (77, 1)
    assert math.isnan(full.temperature_degc)
    partly = one(105, 77, 1.0, 2.0, -9.8, 0.1, 0.2, 0.3, *[0.0] * 7, 0b111100, 0)
    assert isinstance(partly, s.Imu)
    assert math.isnan(partly.ax)
    assert math.isnan(partly.ay)
    assert partly.az == pytest.approx(-9.8)
    raw = one(27, 9, 0, 0, -1000, 0, 0, 1000, 0, 0, 0, 2, 0)
    assert isinstance(raw, s.Imu)
    assert (raw.sensor, raw.az, raw.r) == (2, pytest.approx(-9.80665), 1.0)


def test_esc_messages() -> None:
    status = one(291, 42, 6000, -3000, 0, 60, 16.0, 15.5, 0.0, 0.0, 1.5, 0.0, -0.25, 0.0, 4)
    assert isinstance(status, s.EscStatus)
    assert status.speed == pytest.approx((200 * math.pi, -100 * math.pi, 0.0, 2 * math.pi))
    assert (status.index, status.voltage[1], status.current[2]) == (4, 15.5, -0.25)
    info = one(290, 7, 1, 2, 3, 4, 9, 0, 64, 256, 0, 2500, 32767, -100, 0, 0, 4, 5, 15)
    assert isinstance(info, s.EscInfo)
    assert (info.failure_flags, info.online, info.count) == ((0, 64, 256, 0), 15, 4)
    assert info.temperature_degc[0] == 25.0
    assert math.isnan(info.temperature_degc[1])
    telemetry = one(
        11031, 1600, 0, 0, 0, 250, 0, 0, 0, 1000, 0, 0, 0, 6000, 0, 0, 0, 65535, 1, 2, 3, 40, 0, 0, 0
    )
    assert isinstance(telemetry, s.EscTelemetry)
    assert telemetry.time_us is None
    assert (telemetry.index, telemetry.voltage[0], telemetry.current[0]) == (4, 16.0, 2.5)
    assert telemetry.consumed[0] == pytest.approx(3600.0)
    assert telemetry.speed[0] == pytest.approx(200 * math.pi)
    assert (telemetry.count, telemetry.temperature_degc[0]) == ((65535, 1, 2, 3), 40.0)


def test_values_that_are_not_available_are_never_zero() -> None:
    battery = one(147, 0, 0, 32767, *[4100, 4000] + [65535] * 8, -1, 3, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0, 0)
    assert isinstance(battery, s.Battery)
    assert battery.voltage == pytest.approx(8.1)
    assert all(map(math.isnan, (battery.current, battery.remaining, battery.temperature_degc)))
    outputs = one(36, 123, 1500, 65535, *[1000] * 6, 0, *[0] * 8)
    assert isinstance(outputs, s.Outputs)
    assert (outputs.value[0], len(outputs.value)) == (1500.0, 8)
    assert math.isnan(outputs.value[1])
    time = one(2, 0, 1234)
    assert isinstance(time, s.SystemTime)
    assert (time.unix_us, time.time_us) == (None, 1_234_000)


def test_outputs_are_all_there_whether_active_is_a_count_or_a_mask() -> None:
    for active in (4, 0b1111):  # PX4 sends the count, the definition says mask
        outputs = one(375, 5, active, 0.5, 0.25, 0.0, 0.75, *[0.0] * 28)
        assert isinstance(outputs, s.Outputs)
        assert outputs.value[:4] == (0.5, 0.25, 0.0, 0.75)
        assert not any(outputs.value[4:])


def test_parameters_either_way_and_text() -> None:
    bitwise = struct.unpack("<f", struct.pack("<i", 4))[0]
    for wire in (bitwise, 4.0):
        parameter = one(22, wire, 100, 7, b"CA_ROTOR_COUNT", 6)
        assert isinstance(parameter, s.Parameter)
        assert (parameter.name, parameter.number) == ("CA_ROTOR_COUNT", 4.0)
    sixteen = one(22, 2.5, 100, 7, b"ABCDEFGHIJKLMNOP", 9)
    assert isinstance(sixteen, s.Parameter)
    assert (sixteen.name, sixteen.number) == ("ABCDEFGHIJKLMNOP", 2.5)
    text = one(253, 2, b"Motor failure\0garbage", 0, 0)
    assert isinstance(text, s.StatusText)
    assert (text.severity, text.text) == (2, "Motor failure")
    other = one(77, 511, 0, 0, 0, 0, 0)
    assert isinstance(other, s.Other)
    assert (other.name, other.fields["command"]) == ("COMMAND_ACK", 511)


def test_a_payload_longer_than_we_know_is_read_as_far_as_we_know() -> None:
    payload = DIALECT.messages[0].layout.pack(7, 2, 12, 81, 4, 3) + b"\x09\x08"
    frames, _ = decode(stamped([v2(0, payload)]))
    assert len(frames) == 1
    (sample,) = DECODER.samples(FrameDecoder(DIALECT, stamped=False).feed(v2(0, payload), START_US))
    assert isinstance(sample, s.Heartbeat)
    assert sample.custom_mode == 7


HEARTBEAT = DIALECT.messages[0].layout.pack(0, 2, 12, 81, 4, 3)
ATTITUDE = DIALECT.messages[30].layout.pack(99, 0.5, 0, 0, 0, 0, 0.25)


def healthy(count: int = 200) -> list[bytes]:
    """Frames of two systems and both versions, numbered by their ATTITUDE stamp."""
    out = []
    for k in range(count):
        payload = DIALECT.messages[30].layout.pack(k, 0.5, 0, 0, 0, 0, 0.25)
        make = v1 if k % 3 == 0 else v2
        out.append(make(30, payload, k // 2 & 0xFF, 1 + k % 2))
    return out


def numbers(frames: list[Frame]) -> list[int]:
    return [struct.unpack_from("<I", f.payload)[0] for f in frames if f.message == 30]


@pytest.mark.parametrize("chunk", [7, 100, 1 << 18])
def test_a_dirty_log_gives_all_its_true_frames_and_no_other(chunk: int) -> None:
    rng = random.Random(3)
    log, truth = b"", []
    for k, frame in enumerate(healthy(400)):
        if rng.random() < 0.1:
            log += rng.randbytes(rng.randrange(1, 40))  # garbage between records
        if rng.random() < 0.05:
            frame = bytearray(frame)
            frame[-2 if frame[0] == 0xFE else -1] ^= 0x55  # a CRC that does not hold
        elif rng.random() < 0.05:
            frame = frame[:1] + bytes([frame[1] ^ 0x3F]) + frame[2:]  # a length that lies
        else:
            truth.append(k)
        # stamps go back now and then, and hold the magic bytes
        stamp = START_US + (k if k % 7 else -k) * 1000
        log += (stamp & ~0xFFFF | 0xFDFE).to_bytes(8, "big") + bytes(frame)
    found, decoder = decode(log[:-5], chunk)
    assert numbers(found) == [k for k in truth if k != 399]
    dropped = decoder.counters.dropped
    assert dropped["bad_crc"] > 10
    assert dropped["garbage_bytes"] > 100
    assert decoder.counters.bytes == len(log) - 5


def test_more_frames_in_one_piece_than_are_checked_at_once() -> None:
    frame = v2(0, HEARTBEAT)
    frames = [frame] * 17_000
    frames[16_500] = frame[:-1] + bytes([frame[-1] ^ 1])
    found, decoder = decode(stamped(frames), chunk=1 << 20)
    assert [f.receive_us - START_US for f in found] == [1000 * k for k in range(17_000) if k != 16_500]
    assert decoder.counters.dropped == {"bad_crc": 1}


def test_a_log_cut_anywhere_loses_only_its_last_record() -> None:
    frames = healthy(20)
    log = stamped(frames)
    for cut in range(1, len(frames[-1]) + 8):
        found, decoder = decode(log[:-cut])
        assert numbers(found) == list(range(19))
        assert decoder.counters.dropped["truncated_bytes"] == len(frames[-1]) + 8 - cut


@pytest.mark.parametrize("stamps", [True, False])
def test_a_frame_inside_anothers_payload_is_not_a_frame(stamps: bool) -> None:
    inner = v2(0, HEARTBEAT)
    tunnel = struct.pack("<HBBB", 1, 1, 1, 60) + START_US.to_bytes(8, "big") + inner
    outer = v2(385, tunnel)
    bad = outer[:-1] + bytes([outer[-1] ^ 1])
    after = v2(30, ATTITUDE)
    for broken in (False, True):  # even if the outer frame's CRC fails: a good record follows it
        frames = [bad if broken else outer, after, after]
        data = stamped(frames) if stamps else b"".join(frames)
        found, _ = decode(data, stamped=stamps)
        assert [f.message for f in found] == ([30, 30] if broken else [385, 30, 30])


def test_unknown_incompatible_flags_are_dropped_and_compatible_ones_ignored() -> None:
    frames = [
        v2(30, ATTITUDE, 0),
        v2(30, ATTITUDE, 1, flags=2),
        v2(30, ATTITUDE, 2, compat=7),
        v2(30, ATTITUDE, 3),
    ]
    found, decoder = decode(stamped(frames))
    assert [f.sequence for f in found] == [0, 2, 3]
    assert decoder.counters.dropped["unknown_incompat"] == 1


def test_an_unknown_id_is_passed_over_whole_and_counted() -> None:
    strange = v2(987_654, v2(0, HEARTBEAT))
    for chunk in (1, 1 << 18):
        found, decoder = decode(stamped([v2(30, ATTITUDE), strange, v2(30, ATTITUDE)]), chunk)
        assert [f.message for f in found] == [30, 987_654, 30]
        assert decoder.counters.unknown == {987_654: 1}


def test_several_frames_behind_one_stamp_share_it() -> None:
    log = (
        START_US.to_bytes(8, "big")
        + v2(30, ATTITUDE, 0)
        + v2(30, ATTITUDE, 1)
        + stamped([v2(0, HEARTBEAT, 2)], START_US + 5)
    )
    for chunk in (1, 1 << 18):
        found, _ = decode(log, chunk)
        assert [f.receive_us - START_US for f in found] == [0, 0, 5]


def test_losses_and_repeats_are_counted_per_sender() -> None:
    for repeat in (1, 300):  # few frames and many
        frames = []
        for k in range(repeat):
            frames += [v2(30, ATTITUDE, (4 * k + n) & 0xFF, 1) for n in (0, 1, 1, 3)]
            frames.append(v2(30, ATTITUDE, k & 0xFF, 2))
        _, decoder = decode(stamped(frames))
        assert decoder.counters.lost == {(1, 1): repeat}
        assert decoder.counters.repeated == {(1, 1): repeat}


def sign(frame: bytes, key: bytes, stamp: int, link: int = 0) -> bytes:
    body = bytearray(frame[:-2])
    body[2] |= 1
    message = int.from_bytes(body[7:10], "little")
    signed = (
        bytes(body)
        + crc(bytes(body[1:]), DIALECT.crc_extra[message])
        + bytes([link])
        + stamp.to_bytes(6, "little")
    )
    return signed + hashlib.sha256(key + signed).digest()[:6]


def test_signatures() -> None:
    key, other = b"k" * 32, b"x" * 32
    frames = [
        sign(v2(30, ATTITUDE, 0), key, 100),
        sign(v2(30, ATTITUDE, 1), other, 101),  # another's key
        sign(v2(30, ATTITUDE, 2), key, 100),  # replayed: its stamp is not new
        sign(v2(30, ATTITUDE, 3), key, 50, link=1),  # another link counts for itself
        v2(30, ATTITUDE, 4),
    ]
    found, decoder = decode(stamped(frames), keys=(key,))
    assert [f.sequence for f in found] == [0, 3, 4]
    assert (decoder.counters.signed, decoder.counters.unsigned) == (2, 1)
    assert decoder.counters.dropped == {"bad_signature": 1, "replayed": 1}
    without, decoder = decode(stamped(frames))
    assert [f.sequence for f in without] == [0, 1, 2, 3, 4]
    assert decoder.counters.signed == 4


def test_what_pymavlink_signs_verifies() -> None:
    link = stock.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.sign_outgoing, link.signing.timestamp = b"s" * 32, True, 5000
    frame = stock.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3).pack(link)
    found, decoder = decode(stamped([bytes(frame)]), keys=(b"s" * 32,))
    assert len(found) == decoder.counters.signed == 1


def test_no_fewer_frames_than_pymavlink_finds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAVLINK20", "1")
    from pymavlink import mavutil

    rng = random.Random(8)
    frames = healthy(300)
    clean = stamped(frames)
    dirty = b"".join(
        stamped([frame], START_US + k) + (rng.randbytes(20) if k % 10 == 0 else b"")
        for k, frame in enumerate(frames)
    )
    found = []
    for log in (clean, dirty):
        path = tmp_path / "log.tlog"
        path.write_bytes(log)
        reader = mavutil.mavlink_connection(str(path))
        theirs = 0
        while (message := reader.recv_match()) is not None:
            theirs += message.get_type() == "ATTITUDE"
        reader.close()
        assert numbers(decode(log)[0]) == list(range(300))
        found.append(theirs)
    assert found[0] == 300
    assert found[1] < 300  # recv_match loses frames behind garbage
