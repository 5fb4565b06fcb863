"""An order shorter than the time between two slow rotor speeds, which looks like a lost rotor.

It turns the vehicle and leaves no trace in the speeds. But it leaves its rotor slower in the next sample, or as it
was, while a rotor that has lost its load turns faster; and it is over where a loss goes on. Asked only where no motor
commands come: they tell. Source: this project; benchmarks/simulated_flights.md.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ShortOrderConfig:
    """What tells a loss from a short order."""

    freed: float = 1.03  # from one sample to the next, of a rotor that has lost its load
    lasting: float = 1.3  # times between samples after which a loss needs no such sign
    ticks: int = 3  # of the shortest window in which a loss is looked for


def may_be_order(
    config: ShortOrderConfig, lasted: float, longest: float, interval: float, speeds: tuple[float, float]
) -> bool:
    """Whether what looks like a loss may be a short order.

    Parameters
    ----------
    lasted : for so long the loss has been seen [s]; longest : that can be seen [s].
    interval : between rotor speeds [s]. speeds : of the rotor, its last two [rad/s]; NaN = not known.
    """
    if lasted >= min(config.lasting * interval, longest):
        return False
    before, now = speeds
    return now < config.freed * before
