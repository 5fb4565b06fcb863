"""The latest of every input of the effectiveness estimator."""

import math

from gcs_health.estimators.input_recency import InputRecency
from gcs_health.estimators.ticks import FASTEST, complete
from gcs_health.samples import CommandReading, RotorReading


class Inputs(InputRecency):
    """The latest of every input and its time.

    Attributes
    ----------
    speeds : (n,) last rotor speeds [rad/s], NaN of a rotor that never reported.
    commands : (n,) last motor commands [-], NaN where not known.
    commands_t : when they came [s].
    """

    def __init__(self, rotors: int, stale_after: float) -> None:
        super().__init__(rotors, stale_after)
        self.speeds = [math.nan] * rotors
        self._newest = -math.inf
        self.commands = [math.nan] * rotors
        self.commands_t = -math.inf

    def take_speeds(self, reading: RotorReading) -> float:
        """Take the speeds that are new and plausible; return the slowest, 0 where not all are."""
        t, speeds, n = reading.t, reading.speed, len(self.speeds)
        if t >= self._newest and complete(speeds, n):
            self.speeds[:] = speeds
            self.speed_t[:] = [t] * n
            self._newest = t
            return min(speeds)
        for i, speed in enumerate(speeds[:n]):
            if -FASTEST < speed < FASTEST and t >= self.speed_t[i]:
                self.speeds[i] = abs(speed)
                self.speed_t[i] = t
                self._newest = max(self._newest, t)
        return 0.0

    def take_commands(self, reading: CommandReading) -> None:
        """Take the commands that are known."""
        self.commands_t = reading.t
        for i, command in enumerate(reading.command[: len(self.commands)]):
            if command == command:
                self.commands[i] = command
