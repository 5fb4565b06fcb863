"""The smallest fault of each kind that would be seen now, in words, from what the estimators say of it.

Each estimator works out its own (`Estimate.detectable`), at the false alarm rate of its rules; here is which of them
answers for which kind of fault, and in which unit. A kind of which none would be seen is named too: that nothing was
found means nothing there.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple


class Answers(NamedTuple):
    """Whose estimate answers for a kind of fault; `scale` SI units are one of `unit`."""

    kind: str
    estimator: str
    quantities: tuple[str, ...]
    scale: float
    unit: str


KINDS = (
    Answers("thrust loss", "effectiveness", ("effectiveness",), 0.01, "%"),
    Answers("unbalance", "unbalance", ("unbalance",), 1e-6, "g mm"),
    Answers("unbalance", "unbalance", ("unbalance_relative",), 1e-6, "µm"),
    Answers("drag rise", "motor_observer", ("drag",), 0.01, "%"),
)
NONE = "none"


def smallest(said: Iterable[tuple[str, str, float]]) -> dict[str, str]:
    """Return the smallest fault that would be seen, by kind, in words; "none" where no size would.

    Parameters
    ----------
    said : (estimator, quantity, detectable [SI], NaN = none) of one rotor or of several; the least counts.

    Examples
    --------
    >>> smallest([("effectiveness", "effectiveness", 0.24), ("unbalance", "unbalance", 9e-6)])
    {'thrust loss': '24 %', 'unbalance': '9 g mm'}
    """
    found: dict[str, tuple[float, str]] = {}
    for estimator, quantity, detectable in said:
        for each in KINDS:
            if estimator == each.estimator and quantity in each.quantities:
                size = detectable / each.scale if math.isfinite(detectable) else math.inf
                if size <= found.get(each.kind, (math.inf, ""))[0]:
                    found[each.kind] = (size, each.unit)
    return {
        kind: f"{size:.2g} {unit}" if size < 99.5 else _large(size, unit)
        for kind, (size, unit) in found.items()
    }


def sentence(said: Iterable[tuple[str, str, float]]) -> str:
    """Return it in one line: "thrust loss 24 %, unbalance 9 g mm, drag rise none"; empty if nobody says."""
    return ", ".join(f"{kind} {size}" for kind, size in smallest(said).items())


def _large(size: float, unit: str) -> str:
    return f"{size:.0f} {unit}" if size < math.inf else NONE
