"""What the autopilot knows of each ESC, telemetry faults and drop-outs included."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gcs_health.simulate.faults import KINDS, Fault
from gcs_health.simulate.sensors import EscSample
from gcs_health.simulate.world import World


class Slot(NamedTuple):
    """One ESC index: its last sample, whether it still speaks, for how long not [s], packets and failure flags."""

    sample: EscSample | None
    alive: bool
    silent: float
    packets: int
    flags: int = 0


class Silence(NamedTuple):
    """A rotor's ESC is not heard, or, frozen, is heard to repeat itself; flight times [s]."""

    rotor: int
    start: float
    end: float
    frozen: bool = False


NOBODY = Slot(None, False, 0.0, 0)


class EscView:
    """ESC indices of one flight; an ESC silent for more than `patience` s is no longer alive."""

    def __init__(self, world: World, patience: float = 0.0) -> None:
        self._world = world
        self._patience = patience
        self._rotor_of = {rotor.esc: k for k, rotor in enumerate(world.scenario.vehicle.rotors)}
        faults = [fault for fault in world.faults if KINDS[fault.kind].telemetry]
        self._swaps = [fault for fault in faults if fault.kind == "esc_swapped"]
        self._reports = [fault for fault in faults if fault.kind in ("esc_heat", "esc_flags")]
        self._silences = [
            Silence(fault.rotor, fault.at, math.inf, fault.kind == "esc_frozen")
            for fault in faults
            if fault.kind in ("esc_lost", "esc_frozen")
        ]
        self._silences += drop_outs(world)
        self._held: dict[Silence, tuple[EscSample | None, int]] = {}
        self.slots = max(self._rotor_of) + 1

    def slot(self, index: int, t: float) -> Slot:
        """Return what is known of one ESC index at flight time t [s]."""
        rotor = self._rotor_of.get(index)
        if rotor is None:
            return NOBODY
        for swap in self._swaps:
            if t >= swap.at:
                rotor = _swapped(rotor, swap)
        escs = self._world.escs
        sample, packets, silent = escs.known[rotor], escs.packets[rotor], 0.0
        for silence in self._silences:
            if silence.rotor == rotor and silence.start <= t < silence.end:
                sample, packets = self._held.setdefault(silence, (sample, packets))
                silent = max(silent, 0.0 if silence.frozen else t - silence.start)
        flags = 0
        for report in self._reports:
            if report.rotor != rotor or t < report.at or sample is None:
                continue
            if report.kind == "esc_flags":
                flags |= int(report.size)
            else:
                share = min((t - report.at) / report.ramp, 1.0) if report.ramp else 1.0
                sample = sample._replace(temperature=sample.temperature + share * report.size)
        return Slot(sample, sample is not None and silent <= self._patience, silent, packets, flags)


def _swapped(rotor: int, swap: Fault) -> int:
    other = int(swap.size) - 1
    return {int(swap.rotor): other, other: int(swap.rotor)}.get(rotor, rotor)


def drop_outs(world: World) -> Iterator[Silence]:
    """Yield when which ESC is not heard for a moment: a Poisson process each, lengths exponential."""
    sensors, scenario = world.scenario.sensors, world.scenario
    if not sensors.esc_dropouts:
        return
    for rotor, stream in enumerate(
        np.random.SeedSequence((scenario.seed, 8)).spawn(len(scenario.vehicle.rotors))
    ):
        rng = np.random.default_rng(stream)
        end = 0.0
        while True:
            start = end + rng.exponential(60.0 / sensors.esc_dropouts)
            if start >= scenario.trajectory.duration:
                break
            end = start + rng.exponential(sensors.esc_dropout_length)
            yield Silence(rotor, start, end)
