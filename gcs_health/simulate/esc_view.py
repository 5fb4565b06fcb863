"""What the autopilot knows of each ESC, telemetry faults included."""

from typing import NamedTuple

from gcs_health.simulate.faults import KINDS, Fault
from gcs_health.simulate.sensors import EscSample
from gcs_health.simulate.world import World


class Slot(NamedTuple):
    """One ESC index: its last sample, whether it still speaks, for how long not [s], packets so far."""

    sample: EscSample | None
    alive: bool
    silent: float
    packets: int


NOBODY = Slot(None, False, 0.0, 0)


class EscView:
    """ESC indices of one flight."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._rotor_of = {rotor.esc: k for k, rotor in enumerate(world.scenario.vehicle.rotors)}
        self._faults = [fault for fault in world.faults if KINDS[fault.kind].telemetry]
        self._held: dict[Fault, tuple[EscSample | None, int]] = {}
        self.slots = max(self._rotor_of) + 1

    def slot(self, index: int, t: float) -> Slot:
        """Return what is known of one ESC index at flight time t [s]."""
        rotor = self._rotor_of.get(index)
        if rotor is None:
            return NOBODY
        for fault in self._faults:
            if fault.kind == "esc_swapped" and t >= fault.at:
                other = int(fault.size) - 1
                rotor = {fault.rotor: other, other: fault.rotor}.get(rotor, rotor)
        escs = self._world.escs
        sample, packets, silent = escs.known[rotor], escs.packets[rotor], 0.0
        for fault in self._faults:
            if fault.rotor == rotor and t >= fault.at and fault.kind != "esc_swapped":
                sample, packets = self._held.setdefault(fault, (sample, packets))
                silent = t - fault.at if fault.kind == "esc_lost" else 0.0
        return Slot(sample, sample is not None and silent == 0.0, silent, packets)
