"""What is flown on the boom bench, and what its sensors gave: as readings, or as flights to train on."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.estimators.labelled_flights import IMU, LabelledFlight
from gcs_health.samples import BoomReading, CommandReading, ImuReading, Reading, RotorReading
from gcs_health.simulate.vehicle import load_sim_vehicle

ROTORS = 6
IMU_MEAN = 0.005  # s, what PX4 averages over
SPEED_STEP = 0.1  # s between rotor speeds told


@dataclass(frozen=True, slots=True)
class Bench:
    """How the flights are flown.

    gusts : rms [m/s]. duration, onset [s]. oversample : physics steps a sample of 10/3 kHz; 3 = the paper's 10 kHz.
    noise : of the accelerometers [m/s²]; gyro_noise [rad/s]. speed_step [s] : between rotor speeds told.
    """

    gusts: float = 0.5
    duration: float = 40.0
    onset: float = 0.0
    oversample: int = 1
    noise: float = 0.06
    gyro_noise: float = 0.004
    speed_step: float = SPEED_STEP


@dataclass(frozen=True, slots=True)
class Plan:
    """One flight: which vehicle of the kind (its own lines and rotors), seed, rotor from 0, degradation."""

    vehicle: int
    seed: int
    rotor: int = 0
    k: float = 0.0


@dataclass(frozen=True, slots=True)
class BenchFlights:
    """What the sensors gave; the last axis is the flight.

    rate [Hz] of `hub`: az, p, q (n, 3, flights) and `booms` (n, 6, flights), specific forces along body z [m/s²].
    imu : (m, 6, flights) ax, ay, az, p, q, r as means over 5 ms, 200 Hz.
    speed, command : (s, 6, flights) [rad/s], at 10 Hz if the bench is not told otherwise.
    """

    plans: tuple[Plan, ...]
    bench: Bench
    rate: float
    hub: NDArray[np.float32]
    booms: NDArray[np.float32]
    imu: NDArray[np.float32]
    speed: NDArray[np.float32]
    command: NDArray[np.float32]

    def readings(
        self, flight: int, streams: tuple[str, ...] = ("hub", "boom", "speed", "command")
    ) -> Iterator[Reading]:
        """Yield one flight's readings in order of time; "imu100" is every other one of the 200 Hz stream."""
        rows = [row for stream in streams for row in self._rows(flight, stream)]
        rows.sort(key=lambda row: row[:2])
        for _, _, reading in rows:
            yield reading

    def _rows(self, flight: int, stream: str) -> Iterator[tuple[float, int, Reading]]:
        """Yield (time, order at one time, reading)."""
        absent = (math.nan,) * ROTORS
        step, told = 1.0 / self.rate, round(self.bench.speed_step * self.rate) / self.rate
        if stream == "hub":
            for k, (az, p, q) in enumerate(self.hub[:, :, flight].tolist()):
                yield k * step, 2, ImuReading(k * step, 0.0, 0.0, az, p, q, 0.0)
        elif stream == "boom":
            for k, values in enumerate(self.booms[:, :, flight].tolist()):
                yield k * step, 3, BoomReading(k * step, tuple(values))
        elif stream == "imu100":
            for k, six in enumerate(self.imu[::2, :, flight].tolist()):
                yield 2.0 * IMU_MEAN * k, 2, ImuReading(2.0 * IMU_MEAN * k, *six)
        elif stream == "command":
            for k, values in enumerate((self.command[:, :, flight] / (2.0 * self.hover)).tolist()):
                yield told * (k + 1), 0, CommandReading(told * (k + 1), tuple(values))
        else:
            for k, values in enumerate(self.speed[:, :, flight].tolist()):
                yield told * (k + 1), 1, RotorReading(told * (k + 1), tuple(values), absent, absent)

    @property
    def hover(self) -> float:
        """Rotor speed in hover [rad/s]."""
        return load_sim_vehicle("dutta_hexa").hover

    def labelled(self, skip: float = 6.0, stream: str = "hub") -> list[LabelledFlight]:
        """Return every flight from `skip` [s] on as what a model is trained on; stream: "hub" or "imu100"."""
        out, step = [], self.bench.speed_step
        for j, plan in enumerate(self.plans):
            speeds = self.speed[round(skip / step) :: round(SPEED_STEP / step), :, j]
            if stream == "imu100":
                six = self.imu[round(skip / IMU_MEAN) :: 2, :, j]
                signals, booms = dict(zip(IMU, six.T, strict=True)), None
            else:
                start = round(skip * self.rate)
                hub, booms = self.hub[start:, :, j], self.booms[start:, :, j]
                signals = dict(zip(("az", "p", "q"), hub.T, strict=True))
            out.append(LabelledFlight(str(plan.vehicle), plan.rotor, plan.k, signals, booms, speeds))
        return out
