"""Whether the battery's current fell by what a failed rotor drew: where the ESCs tell no currents of their own.

    c   I / sum w³, learned in flight with a memory of 5 s: sag and payload are in it
    s   scatter of I / (c sum w³): manoeuvres; several batteries, of which now one and now another is heard
    L   (I - c sum_{j != k} w_j³) / (c w_k³)      what rotor k still draws, 1 as before, 0 nothing;
        its variance is SPREAD² + (s sum w³ / w_k³)²

A rotor without its propeller draws next to nothing. It is asked only of a rotor that was named by its thrust, and
speaks for a lost propeller alone, with little weight: it names no rotor, manoeuvres scatter it, and a current that
did not fall may be a sensor that lags. What else it could say is left out; `benchmarks/battery_current.md`.
"""

import math
from collections import deque

from gcs_health.fusion.kinds import Kind
from gcs_health.fusion.verdicts import Evidence
from gcs_health.samples import BatteryReading, RotorReading

MEMORY, LEARN = 5.0, 2.0  # s: of c; until it is believed
SPREAD = 0.35  # of L, by the sensor's lag and rotors that slow down
MOST = 3.0  # nats
TURNS = 0.5  # of its usual w³; a rotor that was switched off since tells nothing
KEPT = 8  # rotor readings, of which the newest speed of each is taken
FRESH = 0.3  # s


class BatteryLoad:
    """Fed rotor readings as they come and the battery's seldom ones."""

    def __init__(self, rotors: int) -> None:
        self._n = rotors
        self.new_flight()

    def new_flight(self) -> None:
        """Forget the flight before."""
        self._rotors: deque[RotorReading] = deque(maxlen=KEPT)
        self._usual = math.nan  # c [A s³]
        self._scatter = 0.0  # s²
        self._cubes: list[float] = []  # usual w³ of each rotor
        self._learned = 0.0
        self._t = -math.inf
        self._loads: list[float] = []

    def rotors(self, reading: RotorReading) -> None:
        """Take speeds: they are looked at with the next battery reading."""
        self._rotors.append(reading)

    def learn(self, reading: BatteryReading) -> None:
        """Take a reading of a vehicle that flies, none of whose rotors has failed."""
        cubes = self._speeds_cubed(reading)
        dt, self._t = reading.t - self._t, reading.t
        if not cubes or not dt > 0.0:
            return
        self._learned += min(dt, 1.0)
        share = min(dt / min(self._learned, MEMORY), 1.0)
        now = reading.current / sum(cubes)
        if self._usual != self._usual:
            self._usual = now
        self._scatter += share * ((now / self._usual - 1.0) ** 2 - self._scatter)
        self._usual += share * (now - self._usual)
        before = self._cubes or cubes
        self._cubes = [old + share * (new - old) for old, new in zip(before, cubes, strict=True)]

    def follow(self, reading: BatteryReading, rotor: int) -> Evidence | None:
        """Take a reading just after a rotor was named; return what the current says of the kind."""
        cubes = self._speeds_cubed(reading)
        if not cubes or self._learned < LEARN or not self._usual > 0.0:
            return None
        if self._rotors[-1].current[rotor] == self._rotors[-1].current[rotor]:
            return None  # the rotor's own current tells more
        if cubes[rotor] < TURNS * self._cubes[rotor]:
            return None
        others = self._usual * (sum(cubes) - cubes[rotor])
        self._loads.append((reading.current - others) / (self._usual * cubes[rotor]))
        load = sum(self._loads) / len(self._loads)
        variance = SPREAD * SPREAD + self._scatter * (sum(cubes) / cubes[rotor]) ** 2
        unloaded = min(max((1.0 - 2.0 * load) / (2.0 * variance), 0.0), MOST)
        odds = ((Kind.PROPELLER_LOST, unloaded), (Kind.MOTOR_STOPPED, unloaded))
        return Evidence(reading.t, rotor, "battery", odds, lasts=math.inf, figures=(("load", load),))

    def _speeds_cubed(self, reading: BatteryReading) -> list[float]:
        """Return w³ of every rotor now; empty where one is not known, or the current is not."""
        cubes = [math.nan] * self._n
        for given in reversed(self._rotors):
            if reading.t - given.t > FRESH:
                break
            for k, speed in enumerate(given.speed):
                if cubes[k] != cubes[k]:
                    cubes[k] = speed**3
        total = sum(cubes)
        return cubes if total > 0.0 and reading.current > 0.0 else []
