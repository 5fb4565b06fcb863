"""Armed, landed, flying: what the autopilot says of the flight."""

from gcs_health.samples import FlightReading, LandedState

ON_GROUND = 1  # MAV_LANDED_STATE
UNKNOWN_LANDED = 0


class FlightPhase:
    """The last word of HEARTBEAT and EXTENDED_SYS_STATE.

    Attributes
    ----------
    armed, landed : None = not said.
    landed_heard : how often EXTENDED_SYS_STATE came.
    """

    def __init__(self) -> None:
        self.armed: bool | None = None
        self.landed: bool | None = None
        self.landed_heard = 0

    def land(self, sample: LandedState) -> bool:
        """Take the landed state; return whether it changed."""
        self.landed_heard += 1
        landed = None if sample.landed_state == UNKNOWN_LANDED else sample.landed_state == ON_GROUND
        changed = landed is not self.landed
        self.landed = landed
        return changed

    @property
    def flies(self) -> bool:
        """Whether the vehicle flies, as far as the autopilot says."""
        return self.armed is not False and self.landed is not True

    def surely_flies(self, gate_open: bool) -> bool:
        """Whether it flies, by the autopilot's word, or, where it does not say, by the flight gate.

        Thrown or held in a hand, its rotors do as they are told one by one: no speed is to be judged by the others'.
        """
        return self.flies if self.landed is not None else self.armed is not False and gate_open

    def reading(self, t: float) -> FlightReading | None:
        """Return what estimators are told at vehicle time t [s]; None while nothing is known."""
        if self.armed is None and self.landed is None:
            return None
        return FlightReading(t, self.armed, self.landed)
