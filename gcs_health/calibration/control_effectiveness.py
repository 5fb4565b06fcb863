"""What one healthy rotor does to the vehicle: from the vehicle file, or learned in flight.

    l_i = -y_i / max|y|,  m_i = x_i / max|x|     signed, normalised arms
    G_p, G_q, G_r   angular acceleration per squared speed      (roll, pitch, yaw)
    I_r/I_z         yaw acceleration per rotor acceleration
    G_az            specific force per squared speed            (thrust)

*Thrust* is learned on the level: hover alone suffices. Ground and hand add upward force, so the ratio
-a_z / sum u only ever errs high before take-off: it is believed once a_z also *follows* sum u with the
same slope, which it does in the air alone, or once the autopilot says that it flies.

*Roll, pitch, yaw* are learned from changes. In closed loop plain regression is biased low and the
inverse regression high, so their geometric mean is taken, in logarithms, and weighed by their distance
against the prior: hover alone teaches nothing and changes nothing.

Source: Strack van Schijndel et al. (2023) section III-C; sheet 1 section 6; sheet 5 section 1.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.gate import GRAVITY

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EffectivenessPrior:
    """What is assumed of a vehicle that nobody has measured.

    A rotor at the largest arm b about an axis turns the vehicle in hover with (g / n) b / (k L²), where L is the
    longest arm and k L² the squared radius of gyration. The more rotors, the more of the mass sits in the middle:
    n k = .84 .. 1.7 over the three quadrotors of sheet 5 section 1 and .73 .. 1.3 over the hexacopters of the papers
    (Ghalamchi 2019 Table I, Dutta 2023, Melczer 2019).
    """

    gyration: float = 1.1  # n k [-]
    unscaled: float = 160.0  # rad/s², divided by the rotor count, where positions have no scale
    spread: float = 0.5  # standard deviation of the logarithm
    bounds: tuple[float, float] = (0.4, 2.5)
    memory: float = 20.0  # s, of what is learned
    high_pass: float = 1.0  # s
    block: float = 0.02  # s, averaging before the regression
    least_r2: float = 0.1
    least_time: float = 2.0  # s of changes before they teach; this project
    apart: float = 0.1  # s between independent samples of manoeuvres; this project
    level_block: float = 0.03  # s, averaging before the level
    level_memory: float = 20.0  # s
    level_settle: float = 1.0  # s


class ControlEffectiveness:
    """The five gains, given or learned. `known` says whether thrust, without which all stops, is."""

    def __init__(self, airframe: Airframe, prior: EffectivenessPrior | None = None) -> None:
        self.prior = prior or EffectivenessPrior()
        rotors = airframe.rotors
        self.rotors = len(rotors)
        self.hover = math.inf  # speed [rad/s]; infinite while thrust is not known
        given = airframe.effectiveness
        reach_x = max(abs(rotor.position[0]) for rotor in rotors)
        reach_y = max(abs(rotor.position[1]) for rotor in rotors)
        self.roll_arm = [-rotor.position[1] / reach_y if reach_y > 0.0 else 0.0 for rotor in rotors]
        self.pitch_arm = [rotor.position[0] / reach_x if reach_x > 0.0 else 0.0 for rotor in rotors]
        self.spin = [float(rotor.spin) for rotor in rotors]
        self.thrust_given = given.thrust is not None
        self.given = (given.roll, given.pitch, given.yaw)
        self.has_yaw = bool(given.yaw) and all(self.spin)  # the yaw row is used
        self.yaw_inertia = given.yaw_inertia or 0.0
        self.thrust = given.thrust or 0.0
        self._in_hover = self._priors(airframe, reach_x, reach_y)
        self._scale = [1.0, 1.0]  # learned over prior, roll and pitch
        # relative standard deviations of roll and pitch
        spread = self.prior.spread
        self.doubt = (0.0 if given.roll else spread, 0.0 if given.pitch else spread)
        self._airborne = False
        self._level = Level(self.prior)
        self._gathered = self._az = self._squares = 0.0  # s, and a_z and sum u times s
        self._apply()

    @property
    def known(self) -> bool:
        """Whether verdicts can be given: thrust is given or learned."""
        return self.thrust > 0.0

    @property
    def learns(self) -> bool:
        """Whether any of roll, pitch or thrust is left to learn."""
        return not (self.thrust_given and self.given[0] and self.given[1])

    def _priors(self, airframe: Airframe, reach_x: float, reach_y: float) -> tuple[float, float]:
        """Return roll and pitch acceleration of one rotor in hover [rad/s²]."""
        out = []
        arm = max(math.hypot(rotor.position[0], rotor.position[1]) for rotor in airframe.rotors)
        for axis, reach in ((0, reach_y), (1, reach_x)):
            if airframe.metric and reach > 0.0:
                if airframe.mass and airframe.inertia:
                    weight = airframe.mass * GRAVITY / self.rotors
                    out.append(weight * reach / airframe.inertia[axis])
                else:
                    out.append(GRAVITY * reach / (self.prior.gyration * arm * arm))
            else:
                out.append(self.prior.unscaled / self.rotors)
        return out[0], out[1]

    def _apply(self) -> None:
        hover_u = GRAVITY / (self.rotors * self.thrust) if self.thrust > 0.0 else math.inf
        self.hover = math.sqrt(hover_u)
        roll = self.given[0] or self._in_hover[0] * self._scale[0] / hover_u
        pitch = self.given[1] or self._in_hover[1] * self._scale[1] / hover_u
        self.roll = [roll * arm for arm in self.roll_arm]
        self.pitch = [pitch * arm for arm in self.pitch_arm]
        yaw = self.given[2] if self.has_yaw and self.given[2] else 0.0
        self.yaw = [yaw * spin for spin in self.spin]
        # rows roll, pitch, yaw, a_z of every rotor: the columns of the model per squared speed
        self.matrix: Array = np.array([self.roll, self.pitch, self.yaw, [-self.thrust] * self.rotors])

    def set_airborne(self, airborne: bool) -> None:
        """Take the autopilot's word that the vehicle flies."""
        self._airborne = airborne

    def learn_thrust(self, dt: float, az: float, squares: float) -> None:
        """Take one tick of a_z [m/s²] and sum u [(rad/s)²]; any tick, the level sorts them out."""
        if self.thrust_given:
            return
        dt = min(dt, 0.1)
        self._gathered += dt
        self._az += dt * az
        self._squares += dt * squares
        length = self._gathered
        if length < self.prior.level_block:
            return
        az, squares = self._az / length, self._squares / length
        self._gathered = self._az = self._squares = 0.0
        if self._level.feed(length, az, squares, self._airborne):
            learned = self._level.thrust
            if abs(learned - self.thrust) > 1e-3 * self.thrust or learned == 0.0:
                self.thrust = learned
                self._apply()

    def learn_moments(self, roll: tuple[float, float], pitch: tuple[float, float], time: float) -> None:
        """Take (direct, R²) of measured on presently predicted acceleration, roll and pitch, of `time` s."""
        if time < self.prior.least_time:
            return
        doubt = list(self.doubt)
        for axis, (slope, r2) in enumerate((roll, pitch)):
            if self.given[axis] or r2 < self.prior.least_r2 or slope <= 0.0:
                continue
            gap = -0.5 * math.log(min(r2, 0.999))  # half the distance of direct and inverse
            learned = math.log(slope) + gap + math.log(self._scale[axis])
            spread = self.prior.spread
            chance = (1.0 - r2) / r2 * self.prior.apart / time  # variance of the logarithm of the slope
            weight = spread * spread / (spread * spread + gap * gap + chance + 1e-3)
            doubt[axis] = spread * math.sqrt(1.0 - weight)
            low, high = self.prior.bounds
            self._scale[axis] = min(max(math.exp(weight * learned), low), high)
        self.doubt = (doubt[0], doubt[1])
        self._apply()


class Level:
    """Thrust per squared speed from the level of a_z, believed once a_z follows the rotors."""

    def __init__(self, prior: EffectivenessPrior) -> None:
        self.prior = prior
        self.thrust = 0.0
        self._time = 0.0
        self._steady = math.inf  # lowest ratio so far
        self._sums = [0.0, 0.0]  # a u, u u on the level
        self._high = [0.0, 0.0, 0.0]  # xx, xy, yy of the high-passed 0.1 s means
        self._fast = [0.0, 0.0]
        self._slow = [0.0, 0.0]
        self._half = [0.0, 0.0]  # 0.5 s means
        self._flown = 0.0

    def feed(self, dt: float, az: float, squares: float, airborne: bool) -> bool:
        """Take one tick; return whether `thrust` moved."""
        if squares <= 0.0 or not az < 0.0:
            return False
        x, y, ratio = self._filter(dt, az, squares)
        if self._time < 0.5:
            return False
        if ratio < 0.75 * self._steady < math.inf:
            self._forget(ratio)
            return True
        if ratio > 1.25 * self._steady:
            return False  # something pushes up
        self._follow_level(dt, ratio)
        keep = math.exp(-dt / self.prior.level_memory)
        self._sums[0] = keep * self._sums[0] - az * squares * dt
        self._sums[1] = keep * self._sums[1] + squares * squares * dt
        for k, value in enumerate((x * x, x * y, y * y)):
            self._high[k] = keep * self._high[k] + value * dt
        level = self._sums[0] / self._sums[1]
        if airborne or self._follows(level):
            self._flown += dt
        if self._flown < self.prior.level_settle:
            return False
        self.thrust = level
        return True

    def _filter(self, dt: float, az: float, squares: float) -> tuple[float, float, float]:
        """Return the changes of squares and -a_z within the last second, and the ratio of their levels."""
        self._time += dt
        first = self._time == dt
        fast = min(1.0, dt / 0.1)
        half = min(1.0, dt / 0.5)
        slow = min(1.0, dt / self.prior.high_pass)
        for k, value in enumerate((squares, -az)):
            if first:
                self._fast[k] = self._half[k] = self._slow[k] = value
            self._fast[k] += fast * (value - self._fast[k])
            self._half[k] += half * (value - self._half[k])
            self._slow[k] += slow * (value - self._slow[k])
        return (
            self._fast[0] - self._slow[0],
            self._fast[1] - self._slow[1],
            self._half[1] / self._half[0],
        )

    def _forget(self, ratio: float) -> None:
        """Start over: far more lift than thought possible, so what was learned was the ground's."""
        self._sums = [0.0, 0.0]
        self._high = [0.0, 0.0, 0.0]
        self._slow = list(self._fast)
        self._flown = self._time = 0.0
        self._steady = ratio
        self.thrust = 0.0

    def _follow_level(self, dt: float, ratio: float) -> None:
        """Follow the ratio down at once, for what the ground adds comes off; up slowly."""
        if self._steady == math.inf:
            self._steady = ratio
        time = 0.3 if ratio < self._steady else self.prior.level_memory
        self._steady += min(1.0, dt / time) * (ratio - self._steady)

    def _follows(self, level: float) -> bool:
        xx, xy, yy = self._high
        if xx <= 0.0:
            return False
        slope = xy / xx
        if not 0.5 * level < slope < 1.6 * level or yy <= 0.0:
            return False
        r2 = min(xy * xy / (xx * yy), 0.999)
        return r2 > 0.1 and r2 / (1.0 - r2) * self._time / 0.2 > 12.0


class MomentRegression:
    """Regression of roll and pitch acceleration on every rotor's squared speed, from changes.

    One matrix serves three questions: how large the gains are (`axis`), and whether the rotors answer
    where the geometry puts them (`calibration.geometry_check`).
    """

    def __init__(self, rotors: int, prior: EffectivenessPrior | None = None) -> None:
        self.prior = prior or EffectivenessPrior()
        self.rotors = rotors
        size = rotors + 2
        self.time = 0.0  # effective time of data [s]
        self.moments: Array = np.zeros((size, size))  # of (u_1 .. u_n, y_p, y_q), weighted by time and age
        self._mean: Array | None = None

    def feed(self, dt: Array, squares: Array, measured: Array) -> None:
        """Take k ticks: lengths (k,), mean squared speeds over each (k, n), measured roll and pitch (k, 2)."""
        values = np.concatenate((squares, measured), axis=1)
        length = float(np.add.reduce(dt))
        group = min(
            len(dt), max(1, math.ceil(self.prior.block * len(dt) / length - 0.01))
        )  # ticks of a block
        odd = len(dt) % group
        if group > 1:
            values = np.add.reduce(values[odd:].reshape(-1, group, self.rotors + 2), axis=1) / group
        mean = np.add.reduce(values) / len(values)
        if self._mean is None:
            self._mean = mean
        self._mean = self._mean + min(1.0, length / self.prior.high_pass) * (mean - self._mean)
        values = values - self._mean
        keep = math.exp(-length / self.prior.memory)
        self.time = keep * self.time + length
        self.moments = keep * self.moments + (length / len(values)) * (values.T @ values)

    def axis(self, row: int, gains: list[float]) -> tuple[float, float]:
        """Return (slope, R²) of measured on predicted acceleration; row 0 roll, 1 pitch."""
        n = self.rotors
        h = np.array(gains)
        xx = float(h @ self.moments[:n, :n] @ h)
        xy = float(h @ self.moments[:n, n + row])
        yy = float(self.moments[n + row, n + row])
        if xx <= 0.0 or yy <= 0.0:
            return 0.0, 0.0
        return xy / xx, xy * xy / (xx * yy)
