"""What one vehicle's monitor has to say, held until its times are on one axis."""

from collections.abc import Iterable

from gcs_health.airframe import Airframe
from gcs_health.fusion.alerts import Alert
from gcs_health.fusion.verdicts import Verdict
from gcs_health.record.describe import alert_event, verdict_event
from gcs_health.record.events import AlertEvent, Event

CLOCK_WAIT_US = 2_000_000  # events wait so long for a first stamped message


class Outbox:
    """Events on their way out.

    Attributes
    ----------
    pending : not yet let out.
    alerts : every step of every alert so far.
    """

    def __init__(self, vehicle: str) -> None:
        self.pending: list[Event] = []
        self.alerts: list[AlertEvent] = []
        self._vehicle = vehicle
        self._told: dict[int, Verdict] = {}  # by rotor
        self._timed = False
        self._first_us: int | None = None

    def alert(self, alerts: Iterable[Alert], us: int) -> list[AlertEvent]:
        """Note alerts, stamped `us` [UNIX µs]; return them as events, which are not pending."""
        events = [alert_event(alert, us, self._vehicle) for alert in alerts]
        self.alerts += events
        return events

    def tell(self, verdicts: list[Verdict], airframe: Airframe, us: int) -> None:
        """Say what changed in what is believed of the rotors."""
        for verdict in verdicts:
            before = self._told.get(verdict.rotor)
            if before is None or verdict.differs(before):
                self._told[verdict.rotor] = verdict
                self.pending.append(verdict_event(verdict, airframe, us, self._vehicle))

    def forget_verdicts(self) -> None:
        """The rotors are others: what was told of them counts no longer."""
        self._told.clear()

    def release(self, receive_us: int, now: float, settled: bool) -> list[Event]:
        """Let out what is pending once the clock is `settled` or will not be; until then `now` is the time [s]."""
        if not self._timed:
            if self._first_us is None:
                self._first_us = receive_us
            self._timed = settled or receive_us - self._first_us > CLOCK_WAIT_US
            if not self._timed:
                return []
            self.pending = [event._replace(t=now) for event in self.pending]
        return self.take()

    def take(self) -> list[Event]:
        """Let out what is pending."""
        events, self.pending = self.pending, []
        return events
