"""Rotor health from a multirotor's MAVLink.

The few names that a notebook or another program needs; each loads what it takes when first asked for, so that
`gcs-health --help` imports neither numpy nor a dialect.

    from gcs_health import replay
    flight = replay("flight.tlog")
    flight.outcome                   # "findings", "healthy", "not judged"
    flight.columns("estimates")      # {"t": array, "motor": array, ...}
    flight.frame("alerts")           # a pandas.DataFrame
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from gcs_health.flight import Flight as Flight
    from gcs_health.flight import replay as replay
    from gcs_health.pipeline import Monitor as Monitor
    from gcs_health.pipeline import MonitorConfig as MonitorConfig
    from gcs_health.vehicle_file import load_vehicle as load_vehicle

_WHERE = {
    "Flight": "flight",
    "Monitor": "pipeline",
    "MonitorConfig": "pipeline",
    "load_vehicle": "vehicle_file",
    "replay": "flight",
}

__all__ = ["Flight", "Monitor", "MonitorConfig", "__version__", "load_vehicle", "replay"]


def __getattr__(name: str) -> object:
    """Load a public name when it is first asked for (PEP 562)."""
    if name not in _WHERE:
        raise AttributeError(f"module 'gcs_health' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"gcs_health.{_WHERE[name]}"), name)


def __dir__() -> list[str]:
    """Name what can be imported from here."""
    return sorted(__all__)
