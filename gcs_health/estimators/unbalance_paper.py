"""The paper's extended Kalman filter on accelerometer power, with its misprints corrected.

    x_1..x_n, x_{n+1}                 all start at 0
    exp(x_i)     = Delta_i / Delta_0                     (24)   Delta_i = m_u r_u / (m_b kappa_f)
    exp(x_{n+1}) = sqrt(E d²) / sigma_d0                 (25)
    z    = a_x² + a_y²                                   (16)   high-passed at 1 Hz, each axis, before
    b_i  = f_i² exp(2 x_i) Delta_0²,  s = exp(2 x_{n+1}) sigma_d0²
    h    = sum b_i + 2 s                                 (26)
    H_i  = 2 b_i,  H_{n+1} = 4 s                         (30), (31)
    Var  = 4 s² + (sum b_i)² - sum b_i² + 4 s sum b_i    (22)
    R    = Var + r_0                                     (35)   r_0 a variance, m^4/s^8
    P_p  = P + diag(q_D² .. q_D², q_d²) dt               (28)
    K    = P_p H' / (H P_p H' + R)                       (32)   printed without the inverse
    x   <- x + K (z - h),  P <- (I - K H) P_p            (33), (34)

Delta_i f_i is m_u r_u w_i² / m_b: with measured speeds neither mass nor thrust coefficient matters, and the
state is kept in m_u r_u / m_b [m]. Without them the speed is the command's first-order lag (23), scaled so
that the mean of f is m g / n: the estimate is then as good as that scale.

Source: Ghalamchi, Jia, Mueller (2019), eqs. (16)-(35); corrections: sheet 2 sections 2 and 3.
"""

import math

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.estimators.amplitude_model import Array, HighPass
from gcs_health.estimators.unbalance_config import PaperConfig
from gcs_health.gate import GRAVITY

NAN = math.nan
MOST_X = 20.0  # |x| beyond is damage to the stream, not to a propeller
RESTART = 0.1  # s without a sample after which the high-pass begins anew
SCALE_TIME = 10.0  # s over which the scale of the commands is learned
LEAST_COMMAND = 0.05  # [-]; below, motors idle


def measurement(x: Array, start: Array) -> tuple[float, Array, float]:
    """Return h (26), H (30), (31) and the variance (22) of the power.

    With g = start exp(2 x) they are sum g, 2 g, and h² - sum b_i²: (22) with its square completed.

    Parameters
    ----------
    x : (n + 1,) state.
    start : (n + 1,) powers at x = 0: (Delta_0 f_i)² of each rotor, 2 sigma_d0² last [m²/s^4].
    """
    g = start * np.exp(2.0 * x)
    h = float(g.sum())
    b = g[:-1]
    return h, 2.0 * g, h * h - float(b @ b)


class PaperUnbalance:
    """The filter; one step per IMU sample.

    Attributes
    ----------
    x, P : (n + 1,), (n + 1, n + 1) state and covariance.
    flown : seconds of data with known speeds. nis : mean of innovation² / S.
    """

    def __init__(self, airframe: Airframe, config: PaperConfig) -> None:
        n = len(airframe.rotors)
        self.config = c = config
        self.x = np.zeros(n + 1)
        self.P = np.diag(np.append(np.full(n, c.start_std**2), c.noise_std**2))
        self._q = np.append(np.full(n, c.drift**2), c.noise_drift**2)
        self._highpass = HighPass(c.highpass)
        self._start = np.append(np.full(n, NAN), 2.0 * c.noise**2)
        self._unknown = n  # rotors whose speed is not known
        self._lag = np.full(n, NAN)
        self._command = np.full(n, NAN)
        self._mean_square = NAN
        thrust = airframe.effectiveness.thrust
        # squared speed that hovers; where unknown, the commands give the forces only relative to hover
        self._hover_square = GRAVITY / (n * thrust) if thrust else NAN
        self._measured = False
        self._t = NAN
        self.flown = 0.0
        self.nis = NAN

    def speeds(self, speed: Array) -> None:
        """Take measured speeds [rad/s], NaN = nothing new."""
        amplitude = self.config.start * speed * speed
        known = amplitude == amplitude
        self._start[:-1][known] = (amplitude * amplitude)[known]
        self._measured = True
        if self._unknown:
            self._unknown = int(np.isnan(self._start).sum())

    def commands(self, command: Array) -> None:
        """Take commands [-], NaN = not known; used where no speed was ever measured."""
        known = command == command
        self._command[known] = command[known]

    def imu(self, t: float, ax: float, ay: float, flying: bool) -> None:
        """Take one sample; on the ground only the filters run."""
        dt = t - self._t
        if dt <= 0.0:
            return
        if not dt < RESTART:
            self._highpass.restart()
            dt = 0.0
        self._t = t
        a = self._highpass.feed(dt, ax, ay)
        if not self._measured:
            self._follow_commands(dt)
        if not flying or not dt or self._unknown:
            return
        self.flown += dt
        self._update(dt, a.real * a.real + a.imag * a.imag)

    def unbalance(self) -> Array:
        """Return (n,) m_u r_u / m_b [m]."""
        out: Array = self.config.start * np.exp(self.x[:-1])
        return out

    def std(self) -> Array:
        """Return their standard deviations [m], to first order."""
        out: Array = self.unbalance() * np.sqrt(np.maximum(np.diag(self.P)[:-1], 0.0))
        return out

    def _update(self, dt: float, z: float) -> None:
        h, H, variance = measurement(self.x, self._start)
        P = self.P
        P.flat[:: len(H) + 1] += self._q * dt
        PH = P @ H
        S = float(H @ PH) + variance + self.config.extra
        innovation = z - h
        x = self.x + PH * (innovation / S)
        self.x = np.minimum(np.maximum(x, -MOST_X), MOST_X)
        P -= PH[:, None] * (PH / S)  # = (I - K H) P, symmetric as it stands
        nis = innovation * innovation / S
        self.nis = nis if self.nis != self.nis else self.nis + 1e-3 * (nis - self.nis)

    def _follow_commands(self, dt: float) -> None:
        lag = self._lag
        fresh = lag != lag
        lag[fresh] = self._command[fresh]
        lag += (self._command - lag) * (1.0 - math.exp(-dt / self.config.motor_lag))
        if not np.all(lag > LEAST_COMMAND):
            return
        square = lag * lag
        mean = float(square.mean())
        if self._mean_square != self._mean_square:
            self._mean_square = mean
        self._mean_square += (mean - self._mean_square) * min(1.0, dt / SCALE_TIME)
        if self._hover_square == self._hover_square:
            amplitude = self.config.start * self._hover_square * square / self._mean_square
            self._start[:-1] = amplitude * amplitude
            self._unknown = 0
