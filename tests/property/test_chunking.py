"""Any bytes, cut anywhere: the same frames, the same counts, the same samples."""

import random
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.messages import MessageDecoder

DIALECT = default_dialect()
DECODER = MessageDecoder(DIALECT)
START = 1_700_000_000_000_000


def source(seed: int) -> list[bytes]:
    from pymavlink.dialects.v20 import all as stock

    rng = random.Random(seed)
    link = stock.MAVLink(None, srcSystem=rng.randrange(1, 4), srcComponent=1)
    frames = []
    for k in range(12):
        link.seq = k
        message = rng.choice(
            [
                stock.MAVLink_heartbeat_message(2, 12, 81, k, 4, 3),
                stock.MAVLink_attitude_message(k, 0.5, rng.random(), 0.0, 0.0, 0.0, 0.0),
                stock.MAVLink_highres_imu_message(k, *[rng.gauss(0, 1) for _ in range(6)], *[0.0] * 7, 63),
                stock.MAVLink_statustext_message(6, b"\xfd\xfe text", 0, 0),
            ]
        )
        frames.append(bytes(message.pack(link, force_mavlink1=rng.random() < 0.3)))
    return frames


FRAMES = [frame for seed in range(6) for frame in source(seed)]


def record(frame: bytes, k: int) -> bytes:
    return (START + k * 997).to_bytes(8, "big") + frame


pieces = st.one_of(
    st.tuples(st.just("frame"), st.integers(0, len(FRAMES) - 1), st.integers(0, 1000)),
    st.tuples(st.just("broken"), st.integers(0, len(FRAMES) - 1), st.integers(0, 1000)),
    st.tuples(st.just("bare"), st.integers(0, len(FRAMES) - 1), st.integers(0, 1000)),
    st.tuples(st.just("noise"), st.integers(0, 2**32), st.integers(1, 40)),
    st.tuples(st.just("cut"), st.integers(0, len(FRAMES) - 1), st.integers(0, 1000)),
)


def build(parts: list[tuple[str, int, int]], stamped: bool) -> bytes:
    out = b""
    for k, (kind, a, b) in enumerate(parts):
        if kind == "noise":
            out += bytes(random.Random(a).choice(b"\x00\x06\xfd\xfe\x09\x55") for _ in range(b))
            continue
        whole = record(FRAMES[a], k) if stamped and kind != "bare" else FRAMES[a]
        if kind == "broken":
            whole = whole[: b % len(whole)] + b"\x5a" + whole[b % len(whole) + 1 :]
        if kind == "cut":
            whole = whole[: b % len(whole)]
        out += whole
    return out


def run(data: bytes, cuts: list[int], stamped: bool) -> tuple[object, ...]:
    decoder = FrameDecoder(DIALECT, stamped=stamped)
    frames, samples, edges = [], [], [0, *sorted(c % (len(data) + 1) for c in cuts), len(data)]
    for a, b in pairwise(edges):
        batch = decoder.feed(data[a:b], START)
        frames += list(batch)
        samples += DECODER.samples(batch)
    batch = decoder.finish()
    return frames + list(batch), repr(samples + DECODER.samples(batch)), decoder.counters


@settings(max_examples=150, deadline=None)
@given(st.lists(pieces, max_size=25), st.lists(st.integers(0, 5000), max_size=30), st.booleans())
def test_any_chunking_gives_the_same(
    parts: list[tuple[str, int, int]], cuts: list[int], stamped: bool
) -> None:
    data = build(parts, stamped)
    whole = run(data, [], stamped)
    assert run(data, cuts, stamped) == whole
    assert run(data, list(range(len(data))), stamped) == whole


@settings(max_examples=40, deadline=None)
@given(st.lists(pieces, min_size=20, max_size=40), st.integers(6, 20))
def test_columns_and_single_records_agree(parts: list[tuple[str, int, int]], times: int) -> None:
    """A log long enough to be read by columns, against the same in pieces too small for them."""
    data = build(parts * times, stamped=True)
    assert run(data, [], True) == run(data, list(range(0, len(data), 500)), True)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=3000), st.booleans())
def test_any_bytes_are_survived(data: bytes, stamped: bool) -> None:
    frames, _, counters = run(data, [], stamped)
    assert counters.frames == len(frames)  # type: ignore[attr-defined,arg-type]
    assert counters.bytes == len(data)  # type: ignore[attr-defined]
