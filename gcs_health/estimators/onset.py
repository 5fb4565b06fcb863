"""Which of two opposite rotors slowed: the one whose command would else have had to jump.

At the moment in which e leaves its healthy value, commands are still what they were. Of the pair i, j with the
same signature and the drop r they share in e:

    rotor i :  W_cmd = (W_i + r, W_j)        rotor j :  W_cmd = (W_i, W_j + r)
    log likelihood ratio = 2 r d / s²        d : change of W_j - W_i over one block, s : its usual size

One block later the controller has slowed the opposite rotor too, and at its end it has all but done so: a single
sample there names either (at 10 Hz 73 rightly, 13 wrongly), the mean of two and more names the right one (at 20 Hz
and above none wrongly). Source: this project, after sheet 4 section 4; benchmarks/pooled_ar.md.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SURE = 12.0  # of the log likelihood ratio
SIGMAS = 6.0  # of e's healthy scatter, from which its jump is an onset
LEAST = 0.03  # of the mean speed
JUMP = 0.3  # of the drop at most was there one block before
MATCH = 0.4  # of the drop at least must be seen in the difference
LEARN = 50  # blocks
OFTEN = 1.5  # speeds a block at least, so that its mean has the beginning of the drop in it


class Onset:
    """Fed once a block; `named` is the rotor told from its lookalikes, until the drop is over."""

    def __init__(self, alike: tuple[tuple[int, ...], ...], own: Array) -> None:
        self.alike, self.own = alike, own
        self.named: int | None = None
        self._shares: Array | None = None
        self._drop = 0.0
        self._changes = 0.0  # mean squared change of a pair's difference
        self._scatter = 0.0  # mean squared drop in healthy flight
        self._count = 0

    def feed(self, shares: Array, e: Array, heard: float) -> None:
        """Take a block's speeds over their mean, e with its healthy part removed, and how many speeds a block has."""
        explained = np.where(e < 0.0, e * e / np.maximum(self.own, 1e-3), 0.0)
        worst = int(explained.argmax())
        drop = float(max(-e[worst] / max(self.own[worst], 1e-3), 0.0))
        before, self._shares = self._shares, shares
        earlier, self._drop = self._drop, drop
        if before is None:
            return
        change = shares - before
        threshold = max(LEAST, SIGMAS * self._scatter**0.5)
        if self._count < LEARN or drop < threshold:
            self.named = None
            self._learn(change, drop)
        elif earlier < JUMP * drop and self.named is None and heard >= OFTEN:
            self.named = self._told(worst, change, drop)

    def _told(self, worst: int, change: Array, drop: float) -> int | None:
        """Return the rotor of the group that the ratio favours against every other, if it does."""
        group = self.alike[worst]
        if len(group) != 2:
            return None
        i, j = group
        d = float(change[j] - change[i])
        if 2.0 * drop * abs(d) < SURE * self._changes or abs(d) < MATCH * drop:
            return None
        return i if d > 0.0 else j

    def _learn(self, change: Array, drop: float) -> None:
        pairs = [(group[0], group[1]) for group in self.alike if len(group) == 2]
        squares = [float(change[j] - change[i]) ** 2 for i, j in pairs]
        self._count += 1
        weight = 1.0 / min(self._count, 10 * LEARN)
        if squares:
            self._changes += weight * (sum(squares) / len(squares) - self._changes)
        self._scatter += weight * (drop * drop - self._scatter)
