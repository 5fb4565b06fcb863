"""What breaks, when, on which rotor; and what that does to the plant and to the ESC's telemetry.

| kind | size | what it does | FAILURE_TYPE |
|---|---|---|---|
| propeller_lost | - | thrust and drag gone, inertia the motor's alone, the motor still driven | - |
| effectiveness | what is left, 0..1 | thrust and drag torque reduced | - |
| slow | factor on the speed, 0..1 | commanded speed reduced (Dutta's degradation) | slow |
| motor_stopped | - | no current: it coasts to a stop | off |
| motor_stuck | - | it stands at once, under current | stuck |
| blade_cut | share of one blade's length | thrust and torque lost, and the mass at the tip | - |
| unbalance | g mm | unbalance of the propeller | - |
| bearing | factor on friction | wear; often with `ramp` | - |
| slipping | what is left of the thrust | the motor is loaded as before: rpm and current are fine | - |
| esc_lost | - | its telemetry stops | off |
| esc_frozen | - | its telemetry repeats | stuck |
| esc_swapped | the other motor | two ESCs' telemetry exchanged | wrong |
| esc_heat | deg C added | its temperature sensor or cooling; with `ramp` a trend | - |
| esc_flags | ESC_FAILURE_FLAGS | PX4's ESC_INFO reports them | - |
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_health.simulate.arithmetic import Arithmetic, Value
from gcs_health.simulate.plant import Plant, RotorState

BLADES = 2
TIP_MASS = 0.6  # a blade's outer part weighs less per length than the mean
RAMP_STEP = 0.02  # s between the steps of a ramp


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of fault: whether it takes a size, and between which bounds."""

    size: str = ""  # what the size is; empty = none
    low: float = 0.0
    high: float = 1.0
    telemetry: bool = False  # touches what is told, not what is


KINDS = {
    "propeller_lost": Kind(),
    "effectiveness": Kind("what is left of it"),
    "slow": Kind("factor on the speed"),
    "motor_stopped": Kind(),
    "motor_stuck": Kind(),
    "blade_cut": Kind("share of one blade"),
    "unbalance": Kind("g mm", 0.0, 1e4),
    "bearing": Kind("factor on the friction", 1.0, 1e3),
    "slipping": Kind("what is left of the thrust"),
    "esc_lost": Kind(telemetry=True),
    "esc_frozen": Kind(telemetry=True),
    "esc_swapped": Kind("the other motor", 1.0, 12.0, telemetry=True),
    "esc_heat": Kind("deg C", 0.0, 200.0, telemetry=True),
    "esc_flags": Kind("ESC_FAILURE_FLAGS", 0.0, 65535.0, telemetry=True),
}
# MAVLink's FAILURE_TYPE where one of its words fits
FAILURE_TYPE = {
    "motor_stopped": "FAILURE_TYPE_OFF",
    "motor_stuck": "FAILURE_TYPE_STUCK",
    "slow": "FAILURE_TYPE_SLOW",
    "esc_lost": "FAILURE_TYPE_OFF",
    "esc_frozen": "FAILURE_TYPE_STUCK",
    "esc_swapped": "FAILURE_TYPE_WRONG",
}


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault on one rotor.

    kind : of `KINDS`. rotor : index from 0. at [s] flight time. size : see the table. ramp [s] over which
    it grows. In a campaign rotor, at and size may be columns, one value a flight.
    """

    kind: str
    rotor: Value
    at: Value
    size: Value = math.nan
    ramp: float = 0.0


class PlantFaults:
    """Applies the faults that touch the plant, each when its time has come."""

    def __init__(self, faults: list[Fault], ops: Arithmetic, propeller_mass: float) -> None:
        self._faults = [fault for fault in faults if not KINDS[fault.kind].telemetry]
        self._ops = ops
        self._propeller_mass = propeller_mass
        self._next = -math.inf

    def apply(self, plant: Plant, t: float) -> None:
        """Do what is due at flight time t [s]."""
        if t < self._next:
            return
        coming = math.inf
        for fault in self._faults:
            for i, rotor in enumerate(plant.rotors):
                due = (fault.rotor == i) & (t >= fault.at)
                if self._ops.any(due):
                    self._strike(plant, rotor, i, fault, due, t)
            times = np.ravel(fault.at)
            later = times[times > t]
            if len(later):
                coming = min(coming, float(later.min()))
            if fault.ramp and bool(np.any((times <= t) & (t < times + fault.ramp))):
                coming = min(coming, t + RAMP_STEP)
        self._next = coming

    def _strike(self, plant: Plant, rotor: RotorState, i: int, fault: Fault, due: Value, t: float) -> None:
        where = self._ops.where
        motor, seat = plant.vehicle.motor, plant.vehicle.rotors[i]
        share = 1.0 if not fault.ramp else self._ops.minimum((t - fault.at) / fault.ramp, 1.0)
        kind, size = fault.kind, fault.size
        left = 1.0 - share * (1.0 - size)
        if kind == "propeller_lost":
            rotor.eta_t = where(due, 0.0, rotor.eta_t)
            rotor.eta_q = where(due, 0.0, rotor.eta_q)
            rotor.imbalance = where(due, 0.0, rotor.imbalance)
            rotor.inertia = where(due, motor.inertia * motor.bare_inertia, rotor.inertia)
        elif kind == "effectiveness":
            rotor.eta_t = where(due, left, rotor.eta_t)
            rotor.eta_q = where(due, left, rotor.eta_q)
        elif kind == "slipping":
            rotor.eta_t = where(due, left, rotor.eta_t)
        elif kind == "slow":
            rotor.slowed = where(due, left, rotor.slowed)
        elif kind == "motor_stopped":
            rotor.driven = where(due, 0.0, rotor.driven)
        elif kind == "motor_stuck":
            rotor.free = where(due, 0.0, rotor.free)
        elif kind == "bearing":
            rotor.friction = where(due, 1.0 + share * (size - 1.0), rotor.friction)
        elif kind == "unbalance":
            rotor.imbalance = where(due, share * size * 1e-6, rotor.imbalance)
        elif kind == "blade_cut":
            # lift goes with r² dr, drag torque with r³ dr along the blade
            kept = 1.0 - share * size
            rotor.eta_t = where(due, 1.0 - (1.0 - kept**3) / BLADES, rotor.eta_t)
            rotor.eta_q = where(due, 1.0 - (1.0 - kept**4) / BLADES, rotor.eta_q)
            lost = self._propeller_mass / BLADES * TIP_MASS * share * size
            arm = (seat.radius or 0.1) * (1.0 - 0.5 * share * size)
            rotor.imbalance = where(due, lost * arm, rotor.imbalance)


def described(fault: Fault) -> dict[str, Any]:
    """Return the fault as `truth.json` has it: motors from 1, MAVLink's word where one fits."""
    out: dict[str, Any] = {"kind": fault.kind, "rotor": int(fault.rotor) + 1}
    if fault.size == fault.size:
        out["size"] = float(fault.size)
        out["size_is"] = KINDS[fault.kind].size
    if fault.ramp:
        out["ramp_s"] = fault.ramp
    if fault.kind in FAILURE_TYPE:
        out["failure_type"] = FAILURE_TYPE[fault.kind]
    return out
