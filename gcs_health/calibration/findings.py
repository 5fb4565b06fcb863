"""What a calibration found: values with their spread and evidence, or why there is none; pooled over flights."""

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Finding:
    """One quantity from one flight, or pooled over flights.

    Attributes
    ----------
    table, key : where the vehicle file has it.
    values, stds : one number, or one a rotor in the airframe's order; empty = not identified.
    why : the evidence, or the reason why there is none.
    word : what was found, where it is no number.
    """

    table: str
    key: str
    values: tuple[float, ...]
    stds: tuple[float, ...]
    why: str
    word: str = ""

    @property
    def found(self) -> bool:
        """Whether it was identified."""
        return bool(self.word) or (bool(self.values) and all(math.isfinite(value) for value in self.values))


def missing(table: str, key: str, why: str) -> Finding:
    """Return a finding of nothing."""
    return Finding(table, key, (), (), why)


def pool(findings: list[Finding]) -> Finding:
    """Join one quantity's findings of several flights.

    The mean is weighted by the inverse variances; its spread is widened by what the flights differ more than
    their own spreads say (Birge ratio), never narrowed: a vehicle is not the same from day to day.
    """
    found = [finding for finding in findings if finding.found]
    first = findings[0]
    if not found:
        return first
    if len(found) == 1:
        return found[0]
    if first.word or found[0].word:
        words = {finding.word for finding in found}
        return (
            found[0]
            if len(words) == 1
            else missing(first.table, first.key, f"flights differ: {sorted(words)}")
        )
    values = np.array([finding.values for finding in found])
    stds = np.maximum(np.array([finding.stds for finding in found]), 1e-12 + 1e-6 * np.abs(values))
    weights = 1.0 / stds**2
    mean = (weights * values).sum(axis=0) / weights.sum(axis=0)
    own = 1.0 / weights.sum(axis=0)
    between = (weights * (values - mean) ** 2).sum(axis=0) / (len(found) - 1) * own
    spread = np.sqrt(np.maximum(own, between))
    why = f"{len(found)} of {len(findings)} flights; the best: {min(found, key=_relative).why}"
    return Finding(first.table, first.key, tuple(mean.tolist()), tuple(spread.tolist()), why)


def _relative(finding: Finding) -> float:
    return max(s / max(abs(v), 1e-12) for v, s in zip(finding.values, finding.stds, strict=True))
