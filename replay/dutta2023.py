"""Dutta et al. (2023) again: 0-100 % of rotors 1 and 2, trained on the even tens, tested on the odd.

    python replay/dutta2023.py [--quick] [--gusts 2.3] [--plots]

One vehicle in severe air on the boom bench. Hub z: FP-AR(43)2 and (38)2 from 5000 samples a level, windows of
5 s; boom tip z: FP-AR(16)2 and (12)2 from 1000, windows of 2 s. "long" trains on all samples, with more basis
functions. `--quick` flies a third of the time. `--plots` writes out/dutta2023_*.png (the extra "plots": matplotlib).
"""

import argparse
import math
from pathlib import Path

import numpy as np

from gcs_health.estimators.labelled_flights import BOOM, LabelledFlight
from gcs_health.estimators.pooled_ar_model import (
    Array,
    Part,
    PooledModel,
    bic,
    fit,
    minimise,
    moments,
    residual_variances,
    rss,
    spread,
)
from gcs_health.estimators.pooled_ar_paper import PaperConfig, PaperWatch
from gcs_health.estimators.pooled_ar_training import samples, windows
from gcs_health.simulate.boom_bench import Bench, BenchFlights, Plan, fly_bench

RATE = 1.0 / 3e-4
EVEN, ODD = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0), (0.1, 0.3, 0.5, 0.7, 0.9)
PAPER = {"hub z": (5.55, 18.44), "boom tip": (1.55, 7.05)}  # mean error, mean width of the interval [% of k]
VEHICLE, SKIP = 1, 6.0


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--gusts", type=float, default=2.3, help="rms [m/s]; severe as in the paper: 2.3")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plots", action="store_true")
    options = parser.parse_args()
    plans = [
        Plan(VEHICLE, 1000 * options.seed + 100 * rotor + round(10 * k), rotor, k)
        for rotor in (0, 1)
        for k in (*EVEN, *ODD)
    ]
    flights = fly_bench(plans, Bench(gusts=options.gusts, duration=21.0 if options.quick else 60.0))
    told = flights.labelled(SKIP)
    print(f"gusts {options.gusts} m/s rms, seed {options.seed}, {flights.bench.duration:.0f} s a flight\n")
    hub = model(told, "az", (43, 38), (2, 2), 5000, 5.0)
    boom = model(told, BOOM, (16, 12), (2, 2), 1000, 2.0)
    structures(told)
    print("\n| signal, training | mean error | printed interval | covers | paper: error, interval |")
    print("|---|---|---|---|---|")
    curves = {}
    for name, which, made in (
        ("hub z", "as the paper", hub),
        ("hub z", "long (43)4", model(told, "az", (43, 43), (4, 4), 0, 5.0)),
        ("boom tip", "as the paper", boom),
        ("boom tip", "long (60)6", model(told, BOOM, (60, 60), (6, 6), 0, 2.0)),
    ):
        curves[f"{name}, {which}"] = quantified(made, told)
        error, width, inside = (
            100.0 * float(np.mean(column)) for column in curves[f"{name}, {which}"][:, 1:].T
        )
        print(
            f"| {name}, {which} | {error:.1f} | {width:.1f} | {inside:.0f} % | {PAPER[name][0]}, {PAPER[name][1]} |"
        )
    decided(hub, flights)
    if options.plots:
        draw(hub, boom, told, curves)


def model(
    flights: list[LabelledFlight],
    channel: str,
    orders: tuple[int, int],
    basis: tuple[int, int],
    length: int,
    window: float,
) -> PooledModel:
    """Return the models of both rotors from the first `length` samples of every even level; 0 = all."""
    levels = np.array(EVEN)
    even = [f for f in flights if f.k in EVEN]
    offset = float(np.mean([f.signal(channel, f.rotor).mean() for f in even if f.k == 0.0]))
    parts = []
    for rotor, na, p in zip((0, 1), orders, basis, strict=True):
        signals = [
            f.signal(channel, rotor) - offset for k in EVEN for f in even if (f.rotor, f.k) == (rotor, k)
        ]
        by_level = [moments(y[: length or len(y)], na) for y in signals]
        theta = fit(by_level, levels, na, p)
        parts.append(Part(rotor, channel, theta, residual_variances(by_level, levels, theta)))
    return PooledModel(
        vehicle="Dutta hexacopter",
        regime="severe",
        rate=RATE,
        mean_over=math.nan,
        cutoff=math.nan,
        levels=levels,
        channels=(channel,),
        offsets=np.array([offset]),
        scales=np.ones(1),
        parts=tuple(parts),
        alarm_window=1.0,
        value_window=window,
        bias=0.0,
        threshold=math.nan,
        alarm_every=math.nan,
        tail=(math.nan, math.nan),
        healthy_time=0.0,
        names=math.nan,
    )


def structures(flights: list[LabelledFlight]) -> None:
    """Print the BIC over the number of basis functions, eq. (18) as it must be meant."""
    even = [f for f in flights if f.k in EVEN and f.rotor == 0]
    mean = np.mean([f.signal("az", 0).mean() for f in even if f.k == 0.0])
    by_level = [moments(f.signal("az", 0)[:5000] - mean, 43) for f in sorted(even, key=lambda f: f.k)]
    print("| p | BIC, hub z, rotor 1 | RSS/SSS % |\n|---|---|---|")
    for p in range(1, 7):
        theta = fit(by_level, np.array(EVEN), 43, p)
        left = residual_variances(by_level, np.array(EVEN), theta) * [m.length for m in by_level]
        ratio = 100.0 * left.sum() / sum(m.Y for m in by_level)
        print(f"| {p} | {bic(by_level, np.array(EVEN), theta):.0f} | {ratio:.2g} |")


def quantified(made: PooledModel, flights: list[LabelledFlight]) -> Array:
    """Return rows of (k, |error|, width, covered) of every window at the odd tens, the rotor known."""
    rows = []
    for flight in flights:
        if flight.k not in ODD:
            continue
        blocks = windows(made, flight, flight.rotor, made.value_window)
        k = np.clip(minimise(blocks.sum(axis=1)), 0.0, 1.0)
        sigma = np.sqrt(spread(blocks, k, samples(made, blocks)).crlb)
        error = np.abs(k - flight.k)
        rows += list(zip(np.full(len(k), flight.k), error, 3.92 * sigma, error <= 1.96 * sigma, strict=True))
    return np.array(rows, dtype=float)


def decided(made: PooledModel, flights: BenchFlights) -> None:
    """Print detection by the t-test (1 s) and identification by whiteness (5 s) at every level."""
    print(
        "\n| rotor | k % | windows of 1 s called faulty | rotor 1 white | rotor 2 white |\n|---|---|---|---|---|"
    )
    stop = SKIP + 12.0
    for j, plan in enumerate(flights.plans):
        watch = PaperWatch(made, PaperConfig())
        faulty, white = [], []
        for reading in flights.readings(j, ("hub",)):
            if not SKIP <= reading.t < stop or not watch.feed(reading) or not watch.views:  # type: ignore[arg-type]
                continue
            faulty.append(watch.detected)
            if watch.views[0].full:
                white.append([watch.views[rotor].white for rotor in (0, 1)])
        share = 100.0 * np.mean(white, axis=0)
        print(
            f"| {plan.rotor + 1} | {100 * plan.k:.0f} | {100 * np.mean(faulty):.0f} % | "
            f"{share[0]:.0f} % | {share[1]:.0f} % |"
        )


def draw(
    hub: PooledModel, boom: PooledModel, flights: list[LabelledFlight], curves: dict[str, Array]
) -> None:
    """Write the RSS curves of figs. 13 and 14, and the errors by level."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    out = Path(__file__).parents[1] / "out"
    out.mkdir(exist_ok=True)
    figure, axes = pyplot.subplots(2, 2, figsize=(9, 6), constrained_layout=True)
    grid = np.linspace(0.0, 1.0, 201)
    for row, (made, name) in zip(axes, ((hub, "hub z, 5 s"), (boom, "boom tip z, 2 s")), strict=True):
        for axis, k in zip(row, (0.1, 0.7), strict=True):
            flight = next(f for f in flights if f.rotor == 0 and f.k == k)
            M = windows(made, flight, 0, made.value_window)[:1].sum(axis=1)
            axis.plot(100 * grid, [float(rss(M, np.array([x]))[0]) for x in grid])
            axis.axvline(100 * k, color="red", label="true")
            axis.axvline(100 * float(minimise(M)[0]), color="green", linestyle="--", label="found")
            axis.set(title=f"{name}: rotor 1, {100 * k:.0f} %", xlabel="degradation %", ylabel="RSS")
    axes[0, 0].legend()
    figure.savefig(out / "dutta2023_rss.png", dpi=120)
    figure, axis = pyplot.subplots(figsize=(7, 4), constrained_layout=True)
    for name, rows in curves.items():
        axis.plot(
            [100 * k for k in ODD], [100 * rows[rows[:, 0] == k, 1].mean() for k in ODD], "o-", label=name
        )
    axis.set(xlabel="degradation %", ylabel="mean absolute error %")
    axis.legend()
    figure.savefig(out / "dutta2023_errors.png", dpi=120)


if __name__ == "__main__":
    main()
