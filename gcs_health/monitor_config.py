"""What the user may choose of the monitoring of vehicles."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from gcs_health.airframe import Airframe
from gcs_health.estimators import REGISTRY
from gcs_health.fusion.rules import RuleBook
from gcs_health.fusion.verdicts import Verdict
from gcs_health.mavlink.batch import FrameBatch
from gcs_health.samples import Reading

if TYPE_CHECKING:
    from gcs_health.estimators.pooled_ar_model import PooledModel

Tap = Callable[[str, Reading], None]
VerdictTap = Callable[[str, list[Verdict], bool], None]


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """What the user may choose.

    Attributes
    ----------
    airframe : from a vehicle file; None = from the stream.
    estimators : by registry name. mode : theirs, "recommended" or "paper".
    estimate_rate : at most so many estimates a second and rotor [Hz].
    keys : 32-byte signing keys.
    stamped : the bytes are a .tlog.
    raw_tap : called with all frames before they are decoded: a recorder's way in.
    tap : called with (vehicle, reading) of everything that reaches an estimator, before it does.
    rules : the user's alert rules.
    vibration_models : trained ones of the vehicle, for `pooled_ar`.
    verdict_tap : called with (vehicle, verdicts of all rotors, whether it flies) ten times a second.
    """

    airframe: Airframe | None = None
    estimators: tuple[str, ...] = tuple(REGISTRY)
    mode: str = "recommended"
    estimate_rate: float = 10.0
    keys: tuple[bytes, ...] = ()
    stamped: bool = False
    raw_tap: Callable[[FrameBatch], None] | None = None
    tap: Tap | None = None
    rules: RuleBook = field(default_factory=RuleBook)
    vibration_models: tuple["PooledModel", ...] = ()
    verdict_tap: VerdictTap | None = None

    @property
    def settings(self) -> dict[str, dict[str, Any]]:
        """What estimators are given besides their mode, by their names."""
        return {"pooled_ar": {"models": self.vibration_models}} if self.vibration_models else {}
