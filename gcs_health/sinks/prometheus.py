"""Metrics for Prometheus, on a local port: each rotor's estimates and the alerts that are open.

What a vehicle last said stays there when it falls silent: `gcs_health_vehicle_last_seconds` tells how old.
"""

import math
from typing import Any, Self

from gcs_health.errors import ConfigError
from gcs_health.record.events import AlertEvent, EstimateEvent, Event, VerdictEvent

HOST = "127.0.0.1"
ROTOR = ("vehicle", "motor", "estimator", "quantity")
VALID = "valid"


class Prometheus:
    """Serves /metrics at `host`:`port`; on this computer alone unless told otherwise."""

    takes: frozenset[type] = frozenset({EstimateEvent, VerdictEvent, AlertEvent})
    estimate_period = 0.0

    def __init__(self, host: str, port: int) -> None:
        import prometheus_client

        self.name = f"prometheus:{host}:{port}"
        self._place = (host, port)
        self._start: Any = prometheus_client.start_http_server
        self._serving: tuple[Any, Any] | None = None
        self._open: dict[str, tuple[str, str, str]] = {}
        self._registry = registry = prometheus_client.CollectorRegistry()
        gauge, counter = prometheus_client.Gauge, prometheus_client.Counter
        name = "gcs_health_rotor_"
        self._value = gauge(f"{name}value", "The estimate, in SI.", ROTOR, registry=registry)
        self._std = gauge(f"{name}std", "Its standard deviation, in SI.", ROTOR, registry=registry)
        self._probability = gauge(
            f"{name}failure_probability",
            "That the rotor has failed; NaN = unknown.",
            ROTOR,
            registry=registry,
        )
        self._valid = gauge(f"{name}valid", "1 = the estimate is valid.", ROTOR, registry=registry)
        self._verdict = gauge(
            f"{name}verdict_probability",
            "Of the likeliest kind; NaN = nothing that sees thrust spoke lately.",
            ("vehicle", "motor", "kind"),
            registry=registry,
        )
        self._kind: dict[tuple[str, str], str] = {}
        self._last = gauge(
            "gcs_health_vehicle_last_seconds",
            "UNIX time of the last datum behind what is shown.",
            ("vehicle",),
            registry=registry,
        )
        self._active = gauge(
            "gcs_health_alert_active",
            "1 = the alert is open.",
            ("vehicle", "motor", "code"),
            registry=registry,
        )
        self._raised = counter(
            "gcs_health_alerts", "Alerts raised.", ("vehicle", "motor", "code"), registry=registry
        )

    @classmethod
    def of(cls, rest: str) -> Self:
        """See `Sink.of`."""
        host, _, port = rest.rpartition(":")
        if not port.isdigit() or not 0 < int(port) < 65536:
            raise ConfigError(f"{rest!r}: no port")
        try:
            return cls(host or HOST, int(port))
        except ModuleNotFoundError:
            raise ConfigError("needs prometheus-client: pip install 'gcs-health[metrics]'") from None

    def open(self) -> None:
        """See `Sink.open`."""
        host, port = self._place
        self._serving = self._start(port, addr=host, registry=self._registry)

    def emit(self, event: Event) -> None:
        """See `Sink.emit`."""
        self._last.labels(event.vehicle).set(event.t_unix_us * 1e-6)
        if isinstance(event, EstimateEvent):
            labels = (event.vehicle, str(event.motor), event.estimator, event.quantity)
            valid = event.status == VALID
            self._value.labels(*labels).set(event.value if valid else math.nan)
            self._std.labels(*labels).set(event.std if valid else math.nan)
            self._probability.labels(*labels).set(event.failure_probability)
            self._valid.labels(*labels).set(valid)
        elif isinstance(event, VerdictEvent):
            self._judge(event)
        elif isinstance(event, AlertEvent):
            self._alert(event)

    def _judge(self, event: VerdictEvent) -> None:
        rotor = (event.vehicle, str(event.motor))
        before = self._kind.get(rotor)
        if before is not None and before != event.kind:  # one kind a rotor is shown
            self._verdict.remove(*rotor, before)
        self._kind[rotor] = event.kind
        self._verdict.labels(*rotor, event.kind).set(event.probability if event.known else math.nan)

    def _alert(self, event: AlertEvent) -> None:
        labels = (event.vehicle, str(event.motor or ""), event.code)
        before = self._open.get(event.id)
        if before is not None and before != labels:  # its kind became clear: another code
            self._active.labels(*before).set(0)
        if event.state == "raised":
            self._raised.labels(*labels).inc()
        self._active.labels(*labels).set(event.state != "cleared")
        if event.state == "cleared":
            self._open.pop(event.id, None)
        else:
            self._open[event.id] = labels

    def close(self) -> None:
        """See `Sink.close`."""
        if self._serving is not None:
            server, thread = self._serving
            self._serving = None
            server.shutdown()
            server.server_close()
            thread.join()
