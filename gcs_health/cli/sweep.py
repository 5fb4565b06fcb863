"""`gcs-health replay --sweep`: which of a flight's verdicts hold under other circumstances."""

import argparse
import json
import sys
from contextlib import ExitStack
from typing import TextIO

from gcs_health.cli import ALERT, BAD_INPUT, DONE
from gcs_health.cli.monitoring import monitor_config
from gcs_health.errors import ConfigError, GcsHealthError
from gcs_health.record.events import plain
from gcs_health.sweep import RECORDED, Variant, findings, sweep


def run(options: argparse.Namespace) -> int:
    """Sweep every file; an unreadable one is told and the rest still done."""
    code, held = DONE, False
    with ExitStack() as stack:
        lines = _lines(options.jsonl, stack)
        for name in options.files:
            try:
                swept = sweep(name, monitor_config(options))
            except GcsHealthError as error:
                print(f"gcs-health: {error}", file=sys.stderr)
                code = BAD_INPUT
                continue
            if lines is not None:
                lines.writelines(_line(name, variant) for variant in swept)
            if lines is not sys.stdout:
                print(sweep_text(name, swept))
            held |= any(count == len(swept) for _, count, _, _ in findings(swept))
    return ALERT if code == DONE and options.fail_on_alert and held else code


def _lines(jsonl: str | None, stack: ExitStack) -> TextIO | None:
    if jsonl is None or jsonl == "-":
        return sys.stdout if jsonl else None
    try:
        return stack.enter_context(open(jsonl, "w", encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{jsonl}: cannot write: {error.strerror}") from None


def _line(name: str, variant: Variant) -> str:
    row = {"log": name, "variant": variant.name, "outcome": variant.outcome, "error": variant.error}
    return json.dumps(row | {"alerts": [plain(h._asdict()) for h in variant.heard]}, allow_nan=False) + "\n"


def sweep_text(name: str, swept: list[Variant]) -> str:
    """Render a sweep: each finding, in how many variants, and where it is missing."""
    total = len(swept)
    recorded = {heard[:3] for heard in swept[0].heard}
    lines = [f"{name}: {total} replays, outcome as recorded: {swept[0].outcome or swept[0].error}"]
    found = findings(swept)
    for heard, count, first, last in found:
        word = "holds" if count == total else "luck" if count <= total / 2 else "wavers"
        where = "" if heard[:3] in recorded else ", not in the recording itself"
        whose = f"motor {heard.motor}" if heard.motor else "no motor in particular"
        lines.append(
            f"  {word:<8}{heard.code} of {whose} ({heard.vehicle}): in {count} of {total}, "
            f"at {first:.2f} to {last:.2f} s{where}"
        )
        missing = [v.name for v in swept if heard[:3] not in {h[:3] for h in v.heard}]
        lines += [f"            not with: {name}" for name in missing[:8]]
        if len(missing) > 8:
            lines.append(f"            and {len(missing) - 8} more")
    if not found:
        lines.append("  no alert in any of them")
    outcomes = [f"{sum(v.outcome == o for v in swept)} {o}" for o in sorted({v.outcome for v in swept}) if o]
    lines.append(f"  outcomes: {', '.join(outcomes)}")
    lines += [f"  {v.name}: {v.error}" for v in swept if v.error]
    assert swept[0].name == RECORDED
    return "\n".join(lines)
