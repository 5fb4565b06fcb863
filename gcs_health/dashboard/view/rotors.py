"""The table of rotors, as wide as there is room for, and the last minute as sparklines."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from gcs_health.dashboard.snapshot import Level, RotorShot
from gcs_health.dashboard.view.airframe import SIGN, STYLE
from gcs_health.dashboard.view.lines import Line, fit, line, title
from gcs_health.dashboard.view.plot import sparkline
from gcs_health.dashboard.view.top import common_reason, seen_now
from gcs_health.dashboard.words import RPM, SHORT, number, percent, ratio


class Column(NamedTuple):
    """One column: heading, width with its gap, how early it gets room, and its cell."""

    title: str
    width: int
    rank: int
    cell: Callable[[RotorShot], str]


def _verdict(rotor: RotorShot) -> str:
    short = SHORT.get(rotor.state, rotor.state)
    sure = f" {percent(rotor.probability)}" if rotor.level > Level.UNKNOWN and rotor.probability > 0.0 else ""
    return f"{SIGN[rotor.level] or ' '} {short}{sure}"


def _effectiveness(rotor: RotorShot) -> str:
    figure = rotor.figure("effectiveness")
    return ratio(figure.value, figure.std) if figure is not None else "–"


def _unbalance(rotor: RotorShot) -> str:
    """Render g mm, or µm where the mass is not known; "1|3" where it is one of these."""
    figure = rotor.figure("unbalance", "unbalance_relative")
    if figure is None:
        return "–"
    if figure.together:
        return "|".join(map(str, figure.together))[:5]
    return number(1e6 * figure.value, 1)


def _trend(rotor: RotorShot) -> str:
    figure = rotor.figure("unbalance", "unbalance_relative")
    if figure is None or figure.trend != figure.trend or not figure.value:
        return "–"
    change = figure.trend / abs(figure.value)
    return "↑" if change > 0.2 else "↓" if change < -0.2 else "→"


def _spread(quantity: str) -> Callable[[RotorShot], str]:
    def cell(rotor: RotorShot) -> str:
        figure = rotor.figure(quantity)
        return ratio(figure.value, figure.std) if figure is not None else "–"

    return cell


def _seen(rotor: RotorShot) -> str:
    figure = rotor.figure("effectiveness")
    return number(100.0 * figure.detectable) if figure is not None else "–"


def _age(rotor: RotorShot) -> str:
    return f"{rotor.age:.1f}" if rotor.age < 100.0 else "–"


def _spark(rotor: RotorShot) -> str:
    return sparkline(rotor.trail, 9)


SPARK = "last min"
COLUMNS = (
    Column("M", 3, 0, lambda rotor: str(rotor.motor)),
    Column("", 12, 6, lambda rotor: rotor.seat.split(",")[0][:11]),
    Column(SPARK, 10, 99, _spark),
    Column("verdict", 15, 1, _verdict),
    Column("eff", 9, 2, _effectiveness),
    Column("unbal", 6, 4, _unbalance),
    Column("trend", 6, 10, _trend),
    Column("rpm", 6, 3, lambda rotor: number(rotor.speed * RPM)),
    Column("A", 5, 5, lambda rotor: number(rotor.current, 1)),
    Column("°C", 4, 7, lambda rotor: number(rotor.temperature_degc)),
    Column("age s", 6, 8, _age),
    Column("seen%", 6, 9, _seen),
    Column("drag", 9, 11, _spread("drag")),
    Column("degrad.", 9, 12, _spread("degradation")),
    Column("V", 5, 13, lambda rotor: number(rotor.voltage, 1)),
)


def columns(cells: int, sparks: bool) -> list[Column]:
    """Return the columns that fit, the most wanted first given room."""
    wanted = sorted(COLUMNS, key=lambda column: 5.5 if sparks and column.rank == 99 else column.rank)
    chosen: set[str] = set()
    room = cells
    for column in wanted:
        if column.rank == 99 and not sparks:
            continue
        if column.width > room:
            break
        room -= column.width
        chosen.add(column.title)
    return [column for column in COLUMNS if column.title in chosen]


def table(rotors: Sequence[RotorShot], cells: int, sparks: bool, chosen: int = 0) -> list[Line]:
    """Return heading, one line a rotor, and what would be seen; `sparks`: the last minute as a column."""
    shown = columns(cells, sparks)
    lines = [title("rotors", cells)]
    lines.append(fit(line(("".join(_place(column, column.title) for column in shown), "dim")), cells))
    for rotor in rotors:
        style = STYLE[rotor.level]
        parts = [
            (
                _place(column, column.cell(rotor)),
                "curve" if column.title == SPARK and style == "fail" else style,
            )
            for column in shown
        ]
        if rotor.motor == chosen:
            parts[0] = (parts[0][0], "pick")
        lines.append(fit(tuple(parts), cells))
    unknown = [rotor for rotor in rotors if rotor.level is Level.UNKNOWN]
    said = f"why unknown: {common_reason(unknown)}" if unknown else seen_now(rotors)
    lines.append(fit(line((f"   {said}", "dim")), cells))
    return lines


def sparklines(rotors: Sequence[RotorShot], cells: int) -> list[Line]:
    """Return the last minute of every rotor's failure probability."""
    lines = [title("last minute: failure probability", cells)]
    wide = cells - 3
    for rotor in rotors:
        lines.append(
            line(
                f"{rotor.motor:<3}",
                (sparkline(rotor.trail, wide), "curve" if rotor.level is Level.FAILED else "dim"),
            )
        )
    return lines


LEFT = frozenset({"M", "", "verdict", SPARK})


def _place(column: Column, text: str) -> str:
    text = text[: column.width - 1]
    return text.ljust(column.width) if column.title in LEFT else text.rjust(column.width - 1) + " "
