"""In which regime a stretch of flight was: like is to be compared with like.

    u = sqrt(mean_k var(w_k)) / mean w      unsteadiness of the rotor speeds in the stretch [-]
    L = mean_k mean(w_k²)                   load: thrust per rotor, over the air's density [rad²/s²]
    v = atan2(|mean a_xy|, |mean a_z|)      lean of the specific force: air that moves past, wind or forward flight

Known from what the monitor has anyway: no vertical speed is, so that a steady climb shows by its load against the
flight's own. Helicopters' monitoring takes its indicators in named regimes (hover, climb, level flight at a stated
torque) for the same reason.

Source: E. Bechhoefer, "The Best Regime Recognition Algorithm for HUMS", and "Setting HUMS Condition Indicator
Thresholds by Modeling Aircraft and Torque Band Variance": the idea; the thresholds are this project's, looked at on
seeds 1 to 4 and 1000 to 1007 of `benchmarks/condition.py`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from statistics import median
from typing import NamedTuple


class Regime(StrEnum):
    """How a stretch was flown, the best to compare in first."""

    HOVER = "hover"  # steady
    WIND = "wind"  # air moves past, or gusts: wind, or forward flight
    CLIMB = "climb"  # steady with clearly more thrust than the flight's usual
    DESCENT = "descent"  # with clearly less
    MANOEUVRE = "manoeuvre"
    GROUND = "ground"  # or taking off and landing


class Stretch(NamedTuple):
    """What tells the regime of a few seconds: see the symbols above; `lean` [rad], NaN where there is no IMU."""

    unsteady: float
    load: float
    lean: float


@dataclass(frozen=True, slots=True)
class RegimeConfig:
    """Thresholds; this project's."""

    gusty: float = 0.08  # unsteadiness [-] of wind
    wild: float = 0.15  # of a manoeuvre
    leans: float = 0.07  # rad, of wind or forward flight
    other_load: float = 0.05  # of the flight's usual load: climb or descent
    ground: float = 0.5  # of it: no flight


def regimes(stretches: Sequence[Stretch], config: RegimeConfig | None = None) -> list[Regime]:
    """Return the regime of each stretch of one flight.

    Examples
    --------
    >>> calm = Stretch(0.01, 2e5, 0.01)
    >>> flown = [calm, calm, calm, calm._replace(load=2.2e5), calm._replace(lean=0.2), calm._replace(unsteady=0.2)]
    >>> [regime.value for regime in regimes([calm._replace(load=1e4), *flown])]
    ['ground', 'hover', 'hover', 'hover', 'climb', 'wind', 'manoeuvre']
    """
    if not stretches:
        return []
    c = config or RegimeConfig()
    flown = [each.load for each in stretches if each.load > c.ground * max(s.load for s in stretches)]
    least = c.ground * median(flown)
    calm = [s.load for s in stretches if s.load > least and s.unsteady < c.wild]
    usual = median(calm or flown)
    return [_regime(each, usual, c) for each in stretches]


def _regime(stretch: Stretch, usual: float, c: RegimeConfig) -> Regime:
    if stretch.load < c.ground * usual:
        return Regime.GROUND
    if stretch.unsteady > c.wild:
        return Regime.MANOEUVRE
    if stretch.unsteady > c.gusty or stretch.lean > c.leans:  # NaN leans nowhere
        return Regime.WIND
    if abs(stretch.load / usual - 1.0) <= c.other_load:
        return Regime.HOVER
    return Regime.CLIMB if stretch.load > usual else Regime.DESCENT


def best(flown: Mapping[Regime, int]) -> Regime | None:
    """Return the regime to compare in: where most was flown, but a steadier one if at least half as much.

    Examples
    --------
    >>> best({Regime.HOVER: 10, Regime.WIND: 15}).value
    'hover'
    """
    most = max(flown.values(), default=0)
    return next((regime for regime in Regime if most and 2 * flown.get(regime, 0) >= most), None)
