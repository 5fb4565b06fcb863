"""The way to the ground: delay, jitter, loss alone and in bursts, frames overtaken and doubled."""

import heapq

import numpy as np

from gcs_health.simulate.scenario import Link


class Air:
    """Frames sent at a time come out at a later one, or not at all, or twice."""

    def __init__(self, link: Link, rng: np.random.Generator) -> None:
        self._link = link
        self._rng = rng
        self._lost_to_come = 0
        self._count = 0
        self._flying: list[tuple[float, int, bytes]] = []
        self._plain = not any((link.jitter, link.loss, link.burst_loss, link.reorder, link.duplicate))
        self._newest = 0.0

    def send(self, t: float, frame: bytes) -> None:
        """Give a frame to the link at time t [s]."""
        link = self._link
        if self._plain:
            self._fly(t + link.delay, frame)
            return
        chance, burst, late, twice = self._rng.random(4).tolist()
        delay = link.delay + float(self._rng.exponential(link.jitter)) if link.jitter else link.delay
        if self._lost_to_come:
            self._lost_to_come -= 1
            return
        if burst * link.burst < link.burst_loss:
            self._lost_to_come = int(self._rng.geometric(1.0 / link.burst))
            return
        if chance < link.loss:
            return
        # jitter alone keeps the order, as a queue does; a reordered frame is overtaken by the next ones
        arrival = t + delay
        if late < link.reorder:
            arrival += 0.02 + 0.03 * late / link.reorder
        else:
            arrival = self._newest = max(arrival, self._newest)
        self._fly(arrival, frame)
        if twice < link.duplicate:
            self._fly(arrival + 0.001, frame)

    def _fly(self, arrival: float, frame: bytes) -> None:
        heapq.heappush(self._flying, (arrival, self._count, frame))
        self._count += 1

    def arrived(self, t: float) -> list[tuple[float, bytes]]:
        """Return what has come out by time t [s], with its times, in order."""
        out: list[tuple[float, bytes]] = []
        while self._flying and self._flying[0][0] <= t:
            arrival, _, frame = heapq.heappop(self._flying)
            out.append((arrival, frame))
        return out
