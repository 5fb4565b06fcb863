"""One vehicle's history as it is shown: its flights, the trend of each rotor since its last repair, repairs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gcs_health.record.history import History, MarkRow, ResultRow
from gcs_health.record.trends import GROWING, Point, Repair, Trend, repair, trend

Series = tuple[int, str, str]  # motor, estimator, quantity


class Line(NamedTuple):
    """One quantity of one rotor since its last repair; `trend` is None with too few flights.

    `balance_quality` is ISO 21940-11's G of an unbalance in the last flight [mm/s]; NaN where it cannot be told.
    """

    motor: int
    estimator: str
    quantity: str
    points: tuple[Point, ...]
    trend: Trend | None
    balance_quality: float


class Mended(NamedTuple):
    """What a repair did to one quantity of the rotor."""

    mark: MarkRow
    estimator: str
    quantity: str
    repair: Repair


@dataclass(frozen=True, slots=True)
class VehicleHistory:
    """What the store says of one vehicle.

    Attributes
    ----------
    vehicle, flights, alerts : rows as stored. results : those of the rotors asked for.
    lines : one a rotor, estimator and quantity. mended : one a repair, estimator and quantity.
    """

    vehicle: Mapping[str, Any]
    flights: Sequence[Mapping[str, Any]]
    alerts: Sequence[Mapping[str, Any]]
    results: Sequence[ResultRow]
    lines: Sequence[Line]
    mended: Sequence[Mended]

    @classmethod
    def of(
        cls, history: History, vehicle: Mapping[str, Any], motor: int | None, limits: Mapping[str, float]
    ) -> "VehicleHistory":
        """Read one vehicle, of all motors or one; `limits` by quantity are for the trends."""
        key = vehicle["vehicle"]
        results = [row for row in history.results(key) if motor in (None, row.motor)]
        marks = [mark for mark in history.marks(key) if motor in (None, mark.motor)]
        series: dict[Series, list[Point]] = {}
        quality: dict[Series, float] = {}
        for row in results:
            if row.valid and row.started_us:  # what has no date has no place in a trend
                point = Point(row.started_us, row.value, row.std)
                key_of = (row.motor, row.estimator, row.quantity)
                series.setdefault(key_of, []).append(point)
                quality[key_of] = row.balance_quality
        lines, mended = [], []
        for (number, estimator, quantity), points in sorted(series.items()):
            own = [mark for mark in marks if mark.motor == number]
            now = _between(points, own[-1].at_us if own else None, None)
            fitted = trend(now, quantity, limits.get(quantity)) if quantity in GROWING else None
            last = quality[number, estimator, quantity]
            lines.append(Line(number, estimator, quantity, now, fitted, last))
            for k, mark in enumerate(own):
                before = _between(points, own[k - 1].at_us if k else None, mark.at_us)
                after = _between(points, mark.at_us, own[k + 1].at_us if k + 1 < len(own) else None)
                compared = repair(before, after, less_is_better=quantity != "effectiveness")
                mended.append(Mended(mark, estimator, quantity, compared))
        mended.sort(key=lambda each: (each.mark.at_us, each.mark.motor))
        return cls(vehicle, history.flights(key), history.alerts(key), results, lines, mended)

    def as_object(self) -> dict[str, Any]:
        """Return it as `history --format json` has it."""
        return {
            **self.vehicle,
            "flights": [dict(row) for row in self.flights],
            "alerts": [dict(row) for row in self.alerts],
            "results": [row._asdict() for row in self.results],
            "trends": [
                {"motor": x.motor, "estimator": x.estimator, "quantity": x.quantity}
                | x.trend._asdict()
                | {"grows": x.trend.grows}
                for x in self.lines
                if x.trend is not None
            ],
            "repairs": [
                x.mark._asdict()
                | {"estimator": x.estimator, "quantity": x.quantity, "verdict": x.repair.verdict}
                | {"before": x.repair.before._asdict(), "after": x.repair.after._asdict()}
                | {"change_low": x.repair.low, "change_high": x.repair.high}
                for x in self.mended
            ],
        }


def _between(points: Sequence[Point], start_us: int | None, end_us: int | None) -> tuple[Point, ...]:
    return tuple(
        p
        for p in points
        if (start_us is None or p.at_us >= start_us) and (end_us is None or p.at_us < end_us)
    )
