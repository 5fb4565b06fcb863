"""Faults grafted into the recorded healthy flights, from bytes: which kind, which rotor, when.

    python benchmarks/grafted.py ../shared/data --moments 3 --seed 62000 > benchmarks/grafted.md

Every flight is received whole up to moments at which verdicts may be given, drawn from the seed. From a copy of
the monitor at each, every fault goes on on every rotor, written into the bytes by `gcs_health.simulate.graft`; a
flight's answer is the code that its first alert on that rotor has escalated to within 6 s, or within 20 s for what
makes nothing fall, or before the recording ends. Delays are from the fault to the first alert, beside those of the
fastest single estimator that names the rotor. Trials at one moment, and rotors of one flight, are not independent:
read the intervals (95 %, Wilson) as somewhat narrow. What no flight can carry is said below the tables, with the
reason.

The rules were tuned on some of these very flights without a fault in them (`real_flights.md`); no fault was.
"""

import argparse
import math
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from every_flight import airframe, truth_of
from verdicts import Faults, Listener, Seen, confusion, share, sort_alerts, table

from gcs_health import vehicle_monitor
from gcs_health.errors import GcsHealthError
from gcs_health.fusion.alert_table import OF_KIND
from gcs_health.fusion.kinds import Kind
from gcs_health.simulate.detect import Course
from gcs_health.simulate.graft_fault import GraftFault
from gcs_health.simulate.recording import Flown, read_frames

# effect and how, its size (m/s² at the usual speed for unbalance), the kind that it is
FAULTS: Faults = {
    "20 % of the thrust lost": ("effectiveness", 0.8, Kind.THRUST_LOSS),
    "40 % of the thrust lost": ("effectiveness", 0.6, Kind.THRUST_LOSS),
    "shakes 2 m/s²": ("unbalance", 2.0, Kind.PROPELLER_UNBALANCED),
    "shakes 4 m/s²": ("unbalance", 4.0, Kind.PROPELLER_UNBALANCED),
    "drag x 1.4": ("drag", 1.4, Kind.DRAG_RISEN),
    "telemetry lost": ("lost", math.nan, Kind.ESC_TELEMETRY_LOST),
    "telemetry frozen": ("frozen", math.nan, Kind.ESC_TELEMETRY_LOST),
    "ESCs exchanged": ("swapped", math.nan, Kind.ESC_MISATTRIBUTED),
}
WITHIN, SLOWLY = 6.0, 20.0  # s
SLOW = ("unbalance", "drag", "swapped")
HEALTHY_UNTIL = {"bebop2_prop_eject": 12.0}  # s: what of a flight with a fault is healthy
NYQUIST = 2.0  # IMU samples in a turn of the rotor, below which its line is not in the stream
HIGHRES_IMU = 105
Result = tuple[str, str, str, Seen]  # flight, fault, rates, what came of it


def healthy(folder: Path) -> Iterator[tuple[str, list[tuple[int, bytes]]]]:
    """Yield the healthy flights, and the healthy beginnings of others: name and frames."""
    for path in sorted(folder.glob("*.tlog")):
        until = HEALTHY_UNTIL.get(path.stem, math.inf)
        if until < math.inf or truth_of(path).startswith("healthy"):
            frames = read_frames(str(path))
            first = frames[0][0]
            yield path.stem, [(stamp, raw) for stamp, raw in frames if stamp - first < until * 1e6]


def grafts(flown: Flown, fault: str, rng: np.random.Generator) -> list[GraftFault]:
    """Return the fault for every rotor that can have it."""
    effect, size, _ = FAULTS[fault]
    motors = [rotor.motor for rotor in flown.airframe.rotors]
    if effect == "drag":
        return [GraftFault(motors[k], effect, 0.0, size) for k in sorted(flown.powered)]
    if effect == "unbalance":
        usual = float(np.median(np.interp(flown.opened, flown.rotor_t, flown.speed.mean(axis=1))))
        size *= (flown.airframe.mass or 1.0) / usual**2
    if effect in ("effectiveness", "unbalance"):
        return [GraftFault(motor, effect, 0.0, size) for motor in motors]
    count = len(motors)
    others = {motor: motors[(k + 1 + int(rng.integers(count - 1))) % count] for k, motor in enumerate(motors)}
    return [
        GraftFault(motor, "telemetry", 0.0, how=effect, other=others[motor] if effect == "swapped" else 0)
        for motor in motors
    ]


def samples_a_turn(frames: list[tuple[int, bytes]], flown: Flown) -> float:
    """Return how many IMU samples the stream has in a turn of the usual rotor."""
    imu = [stamp for stamp, raw in frames if int.from_bytes(raw[7:10], "little") == HIGHRES_IMU]
    if len(imu) < 2:
        return 0.0
    turns = float(np.median(flown.speed)) / (2.0 * math.pi)
    return (len(imu) - 1) / ((imu[-1] - imu[0]) * 1e-6) / turns


def cannot(course: Course, fault: str, samples: float) -> str:
    """Return why a flight cannot carry a fault honestly; empty = it can. `samples` of the IMU a turn."""
    effect, _, _ = FAULTS[fault]
    flown = course.flown
    if effect == "drag" and not flown.powered:
        return "no ESC tells its current"
    if effect == "unbalance" and samples < NYQUIST:
        return f"fewer than {NYQUIST:g} IMU samples in a turn of the rotor"
    starts = course.slow_starts if effect in SLOW else course.starts
    if not starts:
        return (
            f"no moment with {SLOWLY:g} s of flight behind it" if effect in SLOW else "the gate never opens"
        )
    return ""


def judged(course: Course, name: str, faults: list[str], rng: np.random.Generator) -> Iterator[Result]:
    """Graft everything into one flight; yield what came of each fault, rotor and moment."""
    escs = {rotor.motor: rotor.esc for rotor in course.flown.airframe.rotors}
    for fault in faults:
        effect, _, kind = FAULTS[fault]
        within = SLOWLY if effect in SLOW else WITHIN
        for graft in grafts(course.flown, fault, rng):
            for at in course.slow_starts if effect in SLOW else course.starts:
                out = Seen()
                Listener.named.clear()
                steps = [
                    alert
                    for alert in course.alerts(at, graft, within)
                    if alert.state in ("raised", "escalated")
                ]
                sort_alerts(out, steps, kind, at, escs[graft.motor], within)
                named = [t - at for t, which in Listener.named if which == escs[graft.motor] and t >= at]
                out.single = min(named, default=math.nan)
                yield name, fault, "as recorded", out


def rotors(results: list[Result]) -> None:
    """Print how often the kind and the rotor are right, by fault and over all."""
    print(
        "\n| fault | trials | told | kind right | rotor right | another's alarm besides |\n"
        + "|---" * 6
        + "|"
    )
    for fault in (*FAULTS, "all"):
        many = [one for _, which, _, one in results if fault in (which, "all")]
        if not many:
            continue
        told = [one for one in many if one.code or one.others]
        right = sum(bool(one.code) for one in told)
        kinds = sum(
            one.code == OF_KIND[FAULTS[which][2]].code
            for _, which, _, one in results
            if fault in (which, "all")
        )
        besides = sum(bool(one.code and one.others) for one in many)
        print(
            f"| {fault} | {len(many)} | {share(len(told), len(many))} | {share(kinds, len(told))} | "
            f"{share(right, len(told))} | {besides} |"
        )


def refusals(refused: dict[str, list[str]], partly: dict[tuple[str, str], list[str]]) -> None:
    """Print which flights can carry nothing, and which not everything."""
    print("\n| cannot carry | why | flights |\n|---|---|---|")
    for why, names in refused.items():
        print(f"| any fault | {why} | {', '.join(names)} |")
    for (fault, why), names in partly.items():
        print(f"| {fault} | {why} | {', '.join(names)} |")


def main() -> None:
    """Graft and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--moments", type=int, default=3, help="in each flight, and as many slow ones")
    parser.add_argument("--seed", type=int, default=62000)
    parser.add_argument("--flights", nargs="*", help="those alone")
    args = parser.parse_args()
    vehicle_monitor.RotorPanel = Listener  # type: ignore[misc]
    results: list[Result] = []
    refused: dict[str, list[str]] = defaultdict(list)
    partly: dict[tuple[str, str], list[str]] = defaultdict(list)
    for k, (name, frames) in enumerate(healthy(args.folder)):
        if args.flights and name not in args.flights:
            continue
        rng = np.random.default_rng(np.random.SeedSequence(args.seed, spawn_key=(k,)))
        try:
            course = Course(name, frames, airframe(args.folder, name))
        except GcsHealthError as error:
            refused[str(error).removeprefix(f"{name}: ")].append(name)
            continue
        course.choose(args.moments, rng)
        samples = samples_a_turn(frames, course.flown)
        reasons = {fault: cannot(course, fault, samples) for fault in FAULTS}
        for fault, why in reasons.items():
            if why:
                partly[fault, why].append(name)
        results += judged(course, name, [fault for fault, why in reasons.items() if not why], rng)
        print(f"{name}: {len(course.starts)} moments, {len(results)} trials so far", file=sys.stderr)
    print(f"# Grafted faults\n\nPrinted by `python benchmarks/grafted.py {' '.join(sys.argv[1:])}`.\n")
    print((__doc__ or "").split("\n\n", 2)[2])
    rotors(results)
    confusion(results, FAULTS)
    print("\n## By flight\n")
    table(results, FAULTS)
    refusals(refused, partly)


if __name__ == "__main__":
    main()
