"""Dirty streams with signed, unknown and incompatible frames: cuts change nothing, nothing waits for ever."""

import random
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
from wire import DIALECT, KEY, START_US, UNKNOWN, attitude, record, sign, v1, v2

from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.framing import LONGEST_RECORD
from gcs_health.mavlink.messages import MessageDecoder

DECODER = MessageDecoder(DIALECT)
KINDS = (
    *("good", "v1", "signed", "forged", "unknown", "incompatible", "nested", "short"),
    *("bare", "broken", "cut", "stretched", "noise", "magic"),
)
Piece = tuple[str, int]
pieces = st.tuples(st.sampled_from(KINDS), st.integers(0, 1 << 16))
streams = st.lists(pieces, max_size=30)
cuts = st.lists(st.integers(0, 1 << 15), max_size=20)


def piece(kind: str, number: int, k: int, stamped: bool) -> bytes:
    """One piece of a stream; `number` is its own chance."""
    rng = random.Random(number)
    if kind == "noise":
        return rng.randbytes(number % 40)
    if kind == "magic":
        return bytes(rng.choice(b"\x00\x06\xfd\xfe\x09\x1e") for _ in range(number % 40))
    frame = damaged(kind, whole(kind, k, rng.randbytes(number % 30)), number)
    return record(frame, START_US + 997 * k) if stamped and kind != "bare" else frame


def whole(kind: str, k: int, noise: bytes) -> bytes:
    """A frame without damage."""
    seq, said = k & 0xFF, attitude(k)
    if kind == "v1":
        return v1(30, said, seq)
    if kind in ("signed", "forged"):
        return sign(30, said, seq, 1000 + k, KEY if kind == "signed" else bytes(32))
    if kind == "unknown":
        return v2(UNKNOWN, noise, seq)
    if kind == "nested":
        return v2(385, b"\x01\x00\x00\x00\x40" + record(v2(30, said, seq)), seq)
    if kind == "short":
        return v2(0, b"\x07", seq)
    return v2(30, said, seq, flags=2 if kind == "incompatible" else 0)


def damaged(kind: str, frame: bytes, number: int) -> bytes:
    """The frame, with what its kind breaks in it broken."""
    at = number % len(frame)
    if kind == "broken":
        return frame[:at] + bytes([frame[at] ^ 1 << number % 8]) + frame[at + 1 :]
    if kind == "cut":
        return frame[:at]
    if kind == "stretched":
        return frame[:1] + bytes([number % 256]) + frame[2:]
    return frame


def build(parts: list[Piece], stamped: bool) -> bytes:
    return b"".join(piece(kind, number, k, stamped) for k, (kind, number) in enumerate(parts))


def run(data: bytes, edges: list[int], stamped: bool, keys: tuple[bytes, ...]) -> tuple[object, ...]:
    decoder = FrameDecoder(DIALECT, stamped=stamped, keys=keys)
    frames, samples, raw = [], [], []
    for a, b in pairwise([0, *sorted(edge % (len(data) + 1) for edge in edges), len(data)]):
        batch = decoder.feed(data[a:b], START_US)
        frames += batch
        raw += batch.raw()
        samples += DECODER.samples(batch)
    batch = decoder.finish()
    raw += batch.raw()
    return frames + list(batch), repr(samples + DECODER.samples(batch)), raw, decoder.counters


@settings(max_examples=150, deadline=None)
@given(streams, cuts, st.booleans(), st.booleans())
def test_any_cuts_of_any_dirty_stream_give_the_same(
    parts: list[Piece], edges: list[int], stamped: bool, keyed: bool
) -> None:
    data, keys = build(parts, stamped), (KEY,) if keyed else ()
    whole = run(data, [], stamped, keys)
    assert run(data, edges, stamped, keys) == whole
    assert run(data, list(range(len(data))), stamped, keys) == whole


@settings(max_examples=60, deadline=None)
@given(st.lists(pieces, min_size=10, max_size=30), st.integers(10, 16), cuts)
def test_columns_record_by_record_and_any_cuts_agree(
    parts: list[Piece], times: int, edges: list[int]
) -> None:
    data = build(parts * times, stamped=True)
    singly = run(data, list(range(0, len(data), 300)), True, (KEY,))
    assert run(data, [], True, (KEY,)) == singly
    assert run(data, edges[:2], True, (KEY,)) == singly


def test_a_record_whose_header_is_cut_is_found_after_garbage_in_a_large_piece() -> None:
    """Columns and record by record wait at the same place: a magic byte without length or flags behind it."""
    calm = b"".join(piece("good", 0, k, True) for k in range(400))
    data = calm + b"\x55" * 40 + b"".join(piece("good", 0, 400 + k, True) for k in range(3))
    expected = run(data, list(range(0, len(data), 300)), True, ())
    for cut in range(len(calm) + 1, len(data)):
        assert run(data, [cut], True, ()) == expected


@settings(max_examples=150, deadline=None)
@given(streams, st.booleans(), st.sampled_from([64, 1 << 18]))
def test_no_dirt_holds_back_the_good_frames_behind_it(parts: list[Piece], stamped: bool, chunk: int) -> None:
    """However it began: a thousand good frames later all but the last few have been given."""
    calm = [piece("good", 0, k, stamped) for k in range(1000)]
    data = build(parts, stamped) + b"".join(calm)
    decoder = FrameDecoder(DIALECT, stamped=stamped)
    for at in range(0, len(data), chunk):
        decoder.feed(data[at : at + chunk], START_US)
    waiting = sum(len(frame) for _, frame in decoder.finish().raw())
    assert waiting <= 2 * LONGEST_RECORD


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=3000), st.booleans())
def test_any_bytes_are_survived(data: bytes, stamped: bool) -> None:
    decoder = FrameDecoder(DIALECT, stamped=stamped)
    frames = [*decoder.feed(data, START_US), *decoder.finish()]
    assert decoder.counters.frames == len(frames)
    assert decoder.counters.bytes == len(data)
