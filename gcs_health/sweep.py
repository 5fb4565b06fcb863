"""One flight under other circumstances: what of its verdicts holds, and what was luck.

    phases and rates   of IMU and rotor telemetry every 2nd and 4th message is kept, from each offset
    loss               a share of all frames is dropped, by several seeds
    clock jitter       the vehicle's own stamps, or the times of arrival, are shaken

Every variant is an edit of the recorded frames, replayed as any log is.
"""

import struct
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gcs_health.engine import each
from gcs_health.errors import LogError
from gcs_health.flight import replay
from gcs_health.mavlink.dialect import Message, default_dialect
from gcs_health.mavlink.encoder import pack_v2
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import MonitorConfig

Record = tuple[int, bytes]  # stamp, frame

IMU = frozenset({26, 27, 105, 116, 129})
ROTORS = frozenset({36, 290, 291, 375, *range(11030, 11033), *range(11040, 11045)})
LOSSES = (0.05, 0.2)  # share of all frames
SEEDS = (1, 2, 3)
STAMP_JITTER = 0.2  # of the message's usual interval, either way
ARRIVAL_JITTER = 0.02  # s, mean of an exponential delay; order is kept, as a queue does
V2, PLAIN_HEADER, CRC = 0xFD, 10, 2
RECORDED = "as recorded"


class Heard(NamedTuple):
    """An alert: whose, what, and when it was first raised [s]."""

    vehicle: str
    motor: int
    code: str
    t: float


class Variant(NamedTuple):
    """One replay: under which circumstances, the flight's outcome, its alerts; `error` if there was no replay."""

    name: str
    outcome: str
    heard: tuple[Heard, ...]
    error: str


def sweep(log: str, config: MonitorConfig, workers: int | None = None) -> list[Variant]:
    """Replay a log as it is and under every variant, in their order.

    Raises
    ------
    LogError : the log cannot be read, or has no receive stamps.
    """
    with open_log(log) as opened:
        if not opened.stamped:
            raise LogError(f"{opened.name}: a sweep needs receive stamps, raw MAVLink has none")
        decoder = FrameDecoder(default_dialect(), stamped=True)
        records = [record for block in opened.blocks() for record in decoder.feed(block).raw()]
        records += decoder.finish().raw()
    with tempfile.TemporaryDirectory() as place:
        jobs = []
        for k, (name, edited) in enumerate(variants(records)):
            path = Path(place) / f"{k:03d}.tlog"
            path.write_bytes(b"".join(struct.pack(">Q", stamp) + frame for stamp, frame in edited))
            jobs.append((name, str(path), config))
        done = {one.item[0]: one for one in each(_heard, jobs, workers=workers)}
    return [
        done[name].result if not done[name].error else Variant(name, "", (), done[name].error)
        for name, *_ in jobs
    ]


def variants(records: Sequence[Record]) -> Iterator[tuple[str, list[Record]]]:
    """Yield (name, records) of the flight as it is and of each edit."""
    yield RECORDED, list(records)
    for what, ids in (("IMU", IMU), ("rotor telemetry", ROTORS)):
        if not any(_id(frame) in ids for _, frame in records):
            continue
        for every in (2, 4):
            for phase in range(every):
                yield f"{what} at 1/{every} of its rate, phase {phase}", _kept(records, ids, every, phase)
    for share in LOSSES:
        for seed in SEEDS:
            lost = np.random.default_rng(seed).random(len(records)) < share
            kept = [record for record, gone in zip(records, lost.tolist(), strict=True) if not gone]
            yield f"{100 * share:.0f} % of all frames lost, seed {seed}", kept
    for seed in SEEDS[:2]:
        yield f"vehicle stamps shaken by {STAMP_JITTER:.0%} of the step, seed {seed}", _shaken(records, seed)
        yield (
            f"arrival delayed by {1e3 * ARRIVAL_JITTER:.0f} ms on average, seed {seed}",
            _delayed(records, seed),
        )


def findings(swept: Sequence[Variant]) -> list[tuple[Heard, int, float, float]]:
    """Return (alert, variants that raise it, earliest, latest t) of every alert; those of the recording first."""
    found: dict[tuple[str, int, str], list[Heard]] = {}
    for variant in swept:
        for heard in variant.heard:
            found.setdefault(heard[:3], []).append(heard)
    return [(h[0], len(h), min(x.t for x in h), max(x.t for x in h)) for h in found.values()]


def _heard(job: tuple[str, str, MonitorConfig]) -> Variant:
    name, path, config = job
    flight = replay(path, config, readings=False, estimates_every=60.0)
    first: dict[tuple[str, int, str], Heard] = {}
    for alert in flight.alerts:
        motor = alert.motor or 0
        first.setdefault((alert.vehicle, motor, alert.code), Heard(alert.vehicle, motor, alert.code, alert.t))
    return Variant(name, flight.outcome, tuple(first.values()), "")


def _id(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little") if frame[0] == V2 else frame[5]


def _payload(frame: bytes) -> bytes:
    return frame[PLAIN_HEADER : PLAIN_HEADER + frame[1]] if frame[0] == V2 else frame[6 : 6 + frame[1]]


def _kept(records: Sequence[Record], ids: frozenset[int], every: int, phase: int) -> list[Record]:
    """Return the records with, of each message in `ids`, only every so-many-th.

    Counted by sender and by the message's own index: ESCs from the fifth on come as a second message, the
    spare IMUs under another id, and each is to be thinned, not dropped.
    """
    count: dict[tuple[int, bytes, bytes], int] = {}
    place = {id: _index_at(id) for id in ids}
    out = []
    for stamp, frame in records:
        id = _id(frame)
        if id in ids:
            at = place[id]
            index = (
                b"" if at is None else _payload(frame)[at : at + 1] or b"\0"
            )  # zeros at the end are cut off
            key = (id, frame[5:7] if frame[0] == V2 else frame[3:5], index)
            n = count[key] = count.get(key, -1) + 1
            if n % every != phase:
                continue
        out.append((stamp, frame))
    return out


def _index_at(id: int) -> int | None:
    """Return where in a payload a message says which of several it is; None if it does not."""
    message = default_dialect().messages.get(id)
    fields = message.dtype.fields if message is not None else None
    name = next((name for name in ("index", "id") if fields and name in fields), None)
    return fields[name][1] if fields and name else None


def _shaken(records: Sequence[Record], seed: int) -> list[Record]:
    """Return the records with noise on the vehicle's own stamps, `time_usec` of MAVLink 2 frames."""
    rng = np.random.default_rng(seed)
    messages = default_dialect().messages
    last: dict[tuple[int, bytes], int] = {}
    out = []
    for stamp, frame in records:
        message = messages.get(_id(frame))
        at = _time_at(message) if frame[0] == V2 and not frame[2] else None  # signed frames stay as they are
        if message is not None and at is not None:
            key = (message.id, frame[5:7])
            payload = _payload(frame).ljust(message.size, b"\0")
            (t_us,) = struct.unpack_from("<Q", payload, at)
            step = min(t_us - last.get(key, t_us), 100_000)
            last[key] = t_us
            shaken = max(t_us + round(STAMP_JITTER * step * rng.uniform(-1.0, 1.0)), 0)
            changed = payload[:at] + struct.pack("<Q", shaken) + payload[at + 8 :]
            frame = pack_v2(message, changed, frame)
        out.append((stamp, frame))
    return out


def _time_at(message: Message | None) -> int | None:
    """Return where a message of IMU or rotors has its `time_usec` of eight bytes; None if it has none."""
    if message is None or message.id not in IMU | ROTORS:
        return None
    fields = message.dtype.fields
    if fields is None or "time_usec" not in fields or fields["time_usec"][0] != np.dtype("<u8"):
        return None
    return fields["time_usec"][1]


def _delayed(records: Sequence[Record], seed: int) -> list[Record]:
    """Return the records arriving later, each by a chance of its own, in the order in which they were sent."""
    delays = np.random.default_rng(seed).exponential(1e6 * ARRIVAL_JITTER, len(records))
    arrivals = np.maximum.accumulate(np.array([stamp for stamp, _ in records]) + delays.astype(np.int64))
    return [(int(at), frame) for at, (_, frame) in zip(arrivals, records, strict=True)]
