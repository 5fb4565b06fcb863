"""What the command line's arguments may be: each takes the text and returns the value, or says what would be right.

Raises argparse.ArgumentTypeError throughout.
"""

import argparse

from gcs_health.estimators import REGISTRY

AXES = ("ax", "ay", "az", "p", "q", "r")  # of the IMU


def estimators(text: str) -> tuple[str, ...]:
    """Names of the registry, by commas."""
    names = tuple(dict.fromkeys(text.split(",")))
    for name in names:
        if name not in REGISTRY:
            raise argparse.ArgumentTypeError(f"expected names of {', '.join(REGISTRY)}, got {name!r}")
    return names


def positive(text: str) -> float:
    """A number above 0."""
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text}")
    return value


def port(text: str) -> int:
    """Of TCP."""
    if not text.isdigit() or not 0 < int(text) < 65536:
        raise argparse.ArgumentTypeError(f"expected a port from 1 to 65535, got {text}")
    return int(text)


def count(text: str) -> int:
    """A whole number from 1 on."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number from 1 on, got {text}")
    return int(text)


def log(text: str) -> int:
    """A log's number on board."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"expected the number of a log, got {text}")
    return int(text)


def not_negative(text: str) -> float:
    """A number from 0 on."""
    value = float(text)
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a number from 0 on, got {text}")
    return value


def rate(text: str) -> float:
    """Estimates a second, up to 10."""
    value = positive(text)
    if value > 10.0:
        raise argparse.ArgumentTypeError(f"expected at most 10, got {text}")
    return value


def channels(text: str) -> tuple[str, ...]:
    """Signals of the IMU, by commas."""
    names = tuple(text.split(","))
    if not set(names) <= set(AXES):
        raise argparse.ArgumentTypeError(f"expected signals of {','.join(AXES)}, got {text!r}")
    return names


def seeds(text: str) -> tuple[int, int]:
    """First and last seed, as 1-20."""
    first, _, last = text.partition("-")
    if not first.isdigit() or not (last or first).isdigit() or int(last or first) < int(first):
        raise argparse.ArgumentTypeError(f"expected seeds as 1-20, got {text}")
    return int(first), int(last or first)
