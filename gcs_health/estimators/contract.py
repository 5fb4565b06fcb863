"""What every estimator promises, and the words it answers in.

An estimator is fed readings in arrival order and asked for estimates at any data time. It does no
I/O, reads no clock, holds plain values only (so that it pickles), and never raises on what it is fed.
"""

from collections.abc import Iterable
from enum import StrEnum
from typing import ClassVar, NamedTuple, Protocol

from gcs_health.samples import Reading


class Status(StrEnum):
    """How far a value can be trusted."""

    UNOBSERVABLE = "unobservable"
    CONVERGING = "converging"
    VALID = "valid"
    DIVERGED = "diverged"


class Quantity(StrEnum):
    """What an estimate is of."""

    EFFECTIVENESS = "effectiveness"  # [-], 1 healthy, 0 lost
    UNBALANCE = "unbalance"  # [kg m]
    UNBALANCE_RELATIVE = "unbalance_relative"  # [m], unbalance per vehicle mass, where the mass is not known
    DRAG = "drag"  # [-], 1 healthy
    DEGRADATION = "degradation"  # [-], 0 healthy


class Reason(StrEnum):
    """Why a value is not (yet) valid. `REASON_TEXT` has the sentence for the operator."""

    NO_IMU = "no_imu"
    NO_ROTOR_SPEEDS = "no_rotor_speeds"
    ROTOR_NOT_REPORTED = "rotor_not_reported"
    ROTOR_SPEEDS_INCOMPLETE = "rotor_speeds_incomplete"
    ROTOR_SPEED_STALE = "rotor_speed_stale"
    IMU_STALE = "imu_stale"
    RATE_TOO_LOW = "rate_too_low"
    AIRFRAME_UNKNOWN = "airframe_unknown"
    GEOMETRY_CONTRADICTED = "geometry_contradicted"
    ON_GROUND = "on_ground"
    ROTORS_BELOW_HOVER = "rotors_below_hover"
    CONTACT = "contact"
    SETTLING = "settling"
    EFFECTIVENESS_UNKNOWN = "effectiveness_unknown"
    MOTOR_STOPPED = "motor_stopped"
    ANOTHER_ROTOR_FAILED = "another_rotor_failed"
    LITTLE_EXCITATION = "little_excitation"
    NO_CURRENTS = "no_currents"
    CURRENT_STALE = "current_stale"
    CURRENT_SIDE_UNKNOWN = "current_side_unknown"
    CURRENT_OF_BATTERY = "current_of_battery"
    CURRENT_SIDE_CONTRADICTED = "current_side_contradicted"
    MOTOR_CONSTANTS_UNKNOWN = "motor_constants_unknown"
    MOTOR_NOT_DRIVEN = "motor_not_driven"
    NO_MODEL = "no_model"
    NO_HEALTHY_REFERENCE = "no_healthy_reference"
    LOAD_SHIFTED = "load_shifted"
    TRIM_UNCLEAR = "trim_unclear"
    NOT_IDENTIFIABLE = "not_identifiable"
    LINE_NOT_IN_TELEMETRY = "line_not_in_telemetry"
    NO_BASELINE = "no_baseline"
    MODEL_RATE = "model_rate"
    MODEL_FILTER = "model_filter"
    MODEL_SIGNAL = "model_signal"
    UNMODELLED = "unmodelled"
    UNSTEADY = "unsteady"
    VIBRATION_CHANGED = "vibration_changed"
    FILLING = "filling"
    NO_COMMANDS = "no_commands"
    SHARE_UNKNOWN = "share_unknown"
    OPPOSITE_ALIKE = "opposite_alike"


REASON_TEXT: dict[Reason, str] = {
    Reason.NO_IMU: "no accelerations and rates in the stream",
    Reason.NO_ROTOR_SPEEDS: "no rotor speeds in the stream",
    Reason.ROTOR_NOT_REPORTED: "this rotor's ESC has never reported",
    Reason.ROTOR_SPEEDS_INCOMPLETE: "another rotor's ESC has never reported: the motion cannot be predicted",
    Reason.ROTOR_SPEED_STALE: "the last rotor speed is too old",
    Reason.IMU_STALE: "the last accelerations and rates are too old",
    Reason.RATE_TOO_LOW: "the message rate is too low to see a fault in time",
    Reason.AIRFRAME_UNKNOWN: "where the rotors sit is not known",
    Reason.GEOMETRY_CONTRADICTED: "the rotors do not answer as the geometry says",
    Reason.ON_GROUND: "on the ground",
    Reason.ROTORS_BELOW_HOVER: "the rotors turn below hover speed",
    Reason.CONTACT: "something pushed the vehicle: ground, hand or obstacle",
    Reason.SETTLING: "the residuals' baseline is still settling",
    Reason.EFFECTIVENESS_UNKNOWN: "the control effectiveness is not yet identified",
    Reason.MOTOR_STOPPED: "the motor stands still: its effectiveness cannot be seen",
    Reason.ANOTHER_ROTOR_FAILED: "another rotor has failed",
    Reason.LITTLE_EXCITATION: "the rotor speeds hardly differ: the rotors cannot be told apart",
    Reason.NO_CURRENTS: "no motor currents in the stream",
    Reason.CURRENT_STALE: "the last motor current is too old",
    Reason.CURRENT_SIDE_UNKNOWN: "whether the currents are the motors' or the battery's cannot be told yet",
    Reason.CURRENT_OF_BATTERY: "the currents are the battery's: without torque constant, resistance and "
    "voltage the motors' cannot be told",
    Reason.CURRENT_SIDE_CONTRADICTED: "the currents are not on the side that the vehicle file says",
    Reason.MOTOR_CONSTANTS_UNKNOWN: "the motor's constants are not known",
    Reason.MOTOR_NOT_DRIVEN: "the motor is not driven: no current, and it runs down",
    Reason.NO_MODEL: "no model was trained for this vehicle",
    Reason.NO_HEALTHY_REFERENCE: "no commands of a healthy hover are known to compare with",
    Reason.LOAD_SHIFTED: "the hover commands changed as a shifted load changes them, not a damaged propeller",
    Reason.TRIM_UNCLEAR: "the hover commands changed, by a rotor or by a load: it cannot be told which",
    Reason.NOT_IDENTIFIABLE: "not identifiable: which rotor it is cannot be told",
    Reason.LINE_NOT_IN_TELEMETRY: "the rotor's vibration does not pass the filters before this telemetry",
    Reason.NO_BASELINE: "no healthy baseline of this configuration to compare with",
    Reason.MODEL_RATE: "the sensor's rate differs from the one that the model was trained at",
    Reason.MODEL_FILTER: "the sensor is filtered otherwise than when the model was trained",
    Reason.MODEL_SIGNAL: "the signal that the model was trained on does not come",
    Reason.UNMODELLED: "no trained model explains the vibration: other air, another vehicle or another fault",
    Reason.UNSTEADY: "the vibration is not steady enough to be measured",
    Reason.VIBRATION_CHANGED: "the vehicle vibrates otherwise than in its calibrated healthy flights: which rotor, "
    "if it is one, cannot be told from that",
    Reason.FILLING: "the window of samples is still filling, or has gaps",
    Reason.NO_COMMANDS: "without motor commands the speeds of so few rotors cannot show a slow one",
    Reason.SHARE_UNKNOWN: "this vehicle's own healthy rotor speeds are still being learned",
    Reason.OPPOSITE_ALIKE: "the opposite rotor would look the same: commands or the onset would tell",
}


class Estimate(NamedTuple):
    """One quantity of one rotor at one time.

    Attributes
    ----------
    t : vehicle clock [s].
    estimator : registry name, "effectiveness".
    rotor : index into the airframe's rotors.
    quantity : what is estimated; its unit is in `Quantity`.
    value, std : estimate and standard deviation; NaN where unobservable.
    failure_probability : that this rotor has failed, 0..1; NaN where unobservable.
    status, reasons : how far to trust it, and why not further.
    detectable : smallest fault of this kind [same unit as a change of value] that would be seen now
        at the stated false alarm rate; NaN where none would be.
    evidence : named figures behind a decision (log likelihood ratio, speed ratio ...), for the alert.
    """

    t: float
    estimator: str
    rotor: int
    quantity: Quantity
    value: float
    std: float
    failure_probability: float
    status: Status
    reasons: tuple[Reason, ...] = ()
    detectable: float = float("nan")
    evidence: tuple[tuple[str, float | str], ...] = ()


class Missing(NamedTuple):
    """What an estimator says without an input: `absent` when it never came, `stale` when it stopped."""

    absent: Reason
    stale: Reason


class Estimator(Protocol):
    """One published method, online. Made by `Type(airframe, Type.Config(mode=...))`.

    Attributes
    ----------
    name : in the registry.
    quantities : what it estimates of every rotor, in the order of `estimates`.
    takes : the kinds of reading that it wants; others are not fed to it.
    needs : those without which it cannot estimate, and what it says then.
    """

    name: str
    quantities: ClassVar[tuple[Quantity, ...]]
    takes: ClassVar[frozenset[type]]
    needs: ClassVar[dict[type, Missing]]

    def feed(self, reading: Reading) -> Iterable[Estimate]:
        """Take one reading; return estimates only where a decision about a rotor changed with it."""
        ...

    def estimates(self, t: float) -> list[Estimate]:
        """Return the present state, one estimate per rotor and quantity, at vehicle time `t` [s]."""
        ...

    def reset(self) -> None:
        """Forget all that was learned in flight; equal to a new instance."""
        ...
