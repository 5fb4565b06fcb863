"""What all rotors do alike is no rotor's fault: the slow common part of the baselines, to be shown.

    common effectiveness   1 - b_z / g                 b: the slow filter's offset, memory 25 s
    weight, right          y = b_p Y / (n G_p w_h²)    Y, X: the largest arms; w_h hover speed
    weight, forward        x = -b_q X / (n G_q w_h²)
    speed for a command    median of w_i / u_i over what they were early in the flight

A payload, thin air or a thrust that the file has too large lower the first; a shifted weight, and a steady wind with
it, show in the second; a sagging battery in the last. All three are absorbed before a rotor is judged.

Source: b is that of `estimators/slow_effectiveness.py`; a weight m g at (x, y) turns the vehicle by m g y / I_x, and
one rotor, bearing m g / n at Y, by G_p w_h² = (m g / n) Y / I_x.
"""

import math
from typing import NamedTuple

from gcs_health.airframe import Airframe
from gcs_health.estimators.effectiveness_recommended import RecommendedBank
from gcs_health.gate import GRAVITY

SETTLED = 5.0  # s until the offset is worth saying
NAN = math.nan


class Absorbed(NamedTuple):
    """The common part now; NaN = not known.

    Attributes
    ----------
    effectiveness : of all rotors together against the vehicle file's thrust [-].
    forward, right : where the weight sits against the rotors' centre [m], or in largest arms where not `metric`.
    speed : of all rotors for the same command, against early in the flight [-].
    """

    effectiveness: float
    forward: float
    right: float
    metric: bool
    speed: float

    def words(self) -> tuple[str, ...]:
        """Return what is known, a sentence each."""
        said = []
        if self.effectiveness == self.effectiveness:
            said.append(
                f"common effectiveness {self.effectiveness:.2f}, absorbed: payload or air, no rotor's fault"
            )
        if self.forward == self.forward:
            along, across = ("forward", "back")[self.forward < 0.0], ("right", "left")[self.right < 0.0]
            unit, scale = ("mm", 1e3) if self.metric else ("% of the arm", 1e2)
            where = f"{abs(self.forward) * scale:.0f} {unit} {along}, {abs(self.right) * scale:.0f} {unit} {across}"
            said.append(f"weight (or wind) {where} of the rotors' centre, absorbed")
        if self.speed == self.speed:
            said.append(
                f"rotor speed for the same command {self.speed:.2f} of early in the flight, absorbed: battery or load"
            )
        return tuple(said)


def absorbed(bank: RecommendedBank | None, airframe: Airframe, speed: float) -> Absorbed:
    """Return the common part of the baselines as it stands; `speed` as in `Absorbed`."""
    metric = airframe.metric
    if bank is None or bank.slow.time < SETTLED or not math.isfinite(bank.hover):
        return Absorbed(NAN, NAN, NAN, metric, speed)
    gains, (roll, pitch, _, down) = bank.gains, bank.slow.offset
    squares = bank.rotors * bank.hover * bank.hover
    # where it is learned in flight it follows what all rotors do
    effectiveness = 1.0 - down / GRAVITY if gains.thrust_given else NAN
    most_roll, most_pitch = (max(map(abs, row)) * squares for row in (gains.roll, gains.pitch))
    reach = [
        max(abs(rotor.position[axis]) for rotor in airframe.rotors) if metric else 1.0 for axis in (0, 1)
    ]
    if not (most_roll > 0.0 and most_pitch > 0.0):
        return Absorbed(effectiveness, NAN, NAN, metric, speed)
    return Absorbed(effectiveness, -pitch / most_pitch * reach[0], roll / most_roll * reach[1], metric, speed)
