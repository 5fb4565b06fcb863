"""Readings come in the order of their time, mostly: who came late, and when the vehicle's clock was set back."""

import math


class ArrivalOrder:
    """The times of an estimator's readings as they arrive.

    One late reading is for the estimator's parts to refuse; many on end mean that the clock was set back, and the
    estimator must start anew.

    Parameters
    ----------
    late_before_restart : late readings on end that mean a clock set back.

    Attributes
    ----------
    late : readings older than what came before them, or without a time.
    first, newest : times of the first and the newest reading [s]; infinite before any.
    late_row : late readings on end.
    set_back : whether the last one said that the clock was set back.
    """

    def __init__(self, late_before_restart: int) -> None:
        self.late = 0
        self.first = self.newest = math.inf
        self.late_row = 0
        self.set_back = False
        self._limit = late_before_restart

    def takes(self, t: float) -> bool:
        """Take the time of the next reading [s]; return whether it is one."""
        if t - t != 0.0:
            self.late += 1
            return False
        if self.first == math.inf:
            self.first = self.newest = t
        elif t < self.newest:
            self.late += 1
            self.late_row += 1
            self.set_back = self.late_row > self._limit
        else:
            self.late_row = 0
            self.newest = t
        return True

    def begins_anew(self, t: float) -> "ArrivalOrder":
        """Return the order of what comes from the reading at t on [s], the count of late ones kept."""
        order = ArrivalOrder(self._limit)
        order.late = self.late
        order.first = order.newest = t
        return order
