"""A bank of single-fault hypotheses: rotor i has lost a share theta since L ticks ago.

    h_i       what rotor i adds to the rows now           r   residual under "all healthy"
    n_i = -h_i' R^-1 r,  d_i = h_i' R^-1 h_i              of one tick
    N, D, Q   sums of n_i, d_i and r' R^-1 r over the last L ticks, every L at once
    theta = clip(N / D)          most likely loss
    LLR   = theta N - theta² D / 2      log likelihood ratio against "all healthy"

A decision needs the likelihood, a lead over every other rotor, a loss of believable size, and a shape:
the residual must look like this rotor's column and little else, which is what tells a lost rotor from
a gust or a collision. Every rule must hold in successive ticks.

Source: sheet 1 section 7, steps 4 and 5; sheet 5 section 3 rule 4.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.estimators.residual_model import Evidence, contributions, exchange
from gcs_health.gate import GRAVITY

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BankConfig:
    """Thresholds of the bank, sheet 1 section 7."""

    window: float = 0.16  # s, longest window
    max_ticks: int = 20  # the window in 8 ms ticks
    shortest: float = (
        0.024  # s, shortest window: two messages at 100 Hz alias a craft's vibration; this project
    )
    min_ticks: int = 2  # in it, however long they are; likewise
    theta_low: float = 0.55
    theta_high: float = 1.15
    llr: float = 20.0
    lead: float = 6.0
    free_theta_low: float = 0.5
    free_theta_high: float = 1.7
    # more theta for each of the gains' standard deviations, while they are learned, of a rotor slowed below `kept`:
    doubted: float = 0.3  # an order looks like a loss through wrong gains; this project
    kept: float = 0.97  # of its speed at the window's beginning
    # a smaller loss is not named where exchanged seats explain it, though the flight before refuted them: what looks
    whole: float = 0.6  # like both is most often an error of the model; this project
    shape_share: float = 0.6
    shape_chi2: float = 2.5
    excess_sigmas: float = 1.0  # of the mean upward excess of the window; a loss only removes lift
    knock: float = 0.8 * GRAVITY  # m/s², largest upward excess of one tick in it
    gain_low: float = -0.6  # how wrong a gain that is not learned may be, as EffectivenessPrior.bounds
    gain_high: float = 1.5
    model_error: tuple[float, float] = (0.02, 0.5)  # share of a rotor's part, and per relative change of u


class Verdict(NamedTuple):
    """The best hypothesis of one tick. `passes` = all rules but succession hold."""

    rotor: int
    llr: float
    lead: float  # over the second rotor, over wrong gains, or over 0
    theta: float  # unclipped
    std: float  # of theta, 1 / sqrt(D)
    share: float  # 2 LLR / Q
    chi2: float  # what it leaves unexplained, per degree of freedom
    ticks: int  # L of the best window
    passes: bool


NOTHING = Verdict(-1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, False)


class FaultBank:
    """The last ticks: final ones and, on top, those whose rotor speeds are still provisional.

    What a tick contributes is worked out only when somebody asks, over all that wait at once; most
    ticks of a healthy flight are never asked about.
    """

    def __init__(self, rotors: int, rows: int, config: BankConfig) -> None:
        self.config = config
        self.rotors = rotors
        self.rows = rows  # measurement rows in use, for the degrees of freedom
        # so many sigmas that the largest of L ticks of noise exceeds them once in twenty windows
        chance = [1.0 - 0.95 ** (1.0 / length) for length in range(1, config.max_ticks + 1)]
        self._knock_sigmas = [math.inf, *[NormalDist().inv_cdf(1.0 - p) for p in chance]]
        # what the flight so far says against each pair of rotors being in each other's seats
        self.exchange_cost: Array = np.zeros(rotors * (rotors - 1) // 2)
        self._table: Array = np.zeros((4 * config.max_ticks, 2 * rotors + 5))  # one row a tick, newest last
        self.clear()

    def clear(self) -> None:
        """Forget every tick: no window reaches across a closed gate."""
        self._end = self._final_end = 0  # rows of the table in use, and how many of them are final
        self._ticks: list[Evidence] = []  # the last ones, in `ticks`' order
        self._waiting: list[Evidence] = []  # not yet in the table, final ones first
        self._waiting_final = 0
        self._excess: list[float] = []  # upward excess of each tick [m/s²], as many as `ticks`
        self._provisional = 0
        self._doubt = (0.0, 0.0)  # of roll and pitch gains, the newest tick's
        self.final_ticks = 0

    @property
    def ticks(self) -> int:
        """Ticks that can be judged."""
        return min(self.final_ticks + self._provisional, self.config.max_ticks)

    def add_final(self, tick: Evidence, excess: float) -> None:
        """Add one tick that will not change, and its upward excess [m/s²].

        Call `drop_provisional` before the first.
        """
        waiting = self._waiting
        waiting.append(tick)
        self._ticks.append(tick)
        self._doubt = tick.doubt
        if len(waiting) > self.config.max_ticks:
            del waiting[0]
        self._waiting_final = len(waiting)
        if self.final_ticks < self.config.max_ticks:
            self.final_ticks += 1
        self._remember(excess)

    def drop_provisional(self) -> None:
        """Go back to the final ticks."""
        if self._provisional:
            del self._waiting[self._waiting_final :]
            self._end = self._final_end
            del self._excess[-self._provisional :], self._ticks[-self._provisional :]
            self._provisional = 0

    def add_provisional(self, tick: Evidence, excess: float) -> None:
        """Add one tick whose rotor speeds may still change."""
        self._waiting.append(tick)
        self._ticks.append(tick)
        self._provisional += 1
        self._remember(excess)

    def _remember(self, excess: float) -> None:
        self._excess.append(excess)
        if len(self._excess) > 4 * self.config.max_ticks:
            del self._excess[: 2 * self.config.max_ticks], self._ticks[: 2 * self.config.max_ticks]

    def _longest(self, tick_length: float) -> int:
        """Return how many ticks the longest window has now; 0 = too few for any."""
        ticks, least = self.ticks, self._least(tick_length)
        return min(ticks, max(least, round(self.config.window / tick_length))) if ticks >= least else 0

    def _least(self, tick_length: float) -> int:
        """Return how many ticks the shortest window has."""
        c = self.config
        return max(c.min_ticks, math.ceil(c.shortest / tick_length - 0.2))

    def _sums(self, last: int) -> Array:
        """Return sums of `contributions` over the last 1, 2 .. `last` ticks, a row each."""
        if self._waiting:
            self._fill()
        newest_first = self._table[self._end - last : self._end][::-1]
        sums: Array = newest_first.cumsum(axis=0)
        return sums

    def _fill(self) -> None:
        """Work out what waits."""
        rows = contributions(self._waiting, self.config.model_error)
        if self._end + len(rows) > len(self._table):
            kept = self._table[max(0, self._final_end - self.config.max_ticks) : self._end].copy()
            self._final_end -= self._end - len(kept)
            self._end = len(kept)
            self._table[: self._end] = kept
        self._table[self._end : self._end + len(rows)] = rows
        self._end += len(rows)
        self._final_end += self._waiting_final
        self._waiting.clear()
        self._waiting_final = 0

    def judge(self, tick_length: float, floor: float, excess_sigma: float, least: int = 0) -> Verdict:
        """Return the best hypothesis over every rotor and window.

        Parameters
        ----------
        tick_length : usual tick [s]; windows are at most `window` s.
        least : ticks of the shortest window, if more than its time asks.
        excess_sigma : usual size of the upward excess e of one tick [m/s²].
        floor : log likelihood ratio below which nobody wants to know; saves most of the work.
        """
        c = self.config
        last = self._longest(tick_length)
        if not last:
            return NOTHING
        first = max(self._least(tick_length), least) - 1
        if first >= last:
            return NOTHING
        n = self.rotors
        sums = self._sums(last)[first:]
        N = sums[:, :n]
        D = sums[:, n : 2 * n]
        # LLR <= N² / 2D whatever the clip
        if not np.count_nonzero((N > 0.0) & ((2.0 * floor) * D < N * N)):
            return NOTHING
        free = N / (D + 1e-12)
        theta = np.minimum(np.maximum(free, c.theta_low), c.theta_high)
        llr = theta * (N - 0.5 * theta * D)
        best = np.maximum.reduce(llr).tolist()
        rotor = max(range(n), key=best.__getitem__)
        top = best[rotor]
        second = 0.0
        for i in range(n):
            if i != rotor and best[i] > second:
                second = best[i]
        row = int(llr[:, rotor].argmax())
        ticks = row + first + 1
        q = float(sums[row, 2 * n])
        loss = float(free[row, rotor])
        if self._doubt[0] or self._doubt[1]:
            second = max(second, self._gains(sums[row, 2 * n + 1 :].tolist()))
        share = 2.0 * top / q if q > 0.0 else 0.0
        chi2 = (q - 2.0 * top) / max(self.rows * ticks - 1, 1)
        passes = (
            top > c.llr
            and top - second > c.lead
            and c.free_theta_low <= loss <= c.free_theta_high
            and (loss >= c.free_theta_low + c.doubted * max(self._doubt) or self._keeps_speed(rotor, ticks))
            and (share > c.shape_share or chi2 < c.shape_chi2)
            and self._lift_plausible(ticks, excess_sigma)
        )
        if passes and (self._doubt[0] or self._doubt[1]):  # the geometry has not been seen to be right either
            window, most = self._ticks[-ticks:], 1.0 + c.gain_high
            cost = self.exchange_cost if loss >= c.whole else np.zeros_like(self.exchange_cost)
            second = max(second, exchange(window, c.model_error, most, cost))
            passes = top - second > c.lead
        std = 1.0 / math.sqrt(float(D[row, rotor]) + 1e-12)
        return Verdict(rotor, top, top - second, loss, std, share, chi2, ticks, passes)

    def _gains(self, sums: list[float]) -> float:
        """Return the log likelihood ratio of "no rotor, but roll and pitch gains not yet learned are wrong".

        A wrong gain is the same in all ticks of a window, which the noise of each tick cannot stand for: the
        first hard manoeuvre after a calm climb would name the rotor that moved most. With m = gain / prior - 1
        of variance doubt²:  max over m of  m N - m² (D + 1 / doubt²) / 2, m within `gain_low` .. `gain_high`.
        """
        c = self.config
        out = 0.0
        for axis, doubt in enumerate(self._doubt):
            if doubt > 0.0:
                N, D = sums[axis], sums[2 + axis] + 1.0 / (doubt * doubt)
                more = min(max(N / D, c.gain_low), c.gain_high)
                out += more * (N - 0.5 * more * D)
        return out

    def _keeps_speed(self, rotor: int, ticks: int) -> bool:
        """Whether a rotor turns about as fast at the end of the window as at its beginning, or faster."""
        window = self._ticks[-ticks:]
        return window[-1].w1[rotor] >= self.config.kept * window[0].w0[rotor]

    def _lift_plausible(self, ticks: int, sigma: float) -> bool:
        """Whether no upward push lies in the window: a lost rotor only removes lift.

        Judged on the window's mean and on its largest tick, so that one short knock at a low message
        rate, where sigma is large, is not averaged away.
        """
        excess = self._excess[-ticks:]
        if sum(excess) > self.config.excess_sigmas * sigma * math.sqrt(ticks):
            return False
        return max(excess) <= max(self.config.knock, self._knock_sigmas[ticks] * sigma)

    def standing(self, tick_length: float) -> tuple[list[float], list[float]]:
        """Return of each rotor the largest log likelihood ratio of all windows, never below 0, and D.

        D is that of the longest window: 1/D is the variance of its theta.
        """
        c = self.config
        n = self.rotors
        last = self._longest(tick_length)
        if not last:
            return [0.0] * n, [0.0] * n
        sums = self._sums(last)[self._least(tick_length) - 1 :]
        N = sums[:, :n]
        D = sums[:, n : 2 * n]
        theta = np.minimum(np.maximum(N / (D + 1e-12), c.theta_low), c.theta_high)
        best: list[float] = np.maximum.reduce(np.maximum(theta * (N - 0.5 * theta * D), 0.0)).tolist()
        information: list[float] = D[-1].tolist()
        return best, information

    def detectable(self, information: float) -> float:
        """Return the smallest loss [-] that would pass `llr` over a window of this information; NaN = none.

        A loss theta gives N = theta D on average, so LLR = clip theta D - clip² D / 2 with the clip at
        `theta_low`; solved for theta, and never below `free_theta_low`.
        """
        c = self.config
        if information <= 0.0:
            return float("nan")
        small = (c.llr / information + 0.5 * c.theta_low**2) / c.theta_low
        theta = small if small <= c.theta_low else (2.0 * c.llr / information) ** 0.5
        theta = max(theta, c.free_theta_low)
        return theta if theta <= 1.0 else float("nan")
