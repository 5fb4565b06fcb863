"""Fly the experiment of Ghalamchi, Jia and Mueller (2019) and print the paper's figures beside ours.

    python replay/ghalamchi2019.py            three vehicles, random setpoints and circle, about ten minutes
    python replay/ghalamchi2019.py --quick    the small and the medium quadrotor, random setpoints only
    python replay/ghalamchi2019.py --plot     and draw figures 4 to 6 to out/ (needs the extra `plots`)

As there: 500 Hz, motor speeds from the commands through a lag of 15 ms, one propeller cut by 5 or 40 mg, or
none. The paper's filter runs with its own parameters; the recommended mode runs beside it on what a telemetry
link gives of the same flights (100 Hz accelerations, 50 Hz rotor speeds).
"""

import argparse
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from unbalance_flights import DAMAGE_MG, Flown, Telemetry, damage, fly

from gcs_health.estimators.unbalance import UnbalanceConfig, UnbalanceEstimator
from gcs_health.estimators.unbalance_config import PaperConfig

OUT = Path("out")
ON_BOARD = Telemetry(500, 500, jitter=0.0, loss=0.0, latency=0.0, speeds=False, commands=True)
LINK = Telemetry(100, 50)
START_MG = {"small": 2.0, "medium": 20.0, "large": 20.0}  # Table I and section V.B
NAMED = 1.5  # times every other estimate, from then on: converged
# what the paper says of its figures 4 to 6: settled after, final estimate [mg]
PAPER = {
    "small": ("15 s", "order of 5"),
    "medium": ("order of 100 s", "40-50"),
    "large": ("slower", "100-120"),
}


@dataclass(frozen=True)
class Course:
    """How one flight's estimates went: time [s], unbalance of each rotor [mg at the tip]."""

    t: np.ndarray
    mg: np.ndarray
    rotor: int  # the damaged one
    healthy: bool

    def named_at(self) -> float:
        """Return from when on the damaged rotor leads all others clearly [s]; NaN = never."""
        others = np.delete(self.mg, self.rotor, axis=1).max(axis=1)
        leads = self.mg[:, self.rotor] > NAMED * others
        behind = np.flatnonzero(~leads)
        if not len(behind):
            return float(self.t[0])
        return float(self.t[behind[-1] + 1]) if behind[-1] + 1 < len(self.t) else math.nan


def paper(flown: Flown, share: float, extra: float) -> Course:
    """Run the paper's filter over one flight."""
    mass, radius = flown.airframe.mass or 1.0, flown.airframe.rotors[0].radius or 0.1
    start = START_MG[flown.vehicle] * 1e-6 * radius / mass
    config = UnbalanceConfig(mode="paper", paper=PaperConfig(start=start, extra=extra))
    estimator = UnbalanceEstimator(flown.airframe, config)
    t, mg, due = [], [], 1.0
    for reading in flown.readings(0, ON_BOARD, share):
        estimator.feed(reading)
        if reading.t >= due:
            due += 1.0
            t.append(reading.t)
            mg.append([estimate.value / radius * 1e6 for estimate in estimator.estimates(reading.t)])
    return Course(np.array(t), np.array(mg), int(flown.rotor[0]), share == 0.0)


def recommended(flown: Flown, share: float) -> str:
    """Run the recommended mode over the first 22 s of what the link gives; say what it finds."""
    estimator = UnbalanceEstimator(flown.airframe, UnbalanceConfig(damage=damage(flown.vehicle)))
    named = math.nan
    for reading in flown.readings(0, LINK, share):
        if reading.t > 22.0:
            break
        for estimate in estimator.feed(reading):
            if estimate.failure_probability > 0.9 and named != named:
                named = reading.t
    answer = estimator.answer
    if answer is None:
        return "nothing yet"
    tip = np.sqrt(answer.s()) * (flown.airframe.mass or 1.0) / (flown.airframe.rotors[0].radius or 0.1) * 1e6
    verdict = answer.verdict
    if verdict.finding.value != "rotor":
        return f"{verdict.finding.value}, largest {tip.max():.1f} mg"
    right = "right" if share and verdict.rotor == flown.rotor[0] else "WRONG"
    return f"{right} rotor after {named:.0f} s, {tip[verdict.rotor]:.1f} mg"


def figure(courses: dict[str, Course], vehicle: str) -> None:
    """Draw one figure of the paper: a column per experiment."""
    import matplotlib  # the extra `plots`

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    shown, axes = plt.subplots(1, len(courses), figsize=(4.0 * len(courses), 3.2), sharey=True, squeeze=False)
    for axis, (name, course) in zip(axes[0], courses.items(), strict=True):
        for i in range(course.mg.shape[1]):
            cut = i == course.rotor and not course.healthy
            axis.plot(
                course.t, course.mg[:, i], lw=2.0 if cut else 1.0, label=f"motor {i + 1}" + cut * ", cut"
            )
        if not course.healthy:
            axis.axhline(DAMAGE_MG[vehicle], color="0.6", ls="--", lw=1.0)
        axis.set(title=name, xlabel="time [s]")
        axis.legend(fontsize=7)
    axes[0][0].set_ylabel("unbalance [mg at the tip]")
    shown.tight_layout()
    OUT.mkdir(exist_ok=True)
    for kind in ("svg", "png"):
        shown.savefig(OUT / f"ghalamchi2019_{vehicle}.{kind}")
    plt.close(shown)
    print(f"figure: {OUT / f'ghalamchi2019_{vehicle}.svg'}", file=sys.stderr)


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="two vehicles, random setpoints, 60 s")
    parser.add_argument("--seconds", type=float, help="of each flight; 150, with --quick 60")
    parser.add_argument("--seed", type=int, default=2019)
    parser.add_argument("--plot", action="store_true")
    parser.add_argument("--extra", type=float, default=100.0, help="r_0, a variance [m^4/s^8]")
    args = parser.parse_args()
    seconds = args.seconds or (60.0 if args.quick else 150.0)
    print(
        f"Paper's filter at 500 Hz on commanded speeds, r_0 = {args.extra:g} m^4/s^8, "
        f"{seconds:.0f} s, seed {args.seed}.\n"
    )
    print(
        "| vehicle, flight | std of f, of which not common | paper: settles, final mg "
        "| ours: leads from s, final mg, largest other mg | recommended mode, 100/50 Hz |\n|---|---|---|---|---|",
        flush=True,
    )
    for vehicle in ("small", "medium") if args.quick else ("small", "medium", "large"):
        courses: dict[str, Course] = {}
        for kind in ("random",) if args.quick else ("random", "circle"):
            more = {"trajectory__every": 0.8} if kind == "random" else {}
            flown = fly(vehicle, kind, [args.seed], seconds, **more)
            square = flown.speed[:, :, 0] ** 2
            relative = square / square.mean(axis=0)
            common = relative.mean(axis=1, keepdims=True)
            spread = f"{relative.std(axis=0).mean():.1%}, {(relative - common).std(axis=0).mean():.1%}"
            for share in (0.0, 1.0) if kind == "random" else (1.0,):
                name = f"{'cut' if share else 'healthy'}, {kind}"
                course = courses[name] = paper(flown, share, args.extra)
                last = course.mg[-1]
                if share:
                    at = course.named_at()
                    others = np.delete(last, course.rotor).max()
                    ours = f"{at:.0f}, {last[course.rotor]:.1f}, {others:.1f}"
                    theirs = ", ".join(PAPER[vehicle])
                else:
                    ours, theirs = f"-, largest {last.max():.1f}", "decays to about 0"
                print(
                    f"| {vehicle}, {name} | {spread} | {theirs} | {ours} | {recommended(flown, share)} |",
                    flush=True,
                )
        if args.plot:
            figure(courses, vehicle)


if __name__ == "__main__":
    main()
