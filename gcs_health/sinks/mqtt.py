"""Events to an MQTT broker, each as its JSON line; alerts are handed over for good before the next is sent.

TOPIC/status                                   "online", or "offline" by the broker when we are gone
TOPIC/1.1/alert                                likewise vehicle, autopilot and summary
TOPIC/1.1/motor/3/verdict                      when it changes
TOPIC/1.1/motor/3/effectiveness/effectiveness  estimator and quantity, once a second
"""

import threading
from contextlib import suppress
from typing import Any, Self
from urllib.parse import unquote, urlsplit

from gcs_health.errors import ConfigError
from gcs_health.record.events import (
    EVENT_TYPES,
    AlertEvent,
    AutopilotEvent,
    ConditionEvent,
    EstimateEvent,
    Event,
    SummaryEvent,
    VehicleEvent,
    VerdictEvent,
    to_json,
)
from gcs_health.sinks.contract import SinkError

PORT = 1883
TIMEOUT = 10.0  # s for the broker to answer
TOPIC = "gcs_health"
_LEVEL = {
    AlertEvent: "alert",
    VehicleEvent: "vehicle",
    SummaryEvent: "summary",
    AutopilotEvent: "autopilot",
    ConditionEvent: "condition",
}


class Mqtt:
    """Publishes under `topic` at a broker."""

    takes: frozenset[type] = EVENT_TYPES
    estimate_period = 1.0

    def __init__(self, host: str, port: int, topic: str, user: str | None, password: str | None) -> None:
        import paho.mqtt.client as paho

        self.name = f"mqtt://{host}:{port}/{topic}"
        self._paho: Any = paho
        self._place = (host, port)
        self._topic, self._user, self._password = topic, user, password
        self._client: Any = None

    @classmethod
    def of(cls, rest: str) -> Self:
        """See `Sink.of`."""
        try:
            url = urlsplit(f"mqtt:{rest}")
            host, port = url.hostname, url.port or PORT
        except ValueError as error:
            raise ConfigError(f"{error}") from None
        if not host or not rest.startswith("//"):
            raise ConfigError("the broker's host is missing")
        topic = url.path.strip("/") or TOPIC
        if {"+", "#", "?"} & set(rest):
            raise ConfigError("+, # and ? are no part of a topic to publish")
        user, password = (unquote(part) if part else None for part in (url.username, url.password))
        try:
            return cls(host, port, topic, user, password)
        except ModuleNotFoundError:
            raise ConfigError("needs paho-mqtt: pip install 'gcs-health[mqtt]'") from None

    def open(self) -> None:
        """See `Sink.open`."""
        answered, refused = threading.Event(), []

        def on_connect(_client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
            if reason.is_failure:
                refused.append(str(reason))
            answered.set()

        self._client = self._paho.Client(self._paho.CallbackAPIVersion.VERSION2)
        self._client.on_connect = on_connect
        if self._user is not None:
            self._client.username_pw_set(self._user, self._password)
        self._client.will_set(f"{self._topic}/status", "offline", qos=1, retain=True)
        self._client.connect(*self._place, keepalive=30)
        self._client.loop_start()
        if not answered.wait(TIMEOUT) or refused:
            raise SinkError(f"the broker says {refused[0]}" if refused else "the broker does not answer")
        self._publish("status", "online", qos=1, retain=True)

    def emit(self, event: Event) -> None:
        """See `Sink.emit`."""
        line = to_json(event, first=True)
        if isinstance(event, EstimateEvent):
            where = f"{event.vehicle}/motor/{event.motor}/{event.estimator}/{event.quantity}"
            self._publish(where, line, qos=0)
        elif isinstance(event, VerdictEvent):
            self._publish(f"{event.vehicle}/motor/{event.motor}/verdict", line, qos=1)
        else:
            self._publish(f"{event.vehicle}/{_LEVEL[type(event)]}", line, qos=1)

    def _publish(self, where: str, payload: str, *, qos: int, retain: bool = False) -> None:
        sent = self._client.publish(f"{self._topic}/{where}", payload, qos=qos, retain=retain)
        if sent.rc != self._paho.MQTT_ERR_SUCCESS:
            raise SinkError(self._paho.error_string(sent.rc))
        if qos:
            sent.wait_for_publish(TIMEOUT)
            if not sent.is_published():
                raise SinkError("the broker does not confirm")

    def close(self) -> None:
        """See `Sink.close`."""
        client, self._client = self._client, None
        if client is None:
            return
        if client.is_connected():
            with suppress(RuntimeError, ValueError):  # it is gone after all: then the broker says it for us
                client.publish(f"{self._topic}/status", "offline", qos=1, retain=True).wait_for_publish(1.0)
        client.disconnect()
        client.loop_stop()
