"""All that can be set about the motor observer; every threshold has its source."""

from dataclasses import dataclass, field
from typing import Literal

from gcs_health.estimators.adaptive_observer import PaperConfig
from gcs_health.estimators.current_side import SideConfig
from gcs_health.estimators.current_timing import TimingConfig
from gcs_health.estimators.drag_ratio import RatioConfig
from gcs_health.estimators.motor_identification import IdentificationConfig
from gcs_health.estimators.rotor_level import LevelConfig
from gcs_health.estimators.torque_balance import BalanceConfig
from gcs_health.estimators.undriven_motor import UndrivenConfig

Mode = Literal["paper", "recommended"]


@dataclass(frozen=True, slots=True)
class RecommendedConfig:
    """The recommended mode; sheet 3 unless said otherwise."""

    learn: float = 6.0  # s of flight after which a rotor's healthy level is kept; this project
    refine: float = 20.0  # s until which it is refined; this project
    refine_within: float = 0.06  # of its neighbours' level, as long as the ratio is so near; this project
    learn_unknown: float = 5.0  # s of flight until an unknown drag is taken as learned; this project
    drag_known: float = 0.15  # relative standard deviation of an unknown drag below which it is taken
    rows: int = 60  # intervals between two looks at the constants
    slowest: float = 0.2  # s between samples, beyond which no sudden loss is judged; sheet 5 section 6
    balance: BalanceConfig = field(default_factory=BalanceConfig)
    side: SideConfig = field(default_factory=SideConfig)
    timing: TimingConfig = field(default_factory=TimingConfig)
    identification: IdentificationConfig = field(default_factory=IdentificationConfig)
    ratio: RatioConfig = field(default_factory=RatioConfig)
    undriven: UndrivenConfig = field(default_factory=UndrivenConfig)


@dataclass(frozen=True, slots=True)
class MotorObserverConfig:
    """Mode and parameters of `MotorObserver`."""

    mode: Mode = "recommended"
    recommended: RecommendedConfig = field(default_factory=RecommendedConfig)
    paper: PaperConfig = field(default_factory=PaperConfig)
    level: LevelConfig = field(default_factory=LevelConfig)
    absent_after: float = 2.0  # s of stream after which a missing input is called absent
    stale_after: float = 1.0  # s
    stale_intervals: float = 3.0  # usual intervals, where that is longer
    late_before_restart: int = 20  # late readings on end that mean that the clock was set back
