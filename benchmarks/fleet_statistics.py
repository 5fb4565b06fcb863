"""How often a fleet without any fault has a finding, and how large a difference is found: fleets drawn from a seed.

    python benchmarks/fleet_statistics.py [--fleets 400] [--seed 10000]

Twelve aircraft of four rotors, eight flights each: an unbalance of 2 g mm that grows with the logarithm of the
rotor speed, differs by 0.1 g mm between rotors and by 0.05 g mm between flights. One rotor, seat or flight is
then shifted, in standard deviations of a rotor's mean, of a rotor, and of a flight.
"""

import argparse
import math
from collections.abc import Callable

import numpy as np

from gcs_health.fleet_statistics import Finding, Value, odd_flights, odd_rotors, odd_seats

AIRCRAFT, FLIGHTS = 12, 8
BETWEEN, WITHIN = 1e-7, 5e-8  # kg m, standard deviations
Compare = Callable[[list[Value]], list[Finding]]
Chosen = Callable[[int, int, int], bool]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fleets", type=int, default=400)
    parser.add_argument("--seed", type=int, default=10_000, help="of the first fleet")
    options = parser.parse_args()
    print(f"`python benchmarks/fleet_statistics.py --fleets {options.fleets} --seed {options.seed}`\n")
    print(
        "| compared | shift [standard deviations] | fleets | with the shifted one found | with another found |"
    )
    print("|---|---|---|---|---|")
    kinds: list[tuple[str, Compare, Chosen, float, str]] = [
        (
            "rotors",
            odd_rotors,
            lambda a, m, f: (a, m) == (3, 2),
            math.hypot(BETWEEN, WITHIN / 8**0.5),
            "a3/2/",
        ),
        ("seats", odd_seats, lambda a, m, f: m == 2, BETWEEN, "/2/"),
        ("flights", odd_flights, lambda a, m, f: (a, m, f) == (3, 2, 4), WITHIN, "a3/2/4"),
    ]
    for name, compare, chosen, scale, key in kinds:
        for shift in (0.0, 1.0, 2.0, 4.0, 6.0, 8.0):
            right = wrong = 0
            for k in range(options.fleets):
                found = compare(_fleet(options.seed + k, chosen, shift * scale))
                keys = {f"{f.aircraft}/{f.motor}/{f.flight}" for f in found}
                right += key in keys and shift > 0.0
                wrong += bool(keys - {key} if shift else keys)
            n = options.fleets
            print(f"| {name} | {shift:g} | {n} | {_share(right, n) if shift else ''} | {_share(wrong, n)} |")


def _share(count: int, n: int) -> str:
    """A share with its 95 % interval (Wilson 1927)."""
    z, p = 1.96, count / n
    middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = ((middle + sign * half) / (1 + z * z / n) for sign in (-1, 1))
    return f"{100 * p:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def _fleet(seed: int, chosen: Chosen, shift: float) -> list[Value]:
    rng = np.random.default_rng(seed)
    values = []
    for a in range(AIRCRAFT):
        own, weight = rng.normal(0.0, BETWEEN, 4), rng.normal(0.0, 0.1)
        for f in range(FLIGHTS):
            speed = 600.0 * float(np.exp(weight + rng.normal(0.0, 0.05)))
            for m in range(1, 5):
                value = 2e-6 + own[m - 1] + 2e-6 * float(np.log(speed / 600.0)) + rng.normal(0.0, WITHIN)
                value += shift * chosen(a, m, f)
                values.append(Value(f"a{a}", m, str(f), f, "unbalance", "unbalance", value, 0.0, speed))
    return values


if __name__ == "__main__":
    main()
