"""A vehicle's rows as plots: effectiveness, speed, failure probability and lift over time, two by two."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from functools import lru_cache

from gcs_health.dashboard.snapshot import Row
from gcs_health.dashboard.view.lines import Line, beside, line
from gcs_health.dashboard.view.plot import GUTTER, plot
from gcs_health.dashboard.words import RPM


def quarters(
    trace: Sequence[Row], concerned: int, cells: int, rows: int, ends: tuple[float, float], mark: float
) -> list[Line]:
    """Return effectiveness, speed, failure probability and lift of these rows; one rotor before the others.

    What is newer than the last whole column of dots waits for the next: the plots are drawn anew once a column.
    """
    length = round(ends[1] - ends[0], 3)  # the same from picture to picture, whatever the times' last digits
    column = length / (2 * max((cells - 2) // 2 - GUTTER - 1, 4))
    end = math.floor(ends[1] / column) * column if column > 0.0 else ends[1]
    ends = (end - length, end)
    first = bisect_left(trace, ends[0], key=_time)
    last = bisect_right(trace, ends[1], key=_time)
    return list(_panels(_Rows(tuple(trace[first:last])), concerned, cells, rows, ends, mark))


def _time(row: Row) -> float:
    return row.t


class _Rows:
    """Rows that are the same if their ends are: one vehicle's, in order."""

    def __init__(self, rows: tuple[Row, ...]) -> None:
        self.rows = rows
        self._key = (len(rows), rows[0], rows[-1]) if rows else ()

    def __hash__(self) -> int:
        return hash((len(self.rows), self.rows[-1].t if self.rows else 0.0))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Rows) and self._key == other._key


@lru_cache(maxsize=16)
def _panels(
    of: _Rows, concerned: int, cells: int, rows: int, ends: tuple[float, float], mark: float
) -> tuple[Line, ...]:
    trace = of.rows
    times = [row.t for row in trace]
    wide = (cells - 2) // 2
    high = (rows - 2) // 2 if rows >= 10 else rows - 1

    def rotors(name: str, factor: float = 1.0) -> list[tuple[list[float], str]]:
        columns = list(zip(*(getattr(row, name) for row in trace), strict=False))
        order = sorted(range(len(columns)), key=lambda k: k == concerned)
        return [([v * factor for v in columns[k]], "curve" if k == concerned else "dim") for k in order]

    def panel(name: str, drawn: list[Line]) -> list[Line]:
        return [line((f"{' ' * 7}{name}", "dim")), *drawn]

    effectiveness = plot(times, rotors("effectiveness"), wide, high, ends, (-0.2, 1.2), mark)
    speeds = plot(times, rotors("speed", RPM), wide, high, ends, None, mark, 0)
    out = beside(panel("effectiveness", effectiveness), wide, panel("rotor speed, rpm", speeds))
    if rows < 10:
        return tuple(out)
    chances = plot(times, rotors("failed"), wide, high, ends, (0.0, 1.0), mark)
    lift = [([row.expected for row in trace], "dim"), ([row.lift for row in trace], "curve")]
    lifts = plot(times, lift, wide, high, ends, None, mark)
    lifted = panel("lift m/s²: measured, faint: as if healthy", lifts)
    return tuple(out + beside(panel("failure probability", chances), wide, lifted))
