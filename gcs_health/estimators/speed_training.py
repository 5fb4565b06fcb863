"""The speed-deficit table from labelled flights, beside the pooled model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_health.estimators.labelled_flights import LabelledFlight
from gcs_health.estimators.speed_table import Array, SpeedTable

FEW = 0.05  # spread of healthy shares over vehicles, and error of k, where flights are too few to tell


def learned_table(fitted: Sequence[LabelledFlight], held_out: Sequence[LabelledFlight]) -> SpeedTable | None:
    """Return the deficits at the fitted levels and the table's error at others; None without rotor speeds."""
    told = [flight for flight in fitted if flight.speeds is not None]
    own = {flight.vehicle: flight.shares for flight in told if flight.k == 0.0}
    if not own:
        return None
    healthy = np.mean(list(own.values()), axis=0)
    levels = np.array(sorted({flight.k for flight in told}))
    deficit = np.full((len(healthy), len(levels)), np.nan)
    for rotor in {flight.rotor for flight in told if flight.k > 0.0}:
        deficit[rotor, 0] = 0.0
        for at, k in enumerate(levels[1:], 1):
            flights = [flight for flight in told if flight.k == k and flight.rotor == rotor]
            deficit[rotor, at] = np.mean(
                [_deficit(flight, own.get(flight.vehicle, healthy)) for flight in flights]
            )
    table = SpeedTable(
        levels,
        deficit,
        healthy,
        between=float(np.std(np.array(list(own.values())) / healthy)) if len(own) > 1 else FEW,
        drift=float(np.median([flight.share_drift for flight in told if flight.k == 0.0])),
        error=FEW,
        trained=True,
    )
    errors = [
        table.degradation(flight.rotor, _deficit(flight, own[flight.vehicle])) - flight.k
        for flight in held_out
        if flight.speeds is not None and flight.vehicle in own
    ]
    return replace(table, error=float(np.sqrt(np.mean(np.square(errors))))) if errors else table


def _deficit(flight: LabelledFlight, healthy: Array) -> float:
    return float(1.0 - flight.shares[flight.rotor] / healthy[flight.rotor])
