"""What stands out in a fleet: rotors against their sisters, seats against each other, flights against the rest.

One value a flight, rotor, estimator and quantity: the mean of its valid estimates. Every comparison is first
rid of what the regime explains (a rotor that turns faster shakes more), each has an interval, and all of a
kind are corrected together, so that two hundred aircraft do not give ten findings by chance.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gcs_health.condition.growth import GROWING
from gcs_health.record.trends import Point, Trend, trend

Array = np.ndarray[Any, np.dtype[np.float64]]

RATE = 0.05  # false discovery rate, of each kind of comparison
LEAST = 5  # sisters, aircraft or flights; with fewer nothing is compared
ROUNDS = 5  # of setting aside what stands out, so that one odd rotor does not hide another


class Value(NamedTuple):
    """One quantity of one rotor in one flight; `mean_speed` [rad/s] of the vehicle's rotors is the regime."""

    aircraft: str
    motor: int
    flight: str
    started_us: int
    estimator: str
    quantity: str
    value: float
    std: float
    mean_speed: float


class Finding(NamedTuple):
    """What differs from its like.

    Attributes
    ----------
    motor : 0 where it is no single rotor's. flights : that it rests on (of a flight: what it is compared with).
    difference, low, high : from its like, with the 95 % interval, not corrected.
    q : the least false discovery rate at which it would be a finding (Benjamini and Hochberg 1995).
    """

    aircraft: str
    motor: int
    flight: str
    estimator: str
    quantity: str
    flights: int
    difference: float
    low: float
    high: float
    q: float


class Growth(NamedTuple):
    """A rotor's quantity that grows over flights."""

    aircraft: str
    motor: int
    estimator: str
    quantity: str
    trend: Trend


def values_of(rotors: Mapping[str, Sequence[Any]]) -> list[Value]:
    """Return the values in the rotors' table that were valid in flight."""
    rows = zip(*(rotors[name] for name in (*Value._fields, "valid")), strict=True)
    return [Value._make(row[:-1]) for row in rows if row[-1] and row[6] is not None and np.isfinite(row[6])]


def normalised(values: Sequence[Value]) -> list[Value]:
    """Return the values of one estimator and quantity as at the fleet's median rotor speed.

    The slope against log speed is that within each rotor over its flights (fixed effects), so that a heavier
    aircraft's higher speed does not pass for its own rotors' fault. Kept only where the flights bear it out:
    an interval of 95 % that leaves zero out.
    """
    known = [v for v in values if v.mean_speed > 0.0]
    if not known:
        return list(values)
    middle = float(np.median([v.mean_speed for v in known]))
    x = np.array([np.log(v.mean_speed / middle) for v in known])
    y = np.array([v.value for v in known])
    _, group = np.unique([f"{v.aircraft}/{v.motor}" for v in known], return_inverse=True)
    dx, dy = _within(x, group), _within(y, group)
    freedom = len(known) - int(group.max()) - 2
    if freedom < LEAST or not (dx**2).sum() > 1e-12:
        return list(values)
    slope = float((dx * dy).sum() / (dx**2).sum())
    error = float(np.sqrt(((dy - slope * dx) ** 2).sum() / freedom / (dx**2).sum()))
    if abs(slope) < _quantile(freedom) * error:
        return list(values)
    return [
        v._replace(value=v.value - slope * float(np.log(v.mean_speed / middle))) if v.mean_speed > 0.0 else v
        for v in values
    ]


def odd_rotors(values: Sequence[Value]) -> list[Finding]:
    """Return the rotors that differ from all other rotors of the fleet.

    A rotor's mean against the mean and spread of the others' means: a new draw from a normal population, whose
    statistic is Student's with n - 2 degrees of freedom (externally studentized).
    """
    tests = []
    for (estimator, quantity), of in _kinds(values):
        units = _units(of)
        if len(units) <= LEAST:
            continue
        keys = list(units)
        means = np.array([np.mean([v.value for v in units[key]]) for key in keys])
        odd = np.zeros(len(keys), bool)
        for _ in range(ROUNDS):
            rows = [_against(means, k, odd) for k in range(len(keys))]
            found = np.array([p for *_, p in rows]) * len(keys) < RATE  # strict, only to set aside
            if not (found & ~odd).any() or (odd | found).sum() > len(keys) // 4:
                break
            odd |= found
        for (aircraft, motor), (difference, half, p) in zip(keys, rows, strict=True):
            n = len(units[aircraft, motor])
            finding = Finding(
                aircraft,
                motor,
                "",
                estimator,
                quantity,
                n,
                difference,
                difference - half,
                difference + half,
                p,
            )
            tests.append(finding)
    return _corrected(tests)


def odd_seats(values: Sequence[Value]) -> list[Finding]:
    """Return the motor numbers that differ from the other rotors of the same aircraft, over the fleet (t test)."""
    tests = []
    for (estimator, quantity), of in _kinds(values):
        means: dict[str, dict[int, float]] = defaultdict(dict)
        for (aircraft, motor), unit in _units(of).items():
            means[aircraft][motor] = float(np.mean([v.value for v in unit]))
        for motor, (n, difference, half, p) in _seats(list(means.values())).items():
            tests.append(
                Finding(
                    "", motor, "", estimator, quantity, n, difference, difference - half, difference + half, p
                )
            )
    return _corrected(tests)


def _seats(means: Sequence[Mapping[int, float]]) -> dict[int, tuple[int, float, float, float]]:
    """Return, by motor, aircraft compared, mean difference from the aircraft's others, half its interval, and p.

    A seat that stands out is no measure for the others, which would seem to stand out the other way: the surest is
    set aside and the rest compared again, for at most a quarter of the seats.
    """
    seats = sorted({motor for of_one in means for motor in of_one})
    odd: set[int] = set()
    while True:
        rows = {}
        for motor in seats:
            gaps = np.array(
                [
                    of_one[motor] - np.mean(others)
                    for of_one in means
                    if motor in of_one
                    and len(others := [v for m, v in of_one.items() if m != motor and m not in odd]) > 1
                ]
            )
            if len(gaps) >= LEAST and gaps.std() > 0.0:
                error = float(gaps.std(ddof=1) / np.sqrt(len(gaps)))
                difference, freedom = float(gaps.mean()), len(gaps) - 1
                p = _two_sided(difference / error, freedom)
                rows[motor] = (len(gaps), difference, _quantile(freedom) * error, p)
        surest = min((m for m in rows if m not in odd), key=lambda m: rows[m][3], default=None)
        if surest is None or rows[surest][3] * len(rows) >= RATE or len(odd) >= max(len(seats) // 4, 1):
            return rows
        odd.add(surest)


def odd_flights(values: Sequence[Value]) -> list[Finding]:
    """Return the flights in which a rotor differs from its own other flights."""
    tests = []
    for (estimator, quantity), of in _kinds(values):
        for (aircraft, motor), unit in _units(of).items():
            if len(unit) <= LEAST:
                continue
            each = np.array([v.value for v in unit])
            none = np.zeros(len(each), bool)
            for k, value in enumerate(unit):
                difference, half, p = _against(each, k, none)
                tests.append(
                    Finding(
                        aircraft,
                        motor,
                        value.flight,
                        estimator,
                        quantity,
                        len(unit) - 1,
                        difference,
                        difference - half,
                        difference + half,
                        p,
                    )
                )
    return _corrected(tests)


def growing(values: Sequence[Value]) -> list[Growth]:
    """Return the rotors of which a quantity that tells wear grows, the soonest due first; see `record.trends`."""
    found = []
    for (estimator, quantity), of in _kinds(values):
        if quantity not in GROWING:
            continue
        for (aircraft, motor), unit in _units(of).items():
            points = sorted(Point(v.started_us, v.value, v.std) for v in unit if v.started_us)
            fitted = trend(points, quantity)
            if fitted is not None and fitted.grows:
                found.append(Growth(aircraft, motor, estimator, quantity, fitted))
    return sorted(found, key=lambda g: (g.trend.due_us is None, g.trend.due_us or 0))


def _kinds(values: Sequence[Value]) -> list[tuple[tuple[str, str], list[Value]]]:
    of: dict[tuple[str, str], list[Value]] = defaultdict(list)
    for value in values:
        of[value.estimator, value.quantity].append(value)
    return [(kind, normalised(rows)) for kind, rows in sorted(of.items())]


def _units(values: Sequence[Value]) -> dict[tuple[str, int], list[Value]]:
    units: dict[tuple[str, int], list[Value]] = defaultdict(list)
    for value in values:
        units[value.aircraft, value.motor].append(value)
    return dict(sorted(units.items()))


def _within(y: Array, group: np.ndarray[Any, Any]) -> Array:
    means = np.bincount(group, y) / np.bincount(group)
    difference: Array = y - means[group]
    return difference


def _against(means: Array, k: int, odd: np.ndarray[Any, Any]) -> tuple[float, float, float]:
    """Return how far entry k lies from the others that are not odd, the half width of its interval, and p."""
    others = ~odd
    others[k] = False
    rest = means[others]
    spread = float(rest.std(ddof=1)) * float(np.sqrt(1.0 + 1.0 / len(rest)))
    difference = float(means[k] - rest.mean())
    if not spread > 0.0:
        return difference, 0.0, 1.0
    freedom = len(rest) - 1
    return difference, _quantile(freedom) * spread, _two_sided(difference / spread, freedom)


def _corrected(tests: Sequence[Finding]) -> list[Finding]:
    """Return those below the false discovery rate, the surest first; q takes the place of p."""
    if not tests:
        return []
    from scipy.stats import false_discovery_control

    q = false_discovery_control([test.q for test in tests])
    corrected = [test._replace(q=float(value)) for test, value in zip(tests, q, strict=True)]
    return sorted((test for test in corrected if test.q < RATE), key=lambda test: test.q)


def _quantile(freedom: int) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.975))


def _two_sided(t: float, freedom: int) -> float:
    from scipy.special import stdtr

    return float(2.0 * stdtr(freedom, -abs(t)))
