"""One vehicle's readings out of a recorded flight: what `calibrate` and `train` learn from."""

import sys
from dataclasses import dataclass

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.errors import LogError
from gcs_health.estimators import REGISTRY
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.samples import Reading


@dataclass(frozen=True, slots=True)
class RecordedFlight:
    """Of the first vehicle in a log: whose it is, its geometry, all that its estimators took, and its alerts."""

    vehicle: str
    airframe: Airframe
    readings: list[Reading]
    alerts: list[AlertEvent]


def recorded_flight(
    name: str, given: Airframe | None, estimators: tuple[str, ...] = tuple(REGISTRY)
) -> RecordedFlight:
    """Read one flight, with the geometry `given` before its own; `estimators` are those whose alerts are wanted.

    Raises
    ------
    LogError : there is no vehicle whose geometry is known.
    """
    readings: dict[str, list[Reading]] = {}
    with open_log(name) as log:
        monitor = Monitor(
            MonitorConfig(
                airframe=given,
                estimators=estimators,
                stamped=log.stamped,
                tap=lambda vehicle, reading: readings.setdefault(vehicle, []).append(reading),
            )
        )
        for block in log.blocks():
            monitor.feed(block)
        monitor.finish()
    vehicles = [vehicle for vehicle in monitor.vehicles() if vehicle.airframe is not None]
    if not vehicles:
        raise LogError(f"{name}: no vehicle whose geometry is known; give --vehicle FILE.toml")
    if len(vehicles) > 1:
        print(f"{name}: {len(vehicles)} vehicles; taking {vehicles[0].vehicle}", file=sys.stderr)
    vehicle = vehicles[0]
    assert vehicle.airframe is not None
    if vehicle.airframe.source is AirframeSource.ASSUMED:
        raise LogError(f"{name}: the geometry is only assumed; give --vehicle FILE.toml")
    who = vehicle.uid or vehicle.vehicle
    return RecordedFlight(who, vehicle.airframe, readings.get(vehicle.vehicle, []), vehicle.alerts)
