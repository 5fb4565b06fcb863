"""`gcs-health config`: the rules that hold and where each comes from; thresholds from a budget of false alarms."""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import tomlkit

from gcs_health.calibration.false_alarms import Level, level
from gcs_health.calibration.healthy_levels import HealthyLevels
from gcs_health.cli import DONE
from gcs_health.cli.monitoring import config_path
from gcs_health.config import MOST_RAISE, SCHEMA, Config, load_config
from gcs_health.errors import ConfigError, LogError
from gcs_health.fusion.alert_table import CATALOGUE, OF_KIND, ROTOR_FAILED
from gcs_health.fusion.alerts import FAMILIES
from gcs_health.fusion.kinds import FAILED, Kind
from gcs_health.fusion.rules import CRITICAL
from gcs_health.fusion.verdicts import BOUND, PRIOR_ODDS, Verdict
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.vehicle_file import load_vehicle

ROW = "{:<22}{:<13}{:<10}{}"
FIT = "{:<22}{:>7}{:>10}{:>13}{:>10}   {}"


def run(options: argparse.Namespace) -> int:
    """Print the effective rules, or fit thresholds to healthy flights."""
    path = config_path(options)
    config = load_config([path] if path else [])
    if options.fit:
        _fit(options, config, path)
        return DONE
    names = tuple(options.of or ())
    budgets, values = config.budget(*names), config.book.effective(*names)
    if options.json:
        print(
            json.dumps(
                {
                    "schema": SCHEMA,
                    "file": str(path) if path else None,
                    "vehicle": list(names),
                    "budget": {b.kind: {"per_hour": b.rate, "source": b.source} for b in budgets.values()},
                    "alerts": [value._asdict() for value in values],
                }
            )
        )
        return DONE
    print(f"file: {path or 'none'}; vehicle: {', '.join(names) or 'any'}")
    for budget in budgets.values():
        print(ROW.format("budget", budget.kind, f"{budget.rate:g} /h", budget.source))
    for value in values:
        print(ROW.format(value.code, value.key, _plain(value.value), value.source))
    others = [name for name in config.vehicles() if name not in names]
    if others:
        print(f"besides, for --of {', --of '.join(others)}", file=sys.stderr)
    return DONE


def _plain(value: bool | int | float) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else f"{value:g}"


# -- thresholds from healthy flights ------------------------------------------------------------------


def _fit(options: argparse.Namespace, config: Config, path: Path | None) -> None:
    levels = HealthyLevels(tuple(frozenset(kind.value for kind in family) for family in FAMILIES))
    alarms = dict.fromkeys(CATALOGUE, 0)
    names: tuple[str, ...] = ()
    for name in options.fit:
        names = _fly(name, options, config, levels, alarms) or names
    if not names or not any(levels.blocks.values()):
        raise LogError(f"{', '.join(options.fit)}: no flight of a known airframe in it: nothing to fit to")
    budgets = config.budget(*names)
    fitted = {}
    for family in FAMILIES:
        critical = _critical(family)
        share = sum(_critical(other) is critical for other in FAMILIES)
        budget = budgets["critical" if critical else "advisory"].rate / share
        raised = sum(alarms[code] for code in _codes(family))
        blocks = levels.blocks[frozenset(kind.value for kind in family)]
        fitted[family] = level(blocks, raised, budget)
    _print_fit(names, fitted)
    if options.output:
        base = path.read_text("utf-8") if path else f'schema = "{SCHEMA}"\n'
        text = _written(base, names[-1], fitted)
        try:
            Path(options.output).write_text(text, encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{options.output}: cannot write: {error.strerror}") from None
        load_config([options.output])  # what is written can be read
        print(f"{options.output}: written for vehicle {names[-1]}")


def _fly(
    name: str, options: argparse.Namespace, config: Config, levels: HealthyLevels, alarms: dict[str, int]
) -> tuple[str, ...]:
    """Replay one healthy flight; return the vehicle's names, the weakest first."""

    def tap(vehicle: str, verdicts: list[Verdict], flies: bool) -> None:
        odds = [(frozenset(k.value for k in f), max(_log_odds(v, f) for v in verdicts)) for f in FAMILIES]
        levels.feed(verdicts[0].t, odds, flies)

    with open_log(name) as log:
        airframe = load_vehicle(options.vehicle) if options.vehicle else None
        monitor = Monitor(MonitorConfig(airframe, stamped=log.stamped, rules=config.book, verdict_tap=tap))
        for block in log.blocks():
            for event in monitor.feed(block):
                if isinstance(event, AlertEvent) and event.state in ("raised", "escalated"):
                    alarms[event.code] += event.state == "raised"
        monitor.finish()
    levels.close()
    for vehicle in monitor.vehicles():
        if vehicle.airframe is not None:
            return tuple(n for n in (vehicle.airframe.name, vehicle.vehicle, vehicle.uid) if n)
    return ()


def _log_odds(verdict: Verdict, family: frozenset[Kind]) -> float:
    weight = sum(verdict.weights[kind] for kind in family)
    return math.log(max(weight, 1e-300) / max(verdict.total - weight, 1e-300))


def _codes(family: frozenset[Kind]) -> list[str]:
    codes = [OF_KIND[kind].code for kind in family]
    return [ROTOR_FAILED.code, *sorted(codes)] if family == FAILED else codes


def _critical(family: frozenset[Kind]) -> bool:
    return any(CATALOGUE[code].severity <= CRITICAL for code in _codes(family))


def _reach(family: frozenset[Kind]) -> float:
    """Return the probability that one source can raise a family to; a threshold above it waits for a second."""
    odds = math.exp(BOUND) * sum(PRIOR_ODDS[kind] for kind in family)
    return min(odds / (1.0 + odds), MOST_RAISE)


def _raise_at(family: frozenset[Kind], found: Level) -> float:
    """Return the threshold that keeps the budget, never below the catalogue's nor above what a fault reaches."""
    least = CATALOGUE[_codes(family)[0]].raise_at
    wanted = found.high if found.high == found.high else least
    return max(least, min(wanted, _reach(family)))


def _written(base: str, vehicle: str, fitted: dict[frozenset[Kind], Level]) -> str:
    """Return the user's file with the fitted thresholds; whatever else it says is kept."""
    document: Any = tomlkit.parse(base)
    row = document
    for key in ("vehicle", vehicle, "alerts"):
        row = row.setdefault(key, tomlkit.table(is_super_table=True))
    for family, found in fitted.items():
        for code in _codes(family):
            if _raise_at(family, found) == CATALOGUE[code].raise_at and code not in row:
                continue  # as it is anyway
            settings = row.setdefault(code, tomlkit.table())
            value = tomlkit.item(round(_raise_at(family, found), 4))
            value.comment(f"{found.hours:.2f} h, {found.alarms} alarms: at most {found.most:.3g} /h")
            settings["raise_at"] = value
    return tomlkit.dumps(document)


def _print_fit(names: tuple[str, ...], fitted: dict[frozenset[Kind], Level]) -> None:
    hours = max(found.hours for found in fitted.values())
    print(f"vehicle {', '.join(names)}: {hours:.2f} h of healthy flight")
    print(FIT.format("code", "alarms", "at most", "budget", "raise_at", "95 % interval; what the hours say"))
    for family, found in fitted.items():
        code = _codes(family)[0]
        print(
            FIT.format(
                code,
                found.alarms,
                f"{found.most:.3g} /h",
                f"{found.budget:.2g} /h",
                f"{_raise_at(family, found):.4f}",
                _told(family, found),
            )
        )


def _told(family: frozenset[Kind], found: Level) -> str:
    if found.raise_at != found.raise_at:
        said = f"no tail to fit, at most {found.largest:.2g} was seen"
    else:
        said = f"{found.low:.4f} .. {found.high:.4f}"
        if found.high > _reach(family):
            said += f", but above {_reach(family):.3f} no single source would raise it: budget not kept"
    if found.extrapolated:
        said += f"; too few hours to promise it: {found.hours_needed:.0f} h without an alarm would"
    return said
