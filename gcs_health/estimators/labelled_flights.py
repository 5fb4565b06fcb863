"""Flights whose truth is known: what a pooled model is trained on."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.errors import ConfigError
from gcs_health.samples import BoomReading, ImuReading, Reading

Array = NDArray[np.float64]
BOOM = "boom"  # the channel that is each rotor's own boom sensor
IMU = ("ax", "ay", "az", "p", "q", "r")
GAP = 1.6  # sample steps beyond which a stretch ends
SHORTEST = 100  # samples that make a stretch


@dataclass(frozen=True, slots=True)
class LabelledFlight:
    """A steady, gapless stretch of one flight.

    vehicle : which one of the kind. rotor : index, of no matter when k = 0. k : degradation.
    signals : of each IMU channel (n,) at the model's rate. booms : (n, rotors), NaN where there is no sensor.
    speeds : (m, rotors) rotor speeds [rad/s], if known.
    """

    vehicle: str
    rotor: int
    k: float
    signals: Mapping[str, NDArray[np.floating]]
    booms: NDArray[np.floating] | None = None
    speeds: NDArray[np.floating] | None = None

    def signal(self, channel: str, rotor: int) -> Array:
        """Return (n,): the channel as the model of `rotor` sees it."""
        if channel == BOOM:
            if self.booms is None:
                raise ConfigError(f"vehicle {self.vehicle!r}: a labelled flight without boom sensors")
            return np.asarray(self.booms[:, rotor], dtype=float)
        if channel not in self.signals:
            raise ConfigError(f"vehicle {self.vehicle!r}: a labelled flight without the channel {channel!r}")
        return np.asarray(self.signals[channel], dtype=float)

    @property
    def length(self) -> int:
        """Samples."""
        return len(self.booms) if self.booms is not None else len(next(iter(self.signals.values())))


def labelled(
    readings: Iterable[Reading], vehicle: str, rotor: int, k: float, rate: float, start: float, stop: float
) -> list[LabelledFlight]:
    """Cut a flight's readings between two times [s] into gapless stretches of one label.

    Stretches of the IMU and of the boom sensors are flights of their own. Rotor speeds are not taken: give
    them yourself where they are evenly sampled.
    """
    imu: list[list[float]] = []
    booms: list[list[float]] = []
    out: list[LabelledFlight] = []
    last = {ImuReading: math.nan, BoomReading: math.nan}

    def close(rows: list[list[float]], kind: type) -> None:
        if len(rows) >= SHORTEST:
            columns = np.array(rows)
            if kind is BoomReading:
                out.append(LabelledFlight(vehicle, rotor, k, {}, columns))
            else:
                out.append(LabelledFlight(vehicle, rotor, k, dict(zip(IMU, columns.T, strict=True))))
        rows.clear()

    for reading in readings:
        if not start <= reading.t <= stop or not isinstance(reading, ImuReading | BoomReading):
            continue
        kind = type(reading)
        rows = imu if kind is ImuReading else booms
        if not reading.t - last[kind] <= GAP / rate:
            close(rows, kind)
        rows.append(list(reading[1:]) if isinstance(reading, ImuReading) else list(reading.az))
        last[kind] = reading.t
    close(imu, ImuReading)
    close(booms, BoomReading)
    return out
