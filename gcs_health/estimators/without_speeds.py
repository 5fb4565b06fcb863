"""What commands and rates tell where no rotor speeds come: a total loss, or a damaged propeller.

The contradiction test needs commands, rates and geometry alone; the hover trim a healthy reference too.
"""

import math
from statistics import NormalDist

from gcs_health.airframe import Airframe
from gcs_health.estimators.contract import Estimate, Quantity, Reason, Status
from gcs_health.estimators.contradiction import Contradiction, ContradictionConfig
from gcs_health.estimators.hover_trim import HoverTrim, Trim, TrimConfig
from gcs_health.samples import CommandReading, ImuReading

NAN = math.nan
STANDARD = NormalDist()
DAMAGED = 0.75  # k below which a rotor counts as damaged where no rule has spoken
UNDECIDED = 0.89  # highest failure probability while the rules are not satisfied
OF_TRIM = {
    Trim.SETTLING: Reason.SETTLING,
    Trim.LOAD: Reason.LOAD_SHIFTED,
    Trim.UNCLEAR: Reason.TRIM_UNCLEAR,
}


class WithoutSpeeds:
    """Fed commands and IMU readings until rotor speeds come.

    Attributes
    ----------
    heard : whether commands of all rotors have come.
    """

    def __init__(self, airframe: Airframe, contradiction: ContradictionConfig, trim: TrimConfig) -> None:
        self.heard = False
        self.contradiction = Contradiction(airframe, contradiction)
        self.trim = HoverTrim(airframe, trim)
        self._last = math.nan  # of the last commands [s]
        self._rotors = len(airframe.rotors)

    @property
    def failed(self) -> int | None:
        """The rotor that a rule names."""
        if self.contradiction.rotor is not None:
            return self.contradiction.rotor
        return self.trim.rotor if self.trim.state is Trim.CUT else None

    def restart(self) -> None:
        """Begin a new flight."""
        self.contradiction.restart()
        self.trim.restart()

    def commands(self, reading: CommandReading) -> bool:
        """Take commands; return whether something is decided anew."""
        if len(reading.command) != self._rotors:
            return False
        u = [value * abs(value) for value in reading.command]
        if not -1.0 < sum(u) <= 1.21 * self._rotors or not math.isfinite(reading.t):  # NaN too
            return False
        self.heard = True
        self._last = reading.t
        self.contradiction.commands(reading.t, u)
        return self.trim.feed(reading.t, u) and self.contradiction.rotor is None

    def imu(self, reading: ImuReading) -> bool:
        """Take rates; return whether a rotor was named."""
        return self.heard and self.contradiction.rates(reading.t, reading.p, reading.q)

    def estimate(self, name: str, t: float, rotor: int, reasons: list[Reason]) -> Estimate:
        """Return what is known of one rotor; `reasons` say what is missing."""
        failed = self.failed
        value = std = p = NAN
        status = Status.UNOBSERVABLE
        evidence: tuple[tuple[str, float | str], ...] = ()
        if self.contradiction.rotor is not None:
            if rotor == failed:
                value, std, p, status, reasons = 0.0, 0.5, 0.95, Status.VALID, []
                evidence = (("rule", "contradiction"),)
            else:
                reasons = [Reason.ANOTHER_ROTOR_FAILED]
        elif not self.trim.known:
            reasons = [*reasons, Reason.NO_HEALTHY_REFERENCE]
        elif self.trim.state in OF_TRIM:
            reasons = [*reasons, OF_TRIM[self.trim.state]]
        else:
            value, status, reasons = self.trim.left(rotor), Status.VALID, []
            std = self.trim.config.spread * value
            p = min(STANDARD.cdf((DAMAGED - value) / std), UNDECIDED) if rotor != failed else 0.95
            evidence = (
                ("rule", "hover_trim"),
                ("yaw_part", self.trim.yaw),
                ("explained", self.trim.explained),
                ("command", math.sqrt(self.trim.u[rotor])),
                ("command_healthy", math.sqrt(self.trim.reference[rotor])),
            )
        return Estimate(
            t, name, rotor, Quantity.EFFECTIVENESS, value, std, p, status, tuple(reasons), NAN, evidence
        )
