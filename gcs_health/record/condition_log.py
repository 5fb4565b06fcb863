"""A vehicle's condition from flight to flight: what was gathered, told once when a flight ends."""

from collections.abc import Iterable

from gcs_health.airframe import Airframe
from gcs_health.condition.indicators import Indicators
from gcs_health.estimators.contract import Estimate
from gcs_health.record.events import ConditionEvent, Value
from gcs_health.samples import Reading


class ConditionLog:
    """Fed what reaches the estimators and what they say.

    Attributes
    ----------
    maintenance : what grew within the flights that have ended, as a summary has it.
    """

    def __init__(self, vehicle: str) -> None:
        self.maintenance: tuple[Value, ...] = ()
        self._vehicle = vehicle
        self._gathered: Indicators | None = None
        self._told = False

    def adopt(self, airframe: Airframe) -> None:
        """Begin anew with this airframe."""
        self._gathered = Indicators(airframe)
        self._told = False

    def new_flight(self) -> None:
        """Forget the flight before."""
        self._told = False
        if self._gathered is not None:
            self._gathered.new_flight()

    def read(self, reading: Reading) -> None:
        """Take a reading."""
        if self._gathered is not None:
            self._gathered.read(reading)

    def routine(self, t: float, estimates: Iterable[Estimate], sound: bool) -> None:
        """Take what is estimated at `t` [s]; `sound` = it flies, and no rotor has failed."""
        if self._gathered is not None and self._gathered.due(t):
            self._gathered.estimates(t, estimates, sound)

    def end(self, t: float, us: int) -> list[ConditionEvent]:
        """End the flight at `t` [s], `us` [UNIX µs]; return what is to be told of it, once."""
        if self._told or self._gathered is None:
            return []
        found = self._gathered.of_flight()
        if not found:
            return []
        self._told = True
        self.maintenance += tuple({"t": t, **each._asdict()} for each in found if each.grows)
        return [ConditionEvent(t, us, self._vehicle, tuple(each._asdict() for each in found))]
