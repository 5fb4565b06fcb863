"""Alerts: estimates in, one episode per rotor out, raised once and cleared when the reason is gone."""

from dataclasses import dataclass

from gcs_health.airframe import Airframe, Rotor
from gcs_health.estimators.contract import Estimate, Reason, Status
from gcs_health.fusion.alert_table import ROTOR_FAILED, AlertKind


@dataclass(frozen=True, slots=True)
class Alert:
    """One step of an episode.

    Attributes
    ----------
    t : vehicle clock [s] of the datum that caused it.
    number : the episode's number within its vehicle, from 1; raise, update and clear share it.
    state : "raised", "updated" or "cleared".
    rotor : the rotor concerned.
    probability : of failure, 0..1.
    """

    t: float
    number: int
    state: str
    kind: AlertKind
    rotor: Rotor
    probability: float
    text: str
    evidence: tuple[tuple[str, float | str], ...]


@dataclass(slots=True)
class _Episode:
    number: int
    what: str
    calm_since: float | None = None


class AlertDesk:
    """The alert machine of one vehicle: raise at `raise_at`, clear after `clear_after` below `clear_at`."""

    def __init__(self, airframe: Airframe, count: int = 0) -> None:
        """`count` episodes went before, under another airframe."""
        self._airframe = airframe
        self._open: dict[int, _Episode] = {}
        self.count = count

    def feed(self, estimate: Estimate) -> list[Alert]:
        """Take one estimate; return what the operator must be told because of it."""
        episode = self._open.get(estimate.rotor)
        probability = estimate.failure_probability
        if probability != probability:  # NaN: unknown is neither a reason to raise nor to clear
            return []
        if episode is None:
            if probability < ROTOR_FAILED.raise_at:
                return []
            self.count += 1
            self._open[estimate.rotor] = episode = _Episode(self.count, _what(estimate))
            return [self._alert(estimate, episode, "raised")]
        if probability >= ROTOR_FAILED.raise_at:
            episode.calm_since = None
            if _what(estimate) != episode.what:
                episode.what = _what(estimate)
                return [self._alert(estimate, episode, "updated")]
            return []
        return self._clear(estimate, episode)

    def _clear(self, estimate: Estimate, episode: _Episode) -> list[Alert]:
        if estimate.failure_probability > ROTOR_FAILED.clear_at or estimate.status is not Status.VALID:
            episode.calm_since = None
            return []
        if episode.calm_since is None:
            episode.calm_since = estimate.t
        if estimate.t - episode.calm_since < ROTOR_FAILED.clear_after:
            return []
        del self._open[estimate.rotor]
        return [self._alert(estimate, episode, "cleared")]

    def _alert(self, estimate: Estimate, episode: _Episode, state: str) -> Alert:
        rotor = self._airframe.rotors[estimate.rotor]
        text = ROTOR_FAILED.text.format(
            motor=rotor.motor,
            seat=self._airframe.seat(estimate.rotor),
            what="answers again" if state == "cleared" else episode.what,
            percent=min(99, int(100 * _belief(estimate, state))),
        )
        return Alert(
            estimate.t,
            episode.number,
            state,
            ROTOR_FAILED,
            rotor,
            estimate.failure_probability,
            text,
            estimate.evidence,
        )


def _what(estimate: Estimate) -> str:
    if Reason.MOTOR_STOPPED in estimate.reasons:
        return "motor stopped"
    if ("rule", "hover_trim") in estimate.evidence:
        return "gives less thrust"
    return "rotor lost its thrust"


def _belief(estimate: Estimate, state: str) -> float:
    p = estimate.failure_probability
    return 1.0 - p if state == "cleared" else p
