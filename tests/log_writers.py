"""Small writers of PX4's ULog and ArduPilot's DataFlash format: a flight's samples as each autopilot keeps them.

ULog: docs.px4.io, "ULog File Format". DataFlash: libraries/AP_Logger/LogStructure.h.
"""

import math
import struct
from collections.abc import Iterable, Iterator, Sequence

from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.messages import MessageDecoder
from gcs_health.samples import (
    Battery,
    EscStatus,
    Heartbeat,
    Imu,
    LandedState,
    Outputs,
    Parameter,
    Sample,
    StatusText,
    Vibration,
)

RPM = 2.0 * math.pi / 60.0


def samples_of(tlog: bytes) -> list[Sample]:
    """The samples in a .tlog."""
    dialect = default_dialect()
    return MessageDecoder(dialect).samples(FrameDecoder(dialect, stamped=True).feed(tlog))


class ULogWriter:
    """Collects messages of a few topics; `data` is the file."""

    def __init__(self, start_us: int) -> None:
        self._definitions = b""
        self._rest: list[bytes] = []
        self._start_us = start_us
        self._ids: dict[str, tuple[int, struct.Struct]] = {}

    def _record(self, kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    def parameter(self, name: str, value: float | int) -> None:
        key = f"{'int32_t' if isinstance(value, int) else 'float'} {name}".encode()
        packed = struct.pack("<i" if isinstance(value, int) else "<f", value)
        self._definitions += self._record("P", bytes([len(key)]) + key + packed)

    def info(self, name: str, text: str) -> None:
        key = f"char[{len(text)}] {name}".encode()
        self._definitions += self._record("I", bytes([len(key)]) + key + text.encode())

    def format(self, name: str, fields: str) -> None:
        """Declare a type, such as "uint64_t timestamp;float[3] q;"."""
        self._definitions += self._record("F", f"{name}:{fields}".encode())

    def topic(self, name: str, codes: str, instance: int = 0) -> None:
        """Subscribe to a type whose fields pack to `codes`; padding at its end is not logged."""
        key = f"{name}{instance or ''}"
        self._ids[key] = (len(self._ids), struct.Struct("<" + codes))
        self._rest.append(self._record("A", struct.pack("<BH", instance, self._ids[key][0]) + name.encode()))

    def add(self, name: str, *values: object) -> None:
        number, layout = self._ids[name]
        self._rest.append(self._record("D", struct.pack("<H", number) + layout.pack(*values)))

    def text(self, t_us: int, severity: int, text: str) -> None:
        self._rest.append(self._record("L", struct.pack("<BQ", ord("0") + severity, t_us) + text.encode()))

    def data(self) -> bytes:
        head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", self._start_us)
        return head + self._record("B", bytes(40)) + self._definitions + b"".join(self._rest)


_ULOG_TYPES = {
    "esc_report": "uint64_t timestamp;int32_t esc_rpm;float esc_voltage;float esc_current;"
    "float esc_temperature;uint16_t failures;uint8_t actuator_function;uint8_t[1] _padding0;",
    "esc_status": "uint64_t timestamp;uint16_t counter;uint8_t esc_count;uint8_t esc_online_flags;"
    "uint8_t[4] _padding0;esc_report[8] esc;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "vehicle_imu": "uint64_t timestamp;float[3] delta_angle;float[3] delta_velocity;"
    "uint16_t delta_angle_dt;uint16_t delta_velocity_dt;uint8_t[4] _padding0;",
    "actuator_motors": "uint64_t timestamp;float[12] control;",
    "vehicle_status": "uint64_t timestamp;uint8_t arming_state;uint8_t system_type;uint8_t[6] _padding0;",
    "vehicle_land_detected": "uint64_t timestamp;bool landed;uint8_t[7] _padding0;",
    "battery_status": "uint64_t timestamp;float voltage_v;float current_a;float remaining;",
}
# as logged: padding at a topic's end is not
_ULOG_TOPICS = {
    "esc_status": "QHBB4x" + "QifffHBx" * 8,
    "sensor_combined": "Q6f",
    "vehicle_imu": "Q6fHH",
    "actuator_motors": "Q12f",
    "vehicle_status": "QBB",
    "vehicle_land_detected": "Q?",
    "battery_status": "Qfff",
}


def as_ulog(samples: Sequence[Sample], *, imu: str = "sensor_combined", motors: bool = False) -> bytes:
    """A PX4 flight as its .ulg; `motors`: ESCs in reverse order, named by actuator_function."""
    t_us = next(s.time_us for s in samples if s.time_us)
    writer = ULogWriter(t_us)
    writer.info("sys_uuid", "000600000000333233343436000000000001")
    for name, fields in _ULOG_TYPES.items():
        writer.format(name, fields)
    for s in {s.name: s for s in samples if isinstance(s, Parameter)}.values():
        writer.parameter(s.name, int(s.number) if s.kind == 6 else s.value)
    for name, codes in _ULOG_TOPICS.items():
        if name == imu or name not in ("sensor_combined", "vehicle_imu"):
            writer.topic(name, codes)
    for s in samples:
        t_us = s.time_us or t_us
        if isinstance(s, StatusText):
            writer.text(t_us, s.severity, s.text)
        elif isinstance(s, Imu):
            writer.add(imu, t_us, *_imu(s, imu))
        elif isinstance(s, EscStatus):
            writer.add("esc_status", t_us, 0, 4, 15, *_escs(s, t_us, motors))
        else:
            for topic, values in _slow(s):
                writer.add(topic, t_us, *values)
    return writer.data()


def _imu(s: Imu, topic: str) -> tuple[float, ...]:
    values = (s.p, s.q, s.r, s.ax, s.ay, s.az)
    return values if topic == "sensor_combined" else (*(v * 0.005 for v in values), 5000, 5000)


def _escs(s: EscStatus, t_us: int, motors: bool) -> list[float]:
    out: list[float] = []
    for k in reversed(range(4)) if motors else range(4):
        named = 101 + k if motors else 0
        out += [t_us, round(s.speed[k] / RPM), s.voltage[k], s.current[k], 25.0, 0, named]
    return out + [0, 0, 0.0, 0.0, 0.0, 0, 0] * 4


def _slow(s: Sample) -> Iterator[tuple[str, tuple[object, ...]]]:
    match s:
        case Outputs(message=375):
            yield "actuator_motors", (*s.value[:12], *[math.nan] * (12 - len(s.value[:12])))
        case Heartbeat():
            yield "vehicle_status", (2 if s.armed else 1, s.vehicle_type)
        case LandedState():
            yield "vehicle_land_detected", (s.landed_state == 1,)
        case Battery(message=147):
            yield "battery_status", (s.voltage, s.current, s.remaining)


_CODES = {
    "Q": "Q",
    "B": "B",
    "I": "I",
    "f": "f",
    "H": "H",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "h": "h",
    "c": "h",
}
_DATAFLASH = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "PARM": (64, "QNf", "TimeUS,Name,Value"),
    "IMU": (65, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ESC": (66, "QBffffc", "TimeUS,Instance,RPM,RawRPM,Volt,Curr,Temp"),
    "RCOU": (67, "QHHHH", "TimeUS,C1,C2,C3,C4"),
    "EV": (68, "QB", "TimeUS,Id"),
    "MSG": (69, "QZ", "TimeUS,Message"),
    "BAT": (70, "QBff", "TimeUS,Inst,Volt,Curr"),
    "VIBE": (71, "QBfff", "TimeUS,IMU,VibeX,VibeY,VibeZ"),
}


def as_dataflash(samples: Iterable[Sample], parameters: dict[str, float]) -> bytes:
    """A flight as ArduPilot's .bin; commands from 0 to 1 as 1000 to 2000 µs."""
    return b"".join(_dataflash(samples, parameters))


def _row(name: str, *values: object) -> bytes:
    number, codes, _ = _DATAFLASH[name]
    return b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(_CODES[c] for c in codes), *values)


def _dataflash(samples: Iterable[Sample], parameters: dict[str, float]) -> Iterator[bytes]:
    for name, (number, codes, columns) in _DATAFLASH.items():
        length = 3 + struct.calcsize("<" + "".join(_CODES[c] for c in codes))
        yield _row("FMT", number, length, name.encode(), codes.encode(), columns.encode())
    t_us = 0
    events = {"armed": False, "landed": True}
    for s in samples:
        if s.time_us is None:
            if t_us:
                yield from _unstamped(s, t_us, events)
            continue
        if not t_us:
            for name, value in parameters.items():
                yield _row("PARM", s.time_us, name.encode(), value)
            yield _row("MSG", s.time_us, b"ArduCopter V4.5.7 (1234abcd)")
            yield _row("MSG", s.time_us, b"CubeOrange 0036003C 3230510A 34303433")
        t_us = s.time_us
        yield from _stamped(s, t_us)


def _unstamped(s: Sample, t_us: int, events: dict[str, bool]) -> Iterator[bytes]:
    match s:
        case Heartbeat() if s.armed != events["armed"]:
            events["armed"] = s.armed
            yield _row("EV", t_us, 10 if s.armed else 11)
        case LandedState() if (s.landed_state == 1) != events["landed"]:
            events["landed"] = s.landed_state == 1
            yield _row("EV", t_us, 18 if s.landed_state == 1 else 28)
        case Battery(message=147):
            yield _row("BAT", t_us, 0, s.voltage, s.current)


def _stamped(s: Sample, t_us: int) -> Iterator[bytes]:
    match s:
        case Imu():
            yield _row("IMU", t_us, 0, s.p, s.q, s.r, s.ax, s.ay, s.az)
        case EscStatus():
            for k in range(4):  # a packet each, a little apart
                rpm = s.speed[k] / RPM
                yield _row("ESC", t_us + 40 * k, k, rpm, rpm, s.voltage[k], s.current[k], 2500)
        case Outputs(message=375):
            yield _row("RCOU", t_us, *(round(1000.0 + 1000.0 * v) for v in s.value[:4]))
        case Vibration():
            yield _row("VIBE", t_us, 0, s.x, s.y, s.z)
