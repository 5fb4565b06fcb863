"""What the vehicle looks like in healthy hover: speeds, commands, trim. The baselines of later flights.

A rotor's share of speed or command and where the weight sits differ from one healthy
craft to the next by far more than a small fault moves them; only change from the own baseline tells.

Source: sheet 5 sections 4 and 5.
"""

import math

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.calibration.columns import Array, FlightColumns
from gcs_health.calibration.findings import Finding, missing

TABLE = "baseline"
LEAST_TIME = 2.0  # s of hover
WINDOW = 2.0  # s, of which medians show the spread


def hover(flight: FlightColumns, airframe: Airframe) -> list[Finding]:
    """Find hover speeds and commands, and the weight's offset."""
    speed = _rows("hover_speed", flight.rotor_t, flight.speed, flight, "no rotor speeds")
    command = _rows("hover_command", flight.command_t, flight.command, flight, "no motor commands in 0 to 1")
    return [speed, command, _offset(speed, airframe)]


def _rows(key: str, t: Array, values: Array, flight: FlightColumns, without: str) -> Finding:
    """Return the medians of columns in hover and how far medians of 2 s stray from them."""
    if not len(t) or not np.isfinite(values).any(axis=0).all():
        return missing(TABLE, key, without)
    calm = flight.hovering(t)
    windows = np.floor(t / WINDOW).astype(int)
    medians = [
        np.nanmedian(values[calm & (windows == k)], axis=0)
        for k in np.unique(windows[calm])
        if (np.isfinite(values[calm & (windows == k)]).sum(axis=0) > 2).all()
    ]
    if len(medians) < math.ceil(LEAST_TIME / WINDOW):
        return missing(TABLE, key, "less than 2 s of hover")
    middle = np.nanmedian(values[calm], axis=0)
    spread = np.std(medians, axis=0) if len(medians) > 2 else 0.05 * np.abs(middle)
    why = f"{len(medians) * WINDOW:.0f} s of hover"
    return Finding(TABLE, key, tuple(map(float, middle)), tuple(map(float, spread)), why)


def _offset(speed: Finding, airframe: Airframe) -> Finding:
    """Where the weight sits forward and right of the geometric centre [m], by the balance of equal thrusts."""
    key = "weight_offset"
    if not speed.found:
        return missing(TABLE, key, speed.why)
    if not airframe.metric:
        return missing(TABLE, key, "the geometry has no scale")
    squares = np.array(speed.values) ** 2
    spread = 2.0 * np.array(speed.values) * np.array(speed.stds)
    place = np.array([rotor.position[:2] for rotor in airframe.rotors])
    centre = place.mean(axis=0)
    offset = (squares @ place) / squares.sum() - centre
    std = np.sqrt((spread**2) @ (place - centre) ** 2) / squares.sum()
    why = "balance of hover speeds, propellers taken as equal"
    return Finding(TABLE, key, tuple(map(float, offset)), tuple(map(float, std)), why)
