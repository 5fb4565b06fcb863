"""One vehicle's history as it is shown: its flights, the trend of each rotor since its last repair, repairs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, NamedTuple

from gcs_health.condition.growth import GROWING
from gcs_health.record.comparable import ESTIMATOR, NOTHING, Comparable, comparable
from gcs_health.record.history import ConditionRow, History, MarkRow, ResultRow
from gcs_health.record.trends import FLIGHTS_LEAST, Point, Repair, Trend, repair, trend

Series = tuple[int, str, str]  # motor, estimator, quantity


class Line(NamedTuple):
    """One quantity of one rotor since its last repair; `trend` is None with too few flights.

    `points` are the flights' plain means; `alike` is what of them can be compared, and what the trend stands on
    unless it is empty.
    `balance_quality` is ISO 21940-11's G of an unbalance in the last flight [mm/s]; NaN where it cannot be told.
    """

    motor: int
    estimator: str
    quantity: str
    points: tuple[Point, ...]
    trend: Trend | None
    balance_quality: float
    alike: Comparable = NOTHING

    @property
    def like_with_like(self) -> bool:
        """Whether a trend stands on the flights alike; else too few of them told their regime, and it is on all."""
        return len(self.alike.points) >= FLIGHTS_LEAST

    @property
    def based_on(self) -> Sequence[Point]:
        """The flights that a trend stands on."""
        return self.alike.points if self.like_with_like else self.points


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
    vehicle, flights, alerts : rows as stored. results, condition : those of the rotors asked for.
    lines : one a rotor, estimator and quantity. mended : one a repair, estimator and quantity.
    """

    vehicle: Mapping[str, Any]
    flights: Sequence[Mapping[str, Any]]
    alerts: Sequence[Mapping[str, Any]]
    results: Sequence[ResultRow]
    lines: Sequence[Line]
    mended: Sequence[Mended]
    condition: Sequence[ConditionRow] = ()

    @classmethod
    def of(
        cls, history: History, vehicle: Mapping[str, Any], motor: int | None, limits: Mapping[str, float]
    ) -> "VehicleHistory":
        """Read one vehicle, of all motors or one; `limits` by quantity are for the trends."""
        key = vehicle["vehicle"]
        results, condition, marks = history.results(key), history.condition(key), history.marks(key)
        # of all motors, whichever is shown: what is certain depends on how many are looked at
        tale = _Tale(results, condition, marks)
        lines = [line for line in tale.lines(limits) if motor in (None, line.motor)]
        mended = [each for each in tale.mended() if motor in (None, each.mark.motor)]
        results = [row for row in results if motor in (None, row.motor)]
        condition = [row for row in condition if motor in (None, row.motor)]
        flights, alerts = history.flights(key), history.alerts(key)
        return cls(vehicle, flights, alerts, results, lines, mended, condition)

    def as_object(self) -> dict[str, Any]:
        """Return it as `history --format json` has it."""
        return {
            **self.vehicle,
            "flights": [dict(row) for row in self.flights],
            "alerts": [dict(row) for row in self.alerts],
            "results": [row._asdict() for row in self.results],
            "condition": [row._asdict() | {"grows": bool(row.grows)} for row in self.condition],
            "trends": [
                {"motor": x.motor, "estimator": x.estimator, "quantity": x.quantity}
                | x.trend._asdict()
                | dict(
                    zip(("regime", "seconds"), x.alike[:2] if x.like_with_like else (None, None), strict=True)
                )
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


class _Tale:
    """The flights of one vehicle, series by series."""

    def __init__(
        self, results: Sequence[ResultRow], condition: Sequence[ConditionRow], marks: Sequence[MarkRow]
    ) -> None:
        self._marks = marks
        self._plain: dict[Series, list[Point]] = {}
        self._quality: dict[Series, float] = {}
        self._condition: dict[Series, list[ConditionRow]] = {}
        for row in results:
            if row.valid and row.started_us:  # what has no date has no place in a trend
                key = (row.motor, row.estimator, row.quantity)
                self._plain.setdefault(key, []).append(Point(row.started_us, row.value, row.std))
                self._quality[key] = row.balance_quality
        for each in condition:
            key = (each.motor, ESTIMATOR[each.quantity], each.quantity)
            self._condition.setdefault(key, []).append(each)

    def lines(self, limits: Mapping[str, float]) -> list[Line]:
        """Return all series since the last repair of their motors."""
        found = []
        for key in self._series():
            own = self._own(key)
            start = own[-1].at_us if own else None
            alike = comparable(_within(self._condition.get(key, ()), start, None))
            points = _between(self._plain.get(key, ()), start, None)
            found.append(Line(*key, points, None, self._quality.get(key, math.nan), alike))
        growing = [line for line in found if line.quantity in GROWING]
        starts: dict[str, list[float]] = {}
        for line in growing:
            starts.setdefault(line.quantity, []).extend(point.value for point in line.based_on[:1])
        return [
            line._replace(
                trend=trend(
                    line.based_on,
                    line.quantity,
                    limits.get(line.quantity),
                    series=len(growing),
                    usual=median(starts[line.quantity] or [0.0]),
                )
            )
            if line.quantity in GROWING
            else line
            for line in found
        ]

    def mended(self) -> list[Mended]:
        """Return what each repair did, the oldest first."""
        found = []
        for key in self._series():
            own = self._own(key)
            for k, mark in enumerate(own):
                start = own[k - 1].at_us if k else None
                end = own[k + 1].at_us if k + 1 < len(own) else None
                alike = comparable(_within(self._condition.get(key, ()), start, end)).points
                before, after = _between(alike, None, mark.at_us), _between(alike, mark.at_us, None)
                if min(len(before), len(after)) < 2:  # an older version stored one side, or both
                    plain = _between(self._plain.get(key, ()), start, end)
                    before, after = _between(plain, None, mark.at_us), _between(plain, mark.at_us, None)
                compared = repair(before, after, less_is_better=key[2] != "effectiveness")
                found.append(Mended(mark, key[1], key[2], compared))
        return sorted(found, key=lambda each: (each.mark.at_us, each.mark.motor))

    def _series(self) -> list[Series]:
        return sorted({*self._plain, *self._condition})

    def _own(self, key: Series) -> list[MarkRow]:
        return [mark for mark in self._marks if mark.motor == key[0]]


def _within(rows: Sequence[ConditionRow], start_us: int | None, end_us: int | None) -> list[ConditionRow]:
    return [
        row
        for row in rows
        if (start_us is None or row.started_us >= start_us) and (end_us is None or row.started_us < end_us)
    ]


def _between(points: Sequence[Point], start_us: int | None, end_us: int | None) -> tuple[Point, ...]:
    return tuple(
        p
        for p in points
        if (start_us is None or p.at_us >= start_us) and (end_us is None or p.at_us < end_us)
    )
