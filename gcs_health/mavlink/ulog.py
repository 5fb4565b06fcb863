"""PX4's .ulg as the .tlog that the vehicle would have streamed; read by pyulog.

topic                                message
sensor_combined, else vehicle_imu    HIGHRES_IMU       a mean over the IMU_INTEG_RATE interval, as that message has
esc_status                           ESC_STATUS, ESC_INFO    slot = motor - 1 where the topic names the motor
actuator_motors, else actuator_outputs    ACTUATOR_OUTPUT_STATUS    in order of the output channels
vehicle_status                       HEARTBEAT
vehicle_land_detected                EXTENDED_SYS_STATE
battery_status                       BATTERY_STATUS
parameters, logged text              PARAM_VALUE (bits of an int32), STATUSTEXT
sys_uuid                             AUTOPILOT_VERSION

Times are microseconds since boot, in the log as on the wire. Only these topics are loaded: memory grows with
them (some 60 bytes an IMU sample), not with the file.
"""

import struct
from typing import Any, BinaryIO

import numpy as np

from gcs_health.airframe_parameters import AirframeParameters
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
from gcs_health.samples import Parameter

MAGIC = b"ULog\x01\x12\x35"
TOPICS = (
    "sensor_combined",
    "vehicle_imu",
    "esc_status",
    "actuator_motors",
    "actuator_outputs",
    "vehicle_status",
    "vehicle_land_detected",
    "battery_status",
    "vehicle_gps_position",
)
PX4, QUADROTOR = 12, 2  # MAV_AUTOPILOT, MAV_TYPE
ARMED = 2  # vehicle_status.arming_state
MOTOR_1 = 101  # esc_status.actuator_function of the first motor
ESCS, OUTPUTS = 8, 16  # of esc_status, of actuator_outputs
INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE
ESC_INFO_EVERY = 0.1  # s

Topic = dict[str, np.ndarray[Any, Any]]


def open_ulog(name: str, file: BinaryIO) -> BinaryIO:
    """Return a .ulg as a file of .tlog records.

    Raises
    ------
    LogError : pyulog is not installed or cannot read it, or it holds nothing that we know.
    """
    try:
        from pyulog import ULog
    except ModuleNotFoundError:
        raise LogError(f"{name}: a .ulg needs pyulog: pip install 'gcs-health[ulog]'") from None
    try:
        log = ULog(file, list(TOPICS))
    except Exception as error:  # pyulog raises whatever damaged bytes lead to
        raise LogError(f"{name}: pyulog cannot read this ULog: {error}") from None
    finally:
        file.close()
    topics = {
        topic: [d.data for d in log.data_list if d.name == topic and len(d.data["timestamp"])]
        for topic in TOPICS
    }
    imus = _imus(topics)
    if not imus and not topics["esc_status"]:
        raise LogError(f"{name}: neither sensor_combined, vehicle_imu nor esc_status in this ULog")
    told, channels = _parameters(log)
    span = np.concatenate([s.t_us for s in imus] or [topics["esc_status"][0]["timestamp"]]).astype(np.int64)
    streams = [
        heartbeats(span, *_kind(topics, log), _changes(topics["vehicle_status"], "arming_state", ARMED)),
        *hardware(int(span.min()), _uid(log.msg_info_dict.get("sys_uuid", ""))),
        told,
        *_landed(topics, span),
        *imus,
        *(s for topic in topics["esc_status"][:1] for s in _escs(topic)),
        *_outputs(topics, channels),
        *(_battery(topic, k) for k, topic in enumerate(topics["battery_status"])),
        texts([(m.timestamp, _severity(m.log_level), m.message) for m in log.logged_messages]),
    ]
    return as_tlog(streams, _boot_unix_us(topics))


def _imus(topics: dict[str, list[Topic]]) -> list[Stream]:
    if topics["sensor_combined"]:
        data = topics["sensor_combined"][0]
        return [_imu(data["timestamp"], _axes(data, "accelerometer_m_s2"), _axes(data, "gyro_rad"), 0)]
    out = []
    for sensor, data in enumerate(topics["vehicle_imu"]):
        dt = [1e-6 * np.maximum(data[f"{what}_dt"], 1) for what in ("delta_velocity", "delta_angle")]
        out.append(
            _imu(
                data["timestamp"],
                _axes(data, "delta_velocity") / dt[0][:, None],
                _axes(data, "delta_angle") / dt[1][:, None],
                sensor,
            )
        )
    return out


def _imu(t_us: Any, acc: Any, gyro: Any, sensor: int) -> Stream:
    axes = {f"{axis}acc": acc[:, k] for k, axis in enumerate("xyz")}
    axes |= {f"{axis}gyro": gyro[:, k] for k, axis in enumerate("xyz")}
    return stream("HIGHRES_IMU", t_us, time_usec=t_us, fields_updated=0x3F, id=sensor, **axes)


def _axes(data: Topic, name: str) -> np.ndarray[Any, Any]:
    return np.stack([data[f"{name}[{k}]"] for k in range(3)], axis=1)


def _escs(data: Topic) -> list[Stream]:
    """ESC_STATUS at the topic's rate, ESC_INFO ten times a second."""
    t_us = data["timestamp"]
    count = int(data["esc_count"].max())
    there = [k for k in range(ESCS) if f"esc[{k}].esc_rpm" in data]
    slot_of = {}
    for k in there[: max(count, 1)]:
        function = data.get(f"esc[{k}].actuator_function")
        named = int(function[-1]) - MOTOR_1 if function is not None else -1
        slot_of[k] = named if 0 <= named < 12 else k
    if len(set(slot_of.values())) < len(slot_of):  # two of one name: the order is all there is
        slot_of = {k: k for k in slot_of}
    shape = (len(t_us), 12)
    rpm, volts, amps, flags = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    online = np.zeros(len(t_us), np.int64)
    heat = np.full(shape, 32767.0)
    for k, slot in slot_of.items():
        rpm[:, slot] = data[f"esc[{k}].esc_rpm"]
        volts[:, slot] = data[f"esc[{k}].esc_voltage"]
        amps[:, slot] = data[f"esc[{k}].esc_current"]
        flags[:, slot] = data.get(f"esc[{k}].failures", 0)
        if f"esc[{k}].esc_temperature" in data:
            celsius = data[f"esc[{k}].esc_temperature"].astype(float)
            heat[:, slot] = np.where(np.isfinite(celsius), np.clip(celsius * 100.0, -32768, 32766), 32767)
        online |= (data["esc_online_flags"].astype(np.int64) >> k & 1) << slot
    due = _thinned(t_us, ESC_INFO_EVERY)
    out = []
    for first in range(0, max(slot_of.values(), default=0) + 1, 4):
        four = slice(first, first + 4)
        out.append(
            stream(
                "ESC_STATUS",
                t_us,
                time_usec=t_us,
                index=first,
                rpm=rpm[:, four],
                voltage=volts[:, four],
                current=amps[:, four],
            )
        )
        out.append(
            stream(
                "ESC_INFO",
                t_us[due],
                time_usec=t_us[due],
                index=first,
                count=max(count, len(slot_of)),
                info=(online[due] >> first) & 0xF,
                failure_flags=flags[due, four],
                temperature=heat[due, four],
            )
        )
    return out


def _thinned(t_us: Any, every: float) -> np.ndarray[Any, Any]:
    """Return which rows to keep so that one comes about each `every` seconds."""
    return np.flatnonzero(np.diff(t_us.astype(np.int64) // round(every * 1e6), prepend=-1))


def _outputs(topics: dict[str, list[Topic]], channels: dict[int, int]) -> list[Stream]:
    """Commands; those by motor number go to the channel that the parameters give the motor."""
    if topics["actuator_motors"]:
        data = topics["actuator_motors"][0]
        values = np.zeros((len(data["timestamp"]), 32))
        for motor in range(1, 13):
            control = data.get(f"control[{motor - 1}]")
            if control is not None:
                values[:, channels.get(motor, motor - 1)] = np.nan_to_num(control)
    elif topics["actuator_outputs"]:
        data = topics["actuator_outputs"][0]
        values = np.stack([data[f"output[{k}]"] for k in range(OUTPUTS) if f"output[{k}]" in data], axis=1)
    else:
        return []
    t_us = data["timestamp"]
    active = int(np.flatnonzero(values.any(axis=0)).max(initial=-1)) + 1
    return [stream("ACTUATOR_OUTPUT_STATUS", t_us, time_usec=t_us, active=active, actuator=values)]


def _battery(data: Topic, number: int) -> Stream:
    cells = np.full((len(data["timestamp"]), 10), 65535)
    cells[:, 0] = np.clip(np.nan_to_num(data["voltage_v"]) * 1e3, 0, 65534)
    amps, left = data["current_a"], data["remaining"]
    return stream(
        "BATTERY_STATUS",
        data["timestamp"],
        id=number,
        voltages=cells,
        current_battery=np.where(amps >= 0, np.clip(amps * 100.0, 0, 32767), -1),
        battery_remaining=np.where(left >= 0, np.clip(left * 100.0, 0, 100), -1),
        temperature=32767,
    )


def _changes(found: list[Topic], field: str, value: int) -> list[tuple[int, bool]]:
    """Return when `field` became `value` or ceased to be it; without the topic a log was made in flight."""
    if not found or field not in found[0]:
        return [(0, value == ARMED)]
    states = found[0][field] == value
    at = np.flatnonzero(np.diff(states.astype(np.int8), prepend=2))
    return [(int(found[0]["timestamp"][k]), bool(states[k])) for k in at]


def _landed(topics: dict[str, list[Topic]], span: Any) -> list[Stream]:
    found = topics["vehicle_land_detected"]
    return [landed_states(span, _changes(found, "landed", 1))] if found else []


def _kind(topics: dict[str, list[Topic]], log: Any) -> tuple[int, int]:
    """Return MAV_TYPE and MAV_AUTOPILOT."""
    for status in topics["vehicle_status"]:
        if "system_type" in status and status["system_type"][-1]:
            return int(status["system_type"][-1]), PX4
    return int(log.initial_parameters.get("MAV_TYPE", QUADROTOR)), PX4


def _parameters(log: Any) -> tuple[Stream, dict[int, int]]:
    """Return PARAM_VALUE of what was set at the start and what changed; and each motor's output channel."""
    said = [(log.start_timestamp, name, value) for name, value in sorted(log.initial_parameters.items())]
    said += log.changed_parameters
    times, names, values, kinds = [], [], [], []
    geometry = AirframeParameters()
    for t_us, name, value in said:
        integer = isinstance(value, int | np.integer)
        bits = int(value) if integer else 0
        times.append(t_us)
        names.append(name)
        values.append(struct.pack("<i", bits) if integer else struct.pack("<f", value))
        kinds.append(INT32 if integer else REAL32)
        geometry.feed(Parameter(1, 1, 22, 0, None, name, float(value), bits, kinds[-1], 0, 0))
    wire = np.frombuffer(b"".join(values), "<f4")
    return parameters(times, names, wire, kinds), geometry.output_channels()


def _uid(text: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError:
        return b""


def _severity(level: int) -> int:
    return min(max(level - ord("0"), 0), 7)


def _boot_unix_us(topics: dict[str, list[Topic]]) -> int:
    """Return the UNIX time of boot as the first satellite fix tells it; 0 without one."""
    for data in topics["vehicle_gps_position"]:
        utc = data.get("time_utc_usec", np.zeros(0))
        known = np.flatnonzero(utc)
        if len(known):
            return int(utc[known[0]]) - int(data["timestamp"][known[0]])
    return 0
