"""All that can be set about the unbalance estimator; every threshold has its source."""

import math
from dataclasses import dataclass, field
from typing import Literal

from gcs_health.airframe import Airframe

Mode = Literal["paper", "recommended"]
NAN = math.nan


@dataclass(frozen=True, slots=True)
class PaperConfig:
    """The paper's filter, sheet 2 section 2."""

    start: float = (
        2.5e-6  # m, m_u r_u / m_b at x = 0: half the paper's damage, about the same on all its craft
    )
    start_std: float = 0.1  # [-] of each x_i; 1 settles ten times as fast (sheet 2 section 6B)
    noise: float = 1.0  # m/s², sigma_d0
    noise_std: float = 0.05  # [-] of x_{N+1}
    drift: float = 0.2 / math.sqrt(60.0)  # s^-1/2, q_Delta
    noise_drift: float = 0.05 / math.sqrt(60.0)  # s^-1/2, q_d
    extra: float = 100.0  # m^4/s^8, r_0: a variance, whatever the paper prints
    highpass: float = 1.0  # Hz
    motor_lag: float = 0.015  # s, tau_m of (23), where only commands are known
    named: float = 1.5  # times every other estimate: the damaged rotor; the bench's rule
    settle: float = 10.0  # s before anything is named


@dataclass(frozen=True, slots=True)
class Baseline:
    """What a healthy flight of the same configuration showed; NaN and empty = not known.

    Attributes
    ----------
    unbalance : (n,) m_u r_u / m_b of each rotor [m].
    level : horizontal acceleration above 35 Hz, rms, median over the flight [m/s²].
    vibration : the autopilot's own horizontal VIBRATION, median [m/s²].
    command, speed : mean in hover [-], [rad/s]: tells whether the configuration is the same.
    """

    unbalance: tuple[float, ...] = ()
    level: float = NAN
    vibration: float = NAN
    command: float = NAN
    speed: float = NAN

    @classmethod
    def of(cls, airframe: Airframe) -> "Baseline | None":
        """Return what `gcs-health calibrate` has left of the healthy vehicle; None if nothing."""
        known = airframe.baseline
        if not known.unbalance and known.vibration_level is None and known.vibration is None:
            return None
        return cls(
            known.unbalance,
            NAN if known.vibration_level is None else known.vibration_level,
            NAN if known.vibration is None else known.vibration,
            sum(known.hover_command) / len(known.hover_command) if known.hover_command else NAN,
            sum(known.hover_speed) / len(known.hover_speed) if known.hover_speed else NAN,
        )


@dataclass(frozen=True, slots=True)
class RecommendedConfig:
    """Order tracking; sheet 2 section 5 unless said otherwise."""

    lengths: tuple[float, ...] = (0.2, 0.4, 0.8)  # s, of blocks
    keep: float = 0.75  # a longer block must keep so much of a shorter one's sum of s; 0.9 in the sheet
    keep_sigmas: float = 0.5  # less so many standard deviations; this project
    most_lost: float = 1.5  # highest factor on s for what long blocks lose; this project
    windows: tuple[float, float] = (20.0, 10.0)  # s
    every: int = 2  # stretches between solutions; this project
    least: float = 4.5  # s of flight before a first answer; this project
    highpass: float = 2.0  # Hz
    highpass_filtered: float = 5.0  # Hz, behind a low-pass
    wait: float = 0.15  # s for the speeds that bracket a stretch
    widest_gap: float = 0.26  # s between the speed samples of a rotor
    flying: float = 0.5  # of the usual speed; below, a rotor's stretch is no flight
    blind: float = 0.03  # gain of the line at hover; below, not observable with this telemetry
    threshold: float = 16.0  # cost of a bounded fit
    # of the cost of "none is damaged" that the model's own error may be: another rotor must leave more; this project
    own_error: float = 0.07
    ok_below: float = 0.25  # of the damage
    damaged_above: float = 0.7  # of the damage
    sign_ratio: float = 1.5  # between the sums of s of both spin signs, to see the airframe's own right
    flip_ratio: float = 1.8  # likewise, to see them wrong; this project
    flip_after: int = 4  # successive solutions that must say so; this project
    sign_sigmas: float = 4.0  # of the largest s, to look at the sign at all; this project
    one_speed: float = 2.0  # rad/s; rotors of both spins this near tell nothing of the sign; this project
    # rad/s rms; rotors of one spin within the first, such as may both be the largest within the second, share a peak:
    abreast: tuple[float, float] = (3.2, 4.4)
    abreast_error: float = 0.5  # then this much of what shows the damage is no proof either; this project
    inseparable: float = 0.003  # smallest eigenvalue of the normalised Gram matrix
    entangled: float = 0.3  # entry of an eigenvector below it
    # without a known damage and without a baseline: an outlier among its fellows; this project
    outlier: float = 5.0  # times the next largest amplitude
    outlier_chance: float = 0.002  # that the largest of n healthy ones, Rayleigh distributed, exceeds it
    # one that was none at the flight's beginning needs to stand out less: both must go wrong at once
    early: float = 8.0  # s of flight that show the beginning
    grown: float = 4.0  # times its amplitude then
    grown_outlier: float = 3.0  # times the next largest amplitude
    least_amplitude: float = 0.3  # m/s² at hover speed; below, nobody calls it damage
    baseline_ratio: float = 2.0  # times the rotor's own baseline; this project


@dataclass(frozen=True, slots=True)
class LevelConfig:
    """The level of vibration where no rotor speed is known; sheet 5 section 5."""

    corner: float = 35.0  # Hz
    block: float = 1.0  # s
    window: int = 60  # blocks; the level of a healthy hexarotor wanders by 1.7 within a minute
    least: int = 15  # blocks
    flight: int = 600  # blocks, that a baseline is learned from
    ratio: float = 1.6  # level over the baseline's; sheet 5 has 1.8 for a statistic it does not state
    vibration_ratio: float = 3.0  # VIBRATION over the baseline's
    spread: float = 0.12  # of the logarithm of a healthy ratio, as a logistic scale; this project
    another: float = 0.1  # relative change of hover command or speed: another configuration
    correlation: float = 0.7  # of the line's frequency with a rotor's command
    lead: float = 0.2  # over the next rotor's
    least_moves: float = 0.03  # relative standard deviation of the commands
    least_command: float = 0.1  # [-]; below, no rotor flies
    motor_lag: float = 0.015  # s


@dataclass(frozen=True, slots=True)
class UnbalanceConfig:
    """Mode and parameters of `UnbalanceEstimator`.

    Attributes
    ----------
    damage : unbalance that is a damaged propeller, in the unit of the estimate (kg m where the airframe has a
        mass, else m); None = not known: then a baseline, or being an outlier, decides.
    baseline : of a healthy flight, for `Baseline`'s own estimate see `UnbalanceEstimator.baseline`.
    """

    mode: Mode = "recommended"
    damage: float | None = None
    baseline: Baseline | None = None
    recommended: RecommendedConfig = field(default_factory=RecommendedConfig)
    level: LevelConfig = field(default_factory=LevelConfig)
    paper: PaperConfig = field(default_factory=PaperConfig)
    absent_after: float = 2.0  # s of stream after which a missing input is called absent
    stale_after: float = 1.0  # s
    old_after: float = 10.0  # s after which a solution is no longer called valid
    late_before_restart: int = 20  # late readings on end that mean that the clock was set back
