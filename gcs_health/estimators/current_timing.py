"""How an ESC's current lies in time against its speed: of the moment, a mean since the last, or behind a lag.

A filtered current held against an unfiltered speed shows every manoeuvre as a fault. The remedy is to put w and
w² through the same first-order lag as the current went through; which lag (or mean) it was is what leaves
the least residual of the torque balance in healthy flight.

Source: sheet 3, recommended mode, step 2; that a mean over the interval is told apart is this project's.
"""

import math
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Timing(NamedTuple):
    """`mean`: each current is the mean since the last one. `lag`: of a first-order filter before it [s]."""

    mean: bool = False
    lag: float = 0.0


SNAPSHOT = Timing()


@dataclass(frozen=True, slots=True)
class TimingConfig:
    """How the timing is found; this project's figures."""

    lags: tuple[float, ...] = (0.010, 0.020, 0.028, 0.040, 0.056, 0.080)  # s
    shortest_lag: float = 0.5  # of the usual interval; shorter ones cannot be seen
    slow: float = 0.05  # s; between readings that far apart a lag cannot be told from a mean
    mean_margin: float = 0.1  # by which a mean may be worse there: taken for one, snapshots are far worse
    block: float = 3.0  # s
    samples: tuple[int, int] = (24, 512)  # of a block, least and most
    blocks: int = 2  # of every rotor until it is decided
    gain: float = 0.25  # in the logarithm of the residual's variance, against a current of the moment
    interval: float = 0.010  # s, the shortest over which the balance is made


class Lag:
    """First-order lag of a speed and its square, exact for signals that run straight between irregular samples."""

    __slots__ = ("lagged_squares", "lagged_w", "squares", "tau", "w")

    def __init__(self, tau: float, w: float, squares: float) -> None:
        self.tau = tau
        self.w = self.lagged_w = w
        self.squares = self.lagged_squares = squares

    def step(self, dt: float, w: float, squares: float) -> tuple[float, float]:
        """Return both filtered at the end of a step of dt [s] from the last inputs to these."""
        left = math.exp(-dt / self.tau)
        straight = 1.0 - self.tau * (1.0 - left) / dt
        was, squares_was = self.w, self.squares
        self.lagged_w = y = left * self.lagged_w + (1.0 - left) * was + straight * (w - was)
        self.lagged_squares = z = (
            left * self.lagged_squares + (1.0 - left) * squares_was + straight * (squares - squares_was)
        )
        self.w, self.squares = w, squares
        return y, z


class CurrentTiming:
    """Tries the candidates on blocks of flight, then decides once.

    Attributes
    ----------
    decided : the timing, None until enough of the flight was seen.
    speed_step : quantum of the rotor speeds [rad/s], 0 where none shows.
    """

    def __init__(self, rotors: int, config: TimingConfig) -> None:
        self.config = config
        self.decided: Timing | None = None
        self.speed_step = 0.0
        self._blocks: list[list[tuple[float, float, float]]] = [[] for _ in range(rotors)]
        self._scores: list[dict[Timing, float]] = []

    def note(self, rotor: int, t: float, w: float, i: float) -> bool:
        """Take a sample of steady or unsteady flight; return whether the timing was decided with it."""
        block = self._blocks[rotor]
        if block and not 0.0 < t - block[-1][0] < 0.5:
            block.clear()
        block.append((t, w, i))
        least, most = self.config.samples
        if len(block) < least or (t - block[0][0] < self.config.block and len(block) < most):
            return False
        self._judge(np.array(block))
        block.clear()
        return self._decide()

    def _judge(self, block: Array) -> None:
        t, w, i = block.T
        usual = median(np.diff(t).tolist())
        candidates = [SNAPSHOT, Timing(mean=True)]
        if usual < self.config.slow:
            least = self.config.shortest_lag * usual
            candidates += [Timing(lag=lag) for lag in self.config.lags if lag >= least]
        self._scores.append({each: self._residual(t, w, i, each) for each in candidates})
        self.speed_step = max(self.speed_step, quantum(w))

    def _residual(self, t: Array, w: Array, i: Array, timing: Timing) -> float:
        """Return the logarithm of what variance the best balance under this timing leaves [A²]."""
        dt = np.diff(t)
        squares = w * w
        if timing.lag:
            w, squares = lagged(t, w, timing.lag)
        every = max(1, math.ceil(self.config.interval / median(dt.tolist())))
        charge = i[1:] * dt if timing.mean else 0.5 * (i[1:] + i[:-1]) * dt
        columns = []
        for steps in (charge, 0.5 * (squares[1:] + squares[:-1]) * dt, 0.5 * (w[1:] + w[:-1]) * dt):
            columns.append(np.diff(np.concatenate(([0.0], np.cumsum(steps)))[::every]))
        span = np.diff(t[::every])
        y = columns[0] / span
        x = np.stack([columns[1] / span, columns[2] / span, np.diff(w[::every]) / span], axis=1)
        x = x / np.maximum(np.abs(x).max(axis=0), 1e-9)
        solution = np.linalg.lstsq(x, y, rcond=1e-6)[0]
        left = y - x @ solution
        return math.log(float(left @ left) / max(len(y) - 3, 1) + 1e-6)

    def _decide(self) -> bool:
        c = self.config
        if self.decided is not None or len(self._scores) < c.blocks * len(self._blocks):
            return False
        common = set.intersection(*[set(scores) for scores in self._scores])
        mean = {each: float(np.mean([scores[each] for scores in self._scores])) for each in common}
        best = min(sorted(common), key=lambda each: mean[each])
        if len(common) == 2:  # snapshots or means, at a slow rate
            best = max(sorted(common))
            self.decided = best if mean[best] < mean[SNAPSHOT] + c.mean_margin else SNAPSHOT
        else:
            self.decided = best if mean[best] < mean[SNAPSHOT] - c.gain else SNAPSHOT
        self._blocks = [[] for _ in self._blocks]
        self._scores.clear()
        return True


def lagged(t: Array, w: Array, tau: float) -> tuple[Array, Array]:
    """Return w(t) and its square behind a first-order lag `tau` [s]."""
    dt, both = np.diff(t), w + 1j * (w * w)  # as `Lag` has them, the square as the imaginary part
    left = np.exp(-dt / tau)
    push = (1.0 - left) * both[:-1] + (1.0 - tau * (1.0 - left) / dt) * np.diff(both)
    y = complex(both[0])
    out = [y]
    for keep, gain in zip(left.tolist(), push.tolist(), strict=True):
        y = keep * y + gain
        out.append(y)
    behind = np.array(out)
    return behind.real, behind.imag


def quantum(values: Array) -> float:
    """Return the step in which values are told; 0 where they lie on no grid."""
    steps = np.diff(np.sort(values))
    steps = steps[steps > 1e-6]
    if not len(steps):
        return 0.0
    step = float(steps.min())
    whole = steps / step
    return step if float(np.abs(whole - np.round(whole)).max()) < 0.05 else 0.0
