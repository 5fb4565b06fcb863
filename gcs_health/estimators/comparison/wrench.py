"""What the model-based baselines see: body motion against rotor speeds, as one linear system.

    y = [p, q, r - (I_r/I_z) sum s_i w_i, int a_z dt] / scale        u_i = (w_i / w_hover)²
    y' = B diag(u) (1 - gamma) + disturbance                         B (4, n), gamma = loss of each rotor

Each row is scaled by what one rotor is worth in hover at the largest arm, so that B holds numbers of
size one. The system is the survey's (5.36-5.37) with A = 0 and C = I: the motor's lag is not in it,
since rotor speeds are measured. Source: Melczer (2019), 2.1, 4.2, 5.4; sheet 3.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.errors import AirframeError
from gcs_health.estimators.effectiveness_paper import LowPass
from gcs_health.gate import GRAVITY
from gcs_health.samples import FlightReading, ImuReading, Reading, RotorReading

Array = NDArray[np.float64]
SETTLE = 3.0  # s after take-off before a verdict; take-off itself is no flight
GAP = 0.2  # s without IMU after which the past is forgotten
# of y' in rotors' worth, standard deviation: what the filtered acceleration differs by from B u in healthy
# simulated flights of seeds 1 to 4, a quadrotor and a hexacopter, hover and aggressive
DISTURBANCE = np.array([0.06, 0.06, 0.12, 0.4])
CORRELATION = 0.05  # s, of it
NOISE = np.array([0.02, 0.02, 0.02, 0.02])  # of y: rad/s, rad/s, rad/s, m/s


class System(NamedTuple):
    """B (4, n) and the `scale` (4,) of its rows in SI; speeds in units of `hover` [rad/s]."""

    B: Array
    scale: Array
    hover: float
    spin: Array  # (n,)
    yaw_inertia: float  # I_r / I_z [-]


class Motion(NamedTuple):
    """One IMU reading with the rotor speeds of its time: t, step [s], y (4,), speed/hover (n,)."""

    t: float
    dt: float
    y: Array
    w: Array


def system(airframe: Airframe) -> System:
    """Return the model of an airframe whose effectiveness is known.

    Raises
    ------
    AirframeError : gains, spins or arms are missing.
    """
    e = airframe.effectiveness
    if e.roll is None or e.pitch is None or e.thrust is None:
        raise AirframeError(f"{airframe.name}: the baselines must be told the control effectiveness")
    x = np.array([rotor.position[0] for rotor in airframe.rotors])
    y = np.array([rotor.position[1] for rotor in airframe.rotors])
    spin = np.array([float(rotor.spin) for rotor in airframe.rotors])
    if not (abs(x).max() > 0.0 and abs(y).max() > 0.0):
        raise AirframeError(f"{airframe.name}: the rotors need arms in both axes")
    B = np.array([-y / abs(y).max(), x / abs(x).max(), spin, -np.ones(len(x))])
    hover = math.sqrt(GRAVITY / (len(x) * e.thrust))
    gains = np.array([e.roll, e.pitch, e.yaw or 0.0, e.thrust])
    if not gains[2]:
        B[2] = 0.0  # a vehicle without yaw from its rotors
        gains[2] = e.roll
    return System(B, gains * hover**2, hover, spin, e.yaw_inertia or 0.0)


class Wrench:
    """Pairs every IMU reading with the last rotor speeds; silent until the vehicle flies."""

    def __init__(self, airframe: Airframe) -> None:
        self.system = system(airframe)
        self.rotors = len(airframe.rotors)
        self._w = np.full(self.rotors, np.nan)
        self._lift = 0.0  # int a_z dt [m/s]
        self._t = math.nan
        self._flying_since = math.inf

    def ready(self, t: float) -> bool:
        """Whether the vehicle has flown for long enough to be judged at t [s]."""
        return t - self._flying_since > SETTLE

    def feed(self, reading: Reading) -> Motion | None:
        """Take one reading; return the motion with every IMU reading in flight."""
        if isinstance(reading, RotorReading):
            speed = np.array(reading.speed)
            self._w = np.where(np.isfinite(speed), speed / self.system.hover, self._w)
        elif isinstance(reading, FlightReading):
            flies = reading.landed is False and reading.armed is not False
            if not flies:
                self._flying_since = math.inf
            elif self._flying_since == math.inf:
                self._flying_since = reading.t
        elif isinstance(reading, ImuReading):
            return self._imu(reading)
        return None

    def _imu(self, reading: ImuReading) -> Motion | None:
        dt, self._t = reading.t - self._t, reading.t
        if self._flying_since == math.inf or not np.isfinite(self._w).all() or not 0.0 < dt < GAP:
            return None
        s = self.system
        self._lift += dt * reading.az
        yaw = reading.r - s.yaw_inertia * s.hover * float(s.spin @ self._w)
        y = np.array([reading.p, reading.q, yaw, self._lift]) / s.scale
        return Motion(reading.t, dt, y, self._w)


class Filtered(NamedTuple):
    """Equally low-passed signals: t [s], y' (4,), speed/hover (n,) and its derivative [1/s]."""

    t: float
    acceleration: Array
    w: Array
    w_rate: Array


class FilteredWrench:
    """`Wrench` behind the second-order low-pass of Strack van Schijndel and of Smeur, all channels alike."""

    def __init__(self, airframe: Airframe, natural_frequency: float = 50.0, damping: float = 0.55) -> None:
        self.wrench = Wrench(airframe)
        self._filter = LowPass(4 + self.wrench.rotors, natural_frequency, damping)

    def feed(self, reading: Reading) -> Filtered | None:
        """Take one reading; return the filtered signals with every IMU reading in flight."""
        motion = self.wrench.feed(reading)
        if motion is None:
            return None
        low = self._filter
        value = low.feed([*motion.y.tolist(), *motion.w.tolist()], motion.dt)
        return Filtered(motion.t, np.array(low.rate[:4]), np.array(value[4:]), np.array(low.rate[4:]))


def signature(lack: Array, B: Array, u: Array) -> Array:
    """Return (n,) scores: the loss of the one rotor that explains a lack of acceleration best, else 0.

    Parameters
    ----------
    lack : (4,) y' measured less y' modelled [rotors' worth].
    B, u : (4, n), (n,); rotor i's loss gamma shows as -B_i u_i gamma.

    Isolation by direction, weighted by the disturbance of each row; Melczer (2019), 4.3: the model
    whose residual vanishes.
    """
    columns = -(B * u) / DISTURBANCE[:, None]
    d = lack / DISTURBANCE
    along = columns.T @ d
    size = np.sum(columns * columns, axis=0) + 1e-9
    explained = np.where(along > 0.0, along * along / size, 0.0)
    best = int(np.argmax(explained))
    scores = np.zeros(len(u))
    scores[best] = max(along[best], 0.0) / size[best]
    return scores
