"""Indicators of each rotor's condition, gathered by regime over one flight, and their growth within it.

    unbalance   the estimator's [kg m], or [m] per vehicle mass, where its whole window lay in one regime
    drag        (I_r / w_r²) over its median of the rotors [-]; of currents at the battery's side w_r³

Drag is measured anew here: the motor observer's compares a rotor with its own beginning of the same flight, so that
what has grown since the flight before is in its reference. Air, battery and heat move all rotors alike and drop out
in the median; of unbalance the load takes out the payload (`record.comparable`).

A flight is kept as stretches of 5 s, a few numbers a rotor each, and judged when it ends.
"""

import math
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from statistics import median
from typing import NamedTuple

from gcs_health.airframe import Airframe
from gcs_health.balance import figures, words
from gcs_health.condition.growth import Line, limit_of, line
from gcs_health.condition.regime import Regime, Stretch, best, regimes
from gcs_health.estimators.contract import Estimate, Quantity, Status
from gcs_health.samples import BatteryReading, ImuReading, Reading, RotorReading

NAN = math.nan
STRETCH = 5.0  # s
IMU_EVERY = 0.05  # s; a mean over 5 s needs no more
WINDOW = 4  # stretches that an unbalance looks back on: its 20 s
KEPT = 4096  # stretches, 5.7 h: then the oldest go
LEAST = 4  # readings of a rotor in a stretch
ROTORS_LEAST = 3  # for a median
POINTS_LEAST = 8  # of 20 s, to speak of growth within a flight
POINTS_MOST = 120  # then several are taken together
CHANCE = 0.01  # that any series of a flight without growth is told to grow
HOUR = 3600.0
UNBALANCE = (Quantity.UNBALANCE, Quantity.UNBALANCE_RELATIVE)


class Indicator(NamedTuple):
    """One quantity of one rotor in one regime of one flight.

    Attributes
    ----------
    value, spread : mean and standard deviation over stretches; SI.
    seconds : flown in this regime with the quantity known.
    load : mean square of all rotors' speeds there [rad²/s²]. voltage : of the battery [V].
    slope, low, high : change an hour of flight and its 95 % interval; NaN while too little was flown.
    grows : a finding; of the regime that the flight is judged in alone.
    due : hours of flight from its end until the limit is reached at that slope; NaN without growth.
    balance : an unbalance in words: g mm, milligrams at the tip, ISO 21940-11 grade; see `gcs_health.balance`.
    """

    rotor: int
    motor: int
    quantity: str
    regime: str
    value: float
    spread: float
    seconds: float
    load: float
    voltage: float
    slope: float = NAN
    low: float = NAN
    high: float = NAN
    grows: bool = False
    due: float = NAN
    balance: str = ""


class _Row(NamedTuple):
    """A stretch: when it ended, how it was flown, and what was seen of each rotor."""

    t: float
    flown: Stretch
    voltage: float
    drag: tuple[float, ...]
    unbalance: tuple[float, ...]


_Told = tuple[Indicator, list[tuple[float, float]]]  # with time and value of each stretch


class Indicators:
    """Fed what reaches the estimators and, where `due`, what they say; `of_flight` sums up."""

    def __init__(self, airframe: Airframe) -> None:
        self._airframe = airframe
        self._n = len(airframe.rotors)
        self._cubed = airframe.motor.current_side == "battery"
        self._quantity = Quantity.UNBALANCE if airframe.mass else Quantity.UNBALANCE_RELATIVE
        self.new_flight()

    def new_flight(self) -> None:
        """Forget the flight before."""
        self._rows: deque[_Row] = deque(maxlen=KEPT)
        self._voltage = NAN
        self._open(math.inf)

    def _open(self, until: float) -> None:
        """Begin a stretch that ends at `until` [s]; infinity = it begins with the next speeds."""
        self._until = until
        self._count = [0] * self._n
        self._speed = [0.0] * self._n
        self._square = [0.0] * self._n
        self._current = [0.0] * self._n
        self._drive = [0.0] * self._n  # of speeds squared or cubed, where the current was known
        self._force = 0.0, 0.0, 0.0
        self._imu_due = -math.inf

    def read(self, reading: Reading) -> None:
        """Take a reading."""
        kind = type(reading)
        if kind is ImuReading:
            if reading.t >= self._imu_due:
                self._imu(reading)  # type: ignore[arg-type]
        elif kind is RotorReading:
            self._rotors(reading)  # type: ignore[arg-type]
        elif kind is BatteryReading:
            voltage = reading.voltage  # type: ignore[union-attr]
            self._voltage = voltage if voltage > 0.5 else NAN  # type: ignore[assignment, operator]

    def _imu(self, reading: ImuReading) -> None:
        t, ax, ay, az, _, _, _ = reading
        self._imu_due = t + IMU_EVERY
        x, y, z = self._force
        self._force = x + ax, y + ay, z + az

    def _rotors(self, reading: RotorReading) -> None:
        if not -STRETCH <= self._until - reading.t <= STRETCH:  # the first, or after a gap
            self._open(reading.t + STRETCH)
        count, speed, square = self._count, self._speed, self._square
        for k, (w, i) in enumerate(zip(reading.speed, reading.current, strict=True)):
            if w >= 0.0:
                count[k] += 1
                speed[k] += w
                w2 = w * w
                square[k] += w2
                if i == i:
                    self._current[k] += i
                    self._drive[k] += w2 * w if self._cubed else w2

    def due(self, t: float) -> bool:
        """Whether a stretch has ended by t [s]: `estimates` wants to know then what the estimators say."""
        return t >= self._until

    def estimates(self, t: float, estimates: Iterable[Estimate], sound: bool) -> None:
        """Close the stretch with what is estimated now; one in which a rotor failed is left out (not `sound`)."""
        unbalance = [NAN] * self._n
        for estimate in estimates:
            if estimate.quantity in UNBALANCE and estimate.status is Status.VALID:
                unbalance[estimate.rotor] = estimate.value
        if sound and min(self._count) >= LEAST:
            self._rows.append(_Row(t, self._flown(), self._voltage, self._drags(), tuple(unbalance)))
        self._open(t + STRETCH)

    def _flown(self) -> Stretch:
        means = [s / n for s, n in zip(self._speed, self._count, strict=True)]
        squares = [s / n for s, n in zip(self._square, self._count, strict=True)]
        variance = sum(max(q - m * m, 0.0) for q, m in zip(squares, means, strict=True)) / self._n
        mean = sum(means) / self._n
        ax, ay, az = self._force
        lean = math.atan2(math.hypot(ax, ay), abs(az)) if az else NAN
        return Stretch(math.sqrt(variance) / mean if mean > 0.0 else math.inf, sum(squares) / self._n, lean)

    def _drags(self) -> tuple[float, ...]:
        """Return each rotor's current over squared speed against the median of all."""
        each = [
            i / d if d > 0.0 and i > 0.0 else NAN for i, d in zip(self._current, self._drive, strict=True)
        ]
        known = [one for one in each if one == one]
        middle = median(known) if len(known) >= ROTORS_LEAST else NAN
        return tuple([one / middle for one in each])

    def of_flight(self) -> tuple[Indicator, ...]:
        """Return the indicators of the flight so far, by quantity, rotor and regime."""
        rows = list(self._rows)
        flown = regimes([row.flown for row in rows])
        windows = _whole_windows(rows, flown)
        found = []
        for quantity in (self._quantity, Quantity.DRAG):
            drag = quantity is Quantity.DRAG
            by_regime: dict[Regime, list[_Row]] = defaultdict(list)
            for row, regime, whole in zip(rows, flown, windows, strict=True):
                if (drag or whole) and regime is not Regime.GROUND:
                    by_regime[regime].append(row)
            judged = best({regime: len(known) for regime, known in by_regime.items()})
            for regime in Regime:
                told = [self._indicator(k, quantity, regime, by_regime[regime]) for k in range(self._n)]
                grown = self._grown(told) if regime is judged else [said for said, _ in filter(None, told)]
                found += grown
        return tuple(found)

    def _indicator(self, k: int, quantity: Quantity, regime: Regime, rows: list[_Row]) -> _Told | None:
        drag = quantity is Quantity.DRAG
        known = [(row, row.drag[k] if drag else row.unbalance[k]) for row in rows]
        known = [(row, value) for row, value in known if value == value]
        if not known:
            return None
        n = len(known)
        mean = sum(value for _, value in known) / n
        spread = math.sqrt(sum((value - mean) ** 2 for _, value in known) / (n - 1)) if n > 1 else NAN
        volts = [row.voltage for row, _ in known if row.voltage == row.voltage]
        rotor = self._airframe.rotors[k]
        said = Indicator(
            rotor.esc,
            rotor.motor,
            quantity.value,
            regime.value,
            mean,
            spread,
            n * STRETCH,
            sum(row.flown.load for row, _ in known) / n,
            sum(volts) / len(volts) if volts else NAN,
        )
        if quantity is Quantity.UNBALANCE:
            usual = math.sqrt(said.load)  # rad/s
            said = said._replace(balance=words(figures(mean, rotor.radius, rotor.propeller_mass, usual)))
        return said, [(row.t, value) for row, value in known]

    def _grown(self, told: list[_Told | None]) -> list[Indicator]:
        """Add the growth over the stretches, taken together so that neighbours know little of each other."""
        fitted: list[tuple[Indicator, Line | None]] = []
        for said, known in filter(None, told):
            points = list(_together(known, max(WINDOW, math.ceil(len(known) / POINTS_MOST))))
            enough = len(points) >= POINTS_LEAST
            chance = CHANCE / (2 * self._n)
            fitted.append((said, line(points, chance) if enough else None))
        usual = median([each.start for _, each in fitted if each is not None] or [NAN])
        return [_with_line(said, found, usual) if found else said for said, found in fitted]


def _with_line(said: Indicator, found: Line, usual: float) -> Indicator:
    limit = limit_of(said.quantity, found.start, usual)
    grows = found.grows(limit)
    due = max(limit - found.now, 0.0) / found.slope / HOUR if grows else NAN
    slopes = (found.slope * HOUR, found.low * HOUR, found.high * HOUR)
    return said._replace(slope=slopes[0], low=slopes[1], high=slopes[2], grows=grows, due=due)


def _whole_windows(rows: list[_Row], flown: list[Regime]) -> list[bool]:
    """Return whether what looks back on 20 s looked on one regime without a gap."""
    alike = 0
    out = []
    for k, row in enumerate(rows):
        follows = k > 0 and flown[k] is flown[k - 1] and row.t - rows[k - 1].t < 1.5 * STRETCH
        alike = alike + 1 if follows else 1
        out.append(alike >= WINDOW)
    return out


def _together(known: list[tuple[float, float]], count: int) -> Iterator[tuple[float, float]]:
    """Yield the mean time and value of so many after one another; what is left over goes."""
    for k in range(0, len(known) - count + 1, count):
        part = known[k : k + count]
        yield sum(t for t, _ in part) / count, sum(value for _, value in part) / count
