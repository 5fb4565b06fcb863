"""ArduPilot's .bin as the .tlog that the vehicle would have streamed; indexed by pymavlink's DFReader.

message in the log      MAVLink message
IMU (IMU2, IMU3)        HIGHRES_IMU          floats, as filtered by INS_ACCEL_FILTER and INS_GYRO_FILTER
ESC (ESC1 to ESC8)      ESC_TELEMETRY_x      four at a time; speeds in whole rpm, volts and amperes in hundredths
RPM                     RPM
RCOU                    SERVO_OUTPUT_RAW
EV                      HEARTBEAT, EXTENDED_SYS_STATE
BAT, VIBE               BATTERY_STATUS, VIBRATION
PARM, MSG               PARAM_VALUE, STATUSTEXT; AUTOPILOT_VERSION of the board's id, which it logs as text

DFReader finds where each message lies and what its fields are; they are read by columns from there, since
message by message (`recv_match`) takes some 30 µs each.
"""

import contextlib
import io
import re
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from gcs_health.errors import LogError
from gcs_health.mavlink.transcode import (
    Stream,
    as_tlog,
    hardware,
    heartbeats,
    landed_states,
    parameters,
    stream,
    texts,
)

MAGIC = b"\xa3\x95\x80"  # a record of type FMT comes first
ARDUPILOT = 3  # MAV_AUTOPILOT
MAV_TYPES = {1: 2, 2: 13, 3: 14, 4: 14, 5: 13, 7: 15, 12: 29}  # of FRAME_CLASS
QUADROTOR = 2
EV_ARMED, EV_DISARMED, EV_LANDED, EV_FLYING = 10, 11, 18, 28  # AP_Logger.h, LogEvent
REAL32 = 9  # MAV_PARAM_TYPE
INFO = 6  # MAV_SEVERITY
SAME_ROUND_US = 2000  # ESCs that the autopilot writes within so long are told together
GROUPS = ("1_TO_4", "5_TO_8", "9_TO_12")
_BOARD = re.compile(r"^\S+ ([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})$")
HEAD = 3  # bytes before a record's fields

Table = dict[str, np.ndarray[Any, Any]]


def open_dataflash(name: str, path: Path) -> BinaryIO:
    """Return a .bin as a file of .tlog records.

    Raises
    ------
    LogError : it cannot be read, or holds nothing that we know.
    """
    from pymavlink.DFReader import DFReader_binary

    noise = io.StringIO()  # of damaged places, which it skips
    try:
        with contextlib.redirect_stderr(noise), contextlib.redirect_stdout(noise):
            log = DFReader_binary(str(path))
    except Exception as error:  # DFReader raises whatever damaged bytes lead to
        raise LogError(f"{name}: DFReader cannot read this DataFlash log: {error}") from None
    try:
        return _as_tlog(name, log)
    finally:
        log.filehandle.close()


def _as_tlog(name: str, log: Any) -> BinaryIO:
    imus, escs = _imus(log), _escs(log)
    if not imus and not escs:
        raise LogError(f"{name}: neither IMU nor ESC with TimeUS in this DataFlash log")
    span = np.concatenate([each.t_us for each in imus or escs])
    told, values = _parameters(log, int(span.min()))
    events = _table(log, "EV")
    armed = _changes(events, EV_ARMED, EV_DISARMED)
    landed = _changes(events, EV_LANDED, EV_FLYING)
    kind = MAV_TYPES.get(int(values.get("FRAME_CLASS", 0)), QUADROTOR)
    streams = [
        # without a word of it the log was made in flight: ArduPilot writes none on the ground unless told to
        heartbeats(span, kind, ARDUPILOT, armed or [(0, True)]),
        *hardware(int(span.min()), _uid(log)),
        *told,
        *([landed_states(span, landed)] if landed else []),
        *imus,
        *escs,
        *_others(log),
    ]
    return as_tlog(streams, round(1e6 * getattr(log.clock, "timebase", 0.0)))


def _table(log: Any, name: str) -> Table:
    """Return all records of one message as columns in the log's units; empty if there are none."""
    kind = log.name_to_id.get(name)
    offsets = np.array(log.offsets[kind] if kind is not None else [], np.intp)
    if not len(offsets):
        return {}
    fmt = log.formats[kind]
    dtype = np.dtype([(column, _numpy(c)) for column, c in zip(fmt.columns, fmt.format, strict=True)])
    size = HEAD + dtype.itemsize
    data = np.frombuffer(log.data_map, np.uint8)
    offsets = offsets[offsets + size <= len(data)]
    rows = data[offsets[:, None] + np.arange(HEAD, size)].copy().view(dtype)[:, 0]
    return {
        column: rows[column] if mult is None else rows[column] * float(mult)
        for column, mult in zip(fmt.columns, fmt.msg_mults, strict=True)
    }


def _numpy(code: str) -> str:
    """Return the numpy type of a format character (AP_Logger's LogStructure.h)."""
    known = {
        "a": "(32,)<i2",
        "b": "i1",
        "B": "u1",
        "M": "u1",
        "g": "<f2",
        "h": "<i2",
        "c": "<i2",
        "H": "<u2",
        "C": "<u2",
        "i": "<i4",
        "L": "<i4",
        "e": "<i4",
        "I": "<u4",
        "E": "<u4",
        "f": "<f4",
        "d": "<f8",
        "q": "<i8",
        "Q": "<u8",
        "n": "S4",
        "N": "S16",
        "Z": "S64",
    }
    return known[code]


def _imus(log: Any) -> list[Stream]:
    out = []
    for first, name in enumerate(("IMU", "IMU2", "IMU3")):
        data = _table(log, name)
        if "TimeUS" not in data:
            continue
        t_us = data["TimeUS"]
        fields = {f"{axis}acc": data[f"Acc{axis.upper()}"] for axis in "xyz"}
        fields |= {f"{axis}gyro": data[f"Gyr{axis.upper()}"] for axis in "xyz"}
        sensor = data.get("I", np.full(len(t_us), first))
        out.append(stream("HIGHRES_IMU", t_us, time_usec=t_us, fields_updated=0x3F, id=sensor, **fields))
    return out


def _escs(log: Any) -> list[Stream]:
    """Rounds of ESC records as ESC_TELEMETRY: each round holds the latest of four, and how many came of each."""
    together = _table(log, "ESC")
    each: dict[int, Table] = {}
    if "Instance" in together:
        for k in np.unique(together["Instance"]):
            mine = together["Instance"] == k
            each[int(k)] = {name: column[mine] for name, column in together.items()}
    else:
        found = {k: _table(log, f"ESC{k + 1}") for k in range(8)}
        each = {k: data for k, data in found.items() if "TimeUS" in data}
    out = []
    for group, name in enumerate(GROUPS):
        members = {k - 4 * group: data for k, data in each.items() if k // 4 == group}
        if not members:
            continue
        t_us = np.sort(np.concatenate([data["TimeUS"] for data in members.values()])).astype(np.int64)
        t_us = t_us[np.append(np.diff(t_us) > SAME_ROUND_US, True)]  # the last of each round
        fields = {
            what: np.zeros((len(t_us), 4)) for what in ("rpm", "voltage", "current", "count", "temperature")
        }
        for slot, data in members.items():
            latest = np.searchsorted(data["TimeUS"], t_us, side="right")
            row = np.maximum(latest - 1, 0)
            there = latest > 0
            fields["count"][:, slot] = latest & 0xFFFF
            for what, column, scale, top in _ESC_FIELDS:
                if column in data:
                    value = np.nan_to_num(data[column][row].astype(float)) * scale
                    fields[what][:, slot] = np.where(there, np.clip(np.rint(value), 0, top), 0)
        out.append(stream(f"ESC_TELEMETRY_{name}", t_us, **fields))
    return out


_ESC_FIELDS = (
    ("rpm", "RPM", 1.0, 65535),
    ("voltage", "Volt", 100.0, 65535),
    ("current", "Curr", 100.0, 65535),
    ("temperature", "Temp", 1.0, 255),
)


def _others(log: Any) -> list[Stream]:
    """Outputs, rotor speed sensors, battery, vibration, words."""
    out = []
    if "TimeUS" in (data := _table(log, "RCOU")):
        servos = {f"servo{n}_raw": data[f"C{n}"] for n in range(1, 17) if f"C{n}" in data}
        out.append(
            stream("SERVO_OUTPUT_RAW", data["TimeUS"], time_usec=data["TimeUS"] & 0xFFFFFFFF, **servos)
        )
    if "rpm2" in (data := _table(log, "RPM")):
        out.append(stream("RPM", data["TimeUS"], rpm1=data["rpm1"], rpm2=data["rpm2"]))
    if "Volt" in (data := _table(log, "BAT")):
        cells = np.full((len(data["Volt"]), 10), 65535)
        cells[:, 0] = np.clip(np.nan_to_num(data["Volt"]) * 1e3, 0, 65534)
        amps = np.clip(np.nan_to_num(data["Curr"], nan=-0.01) * 100.0, -1, 32767)
        number = data.get("Inst", data.get("Instance", 0))
        fields = {"id": number, "voltages": cells, "current_battery": amps, "temperature": 32767}
        out.append(stream("BATTERY_STATUS", data["TimeUS"], battery_remaining=-1, **fields))
    if "VibeX" in (data := _table(log, "VIBE")):
        first = data["IMU"] == 0 if "IMU" in data else slice(None)
        axes = {f"vibration_{axis}": data[f"Vibe{axis.upper()}"][first] for axis in "xyz"}
        out.append(stream("VIBRATION", data["TimeUS"][first], time_usec=data["TimeUS"][first], **axes))
    if "Message" in (data := _table(log, "MSG")):
        said = zip(data["TimeUS"].tolist(), data["Message"].tolist(), strict=True)
        out.append(texts([(t, INFO, text.decode("utf-8", "replace")) for t, text in said]))
    return out


def _uid(log: Any) -> bytes:
    """Return the board's id, three words behind its name, as in "CubeOrange 0036003C 3230510A 34303433"."""
    for text in _table(log, "MSG").get("Message", ()):
        found = _BOARD.search(text.decode("ascii", "replace"))
        if found:
            return bytes.fromhex(found[1].replace(" ", ""))
    return b""


def _changes(events: Table, on: int, off: int) -> list[tuple[int, bool]]:
    if "Id" not in events:
        return []
    pairs = zip(events["TimeUS"].tolist(), events["Id"].tolist(), strict=True)
    return [(t, id == on) for t, id in pairs if id in (on, off)]


def _parameters(log: Any, start_us: int) -> tuple[list[Stream], dict[str, float]]:
    """Return PARAM_VALUE, cast to floats as ArduPilot sends them, and the values by name."""
    data = _table(log, "PARM")
    if not data:
        return [], {}
    names = [name.decode("ascii", "replace") for name in data["Name"].tolist()]
    times = data.get("TimeUS", np.full(len(names), start_us))
    values = data["Value"].astype(np.float32)
    return [parameters(times, names, values, REAL32)], dict(zip(names, values.tolist(), strict=True))
