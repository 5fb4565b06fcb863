"""Curves in braille, two dots by four a cell, and sparklines; the curve that matters is drawn last."""

import math
from collections.abc import Sequence

from gcs_health.dashboard.view.lines import Line

BARS = "▁▂▃▄▅▆▇█"
DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
GAP = 1.5  # s without a value over which no line is drawn
GUTTER = 6  # cells of the scale at the left

Curve = tuple[Sequence[float], str]  # values at `times`, style


def sparkline(values: Sequence[float], cells: int) -> str:
    """Render values of 0..1 in so many cells, each the most of its share; a dot where nothing is known."""
    out = []
    for k in range(cells):
        share = values[
            k * len(values) // cells : max((k + 1) * len(values) // cells, k * len(values) // cells + 1)
        ]
        known = [value for value in share if value == value]
        out.append(BARS[min(int(max(known) * 7.999), 7)] if known else "·")
    return "".join(out)


def plot(
    times: Sequence[float],
    curves: Sequence[Curve],
    cells: int,
    rows: int,
    ends: tuple[float, float],
    scale: tuple[float, float] | None = None,
    mark: float = math.nan,
    digits: int = 1,
) -> list[Line]:
    """Render curves over `ends` in time; `scale` is least and most, else what they need.

    `mark` is a time drawn as a vertical line.
    """
    wide = max(cells - GUTTER - 1, 4)
    low, high = scale or _range([values for values, _ in curves])
    grid = [[0] * wide for _ in range(rows)]
    styles = [[""] * wide for _ in range(rows)]
    length = (ends[1] - ends[0]) or 1.0
    shares = _shares(times, ends, 2 * wide)
    bottom = 4 * rows - 1
    steepness = bottom / (high - low)

    def place(value: float) -> int:
        y = int((high - value) * steepness + 0.5)
        return 0 if y < 0 else bottom if y > bottom else y

    for values, style in curves:
        last: tuple[float, int, int] | None = None  # time, column and row of dots
        for t, x, start, end in shares:
            known = values[start:end]
            total = sum(known)
            if total != total:  # not known at some moment: of the others
                known = [value for value in known if value == value]
            if not known:
                last = None
                continue
            least, most = place(max(known)), place(min(known))
            first = final = least
            if least != most:
                first, final = place(known[0]), place(known[-1])
            joined = last if last is not None and t - last[0] <= GAP else None
            for dot_x, dot_y in _stroke(joined, x, first, least, most):
                grid[dot_y // 4][dot_x // 2] |= DOTS[dot_x & 1][dot_y & 3]
                styles[dot_y // 4][dot_x // 2] = style
            last = (times[end - 1], x, final)
    at = int((mark - ends[0]) / length * wide) if ends[0] <= mark <= ends[1] else -1
    labels = {0: f"{high:.{digits}f}", rows - 1: f"{low:.{digits}f}"}
    return [
        ((labels.get(row, "").rjust(GUTTER), "dim"), ("│", "dim"), *_cells(grid[row], styles[row], at))
        for row in range(rows)
    ]


def _shares(
    times: Sequence[float], ends: tuple[float, float], dots: int
) -> list[tuple[float, int, int, int]]:
    """Return (time of the first, column of dots, start, end) of the values that fall on each column."""
    scale = dots / ((ends[1] - ends[0]) or 1.0)
    out: list[tuple[float, int, int, int]] = []
    start, column = 0, -1
    for k, t in enumerate(times):
        x = min(int((t - ends[0]) * scale), dots - 1) if ends[0] <= t <= ends[1] else -1
        if x != column:
            if column >= 0:
                out.append((times[start], column, start, k))
            start, column = k, x
    if column >= 0:
        out.append((times[start], column, start, len(times)))
    return out


def _stroke(
    last: tuple[float, int, int] | None, x: int, first: int, least: int, most: int
) -> list[tuple[int, int]]:
    """Return the dots from the last value, held, to this column's, from its least row to its most."""
    if last is None:
        return [(x, row) for row in range(least, most + 1)]
    _, from_x, from_y = last
    held = [(column, from_y) for column in range(from_x + 1, x)]
    return held + [(x, row) for row in range(min(from_y, first, least), max(from_y, first, most) + 1)]


def _cells(dots: list[int], styles: list[str], mark: int) -> Line:
    out: list[tuple[str, str]] = []
    for x, value in enumerate(dots):
        sign, style = (chr(0x2800 + value), styles[x]) if value else ("┊", "dim") if x == mark else (" ", "")
        if out and out[-1][1] == style:
            out[-1] = (out[-1][0] + sign, style)
        else:
            out.append((sign, style))
    return tuple(out)


def _range(curves: Sequence[Sequence[float]]) -> tuple[float, float]:
    known = [value for values in curves for value in values if math.isfinite(value)]
    if not known:
        return 0.0, 1.0
    low, high = min(known), max(known)
    if high - low < 1e-9:
        return low - 0.5, high + 0.5
    return low, high
