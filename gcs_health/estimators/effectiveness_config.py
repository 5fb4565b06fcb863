"""All that can be set about the effectiveness estimator; every threshold has its source."""

from dataclasses import dataclass, field
from typing import Literal

from gcs_health.calibration.control_effectiveness import EffectivenessPrior
from gcs_health.calibration.geometry_check import GeometryConfig
from gcs_health.calibration.residual_noise import NoiseConfig
from gcs_health.calibration.time_shift import ShiftConfig
from gcs_health.estimators.commanded_speeds import CommandConfig
from gcs_health.estimators.contradiction import ContradictionConfig
from gcs_health.estimators.effectiveness_paper import PaperConfig
from gcs_health.estimators.fault_bank import BankConfig
from gcs_health.estimators.hover_trim import TrimConfig
from gcs_health.estimators.motion import MotionConfig
from gcs_health.estimators.partial_loss import PartialConfig
from gcs_health.estimators.short_order import ShortOrderConfig
from gcs_health.estimators.slow_effectiveness import SlowConfig
from gcs_health.estimators.stopped_motor import StoppedConfig
from gcs_health.gate import GateConfig

Mode = Literal["paper", "recommended"]


@dataclass(frozen=True, slots=True)
class RecommendedConfig:
    """The recommended mode; sheet 1 section 7 and sheet 5 section 3 unless said otherwise."""

    tick: float = 0.008  # s
    ticks: int = 2  # successive ticks that must agree
    ticks_slow: int = 3  # with slow rotor speeds
    slow_rotor_speeds: float = 0.04  # s between them
    short_order: ShortOrderConfig = field(default_factory=ShortOrderConfig)
    slowest_tick: float = 0.053  # s; three ticks must fit into the window
    slowest_rotor_speeds: float = 0.25  # s
    shift_rotor_speeds: float = 0.03  # s; slower ones smear the shift away
    slowest_named: float = 0.6  # of hover speed; a slower rotor adds a third at most; this project
    calm: float = 2.0  # sigmas; a tick within accuses nobody and need not be judged by itself
    wait: float = 0.01  # s; rotor speeds as fast as that are waited for rather than held
    freeze: float = 0.4  # s without learning after a hypothesis exceeded half its threshold
    freeze_at_most: float = 1.0  # s on end; this project
    refine: float = 0.3  # s after a verdict in which the size of the loss is still learned; this project
    lesson: float = 0.4  # s of ticks from which is learned at once
    check_every: float = 0.5  # s between looks at gains and geometry
    strikes: int = 3  # successive looks that must contradict the geometry
    bank: BankConfig = field(default_factory=BankConfig)
    gate: GateConfig = field(default_factory=GateConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    prior: EffectivenessPrior = field(default_factory=EffectivenessPrior)
    shift: ShiftConfig = field(default_factory=ShiftConfig)
    geometry: GeometryConfig = field(default_factory=GeometryConfig)
    commands: CommandConfig = field(default_factory=CommandConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    slow: SlowConfig = field(default_factory=SlowConfig)
    partial: PartialConfig = field(default_factory=PartialConfig)


@dataclass(frozen=True, slots=True)
class EffectivenessConfig:
    """Mode and parameters of `EffectivenessEstimator`."""

    mode: Mode = "recommended"
    recommended: RecommendedConfig = field(default_factory=RecommendedConfig)
    paper: PaperConfig = field(default_factory=PaperConfig)
    stopped: StoppedConfig = field(default_factory=StoppedConfig)
    contradiction: ContradictionConfig = field(default_factory=ContradictionConfig)
    trim: TrimConfig = field(default_factory=TrimConfig)
    absent_after: float = 2.0  # s of stream after which a missing input is called absent
    stale_after: float = 1.0  # s
    flight_over_after: float = 2.0  # s with all rotors below `flight_over_speed`
    flight_over_speed: float = 0.1  # of hover speed
    late_before_restart: int = 20  # late readings on end that mean that the clock was set back
