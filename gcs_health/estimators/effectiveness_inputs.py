"""Which inputs the effectiveness estimator has, and what is missing."""

import math

from gcs_health.estimators.contract import Reason
from gcs_health.estimators.ticks import FASTEST, complete
from gcs_health.samples import CommandReading, RotorReading


class Inputs:
    """The latest of every input and its time.

    Attributes
    ----------
    imu_t : time of the last IMU reading [s], -inf before the first.
    speeds : (n,) last rotor speeds [rad/s], NaN of a rotor that never reported.
    speed_t : (n,) their times [s].
    commands : (n,) last motor commands [-], NaN where not known.
    """

    def __init__(self, rotors: int, stale_after: float) -> None:
        self.stale_after = stale_after
        self.imu_t = -math.inf
        self.speeds = [math.nan] * rotors
        self.speed_t = [-math.inf] * rotors
        self._newest = -math.inf
        self.commands = [math.nan] * rotors

    def take_speeds(self, reading: RotorReading) -> float:
        """Take the speeds that are new and plausible; return the slowest, 0 where not all are."""
        t = reading.t
        if t >= self._newest and complete(reading.speed, len(self.speeds)):
            self.speeds[:] = reading.speed
            self.speed_t[:] = [t] * len(self.speeds)
            self._newest = t
            return min(reading.speed)
        for i, speed in enumerate(reading.speed[: len(self.speeds)]):
            if -FASTEST < speed < FASTEST and reading.t >= self.speed_t[i]:
                self.speeds[i] = abs(speed)
                self.speed_t[i] = reading.t
                self._newest = max(self._newest, t)
        return 0.0

    def take_commands(self, reading: CommandReading) -> None:
        """Take the commands that are known."""
        for i, command in enumerate(reading.command[: len(self.commands)]):
            if command == command:
                self.commands[i] = command

    def missing(self, t: float) -> list[Reason]:
        """Return what keeps every rotor from being judged at time t [s]."""
        reasons = []
        if self.imu_t == -math.inf:
            reasons.append(Reason.NO_IMU)
        elif t - self.imu_t > self.stale_after:
            reasons.append(Reason.IMU_STALE)
        newest = self._newest
        if newest == -math.inf:
            reasons.append(Reason.NO_ROTOR_SPEEDS)
        elif t - newest > self.stale_after:
            reasons.append(Reason.ROTOR_SPEED_STALE)
        return reasons

    def reasons(self, rotor: int, common: list[Reason]) -> list[Reason]:
        """Return what keeps one rotor from being judged, `common` to all included."""
        reasons = list(common)
        if Reason.NO_ROTOR_SPEEDS not in reasons:
            if self.speed_t[rotor] == -math.inf:
                reasons.append(Reason.ROTOR_NOT_REPORTED)
            elif min(self.speed_t) == -math.inf:
                reasons.append(Reason.ROTOR_SPEEDS_INCOMPLETE)
        return reasons
