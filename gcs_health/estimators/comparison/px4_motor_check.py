"""PX4's motor checks: current against command, as the autopilot runs them.

up to v1.16   current < command FD_ACT_MOT_C2T while command > FD_ACT_MOT_THR (0.2), for FD_ACT_MOT_TOUT (0.1 s);
              a motor is judged once it has drawn any current, and not on telemetry older than 0.1 s
main          residual = current - (MOTFAIL_C2T command + MOTFAIL_IDLE), low-passed over 0.2 s, at 10 Hz;
              below -MOTFAIL_UNDER for MOTFAIL_UND_TIME, or above MOTFAIL_OVER for MOTFAIL_OVR_TIME;
              a gap above 0.3 s starts the filter anew

Both need the airframe's own currents: `fit` is PX4's regression over healthy flights. The commander's flag
latches until disarm. Source: PX4 src/modules/commander/failure_detector/FailureDetector.cpp (v1.13 to
v1.16), HealthAndArmingChecks/checks/escCheck.cpp and docs/en/config/motor_failure_detection.md (main).
"""

import math

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import Judge, Verdict
from gcs_health.samples import CommandReading, FlightReading, Reading, RotorReading

THROTTLE = 0.2  # FD_ACT_MOT_THR
TIME_OUT = 0.1  # s, FD_ACT_MOT_TOUT, and the age of telemetry
FILTER = 0.2  # s
PERIOD = 0.1  # s, 10 Hz
GAP = 0.3  # s


def fit(command: NDArray[np.float64], current: NDArray[np.float64]) -> tuple[float, float]:
    """Return (C2T [A], idle [A]) of current = C2T command + idle, over all motors and flights.

    As PX4's `mfd_fit`: one model for all motors; an offset below 0 cannot be set, it is 0 then.
    """
    slope, offset = np.polyfit(command, current, 1)
    if offset < 0.0:
        return float(command @ current / (command @ command)), 0.0
    return float(slope), float(offset)


class _Motors:
    """Last command of each motor, and whether the vehicle is armed and flies."""

    def __init__(self, airframe: Airframe) -> None:
        self.command = [math.nan] * len(airframe.rotors)
        self.flying = False

    def feed(self, reading: Reading) -> RotorReading | None:
        if isinstance(reading, CommandReading):
            self.command = list(reading.command)
        elif isinstance(reading, FlightReading):
            self.flying = reading.armed is not False and reading.landed is False
        return reading if isinstance(reading, RotorReading) and self.flying else None


class UndercurrentCheck:
    """Up to v1.16. Scores: how far the current lies below C2T command, as a share of it [-].

    A threshold of s is a C2T lowered by the factor 1 - s: the parameter is set so that healthy flights pass.
    """

    def __init__(
        self, airframe: Airframe, c2t: float, threshold: float = 0.0, hold: float = TIME_OUT
    ) -> None:
        self.judge = Judge(threshold, hold)
        self._c2t = c2t
        self._motors = _Motors(airframe)
        self._has_current = [False] * len(airframe.rotors)
        self._t = -math.inf

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        report = self._motors.feed(reading)
        if report is None:
            return None
        fresh = report.t - self._t <= TIME_OUT
        self._t = report.t
        scores = []
        for i, (current, command) in enumerate(zip(report.current, self._motors.command, strict=True)):
            self._has_current[i] |= current > 0.0
            judged = fresh and self._has_current[i] and command > THROTTLE and current == current
            scores.append(1.0 - current / (command * self._c2t) if judged else -math.inf)
        return self.judge.feed(report.t, scores)


class ResidualCheck:
    """Main. Scores: the filtered residual in bands [-]: under -residual / `under`, over residual / `over`.

    Parameters
    ----------
    c2t, idle : of `fit` [A]. under, over : bands [A]; with threshold 1 they are MOTFAIL_UNDER and _OVER.
    hold, over_time : MOTFAIL_UND_TIME, MOTFAIL_OVR_TIME [s].
    """

    def __init__(
        self,
        airframe: Airframe,
        c2t: float,
        idle: float = 0.0,
        under: float = 1.0,
        over: float = math.inf,
        threshold: float = 1.0,
        hold: float = 0.3,
        over_time: float = 1.0,
    ) -> None:
        self.judge = Judge(threshold, hold)
        self.over_judge = Judge(threshold, over_time)
        self._c2t, self._idle = c2t, idle
        self._under, self._over = under, over
        self._motors = _Motors(airframe)
        self._has_current = [False] * len(airframe.rotors)
        self._residual: list[float] = []
        self._t = self._next = -math.inf

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        report = self._motors.feed(reading)
        if report is None or report.t < self._next:
            return None
        dt, self._t = report.t - self._t, report.t
        self._next = report.t + PERIOD - 1e-6
        keep = math.exp(-dt / FILTER) if dt <= GAP else 0.0
        if dt > GAP:
            self._residual = [0.0] * len(report.current)
            self.judge = Judge(self.judge.threshold, self.judge.hold)
            self.over_judge = Judge(self.over_judge.threshold, self.over_judge.hold)
        for i, (current, command) in enumerate(zip(report.current, self._motors.command, strict=True)):
            self._has_current[i] |= current > 0.0
            if self._has_current[i] and current == current and command == command:
                off = current - (self._c2t * command + self._idle)
                self._residual[i] = keep * self._residual[i] + (1.0 - keep) * off
        under = self.judge.feed(report.t, [-r / self._under for r in self._residual])
        return under or self.over_judge.feed(report.t, [r / self._over for r in self._residual])
