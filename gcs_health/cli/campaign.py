"""`gcs-health campaign`: many seeds of a scenario, in parallel, to rates with intervals."""

import argparse
import json
import sys
from pathlib import Path

from gcs_health.campaign import Job, Seen, fly, rates
from gcs_health.cli import BUG, DONE
from gcs_health.cli.fleet import with_progress
from gcs_health.cli.monitoring import monitor_config
from gcs_health.engine import each
from gcs_health.errors import ConfigError
from gcs_health.record.events import plain
from gcs_health.simulate.scenario import load_scenario

SCHEMA = "gcs_health.campaign/1"


def run(options: argparse.Namespace) -> int:
    """Fly every seed; print the rates, and a line a flight where asked to."""
    load_scenario(options.scenario, options.set)  # what is wrong with it is wrong for every seed
    first, last = options.seeds
    config = monitor_config(options)
    jobs = [Job(options.scenario, tuple(options.set), seed, config) for seed in range(first, last + 1)]
    seen: list[Seen] = []
    code = DONE
    for one in with_progress(
        each(fly, jobs, workers=options.workers, scheduler=options.scheduler), len(jobs)
    ):
        if one.error:
            print(f"gcs-health: seed {one.item.seed}: {one.error}", file=sys.stderr)
            code = BUG
        else:
            seen.append(one.result)
    seen.sort()
    if options.jsonl:
        _write(options.jsonl, options.scenario, seen)
    if options.jsonl != "-":
        print(_text(options.scenario, seen))
    return code


def _text(name: str, seen: list[Seen]) -> str:
    said = rates(seen)
    lines = [f"{name}: {len(seen)} flights"]
    if said.faulty:
        low, high = said.found_interval
        share = 100 * said.found / said.faulty
        lines.append(
            f"  found      {said.found} of {said.faulty}, {share:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"
        )
        lines.append(f"  misnamed   {said.wrong}")
        lines.append(f"  delay      median {said.delay[0]:.3f} s, 90 % within {said.delay[1]:.3f} s")
    most = f"at most {said.early_most:.3g} an hour (95 %)"
    lines.append(f"  false      {said.early} in {said.hours:.2f} h without a fault; {most}")
    return "\n".join(lines)


def _write(place: str, name: str, seen: list[Seen]) -> None:
    rows = [{"schema": SCHEMA, "scenario": name}, *(plain(one._asdict()) for one in seen)]
    text = "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows)
    if place == "-":
        print(text, end="")
        return
    try:
        Path(place).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{place}: cannot write: {error.strerror}") from None
