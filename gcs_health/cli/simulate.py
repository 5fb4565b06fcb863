"""`gcs-health simulate`: fly a scenario into a log, or live over a link."""

import argparse
import sys
from pathlib import Path

from gcs_health.cli import DONE, INTERRUPTED
from gcs_health.errors import ConfigError
from gcs_health.mavlink.endpoints import Links, now_us
from gcs_health.mavlink.spellings import parse_endpoint
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.scenario import Scenario, load_scenario, shipped
from gcs_health.simulate.truth import simulated

TICK = 0.004  # s between looks at the clock
LEAP = 0.1  # s of flight at most between two looks: a late flight catches up, it does not flood the receiver
BEHIND = 1.0  # s; so late, the machine cannot keep up


def run(options: argparse.Namespace) -> int:
    """List the scenarios, write a log, or fly live."""
    if options.list:
        for name, about in shipped().items():
            print(f"{name:24}{about}")
        return DONE
    if options.scenario is None:
        raise ConfigError(f"which scenario? a .toml file or one of {', '.join(shipped())}")
    if not (options.output or options.to):
        raise ConfigError("where to? -o FLIGHT.tlog writes a log, --to udpout:127.0.0.1:14550 flies live")
    flight = _begun(load_scenario(options.scenario, options.set), options.skip)
    if options.output:
        _write(flight, Path(options.output), options.signals)
    if options.to:
        try:
            return fly_live(flight, options.to, options.speed)
        except KeyboardInterrupt:
            return INTERRUPTED
    return DONE


def _begun(scenario: Scenario, skip: float) -> Flight:
    """Return the flight after its first `skip` seconds, which nobody heard."""
    if skip >= scenario.trajectory.duration:
        raise ConfigError(f"--skip {skip:g}: the flight lasts {scenario.trajectory.duration:g} s")
    flight = Flight(scenario)
    while flight.world.t < skip:
        flight.step()
        flight.arrived()
    if skip:
        flight.send_parameters()
    return flight


def _write(flight: Flight, path: Path, signals: str | None) -> None:
    try:
        with path.open("wb") as log:
            count = first = 0
            for stamp, frame in flight.run():
                first = first or stamp
                log.write(record(stamp, frame))
                count += 1
        beside = path.with_suffix(".truth.json")
        beside.write_text(simulated(flight.scenario, path.name, first), encoding="utf-8")
        if signals:
            _write_signals(flight, Path(signals))
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot write: {error.strerror}") from None
    print(f"{path}: {count} frames, {flight.world.t:.1f} s; the truth is in {beside.name}")


def _write_signals(flight: Flight, path: Path) -> None:
    """What MAVLink does not carry: the boom tips' accelerometers."""
    import numpy as np

    if not flight.boom_tips:
        raise ConfigError(
            f"--signals: {flight.scenario.vehicle.name} has no booms, there is nothing to write"
        )
    np.savez_compressed(
        path, rate=flight.scenario.physics_rate, boom_tip_acceleration=np.array(flight.boom_tips)
    )


def fly_live(flight: Flight, endpoint: str, speed: float) -> int:
    """Fly at `speed` times real time over a link, answering what is asked."""
    late = False
    with Links([parse_endpoint(endpoint)]) as links:
        started = None
        for packet in links.packets(TICK):
            now = now_us()
            if started is None:
                started = now - round(flight.world.t * 1e6 / speed)
            if packet.data:
                flight.receive(packet.data)
            due = (now - started) * 1e-6 * speed
            until = min(due, flight.world.t + LEAP)
            while flight.world.t < until and not flight.over:
                flight.step()
            for _, frame in flight.arrived():
                links.send(frame)
            if (due - flight.world.t) / speed > BEHIND and not late:
                late = True
                print(
                    f"gcs-health: this machine cannot simulate at {speed:g} times real time", file=sys.stderr
                )
            if flight.over:
                return DONE
    return DONE
