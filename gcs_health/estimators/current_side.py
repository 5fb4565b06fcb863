"""Which current an ESC tells: the motor's, of the torque, or the battery's; and the one from the other.

At steady speed the motor's current goes with w², the battery's with w³, since I_b = delta i and the duty delta
goes with w. So the slope of log i over log w tells them apart: 1.5 to 1.9 for the motor, 2.7 to 3.3 for the
battery, measured; cut at 2.45. An idle on the ground is what makes the speeds spread; hover alone does not.
There a battery's current is near nothing, and an ESC's offset all that shows: such a bin counts, at the least
current that can be told, with little weight. (The sheet takes friction off first: that turns a battery's current
at idle negative.)

The sum of the ESCs' currents against the battery's own sensor is a second witness, and a worse one: its
scale is often wrong, so it may say no more than "unusable".

Source: sheet 3, what is wrong, item 1, and step 1; sheet 5 section 6.
"""

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class SideConfig:
    """Rules of the recognition; sheet 3 unless said otherwise."""

    cut: float = 2.45  # exponent between motor and battery
    apart: float = 1.0  # between the exponents of the two sides, 1.9 and 2.9 with an idle; this project
    certain: float = 9.0  # twice the log-likelihood ratio of the two sides that decides; this project
    clear: float = 0.08  # that the exponent must be away from the cut at least; this project
    # |w'| below this many w²/level a second; the sheet's 400 rad/s² is .73 in hover, and .35 let the tails of
    # thrust pulses bend the slope of duty-driven motors, 1.5 for 1.9 and 2.6 for 3.1; this project
    steady: float = 0.2
    slowest: float = 0.2  # of the level; an idle counts, a start does not
    bin_width: float = 0.15  # of log w: eight bins from idle to full
    least_in_bin: int = 6
    offset: tuple[float, float] = (0.04, 0.005)  # A and share of the largest mean current that an idle may be
    # off; smaller means count as that much; this project
    least_bins: int = 3
    spread: float = 0.12  # of log w between bins (standard deviation); this project
    scatter: float = 0.06  # of log i in a bin that no number of readings averages away; this project
    memory: int = 4000  # readings in a bin after which it forgets half
    every: float = 0.03  # s between two looks at a rotor; this project
    decide_every: int = 8  # readings; this project
    look_at: int = 3000  # steady readings in which a side given by the vehicle file is checked; this project
    braking: float = 0.7  # of the level a second; a rotor that falls so fast may be braked; this project
    braking_current: float = (
        0.3  # of the usual, below which its battery-side current may be negative; this project
    )
    battery_sum: tuple[float, float] = (
        0.75,
        1.15,
    )  # sum of ESCs over battery that fits battery-side currents
    motor_sum: tuple[float, float] = (1.15, 3.0)  # ... motor-side currents, the duty being below one


class CurrentSide:
    """Recognises the side from steady moments of all rotors.

    Attributes
    ----------
    exponent, error : of current over speed, and its standard error; NaN while unknown.
    news : readings taken.
    """

    def __init__(self, config: SideConfig) -> None:
        self.config = config
        self.exponent = self.error = math.nan
        self._bins: dict[int, list[float]] = {}  # count, sum of w, of i, of i²
        self.news = 0

    def note(self, w: float, i: float) -> None:
        """Take speed and current [rad/s, A] of a steady moment."""
        key = math.floor(math.log(w) / self.config.bin_width)
        row = self._bins.get(key)
        if row is None:
            if len(self._bins) > 60:
                return
            row = self._bins[key] = [0.0, 0.0, 0.0, 0.0]
        row[0] += 1.0
        row[1] += w
        row[2] += i
        row[3] += i * i
        self.news += 1
        if row[0] > self.config.memory:
            row[:] = [0.5 * value for value in row]

    def decide(self) -> Literal["motor", "battery"] | None:
        """Return "motor", "battery", or None while it cannot be told."""
        c = self.config
        self._fit()
        away = abs(self.exponent - c.cut)
        if not (away > c.clear and 2.0 * c.apart * away > c.certain * self.error**2):
            return None
        return "motor" if self.exponent < c.cut else "battery"

    def _fit(self) -> None:
        c = self.config
        self.exponent = self.error = math.nan
        rows = []
        largest = max(
            [row[2] / row[0] for row in self._bins.values() if row[0] >= c.least_in_bin], default=0.0
        )
        offset = c.offset[0] + c.offset[1] * max(largest, 0.0)
        for count, w, i, square in self._bins.values():
            if count < c.least_in_bin:
                continue
            mean = max(i / count, offset)
            variance = max(square / count - (i / count) ** 2, 0.0) / count + 0.5 * offset**2
            rows.append((math.log(w / count), math.log(mean), 1.0 / (variance / mean**2 + c.scatter**2)))
        if len(rows) < c.least_bins:
            return
        total = sum([weight for _, _, weight in rows])
        middle = sum([weight * x for x, _, weight in rows]) / total
        level = sum([weight * y for _, y, weight in rows]) / total
        if math.sqrt(sum([(x - middle) ** 2 for x, _, _ in rows]) / len(rows)) < c.spread:
            return
        xx = sum([weight * (x - middle) ** 2 for x, _, weight in rows])
        slope = sum([weight * (x - middle) * y for x, y, weight in rows]) / xx
        excess = sum([weight * (y - level - slope * (x - middle)) ** 2 for x, y, weight in rows])
        excess /= len(rows) - 2
        self.exponent = slope
        self.error = math.sqrt(max(excess, 1.0) / xx)


def battery_witness(escs: float, battery: float, config: SideConfig) -> str:
    """Compare the sum of the ESCs' currents with the battery's [A]: "motor", "battery" or "unusable"."""
    if not (escs > 0.0 and battery > 0.0):
        return "unusable"
    ratio = escs / battery
    if config.battery_sum[0] < ratio <= config.battery_sum[1]:
        return "battery"
    if config.motor_sum[0] < ratio <= config.motor_sum[1]:
        return "motor"
    return "unusable"


def motor_current(w: float, battery: float, volts: float, torque_constant: float, resistance: float) -> float:
    """Return the motor's current from the battery's [A] at speed w [rad/s] and bus voltage [V].

    u_b I_b = (R i + kappa_q w) i, the electric power on both sides of the ESC; its sign under braking is lost.
    Source: sheet 3, step 1.
    """
    back = torque_constant * w
    power = volts * battery
    inside = back * back + 4.0 * resistance * power
    if not inside > 0.0:
        return 0.0
    return (math.sqrt(inside) - back) / (2.0 * resistance)
