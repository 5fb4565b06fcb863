"""What an estimator needs of the stream, and the parameter or command that would give it.

One table an autopilot; parameter names, message ids and intervals as PX4 and ArduPilot publish them
(their parameter references; MAV_CMD_SET_MESSAGE_INTERVAL is command 511, MAVLink common.xml).
"""

from dataclasses import dataclass
from enum import StrEnum

PX4, ARDUPILOT = 12, 3  # MAV_AUTOPILOT

# Least rates at which the effectiveness estimator answers [Hz]: below 20 Hz of IMU one sample spans
# the whole event, below 5 Hz of rotor speed a loss is older than a second before it can be told.
LEAST_IMU_RATE = 20.0
LEAST_ROTOR_RATE = 5.0
WANTED_IMU_RATE = 50.0
WANTED_ROTOR_RATE = 10.0


class Input(StrEnum):
    """What an estimator takes from the stream."""

    IMU = "accelerations and rates"
    ROTOR_SPEED = "rotor speeds"
    LANDED_STATE = "landed state"
    AIRFRAME = "airframe geometry"


@dataclass(frozen=True, slots=True)
class Need:
    """One input of one estimator: what it is, what the stream has, what would mend it.

    Attributes
    ----------
    rate : received [Hz]; 0 = none, NaN where a rate means nothing.
    wanted : rate asked for [Hz].
    met : whether the estimator can work with it.
    remedy : what to do if not; empty where met.
    """

    input: Input
    rate: float
    wanted: float
    met: bool
    remedy: str


_REMEDY: dict[tuple[Input, int], str] = {
    (Input.IMU, PX4): (
        "ask for HIGHRES_IMU: MAV_CMD_SET_MESSAGE_INTERVAL (511) param1=105 param2=20000, "
        "or set MAV_n_MODE to Onboard"
    ),
    (Input.IMU, ARDUPILOT): (
        "ask for RAW_IMU: MAV_CMD_SET_MESSAGE_INTERVAL (511) param1=27 param2=20000, "
        "or set SRn_RAW_SENS (MAVn_RAW_SENS from 4.7) to 50"
    ),
    (Input.ROTOR_SPEED, PX4): (
        "ask for ESC_STATUS: MAV_CMD_SET_MESSAGE_INTERVAL (511) param1=291 param2=100000; "
        "the ESCs must report: DSHOT_BIDIR_EN or DSHOT_TEL_CFG, or UAVCAN_ENABLE 3 for CAN"
    ),
    (Input.ROTOR_SPEED, ARDUPILOT): (
        "ask for ESC_TELEMETRY_1_TO_4: MAV_CMD_SET_MESSAGE_INTERVAL (511) param1=11030 param2=100000; "
        "the ESCs must report: SERVO_BLH_BDMASK (bidirectional DShot) or SERVO_BLH_AUTO, or CAN"
    ),
    (Input.LANDED_STATE, PX4): (
        "ask for EXTENDED_SYS_STATE: MAV_CMD_SET_MESSAGE_INTERVAL (511) param1=245 param2=1000000"
    ),
    (Input.LANDED_STATE, ARDUPILOT): (
        "ask for EXTENDED_SYS_STATE: MAV_CMD_SET_MESSAGE_INTERVAL (511) param1=245 param2=1000000"
    ),
    (Input.AIRFRAME, PX4): (
        "download the parameters (PARAM_REQUEST_LIST; CA_ROTOR_COUNT and CA_ROTORn_* are read), "
        "or give --vehicle FILE.toml"
    ),
    (Input.AIRFRAME, ARDUPILOT): (
        "download the parameters (PARAM_REQUEST_LIST; FRAME_CLASS and FRAME_TYPE are read), "
        "or give --vehicle FILE.toml"
    ),
}


def remedy(what: Input, autopilot: int | None) -> str:
    """Return what would give `what` on this autopilot (MAV_AUTOPILOT), PX4's and ArduPilot's if unknown."""
    if autopilot in (PX4, ARDUPILOT):
        return _REMEDY[what, autopilot]
    return f"PX4: {_REMEDY[what, PX4]}. ArduPilot: {_REMEDY[what, ARDUPILOT]}"


def effectiveness_needs(
    imu_rate: float, rotor_rate: float, landed_rate: float, airframe_known: bool, autopilot: int | None
) -> tuple[Need, ...]:
    """List what the effectiveness estimator needs against what the stream has.

    Parameters
    ----------
    imu_rate, rotor_rate, landed_rate : received rates [Hz]; 0 = none.
    airframe_known : whether the geometry came from a file or from parameters.
    autopilot : MAV_AUTOPILOT, None if unheard.

    The landed state is optional: without it the flight phase is told from rotor speeds alone.
    """

    def need(what: Input, rate: float, wanted: float, met: bool) -> Need:
        return Need(what, rate, wanted, met, "" if met else remedy(what, autopilot))

    return (
        need(Input.IMU, imu_rate, WANTED_IMU_RATE, imu_rate >= LEAST_IMU_RATE),
        need(Input.ROTOR_SPEED, rotor_rate, WANTED_ROTOR_RATE, rotor_rate >= LEAST_ROTOR_RATE),
        need(Input.AIRFRAME, float("nan"), float("nan"), airframe_known),
        need(Input.LANDED_STATE, landed_rate, 1.0, landed_rate > 0),
    )
