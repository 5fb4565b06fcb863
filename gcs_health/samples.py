"""Samples: what was measured, when, in SI. The vocabulary between the wire and the estimators.

Two families, both frozen:

*Samples* are what a MAVLink message said (`mavlink/messages.py` makes them). All start with the
same head:

``system, component``   who sent it
``message``             MAVLink message id it came from (tells HIGHRES_IMU from SCALED_IMU2)
``receive_us``          arrival stamp, UNIX µs: the log record's or the datagram's
``time_us``             the vehicle's own stamp in µs as sent (not unwrapped, boot or UNIX),
                        None where the message carries none

*Readings* are what an estimator sees: one time axis (``t``, seconds, made by `clock.py`), rotors in
the airframe's order (made by `rotor_telemetry.py`).

Units are SI: rad/s, m/s², A, V; temperatures are degrees Celsius and say so. An absent float is NaN,
an absent integer None: never 0, never MAVLink's sentinel.

NamedTuples rather than dataclasses: a log holds millions, and a frozen dataclass costs some four
times as much to make (`benchmarks/decode.py`).
"""

from typing import NamedTuple

Four = tuple[float, float, float, float]

# makes one of all its fields, new_tuple(ImuReading, (t, ax, ...)), in half the time of ImuReading(t, ax, ...)
new_tuple = tuple.__new__


class Heartbeat(NamedTuple):
    """HEARTBEAT: who speaks, what it is, in which mode."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    vehicle_type: int  # MAV_TYPE
    autopilot: int  # MAV_AUTOPILOT
    base_mode: int
    custom_mode: int
    system_status: int

    @property
    def armed(self) -> bool:
        """Whether MAV_MODE_FLAG_SAFETY_ARMED is set."""
        return bool(self.base_mode & 128)


class Imu(NamedTuple):
    """HIGHRES_IMU, SCALED_IMU, SCALED_IMU2, SCALED_IMU3 or RAW_IMU in forward-right-down axes."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    ax: float  # specific force [m/s²]; level rest reads az = -9.81
    ay: float
    az: float
    p: float  # body rates [rad/s]
    q: float
    r: float
    sensor: int  # which IMU: `id` of HIGHRES_IMU and RAW_IMU; 0, 1, 2 for SCALED_IMU, 2, 3
    temperature_degc: float


class EscStatus(NamedTuple):
    """ESC_STATUS (PX4): four ESCs from slot `index` on. Zeros are kept: their meaning is not the wire's."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    index: int
    speed: Four  # [rad/s], negative = reverse
    voltage: Four  # [V]
    current: Four  # [A]


class EscInfo(NamedTuple):
    """ESC_INFO (PX4): slow facts of four ESCs from slot `index` on."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    index: int
    count: int
    counter: int
    connection_type: int
    online: int  # bit mask, `info` of the message
    failure_flags: tuple[int, int, int, int]
    error_count: tuple[int, int, int, int]
    temperature_degc: Four


class EscTelemetry(NamedTuple):
    """ESC_TELEMETRY_1_TO_4 … 29_TO_32 (ArduPilot): four servo channels from `index` on."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    index: int  # 0-based
    speed: Four  # [rad/s]
    voltage: Four  # [V]
    current: Four  # [A]
    consumed: Four  # [C]
    count: tuple[int, int, int, int]  # packets, u16, wraps
    temperature_degc: Four


class RotorRpm(NamedTuple):
    """RAW_RPM (one sensor) or RPM (ArduPilot's two): rotor speed sensors that are not ESCs."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    index: int
    speed: tuple[float, ...]  # [rad/s]


class Outputs(NamedTuple):
    """SERVO_OUTPUT_RAW, ACTUATOR_OUTPUT_STATUS or ACTUATOR_CONTROL_TARGET: outputs as commanded.

    `value` is in the message's own unit (PWM µs, DShot, UAVCAN raw, 0..1): the wire does not say
    which; `rotor_telemetry.py` decides. An unused channel is NaN.
    """

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    port: int  # `port` of SERVO_OUTPUT_RAW, `group_mlx` of ACTUATOR_CONTROL_TARGET, else 0
    value: tuple[float, ...]


class Attitude(NamedTuple):
    """ATTITUDE or ATTITUDE_QUATERNION."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    roll: float  # [rad]
    pitch: float
    yaw: float
    p: float  # [rad/s]
    q: float
    r: float


class AttitudeTarget(NamedTuple):
    """ATTITUDE_TARGET."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    quaternion: Four
    p: float  # [rad/s]
    q: float
    r: float
    thrust: float  # [-] 0..1
    type_mask: int


class Battery(NamedTuple):
    """BATTERY_STATUS, or the battery part of SYS_STATUS."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    battery: int
    voltage: float  # [V]
    current: float  # [A]
    remaining: float  # [-] 0..1
    temperature_degc: float


class Vibration(NamedTuple):
    """VIBRATION."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    x: float  # [m/s²]
    y: float
    z: float
    clipping: tuple[int, int, int]


class LandedState(NamedTuple):
    """EXTENDED_SYS_STATE."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    landed_state: int  # MAV_LANDED_STATE
    vtol_state: int


class StatusText(NamedTuple):
    """STATUSTEXT, one chunk."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    severity: int  # MAV_SEVERITY
    text: str
    chunk_of: int  # `id`: 0 = not chunked
    chunk: int


class Parameter(NamedTuple):
    """PARAM_VALUE. `value` is as cast by ArduPilot; `bits` the same four bytes as PX4 means them."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    name: str
    value: float
    bits: int  # the float's bits as int32: PX4's INT32 value
    kind: int  # MAV_PARAM_TYPE
    index: int
    count: int

    @property
    def number(self) -> float:
        """The value whichever way it was put into the float: bits of an int32 (PX4), or cast (ArduPilot).

        A whole number that was cast has bits far above 2**24, one whose bits were copied far below.
        """
        return float(self.bits) if self.kind == 6 and abs(self.bits) < 1 << 24 else self.value


class SystemTime(NamedTuple):
    """SYSTEM_TIME: pairs UNIX and boot time."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    unix_us: int | None  # None until the vehicle knows it


class Other(NamedTuple):
    """Any further known message, fields by MAVLink name and unit: shown, counted, not estimated from."""

    system: int
    component: int
    message: int
    receive_us: int
    time_us: int | None
    name: str
    fields: dict[str, object]


Sample = (
    Heartbeat
    | Imu
    | EscStatus
    | EscInfo
    | EscTelemetry
    | RotorRpm
    | Outputs
    | Attitude
    | AttitudeTarget
    | Battery
    | Vibration
    | LandedState
    | StatusText
    | Parameter
    | SystemTime
    | Other
)


class ImuReading(NamedTuple):
    """Specific force [m/s²] and body rates [rad/s] in forward-right-down axes at time `t` [s]."""

    t: float
    ax: float
    ay: float
    az: float
    p: float
    q: float
    r: float


class BoomReading(NamedTuple):
    """Specific force at the booms' tips, downward [m/s²], in the airframe's rotor order; NaN = no sensor."""

    t: float
    az: tuple[float, ...]


class RotorReading(NamedTuple):
    """Speeds [rad/s, ≥ 0] in the airframe's rotor order; NaN = nothing new of this rotor in this reading.

    `current` [A] and `voltage` [V] likewise; NaN where the ESC gives none.
    """

    t: float
    speed: tuple[float, ...]
    current: tuple[float, ...]
    voltage: tuple[float, ...]


class CommandReading(NamedTuple):
    """Motor commands [-], 0 = off, 1 = full, in the airframe's rotor order; NaN = not known."""

    t: float
    command: tuple[float, ...]


class FlightReading(NamedTuple):
    """What the autopilot says of the flight; None = it has not said."""

    t: float
    armed: bool | None
    landed: bool | None

    @property
    def flies(self) -> bool:
        """Whether the vehicle flies, as far as the autopilot says."""
        return self.armed is not False and self.landed is not True


class ImuFilterReading(NamedTuple):
    """What the accelerations of the `ImuReading`s have passed on board; said when known and when it changes.

    Attributes
    ----------
    mean_over : each value is a mean over so long [s]; NaN = it is not.
    cutoff : of a two-pole low-pass [Hz]; NaN = there is none.
    source : who says so: a parameter, its default, or nobody.
    """

    t: float
    mean_over: float
    cutoff: float
    source: str


class BatteryReading(NamedTuple):
    """Voltage [V] and current [A] at the battery; NaN = not known."""

    t: float
    voltage: float
    current: float


class VibrationReading(NamedTuple):
    """The autopilot's own vibration levels [m/s²] about its body axes."""

    t: float
    x: float
    y: float
    z: float


Reading = (
    ImuReading
    | BoomReading
    | RotorReading
    | CommandReading
    | FlightReading
    | ImuFilterReading
    | BatteryReading
    | VibrationReading
)
