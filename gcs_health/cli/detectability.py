"""`gcs-health detectability`: what would be found on this airframe, with its noise and its rates."""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from gcs_health.cli import DONE
from gcs_health.errors import ConfigError, LogError
from gcs_health.simulate.detect import (
    SLOW,
    SLOW_WINDOW,
    WINDOW,
    Course,
    Trial,
    faults,
    median_interval,
    wilson,
)
from gcs_health.simulate.recording import read_frames
from gcs_health.vehicle_file import load_vehicle

SCHEMA = "gcs_health.detectability/1"
ROW = "{:<18}{:<7}{:<19}{:<22}{:>9}{:>13}"
FOOT = f"""
left: of the rotor's thrust after a sudden loss, grafted by the linear model. shakes: an unbalanced propeller, by its
acceleration at the flight's usual speed. drag: factor on that motor's current. found: the right motor named within
{WINDOW:g} s, for shakes and drag within {SLOW_WINDOW:g} s, at fewer moments. Intervals: 95 %, Wilson and order
statistics. Every motor fails at the same moments. wrong alarm: another motor named, or any motor where only telemetry
failed. Trials at one moment are not independent: read "all" as somewhat less sure than its interval."""


def run(options: argparse.Namespace) -> int:
    """Graft the ladder over every rotor into every flight; print what was found."""
    airframe = load_vehicle(options.vehicle) if options.vehicle else None
    courses = [Course(name, read_frames(name), airframe) for name in options.files]
    motors = [rotor.motor for rotor in courses[0].flown.airframe.rotors]
    for course in courses[1:]:
        if [rotor.motor for rotor in course.flown.airframe.rotors] != motors:
            raise LogError(f"{course.name}: other motors than in {courses[0].name}; one vehicle at a time")
    for k, course in enumerate(courses):
        rng = np.random.default_rng(np.random.SeedSequence(options.seed, spawn_key=(k,)))
        if not course.choose(math.ceil(options.trials / len(courses)), rng):
            raise LogError(f"{course.name}: the gate never opens for long: no moment to judge a fault at")
    with _Lines(options.jsonl) as lines:
        _report(courses, motors, options, lines)
    return DONE


class _Lines:
    """The JSON lines, where asked for; a context manager. `text` is where the table goes."""

    def __init__(self, name: str | None) -> None:
        self.text: TextIO = sys.stderr if name == "-" else sys.stdout
        self._file: TextIO | None = None
        try:
            # for as long as the table is being made
            self._own = Path(name).open("w", encoding="utf-8") if name and name != "-" else None  # noqa: SIM115
        except OSError as error:
            raise ConfigError(f"{name}: cannot write the JSON lines: {error.strerror}") from None
        self._file = sys.stdout if name == "-" else self._own

    def __enter__(self) -> "_Lines":
        return self

    def __exit__(self, *_: object) -> None:
        if self._own is not None:
            self._own.close()

    def write(self, row: dict[str, Any]) -> None:
        if self._file is not None:
            known = {key: None if isinstance(v, float) and math.isnan(v) else v for key, v in row.items()}
            self._file.write(json.dumps(known) + "\n")


def _report(courses: list[Course], motors: list[int], options: argparse.Namespace, lines: _Lines) -> None:
    count = sum(len(course.starts) for course in courses)
    opened = sum(course.open_time for course in courses)
    head = {"schema": SCHEMA, "files": options.files, "motors": motors, "seed": options.seed}
    lines.write(head | {"starts": count, "open_gate_s": round(opened, 3), "window_s": WINDOW})
    plural = "s" if len(courses) > 1 else ""
    print(
        f"{len(courses)} flight{plural}, verdicts possible for {opened:.0f} s of it, in which healthy nothing is "
        f"named\n{len(motors)} motors, {count} moment{'s' if count > 1 else ''} each, seed {options.seed}\n",
        file=lines.text,
    )
    print(
        ROW.format("fault", "motor", "found", "median ms", "97.5 % ms", "wrong alarm"),
        file=lines.text,
    )
    rungs = faults(courses[0].flown)
    if options.only:
        rungs = [rung for rung in rungs if rung.effect.split()[0] in options.only]
    for rung in rungs:
        _progress(rung.name)
        by_motor = [
            [course.trial(k, fault) for course in courses for k in range(len(course.starts_for(rung.effect)))]
            for fault in rung.faults
        ]
        _progress("")
        everything = [trial for trials in by_motor for trial in trials]
        if not everything:
            continue
        sized = rung.size == rung.size
        rows = zip(["all", *(fault.motor for fault in rung.faults)], [everything, *by_motor], strict=True)
        name, head = rung.name, {"fault": rung.effect, "size": rung.size, "size_is": rung.size_is or None}
        for motor, trials in rows if sized else [("all", everything)]:
            row = _row(trials, named_is_wrong=not sized)
            print(_text(name, str(motor), row), file=lines.text, flush=True)
            lines.write(head | {"motor": None if motor == "all" else motor} | row)
            name = ""
    wanted = set(options.only or SLOW)
    if wanted.intersection(SLOW) and not any(course.slow_starts for course in courses):
        print(
            f"\nno moment has {SLOW_WINDOW:g} s of flight behind it: nothing slow is judged", file=lines.text
        )
    elif "drag" in wanted and not any(rung.effect == "drag" for rung in rungs):
        print("\nno ESC tells its current: no drag can be raised", file=lines.text)
    print(FOOT, file=lines.text)


def _row(trials: list[Trial], *, named_is_wrong: bool) -> dict[str, Any]:
    """Return what a row of the table says, delays in seconds."""
    right = [] if named_is_wrong else [trial.delay for trial in trials if trial.found]
    wrong = sum(trial.named != 0 for trial in trials) - len(right)
    low, high = wilson(len(right), len(trials))
    median_low, median_high = median_interval(right)
    return {
        "trials": len(trials),
        "found": None if named_is_wrong else len(right),
        "found_low": math.nan if named_is_wrong else round(low, 4),
        "found_high": math.nan if named_is_wrong else round(high, 4),
        "median_s": round(float(np.median(right)), 4) if right else math.nan,
        "median_low_s": round(median_low, 4),
        "median_high_s": round(median_high, 4),
        "p97_5_s": round(float(np.percentile(right, 97.5)), 4) if right else math.nan,
        "wrong": wrong,
    }


def _text(name: str, motor: str, row: dict[str, Any]) -> str:
    found = "-"
    if row["found"] is not None:
        found = f"{row['found']}/{row['trials']} ({row['found_low']:.0%}-{row['found_high']:.0%})"
    median, low, high, late = (1e3 * row[k] for k in ("median_s", "median_low_s", "median_high_s", "p97_5_s"))
    between = f" ({low:.0f}-{high:.0f})" if low == low else ""
    delay = f"{median:.0f}{between}" if median == median else "-"
    return ROW.format(
        name, motor, found, delay, f"{late:.0f}" if late == late else "-", f"{row['wrong']}/{row['trials']}"
    )


def _progress(what: str) -> None:
    if sys.stderr.isatty():
        print(f"\r{what:<30}\r", end="", file=sys.stderr, flush=True)
