"""What healthy rotor speeds look like outside the mixer's span, from labelled flights."""

from collections.abc import Sequence

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.estimators.labelled_flights import LabelledFlight
from gcs_health.estimators.speed_span import Array, Span, SpeedFacts

WINDOW = 20  # rotor speeds: 2 s at 10 Hz
FEW = 0.02  # spread over vehicles, and error of k, where flights are too few to tell


def learned_speeds(
    airframe: Airframe,
    fitted: Sequence[LabelledFlight],
    held_out: Sequence[LabelledFlight],
    healthy: Sequence[LabelledFlight],
) -> SpeedFacts | None:
    """Return the facts; None where flights have no rotor speeds, or too few rotors to show anything."""
    span = Span(airframe)
    told = [f for f in (*fitted, *healthy) if f.speeds is not None and f.k == 0.0]
    if not told or not span.shows:
        return None
    own: dict[str, list[Array]] = {}
    for flight in told:
        own.setdefault(flight.vehicle, []).extend(span.outside(w) for w in _windows(flight))
    means = {vehicle: np.mean(windows, axis=0) for vehicle, windows in own.items()}
    mean = np.mean(list(means.values()), axis=0)
    errors = [
        span.degradation(span.outside(w) - means[f.vehicle], w)[f.rotor] - f.k
        for f in held_out
        if f.speeds is not None and f.vehicle in means
        for w in _windows(f)
    ]
    return SpeedFacts(
        healthy=mean,
        between=float(np.std(np.array(list(means.values())) - mean)) if len(means) > 1 else FEW,
        drift=float(np.mean([np.std(windows, axis=0).mean() for windows in own.values()])),
        error=float(np.sqrt(np.mean(np.square(errors)))) if errors else FEW,
    )


def _windows(flight: LabelledFlight) -> Array:
    """Return (w, n): mean speeds of 2 s each."""
    assert flight.speeds is not None
    speeds = np.asarray(flight.speeds, dtype=float)
    whole = max(len(speeds) // WINDOW, 1) * WINDOW
    pieces = speeds[:whole].reshape(-1, min(WINDOW, len(speeds)), speeds.shape[1])
    return np.asarray(pieces.mean(axis=1))
