"""A vehicle's history as text for people."""

import math
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime

from gcs_health.balance import grade
from gcs_health.cli.text import UNIT, maintenance
from gcs_health.record.trends import Mean, Trend
from gcs_health.record.vehicle_history import Line, Mended, VehicleHistory

FLIGHTS_SHOWN = 12
WEEK = 7.0


def days_text(at_us: int) -> str:
    """Render a UNIX time [µs] to the minute."""
    return f"{datetime.fromtimestamp(at_us * 1e-6, UTC):%Y-%m-%d %H:%M} UTC" if at_us else "without a date"


def vehicle_text(told: VehicleHistory, *, brief: bool) -> str:
    """One vehicle; `brief` leaves out its single flights."""
    vehicle = told.vehicle
    name = f" ({vehicle['name']})" if vehicle["name"] else ""
    lines = [f"vehicle {vehicle['vehicle']}{name}: {_count(len(told.flights), 'flight')}"]
    alerts = Counter(alert["flight"] for alert in told.alerts)
    shown = told.flights[-1:] if brief else told.flights[-FLIGHTS_SHOWN:]
    if len(shown) < len(told.flights) and not brief:
        lines.append(f"  {len(told.flights) - len(shown)} earlier flights; --format csv has all")
    for flight in shown:
        minutes, seconds = divmod(round(flight["duration"]), 60)
        said = _count(alerts[flight["flight"]], "alert") if alerts[flight["flight"]] else "no alert"
        lines.append(f"  {days_text(flight['started_us']):<22}{minutes:>4}:{seconds:02d}  {said}")
    for line in told.lines:
        lines += _line(line, brief)
    lines += _within(told, {flight["flight"] for flight in shown})
    lines += [_mended(each) for each in told.mended]
    return "\n".join(lines) + "\n"


def _line(line: Line, brief: bool) -> Iterator[str]:
    points = line.points or line.alike.points
    if not points or (brief and not (line.trend and line.trend.grows)):
        return
    factor, unit = UNIT.get(line.quantity, (1.0, "SI"))
    last = line.based_on[-1] if line.like_with_like else points[-1]
    yield (
        f"  motor {line.motor}  {line.quantity} {_number(last.value * factor)}"
        f"{f' ± {_number(last.std * factor)}' if math.isfinite(last.std) else ''} {unit}".rstrip()
        + (f" ({grade(line.balance_quality)})" if math.isfinite(line.balance_quality) else "")
        + f", {_count(len(points), 'flight')} since the baseline began ({line.estimator})"
    )
    if line.trend is not None:
        yield "           " + _trend(line.trend, factor, unit) + _basis(line)


def _trend(trend: Trend, factor: float, unit: str) -> str:
    slope, low, high = (_number(s * factor * WEEK) for s in (trend.slope, trend.low, trend.high))
    rate = f"{slope} ({low} to {high}) {unit}".rstrip() + " a week"
    if not trend.grows:
        return f"no growth that the flights bear out: {rate}"
    limit = f"{_number(trend.limit * factor)} {unit}".rstrip()
    if trend.due_us is None:
        return f"maintenance: grows by {rate}"
    latest = f"to {_day(trend.latest_us)}" if trend.latest_us is not None else "or later"
    when = f"about {_day(trend.due_us)} ({_day(trend.earliest_us)} {latest})"
    return f"maintenance: grows by {rate}; at {limit} {when}"


def _basis(line: Line) -> str:
    """Say on which flights a trend stands."""
    if not line.like_with_like:
        return " (all regimes together)"
    payload = ", payload taken out" if line.quantity != "drag" else " against the other rotors"
    return f" ({line.alike.regime} of {len(line.alike.points)} flights, {line.alike.seconds:.0f} s{payload})"


def _within(told: VehicleHistory, flights: set[str]) -> Iterator[str]:
    """Say what grew within single flights."""
    for row in told.condition:
        if row.grows and row.flight in flights:
            yield f"  {days_text(row.started_us)}  {maintenance(row._asdict())}"


def _mended(each: Mended) -> str:
    factor, unit = UNIT.get(each.quantity, (1.0, "SI"))
    before, after = (_mean(side, factor, unit) for side in (each.repair.before, each.repair.after))
    return (
        f"  {days_text(each.mark.at_us)}  motor {each.mark.motor}: {each.mark.what}: {each.quantity} "
        f"{before} before, {after} after: {each.repair.verdict} ({each.estimator})"
    )


def _mean(mean: Mean, factor: float, unit: str) -> str:
    if not mean.flights:
        return "not flown"
    said = f"{_number(mean.mean * factor)} {unit}".rstrip()
    if math.isfinite(mean.low):
        said += f" ({_number(mean.low * factor)} to {_number(mean.high * factor)})"
    return said


def _day(at_us: int | None) -> str:
    return f"{datetime.fromtimestamp(at_us * 1e-6, UTC):%Y-%m-%d}" if at_us is not None else "never"


def _number(value: float) -> str:
    return f"{value:.3g}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"
