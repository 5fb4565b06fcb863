"""One simulated flight: frames out as a ground station would receive them, commands in."""

import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from gcs_health.mavlink.dialect import Dialect, default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.simulate.booms import Booms
from gcs_health.simulate.link import Air
from gcs_health.simulate.scenario import Scenario
from gcs_health.simulate.speaker import HEARD, Speaker
from gcs_health.simulate.telemetry import BOOTED, UNIX_BOOT_US
from gcs_health.simulate.world import World

FIRST_US = UNIX_BOOT_US + round(BOOTED * 1e6)  # UNIX µs of flight time 0
SYSTEM = 1
NEIGHBOUR = 7  # system id of the other vehicle on the port
NEIGHBOUR_PHYSICS = 500.0  # Hz; nobody looks closely at it


class Flight:
    """A scenario in flight; deterministic for what is fed to it.

    Attributes
    ----------
    world : the truth. boom_tips : accelerations of the boom tips [m/s²], one row a step, where there are booms.
    """

    def __init__(self, scenario: Scenario, dialect: Dialect | None = None) -> None:
        self.scenario = scenario
        self._dialect = dialect or default_dialect()
        self.world = World(scenario, [scenario.seed])
        self._air = Air(
            scenario.link, np.random.default_rng(np.random.SeedSequence(scenario.seed).spawn(7)[6])
        )
        self._vehicle = Speaker(self.world, self._dialect, SYSTEM, self._air.send)
        self._neighbour = self._second() if scenario.link.second_system else None
        self._ear = FrameDecoder(self._dialect, stamped=False)
        boom = scenario.vehicle.boom
        self._booms = Booms(boom, len(scenario.vehicle.rotors), self.world.dt) if boom else None
        self.boom_tips: list[np.ndarray[Any, np.dtype[np.float64]]] = []

    def _second(self) -> Speaker:
        """Return a healthy vehicle of the same kind that flies the same plan on a chance of its own."""
        plan = replace(self.scenario, faults=(), seed=self.scenario.seed + 1, physics_rate=NEIGHBOUR_PHYSICS)
        return Speaker(World(plan, [plan.seed]), self._dialect, NEIGHBOUR, self._air.send)

    def send_parameters(self) -> None:
        """Send all parameters again, as for a ground station that connects now."""
        self._vehicle.send_parameters()

    @property
    def over(self) -> bool:
        """Whether the scenario's duration has passed."""
        return self.world.t >= self.scenario.trajectory.duration

    def step(self) -> None:
        """Advance by one physics step."""
        world = self.world
        world.step()
        if self._booms is not None:
            self.boom_tips.append(self._booms.step(np.array([rotor.lift for rotor in world.plant.rotors])))
        self._vehicle.speak(world.t)
        if self._neighbour is not None:
            while self._neighbour.world.t < world.t:
                self._neighbour.world.step()
            self._neighbour.speak(world.t)

    def arrived(self) -> list[tuple[int, bytes]]:
        """Return the frames that have reached the ground by now: (UNIX µs, frame)."""
        return [(FIRST_US + round(t * 1e6), frame) for t, frame in self._air.arrived(self.world.t)]

    def run(self) -> Iterator[tuple[int, bytes]]:
        """Fly to the end; yield (UNIX µs, frame) in order of arrival."""
        while not self.over:
            self.step()
            yield from self.arrived()

    def receive(self, data: bytes) -> None:
        """Take bytes from a ground station; answers go out over the same link."""
        for _, _, _, message, _, payload in self._ear.feed(data):
            known = self._dialect.messages.get(message)
            if known is None or known.name not in HEARD:
                continue
            values = known.layout.unpack(payload.ljust(known.size, b"\0")[: known.size])
            fields = {name: values[at] for name, (at, _) in known.positions.items()}
            for speaker in (self._vehicle, self._neighbour):
                if speaker is not None:
                    speaker.hear(known.name, fields)


def record(stamp: int, frame: bytes) -> bytes:
    """Return one record of a .tlog."""
    return struct.pack(">Q", stamp) + frame
