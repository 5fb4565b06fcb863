"""`gcs-health train`: flights whose truth is known to a model of the vehicle's vibration, for `pooled_ar`."""

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gcs_health.airframe import Airframe
from gcs_health.cli import DONE
from gcs_health.cli.recorded import recorded_flight
from gcs_health.errors import ConfigError
from gcs_health.estimators.labelled_flights import Label, LabelledFlight, flown, imu_filters, imu_rate, split
from gcs_health.estimators.pooled_ar_file import save
from gcs_health.estimators.pooled_ar_model import PooledModel
from gcs_health.estimators.pooled_ar_training import TrainingSettings, orders_for, train
from gcs_health.vehicle_file import load_vehicle

EVEN = 0.05  # by so much the rates of two flights may differ


def run(options: argparse.Namespace) -> int:
    """Read every flight and its label, train, write the model, say what it can do."""
    given = load_vehicle(options.vehicle) if options.vehicle else None
    airframe: Airframe | None = None
    rate, flights = math.nan, []
    for name in options.files:
        flight = recorded_flight(name, given or airframe, ("effectiveness",))
        airframe, readings = flight.airframe, flight.readings
        label = read_label(Path(name).with_suffix(".truth.json"), airframe)
        own = imu_rate(readings)
        if own != own:
            raise ConfigError(f"{name}: no accelerations and rates in it")
        rate = rate if rate == rate else own
        if abs(own - rate) > EVEN * rate:
            raise ConfigError(
                f"{name}: accelerations at {own:.0f} Hz, those of {options.files[0]} at {rate:.0f}"
            )
        cut = flown(readings, flight.vehicle, label, rate)
        if not cut:
            raise ConfigError(f"{name}: nothing to learn from: too short a time in the air after its label")
        flights.append((label, cut))
    assert airframe is not None
    settings = TrainingSettings(
        airframe.name, options.regime, rate, options.channels, *imu_filters(readings), orders=orders_for(rate)
    )
    model = train(*split(flights), settings, airframe)
    try:
        save(model, Path(options.output))
    except OSError as error:
        raise ConfigError(f"{options.output}: cannot write: {error.strerror}") from None
    for line in told(model, airframe, flights):
        print(line)
    entry = f'[vibration] models = ["{Path(options.output).name}"]'
    print(f"{options.output}: name it in the vehicle file that lies beside it: {entry}")
    return DONE


def read_label(path: Path, airframe: Airframe) -> Label:
    """Read what is true of a flight, in the form that `simulate` writes.

    Raises
    ------
    ConfigError : there is no such file, or it tells of something that no model is made for.
    """
    wanted = f"{path}: expected the truth of the flight: healthy, or one rotor slow from a time on"
    try:
        truth = json.loads(path.read_text(encoding="utf-8"))["truth"]
        faults: list[dict[str, Any]] = truth.get("faults", [])
        if truth["condition"] == "healthy":
            return Label(0, 0.0)
        (fault,) = faults
        motor, size, since = int(fault["rotor"]), float(fault["size"]), float(fault["vehicle_time_s"])
    except OSError as error:
        raise ConfigError(f"{wanted}; {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{wanted}; got {error}") from None
    rotors = [rotor.motor for rotor in airframe.rotors]
    if fault.get("kind") != "slow" or not 0.0 <= size < 1.0 or motor not in rotors:
        raise ConfigError(f"{wanted}; got {fault.get('kind')!r} of motor {motor}, size {size:g}")
    return Label(rotors.index(motor), round(1.0 - size, 6), since)


def told(
    model: PooledModel, airframe: Airframe, flights: Sequence[tuple[Label, Sequence[LabelledFlight]]]
) -> list[str]:
    """Return what the model can do, in sentences."""
    facts = dict(model.facts)
    healthy, slow = (
        sum(one.length for label, cut in flights if (label.k > 0.0) is kind for one in cut) / model.rate
        for kind in (False, True)
    )
    motors = ", ".join(str(airframe.rotors[rotor].motor) for rotor in model.rotors)
    orders = ", ".join(f"{part.channel} {len(part.theta)}" for part in model.of_rotor(model.rotors[0]))
    levels = ", ".join(f"{k:g}" for k in model.levels)
    lines = [
        f"{len(flights)} flights: {healthy:.0f} s healthy, {slow:.0f} s with a slow rotor (motor {motors})",
        f"levels {levels} fitted; orders {orders}",
        f"levels between, held out: mean error {facts['mean_error']:.3f} in {facts['held_out_windows']:.0f} windows "
        f"of {model.value_window:g} s; {model.names:.0%} of them told the right rotor",
        f"alarms where a loss of speed is above {model.threshold:.3f}: once in {model.alarm_every:.0f} healthy s",
    ]
    if model.healthy_time < model.alarm_every:
        lines.append(
            f"that is drawn from {model.healthy_time:.0f} s of healthy flight alone: more would make it surer"
        )
    missing = [rotor.motor for k, rotor in enumerate(airframe.rotors) if k not in model.rotors]
    if missing:
        lines.append(f"no flight degrades motor {', '.join(map(str, missing))}: the model does not know them")
    return lines
