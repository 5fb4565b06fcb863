"""Many seeds of a scenario to rates with intervals: what was found, how fast, what was named wrongly.

Each seed is flown and watched in a task of its own, by the same engine as a fleet's logs (`engine.each`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.simulate.detect import wilson
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.telemetry import BOOTED


@dataclass(frozen=True)
class Job:
    """One flight: a scenario by name or path, changes "key=value" to it, its seed, and who watches."""

    scenario: str
    changes: tuple[str, ...]
    seed: int
    config: MonitorConfig


class Seen(NamedTuple):
    """One flight's truth and what was said of it.

    Attributes
    ----------
    motor, at : the first fault's motor (0 = none) and vehicle time [s].
    named, code, delay : of the first alert at or after the fault, its motor (0 = none), and how long after [s].
    early : alerts before the fault, or at all in a flight without one.
    healthy : seconds flown without a fault.
    """

    seed: int
    motor: int
    at: float
    named: int
    code: str
    delay: float
    early: int
    healthy: float


class Rates(NamedTuple):
    """What the flights of a campaign say; intervals are of 95 %.

    Attributes
    ----------
    found : flights with a fault in which the right motor was named, of `faulty`; (low, high) by Wilson.
    wrong : in which another was named first.
    delay : median and 90 % quantile of those found [s]; NaN if none was.
    early : false alerts, in `hours` without a fault; `early_most` an hour at most (3 / T if there was none).
    """

    faulty: int
    found: int
    found_interval: tuple[float, float]
    wrong: int
    delay: tuple[float, float]
    early: int
    hours: float
    early_most: float


def fly(job: Job) -> Seen:
    """Fly one seed and watch it."""
    scenario = load_scenario(job.scenario, [*job.changes, f"seed={job.seed}"])
    fault = min(scenario.faults, key=lambda f: float(f.at), default=None)
    at = BOOTED + float(fault.at) if fault is not None else math.inf
    motor = scenario.vehicle.rotors[int(fault.rotor)].motor if fault is not None else 0
    monitor = Monitor(replace(job.config, stamped=True))
    raised = [
        event
        for stamp, frame in Flight(scenario).run()
        for event in monitor.feed(record(stamp, frame))
        if isinstance(event, AlertEvent) and event.state == "raised"
    ]
    early = sum(alert.t < at for alert in raised)
    first = next((alert for alert in raised if alert.t >= at), None)
    duration = scenario.trajectory.duration
    return Seen(
        job.seed,
        motor,
        at,
        (first.motor or 0) if first is not None else 0,
        first.code if first is not None else "",
        first.t - at if first is not None else math.nan,
        early,
        min(duration, at - BOOTED),
    )


def rates(flights: Sequence[Seen]) -> Rates:
    """Sum up a campaign.

    Source: Wilson (1927); for the false alerts the exact upper bound of a Poisson rate, chi² with 2 (n + 1)
    degrees of freedom (Garwood 1936), 3.0 / T for none, one-sided.
    """
    from scipy.special import gammaincinv

    faulty = [seen for seen in flights if seen.motor]
    found = [seen for seen in faulty if seen.named == seen.motor]
    delays = [seen.delay for seen in found]
    early = sum(seen.early for seen in flights)
    hours = sum(seen.healthy for seen in flights) / 3600.0
    return Rates(
        len(faulty),
        len(found),
        wilson(len(found), len(faulty)) if faulty else (math.nan, math.nan),
        sum(seen.named not in (0, seen.motor) for seen in faulty),
        (float(np.median(delays)), float(np.quantile(delays, 0.9))) if delays else (math.nan, math.nan),
        early,
        hours,
        float(gammaincinv(early + 1, 0.95)) / hours if hours > 0.0 else math.inf,
    )
