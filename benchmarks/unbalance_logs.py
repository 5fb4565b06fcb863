"""Recorded flights as readings, at any rate, for the unbalance estimator alone."""

from functools import lru_cache
from pathlib import Path

from gcs_health.airframe import Airframe
from gcs_health.airframe_tables import assume_airframe
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.samples import ImuReading, Reading, RotorReading
from gcs_health.vehicle_file import load_vehicle

VEHICLE = {
    "bebop2": "bebop2",
    "indiflight": "indiflight",
    "nanodrone": "nanodrone",
    "crazypad": "crazypad",
    "udesa_quad": "quad_x",
    "udesa_garage": "quad_x",
    "udesa_px4": "quad_x",
    "ardupilot": "quad_x",
    "px4_uavcan": "quad_x",
    "copter2015": "quad_x",
    "px4_v6c": "quad_x",
}
ROTORS = {"udesa_hexa": (0, 13), "agh_octo": (0, 14)}  # MAV_TYPE, where no vehicle file fits
RATES = {"full": (1, 1), "100/50": (5, 10), "50/10": (10, 50)}  # one in n of a 500 Hz log


def airframe(folder: Path, name: str) -> Airframe:
    """Return the vehicle file's airframe, or a regular one of so many rotors."""
    for start, file in VEHICLE.items():
        if name.startswith(start):
            return load_vehicle(folder / "vehicles" / f"{file}.toml")
    for start, (count, kind) in ROTORS.items():
        if name.startswith(start):
            assumed = assume_airframe(count, kind)
            assert assumed is not None
            return assumed
    raise KeyError(name)


@lru_cache(maxsize=2)
def readings(folder: Path, name: str) -> tuple[Reading, ...]:
    """Return everything that an estimator would be fed of a flight; times from the first record [s]."""
    heard: list[Reading] = []
    monitor = Monitor(
        MonitorConfig(
            airframe=airframe(folder, name),
            estimators=(),
            tap=lambda _, reading: heard.append(reading),
            stamped=True,
        )
    )
    data = (folder / f"{name}.tlog").read_bytes()
    for at in range(0, len(data), 1 << 16):
        monitor.feed(data[at : at + (1 << 16)])
    return tuple(heard)


def thinned(
    heard: tuple[Reading, ...], keep: tuple[int, int], phase: tuple[int, int] = (0, 0)
) -> list[Reading]:
    """Keep every n-th IMU and rotor reading, from the phase-th on."""
    seen = {ImuReading: 0, RotorReading: 0}
    out = []
    for reading in heard:
        kind = type(reading)
        if kind in seen:
            which = 0 if kind is ImuReading else 1
            count = seen[kind]
            seen[kind] += 1
            if (count - phase[which]) % keep[which]:
                continue
        out.append(reading)
    return out
