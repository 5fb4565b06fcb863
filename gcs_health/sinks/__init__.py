"""Where alerts go besides the screen: one file a sink, under one contract; `docs/howto/sinks.md` shows each."""

from importlib import import_module
from typing import TYPE_CHECKING

from gcs_health.errors import ConfigError

if TYPE_CHECKING:
    from gcs_health.sinks.contract import Sink

# scheme -> where its class is, and how it is spelled; nothing is loaded that is not asked for
REGISTRY = {
    "bell": ("bell:Bell", "bell"),
    "jsonl": ("json_lines:JsonLines", "jsonl:FILE"),
    "command": ("command:Command", "command:PROGRAM ARGUMENT..."),
    "syslog": ("syslog:Syslog", "syslog or syslog:HOST:PORT or syslog:/PATH"),
    "mqtt": ("mqtt:Mqtt", "mqtt://[USER[:PASSWORD]@]HOST[:PORT][/TOPIC]"),
    "prometheus": ("prometheus:Prometheus", "prometheus:PORT or prometheus:ADDRESS:PORT"),
    "apprise": ("apprise_url:AppriseUrl", "apprise:URL, any that Apprise knows"),
    "mavlink": ("mavlink_out:MavlinkOut", "mavlink:udpout://HOST:PORT (this transmits)"),
}


def parse_sink(spec: str) -> "Sink":
    """Return the sink that `--sink SPEC` names, not yet opened.

    Raises
    ------
    ConfigError : there is none of this name, or that is not how it is spelled.
    """
    scheme, _, rest = spec.partition(":")
    if scheme not in REGISTRY:
        known = ", ".join(spelled for _, spelled in REGISTRY.values())
        raise ConfigError(f"--sink {spec}: no such sink; there are {known}")
    place, spelled = REGISTRY[scheme]
    module, name = place.split(":")
    try:
        sink: Sink = getattr(import_module(f"gcs_health.sinks.{module}"), name).of(rest)
    except ConfigError as error:
        raise ConfigError(f"--sink {scheme}: {error}; expected {spelled}") from None
    return sink
