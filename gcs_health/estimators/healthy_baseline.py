"""What a healthy flight teaches the estimators about this very vehicle, beyond gains and hover.

Runs the estimators themselves over the flight and keeps what they ended with: each propeller's unbalance, or the
level of vibration where no rotor speeds come; the side of the ESC on which currents are measured, and the
motors' constants.

Source: sheet 2 section 5, sheet 3 steps 1 and 7, sheet 5 section 5.
"""

import math
from collections.abc import Iterable

from gcs_health.airframe import Airframe
from gcs_health.calibration.findings import Finding, missing
from gcs_health.estimators.motor_identification import Identified
from gcs_health.estimators.motor_observer import MotorObserver
from gcs_health.estimators.motor_observer_recommended import RecommendedObserver
from gcs_health.estimators.unbalance import UnbalanceEstimator
from gcs_health.samples import Reading

CONSTANTS = ("torque", "friction", "inertia")
LEVEL_SPREAD = 0.1  # of a level of vibration from one healthy flight to the next; sheet 5 section 5


def healthy_baseline(readings: Iterable[Reading], airframe: Airframe) -> list[Finding]:
    """Return findings for the vehicle file from the readings of one healthy flight, in order of arrival."""
    unbalance, motors = UnbalanceEstimator(airframe), MotorObserver(airframe)
    for reading in readings:
        for estimator in (unbalance, motors):
            if type(reading) in estimator.takes:
                estimator.feed(reading)
    return [*_unbalance(unbalance), *_motors(motors, airframe)]


def _unbalance(estimator: UnbalanceEstimator) -> list[Finding]:
    answer, seen = estimator.answer, estimator.baseline()
    if answer is None:
        rotors = missing("baseline", "unbalance", "no rotor speeds, or too short a flight")
    else:
        s, std = answer.s(), answer.std()
        error = [math.sqrt(float(a + b)) - math.sqrt(float(a)) for a, b in zip(s, std, strict=True)]
        why = f"order tracking over {answer.window:.0f} s at {float(answer.speed.mean()):.0f} rad/s"
        rotors = Finding("baseline", "unbalance", seen.unbalance, tuple(error), why)
    if math.isfinite(seen.level):
        spread = (LEVEL_SPREAD * seen.level,)
        why = "median over the flight, above 35 Hz"
        level = Finding("baseline", "vibration_level", (seen.level,), spread, why)
    else:
        level = missing("baseline", "vibration_level", "rotor speeds come, they tell more")
        if answer is None:
            level = missing("baseline", "vibration_level", "no accelerations in flight, or too slow")
    if math.isfinite(seen.vibration):
        spread = (LEVEL_SPREAD * seen.vibration,)
        autopilots = Finding("baseline", "vibration", (seen.vibration,), spread, "median over the flight")
    else:
        autopilots = missing("baseline", "vibration", "no VIBRATION messages in flight")
    return [rotors, level, autopilots]


def _motors(estimator: MotorObserver, airframe: Airframe) -> list[Finding]:
    core = estimator.core
    assert isinstance(core, RecommendedObserver)
    side = core.measured_on
    if side is None:
        measured = missing("motor", "current_side", "no currents, or too little change of speed to tell")
    else:
        measured = Finding("motor", "current_side", (), (), "from how current rises with speed", side)
    usable = side == "motor" or core.convertible
    found = [core.identified(k) for k in range(len(airframe.rotors))] if usable else []
    known = [each for each in found if each is not None]
    constant = airframe.motor.torque_constant
    if not known:
        rest = [missing("motor", key, "no currents of the motors' side") for key in CONSTANTS]
    elif constant is None:
        rest = [missing("motor", key, _in_amperes(known, k)) for k, key in enumerate(CONSTANTS)]
    else:
        rest = [_constant(known, k, key, constant) for k, key in enumerate(CONSTANTS)]
    return [measured, *rest]


def _constant(known: list[Identified], k: int, key: str, constant: float) -> Finding:
    """Return one constant, the motors taken as alike: their mean, and how far they and their errors spread."""
    values = [each[k] for each in known]
    mean = sum(values) / len(values)
    own = sum(each[3 + k] ** 2 for each in known) / len(known)
    between = sum((value - mean) ** 2 for value in values) / len(values)
    separable = sum(each.separable for each in known) / len(known)
    why = f"{len(known)} motors; drag told from friction to {separable:.0%}"
    return Finding("motor", key, (mean * constant,), (math.sqrt(own + between) * constant,), why)


def _in_amperes(known: list[Identified], k: int) -> str:
    mean = sum(each[k] for each in known) / len(known)
    unit = ("A s²", "A s", "A s²")[k]
    return f"{mean:.3g} {unit} over the torque constant; give motor.torque_constant to keep it"
