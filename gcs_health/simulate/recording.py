"""A recorded flight as frames with vehicle times, and what the monitor makes of it when healthy."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.clock import VehicleClock
from gcs_health.errors import LogError
from gcs_health.mavlink.batch import FrameBatch
from gcs_health.mavlink.dialect import Dialect, Message, default_dialect
from gcs_health.mavlink.encoder import pack_v1, pack_v2, payload_of
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.framing import MAGIC_V1, SIGNED
from gcs_health.mavlink.messages import MessageDecoder
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.samples import Outputs, Parameter, Reading, RotorReading, Sample
from gcs_health.vehicle_monitor import VehicleMonitor

Array = NDArray[np.float64]
MOTOR_OUTPUTS = (36, 375)  # SERVO_OUTPUT_RAW, ACTUATOR_OUTPUT_STATUS


class Recorded(NamedTuple):
    """One frame: receive stamp [UNIX µs], bytes, sender, message id, and its sample and time if it has any."""

    stamp: int
    raw: bytes
    sender: tuple[int, int]
    message: int
    sample: Sample | None
    t: float  # vehicle clock [s]; NaN without a sample, and until it is known


@dataclass(frozen=True)
class Flown:
    """What a first, healthy pass tells.

    vehicle : (system, component). airframe, matrix : geometry and gains G (4, n) of the estimator, rows roll,
    pitch, yaw [(rad/s²)/(rad/s)²] and a_z [(m/s²)/(rad/s)²]. rotor_t (m,), speed (m, n) [rad/s].
    opened : times at which verdicts could be given [s]. first_t, last_t [s]. parameters : by name.
    reported : ESC indices in the stream. powered : rotors whose ESC gives a current. channels : output channel,
    from 0, of each rotor. outputs : by message id, times (k,) and raw outputs (k, n) of the rotors.
    """

    vehicle: tuple[int, int]
    airframe: Airframe
    matrix: Array
    rotor_t: Array
    speed: Array
    opened: Array
    first_t: float
    last_t: float
    parameters: dict[str, float]
    reported: frozenset[int]
    powered: frozenset[int]
    channels: tuple[int, ...]
    outputs: dict[int, tuple[Array, Array]]


def read_frames(path: str) -> list[tuple[int, bytes]]:
    """Return (stamp, frame) of every good frame.

    Raises
    ------
    LogError : no log, or one without receive stamps.
    """
    with open_log(path) as log:
        if not log.stamped:
            raise LogError(f"{path}: a raw stream without receive stamps; expected a .tlog")
        decoder = FrameDecoder(default_dialect(), stamped=True)
        frames = [pair for block in log.blocks() for pair in decoder.feed(block).raw()]
        return frames + list(decoder.finish().raw())


def with_times(frames: list[tuple[int, bytes]], dialect: Dialect) -> Iterator[Recorded]:
    """Yield the frames with their samples, timed as the monitor times them."""
    decoder = MessageDecoder(dialect)
    clocks: dict[tuple[int, int], VehicleClock] = {}
    framing = FrameDecoder(dialect, stamped=False)
    for stamp, raw in frames:
        batch: FrameBatch = framing.feed(raw, stamp)
        if len(batch) != 1:  # a frame of unknown id waits for the next: it has no sample
            framing = FrameDecoder(dialect, stamped=False)
            yield Recorded(stamp, raw, (0, 0), -1, None, float("nan"))
            continue
        frame = batch.frames[0]
        sender = (frame.system, frame.component)
        samples = decoder.samples(batch)
        if not samples:
            yield Recorded(stamp, raw, sender, frame.message, None, float("nan"))
            continue
        clock = clocks.setdefault(sender, VehicleClock())
        t = clock.time_of(samples[0])
        # until the vehicle's clock is known, times are on the receive stamps' axis: long after any fault
        yield Recorded(stamp, raw, sender, frame.message, samples[0], t if clock.settled else math.nan)


def first_pass(name: str, frames: list[tuple[int, bytes]], airframe: Airframe | None) -> Flown:
    """Let the monitor watch the flight; return what it learned.

    Raises
    ------
    LogError : no vehicle, no geometry, no rotor speeds, or an alarm in what should be a healthy flight.
    """
    readings: dict[str, list[Reading]] = {}
    opened: list[float] = []

    def tap(vehicle: str, reading: Reading) -> None:
        readings.setdefault(vehicle, []).append(reading)

    monitor = Monitor(MonitorConfig(airframe=airframe, tap=tap))
    for stamp, raw in frames:
        monitor.feed(raw, stamp)
        for vehicle in monitor.vehicles():
            bank = vehicle.bank
            if bank is not None and bank.gate.verdicts:
                opened.append(vehicle.last_t)
    monitor.finish()
    vehicle = _the_vehicle(name, monitor)
    assert vehicle.airframe is not None
    assert vehicle.bank is not None
    rotors = [r for r in readings.get(vehicle.vehicle, []) if isinstance(r, RotorReading)]
    whole = [r for r in rotors if all(speed == speed for speed in r.speed)]
    if len(whole) < 10:
        raise LogError(f"{name}: no rotor speeds of all rotors in it; a fault cannot be grafted without")
    system, component = map(int, vehicle.vehicle.split("."))
    said = [r for r in with_times(frames, monitor.dialect) if r.sender == (system, component)]
    channels = vehicle.rotors.output_channels
    return Flown(
        (system, component),
        vehicle.airframe,
        vehicle.bank.gains.matrix,
        np.array([r.t for r in whole]),
        np.array([r.speed for r in whole]),
        np.array(opened),
        vehicle.first_t,
        vehicle.last_t,
        {r.sample.name: r.sample.number for r in said if isinstance(r.sample, Parameter)},
        frozenset(vehicle.rotors.esc_indices()),
        frozenset(k for r in rotors for k, current in enumerate(r.current) if current > 0.0),
        channels,
        _outputs(said, channels),
    )


def _outputs(said: list[Recorded], channels: tuple[int, ...]) -> dict[int, tuple[Array, Array]]:
    """Return times and raw values of the rotors' output channels, by message."""
    rows: dict[int, list[tuple[float, list[float]]]] = {}
    for record in said:
        sample = record.sample
        if isinstance(sample, Outputs) and record.message in MOTOR_OUTPUTS and not sample.port:
            values = [sample.value[c] if 0 <= c < len(sample.value) else math.nan for c in channels]
            rows.setdefault(record.message, []).append((record.t, values))
    return {
        message: (np.array([t for t, _ in many]), np.array([values for _, values in many]))
        for message, many in rows.items()
    }


def _the_vehicle(name: str, monitor: Monitor) -> VehicleMonitor:
    """Return the vehicle whose rotors are known, in a flight without an alarm."""
    vehicles = [vehicle for vehicle in monitor.vehicles() if vehicle.airframe is not None]
    if not vehicles or vehicles[0].airframe is None:
        raise LogError(f"{name}: no vehicle whose geometry is known; give --vehicle FILE.toml")
    vehicle = vehicles[0]
    if vehicle.alerts:
        raise LogError(f"{name}: not a healthy flight: {vehicle.alerts[0].text}")
    if vehicles[0].airframe.source is AirframeSource.ASSUMED:
        raise LogError(f"{name}: the geometry is only assumed; give --vehicle FILE.toml")
    return vehicle


def unpacked(message: Message, raw: bytes) -> dict[str, Any]:
    """Return the wire fields of a frame by name; arrays as lists."""
    start = 6 if raw[0] == MAGIC_V1 else 10
    payload = raw[start : start + raw[1]].ljust(message.size, b"\0")[: message.size]
    values = message.layout.unpack(payload)
    return {
        name: list(values[at : at + count]) if count else values[at]
        for name, (at, count) in message.positions.items()
    }


def repacked(message: Message, raw: bytes, fields: dict[str, Any]) -> bytes:
    """Return the frame with these fields, all else as it was, even what our dialect does not know; CRC anew."""
    payload, length = payload_of(message, fields), raw[1]
    if raw[0] == MAGIC_V1:
        return pack_v1(message, payload[:length], raw)
    known = raw[10 : 10 + length]
    payload += known[message.size :]  # extensions newer than ours
    if known[-1:] != b"\0":
        payload = payload.rstrip(b"\0") or payload[:1]
    else:  # a sender that does not cut zeros off
        payload = payload[: max(len(payload.rstrip(b"\0")), length)]
    return pack_v2(message, payload, raw)


def is_signed(raw: bytes) -> bool:
    """Whether a frame carries a signature, which an edit would break."""
    return raw[0] != MAGIC_V1 and bool(raw[2] & SIGNED)
