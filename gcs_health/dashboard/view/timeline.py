"""A replay's line: where it stands, how it plays, and the alerts along the flight."""

from gcs_health.dashboard.snapshot import ReplayShot
from gcs_health.dashboard.view.lines import Line, line
from gcs_health.dashboard.words import span

HEAD = 25  # cells before the bar


def timeline(replay: ReplayShot, cells: int) -> Line:
    """Return position, speed, and a bar: ✗ grave alerts, ! others, a arming, d disarming, ● here."""
    sign = "▶" if replay.playing else "‖"
    if replay.backwards:
        sign = "◀" if replay.playing else "‖◀"
    speed = "max" if replay.speed == float("inf") else f"{replay.speed:g}x"
    length = (replay.end_us - replay.start_us) * 1e-6
    at, end = span((replay.at_us - replay.start_us) * 1e-6), span(length)
    read = "" if replay.scanned >= 1.0 else f" {100 * replay.scanned:2.0f} %"
    head = f"{sign:<2}{speed:>5} {at}/{end}{read}"[: HEAD - 1].ljust(HEAD)
    wide = max(cells - HEAD, 1)
    bar = ["─"] * wide
    for us, armed in replay.armings:
        bar[place(replay, us, wide)] = "a" if armed else "d"
    for us, severity in sorted(replay.marks, key=lambda mark: -mark[1]):
        bar[place(replay, us, wide)] = "✗" if severity <= 2 else "!"
    here = place(replay, replay.at_us, wide)
    return line((head, "bold"), ("".join(bar[:here]), ""), ("●", "pick"), ("".join(bar[here + 1 :]), "dim"))


def place(replay: ReplayShot, us: int, wide: int) -> int:
    """Return the cell of the bar at which a time lies."""
    length = max(replay.end_us - replay.start_us, 1)
    return min(max(int((us - replay.start_us) / length * wide), 0), wide - 1)


def time_at(replay: ReplayShot, cell: int, cells: int) -> int | None:
    """Return the UNIX µs that a cell of the line stands for; None beside the bar."""
    wide = max(cells - HEAD, 1)
    if not 0 <= cell - HEAD < wide:
        return None
    return replay.start_us + int((cell - HEAD + 0.5) / wide * (replay.end_us - replay.start_us))
