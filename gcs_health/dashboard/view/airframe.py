"""The airframe from above, nose up, to its geometry: one box a rotor, stacked rotors in one box.

The state shows in the border and the sign before it shows in colour: light and round = ok, dashed and ? = unknown,
heavy and ! = something wrong, double and ✗ = failed.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

from gcs_health.dashboard.snapshot import Level, RotorShot
from gcs_health.dashboard.view.lines import Line

BORDER = {Level.OK: "╭─╮│╰╯", Level.UNKNOWN: "┌╌┐╎└┘", Level.WARN: "┏━┓┃┗┛", Level.FAILED: "╔═╗║╚╝"}
SIGN = {Level.OK: "", Level.UNKNOWN: "?", Level.WARN: "!", Level.FAILED: "✗"}
STYLE = {Level.OK: "", Level.UNKNOWN: "unknown", Level.WARN: "warn", Level.FAILED: "fail"}
FILLED = {**STYLE, Level.FAILED: "alarm"}  # of the boxes
SPIN = {1: "↺", -1: "↻", 0: "·"}
SIZES = ((11, 4), (9, 4), (7, 3), (5, 3), (4, 3))  # of boxes, cells; the inner rows grow with stacked rotors

Spot = tuple[float, float, float, int, int, Level]  # forward, right, down, spin, motor, level


def airframe_map(rotors: Sequence[RotorShot], cells: int, rows: int) -> list[Line]:
    """Return the airframe in so many cells and rows."""
    spots = tuple((*rotor.position, rotor.spin, rotor.motor, rotor.level) for rotor in rotors)
    return list(_drawn(spots, cells, rows))


def zones(rotors: Sequence[RotorShot], cells: int, rows: int) -> list[tuple[int, int, int, int, int]]:
    """Return (left, top, right, bottom, motor) of every box, ends excluded."""
    spots = tuple((*rotor.position, rotor.spin, rotor.motor, rotor.level) for rotor in rotors)
    return [
        (x, y, x + wide, y + high, stack[0][4])
        for stack, x, y, wide, high in (_placed(spots, cells, rows) if spots else ())
    ]


@lru_cache(maxsize=64)
def _drawn(spots: tuple[Spot, ...], cells: int, rows: int) -> tuple[Line, ...]:
    grid = [[(" ", "")] * cells for _ in range(rows)]
    if not spots or rows < 3:
        return tuple(() for _ in range(rows))
    placed = _placed(spots, cells, rows)
    middle = (cells // 2, rows // 2)
    for _, x, y, wide, high in placed:
        _arm(grid, middle, (x + wide // 2, y + high // 2))
    _put(grid, middle[0], middle[1], "▲", "bold")
    for stack, x, y, wide, high in placed:
        _box(grid, stack, x, y, wide, high)
    return tuple(_runs(row) for row in grid)


def _placed(
    spots: tuple[Spot, ...], cells: int, rows: int
) -> list[tuple[tuple[Spot, ...], int, int, int, int]]:
    """Return (stack, left, top, width, height) of every place: the largest boxes that do not overlap."""
    stacks = _stacks(spots)
    reach = max((math.hypot(s[0], s[1]) for s in spots), default=1.0) or 1.0
    tallest = max(len(stack) for stack in stacks)
    out: list[tuple[tuple[Spot, ...], int, int, int, int]] = []
    for wide, high in SIZES:
        high = max(high, tallest + 2)
        out = []
        across = max(abs(s[1]) for s in spots) or reach
        along = max(abs(s[0]) for s in spots) or reach
        # cells are twice as high as wide; where the room is not square, the geometry stays and the picture shrinks
        scale = min((cells - wide) / 2.0 / across / 2.0, (rows - high) / 2.0 / along)
        for stack in stacks:
            x = round((cells - wide) / 2.0 + 2.0 * scale * stack[0][1])
            y = round((rows - high) / 2.0 - scale * stack[0][0])
            out.append((stack, x, y, wide, high))
        if not any(_overlap(a, b) for k, a in enumerate(out) for b in out[:k]):
            break
    return out


def _stacks(spots: tuple[Spot, ...]) -> list[tuple[Spot, ...]]:
    """Gather rotors that share a place, the upper one first."""
    reach = max((math.hypot(s[0], s[1]) for s in spots), default=1.0) or 1.0
    out: list[list[Spot]] = []
    for spot in spots:
        for stack in out:
            if math.dist(stack[0][:2], spot[:2]) < 0.1 * reach:
                stack.append(spot)
                break
        else:
            out.append([spot])
    return [tuple(sorted(stack, key=lambda spot: spot[2])) for stack in out]


def _overlap(
    a: tuple[tuple[Spot, ...], int, int, int, int], b: tuple[tuple[Spot, ...], int, int, int, int]
) -> bool:
    return a[1] < b[1] + b[3] and b[1] < a[1] + a[3] and a[2] < b[2] + b[4] and b[2] < a[2] + a[4]


def _box(
    grid: list[list[tuple[str, str]]], stack: tuple[Spot, ...], x: int, y: int, wide: int, high: int
) -> None:
    worst = max(spot[5] for spot in stack)
    corner, flat, right, side, below, end = tuple(BORDER[worst])
    style = FILLED[worst]
    _text(grid, x, y, corner + flat * (wide - 2) + right, style)
    for row in range(1, high - 1):
        _text(grid, x, y + row, side + " " * (wide - 2) + side, style)
    _text(grid, x, y + high - 1, below + flat * (wide - 2) + end, style)
    if len(stack) == 1 and high >= 4:
        (_, _, _, spin, motor, level) = stack[0]
        _text(grid, x + 1, y + 1, f"{motor}".center(wide - 2), style or "bold")
        _text(grid, x + 1, y + 2, (SIGN[level] or SPIN[spin]).center(wide - 2), style)
        return
    for row, (_, _, _, spin, motor, level) in enumerate(stack):
        _text(grid, x + 1, y + 1 + row, f"{motor}{SIGN[level] or SPIN[spin]}".center(wide - 2), FILLED[level])


def _arm(grid: list[list[tuple[str, str]]], start: tuple[int, int], end: tuple[int, int]) -> None:
    steps = max(abs(end[0] - start[0]) // 2, abs(end[1] - start[1]), 1)
    for k in range(1, steps):
        x = round(start[0] + (end[0] - start[0]) * k / steps)
        y = round(start[1] + (end[1] - start[1]) * k / steps)
        _put(grid, x, y, "·", "dim")


def _text(grid: list[list[tuple[str, str]]], x: int, y: int, text: str, style: str) -> None:
    for k, sign in enumerate(text):
        _put(grid, x + k, y, sign, style)


def _put(grid: list[list[tuple[str, str]]], x: int, y: int, sign: str, style: str) -> None:
    if 0 <= y < len(grid) and 0 <= x < len(grid[y]):
        grid[y][x] = (sign, style)


def _runs(row: list[tuple[str, str]]) -> Line:
    out: list[tuple[str, str]] = []
    for sign, style in row:
        if out and out[-1][1] == style:
            out[-1] = (out[-1][0] + sign, style)
        else:
            out.append((sign, style))
    return tuple(out)
