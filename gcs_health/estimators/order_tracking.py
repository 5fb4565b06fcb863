"""The accelerometer as each rotor sees it: blocks of samples turned with the rotor's phase, their powers.

    a         = a_x + j a_y, high-passed                     body axes forward, right
    theta_i   = sigma_i int w_i dt                            sigma = +1 clockwise from above
    Y_i       = sum_k w_k exp(-j theta_i(k)) a_k              Hann weights of sum 1 over one block
    Gamma_il  = sum_k w_k exp(-j theta_i(k)) g_l(k) exp(j theta_l(k))
    E|Y_i|²   = sum_l |Gamma_il|² s_l + nu sum_k w_k²         s_l = (m_u r_u / m_b)² of rotor l [m²]

Two further rows per rotor lie +-3.5 bins beside its track: the *local* noise floor. Opposite handedness
turns the other way in this plane, so it is separable even at equal speed; only phase differences within a
block matter, so that an error of the speeds counts over one block only.

With all spin signs flipped every Gamma becomes its conjugate and |Gamma|² stays: only Y is taken twice.

Source: sheet 2 section 5.
"""

import math
from bisect import bisect_left
from itertools import pairwise
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.estimators.amplitude_model import Array, HighPass, ImuFilter, highpass_gain

Complex = NDArray[np.complex128]
SINGLE = np.float32  # rows are kept for 20 s, and no power is known to seven digits
Single = NDArray[np.float32]

SHIFT_BINS = 3.5  # of the noise rows, in 1 / block length
HOLES = 0.6  # share of the usual samples that a stretch must have
RESTART = 0.1  # s without a sample after which the high-pass begins anew
MOST_SAMPLES = 4096  # of a stretch; more is no IMU


class Stretch(NamedTuple):
    """What came of one stretch of samples.

    Attributes
    ----------
    t : its end [s].
    speed : (n,) mean rotor speeds [rad/s].
    slowest : lowest speed of any rotor [rad/s].
    gain : (n,) |H_ap H_hp| at the mean speeds [-].
    rows : per block length (m, n + 3): the equations, each |Gamma|² [1/s⁴] of every rotor, |Y|² [(m/s²)²] with
        the spin signs as given and flipped, the sum of the squared weights [-].
    """

    t: float
    speed: Array
    slowest: float
    gain: Array
    rows: tuple[Single, ...]


class SpeedTrack:
    """One rotor's speed samples around the present stretch, and its phase between them."""

    def __init__(self) -> None:
        self.t: list[float] = []
        self.w: list[float] = []

    def add(self, t: float, w: float) -> None:
        """Take a speed [rad/s]; samples must come in order, later ones of the same time are dropped."""
        if not self.t or t > self.t[-1]:
            self.t.append(t)
            self.w.append(w)

    def forget(self, before: float) -> None:
        """Keep one sample at or before that time [s], and all after."""
        keep = len(self.t)
        while keep > 1 and self.t[keep - 1] > before:
            keep -= 1
        del self.t[: keep - 1], self.w[: keep - 1]

    def widest_gap(self, start: float, end: float) -> float:
        """Return the longest time without a sample within [start, end]; infinite if an end is not covered."""
        t = self.t
        if not t or t[0] > start or t[-1] < end:
            return math.inf
        return max([b - a for a, b in pairwise(t) if b >= start and a <= end], default=math.inf)

    def phase(self, times: Array) -> tuple[Array, Array]:
        """Return the angle [rad] since the first sample and the speed [rad/s]; speeds are linear between.

        Every time must lie between two samples.
        """
        t, w = np.array(self.t), np.array(self.w)
        step = np.diff(t)
        turned = np.concatenate(([0.0], np.cumsum(0.5 * step * (w[1:] + w[:-1]))))
        at = np.searchsorted(t, times, side="right") - 1
        since = times - t[at]
        slope = (np.diff(w) / step)[at]
        return turned[at] + since * (w[at] + 0.5 * slope * since), w[at] + slope * since


class OrderTracker:
    """Samples in, stretches out; a stretch is cut into blocks of several lengths.

    Parameters
    ----------
    spins : (n,) the airframe's, +1 counter-clockwise seen from above.
    lengths : block lengths [s]; the longest is a stretch, the others divide it.
    corner : of the high-pass [Hz]. corner_filtered : likewise behind a low-pass.
    wait : for the speeds that bracket a stretch's end [s].
    widest_gap : between a rotor's speed samples [s].

    Attributes
    ----------
    step : usual time between IMU samples [s]. interval : between speed samples, of the slowest rotor [s].
    filter : what the samples passed on board.
    dropped : stretches that were not used, for want of samples or of speeds.
    """

    def __init__(
        self,
        spins: tuple[int, ...],
        lengths: tuple[float, ...],
        corner: float,
        corner_filtered: float,
        wait: float,
        widest_gap: float,
    ) -> None:
        self.lengths = lengths
        self.stretch = max(lengths)
        self.step = self.interval = math.nan
        self.filter = ImuFilter()
        self.dropped = 0
        self._sign = -np.array(spins, dtype=float)[:, None]  # clockwise is positive about z down
        self._corners = (corner, corner_filtered)
        self._wait = wait
        self._widest_gap = widest_gap
        self.tracks = [SpeedTrack() for _ in spins]
        self._highpass = HighPass(corner)
        self._t: list[float] = []
        self._a: list[complex] = []  # not yet high-passed
        self._taken = -math.inf  # time of the last sample that was [s]
        self._last = math.nan
        self._end = math.nan

    def set_filter(self, new: ImuFilter) -> None:
        """Take what is said of the filter on board; what went before had another: it begins anew."""
        if repr(new) != repr(self.filter):
            self.filter = new
            self._highpass = HighPass(self._corners[1] if new.cutoff == new.cutoff else self._corners[0])
            self._start_over()

    def imu(self, t: float, ax: float, ay: float) -> bool:
        """Take one sample; return whether a stretch is due (`take`)."""
        dt = t - self._last
        if not 0.0 < dt < RESTART:
            if dt <= 0.0:
                return False
            if not dt < self.stretch:
                self._start_over()
                self._end = t + self.stretch
        self._last = t
        self._t.append(t)
        self._a.append(complex(ax, ay))
        return t >= self._end + self._wait or len(self._t) > MOST_SAMPLES

    def blank(self) -> Stretch:
        """Return a stretch that says nothing, of the size of one that does."""
        n = len(self.tracks)
        none = np.zeros(n)
        blocks = [round(self.stretch / length) for length in self.lengths]
        rows = tuple([np.zeros((3 * n * count, n + 3), SINGLE) for count in blocks])
        return Stretch(-math.inf, none, 0.0, none, rows)

    def take(self) -> Stretch | None:
        """Return the stretch that is due, None if it cannot be used; the next one begins at its end."""
        end, start = self._end, self._end - self.stretch
        count = bisect_left(self._t, end)
        times, samples = np.array(self._t[:count]), self._a[:count]
        del self._t[:count], self._a[:count]
        passed: list[complex] = []
        if count:
            steps = np.diff(times, prepend=self._taken)
            steps[~(steps < RESTART)] = math.inf
            passed = self._highpass.block(steps.tolist(), samples)
            self._taken = float(times[-1])
        self._end = end + self.stretch
        if self._t and self._t[-1] > self._end + self.stretch + self._wait:
            self._start_over()
        gaps = [track.widest_gap(start, end) for track in self.tracks]
        made = None
        if count > 8:
            self.step = median(steps[1:].tolist())
            self.interval = max(gaps)
            if max(gaps) <= self._widest_gap and self.step * count > HOLES * self.stretch:
                made = self._stretch(times, np.array(passed), start)
        self.dropped += made is None
        for track in self.tracks:
            track.forget(end)
        return made

    def _start_over(self) -> None:
        self._t.clear()
        self._a.clear()
        self._end = self._last + self.stretch
        self._taken = -math.inf
        self._highpass.restart()

    def _stretch(self, times: Array, a: Complex, start: float) -> Stretch:
        turned = [track.phase(times) for track in self.tracks]
        speed = np.array([w for _, w in turned])
        gain = self.filter.gain(speed) * highpass_gain(speed, self._highpass.corner, self.step)
        turn = np.exp(1j * (self._sign * np.array([angle for angle, _ in turned])))
        # a product with a's conjugate has the power of a with all spins flipped
        seen = np.concatenate((speed * speed * gain * turn, a[None], np.conj(a)[None])).T.copy()
        rows = tuple([self._rows(times - start, np.conj(turn), seen, length) for length in self.lengths])
        return Stretch(start + self.stretch, speed.mean(axis=1), float(speed.min()), gain.mean(axis=1), rows)

    def _rows(self, since: Array, back: Complex, seen: Complex, length: float) -> Single:
        """Return the rows of all blocks of one length."""
        n, blocks = len(back), round(self.stretch / length)
        hann = 1.0 - np.cos((2.0 * math.pi / length) * since)
        aside = np.exp((-2j * math.pi * SHIFT_BINS / length) * since)
        window = hann * np.array((np.ones(len(since)), aside, np.conj(aside)))
        turned = (window[:, None, :] * back).reshape(3 * n, -1)
        edges = np.searchsorted(since, np.arange(blocks + 1) * length).tolist()
        sums, noise = [np.zeros((0, n + 2), complex)], []
        for first, last in pairwise(edges):
            if last - first < 8:
                continue
            weights = hann[first:last]
            total = float(weights.sum())
            sums.append(turned[:, first:last] @ seen[first:last] / total)
            noise.append(float(weights @ weights) / (total * total))
        made = np.concatenate(sums)
        rows = np.empty((len(made), n + 3), SINGLE)
        rows[:, : n + 2] = made.real**2 + made.imag**2
        rows[:, n + 2] = np.repeat(noise, 3 * n)
        return rows
