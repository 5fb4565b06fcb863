"""Flights on the boom bench for the pooled AR's tables: flown once, kept if asked, given as each model needs them."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs_health.estimators.labelled_flights import LabelledFlight
from gcs_health.samples import BoomReading, CommandReading, ImuReading, Reading, RotorReading
from gcs_health.simulate.boom_bench import ROTORS, SPEED_STEP, Bench, Plan, fly_bench

GUSTS = {"light": 0.5, "middle": 1.5, "severe": 2.3}  # m/s rms
BETWEEN = (0.1, 0.3, 0.5, 0.7, 0.9)  # levels that are not fitted
RATE = 1.0 / 3e-4
AT_ONCE = 120  # flights side by side: memory
SETTLE = 6.0  # s after the onset, as the paper waits for
AXES = ("ax", "ay", "az", "p", "q", "r")


@dataclass(frozen=True)
class Flown:
    """Flights from `SETTLE` on; speeds and commands from the start."""

    plans: tuple[Plan, ...]
    signals: dict[str, np.ndarray]

    def of(self, vehicles: tuple[int, ...]) -> "Flown":
        """Return those of some vehicles."""
        kept = [j for j, plan in enumerate(self.plans) if plan.vehicle in vehicles]
        return Flown(tuple(self.plans[j] for j in kept), {k: v[..., kept] for k, v in self.signals.items()})

    def labelled(self, stream: str) -> list[LabelledFlight]:
        """Return what a model is trained on, or judges."""
        s, first = self.signals, round(SETTLE / SPEED_STEP)
        out = []
        for j, plan in enumerate(self.plans):
            six = stream == "imu100"
            columns = s["imu"][::2, :, j] if six else s["hub"][:, :, j]
            signals = dict(zip(AXES if six else ("az", "p", "q"), columns.T, strict=True))
            booms = None if six else s["booms"][:, :, j]
            speeds = s["speed"][first:, :, j]
            out.append(LabelledFlight(str(plan.vehicle), plan.rotor, plan.k, signals, booms, speeds))
        return out

    def told(self, j: int, commands: bool, step: float = SPEED_STEP) -> Iterator[Reading]:
        """Yield rotor speeds, and commands, of a flight."""
        s, absent = self.signals, (float("nan"),) * ROTORS
        for k in range(len(s["speed"])):
            t = step * (k + 1)
            if commands:
                yield CommandReading(t, tuple((s["command"][k, :, j] / 1000.0).tolist()))
            yield RotorReading(t, tuple(s["speed"][k, :, j].tolist()), absent, absent)

    def vibrated(self, j: int, stream: str) -> Iterator[Reading]:
        """Yield the IMU's or the booms' samples of a flight."""
        s, absent = self.signals, (float("nan"),) * (ROTORS - 2)
        if stream == "imu100":
            for k, six in enumerate(s["imu"][::2, :, j].tolist()):
                yield ImuReading(SETTLE + 0.01 * k, *six)
            return
        rows = s["hub" if stream == "hub" else "booms"][:, :, j].tolist()
        for k, row in enumerate(rows):
            t = SETTLE + k / RATE
            if stream == "hub":
                yield ImuReading(t, 0.0, 0.0, row[0], row[1], row[2], 0.0)
            else:
                yield BoomReading(t, (*row, *absent))


def flown(
    cache: Path | None,
    regime: str,
    name: str,
    plans: list[Plan],
    duration: float,
    onset: float = 0.0,
    speed_step: float = SPEED_STEP,
) -> Flown:
    """Fly on the bench, or take the flights from the cache."""
    file = cache / f"{regime}_{name}.npz" if cache else None
    if file is not None and file.exists():
        with np.load(file) as stored:
            return Flown(tuple(plans), {k: stored[k] for k in ("hub", "booms", "imu", "speed", "command")})
    log(f"{regime}: {name}, {len(plans)} flights of {duration:.0f} s")
    bench = Bench(gusts=GUSTS[regime], duration=duration, onset=onset, speed_step=speed_step)
    parts = [_signals(plans[k : k + AT_ONCE], bench) for k in range(0, len(plans), AT_ONCE)]
    signals = {key: np.concatenate([part[key] for part in parts], axis=-1) for key in parts[0]}
    if file is not None:
        file.parent.mkdir(exist_ok=True)
        np.savez(file, **signals)
    return Flown(tuple(plans), signals)


def _signals(plans: list[Plan], bench: Bench) -> dict[str, np.ndarray]:
    flights = fly_bench(plans, bench)
    start = round(SETTLE * RATE)
    return {
        "hub": flights.hub[start:],
        "booms": flights.booms[start:, :2].copy(),
        "imu": flights.imu[round(SETTLE / 0.005) :],
        "speed": flights.speed,
        "command": flights.command,
    }


def log(text: str) -> None:
    """Say how far it is."""
    print(text, file=sys.stderr, flush=True)


def between(vehicles: tuple[int, ...], seed: int, times: int = 1) -> list[Plan]:
    """Return flights at levels that are not fitted, both rotors, so many `times`; seeds on from `seed`."""
    rows = [(rotor, k) for rotor in (0, 1) for k in BETWEEN] * times
    return [Plan(v, seed + 1000 * v + i, rotor, k) for v in vehicles for i, (rotor, k) in enumerate(rows)]
