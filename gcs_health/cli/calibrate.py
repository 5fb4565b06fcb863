"""`gcs-health calibrate`: from healthy flights, the vehicle file with all that the estimators need."""

import argparse
from pathlib import Path

from gcs_health import __version__
from gcs_health.airframe import Airframe
from gcs_health.calibration.columns import columns
from gcs_health.calibration.control_gains import control_gains
from gcs_health.calibration.findings import Finding, pool
from gcs_health.calibration.hover import hover
from gcs_health.calibration.vehicle_text import vehicle_text
from gcs_health.cli import DONE
from gcs_health.cli.recorded import recorded_flight
from gcs_health.errors import ConfigError, LogError
from gcs_health.estimators.healthy_baseline import healthy_baseline
from gcs_health.estimators.vibration_lessons import Vibration
from gcs_health.samples import Reading
from gcs_health.vehicle_file import load_vehicle


def run(options: argparse.Namespace) -> int:
    """Read every flight, pool what they teach, write the file, say what was found and what was not."""
    given = load_vehicle(options.vehicle) if options.vehicle else None
    airframe, flights = None, []
    vibration = Vibration(given.vibration_models if given else (), 3600.0 / options.false_alarms)
    for name in options.files:
        flight = recorded_flight(name, given)
        seen, readings = flight.airframe, flight.readings
        if flight.alerts:
            raise LogError(f"{name}: not a healthy flight: {flight.alerts[0].text}")
        if airframe is not None and seen.rotors != airframe.rotors:
            raise LogError(f"{name}: its rotors are not those of {options.files[0]}: another vehicle")
        airframe = seen
        flights.append(_findings(Path(name).name, readings, seen))
        vibration.fly(readings)
    assert airframe is not None
    airframe, learned = vibration.taught(airframe)
    findings = [*_pooled(flights), *learned]
    names = ", ".join(Path(name).name for name in options.files)
    text = vehicle_text(airframe, findings, f"gcs-health {__version__} calibrate: {names}")
    try:
        Path(options.output).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{options.output}: cannot write: {error.strerror}") from None
    for finding in findings:
        print(_line(finding))
    for model in map(Path, airframe.vibration_models):
        if not Path(options.output).with_name(model.name).exists():
            print(f"vibration.models           copy {model} beside {options.output}")
    print(f"{options.output}: {sum(finding.found for finding in findings)} of {len(findings)} identified")
    return DONE


def _findings(name: str, readings: list[Reading], airframe: Airframe) -> list[Finding]:
    flight = columns(name, readings, len(airframe.rotors))
    learned = healthy_baseline(readings, airframe)
    return [*control_gains(flight, airframe), *hover(flight, airframe), *learned]


def _pooled(flights: list[list[Finding]]) -> list[Finding]:
    """Pool every quantity over the flights, in the order of the first that asked for it."""
    by_key: dict[tuple[str, str], list[Finding]] = {}
    for findings in flights:
        for finding in findings:
            by_key.setdefault((finding.table, finding.key), []).append(finding)
    return [pool(findings) for findings in by_key.values()]


def _line(finding: Finding) -> str:
    name = f"{finding.table}.{finding.key}"
    if not finding.found:
        return f"{name:<27}-  {finding.why}"
    values = " ".join(f"{v:.4g} ± {s:.2g}" for v, s in zip(finding.values, finding.stds, strict=True))
    return f"{name:<27}{values}  ({finding.why})"
