"""Which geometry a vehicle has: the user's file before its parameters before a guess."""

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.airframe_parameters import AirframeParameters
from gcs_health.airframe_tables import assume_airframe
from gcs_health.samples import Heartbeat, Parameter

MULTIROTORS = frozenset(
    {0, 2, 3, 4, 13, 14, 15, 29, 35, 43}
)  # MAV_TYPE; 0 generic; 4: some quads say helicopter
NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: ground stations, companions, gimbals
NOT_VEHICLES = frozenset({5, 6, 18, 26, 27, 30, 31, 34})  # MAV_TYPE: ground stations, companions ...
ASSUME_AFTER = 3.0  # s of vehicle time in which parameters may still tell the geometry
BETTER = (AirframeSource.FILE, AirframeSource.PARAMETERS, AirframeSource.ASSUMED)


def of_a_vehicle(sample: Heartbeat) -> bool:
    """Whether a heartbeat is a vehicle's, and not a ground station's or a companion's."""
    return sample.autopilot != NO_AUTOPILOT and sample.vehicle_type not in NOT_VEHICLES


class AirframeChoice:
    """Fed parameters; says which airframe to take next.

    Attributes
    ----------
    chosen : the airframe taken; None before any.
    refused : why the last one offered cannot be used; empty if it can.
    vehicle_type : MAV_TYPE; None if unheard.
    """

    def __init__(self) -> None:
        self.chosen: Airframe | None = None
        self.refused = ""
        self.vehicle_type: int | None = None
        self._parameters = AirframeParameters()

    def parameter(self, sample: Parameter) -> bool:
        """Take a parameter; return whether it is one of the geometry's."""
        return self._parameters.feed(sample)

    @property
    def output_channels(self) -> dict[int, int]:
        """Which output channel (from 0) drives which motor (from 1), as the parameters say."""
        return self._parameters.output_channels()

    def from_parameters(self) -> Airframe | None:
        """Return the parameters' airframe if it is news and no file was given."""
        if not self._worse_than(AirframeSource.FILE):
            return None
        airframe = self._parameters.airframe(self.vehicle_type)
        return airframe if airframe != self.chosen else None

    def assumed(self, waited: float, esc_count: int) -> Airframe | None:
        """Return a guess where none is known after `waited` s; from the number of ESCs and the vehicle's type."""
        if waited >= ASSUME_AFTER and not self.unusable():
            return assume_airframe(esc_count, self.vehicle_type)
        return None

    def missing(self) -> str:
        """Say which parameters a geometry begun still lacks; empty if none."""
        return self._parameters.missing() if self._worse_than(AirframeSource.PARAMETERS) else ""

    def unusable(self) -> str:
        """Say why nothing can be estimated here at all; empty if something can."""
        if self.vehicle_type is not None and self.vehicle_type not in MULTIROTORS:
            return f"MAV_TYPE {self.vehicle_type} is not a multirotor: no rotors to watch"
        return self.refused

    def _worse_than(self, source: AirframeSource) -> bool:
        return self.chosen is None or BETTER.index(self.chosen.source) > BETTER.index(source)
