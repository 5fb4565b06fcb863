"""Degradation from rotor speeds: by the speed's deficit, and, where commands are known, against the command.

    shares    d_i = 1 - share_i / own healthy share_i              -> k by the table (`speed_table.py`)
    commands  k_i = 1 - (W_i / u_i) / (its healthy value) / c,     c : the median over the rotors (voltage sags)

Healthy trims differ by 20 % between rotors and days (sheet 5 section 4): the own healthy values are learned over the
first 10 s of flight, and before that doubted by as much. Shares alone never decide on a vehicle that nobody
has trained: turning and climbing move them too. Source: sheet 4 sections 4 and 6.7.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.estimators.speed_table import Array, SpeedTable, from_geometry, lookalikes
from gcs_health.samples import CommandReading, RotorReading

BLOCK = 0.1  # s
FASTEST = 1e5  # rad/s
LEAST_COMMAND = 0.02


@dataclass(frozen=True, slots=True)
class SpeedConfig:
    """Windows, spreads and thresholds of the speed path."""

    fast: int = 5  # blocks of 0.1 s in which a fault is seen
    value: int = 20  # blocks over which it is measured
    learn: float = 10.0  # s of flight that teach the own healthy values
    flying: float = 0.7  # of the highest mean speed so far
    risen: float = 1.25  # a mean higher by so much was no flight before: learn anew
    between: float = 0.10  # of shares and of speed per command, over healthy rotors; sheet 5 section 4
    drift: float = 0.02  # of a share within a flight: half the 3-6 % by which squared commands move
    drift_command: float = 0.01  # of speed per command within a flight, voltage removed
    table_error: float = 0.15  # of k by the geometry alone
    exponent: float = 0.3  # speed goes with command to the power 1 +- so much
    sigmas: float = 5.0  # at which an alarm is given
    least: float = 0.08  # k that is never an alarm
    least_trained: float = 0.03
    onset: int = 15  # blocks in which the onset may tell a rotor from its opposite
    onset_sigmas: float = 6.0


@dataclass(frozen=True, slots=True)
class SpeedView:
    """One rotor's answer.

    k, std : over 2 s. k_fast, threshold : over 0.5 s, and what it must exceed. by_command : commands were known.
    settled : the own healthy values are learned. decides : whether it may raise an alarm.
    """

    k: float
    std: float
    k_fast: float
    threshold: float
    std_fast: float
    by_command: bool
    settled: bool
    decides: bool


class _Ratios:
    """Healthy values of one figure a rotor, learned once in a flight, and how much its windows scatter."""

    def __init__(self, prior: Array, between: float, drift: float, learn: int) -> None:
        self.prior, self.between, self.drift, self.learn = prior, between, drift, learn
        self.healthy = prior.copy()
        self.count = 0
        self._squares = np.zeros(len(prior))
        self._fast: deque[Array] = deque(maxlen=5)
        self._sum = np.zeros(len(prior))

    def teach(self, block: Array, fast: Array) -> None:
        """Take one block's values and the fast window's, while learning."""
        if self.count >= self.learn or not np.isfinite(block).all():
            return
        self.count += 1
        self._sum += block
        self._squares += (fast / np.maximum(self.prior, 1e-12)) ** 2
        if self.count == self.learn:
            mean = self._sum / self.count
            self._squares = np.maximum(self._squares / self.count - (mean / self.prior) ** 2, 0.0)
            self.healthy = mean

    @property
    def settled(self) -> bool:
        """Whether learning is over."""
        return self.count >= self.learn

    @property
    def scatter(self) -> float:
        """Standard deviation of the fast window's relative values in healthy flight."""
        return float(np.sqrt(self._squares.mean())) if self.settled else self.between

    @property
    def doubt(self) -> float:
        """Standard deviation of the healthy values themselves, relative."""
        return self.drift if self.settled else self.between


class SpeedDeficit:
    """Feed rotor speeds and commands; `views` is the last answer, one a rotor or None."""

    def __init__(self, airframe: Airframe, config: SpeedConfig, table: SpeedTable | None = None) -> None:
        self.config = config
        self.n = len(airframe.rotors)
        geometric = from_geometry(airframe, config.between, config.drift, config.table_error)
        self.table = geometric if table is None else _completed(table, geometric)
        self.trained = table is not None
        self.alike = lookalikes(airframe)
        self.commands_at = self.speeds_at = -math.inf
        self.speed_t = [-math.inf] * self.n
        self.landed: bool | None = None
        self.named: int | None = None  # told from its opposite by the onset
        self._index = -1
        self._open = np.zeros((4, self.n))  # speed sum and count, command sum and count, of the open block
        self._ring: deque[tuple[int, Array]] = deque(maxlen=config.value)
        self._deficits: deque[Array] = deque(maxlen=config.onset)
        self._top = 0.0
        self.views: list[SpeedView | None] = [None] * self.n
        self._relearn()

    def _relearn(self) -> None:
        c, blocks = self.config, round(self.config.learn / BLOCK)
        between = self.table.between if self.trained else c.between
        drift = self.table.drift if self.trained else c.drift
        self._shares = _Ratios(self.table.healthy.copy(), between, drift, blocks)
        drift = 0.3 * c.drift_command if self.trained else c.drift_command
        self._gains = _Ratios(np.ones(self.n), c.between, drift, blocks)
        self._rests = np.full(self.n, math.nan)  # healthy commands, from which the exponent counts
        self._rest_sum = np.zeros(self.n)
        self._rest_count = 0
        self._deficits.clear()
        self.named = None

    def speeds(self, reading: RotorReading) -> bool:
        """Take rotor speeds; return whether there is a new answer."""
        new = self._turn(reading.t)
        for i, speed in enumerate(reading.speed[: self.n]):
            if 0.0 <= speed < FASTEST and reading.t >= self.speed_t[i]:
                self._open[0, i] += speed
                self._open[1, i] += 1.0
                self.speed_t[i] = self.speeds_at = reading.t
        return new

    def commands(self, reading: CommandReading) -> bool:
        """Take motor commands; return whether there is a new answer."""
        new = self._turn(reading.t)
        for i, command in enumerate(reading.command[: self.n]):
            if LEAST_COMMAND < command < 10.0:
                self._open[2, i] += command
                self._open[3, i] += 1.0
                self.commands_at = reading.t
        return new

    def _turn(self, t: float) -> bool:
        """Close the open block when time has left it."""
        index = math.floor(t / BLOCK)
        if index <= self._index:
            return False
        if self._index >= 0 and self._open.any():
            self._ring.append((self._index, self._open.copy()))
            self._open[:] = 0.0
        self._index = index
        while self._ring and self._ring[0][0] < index - self.config.value:
            self._ring.popleft()
        if not self._ring:
            self.views = [None] * self.n
            return False
        self._look()
        return True

    def _means(self, blocks: int) -> tuple[Array, Array]:
        """Return mean speeds and commands over the newest blocks; NaN where there were none."""
        edge = self._index - blocks
        total = np.sum([row for index, row in self._ring if index >= edge], axis=0)
        if np.ndim(total) == 0:
            return np.full(self.n, math.nan), np.full(self.n, math.nan)
        with np.errstate(invalid="ignore"):
            return total[0] / total[1], total[2] / total[3]

    def _look(self) -> None:
        c = self.config
        slow, slow_u = self._means(c.value)
        fast, fast_u = self._means(c.fast)
        self.views = [None] * self.n
        if not np.isfinite(slow).all() or slow.max() <= 0.0 or not np.isfinite(fast).all():
            return
        if not self._flies(float(slow.mean())):
            return
        commanded = bool(np.isfinite(slow_u).all() and np.isfinite(fast_u).all())
        now, _ = self._means(1)
        block = now if np.isfinite(now).all() and now.mean() > 0.0 else fast
        shares, fast_shares, now_shares = (w / w.mean() for w in (slow, fast, block))
        self._shares.teach(now_shares, fast_shares)
        if commanded:
            self._gains.teach(_relative(fast, fast_u), _relative(fast, fast_u))
            self._rest(fast_u)
        self._deficits.append(1.0 - now_shares / self._shares.healthy)
        by_share = [self._by_share(i, shares, fast_shares) for i in range(self.n)]
        if commanded:
            by_command = self._by_command(slow, slow_u, fast, fast_u)
            self.views = [
                a if b is None or a.std < b.std else b for a, b in zip(by_command, by_share, strict=True)
            ]
        else:
            self.views = list(by_share)
        self._watch_onset()

    def _flies(self, mean: float) -> bool:
        if self.landed:
            return False
        if mean > self.config.risen * self._top:
            self._relearn()
            self._top = mean
        self._top = max(self._top, mean)
        return mean > self.config.flying * self._top

    def _rest(self, commands: Array) -> None:
        if self._rest_count < self._gains.learn:
            self._rest_sum += commands
            self._rest_count += 1
            self._rests = self._rest_sum / self._rest_count

    def _by_share(self, i: int, shares: Array, fast: Array) -> SpeedView | None:
        table, learned, c = self.table, self._shares, self.config
        if not table.shows(i):
            return None
        deficits = [float(1.0 - row[i] / learned.healthy[i]) for row in (shares, fast)]
        k, k_fast = (table.degradation(i, d) for d in deficits)
        slope = max(table.slope(i, k), 0.1)
        noise, noise_fast = 0.5 * learned.scatter, learned.scatter
        error = table.error if self.trained else table.error * min(max(abs(k), 0.2), 1.0)
        std = math.sqrt((learned.doubt**2 + noise**2) / slope**2 + error**2)
        std_fast = math.hypot(learned.doubt, noise_fast) / max(table.slope(i, 0.0), 0.1)
        least = c.least_trained if self.trained else c.least
        return SpeedView(
            k, std, k_fast, max(least, c.sigmas * std_fast), std_fast, False, learned.settled, self.trained
        )

    def _by_command(self, slow: Array, slow_u: Array, fast: Array, fast_u: Array) -> list[SpeedView]:
        learned, c = self._gains, self.config
        least = c.least_trained if self.trained else c.least
        out = []
        values = [_relative(w, u) / learned.healthy for w, u in ((slow, slow_u), (fast, fast_u))]
        k, k_fast = (1.0 - value / np.median(value) for value in values)
        # what a wrong exponent makes of commands that left their healthy values
        away = np.log(slow_u / self._rests) if np.isfinite(self._rests).all() else np.zeros(self.n)
        away = np.abs(away - np.median(away)) * (0.1 * c.exponent if self.trained else c.exponent)
        for i in range(self.n):
            std = math.sqrt(learned.doubt**2 + (0.5 * learned.scatter) ** 2 + away[i] ** 2)
            std_fast = math.sqrt(learned.doubt**2 + learned.scatter**2 + away[i] ** 2)
            threshold = max(least, c.sigmas * std_fast)
            out.append(
                SpeedView(
                    float(k[i]),
                    std,
                    float(k_fast[i]),
                    threshold,
                    std_fast,
                    True,
                    learned.settled,
                    learned.settled,
                )
            )
        return out

    def _watch_onset(self) -> None:
        """Name the rotor whose share dipped first and deepest, while the controller had not yet answered."""
        worst = max(
            (i for i in range(self.n) if self.views[i] is not None),
            key=lambda i: self.views[i].k_fast,  # type: ignore[union-attr]
            default=None,
        )
        view = self.views[worst] if worst is not None else None
        if view is None or view.k_fast < 0.7 * view.threshold:
            self.named = None
            return
        if self.named is not None or not self._shares.settled or worst is None:
            return
        group = self.alike[worst]
        recent = np.array(self._deficits)[:, list(group)]
        limit = self.config.onset_sigmas * max(3.0 * self._shares.scatter, self._shares.doubt)
        for a, rotor in enumerate(group):
            others = [b for b in range(len(group)) if b != a]
            if others and (recent[:, [a]] - recent[:, others]).min(axis=1).max() > limit:
                self.named = rotor


def _relative(speeds: Array, commands: Array) -> Array:
    """Return (n,): speed per command over the rotors' median, so that voltage falls out."""
    gain = speeds / commands
    return np.asarray(gain / max(float(np.median(gain)), 1e-12))


def _completed(table: SpeedTable, geometric: SpeedTable) -> SpeedTable:
    """Return the trained table, rotors that it lacks from the geometry."""
    from dataclasses import replace

    rows = []
    for i, row in enumerate(table.deficit):
        known = np.isfinite(row).all()
        usable = np.isfinite(geometric.deficit[i]).all()
        line = np.interp(table.levels, geometric.levels, geometric.deficit[i]) if usable else row
        rows.append(row if known else line)
    return replace(table, deficit=np.array(rows))
