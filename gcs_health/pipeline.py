"""The whole flow in one screen: bytes → frames → samples → one VehicleMonitor per vehicle → events.

Live, replay, tests and benchmarks all call this `Monitor`. It does no I/O and reads no clock: events are
a function of configuration, bytes and stamps, whatever the chunking.
"""

import copy
import math
from collections.abc import Callable
from dataclasses import replace

from gcs_health.airframe import AirframeSource
from gcs_health.estimators.contract import Estimate
from gcs_health.mavlink.batch import FrameBatch
from gcs_health.mavlink.dialect import Dialect, default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.messages import MessageDecoder
from gcs_health.mavlink.requests import RateRequests
from gcs_health.monitor_config import MonitorConfig, Tap
from gcs_health.record.describe import describe_state
from gcs_health.record.events import Event, SummaryEvent, Value
from gcs_health.survey import Census, Survey, SystemSurvey, VehicleSurvey
from gcs_health.vehicle_monitor import VehicleMonitor

__all__ = ["Monitor", "MonitorConfig"]


class Monitor:
    """Bytes in, events out."""

    def __init__(self, config: MonitorConfig | None = None) -> None:
        self.config = config or MonitorConfig()
        self.dialect: Dialect = default_dialect()
        self._messages = MessageDecoder(self.dialect)
        self._sources: dict[str, FrameDecoder] = {}
        self._vehicles: dict[tuple[int, int], VehicleMonitor] = {}
        self._census = Census()

    def feed(
        self, data: bytes, receive_us: int = 0, source: str = "", stamped: bool | None = None
    ) -> list[Event]:
        """Take bytes of one source; return what they cause.

        Parameters
        ----------
        receive_us : arrival [UNIX µs]; a .tlog brings its own.
        source : whose byte stream this is: frames never reach across sources.
        stamped : whether this source is a .tlog; None = as the configuration says.
        """
        return self._take(self._decoder(source, stamped).feed(data, receive_us))

    def poll(self, receive_us: int) -> list[Event]:
        """Return what time alone causes."""
        return [event for vehicle in self.vehicles() for event in vehicle.poll(receive_us)]

    def finish(self) -> list[Event]:
        """End of input: return what the rest causes, and one summary a vehicle."""
        events = [event for decoder in self._sources.values() for event in self._take(decoder.finish())]
        events += [event for vehicle in self.vehicles() for event in vehicle.finish()]
        return events + [self._summary(vehicle) for vehicle in self.vehicles()]

    def copy(self) -> "Monitor":
        """Return a second monitor that goes on from here by itself; a `tap` would hear of both."""
        shared = (self.config, self.config.tap, self.dialect, self._messages)  # none of them changes
        return copy.deepcopy(self, {id(part): part for part in shared})

    def set_taps(self, tap: Tap | None, raw_tap: Callable[[FrameBatch], None] | None) -> None:
        """Let others hear from now on: a copy's own."""
        self.config = replace(self.config, tap=tap, raw_tap=raw_tap)
        for vehicle in self._vehicles.values():
            vehicle.config = self.config

    def vehicles(self) -> list[VehicleMonitor]:
        """Return the vehicles seen so far."""
        return [monitor for monitor in self._vehicles.values() if monitor.is_vehicle]

    def rates(self, system: int, component: int, now_us: int) -> dict[int, float]:
        """Return how often each message of one sender came until now [Hz], by message id."""
        return self._census.rates_until(system, component, now_us)

    def survey(self) -> Survey:
        """Return what is in the stream so far."""
        return Survey(
            *self._census.span(),
            systems=tuple(self._systems()),
            vehicles=tuple(_vehicle_survey(vehicle) for vehicle in self.vehicles()),
            counters=tuple(self._counters().items()),
        )

    def _decoder(self, source: str, stamped: bool | None) -> FrameDecoder:
        decoder = self._sources.get(source)
        if decoder is None:
            stamped = self.config.stamped if stamped is None else stamped
            decoder = FrameDecoder(self.dialect, stamped=stamped, keys=self.config.keys)
            self._sources[source] = decoder
        return decoder

    def _take(self, batch: FrameBatch) -> list[Event]:
        if not len(batch):
            return []
        if self.config.raw_tap is not None:
            self.config.raw_tap(batch)
        self._census.add(batch)
        events: list[Event] = []
        vehicles = self._vehicles
        for sample in self._messages.samples(batch):
            sender = sample[:2]  # system, component
            vehicle = vehicles.get(sender)
            if vehicle is None:
                vehicle = vehicles[sender] = VehicleMonitor(f"{sender[0]}.{sender[1]}", self.config)
            caused = vehicle.feed(sample)
            if caused:
                events += caused
        return events

    def _counters(self) -> dict[str, int]:
        """Frames and bytes, kept and dropped, over all sources."""
        total: dict[str, int] = {"bytes": 0, "frames": 0, "signed": 0, "unsigned": 0}
        for decoder in self._sources.values():
            c = decoder.counters
            parts = {"bytes": c.bytes, "frames": c.frames, "signed": c.signed, "unsigned": c.unsigned}
            parts |= dict(c.dropped)
            parts |= {"unknown_id": c.unknown.total(), "lost": c.lost.total(), "repeated": c.repeated.total()}
            for name, count in parts.items():
                total[name] = total.get(name, 0) + count
        return {name: count for name, count in total.items() if count or name in ("bytes", "frames")}

    def _systems(self) -> list[SystemSurvey]:
        lost = [decoder.counters.lost for decoder in self._sources.values()]
        return [
            self._census.system(sender, self._role(sender), sum(c[sender] for c in lost), self.dialect.name)
            for sender in self._census.senders()
        ]

    def _role(self, sender: tuple[int, int]) -> str:
        vehicle = self._vehicles.get(sender)
        if vehicle is not None and vehicle.is_vehicle:
            return "vehicle"
        return "ground station" if sender[0] >= 250 or sender[1] in (0, 190) else "other"

    def _summary(self, vehicle: VehicleMonitor) -> SummaryEvent:
        system, component = map(int, vehicle.vehicle.split("."))
        rotors: list[Value] = []
        final: dict[int, list[Estimate]] = {}
        for estimate in vehicle.estimates():
            final.setdefault(estimate.rotor, []).append(estimate)
        for k, rotor in enumerate(vehicle.airframe.rotors if vehicle.airframe and final else ()):
            rotors.append(
                {
                    "rotor": rotor.esc,
                    "motor": rotor.motor,
                    "seat": vehicle.airframe.seat(k) if vehicle.airframe else "",
                    "telemetry": vehicle.rotors.state(rotor.esc, vehicle.last_t).value,
                    "final": describe_state(final[k][0]),
                    "worst": describe_state(vehicle.worst(final[k][0])),
                    "estimates": tuple(
                        {
                            "estimator": e.estimator,
                            "quantity": e.quantity.value,
                            "final": describe_state(e),
                            "worst": describe_state(vehicle.worst(e)),
                        }
                        for e in final[k]
                    ),
                }
            )
        notes = [*vehicle.clock.quality(), vehicle.imu.describe(vehicle.autopilot), *vehicle.rotors.notes()]
        notes += vehicle.absorbed
        if vehicle.airframe is not None:
            notes += vehicle.airframe.warnings
        if vehicle.geometry.missing():
            notes.append(f"geometry parameters {vehicle.geometry.missing()}")
        if vehicle.geometry.unusable():
            notes.append(vehicle.geometry.unusable())
        elif vehicle.airframe is None:
            notes.append("the airframe is not known: nothing was estimated; give --vehicle FILE.toml")
        span = vehicle.last_t - vehicle.first_t
        return SummaryEvent(
            vehicle.last_t,
            vehicle.last_us,
            vehicle.vehicle,
            span if math.isfinite(span) else 0.0,
            {self.dialect.name(m): r for m, r in self._census.rates(system, component).items()},
            {
                "count": len(vehicle.gaps),
                "longest": max((g for _, g in vehicle.gaps), default=0.0),
                "total": sum(g for _, g in vehicle.gaps),
            },
            dict(self._counters()),
            tuple(notes),
            tuple(rotors),
            tuple(
                {"id": a.id, "code": a.code, "motor": a.motor, "t": a.t, "state": a.state, "text": a.text}
                for a in vehicle.alerts
            ),
            vehicle.condition.maintenance,
        )


def requests_to(
    requests: RateRequests, monitor: Monitor, vehicle: VehicleMonitor, now_us: int
) -> tuple[list[bytes], str]:
    """Return the frames that ask a vehicle for what comes too seldom until now, and what they ask for in words."""
    system, component = map(int, vehicle.vehicle.split("."))
    heard = monitor.rates(system, component, now_us)
    known = vehicle.airframe is not None and vehicle.airframe.source is not AirframeSource.ASSUMED
    return requests.to(system, component, vehicle.autopilot, heard, known, vehicle.uid is not None)


def _vehicle_survey(vehicle: VehicleMonitor) -> VehicleSurvey:
    return VehicleSurvey(
        vehicle=vehicle.vehicle,
        autopilot=vehicle.autopilot,
        vehicle_type=vehicle.vehicle_type,
        airframe=vehicle.airframe,
        clock=vehicle.clock.quality(),
        imu=vehicle.imu.describe(vehicle.autopilot),
        rotor_telemetry=vehicle.rotors.notes(),
        gaps=tuple(vehicle.gaps),
        needs=vehicle.needs(),
    )
