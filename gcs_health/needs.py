"""What an estimator needs of the stream, and the parameter or command that would give it.

One table an autopilot; parameter names, message ids and intervals as PX4 and ArduPilot publish them
(their parameter references; MAV_CMD_SET_MESSAGE_INTERVAL is command 511, MAVLink common.xml).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

PX4, ARDUPILOT = 12, 3  # MAV_AUTOPILOT


class Input(StrEnum):
    """What an estimator takes from the stream."""

    IMU = "accelerations and rates"
    ROTOR_SPEED = "rotor speeds"
    CURRENT = "motor currents"
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
    (Input.CURRENT, PX4): (
        "the ESCs must measure it and report: DSHOT_TEL_CFG (telemetry wire) or UAVCAN_ENABLE 3 for CAN; "
        "bidirectional DShot alone has none"
    ),
    (Input.CURRENT, ARDUPILOT): (
        "the ESCs must measure it and report: SERVO_BLH_AUTO with the telemetry wire, or CAN; "
        "bidirectional DShot alone has none"
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


@dataclass(frozen=True, slots=True)
class Stream:
    """What a vehicle's stream has: received rates [Hz], 0 = none.

    Attributes
    ----------
    airframe_known : whether the geometry came from a file or from parameters.
    autopilot : MAV_AUTOPILOT, None if unheard.
    """

    imu: float
    rotor: float
    current: float
    landed: float
    airframe_known: bool
    autopilot: int | None


@dataclass(frozen=True, slots=True)
class Rates:
    """Rates that an estimator works from, and those at which it does well [Hz]; None = it does not use it."""

    imu: tuple[float, float] | None = None
    rotor: tuple[float, float] | None = None
    current: tuple[float, float] | None = None


# (least, wanted). Effectiveness: below 20 Hz of IMU one sample spans the whole event, below 5 Hz of rotor speed a
# loss is older than a second before it can be told (sheet 1 section 10). Unbalance: lines fold onto one another
# below 50 Hz, phase is lost below 10 Hz of rotor speed (sheet 2 section 6). Motor observer: currents sampled more
# seldom than 10 Hz alias (sheet 3). Pooled AR: 50 Hz says nothing in gusts (sheet 4 section 7).
RATES: dict[str, Rates] = {
    "effectiveness": Rates(imu=(20.0, 50.0), rotor=(5.0, 10.0)),
    "unbalance": Rates(imu=(45.0, 100.0), rotor=(9.0, 50.0)),
    "motor_observer": Rates(rotor=(9.0, 50.0), current=(9.0, 50.0)),
    "pooled_ar": Rates(imu=(90.0, 200.0)),
}


def estimator_needs(estimator: str, stream: Stream) -> tuple[Need, ...]:
    """List what an estimator needs against what the stream has.

    The landed state is optional: without it the flight phase is told from rotor speeds alone.
    """
    rates = RATES.get(estimator, Rates())

    def need(what: Input, rate: float, wanted: float, met: bool) -> Need:
        return Need(what, rate, wanted, met, "" if met else remedy(what, stream.autopilot))

    out = []
    for what, pair, rate in (
        (Input.IMU, rates.imu, stream.imu),
        (Input.ROTOR_SPEED, rates.rotor, stream.rotor),
        (Input.CURRENT, rates.current, stream.current),
    ):
        if pair is not None:
            least, wanted = pair
            out.append(need(what, rate, wanted, rate >= least))
    out.append(need(Input.AIRFRAME, float("nan"), float("nan"), stream.airframe_known))
    if estimator == "effectiveness":
        out.append(need(Input.LANDED_STATE, stream.landed, 1.0, stream.landed > 0))
    return tuple(out)


def remedies(needs: Iterable[tuple[Need, ...]]) -> list[str]:
    """Say once of each input that is needed and not there, of several estimators, what would give it."""
    told: dict[Input, str] = {}
    for need in (need for each in needs for need in each):
        if need.met or need.input in told or not need.wanted > 1.0:
            continue
        if need.input is Input.CURRENT and Input.ROTOR_SPEED in told:
            continue  # what gives the one gives the other
        have = f"only {need.rate:.1f} Hz of" if need.rate else "no"
        told[need.input] = f"{have} {need.input.value} in the stream: {need.remedy}"
    return list(told.values())
