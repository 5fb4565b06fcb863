"""The paper mode's plumbing: readings to the thesis's observers, one for each rotor or one for all."""

import math

from gcs_health.airframe import Airframe
from gcs_health.estimators.adaptive_observer import (
    CoupledObserver,
    Gains,
    PaperConfig,
    RotorObserver,
    motor_model,
)
from gcs_health.estimators.rotor_input import FASTEST, MOST_CURRENT, RotorInput
from gcs_health.estimators.rotor_level import LevelConfig, RotorLevel, mean_of_known
from gcs_health.samples import FlightReading, ImuReading, RotorReading

NAN = math.nan
RAN_AWAY = 50.0  # eta^ beyond which an observer is started anew


class PaperObserver:
    """The thesis's observers of one vehicle.

    Attributes
    ----------
    rotor_observers : one for each rotor; empty where the motor's constants are not known.
    coupled : the coupled form, if it was asked for.
    lost : (n,) whether each eta^ is below the thesis's limit.
    """

    def __init__(self, airframe: Airframe, config: PaperConfig, level: LevelConfig) -> None:
        n = len(airframe.rotors)
        self.config = config
        self.inputs = [RotorInput() for _ in range(n)]
        self.level = RotorLevel(level)
        self.model = motor_model(airframe)
        self.rotor_observers: list[RotorObserver] = []
        self.coupled: CoupledObserver | None = None
        if self.model is not None:
            self.rotor_observers = [RotorObserver(self.model, config) for _ in range(n)]
            if config.form == "coupled":
                self.coupled = CoupledObserver(self.model, airframe, config)
        self.lost = [False] * n
        self._seen = [NAN] * n
        self._gains: Gains | None = None
        self._gains_at = 0.0

    def flight(self, reading: FlightReading) -> None:
        """Take what the autopilot says of the flight."""
        if self.level.flight(reading):
            self._begin_anew()

    def imu(self, reading: ImuReading) -> None:
        """Take the body rates, which the coupled form wants."""
        if self.coupled is not None and all([abs(rate) < 1e3 for rate in reading[4:7]]):
            self.coupled.rates[:] = reading[4:7]

    def rotors(self, reading: RotorReading) -> bool:
        """Take speeds and currents; return whether a rotor was lost or found again."""
        t = reading.t
        news = self._take(reading)
        mean = mean_of_known(self._seen)
        if mean == mean and self.level.speeds(t, mean):
            self._begin_anew()
        if self.model is None or not self.level.value > 0.0 or not news:
            return False
        gains = self._tuned(max(self.level.value, mean))
        slowest = self.level.config.turning * self.level.value
        if self.coupled is not None:
            return self._all(t, gains, slowest)
        for k in news:
            observer, given = self.rotor_observers[k], self.inputs[k]
            if given.speed < slowest:
                observer.skip()
            elif observer.sample(t, given.speed, given.current, gains) and not abs(observer.eta) < RAN_AWAY:
                self.rotor_observers[k] = RotorObserver(self.model, self.config)  # ran away
        return self._decide([observer.eta for observer in self.rotor_observers], t)

    def _take(self, reading: RotorReading) -> list[int]:
        """Take speeds and currents; return the rotors that gave both."""
        news = []
        for k, (w, i, u) in enumerate(zip(reading.speed, reading.current, reading.voltage, strict=False)):
            if k < len(self._seen) and 0.0 <= w < FASTEST:
                self._seen[k] = w
                if abs(i) < MOST_CURRENT and self.inputs[k].take(reading.t, w, i, u) > 0.0:
                    news.append(k)
        return news

    def _all(self, t: float, gains: Gains, slowest: float) -> bool:
        assert self.coupled is not None
        if any([given.t != t for given in self.inputs]):  # it wants all rotors at once
            return False
        if min(self._seen) < slowest:
            self.coupled.skip()
            return False
        speeds = [given.speed for given in self.inputs]
        self.coupled.sample(t, speeds, [given.current for given in self.inputs], gains)
        if not max(map(abs, self.coupled.eta.tolist())) < RAN_AWAY:
            self.coupled.restart()
        return self._decide(self.coupled.eta.tolist(), t)

    def _decide(self, etas: list[float], t: float) -> bool:
        lost = [eta < self.config.lost for eta in etas]
        changed = lost != self.lost and self.level.judged(t)
        if self.level.judged(t):
            self.lost = lost
        return changed

    def _tuned(self, level: float) -> Gains:
        """Return the gains at a speed [rad/s]; it must move by a tenth until they follow.

        At a take-off the speed of the moment leads the level: the loop's bandwidth goes with w², and Gamma of an
        idle would let it ring without end.
        """
        assert self.model is not None
        if self._gains is None or not 0.9 * self._gains_at < level < 1.1 * self._gains_at:
            rotors = len(self.inputs) if self.coupled is not None else 1
            self._gains = Gains(self.model, self.config, level, rotors)
            self._gains_at = level
        return self._gains

    def _begin_anew(self) -> None:
        if self.coupled is not None:
            self.coupled.skip()
        for observer in self.rotor_observers:
            observer.skip()

    def value(self, rotor: int) -> tuple[float, float]:
        """Return eta^ and its spread."""
        if self.coupled is not None:
            return float(self.coupled.eta[rotor]), math.sqrt(float(self.coupled.variance[rotor]))
        observer = self.rotor_observers[rotor]
        return observer.eta, math.sqrt(observer.variance)
