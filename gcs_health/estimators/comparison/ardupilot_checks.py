"""ArduCopter's thrust-loss and yaw-imbalance checks; facts of its crash_check.cpp and AP_MotorsMatrix.cpp.

Thrust loss: for 1 s on end a target lean of at most 15 deg, collective throttle of at least .9 (or at the
upper limit and above .25), descent, attitude error below 30 deg. It guesses the motor with the highest
thrust command, low-passed over 0.5 s. Then thrust boost is on and the check rests.

Yaw imbalance: the yaw rate loop's integral, low-passed at 0.05 Hz (never above its present size), above
.75 of its limit; said at most every 10 s, not under thrust boost. It names no rotor.

Both run on board, on values that telemetry does not carry: `ControlReading` has them from the simulator.
"""

import math
from typing import NamedTuple

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import UNNAMED, Verdict
from gcs_health.samples import CommandReading, FlightReading, Reading

LEAN, ERROR = math.radians(15.0), math.radians(30.0)
THROTTLE, LEAST_THROTTLE = 0.9, 0.25
TRIGGER = 1.0  # s
MOTOR_FILTER = 0.5  # s
YAW_CUTOFF = 0.05  # Hz
YAW_SHARE = 0.75
YAW_EVERY = 10.0  # s


class ControlReading(NamedTuple):
    """What the controller knows of itself at t [s].

    Attributes
    ----------
    target_lean, attitude_error : angles [rad].
    throttle : collective thrust, share of the most [-]. saturated : a motor is at its upper limit.
    climb_rate : [m/s]. yaw_integral : of the yaw rate loop, share of its limit [-].
    """

    t: float
    target_lean: float
    attitude_error: float
    throttle: float
    saturated: bool
    climb_rate: float
    yaw_integral: float


class ThrustLossCheck:
    """Feed `ControlReading` besides the usual ones. `boost` : whether it has fired."""

    def __init__(self, airframe: Airframe) -> None:
        self.boost = False
        self._thrust = [0.0] * len(airframe.rotors)
        self._command_t = math.nan
        self._since = math.nan
        self._flying = False

    def feed(self, reading: Reading | ControlReading) -> Verdict | None:
        """Take one reading."""
        if isinstance(reading, FlightReading):
            self._flying = reading.armed is not False and reading.landed is False
        elif isinstance(reading, CommandReading):
            self._filter(reading)
        elif isinstance(reading, ControlReading) and not self.boost:
            return self._check(reading)
        return None

    def _filter(self, reading: CommandReading) -> None:
        dt, self._command_t = reading.t - self._command_t, reading.t
        share = dt / (dt + MOTOR_FILTER) if dt == dt else 1.0
        for i, command in enumerate(reading.command):
            if command == command:
                self._thrust[i] += share * (command * command - self._thrust[i])

    def _check(self, now: ControlReading) -> Verdict | None:
        full = now.throttle >= THROTTLE or (now.saturated and now.throttle >= LEAST_THROTTLE)
        level = now.target_lean <= LEAN and now.attitude_error < ERROR
        if not (self._flying and full and level and now.climb_rate < 0.0):
            self._since = math.nan
            return None
        if self._since != self._since:
            self._since = now.t
        if now.t - self._since < TRIGGER:
            return None
        self.boost = True
        return Verdict(max(range(len(self._thrust)), key=self._thrust.__getitem__), now.t)


class YawImbalanceCheck:
    """Feed `ControlReading` besides the usual ones."""

    def __init__(self, airframe: Airframe) -> None:
        self._loss = ThrustLossCheck(airframe)
        self.filtered = 0.0
        self._t = math.nan
        self._said = -math.inf
        self._flying = False

    def feed(self, reading: Reading | ControlReading) -> Verdict | None:
        """Take one reading."""
        self._loss.feed(reading)
        if isinstance(reading, FlightReading):
            self._flying = reading.armed is not False and reading.landed is False
        if not isinstance(reading, ControlReading):
            return None
        dt, self._t = reading.t - self._t, reading.t
        if not self._flying or self._loss.boost or dt != dt:
            self.filtered = 0.0
            return None
        self.filtered += (
            dt / (dt + 1.0 / (2.0 * math.pi * YAW_CUTOFF)) * (reading.yaw_integral - self.filtered)
        )
        if abs(self.filtered) > abs(reading.yaw_integral):
            self.filtered = reading.yaw_integral
        if abs(self.filtered) <= YAW_SHARE or reading.t - self._said < YAW_EVERY:
            return None
        self._said = reading.t
        return Verdict(UNNAMED, reading.t)
