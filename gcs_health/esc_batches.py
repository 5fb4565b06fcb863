"""Batches of four ESCs joined into one reading of all.

A vehicle of more than four rotors sends its ESCs in batches, one right behind the other. Joined, they
are what they were when measured, one moment of all rotors, and the estimators work half as often.
"""

from operator import add
from typing import NamedTuple

from gcs_health.samples import new_tuple


class Known(NamedTuple):
    """What is known of some ESCs, NaN where an ESC does not say."""

    escs: tuple[int, ...] = ()  # their indices
    speed: tuple[float, ...] = ()  # [rad/s]
    current: tuple[float, ...] = ()  # [A]
    voltage: tuple[float, ...] = ()  # [V]

    @staticmethod
    def of(escs: list[tuple[int, float, float, float]]) -> "Known":
        """Return (index, speed, current, voltage) of each ESC as one."""
        return Known(*zip(*escs, strict=True)) if escs else Known()

    def and_these(self, more: "Known") -> "Known":
        """Return both."""
        return new_tuple(Known, map(add, self, more))


NONE_KNOWN = Known()
MOMENT = 0.002  # s; batches of one moment may carry stamps so far apart (the newest PX4 stamps the sending)
MISSED = 3  # times in a row that the rest did not follow: it is no longer waited for


class BatchJoin:
    """Holds the first batches of a moment until the last one known to come is there.

    A lost batch delays the others until the next moment, no longer; one that stays away (PX4 leaves out
    a batch whose ESCs are all stale) is soon not waited for.
    """

    def __init__(self) -> None:
        self._last = 0  # first ESC of the last batch that is waited for
        self._missed = 0
        self._held = NONE_KNOWN
        self._t = 0.0
        self._reached = 0

    def feed(self, t: float, first: int, known: Known) -> tuple[float, Known] | None:
        """Take one batch from ESC `first` on at time `t` [s]; return what is complete, with its time."""
        if first > self._last:
            self._last, self._missed = first, 0
        joins = bool(self._held.escs) and first > self._reached and abs(t - self._t) < MOMENT
        if joins:
            t, known = self._t, self._held.and_these(known)
        if first >= self._last:
            if joins:
                self._held, self._missed = NONE_KNOWN, 0
            return t, known
        overdue, since = self._held, self._t
        self._held, self._t, self._reached = known, t, first
        if joins or not overdue.escs:
            return None
        self._missed += 1
        if self._missed < MISSED:
            return since, overdue
        self._last, self._held = first, NONE_KNOWN
        return t, known
