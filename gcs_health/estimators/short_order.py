"""An order shorter than the time between two slow rotor speeds, which looks like a lost rotor.

It turns the vehicle and leaves no trace in the speeds. But it leaves its rotor slower in the next sample, or as it
was, while a rotor that has lost its load turns faster; it is over where a loss goes on; and others are ordered with
it, so that one rotor alone explains it less well. Asked only where no motor commands come often enough to tell.
Source: this project; benchmarks/simulated_flights.md.
"""

from dataclasses import dataclass

from gcs_health.estimators.fault_bank import Verdict


@dataclass(frozen=True, slots=True)
class ShortOrderConfig:
    """What tells a loss from a short order."""

    share: float = 0.75  # of the residual; a loss that explains less must be whole
    chi2: float = 1.5  # per degree of freedom ... and leave no more than this
    freed: float = 1.03  # from one sample to the next, of a rotor that has lost its load
    lasting: float = 1.3  # times between samples after which a whole loss needs no such sign
    whole: float = 0.8  # theta
    ticks: int = 3  # of the shortest window in which a loss is looked for


def may_be_order(
    config: ShortOrderConfig,
    verdict: Verdict,
    tick_length: float,
    longest: float,
    interval: float,
    speeds: tuple[float, float],
) -> bool:
    """Whether what looks like a loss may be a short order.

    Parameters
    ----------
    verdict : the loss; tick_length : of its ticks [s]; longest : for so long it can be seen [s].
    interval : between rotor speeds [s]. speeds : of the rotor, its last two [rad/s]; NaN = not known.
    """
    whole = verdict.theta >= config.whole
    if verdict.share < config.share and (verdict.chi2 > config.chi2 or not whole):
        return True
    if whole and verdict.ticks * tick_length >= min(config.lasting * interval, longest):
        return False
    before, now = speeds
    return now < config.freed * before
