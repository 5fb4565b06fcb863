"""Endpoints as users write them: MAVSDK's spellings and mavutil's."""

import re
from pathlib import Path
from typing import NamedTuple

from gcs_health.errors import EndpointError

DEFAULT_PORT, DEFAULT_BAUD = 14550, 57600
_SPELLINGS = (
    "udpin://0.0.0.0:14550, udpout://HOST:PORT, tcpout://HOST:PORT, tcpin://0.0.0.0:PORT, "
    "serial:///dev/ttyUSB0:57600 or file://PATH"
)
_SCHEMES = {
    "udp": "udpin",
    "udpin": "udpin",
    "udpout": "udpout",
    "tcp": "tcpout",
    "tcpout": "tcpout",
    "tcpin": "tcpin",
    "serial": "serial",
    "file": "file",
}


class Endpoint(NamedTuple):
    """A link as asked for: `kind` is udpin, udpout, tcpout, tcpin, serial or file."""

    kind: str
    host: str  # or device, or path
    port: int  # or baud
    text: str  # as the user wrote it


def parse_endpoint(text: str) -> Endpoint:
    """Read an endpoint as MAVSDK (udpin://0.0.0.0:14550) or mavutil (udpin:0.0.0.0:14550) spells it.

    Raises
    ------
    EndpointError : names the endpoint and the spellings there are.
    """
    scheme, colon, rest = text.partition(":")
    kind = _SCHEMES.get(scheme.lower()) if colon else None
    if kind is None:
        if re.fullmatch(r"(/dev/|COM\d).*", text):
            return _serial(text, text)
        if Path(text).is_file():
            return Endpoint("file", text, 0, text)
        raise EndpointError(f"{text}: not an endpoint; expected one like {_SPELLINGS}")
    rest = rest.removeprefix("//")
    if kind == "serial":
        return _serial(rest, text)
    if kind == "file":
        return Endpoint(kind, rest, 0, text)
    match = re.fullmatch(r"(\[[0-9a-fA-F:]+\]|[^:\[\]]*)(?::(\d+))?", rest)
    if match is None or int(match[2] or DEFAULT_PORT) > 65535:
        raise EndpointError(f"{text}: expected HOST:PORT with a port up to 65535 after {scheme}")
    host = match[1].strip("[]")
    if not host and kind in ("udpout", "tcpout"):
        raise EndpointError(f"{text}: expected a host to send to, as in {kind}://192.168.1.10:14550")
    return Endpoint(kind, host or "0.0.0.0", int(match[2] or DEFAULT_PORT), text)


def _serial(rest: str, text: str) -> Endpoint:
    match = re.fullmatch(r"(.+?)(?:[:,](\d+))?", rest)
    if match is None:
        raise EndpointError(f"{text}: expected a device, as in serial:///dev/ttyUSB0:57600")
    return Endpoint("serial", match[1], int(match[2] or DEFAULT_BAUD), text)
