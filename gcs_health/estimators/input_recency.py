"""How recent the inputs of an estimator are, and what is missing."""

import math

from gcs_health.estimators.contract import Reason


class InputRecency:
    """When accelerations and each rotor's speed came last.

    Attributes
    ----------
    imu_t : time of the last IMU reading [s], -inf before the first.
    speed_t : (n,) of the last speed of each rotor [s].
    stale_after : age from which an input counts as missing [s].
    """

    def __init__(self, rotors: int, stale_after: float) -> None:
        self.stale_after = stale_after
        self.imu_t = -math.inf
        self.speed_t = [-math.inf] * rotors

    def missing(self, t: float) -> list[Reason]:
        """Return what keeps every rotor from being judged at time t [s]."""
        reasons = []
        if self.imu_t == -math.inf:
            reasons.append(Reason.NO_IMU)
        elif t - self.imu_t > self.stale_after:
            reasons.append(Reason.IMU_STALE)
        newest = max(self.speed_t)
        if newest == -math.inf:
            reasons.append(Reason.NO_ROTOR_SPEEDS)
        elif t - newest > self.stale_after:
            reasons.append(Reason.ROTOR_SPEED_STALE)
        return reasons

    @property
    def incomplete(self) -> bool:
        """Whether some rotors have told their speed and others never have."""
        return min(self.speed_t) == -math.inf < max(self.speed_t)

    def reasons(self, rotor: int, common: list[Reason]) -> list[Reason]:
        """Return what keeps one rotor from being judged, `common` to all included."""
        reasons = list(common)
        if Reason.NO_ROTOR_SPEEDS not in reasons:
            if self.speed_t[rotor] == -math.inf:
                reasons.append(Reason.ROTOR_NOT_REPORTED)
            elif min(self.speed_t) == -math.inf:
                reasons.append(Reason.ROTOR_SPEEDS_INCOMPLETE)
        return reasons
