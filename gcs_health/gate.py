"""When the vehicle flies freely, so that rotors may be judged and baselines learned, or why not.

    w_h = sqrt(g / (n G_az))     hover speed [rad/s]
    e   = -a_z - G_az sum u      upward excess [m/s²]: upward force that the rotors do not explain

A lost rotor only *removes* upward force; ground, hand or net *add* it, so the sign of e is the best
test of contact. Low a_z alone never closes the gate: that is the fault itself, and free fall; idle
rotors show free fall. One stopped rotor is a verdict of its own, hence "two rotors below".

Source: sheet 5 section 3, rules 1-3 and 6; tuned there on `indiflight_*`, `nanodrone_*`, `bebop2_*`.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from operator import mul

GRAVITY = 9.80665  # m/s²


class Closed(StrEnum):
    """Why the gate is closed; the values are those of `estimators.contract.Reason`."""

    ON_GROUND = "on_ground"
    ROTORS_BELOW_HOVER = "rotors_below_hover"
    CONTACT = "contact"
    SETTLING = "settling"
    IMU_STALE = "imu_stale"
    ROTOR_SPEED_STALE = "rotor_speed_stale"
    RATE_TOO_LOW = "rate_too_low"
    EFFECTIVENESS_UNKNOWN = "effectiveness_unknown"


PASSING = (Closed.CONTACT, Closed.ROTORS_BELOW_HOVER)  # what a manoeuvre may do for a moment


@dataclass(frozen=True, slots=True)
class GateConfig:
    """Thresholds of the gate, sheet 5 section 3."""

    open_after: float = 0.5  # s without any reason to be closed
    verdict_after: float = 0.5  # s after the opening
    gust: float = 0.1  # s; a push or slow rotors so short, after
    gust_before: float = 0.5  # s of verdicts, are no landing: then there is but
    gust_after: float = 0.1  # s of either wait; this project
    low_rotor: float = 0.45  # of hover speed
    low_rotor_time: float = 0.06  # s
    low_mean: float = 0.5  # of hover speed
    low_mean_time: float = 0.04  # s
    excess: float = 0.4  # g
    excess_sigmas: float = 4.0
    excess_time: float = 0.03  # s
    excess_memory: float = 5.0  # s
    excess_floor: float = 0.2  # m/s²
    contact: float = 0.8  # g, a single tick
    contact_sigmas: float = 3.0
    contact_hold: float = 0.1  # s
    rotor_age: float = 0.06  # s
    rotor_age_intervals: float = 2.5
    imu_step: float = 0.1  # s


class FlightGate:
    """Fed once a tick; says whether baselines may be learned (`open`) and verdicts given (`verdicts`).

    Attributes
    ----------
    open : rotors turn, nothing pushes, data are fresh, for half a second.
    verdicts : open long enough, and no contact in the last 0.1 s.
    reason : why not, the first that applies; None while verdicts may be given.
    since_open : seconds since the gate opened; 0 while closed.
    after_gust : it was closed for a moment in the midst of flight: what was learned before still holds.
    teaches : open, and as long without a reason to be closed as the usual wait.
    excess_sigma : usual size of e [m/s²].
    mean_speed : of all rotors at the last tick [rad/s].
    """

    def __init__(self, rotors: int, config: GateConfig | None = None) -> None:
        self.config = config or GateConfig()
        self.rotors = rotors
        self.open = False
        self.verdicts = False
        self.reason: Closed | None = Closed.SETTLING
        self.since_open = 0.0
        self.excess_sigma = 2.0
        self.mean_speed = 0.0
        self._clear_since = math.nan
        self._opened_at = math.nan
        self._pushed_at = math.nan  # when a push closed it in the midst of flight
        self.after_gust = False
        self.teaches = False
        self._low_since = [math.nan] * rotors
        self._turning = False  # no rotor was slow at the last tick
        self._recent: deque[tuple[float, float, float]] = deque()  # t, mean speed, e
        self._contact_at = -math.inf
        self._taught = 0.0

    def feed(
        self,
        t: float,
        dt: float,
        speeds: Sequence[float],
        rotor_age: float,
        rotor_interval: float,
        az: float,
        thrust: float,
        blocked: Closed | None = None,
    ) -> bool:
        """Take one tick; return whether the gate is open.

        Parameters
        ----------
        t, dt : time of the tick and since the last one [s].
        speeds : (n,) rotor speeds at t [rad/s].
        rotor_age, rotor_interval : age of the oldest rotor's last sample, usual time between samples [s].
        az : vertical specific force [m/s²], about -9.8 in hover.
        thrust : G_az [(m/s²)/(rad/s)²].
        blocked : a reason of the caller's to keep it closed.
        """
        c = self.config
        mean = self.mean_speed = sum(speeds) / self.rotors
        excess = -az - thrust * sum(map(mul, speeds, speeds))
        hover = math.sqrt(GRAVITY / (self.rotors * thrust)) if thrust > 0.0 else math.inf
        recent = self._recent
        recent.append((t, mean, excess))
        while t - recent[0][0] > c.low_mean_time:
            recent.popleft()
        low = self._speeds_low(t, speeds, hover, recent)
        speeds_low = low is not None
        reason = blocked or low
        if reason is None and dt > c.imu_step:
            reason = Closed.IMU_STALE
        late = rotor_age - dt
        if reason is None and late > c.rotor_age and late > self.rotor_age_limit(rotor_interval):
            reason = Closed.ROTOR_SPEED_STALE
        if reason is None:
            reason = self._pushed(t, recent)
        if reason is not None:
            if self.open:
                flew = self.since_open >= c.verdict_after + c.gust_before
                self._pushed_at = t if flew and reason in PASSING else math.nan
            self.close(reason)
        else:
            self._go_on(t)
        self._watch_contact(t, dt, excess, speeds_low)
        if not self.open:
            self.verdicts = False
            return False
        wait = c.gust_after if self.after_gust else c.verdict_after
        settled, free = self.since_open >= wait, t - self._contact_at >= c.contact_hold
        self.verdicts = settled and free
        self.reason = None if self.verdicts else Closed.CONTACT if settled else Closed.SETTLING
        return True

    def close(self, reason: Closed) -> None:
        """Close it at once; it opens again as usual."""
        self.open = self.verdicts = self.teaches = False
        self.reason = reason
        self.since_open = 0.0
        self._clear_since = math.nan

    def rotor_age_limit(self, interval: float) -> float:
        """Return the oldest rotor speed that is not stale [s]."""
        c = self.config
        usual = c.rotor_age_intervals * interval
        return usual if usual > c.rotor_age else c.rotor_age

    def _speeds_low(
        self, t: float, speeds: Sequence[float], hover: float, recent: deque[tuple[float, float, float]]
    ) -> Closed | None:
        c = self.config
        low = 0
        limit = c.low_rotor * hover
        turning = min(speeds) >= limit
        if not (turning and self._turning):  # by far the most ticks have no slow rotor
            low = self._slow_rotors(t, speeds, limit)
        self._turning = turning
        mean = 0.0
        for entry in recent:
            mean += entry[1]
        mean /= len(recent)
        if low >= 2 or mean < c.low_mean * hover:
            return Closed.ON_GROUND if mean < 0.1 * hover else Closed.ROTORS_BELOW_HOVER
        return None

    def _slow_rotors(self, t: float, speeds: Sequence[float], limit: float) -> int:
        """Return how many rotors have been slower than the limit [rad/s] for long."""
        low = 0
        for i in range(self.rotors):
            if speeds[i] < limit:
                since = self._low_since[i]
                if since != since:
                    self._low_since[i] = since = t
                if t - since >= self.config.low_rotor_time:
                    low += 1
            else:
                self._low_since[i] = math.nan
        return low

    def _pushed(self, t: float, recent: deque[tuple[float, float, float]]) -> Closed | None:
        c = self.config
        total = 0.0
        count = 0
        for entry in reversed(recent):
            if t - entry[0] > c.excess_time:
                break
            total += entry[2]
            count += 1
        if total <= c.excess * GRAVITY * count:
            return None
        return Closed.CONTACT if total > c.excess_sigmas * self.excess_sigma * count else None

    def _go_on(self, t: float) -> None:
        """Open, or stay open: nothing speaks against it."""
        c = self.config
        if not self._clear_since <= t:  # NaN: just became clear
            self._clear_since = t
            self.after_gust = t - self._pushed_at <= c.gust
        clear = t - self._clear_since
        self.teaches = clear >= c.open_after
        if not self.open and clear >= (c.gust_after if self.after_gust else c.open_after):
            self.open = True
            self._opened_at = t
        self.since_open = t - self._opened_at if self.open else 0.0
        if not self.open:
            self.reason = Closed.SETTLING

    def _watch_contact(self, t: float, dt: float, excess: float, speeds_low: bool) -> None:
        c = self.config
        sigma = self.excess_sigma
        if excess > c.contact * GRAVITY and excess > c.contact_sigmas * sigma:
            self._contact_at = t
        if speeds_low or not (self.open or excess < 0.0):
            return  # noise has both signs, contact only one: while closed, the free sign alone teaches
        variance = sigma * sigma
        square = min(excess * excess, 9.0 * variance)
        self._taught += dt
        memory = self._taught if self._taught < c.excess_memory else c.excess_memory
        gain = dt / memory if memory > 10.0 * dt else 0.1
        sigma = math.sqrt(variance + gain * (square - variance))
        self.excess_sigma = sigma if sigma > c.excess_floor else c.excess_floor
