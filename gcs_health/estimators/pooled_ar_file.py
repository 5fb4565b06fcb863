"""A trained model as a file: numpy's .npz of plain arrays and one JSON text, under a version.

The one place of this family that touches a file; estimators are given models, they do not look for them.
"""

import json
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from gcs_health.errors import ConfigError
from gcs_health.estimators.pooled_ar_air import KnownAir
from gcs_health.estimators.pooled_ar_model import Part, PooledModel
from gcs_health.estimators.speed_span import SpeedFacts

SCHEMA = "gcs_health.pooled_ar/2"
ARRAYS = ("levels", "offsets", "scales")
TUPLES = ("channels", "tail")
AIR = ("levels", "mean", "covariance")
PLAIN = (
    *("vehicle", "regime", "rate", "mean_over", "cutoff", "alarm_window", "value_window", "bias"),
    *("threshold", "alarm_every", "healthy_time", "names"),
)


def save(model: PooledModel, path: Path) -> None:
    """Write a model; what `load` reads is equal to the last bit."""
    arrays = {name: getattr(model, name) for name in ARRAYS}
    for k, part in enumerate(model.parts):
        arrays[f"theta_{k}"], arrays[f"variance_{k}"] = part.theta, part.variance
    text: dict[str, Any] = {name: getattr(model, name) for name in PLAIN + TUPLES}
    text |= {"schema": SCHEMA, "parts": [[p.rotor, p.channel] for p in model.parts], "facts": model.facts}
    if model.air is not None:
        arrays |= {f"air_{name}": getattr(model.air, name) for name in AIR}
        text["air_bound"] = model.air.bound
    if model.speeds is not None:
        arrays["speeds_healthy"] = model.speeds.healthy
        text["speeds"] = {name: getattr(model.speeds, name) for name in ("between", "drift", "error")}
    with path.open("wb") as file:
        np.savez_compressed(file, text=np.array(json.dumps(text)), **arrays)


def load(path: Path) -> PooledModel:
    """Read a model.

    Raises
    ------
    ConfigError : not such a file, or of another version.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        text = json.loads(str(arrays.pop("text")))
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise ConfigError(f"{path.name}: not a trained model: {error}") from error
    if text.pop("schema", None) != SCHEMA:
        raise ConfigError(f"{path.name}: expected a model under {SCHEMA!r}: train it again")
    try:
        values: dict[str, Any] = {name: text[name] for name in PLAIN}
        values |= {name: arrays[name] for name in ARRAYS}
        values |= {name: tuple(text[name]) for name in TUPLES}
        values["facts"] = tuple((name, value) for name, value in text["facts"])
        values["parts"] = tuple(
            Part(rotor, channel, arrays[f"theta_{k}"], arrays[f"variance_{k}"])
            for k, (rotor, channel) in enumerate(text["parts"])
        )
        if "air_bound" in text:
            values["air"] = KnownAir(**{name: arrays[f"air_{name}"] for name in AIR}, bound=text["air_bound"])
        if "speeds" in text:
            values["speeds"] = SpeedFacts(healthy=arrays["speeds_healthy"], **text["speeds"])
        return PooledModel(**values)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path.name}: not a whole model: {error}") from error
