"""A trained model as a file: numpy's .npz of plain arrays and one JSON text, under a version.

The one place of this family that touches a file; estimators are given models, they do not look for them.
"""

import json
from dataclasses import fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from gcs_health.errors import ConfigError
from gcs_health.estimators.pooled_ar_model import Part, PooledModel
from gcs_health.estimators.speed_table import SpeedTable

SCHEMA = "gcs_health.pooled_ar/1"
ARRAYS = ("levels", "offsets", "scales")
TUPLES = ("channels", "tail")


def save(model: PooledModel, path: Path) -> None:
    """Write a model; what `load` reads is equal to the last bit."""
    arrays = {name: getattr(model, name) for name in ARRAYS}
    for k, part in enumerate(model.parts):
        arrays[f"theta_{k}"], arrays[f"variance_{k}"] = part.theta, part.variance
    plain = ("vehicle", "regime", "rate", "mean_over", "cutoff", "alarm_window", "value_window", "bias")
    plain += ("threshold", "alarm_every", "healthy_time", "names")
    text = {name: getattr(model, name) for name in plain + TUPLES}
    text |= {"schema": SCHEMA, "parts": [[p.rotor, p.channel] for p in model.parts], "facts": model.facts}
    if model.speeds is not None:
        for name in _table_fields("Array"):
            arrays[f"speeds_{name}"] = getattr(model.speeds, name)
        text["speeds"] = {name: getattr(model.speeds, name) for name in _table_fields("")}
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
        raise ConfigError(f"{path.name}: expected a model under {SCHEMA!r}")
    try:
        parts = tuple(
            Part(rotor, channel, arrays[f"theta_{k}"], arrays[f"variance_{k}"])
            for k, (rotor, channel) in enumerate(text.pop("parts"))
        )
        table = text.pop("speeds", None)
        if table is not None:
            table |= {name: arrays[f"speeds_{name}"] for name in _table_fields("Array")}
        facts = tuple((name, value) for name, value in text.pop("facts"))
        return PooledModel(
            parts=parts,
            speeds=SpeedTable(**table) if table else None,
            facts=facts,
            **{name: arrays[name] for name in ARRAYS},
            **{name: tuple(text.pop(name)) for name in TUPLES},
            **text,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path.name}: a model that lacks {error}") from error


def _table_fields(kind: str) -> list[str]:
    """Return the table's array fields, or all others."""
    arrays = ["levels", "deficit", "healthy"]
    return arrays if kind else [field.name for field in fields(SpeedTable) if field.name not in arrays]
