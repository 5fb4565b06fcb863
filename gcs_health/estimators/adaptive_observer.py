"""The thesis's adaptive observer: a copy of the rotor that is pulled to the measured speed, and learns eta.

Decentralised, one for each rotor (the form of its hardware test):

    w^'   = (kappa_q i - kappa_tau eta^ w^² - kappa_f w^)/J + K (w - w^)                              (5), (15)
    eta^' = -(P/Gamma)(kappa_tau/J) w^² (w - w^)                                                           (15)

Coupled, x = [w; W] with the body rates W, for comparison: the rates' errors drive eta^ too, by the moments
that each rotor makes (10). It needs inertia and effectiveness of the airframe, and adds nothing.

Where the thesis prints no number, from sheet 3: P = 1, Gamma and K by the poles of the error,
s² + (K + kappa_f/J) s + (P/Gamma) D² w^4 = 0, at the flight's usual speed; K never below what the LMI
(17) asks for, in its closed form (`observer_gains`). kappa_tau may go with w, as the thesis's does since
its current was the battery's. Not the thesis's: the spread of eta^ as its standard deviation.

Source: Melczer (2019), eqs. (5), (8), (10), (15), (17); sheet 3.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.errors import AirframeError
from gcs_health.estimators.observer_gains import least_gain

Array = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True)
class PaperConfig:
    """What the thesis leaves open, and its rule.

    form : "decentralised" or "coupled".
    gain, weight : K [1/s] and Gamma if they are to be fixed; else from bandwidth [rad/s] and damping.
    torque_slope : kappa_tau = torque + slope w [N m s³].
    lost : eta^ below which a propeller counts as lost (its hardware test: below .1).
    """

    form: Literal["decentralised", "coupled"] = "decentralised"
    gain: float | None = None
    weight: float | None = None
    bandwidth: float = 12.0  # rad/s; sheet 3's comparison gains
    damping: float = 0.8
    torque_slope: float = 0.0
    lost: float = 0.1
    step: float = 0.002  # s, of the integration
    gap: float = 0.5  # s after which the observer starts at the measured speed
    top: float = 1.45  # of the usual speed, the bound on w of the Lipschitz constant: 800 at 550 rad/s
    turn: float = 6.0  # rad/s, the bound on body rates likewise; this project
    spread_time: float = 5.0  # s


@dataclass(frozen=True, slots=True)
class MotorModel:
    """The constants (5) needs; SI."""

    torque_constant: float
    torque: float
    friction: float
    inertia: float


def motor_model(airframe: Airframe) -> MotorModel | None:
    """Return the vehicle file's constants; None where one is missing."""
    m = airframe.motor
    if m.torque_constant is None or m.torque is None or m.friction is None or m.inertia is None:
        return None
    return MotorModel(m.torque_constant, m.torque, m.friction, m.inertia)


class Gains:
    """K, Gamma and P = 1 at one speed."""

    def __init__(self, model: MotorModel, config: PaperConfig, level: float, rotors: int = 1) -> None:
        drag = (model.torque + config.torque_slope * level) / model.inertia
        lipschitz = 2.0 * config.top * level  # of w² up to the top speed, eq. (11)
        alpha = math.sqrt(rotors) * lipschitz * drag  # |eta| <= sqrt(n)
        if config.form == "coupled":
            alpha += 2.0 * config.turn  # of the gyroscopic term, a bound
        poles = 2.0 * config.damping * config.bandwidth - model.friction / model.inertia
        bound = least_gain(alpha, model.friction / model.inertia)
        self.gain = config.gain if config.gain is not None else max(poles, 1.05 * bound)
        by_poles = (drag * level**2 / config.bandwidth) ** 2
        self.weight = config.weight if config.weight is not None else by_poles


class RotorObserver:
    """The decentralised observer of one rotor.

    Attributes
    ----------
    speed : w^ [rad/s]. eta : eta^. variance : of eta^ over the last seconds.
    """

    __slots__ = ("_i", "_mean", "_t", "_w", "config", "eta", "model", "speed", "variance")

    def __init__(self, model: MotorModel, config: PaperConfig) -> None:
        self.model = model
        self.config = config
        self.eta = self._mean = 1.0
        self.variance = 0.04
        self.skip()

    def skip(self) -> None:
        """Start from the measured speed next time."""
        self._t = self._w = self._i = self.speed = math.nan

    def sample(self, t: float, w: float, i: float, gains: Gains) -> bool:
        """Take speed and motor current [rad/s, A]; both run straight between samples."""
        dt = t - self._t
        if not 0.0 < dt <= self.config.gap:
            if dt != dt or dt > 0.0 or dt < -self.config.gap:
                self._t, self._w, self._i, self.speed = t, w, i, w
            return False
        m = self.model
        steps = math.ceil(dt / self.config.step - 1e-6)
        h = dt / steps
        x, eta = self.speed, self.eta
        slope = self.config.torque_slope
        push, rub = m.torque_constant / m.inertia, m.friction / m.inertia
        drag, share = m.torque / m.inertia, 1.0 / gains.weight
        for k in range(1, steps + 1):
            part = (k - 0.5) / steps
            now = self._i + part * (i - self._i)
            error = self._w + part * (w - self._w) - x
            load = (drag + slope * x / m.inertia) * x * x
            x += h * (push * now - load * eta - rub * x + gains.gain * error)
            eta -= h * share * load * error
        self._t, self._w, self._i = t, w, i
        self.speed, self.eta = x, eta
        part = dt / (self.config.spread_time + dt)
        off = eta - self._mean
        self._mean += part * off
        self.variance += part * (off * off - self.variance)
        return True


class CoupledObserver:
    """The observer of all rotors and the body rates together, eq. (10).

    Raises
    ------
    AirframeError : the airframe's effectiveness is not known.
    """

    def __init__(self, model: MotorModel, airframe: Airframe, config: PaperConfig) -> None:
        n = len(airframe.rotors)
        self.model = model
        self.config = config
        self.moments = moments(airframe)
        ix, iy, iz = airframe.inertia or (1.0, 1.0, 1.0)
        self._gyroscopic = np.array([(iy - iz) / ix, (iz - ix) / iy, (ix - iy) / iz])
        self.rates = np.full(3, math.nan)
        self._n = n
        self.restart()

    def restart(self) -> None:
        """Begin with healthy rotors."""
        self.eta = np.ones(self._n)
        self._mean = np.ones(self._n)
        self.variance = np.full(self._n, 0.04)
        self.skip()

    def skip(self) -> None:
        """Start from the measured state next time."""
        self._t = math.nan
        self.state = self._y = self._i = np.full(0, math.nan)

    def sample(self, t: float, w: list[float], i: list[float], gains: Gains) -> bool:
        """Take speeds and motor currents of all rotors; `rates` is as last measured."""
        y = np.concatenate((w, self.rates))
        current = np.array(i)
        dt = t - self._t
        if not 0.0 < dt <= self.config.gap:
            if (dt != dt or dt > 0.0 or dt < -self.config.gap) and np.isfinite(y).all():
                self._t, self._y, self._i, self.state = t, y, current, y.copy()
            return False
        n, m, slope = len(w), self.model, self.config.torque_slope
        steps = math.ceil(dt / self.config.step - 1e-6)
        h = dt / steps
        x, eta = self.state, self.eta
        for k in range(1, steps + 1):
            part = (k - 0.5) / steps
            now = self._i + part * (current - self._i)
            error = self._y + part * (y - self._y) - x
            speed, rates = x[:n], x[n:]
            squares = speed * speed
            load = (m.torque + slope * speed) / m.inertia * squares
            turn = self.moments @ (squares * eta)
            turn = turn + self._gyroscopic * rates[[1, 2, 0]] * rates[[2, 0, 1]]
            rise = (m.torque_constant * now - m.friction * speed) / m.inertia - load * eta
            drive = -load * error[:n] + squares * (self.moments.T @ error[n:])
            x = x + h * (np.concatenate((rise, turn)) + gains.gain * error)
            eta = eta + h / gains.weight * drive
        if not (np.isfinite(x).all() and np.isfinite(eta).all()):
            self.skip()
            return False
        self._t, self._y, self._i, self.state, self.eta = t, y, current, x, eta
        part = dt / (self.config.spread_time + dt)
        off = eta - self._mean
        self._mean = self._mean + part * off
        self.variance = self.variance + part * (off * off - self.variance)
        return True


def moments(airframe: Airframe) -> Array:
    """Return (3, n): roll, pitch and yaw acceleration per squared speed of each healthy rotor.

    Raises
    ------
    AirframeError : roll or pitch is not known.
    """
    gains = airframe.effectiveness
    if gains.roll is None or gains.pitch is None:
        raise AirframeError(f"{airframe.name}: the coupled observer needs [effectiveness] roll and pitch")
    x = np.array([rotor.position[0] for rotor in airframe.rotors])
    y = np.array([rotor.position[1] for rotor in airframe.rotors])
    spin = np.array([float(rotor.spin) for rotor in airframe.rotors])
    return np.stack(
        [-gains.roll * y / abs(y).max(), gains.pitch * x / abs(x).max(), (gains.yaw or 0.0) * spin]
    )
