"""Training a pooled model from labelled flights: orders, coefficients, intervals and alarm threshold.

    fit         levels 0, .2 .. 1 of each rotor            -> na by BIC on healthy data, theta by WLS
    held out    levels between, vehicles not fitted        -> p, b of the intervals, share of right rotors
    healthy     flights of at least five vehicles          -> threshold at one alarm per `alarm_every`

A flight belongs to one of the three alone: what is tuned on must not report. Flights come from the simulator or
from recordings (`labelled_flights.py`). Source: Dutta et al. (2023); sheet 4 section 6.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.calibration.alarm_level import gumbel
from gcs_health.errors import ConfigError
from gcs_health.estimators.labelled_flights import BOOM, LabelledFlight
from gcs_health.estimators.pooled_ar_air import FEW, KnownAir, learned
from gcs_health.estimators.pooled_ar_model import (
    Array,
    Moments,
    Part,
    PooledModel,
    best_order,
    fit,
    grams,
    minimise,
    misfit,
    moments,
    residual_variances,
    spread,
)
from gcs_health.estimators.pooled_ar_watch import WatchConfig, judge
from gcs_health.estimators.speed_training import learned_speeds

MAXIMA = 10.0  # s, over which healthy maxima are taken
SLOWEST_FILTER = 40.0  # Hz: a lower cut-off leaves the body's motion alone, of which nothing was measured
COVERED = 0.95  # of held-out windows by the 95 % interval


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """What to train; of `orders` and `basis` the best is taken.

    vehicle, regime : in words. rate [Hz]. channels : "ax" .. "r" of the IMU, or "boom" alone.
    mean_over [s], cutoff [Hz] : what the accelerations have passed. alarm_window, value_window [s].
    alarm_every [s] : a healthy flight's time between alarms.
    """

    vehicle: str
    regime: str
    rate: float
    channels: tuple[str, ...]
    mean_over: float = math.nan
    cutoff: float = math.nan
    orders: tuple[int, ...] = (8, 12, 16, 24, 32, 43)
    basis: tuple[int, ...] = (2, 3, 4, 5, 6)
    alarm_window: float = 1.0
    value_window: float = 5.0
    alarm_every: float = 300.0


def train(
    fitted: Sequence[LabelledFlight],
    held_out: Sequence[LabelledFlight],
    healthy: Sequence[LabelledFlight],
    settings: TrainingSettings,
    airframe: Airframe | None = None,
) -> PooledModel:
    """Learn a model; with an airframe, what its flights' rotor speeds teach too.

    Raises
    ------
    ConfigError : a set of flights is missing or short, or a filter leaves nothing to learn from.
    """
    s = settings
    _check(fitted, held_out, healthy, s)
    candidates = [measured(model, held_out) for model in _fits(fitted, s)]
    model = min(candidates, key=lambda one: dict(one.facts)["mean_error"])
    maxima = np.concatenate([healthy_maxima(model, flight) for flight in healthy])
    if not len(maxima):
        longest = max(flight.length for flight in healthy) / s.rate
        raise ConfigError(
            f"training: expected {MAXIMA + s.alarm_window:g} s of healthy flight on end to set the threshold on, "
            f"got {longest:.0f} s"
        )
    location, scale = gumbel(maxima)
    vehicles = {flight.vehicle for flight in (*fitted, *held_out, *healthy)}
    return replace(
        model,
        tail=(location, scale),
        threshold=_threshold(maxima, location, scale, s.alarm_every),
        healthy_time=len(maxima) * MAXIMA,
        air=known_air(model, [*held_out, *healthy]),
        speeds=learned_speeds(airframe, fitted, held_out, healthy) if airframe else None,
        facts=(
            *model.facts,
            ("vehicles", float(len(vehicles))),
            ("fit_seconds", sum(flight.length for flight in fitted) / s.rate),
        ),
    )


def measured(model: PooledModel, held_out: Sequence[LabelledFlight]) -> PooledModel:
    """Return the model with its mean error, b and share of right rotors, from held-out flights."""
    errors, needed, right = [], [], []
    for flight in held_out:
        blocks = windows(model, flight, flight.rotor, model.value_window)
        if not len(blocks):
            continue
        k = minimise(blocks.sum(axis=1))
        error = k - flight.k
        errors.append(np.abs(error))
        sure = spread(blocks, k, samples(model, blocks))
        needed.append((error / 1.96) ** 2 - sure.robust)
        if flight.k > 0.0:
            right.append(identified(model, flight, model.value_window) == flight.rotor)
    if not errors:
        raise ConfigError(f"training: no held-out flight is as long as {model.value_window:g} s")
    bias = math.sqrt(max(float(np.quantile(np.concatenate(needed), COVERED)), 0.0))
    facts = (
        ("mean_error", float(np.concatenate(errors).mean())),
        ("held_out_windows", float(sum(map(len, errors)))),
    )
    names = float(np.concatenate(right).mean()) if right else math.nan
    return replace(model, bias=bias, names=names, facts=(*model.facts, *facts))


def known_air(model: PooledModel, flights: Sequence[LabelledFlight]) -> KnownAir | None:
    """Return what value windows of flights that were not fitted look like; None if there are too few."""
    recent = round(model.alarm_window * model.rate / model.block)
    truth, k, z = [], [], []
    for flight in flights:
        of_each = [windows(model, flight, rotor, model.value_window) for rotor in model.rotors]
        for blocks in zip(*of_each, strict=True):
            grams = dict(zip(model.rotors, blocks, strict=True))
            verdict = judge(model, WatchConfig(), 0.0, grams, recent, True)
            truth.append(flight.k)
            k.append(verdict.views[verdict.best].k)
            z.append(verdict.traits)
    return learned(np.array(truth), np.array(k), np.array(z)) if len(z) >= FEW else None


def windows(model: PooledModel, flight: LabelledFlight, rotor: int, length: float, every: int = 0) -> Array:
    """Return (w, m, p+1, p+1): the block Grams of windows of `length` [s] through a rotor's model.

    `every` : blocks from one window to the next; 0 = they do not overlap.
    """
    offset = dict(zip(model.channels, model.offsets, strict=True))
    scale = dict(zip(model.channels, model.scales, strict=True))
    total: Array | None = None
    for part in model.of_rotor(rotor):
        y = flight.signal(part.channel, rotor) - offset[part.channel]
        y = y[model.longest - len(part.theta) :]  # so that the blocks of all parts are the same
        one = grams(y, part.theta, model.block) / scale[part.channel]
        total = one if total is None else total + one
    assert total is not None
    m = max(1, round(length * model.rate / model.block))
    starts = range(0, len(total) - m + 1, every or m)
    return np.array([total[start : start + m] for start in starts]).reshape(-1, m, *total.shape[1:])


def samples(model: PooledModel, blocks: Array) -> float:
    """Return how many residuals a window of these blocks holds, over all channels."""
    return float(blocks.shape[1] * model.block * len(model.channels))


def identified(model: PooledModel, flight: LabelledFlight, length: float) -> Array:
    """Return (w,): the rotor of the smallest residual in each window."""
    of_each = []
    for rotor in model.rotors:
        blocks = windows(model, flight, rotor, length)
        M: Array = blocks.sum(axis=1)
        of_each.append(misfit(model, rotor, M, minimise(M), samples(model, blocks)))
    return np.asarray(np.array(model.rotors)[np.argmin(np.array(of_each), axis=0)])


def healthy_maxima(model: PooledModel, flight: LabelledFlight) -> Array:
    """Return the largest k of any rotor in every 10 s of alarm windows, 0.1 s apart."""
    of_each = [
        minimise(windows(model, flight, rotor, model.alarm_window, every=1).sum(axis=1))
        for rotor in model.rotors
    ]
    largest = np.max(np.array(of_each), axis=0)
    count = round(MAXIMA * model.rate / model.block)
    whole = len(largest) // count
    return np.asarray(largest[: whole * count].reshape(whole, count).max(axis=1))


def _check(
    fitted: Sequence[LabelledFlight],
    held_out: Sequence[LabelledFlight],
    healthy: Sequence[LabelledFlight],
    s: TrainingSettings,
) -> None:
    if not any(flight.k == 0.0 for flight in fitted):
        raise ConfigError("training: expected healthy flights (k = 0) among those to fit, got none")
    faulty = {flight.rotor for flight in fitted if flight.k > 0.0}
    for rotor in faulty:
        if len({flight.k for flight in fitted if flight.rotor == rotor and flight.k > 0.0}) < 2:
            raise ConfigError(f"training: rotor {rotor + 1}: expected two degraded levels at least")
    if not faulty or not held_out or not healthy:
        raise ConfigError("training: expected degraded, held-out and healthy flights, one kind is missing")
    if not {flight.rotor for flight in held_out if flight.k > 0.0} <= faulty:
        raise ConfigError("training: held-out flights of a rotor that no flight to fit degrades")
    if any(flight.k > 0.0 for flight in healthy):
        raise ConfigError("training: a degraded flight among those to set the threshold on")
    if BOOM in s.channels and len(s.channels) > 1:
        raise ConfigError("training: boom sensors and the IMU make two models")
    if s.cutoff < SLOWEST_FILTER:
        raise ConfigError(f"training: a filter of {s.cutoff:g} Hz leaves nothing of the rotors to learn from")


def _fits(fitted: Sequence[LabelledFlight], s: TrainingSettings) -> list[PooledModel]:
    """Return a model for each candidate number of basis functions, thresholds still unknown."""
    rotors = sorted({flight.rotor for flight in fitted if flight.k > 0.0})
    levels = np.array(sorted({flight.k for flight in fitted}))
    healthy = [flight for flight in fitted if flight.k == 0.0]
    offsets = {
        channel: float(np.mean([flight.signal(channel, r).mean() for flight in healthy for r in rotors]))
        for channel in s.channels
    }
    learned = {
        (rotor, channel): _by_level(fitted, channel, rotor, offsets[channel], levels, max(s.orders))
        for rotor in rotors
        for channel in s.channels
    }
    orders = {key: best_order(by_level[0], s.orders) for key, by_level in learned.items()}
    made = []
    for p in s.basis:
        if p > len(levels):
            continue
        parts = tuple(_part(*key, by_level, levels, orders[key], p) for key, by_level in learned.items())
        made.append(
            PooledModel(
                vehicle=s.vehicle,
                regime=s.regime,
                rate=s.rate,
                mean_over=s.mean_over,
                cutoff=s.cutoff,
                levels=levels,
                channels=s.channels,
                offsets=np.array(list(offsets.values())),
                scales=_scales(parts, s.channels),
                parts=parts,
                alarm_window=s.alarm_window,
                value_window=s.value_window,
                bias=math.nan,
                threshold=math.nan,
                alarm_every=s.alarm_every,
                tail=(math.nan, math.nan),
                healthy_time=0.0,
                names=math.nan,
                facts=(("p", float(p)),),
            )
        )
    return made


def _by_level(
    fitted: Sequence[LabelledFlight], channel: str, rotor: int, offset: float, levels: Array, na: int
) -> list[Moments]:
    out = []
    for k in levels:
        flights = [f for f in fitted if f.k == k and (k == 0.0 or f.rotor == rotor)]
        if not flights:
            raise ConfigError(f"training: rotor {rotor + 1}: no flight at the level {k:g} of another rotor")
        parts = [moments(flight.signal(channel, rotor) - offset, na) for flight in flights]
        total = parts[0]
        for part in parts[1:]:
            total = total + part
        out.append(total)
    return out


def _part(rotor: int, channel: str, by_level: list[Moments], levels: Array, na: int, p: int) -> Part:
    theta = fit(by_level, levels, na, p)
    return Part(rotor, channel, theta, residual_variances(by_level, levels, theta))


def _scales(parts: tuple[Part, ...], channels: tuple[str, ...]) -> Array:
    """Return one variance a channel, the same for every rotor's model: else their residuals do not compare."""
    return np.array(
        [
            math.exp(np.mean([np.log(part.variance).mean() for part in parts if part.channel == channel]))
            for channel in channels
        ]
    )


def orders_for(rate: float) -> tuple[int, ...]:
    """Return AR orders to choose from at a rate [Hz]: up to a tenth of a second of the past."""
    most = TrainingSettings("", "", rate, ()).orders
    return tuple(order for order in most if order <= max(0.1 * rate, most[0]))


def _threshold(maxima: Array, location: float, scale: float, every: float) -> float:
    """Return what 10 s of healthy flight pass with probability 10 s / `every`: the larger of law and count."""
    share = 1.0 - min(MAXIMA / every, 0.5)
    law = location - scale * math.log(-math.log(share))
    return max(law, float(np.quantile(maxima, share)))
