"""Frames that autopilots know by number, and the geometry to assume where nothing tells it."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from gcs_health.airframe import Airframe, AirframeSource, Rotor

_LAYER = 0.1  # height of a coaxial layer in a pattern without a scale

# MAV_TYPE: how many rotors, and the FRAME_CLASS and FRAME_TYPE of its X layout, numbered alike by both autopilots
_BY_TYPE = {2: (1, 1), 13: (2, 1), 14: (3, 1), 29: (12, 1), 35: (14, 1)}
_BY_COUNT = {4: (1, 1), 6: (2, 1), 8: (3, 1), 10: (14, 1), 12: (12, 1)}
_COUNT_OF_TYPE = {2: 4, 13: 6, 14: 8, 29: 12, 35: 10}


def ardupilot_frame(frame_class: int, frame_type: int) -> tuple[str, tuple[Rotor, ...]] | None:
    """Return (name, rotors) of an ArduPilot FRAME_CLASS and FRAME_TYPE; None if the table has none.

    Positions are the mixer's pattern, without a scale.
    """
    rows = [row for row in _table("ardupilot_frames.toml") if row["class"] == frame_class]
    for wanted in (frame_type, -1):
        for row in rows:
            if row["type"] == wanted:
                return row["name"], tuple(
                    Rotor(k + 1, k, (x, y, layer * _LAYER), spin)
                    for k, (x, y, spin, layer) in enumerate(row["motors"])
                )
    return None


def px4_frame(autostart: int) -> tuple[str, tuple[Rotor, ...], bool] | None:
    """Return (name, rotors, whether positions are metres) of a generic PX4 SYS_AUTOSTART; None if not listed."""
    for row in _table("px4_frames.toml"):
        if row["autostart"] == autostart:
            return row["name"], _px4_rotors(row), row["metric"]
    return None


def _px4_rotors(row: dict[str, Any]) -> tuple[Rotor, ...]:
    return tuple(Rotor(k + 1, k, (x, y, z), spin) for k, (x, y, z, spin) in enumerate(row["motors"]))


def assume_airframe(rotor_count: int, vehicle_type: int | None) -> Airframe | None:
    """Return the X layout that a vehicle of so many rotors, or of that MAV_TYPE, most likely has.

    Parameters
    ----------
    rotor_count : ESCs that have reported; 0 = none.
    vehicle_type : MAV_TYPE; None if unheard.

    None where neither tells. The warning says what was assumed and how to do better.
    """
    count = rotor_count
    frame = _BY_TYPE.get(vehicle_type or 0)
    expected = _COUNT_OF_TYPE.get(vehicle_type or 0, 0)
    if count and count != expected:
        # fewer ESCs than the type has rotors: some do not report; more: the type is wrong
        frame = frame if 0 < count < expected else _BY_COUNT.get(count)
    found = ardupilot_frame(*frame) if frame else None
    if found is None:
        return None
    name, rotors = found
    why = f"MAV_TYPE {vehicle_type}" if expected == len(rotors) else f"{count} reporting ESCs"
    warning = (
        f"geometry assumed: {name} numbered as PX4 and ArduPilot do, from {why}; "
        "give --vehicle FILE.toml or download the parameters"
    )
    return Airframe(name, rotors, AirframeSource.ASSUMED, metric=False, warnings=(warning,))


@cache
def _table(name: str) -> list[dict[str, Any]]:
    text = files("gcs_health.tables").joinpath(name).read_text("utf-8")
    frames: list[dict[str, Any]] = tomllib.loads(text)["frame"]
    return frames
