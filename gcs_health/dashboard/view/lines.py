"""Lines: tuples of (text, style name). All that is drawn is one cell wide, so a text's length is its width.

Styles: "" plain, dim, bold, title, ok, warn, fail, alarm, caution, acked, stale, unknown, key, pick; curve: of bars
and plots, never reversed, which would turn them over.
"""

from collections.abc import Iterable, Sequence

Run = tuple[str, str]
Line = tuple[Run, ...]
BLANK: Line = ()


def line(*parts: str | Run) -> Line:
    """Return a line of texts, plain ones bare."""
    return tuple((part, "") if isinstance(part, str) else part for part in parts)


def width(of: Line) -> int:
    """Return how many cells a line takes."""
    return sum(len(text) for text, _ in of)


def plain(of: Line) -> str:
    """Return a line's text."""
    return "".join(text for text, _ in of)


def fit(of: Line, cells: int, style: str = "") -> Line:
    """Return a line of exactly so many cells: cut with an ellipsis, or filled."""
    missing = cells - width(of)
    if missing == 0:
        return of
    if missing > 0:
        return (*of, (" " * missing, style))
    return (*cut(of, 0, max(cells - 1, 0)), ("…", of[-1][1]))[: cells or 0]


def cut(of: Line, start: int, end: int) -> Line:
    """Return the cells from `start` to before `end`."""
    out: list[Run] = []
    at = 0
    for text, style in of:
        part = text[max(start - at, 0) : max(end - at, 0)]
        if part:
            out.append((part, style))
        at += len(text)
    return tuple(out)


def sides(left: Line, right: Line, cells: int) -> Line:
    """Return a line with one part at each end; the left one is cut where both do not fit."""
    if width(right) + 2 > cells:
        return fit(left, cells)
    return (*fit(left, cells - width(right) - 1), (" ", ""), *right)


def beside(left: Sequence[Line], cells: int, right: Sequence[Line], gap: int = 2) -> list[Line]:
    """Return two blocks side by side, the left one so many cells wide."""
    rows = max(len(left), len(right))
    space: Run = (" " * gap, "")
    return [
        (*fit(left[k] if k < len(left) else BLANK, cells), space, *(right[k] if k < len(right) else BLANK))
        for k in range(rows)
    ]


def title(text: str, cells: int) -> Line:
    """Return a section's heading: its name in a rule."""
    return ((f"── {text} ".ljust(cells, "─")[:cells], "title"),)


def fill(lines: Iterable[Line], rows: int) -> list[Line]:
    """Return exactly so many lines."""
    out = list(lines)[:rows]
    return out + [BLANK] * (rows - len(out))


def wrap(text: str, cells: int, style: str = "", indent: int = 0, margin: int = 0) -> list[Line]:
    """Break a text at spaces; `margin` cells are left before every line, `indent` more before what follows."""
    if margin:
        return [((" " * margin, ""), *each) for each in wrap(text, cells - margin, style, indent)]
    out: list[Line] = []
    now = ""
    for word in text.split():
        room = cells - (indent if out else 0)
        if now and len(now) + 1 + len(word) > room:
            out.append(((" " * (indent if out else 0) + now, style),))
            now = word
        else:
            now = f"{now} {word}" if now else word
    if now:
        out.append(((" " * (indent if out else 0) + now, style),))
    return out
