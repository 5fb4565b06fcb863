"""Whose speed is it: each rotor's telemetry held against the commands and against the vehicle's own turning.

    m_i   squared speed of rotor i, c_i squared command, both less their mean over 2 s
    turn  (dp/dt, dq/dt) = (a_p sum -y_i m_i, a_q sum x_i m_i)          what rotors at their seats would do

Blocks of 0.1 s feed one covariance of all of these, with a memory of 6 s. Rotor i follows command j where that
explains its speed better than its own does; rotors i and j answer in each other's place where exchanging their seats
explains the turning better. Both are compared by N/2 log(S_own / S_other), S the variance left over and N the blocks,
counted as fewer since neighbours are alike.

The two tell apart what is wrong. Speeds that follow another's command are another's telemetry, whenever it began.
Speeds that follow their own command while the vehicle turns as if the seats were exchanged are motors, or a geometry,
in the wrong order. Without commands it is the order where it was so from take-off on, telemetry where it came later.
"""

import math
from operator import add, mul

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.fusion.kinds import Kind
from gcs_health.fusion.verdicts import BOUND, Evidence
from gcs_health.samples import CommandReading, ImuReading, RotorReading

Array = NDArray[np.float64]
BLOCK = 0.1  # s
MEAN_OVER, MEMORY = 2.0, 6.0  # s
SETTLE = 4.0  # s of flight before anything is said
CLIP, SETTLED = 3.0, 20  # standard deviations, and blocks after which they are known
ALIKE = 3.0  # blocks that count as one
GAP = 0.5  # s: nothing reaches across
ENOUGH = 9.0  # nats by which the other must explain better, both paths together
TAKEN = 2.0  # nats by which the other rotor, too, must follow another's command better than its own
EXPLAINS = 0.4  # share of the variance that it must explain
EVERY = 10  # blocks from look to look
LASTS = 3.0  # s


class Attribution:
    """Fed readings; says of each rotor whether its telemetry is its own. Cheap between two blocks.

    Attributes
    ----------
    latest : the last IMU reading; its body rates are looked at with the next block.
    """

    def __init__(self, airframe: Airframe) -> None:
        self._n = len(airframe.rotors)
        x = np.array([rotor.position[0] for rotor in airframe.rotors])
        y = np.array([rotor.position[1] for rotor in airframe.rotors])
        self._seats: tuple[Array, Array] = (-y, x)
        self.new_flight()

    def new_flight(self) -> None:
        """Forget the flight before."""
        self._restart()
        self._was_right = False

    def _restart(self) -> None:
        size = 2 + 2 * self._n
        self._mean: Array | None = None
        self._covariance: Array = np.zeros((size, size))
        self._blocks = 0
        self._command: list[float] | None = None
        self._commanded = 0  # blocks with commands
        self._squares, self._counts = [0.0] * self._n, [0] * self._n
        self._whole = 0  # readings that counted for every rotor
        self.latest: ImuReading | None = None
        self._begin: ImuReading | None = None
        self._index = -1

    def command(self, reading: CommandReading) -> None:
        """Take commands."""
        if sum(reading.command) < math.inf:  # NaN is not
            self._command = [u * u for u in reading.command]

    def rotors(self, reading: RotorReading, flies: bool) -> list[Evidence]:
        """Take speeds; return what a look that fell due says, rotor by rotor."""
        index = math.floor(reading.t / BLOCK)
        if index <= self._index:
            self._add(reading)
            return []
        said = self._turn_over(index, flies)
        self._add(reading)
        return said

    def _add(self, reading: RotorReading) -> None:
        speeds = reading.speed
        total = sum(speeds)
        if total == total:  # all are known
            self._squares = list(map(add, self._squares, map(mul, speeds, speeds)))
            self._whole += 1
            return
        for k, speed in enumerate(speeds):
            if speed == speed:
                self._squares[k] += speed * speed
                self._counts[k] += 1

    def _turn_over(self, index: int, flies: bool) -> list[Evidence]:
        """Close the block, unless something breaks it."""
        counts = [self._whole + count for count in self._counts]
        squares = [s / c if c else math.nan for s, c in zip(self._squares, counts, strict=True)]
        self._squares, self._counts, self._whole = [0.0] * self._n, [0] * self._n, 0
        steps, self._index = index - self._index, index
        begin, imu = self._begin, self.latest
        self._begin = imu
        if not flies or steps * BLOCK > GAP:
            if self._blocks:
                self._restart()
            return []
        if begin is None or imu is None or not imu.t > begin.t or not min(squares) > 0.0:
            return []
        return self._block(begin, imu, squares)

    def _block(self, begin: ImuReading, imu: ImuReading, squares: list[float]) -> list[Evidence]:
        command = self._command or [0.0] * self._n
        dt = imu.t - begin.t
        turn = ((imu.p - begin.p) / dt, (imu.q - begin.q) / dt)
        row = [*turn, *squares, *command]
        if not math.isfinite(sum(row)):
            return []
        z = np.array(row)
        if self._mean is None:
            self._mean = z
        self._blocks += 1
        self._commanded = self._commanded + 1 if self._command else 0
        self._mean = self._mean + (z - self._mean) / min(self._blocks, MEAN_OVER / BLOCK)
        z = z - self._mean
        if self._blocks > SETTLED:  # one jolt is not the whole story
            limit = CLIP * np.sqrt(self._covariance.diagonal())
            z = np.minimum(np.maximum(z, -limit), limit)
        self._covariance += (z[:, None] * z - self._covariance) / min(self._blocks, MEMORY / BLOCK)
        if self._blocks * BLOCK < SETTLE or self._blocks % EVERY:
            return []
        return self._look(imu.t)

    def _look(self, t: float) -> list[Evidence]:
        count = min(self._blocks, MEMORY / BLOCK) / ALIKE
        moments, partner, right = self._by_moments(count)
        commands, follows = self._by_commands(count)
        self._was_right = self._was_right or right
        said = []
        for i in range(self._n):
            wrong, order = 0.0, 0.0
            both = max(moments[i], 0.0) + commands[i]
            own = follows[i] and follows[partner[i]]
            if own or not (self._was_right or commands[i] > 0.0 or self._commanded):
                order = moments[i]
            else:
                wrong = both
            said.append(
                Evidence(
                    t,
                    i,
                    "attribution",
                    ((Kind.ESC_MISATTRIBUTED, _odds(wrong)), (Kind.MOTOR_ORDER_WRONG, _odds(order))),
                    lasts=LASTS,
                    figures=(("by_moments", moments[i]), ("by_commands", commands[i])),
                )
            )
        return said

    def _by_moments(self, count: float) -> tuple[list[float], list[int], bool]:
        """Return of each rotor how much better an exchange of seats explains the turning, with whom; if none does."""
        n, c = self._n, self._covariance
        spread = c[2 : 2 + n, 2 : 2 + n]
        own = [
            _left(c[axis, axis], c[axis, 2 : 2 + n], seat, spread) for axis, seat in enumerate(self._seats)
        ]
        best, partner = [-math.inf] * n, list(range(n))
        for i in range(n):
            for j in range(i):
                score, explained = 0.0, 0.0
                for axis, seat in enumerate(self._seats):
                    changed = seat.copy()
                    changed[i], changed[j] = seat[j], seat[i]
                    left = _left(c[axis, axis], c[axis, 2 : 2 + n], changed, spread)
                    score += 0.5 * count * math.log(own[axis] / left)
                    explained = max(explained, 1.0 - left)
                if explained < EXPLAINS:
                    score = min(score, 0.0)
                for one, other in ((i, j), (j, i)):
                    if score > best[one]:
                        best[one], partner[one] = score, other
        right = max(best) < 0.0 and 1.0 - min(own) > EXPLAINS
        top = max(best)
        # one exchange: only its two rotors
        return [score if score == top else 0.0 for score in best], partner, right

    def _by_commands(self, count: float) -> tuple[list[float], list[bool]]:
        """Return of each rotor how much better another's command explains its speed, and whether its own is best."""
        n, c = self._n, self._covariance
        if self._commanded * BLOCK < SETTLE:
            return [0.0] * n, [False] * n
        variance = np.diag(c)
        with np.errstate(invalid="ignore", divide="ignore"):
            r = c[2 : 2 + n, 2 + n :] / np.sqrt(np.outer(variance[2 : 2 + n], variance[2 + n :]))
        r = np.clip(np.nan_to_num(r), 0.0, 0.999)
        left = 1.0 - r * r
        best = left.argmin(axis=1)
        explained = [1.0 - float(left[i, best[i]]) > EXPLAINS for i in range(n)]
        scores = [
            0.5 * count * math.log(left[i, i] / left[i, best[i]]) if explained[i] else 0.0 for i in range(n)
        ]
        # whoever has lost its own speed to another has got another's: a slow rotor that the others make up
        # for has not
        taken = [max(scores[i], scores[best[i]]) if scores[best[i]] > TAKEN else 0.0 for i in range(n)]
        return taken, [explained[i] and best[i] == i for i in range(n)]


def _left(variance: float, shared: Array, seat: Array, spread: Array) -> float:
    """Return the share of one axis' turning that rotors at these seats leave unexplained."""
    common = float(shared @ seat)
    own = float(seat @ spread @ seat)
    if not (common > 0.0 and own > 0.0 and variance > 0.0):  # the wrong way round is no explanation
        return 1.0
    return max(1.0 - common * common / (own * variance), 1e-3)


def _odds(score: float) -> float:
    return BOUND if score > ENOUGH else -3.0
