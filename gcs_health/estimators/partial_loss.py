"""One rotor that lost part of its thrust, held against a baseline with a long memory.

    e, h     raw residual and columns of the rotors, means over a lesson of 0.4 s
    b        offset with a memory of 25 s, not learned while a loss is seen
    N, D     sums of -h_i' W (e - b) and h_i' W h_i over the last 0.8 .. 1.6 s,  W = 1 / noise of the means
    theta = N / D,   LLR = N² / 2D,   std² = 1 / D + spread²

As in the fault bank, but of any size: of all rotors and windows the likeliest counts. It is seen where theta is
above .10, which no healthy flight reached in 272 windows, and not by its likelihood alone, which slow
aerodynamic forces raise too; and where this rotor's column explains most of what is there.

A manoeuvre that closes the gate for a moment ends the windows and nothing else. The baseline is the vehicle's,
not the manoeuvre's: learned anew each time it would take in a loss that came just before, and no rotor would be
judged for three seconds.

A load that drops shifts the centre of mass, which looks like a loss in roll and pitch. But it makes the vehicle
lighter, where a loss takes lift away: lift that stays above the baseline by more than .08 is another load, and the
baseline is learned anew.

Source: sheet 1 section 7 step 7; sheet 5 section 3, partial loss.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.estimators.lesson import Lesson

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PartialConfig:
    """Thresholds and times."""

    windows: tuple[int, int] = (2, 4)  # lessons, shortest and longest
    offset_memory: float = 25.0  # s
    settle: float = 3.0  # s until the offset is believed; this project
    clip: float = 3.5  # sigmas of a lesson's mean, of what teaches the offset
    correlated: float = 6.0  # variance of a mean over that of white noise; this project
    least: float = 0.10  # theta
    llr: float = 8.0  # this project
    lead: float = 3.0  # over the next rotor; this project
    share: float = 0.6  # 2 LLR / Q
    spread: float = 0.03  # of theta in healthy flight
    hold_at_most: float = 60.0  # s that the offset stands still; this project
    closed_at_most: float = 3.0  # s of closed gate after which the offset still holds; this project
    lighter: float = 0.08  # of the lift, above the baseline, in so many lessons on end: another load;
    lighter_lessons: int = 5  # this project


class PartialLoss:
    """Fed lessons; says which rotor lost how much.

    Attributes
    ----------
    rotor : the one seen, None = none. theta : what it lost [-]. std : of theta. llr : its likelihood.
    """

    def __init__(self, rotors: int, config: PartialConfig) -> None:
        self.config = config
        self.rotors = rotors
        self.restart()

    def go_on(self, closed_for: float) -> None:
        """Take that the gate opened after so long [s]; what was seen before stands until it is judged anew."""
        if closed_for > self.config.closed_at_most and self._named is None:
            self.restart()
        else:
            self._recent.clear()

    def restart(self) -> None:
        """Forget everything: another flight, or perhaps another load."""
        self.rotor: int | None = None
        self._named: int | None = None
        self.theta = self.llr = 0.0
        self.std = 1.0
        self.time = 0.0  # s since the restart
        self._held = 0.0  # s that the offset has stood still
        self._lighter = 0  # lessons on end
        self._offset: Array = np.zeros(4)
        self._recent: deque[Array] = deque(maxlen=self.config.windows[1])  # [N, D, Q] of each lesson

    def size(self, rotor: int) -> None:
        """Take that this rotor was named by a faster rule: from now on only how much it lost is asked."""
        self._recent.clear()
        self.rotor, self._named = None, rotor

    def feed(self, lesson: Lesson, matrix: Array) -> None:
        """Take one lesson, with the gains G (4, n)."""
        c = self.config
        n = self.rotors
        self.time += lesson.length
        weights = lesson.dt / lesson.length
        h = matrix * (weights @ lesson.squares)
        h[3] = matrix[3] * (weights @ lesson.last_squares)
        noise = (weights @ lesson.variances) * (c.correlated / len(lesson.dt))
        r = (weights @ lesson.e) - self._offset
        if self._lost_load(float(r[3] / h[3].sum())):
            self.restart()
            r = weights @ lesson.e
        weighted = r / noise
        row = np.concatenate((-(weighted @ h), (1.0 / noise) @ (h * h), [float(weighted @ r)]))
        self._recent.append(row)
        self._judge(n)
        if self._named is not None:
            return
        if self.rotor is not None and self._held < c.hold_at_most:
            self._held += lesson.length
            return
        if self.rotor is None:
            self._held = 0.0
        limit = c.clip * np.sqrt(noise)
        gain = min(1.0, lesson.length / min(c.offset_memory, max(self.time, 0.5)))
        self._offset = self._offset + gain * np.minimum(np.maximum(r, -limit), limit)

    def _lost_load(self, lighter: float) -> bool:
        """Whether the vehicle has become lighter by a share that lasts."""
        c = self.config
        self._lighter = self._lighter + 1 if lighter > c.lighter and self.time > c.settle else 0
        return self._lighter >= c.lighter_lessons and self._named is None

    def _judge(self, n: int) -> None:
        c = self.config
        shortest = c.windows[0]
        if len(self._recent) < shortest:
            return
        self.rotor = None
        if self.time < c.settle:
            return
        sums = np.array(self._recent)[::-1].cumsum(axis=0)[shortest - 1 :]
        N, D, Q = np.maximum(sums[:, :n], 0.0), sums[:, n : 2 * n] + 1e-12, sums[:, 2 * n]
        llr = 0.5 * N * N / D
        best = llr.max(axis=0)
        rotor = int(best.argmax())
        row = int(llr[:, rotor].argmax())
        theta = float(N[row, rotor] / D[row, rotor])
        top = float(best[rotor])
        best[rotor] = 0.0
        if (
            theta > c.least
            and top > c.llr
            and top - float(best.max()) > c.lead
            and 2.0 * top > c.share * float(Q[row])
            and self._named in (None, rotor)
        ):
            self.rotor, self.theta, self.llr = rotor, theta, top
            self.std = float((1.0 / D[row, rotor] + c.spread**2) ** 0.5)
