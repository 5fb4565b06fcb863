"""Mutated frames without a crash, a stall or a frame that is not one.

    python benchmarks/fuzz_decode.py            # 10^6 mutated frames, a minute or two
    python benchmarks/fuzz_decode.py --frames 20000 --seed 3

Frames of the shipped flight and of every known message are mutated (bits, bytes, lengths, cuts, splices),
joined to logs and to streams, and decoded to samples. Each log is decoded twice, whole and in random
pieces: both must give the same. As a fuzz target for a coverage-guided fuzzer: `target(bytes)`.
"""

import argparse
import random
import time
from pathlib import Path

from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.messages import MessageDecoder

DIALECT = default_dialect()
DECODER = MessageDecoder(DIALECT)
FLIGHT = Path(__file__).parents[1] / "replay" / "lost_propeller.tlog"
START_US = 1_700_000_000_000_000
FRAMES_A_LOG = 500


def decode(data: bytes, stamped: bool, cuts: list[int]) -> tuple[list[object], str]:
    """Decode in pieces; return frames and counters."""
    decoder = FrameDecoder(DIALECT, stamped=stamped)
    frames: list[object] = []
    for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True):
        batch = decoder.feed(data[a:b], START_US)
        DECODER.samples(batch)
        frames += batch
    last = decoder.finish()
    DECODER.samples(last)
    return frames + list(last), repr(decoder.counters)


def target(data: bytes) -> None:
    """One fuzz case: any bytes, as log and as stream, whole and cut in two."""
    for stamped in (True, False):
        assert decode(data, stamped, []) == decode(data, stamped, [len(data) // 2])


def mutate(frame: bytes, other: bytes, rng: random.Random) -> bytes:
    """Return a frame with something wrong with it, now and then with nothing."""
    kind = rng.randrange(8)
    data = bytearray(frame)
    at = rng.randrange(len(data))
    if kind == 0:
        data[at] ^= 1 << rng.randrange(8)
    elif kind == 1:
        data[at] = rng.choice((0, 0xFD, 0xFE, 0xFF, rng.randrange(256)))
    elif kind == 2:
        data[1] = rng.randrange(256)
    elif kind == 3:
        del data[at:]
    elif kind == 4:
        data[at:at] = other[: rng.randrange(len(other))]
    elif kind == 5:
        data[at : at + 4] = rng.randbytes(rng.randrange(9))
    elif kind == 6:
        data += rng.randbytes(rng.randrange(300))
    return bytes(data)


def seeds(rng: random.Random) -> list[bytes]:
    """Return good frames to start from."""
    flight = [f for _, f in FrameDecoder(DIALECT, stamped=True).feed(FLIGHT.read_bytes()).raw()]
    made = [
        b"\xfd"
        + bytes([n := rng.randrange(1, 60), 0, 0, 0, 1, 1])
        + id.to_bytes(3, "little")
        + rng.randbytes(n + 2)
        for id in DIALECT.messages
    ]
    return rng.sample(flight, 300) + made


def main() -> None:
    """Fuzz and print one line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rng = random.Random(args.seed)
    good = seeds(rng)
    mutated = kept = size = 0
    slowest = 0.0
    started = time.process_time()
    while mutated < args.frames:
        stamped = rng.random() < 0.5
        parts = []
        for k in range(FRAMES_A_LOG):
            frame = mutate(rng.choice(good), rng.choice(good), rng)
            parts.append((START_US + k).to_bytes(8, "big") + frame if stamped else frame)
        data = b"".join(parts)
        before = time.process_time()
        whole = decode(data, stamped, [])
        slowest = max(slowest, time.process_time() - before)
        if rng.random() < 0.1:  # the second decoding in pieces is slow: a sample of the logs
            cuts = sorted(rng.randrange(len(data)) for _ in range(50))
            assert decode(data, stamped, cuts) == whole, f"seed {args.seed}, log after {mutated} frames"
        mutated += FRAMES_A_LOG
        kept += len(whole[0])
        size += len(data)
    spent = time.process_time() - started
    print(
        f"{mutated} mutated frames ({size / 1e6:.0f} MB, seed {args.seed}): {kept} frames kept, no crash, "
        f"slowest log of {FRAMES_A_LOG} frames {1000 * slowest:.0f} ms, {spent:.0f} s in all"
    )


if __name__ == "__main__":
    main()
