"""One pooled model watching one stream: samples in, a verdict every 0.1 s.

A block of 0.1 s becomes one (p+1)² Gram a rotor; windows are sums of blocks (sheet 4, eq. 5). Blocks are counted
in samples from the last gap on, so how readings are chunked changes nothing. Memory: the blocks of one value
window. A gap starts the AR history anew and leaves the blocks before it as they are.
"""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from gcs_health.estimators.contract import Reason
from gcs_health.estimators.pooled_ar_air import traits
from gcs_health.estimators.pooled_ar_model import Array, PooledModel, minimise, misfit, rss, spread
from gcs_health.samples import BoomReading, ImuReading

ABSURD = 1e5  # no sensor gives more
EVEN = 0.05  # of the step: by so much a block's mean step may differ from the trained one
GAP, RUSH = 1.6, 0.3  # steps; between them is jitter
FULL = 0.8  # of a window must be there
FIFTHS = 5  # pieces of a window whose residuals are compared


@dataclass(frozen=True, slots=True)
class WatchConfig:
    """When a model refuses to answer; sheet 4 section 6, bounds as tested in benchmarks/pooled_ar.md."""

    ratio: tuple[float, float] = (0.6, 2.0)  # residual variance over the trained one
    uneven: float = 3.0  # between the fifths of a window
    k: tuple[float, float] = (-0.2, 1.2)
    margin: float = 1.02  # the second rotor's residual over the best one's
    names: float = 0.8  # of held-out windows named rightly, or the model names no rotor
    hold: float = 2.0  # s that an alarm lasts: overlapping windows are one event
    usual: float = 0.02  # weight of a new step in the usual one


@dataclass(frozen=True, slots=True)
class RotorView:
    """What one rotor's model says of the windows that end now.

    k, std : of the value window. k_alarm, std_alarm : of the alarm window. ratio : residual variance over the
    trained one, in both windows.
    """

    k: float
    std: float
    k_alarm: float
    std_alarm: float
    ratio: float
    ratio_alarm: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """One model's answer at t [s].

    views : by rotor. order : rotors by their residual, the smallest first. lead : the next one's over it.
    refused : why no value is given; blind : why no alarm either.
    """

    t: float
    views: dict[int, RotorView]
    order: tuple[int, ...]
    lead: float
    refused: tuple[Reason, ...]
    blind: tuple[Reason, ...]

    @property
    def best(self) -> int:
        """The rotor of the smallest residual."""
        return self.order[0]

    @property
    def traits(self) -> Array:
        """What tells the air; see `pooled_ar_air`."""
        best, *others = (self.views[rotor] for rotor in self.order)
        return traits(best.ratio, [(other.ratio, other.k) for other in others])


class ModelWatch:
    """Feed one kind of reading; `verdict` is the last one, `missing` says why there is none."""

    def __init__(self, model: PooledModel, config: WatchConfig, lags: int = 0) -> None:
        self.model, self.config, self.lags = model, config, lags
        self.takes: type = ImuReading if model.takes_imu else BoomReading
        self._fields = (
            () if self.takes is BoomReading else tuple(ImuReading._fields.index(c) for c in model.channels)
        )
        self._rotors = model.rotors
        self._parts = [
            (
                rotor,
                self._rotors.index(rotor)
                if self.takes is BoomReading
                else model.channels.index(part.channel),
                part.theta[::-1].copy(),
                model.offsets[model.channels.index(part.channel)],
                model.scales[model.channels.index(part.channel)],
            )
            for rotor in self._rotors
            for part in model.of_rotor(rotor)
        ]
        self._longest, self._block = model.longest, model.block
        self._size = round(model.value_window * model.rate / model.block)
        self._alarm_size = round(model.alarm_window * model.rate / model.block)
        self.verdict: Verdict | None = None
        self._t = -math.inf
        self._usual = math.nan
        self._rows: list[tuple[float, ...]] = []
        self._started = math.nan  # time of the first sample of the block
        self.blocks: deque[tuple[float, dict[int, Array]]] = deque(maxlen=self._size)
        self._tails: dict[int, Array] = {}  # of v, for the lags
        self._uneven = False
        self._filter_differs = False

    def filtered(self, mean_over: float, cutoff: float) -> None:
        """Take what the accelerations pass on board."""
        self._filter_differs = self.takes is ImuReading and not (
            _alike(mean_over, self.model.mean_over) and _alike(cutoff, self.model.cutoff)
        )

    def feed(self, reading: ImuReading | BoomReading) -> bool:
        """Take one sample; return whether there is a new verdict."""
        row = self._row(reading)
        if row is None:
            return False
        t, step = reading.t, 1.0 / self.model.rate
        dt = t - self._t
        if dt <= 0.0:
            return False
        self._t = t
        if 0.2 * step < dt < 5.0 * step:
            usual = self._usual
            self._usual = dt if usual != usual else usual + self.config.usual * (dt - usual)
        if not RUSH * step < dt < GAP * step:
            self._rows.clear()
            self._tails.clear()
        self._rows.append(row)
        count = len(self._rows)
        if count == self._longest:
            self._started = t
        if count < self._longest + self._block:
            return False
        self._close(t)
        return True

    def missing(self, t: float, stale_after: float) -> tuple[Reason, ...]:
        """Return why there is no verdict at time t [s]; empty = there is one."""
        if self._t == -math.inf:
            return (Reason.MODEL_SIGNAL,)
        if t - self._t > stale_after:
            return (Reason.IMU_STALE,)
        reasons = []
        if self._filter_differs:
            reasons.append(Reason.MODEL_FILTER)
        if abs(self._usual * self.model.rate - 1.0) > 2.0 * EVEN or self._uneven:
            reasons.append(Reason.MODEL_RATE)
        newest = self.blocks[-1][0] if self.blocks and (self.lags or self.verdict) else -math.inf
        if not reasons and t - newest > stale_after:
            reasons.append(Reason.FILLING)
        return tuple(reasons)

    def _row(self, reading: ImuReading | BoomReading) -> tuple[float, ...] | None:
        if isinstance(reading, BoomReading):
            if len(reading.az) <= self._rotors[-1]:
                return None
            row = tuple([reading.az[rotor] for rotor in self._rotors])
        else:
            row = tuple([reading[k] for k in self._fields])
        for value in row:
            if not -ABSURD < value < ABSURD:
                return None
        return row

    def _close(self, t: float) -> None:
        """Turn the rows into Grams, and look."""
        step = (t - self._started) / self._block
        self._uneven = abs(step * self.model.rate - 1.0) > EVEN
        y = np.array(self._rows).T
        self._rows = self._rows[-self._longest :]
        self._started = t
        if self._uneven:
            return
        grams: dict[int, Array] = {}
        for rotor, column, theta, offset, scale in self._parts:
            v = self._features(y[column] - offset, theta)
            gram = v.T @ v / scale
            grams[rotor] = grams[rotor] + gram if rotor in grams else gram
            if self.lags:
                grams[rotor] = self._lagged(rotor, v)
        self.blocks.append((t, grams))
        self.verdict = None if self.lags else self._look(t)

    def _features(self, signal: Array, theta: Array) -> Array:
        """Return v (block, p + 1) of the newest block; theta is reversed in time."""
        v = np.empty((self._block, theta.shape[1] + 1))
        v[:, 0] = signal[self._longest :]
        phi = np.lib.stride_tricks.sliding_window_view(signal[self._longest - len(theta) : -1], len(theta))
        v[:, 1:] = np.ascontiguousarray(phi) @ theta  # a view would miss the fast product
        return v

    def _lagged(self, rotor: int, v: Array) -> Array:
        """Return (lags + 1, p+1, p+1): sums of v[t] v[t - lag]', from which residuals' autocorrelations come."""
        tail = self._tails.get(rotor, np.zeros((self.lags, v.shape[1])))
        whole = np.concatenate([tail, v])
        self._tails[rotor] = whole[-self.lags :]
        end = len(whole)
        return np.array([v.T @ whole[self.lags - lag : end - lag] for lag in range(self.lags + 1)])

    def _look(self, t: float) -> Verdict | None:
        """Judge the windows that end at t [s]; None while they fill."""
        model = self.model
        edge = t - model.value_window - 0.05
        while self.blocks[0][0] < edge:
            self.blocks.popleft()
        alarm_edge = t - model.alarm_window + 0.05
        recent = sum(1 for when, _ in self.blocks if when > alarm_edge)
        if recent < FULL * self._alarm_size:
            return None
        grams = {rotor: np.array([each[rotor] for _, each in self.blocks]) for rotor in self._rotors}
        return judge(model, self.config, t, grams, recent, len(self.blocks) >= FULL * self._size)


def judge(
    model: PooledModel, config: WatchConfig, t: float, grams: dict[int, Array], recent: int, whole: bool
) -> Verdict:
    """Return the verdict of the windows that end at t [s].

    Parameters
    ----------
    grams : of each rotor (m, p+1, p+1), the blocks of the value window, oldest first.
    recent : how many of them are the alarm window. whole : the value window has no holes.
    """
    c = config
    views, misfits = {}, {}
    for rotor, blocks in grams.items():
        views[rotor], misfits[rotor] = _view(model, rotor, blocks, recent)
    order = tuple(sorted(grams, key=misfits.__getitem__))
    lead = misfits[order[1]] / misfits[order[0]] if len(order) > 1 else math.inf
    best = views[order[0]]
    blind = () if c.ratio[0] <= best.ratio_alarm <= c.ratio[1] else (Reason.UNMODELLED,)
    verdict = Verdict(t, views, order, float(lead), (), blind)
    refused = [] if whole else [Reason.FILLING]
    at_home = model.air is None or model.air.holds(best.k, verdict.traits)
    if not (at_home and c.ratio[0] <= best.ratio <= c.ratio[1] and c.k[0] <= best.k <= c.k[1]):
        refused.append(Reason.UNMODELLED)
    if not _steady(grams[order[0]], best.k, c.uneven):
        refused.append(Reason.UNSTEADY)
    return replace(verdict, refused=tuple(refused))


def _view(model: PooledModel, rotor: int, blocks: Array, recent: int) -> tuple[RotorView, float]:
    """Return what a rotor's model says, and its misfit in the value window."""
    channels = len(model.channels)
    M = np.stack([blocks.sum(axis=0), blocks[-recent:].sum(axis=0)])
    k = minimise(M)
    counts = channels * model.block * np.array([len(blocks), recent], dtype=float)
    ratio = rss(M, k) / counts / model.expected(rotor, k) * channels
    sure = spread(blocks[None], k[:1], counts[0])
    sure_alarm = spread(blocks[None, -recent:], k[1:], counts[1])
    view = RotorView(
        k=float(k[0]),
        std=math.sqrt(float(sure.robust[0]) + model.bias**2),
        k_alarm=float(k[1]),
        std_alarm=math.sqrt(float(sure_alarm.robust[0])),
        ratio=float(ratio[0]),
        ratio_alarm=float(ratio[1]),
    )
    return view, float(misfit(model, rotor, M[:1], k[:1], counts[0])[0])


def _steady(blocks: Array, k: float, most: float) -> bool:
    """Whether no fifth of the window has a residual far from another's."""
    size = len(blocks) // FIFTHS
    if size == 0:
        return True
    sums = blocks[: FIFTHS * size].reshape(FIFTHS, size, *blocks.shape[1:]).sum(axis=1)
    left = rss(sums, np.full(FIFTHS, k))
    return bool(left.max() <= most * max(left.min(), 1e-300))


def _alike(one: float, other: float) -> bool:
    return one == other or (one != one and other != other) or abs(one - other) < 0.05 * abs(other)
