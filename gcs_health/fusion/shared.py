"""A fault that one of the rotors has and nothing tells which: its probability is shared among the suspects.

    P(one of them) = sum over the suspects of P(it is this one)

Where rotor speeds do not come, the level of vibration tells that some propeller is damaged and not whose; where they
do, two of one spin at one speed look alike. No rotor's own probability is then high enough to be told, and the sum
is. It is a verdict on the vehicle, not on any rotor: rotors stay as they are believed to be.
"""

from collections.abc import Sequence

from gcs_health.estimators.contract import Estimate, Reason
from gcs_health.fusion.kinds import Kind
from gcs_health.fusion.verdicts import NAN, NOBODY, Verdict

SUSPECT = 0.01  # least probability of a rotor that may have it: the estimator gives the others .003
LASTS = 5.0  # s
Figures = tuple[tuple[str, float | str], ...]


class SharedUnbalance:
    """Fed the unbalance estimates of all rotors, a round at a time; `verdict` is on the vehicle."""

    def __init__(self, motors: Sequence[int]) -> None:
        self._motors = motors
        self.new_flight()

    def new_flight(self) -> None:
        """Forget the flight before."""
        self._t = self._p = NAN
        self._suspects: list[Estimate] = []

    def feed(self, estimates: Sequence[Estimate]) -> None:
        """Take one round; what is not known of any rotor says nothing."""
        known = [each for each in estimates if each.failure_probability == each.failure_probability]
        if not known:
            return
        self._suspects = [
            each
            for each in known
            if each.failure_probability > SUSPECT and Reason.NOT_IDENTIFIABLE in each.reasons
        ]
        self._t = known[0].t
        self._p = min(sum(each.failure_probability for each in self._suspects), 1.0)

    def probability(self, t: float) -> float:
        """Return the probability that one of the suspects has it at vehicle time `t` [s]; NaN = not known."""
        return self._p if t - self._t <= LASTS else NAN

    def verdict(self, t: float) -> Verdict | None:
        """Return the verdict on no rotor in particular; None where nothing is known."""
        p = self.probability(t)
        if p != p:
            return None
        weights: dict[Kind, float] = dict.fromkeys(Kind, 0.0)
        weights |= {Kind.HEALTHY: 1.0 - p, Kind.PROPELLER_UNBALANCED: p}
        return Verdict(t, NOBODY, Kind.PROPELLER_UNBALANCED, p, weights, 1.0, True, t, ())

    def figures(self) -> Figures:
        """Return the numbers behind it; `one_of_motors` are the suspects."""
        if not self._suspects:
            return ()
        names = " ".join(str(self._motors[each.rotor]) for each in self._suspects)
        said: dict[str, float | str] = dict(self._suspects[0].evidence)
        said["one_of_motors"] = names
        return tuple((f"unbalance.{name}", value) for name, value in said.items())
