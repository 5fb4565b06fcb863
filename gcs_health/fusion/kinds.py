"""What can be wrong with a rotor: the closed list over which verdicts are given."""

from enum import StrEnum


class Kind(StrEnum):
    """The state of one rotor."""

    HEALTHY = "healthy"
    PROPELLER_LOST = "propeller lost"
    THRUST_LOSS = "thrust partly lost"
    MOTOR_STOPPED = "motor stopped"
    MOTOR_STUCK = "motor stuck"
    PROPELLER_SLIPPING = "propeller slipping"
    PROPELLER_UNBALANCED = "propeller unbalanced"
    DRAG_RISEN = "drag risen"
    ESC_TELEMETRY_LOST = "ESC telemetry lost or frozen"
    ESC_FAULT_REPORTED = "ESC reports a fault"
    ESC_OVERHEATING = "ESC overheating"
    ESC_MISATTRIBUTED = "telemetry of another motor"
    MOTOR_ORDER_WRONG = "motors in the wrong order"


# kinds in which the rotor no longer gives the thrust that it should: one event may look like any of them at first
FAILED = frozenset(
    {
        Kind.PROPELLER_LOST,
        Kind.THRUST_LOSS,
        Kind.MOTOR_STOPPED,
        Kind.MOTOR_STUCK,
        Kind.PROPELLER_SLIPPING,
    }
)
# what an ESC says of itself: true beside any other fault, of which it may be the consequence
REPORTED = frozenset({Kind.ESC_FAULT_REPORTED, Kind.ESC_OVERHEATING})
UNKNOWN = "unknown"  # said in place of "healthy" where no source has looked lately
FAULTS = tuple(kind for kind in Kind if kind is not Kind.HEALTHY)
