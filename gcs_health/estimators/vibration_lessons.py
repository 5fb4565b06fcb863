"""What healthy flights teach of the vibration: the trained models' alarms, and the healthy baseline."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gcs_health.airframe import Airframe
from gcs_health.calibration.findings import Finding
from gcs_health.estimators.pooled_ar_alarm import ModelHealth, without_models
from gcs_health.estimators.pooled_ar_file import load
from gcs_health.estimators.vibration_baseline import VibrationBaseline
from gcs_health.samples import Reading


class Vibration:
    """Fed whole healthy flights, one after the other.

    Parameters
    ----------
    models : files of trained ones. every : time between false alarms that are bearable [s].
    """

    def __init__(self, models: Sequence[str], every: float) -> None:
        self._every = every
        self._models = [ModelHealth(Path(name).name, load(Path(name))) for name in models]
        self._baseline = VibrationBaseline()

    def fly(self, readings: Sequence[Reading]) -> None:
        """Take one flight."""
        for model in self._models:
            model.fly(readings)
        self._baseline.fly(readings)

    def taught(self, airframe: Airframe) -> tuple[Airframe, list[Finding]]:
        """Return the airframe with what was learned, nothing of other flights left in it, and what is said."""
        said, alarms = [], []
        for model in self._models:
            level, finding = model.found(self._every)
            said.append(finding)
            if level is not None:
                alarms.append((model.name, level))
        if not self._models:
            said.append(without_models())
        healthy, finding = self._baseline.found(self._every)
        learned = replace(airframe, vibration_alarms=tuple(alarms), healthy_vibration=healthy)
        return learned, [*said, finding]
