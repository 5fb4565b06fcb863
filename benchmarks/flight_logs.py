"""Recorded flights for the benchmarks: a .tlog as records, decimated, changed, and run through the Monitor."""

import struct
from dataclasses import dataclass, field
from pathlib import Path

from fastcrc import crc16

from gcs_health.airframe import Airframe
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent

HIGHRES_IMU, ESC_STATUS = 105, 291
CRC_EXTRA = {HIGHRES_IMU: 93, ESC_STATUS: 10}

# name of the flights with rotor speeds: vehicle file, last second worth judging (crash), s
FLIGHTS: dict[str, tuple[str, float]] = {
    "bebop2_prop_eject": ("bebop2", 12.9),
    **{
        f"indiflight_{n}": ("indiflight", 1e9) for n in ("00230", "00258", "00262", "00267", "00271", "00341")
    },
    **{f"nanodrone_square_run{n}": ("nanodrone", 1e9) for n in (1, 3, 5)},
}
EJECTION = "bebop2_prop_eject"
LABEL, FIRST_VISIBLE, EJECTED = 12.39, 12.24, 2  # s, s, motor

# rate cell: IMU and ESC messages to keep, one in n, for a 500 Hz and for a 100 Hz log; None = not possible
CELLS: dict[str, tuple[tuple[int, int], tuple[int, int] | None]] = {
    "full": ((1, 1), (1, 1)),
    "100/50": ((5, 10), None),
    "50/50": ((10, 10), (2, 2)),
    "50/10": ((10, 50), (2, 10)),
    "25/10": ((20, 50), (4, 10)),
}


@dataclass(frozen=True)
class Record:
    """One .tlog record: receive stamp [µs], message id, its bytes as in the log."""

    stamp: int
    message: int
    raw: bytes

    @property
    def payload(self) -> bytes:
        """Payload with the zero bytes back that the sender cut."""
        return self.raw[18 : 18 + self.raw[9]].ljust(63, b"\0")

    @property
    def time(self) -> float:
        """The vehicle's stamp [s]."""
        return float(struct.unpack_from("<Q", self.payload)[0]) * 1e-6


def records(path: Path) -> list[Record]:
    """Return the records of a clean MAVLink 2 .tlog."""
    data = path.read_bytes()
    out = []
    at = 0
    while at + 20 <= len(data):
        size = 8 + 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        stamp = int.from_bytes(data[at : at + 8], "big")
        message = int.from_bytes(data[at + 15 : at + 18], "little")
        out.append(Record(stamp, message, data[at : at + size]))
        at += size
    return out


def divisors(name: str, cell: str) -> tuple[int, int] | None:
    """Return how many IMU and ESC messages become one; None where the log is too slow."""
    return CELLS[cell][1 if name.startswith("nanodrone") else 0]


def decimate(log: list[Record], keep: tuple[int, int], phase: tuple[int, int]) -> list[Record]:
    """Keep every n-th HIGHRES_IMU and ESC_STATUS, from the phase-th on; all else stays."""
    seen = {HIGHRES_IMU: 0, ESC_STATUS: 0}
    out = []
    for record in log:
        if record.message in seen:
            k = 0 if record.message == HIGHRES_IMU else 1
            count = seen[record.message]
            seen[record.message] += 1
            if count < phase[k] or (count - phase[k]) % keep[k]:
                continue
        out.append(record)
    return out


def repack(record: Record, payload: bytes) -> Record:
    """Return the record with another payload of the same length, and its checksum."""
    size = record.raw[9]
    head = record.raw[8:18]
    body = head[1:] + payload[:size]
    crc = crc16.mcrf4xx(body + bytes([CRC_EXTRA[record.message]]))
    raw = record.raw[:8] + head + payload[:size] + crc.to_bytes(2, "little") + record.raw[20 + size :]
    return Record(record.stamp, record.message, raw)


@dataclass
class Run:
    """What came of one replay: alarms as (s, motor), and how long the gate was open [s]."""

    alarms: list[tuple[float, int]] = field(default_factory=list)
    contradicted: bool = False
    open_time: float = 0.0
    flying_time: float = 0.0


def run(log: list[Record], airframe: Airframe, mode: str = "recommended", until: float = 1e9) -> Run:
    """Replay records through the Monitor, one at a time, up to `until` s after the first."""
    monitor = Monitor(
        MonitorConfig(
            airframe=airframe, estimators=("effectiveness",), mode=mode, stamped=True, estimate_rate=2.0
        )
    )
    out = Run()
    start = log[0].stamp
    for record in log:
        if (record.stamp - start) * 1e-6 > until:
            break
        for event in monitor.feed(record.raw):
            if isinstance(event, AlertEvent) and event.state == "raised":
                out.alarms.append(((event.t_unix_us - start) * 1e-6, event.motor))
    for vehicle in monitor.vehicles():
        bank = vehicle.bank
        if bank is not None:
            out.open_time, out.flying_time = bank.open_time, bank.flying_time
            out.contradicted = bank.contradicted
    return out
