"""Which sample each MAVLink message becomes, field by field: the one place that knows units.

Each row gives the sample type, the rule for its `time_us`, and one rule per further field of the type,
in its order. Source: MAVLink common.xml and ardupilotmega.xml; habits of autopilots are commented.
"""

import math
from typing import Any, NamedTuple

from gcs_health import samples as s
from gcs_health.mavlink.rules import (
    Computed,
    Constant,
    Integer,
    Rule,
    Si,
    SiArray,
    Text,
    Thousandfold,
    Together,
)

NAN = math.nan
NONE = Constant(None)
ZERO = Constant(0)
NO_VALUE = Constant(NAN)
RPM = math.pi / 30.0  # rad/s
MILLI_G = 9.80665e-3  # m/s²
UINT16_MAX, INT16_MAX = 65535, 32767

BOOT_US = Integer("time_usec")
BOOT_MS = Thousandfold("time_boot_ms")
# HIGHRES_IMU.fields_updated: a clear bit means that the value was not measured
ACC_BITS, GYRO_BITS = (1, 2, 4), (8, 16, 32)


class Row(NamedTuple):
    """One message: its sample type and how each field behind `receive_us` is read."""

    sample: Any
    rules: tuple[Rule, ...]


def _imu(time: Rule, sensor: Rule, temperature: Rule) -> Row:
    """RAW_IMU and SCALED_IMU*: mG and mrad/s. RAW_IMU has no unit by its definition, but ArduPilot, the
    only autopilot of note that sends it, sends it scaled.
    """
    acc = (Si("xacc", MILLI_G), Si("yacc", MILLI_G), Si("zacc", MILLI_G))
    gyro = (Si("xgyro", 1e-3), Si("ygyro", 1e-3), Si("zgyro", 1e-3))
    return Row(s.Imu, (time, *acc, *gyro, sensor, temperature))


_CENTI_DEGREES = Si("temperature", 0.01, absent=0)  # of the IMUs: 0 = not available


def _highres_imu() -> Row:
    acc = [Si(f"{axis}acc", when=("fields_updated", bit)) for axis, bit in zip("xyz", ACC_BITS, strict=True)]
    gyro = [Si(f"{axis}gyro", when=("fields_updated", b)) for axis, b in zip("xyz", GYRO_BITS, strict=True)]
    temperature = Si("temperature", when=("fields_updated", 4096))
    return Row(s.Imu, (BOOT_US, *acc, *gyro, Integer("id"), temperature))


def _esc_telemetry(index: int) -> Row:
    """Four servo output channels, 0-based `index` on."""
    return Row(
        s.EscTelemetry,
        (
            NONE,
            Constant(index),
            SiArray("rpm", RPM),
            SiArray("voltage", 0.01),
            SiArray("current", 0.01),
            SiArray("totalcurrent", 3.6),  # mAh → C
            Integer("count"),
            SiArray("temperature"),
        ),
    )


_SERVOS = tuple(f"servo{n}_raw" for n in range(1, 17))


def _servo_outputs(*values: int) -> tuple[float, ...]:
    """65535 is an unused channel; 9 to 16 are extension fields, whose 0 says nothing."""
    first = [NAN if v == UINT16_MAX else float(v) for v in values[:8]]
    more = [NAN if v in (0, UINT16_MAX) else float(v) for v in values[8:]]
    while more and math.isnan(more[-1]):
        more.pop()
    return tuple(first + more)


def _actuator_outputs(active: int, values: tuple[float, ...]) -> tuple[float, ...]:
    """`active` is a bit mask by its name and the count of outputs as PX4 fills it: take the longer reading
    of the two that the values bear out.
    """
    used = max((k + 1 for k, v in enumerate(values) if v), default=0)
    return values[: max(used, active if active <= len(values) else active.bit_length())]


def _cells(voltages: tuple[int, ...]) -> float:
    """Sum of the cells that are there [V]; ArduPilot puts a pack above 65 V into several cells likewise."""
    there = [v for v in voltages if v != UINT16_MAX]
    return sum(there) * 1e-3 if there else NAN


def _euler(q1: float, q2: float, q3: float, q4: float) -> tuple[float, float, float]:
    roll = math.atan2(2 * (q1 * q2 + q3 * q4), 1 - 2 * (q2 * q2 + q3 * q3))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (q1 * q3 - q4 * q2))))
    return roll, pitch, math.atan2(2 * (q1 * q4 + q2 * q3), 1 - 2 * (q3 * q3 + q4 * q4))


def _angle(k: int) -> Rule:
    def angle(*q: float) -> float:
        return _euler(*q)[k] if all(map(math.isfinite, q)) else NAN

    return Computed(("q1", "q2", "q3", "q4"), angle)


def _bits(value: float) -> int:
    """The float's own 32 bits as an integer: how PX4 sends INT32 parameters."""
    import struct

    return int(struct.unpack("<i", struct.pack("<f", value))[0])


_PERCENT = Si("battery_remaining", 0.01, absent=-1)
_CENTI_AMPERES = Si("current_battery", 0.01, absent=-1)

TABLE: dict[int, Row] = {
    0: Row(
        s.Heartbeat,
        (
            NONE,
            Integer("type"),
            Integer("autopilot"),
            Integer("base_mode"),
            Integer("custom_mode"),
            Integer("system_status"),
        ),
    ),
    1: Row(
        s.Battery,
        (NONE, ZERO, Si("voltage_battery", 1e-3, absent=UINT16_MAX), _CENTI_AMPERES, _PERCENT, NO_VALUE),
    ),
    2: Row(s.SystemTime, (BOOT_MS, Computed(("time_unix_usec",), lambda us: us or None))),
    22: Row(
        s.Parameter,
        (
            NONE,
            Text("param_id"),
            Si("param_value"),
            Computed(("param_value",), _bits),
            Integer("param_type"),
            Integer("param_index"),
            Integer("param_count"),
        ),
    ),
    26: _imu(BOOT_MS, ZERO, _CENTI_DEGREES),
    116: _imu(BOOT_MS, Constant(1), _CENTI_DEGREES),
    129: _imu(BOOT_MS, Constant(2), _CENTI_DEGREES),
    27: _imu(BOOT_US, Integer("id"), _CENTI_DEGREES),
    30: Row(
        s.Attitude,
        (
            BOOT_MS,
            Si("roll"),
            Si("pitch"),
            Si("yaw"),
            Si("rollspeed"),
            Si("pitchspeed"),
            Si("yawspeed"),
        ),
    ),
    31: Row(
        s.Attitude,
        (
            BOOT_MS,
            _angle(0),
            _angle(1),
            _angle(2),
            Si("rollspeed"),
            Si("pitchspeed"),
            Si("yawspeed"),
        ),
    ),
    36: Row(s.Outputs, (BOOT_US, Integer("port"), Computed(_SERVOS, _servo_outputs))),
    83: Row(
        s.AttitudeTarget,
        (
            BOOT_MS,
            SiArray("q"),
            Si("body_roll_rate"),
            Si("body_pitch_rate"),
            Si("body_yaw_rate"),
            Si("thrust"),
            Integer("type_mask"),
        ),
    ),
    105: _highres_imu(),
    140: Row(s.Outputs, (BOOT_US, Integer("group_mlx"), SiArray("controls"))),
    147: Row(
        s.Battery,
        (
            NONE,
            Integer("id"),
            Computed(("voltages",), _cells),
            _CENTI_AMPERES,
            _PERCENT,
            Si("temperature", 0.01, absent=INT16_MAX),
        ),
    ),
    226: Row(s.RotorRpm, (NONE, ZERO, Together((Si("rpm1", RPM), Si("rpm2", RPM))))),
    241: Row(
        s.Vibration,
        (
            BOOT_US,
            Si("vibration_x"),
            Si("vibration_y"),
            Si("vibration_z"),
            Together((Integer("clipping_0"), Integer("clipping_1"), Integer("clipping_2"))),
        ),
    ),
    245: Row(s.LandedState, (NONE, Integer("landed_state"), Integer("vtol_state"))),
    253: Row(s.StatusText, (NONE, Integer("severity"), Text("text"), Integer("id"), Integer("chunk_seq"))),
    290: Row(
        s.EscInfo,
        (
            BOOT_US,
            Integer("index"),
            Integer("count"),
            Integer("counter"),
            Integer("connection_type"),
            Integer("info"),
            Integer("failure_flags"),
            Integer("error_count"),
            # the oldest PX4 sends whole degrees here; no ESC works at 0.2 to 1.2 °C, so the reader can tell
            SiArray("temperature", 0.01, absent=INT16_MAX),
        ),
    ),
    291: Row(
        s.EscStatus,
        (BOOT_US, Integer("index"), SiArray("rpm", RPM), SiArray("voltage"), SiArray("current")),
    ),
    339: Row(s.RotorRpm, (NONE, Integer("index"), Together((Si("frequency", RPM),)))),
    375: Row(s.Outputs, (BOOT_US, ZERO, Computed(("active", "actuator"), _actuator_outputs))),
}
TABLE.update(
    {
        message: _esc_telemetry(4 * k)
        for k, message in enumerate((11030, 11031, 11032, 11040, 11041, 11042, 11043, 11044))
    }
)

# Known by name and field, of interest to `info` and to whoever reads a log, but no estimator's input
OTHERS = (20, 21, 23, 66, 75, 76, 77, 111, 148, 244, 292, 410)
