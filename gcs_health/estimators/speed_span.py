"""What a slowed rotor does to the speeds of all: it leaves what the mixer can command.

    W_cmd = W_0 + M u                u : four controls, so that healthy speeds lie in the span of M, gusts or not
    e     = P (W - healthy) = -k W_cmd,i P_i       P : projector onto what the mixer cannot reach, (n, n)
    k / (1 - k) = -e_i / (P_ii W_i)

Sheet 4 reads the deficit to the mean speed, by a table; but the controller's own swing (6 % in severe gusts) stands
in it for seconds, and in e it does not stand at all. At rest both say the same: six rotors have deficits of 7.7,
18, 33, 58 % at k = .2, .4, .6, .8. Three or four rotors have no e: their steady speeds stay as they were, whatever
k, and only the command shows it. Of six, opposite rotors have the same P_i (sheet 4 section 4).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe

Array = NDArray[np.float64]
ALIKE = 0.95  # cosine of two rotors' columns of P from which they are one
LEAST = 0.05  # of P_ii, below which a rotor does not show


@dataclass(frozen=True, slots=True, eq=False)
class SpeedFacts:
    """What healthy flights of one vehicle type taught about e, over the mean speed.

    healthy : (n,) its mean. between : standard deviation over vehicles; drift : over stretches of one flight.
    error : of k, from levels not trained on.
    """

    healthy: Array
    between: float
    drift: float
    error: float


def mixer_of(airframe: Airframe) -> Array:
    """Return (4, n): lift, roll, pitch and yaw of one rotor's thrust, arms over the longest, torque over its own."""
    x, y = (np.array([r.position[axis] for r in airframe.rotors]) for axis in (0, 1))
    reach = max(float(np.hypot(x, y).max()), 1e-9)
    spin = np.array([float(r.spin) for r in airframe.rotors])
    return np.stack([np.ones(len(x)), -y / reach, x / reach, spin])


def projector(airframe: Airframe) -> Array:
    """Return P (n, n)."""
    B = mixer_of(airframe)
    return np.eye(B.shape[1]) - np.linalg.pinv(B, rcond=1e-6) @ B


def steady_speeds(airframe: Airframe, rotor: int, k: float) -> Array:
    """Return (n,): speeds over hover speed when the controller has answered: B W² = B 1, W = L (1 + M u)."""
    B = mixer_of(airframe)
    M = np.linalg.pinv(B, rcond=1e-6)
    left, u = np.ones(B.shape[1]), np.zeros(4)
    for step in np.linspace(0.0, k, 1 + math.ceil(k / 0.05)):
        left[rotor] = 1.0 - step
        for _ in range(20):
            speeds = left * (1.0 + M @ u)
            slope = B @ (2.0 * (speeds * left)[:, None] * M)
            u = u - np.linalg.pinv(slope, rcond=1e-9) @ (B @ speeds**2 - B.sum(axis=1))
    return np.asarray(left * (1.0 + M @ u))


def lookalikes(airframe: Airframe) -> tuple[tuple[int, ...], ...]:
    """Return of each rotor those that steady flight cannot tell from it: itself, its arm's, its opposites."""
    places = [(r.position[0], r.position[1]) for r in airframe.rotors]
    near = 0.2 * max(math.hypot(x, y) for x, y in places)
    return tuple(
        tuple(
            j
            for j, (a, b) in enumerate(places)
            if math.hypot(a - x, b - y) < near or math.hypot(a + x, b + y) < near
        )
        for x, y in places
    )


class Span:
    """The projector at work: e of speeds, k of e, and who it may be."""

    def __init__(self, airframe: Airframe) -> None:
        self.P = projector(airframe)
        self.own = np.diag(self.P).copy()
        self.shown = (self.own > LEAST).tolist()
        self.shows = any(self.shown)
        size = np.sqrt(np.maximum(np.outer(self.own, self.own), 1e-12))
        cosine = self.P / size
        places = lookalikes(airframe)
        self.alike = tuple(
            tuple(j for j in range(len(places)) if j in places[i] or cosine[i, j] > ALIKE)
            for i in range(len(places))
        )

    def outside(self, speeds: Array) -> Array:
        """Return (n,): P W over the mean speed."""
        return np.asarray(self.P @ speeds / speeds.mean())

    def degradation(self, e: Array, speeds: Array) -> Array:
        """Return (n,): k of each rotor as if it alone were degraded; e over the mean speed, healthy part removed.

        Of rotors that do not share the largest one's signature: what is left of e when that one is removed.
        """
        share = np.maximum(speeds / speeds.mean(), 1e-3)
        own = np.maximum(self.own, LEAST)
        ratio = -e / (own * share)
        explained = np.where(ratio > 0.0, e * e / own, 0.0)
        best = int(explained.argmax())
        rest = e - self.P[:, best] * (e[best] / own[best])
        others = np.ones(len(e), dtype=bool)
        others[list(self.alike[best])] = False
        ratio = np.where(others, -rest / (own * share), ratio)
        return np.asarray(ratio / (1.0 + np.maximum(ratio, -0.5)))
