"""What a vehicle's healthy flights raise by themselves: the log odds of each family of kinds, block by block."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from gcs_health.calibration.false_alarms import BLOCK

Family = frozenset[str]


@dataclass
class HealthyLevels:
    """Fed all rotors' log odds of one flight at a time; `blocks` are the largest of each block of flight.

    Attributes
    ----------
    blocks : (n,) per family [nats]; blocks that the flight broke off count where they are at least half full.
    """

    families: tuple[Family, ...]
    blocks: dict[Family, list[float]] = field(init=False)
    _start: float = math.nan
    _last: float = math.nan
    _open: dict[Family, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.blocks = {family: [] for family in self.families}

    def feed(self, t: float, odds: Iterable[tuple[Family, float]], flies: bool) -> None:
        """Take the largest log odds over the rotors at vehicle time t [s], one a family."""
        if not flies:
            self.close()
            return
        if not self._start <= t <= self._last + BLOCK:
            self.close()
            self._start = t
        self._last = t
        for family, value in odds:
            self._open[family] = max(value, self._open.get(family, -math.inf))
        if t - self._start >= BLOCK:
            self.close()

    def close(self) -> None:
        """End the block: the flight, or its time, is over."""
        if self._last - self._start >= 0.5 * BLOCK:
            for family, value in self._open.items():
                self.blocks[family].append(value)
        self._open.clear()
        self._start = math.nan
