"""Estimators: samples in, estimates out; one published method each, independent of one another.

`REGISTRY` names them without importing any; `load` imports one.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_health.airframe import Airframe
    from gcs_health.estimators.contract import Estimator

REGISTRY: dict[str, tuple[str, str]] = {
    "effectiveness": ("gcs_health.estimators.effectiveness", "EffectivenessEstimator"),
    "unbalance": ("gcs_health.estimators.unbalance", "UnbalanceEstimator"),
    "motor_observer": ("gcs_health.estimators.motor_observer", "MotorObserver"),
    "pooled_ar": ("gcs_health.estimators.pooled_ar", "PooledArEstimator"),
}


def load(name: str, airframe: "Airframe", mode: str = "recommended", **settings: object) -> "Estimator":
    """Return a new estimator by its registry name, in its "recommended" or "paper" mode.

    Further `settings` are its own.

    Raises
    ------
    KeyError : no such estimator.
    AirframeError : it cannot work on this airframe.
    """
    module, attribute = REGISTRY[name]
    kind = getattr(import_module(module), attribute)
    made: Estimator = kind(airframe, kind.Config(mode=mode, **settings))
    return made
