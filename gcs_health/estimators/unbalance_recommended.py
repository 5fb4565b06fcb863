"""The recommended mode: order-tracked block powers of the last 20 and 10 s, solved anew with every stretch.

Both windows look for damage; the long one alone says "ok". Block length: the longest whose sum of s keeps
what a shorter one finds, since an error of the speeds shows as power lost in long blocks. Spin sign: solved
for the airframe's signs and for all flipped; the airframe is believed until the other sum of s is clearly
larger (an assumed geometry only once its own is), and "ok" needs both.

Source: sheet 2 section 5.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.estimators.amplitude_model import Array, ImuFilter
from gcs_health.estimators.bounded_fit import Fit, fit
from gcs_health.estimators.contract import Reason
from gcs_health.estimators.order_tracking import OrderTracker, Stretch
from gcs_health.estimators.unbalance_config import Baseline, RecommendedConfig
from gcs_health.estimators.unbalance_verdict import Finding, Verdict, judge, outlier_ratio
from gcs_health.gate import GRAVITY

NAN = math.nan
FORGET_AFTER = 60.0  # s without flight: another flight
LARGEST_SIGMAS = 3.0  # within these of the largest estimate another rotor may be the largest


@dataclass(frozen=True, slots=True)
class Answer:
    """What one solution says.

    Attributes
    ----------
    t : its end [s]. fit, verdict : of the window that decided.
    flipped : the spin signs fit better the other way round.
    leak : amplitude that the wrong direction keeps [-].
    speed : (n,) mean speeds [rad/s]. gain : (n,) of the lines.
    window, length : s, of the window and its blocks.
    together : groups of rotors that cannot be told apart; empty if all can.
    seen : (n,) smallest m_u r_u / m_b that would be seen now [m].
    largest : rotors that may be the largest: within so many standard deviations of the one that is.
    lost : factor on s that gives back what blocks so long lose of a phase that wanders [-].
    """

    t: float
    fit: Fit
    verdict: Verdict
    flipped: bool
    leak: float
    speed: Array
    gain: Array
    window: float
    length: float
    together: tuple[tuple[int, ...], ...]
    seen: Array
    largest: tuple[int, ...]
    lost: float

    def s(self) -> Array:
        """Return (n,) (m_u r_u / m_b)² [m²]."""
        return self.fit.s * self.lost

    def std(self) -> Array:
        """Return (n,) their standard deviations [m²]."""
        return self.fit.std() * self.lost


class RecommendedTracker:
    """Fed samples and speeds; `answer` is the last solution, None before any.

    Parameters
    ----------
    damage : m_u r_u / m_b that is a damaged propeller [m], None = not known.
    baseline : of a healthy flight, None = not known.

    Attributes
    ----------
    gate : why the last stretch was no flight; None if it was.
    """

    def __init__(
        self,
        airframe: Airframe,
        config: RecommendedConfig,
        damage: float | None,
        baseline: Baseline | None,
    ) -> None:
        c = self.config = config
        self.damage, self.baseline = damage, baseline
        n = len(airframe.rotors)
        spins = tuple(rotor.spin for rotor in airframe.rotors)
        self._spins = np.array(spins)
        self.tracker = OrderTracker(
            spins,
            c.lengths,
            c.highpass,
            c.highpass_filtered,
            c.wait,
            c.widest_gap,
        )
        thrust = airframe.effectiveness.thrust
        self._usual = math.sqrt(GRAVITY / (n * thrust)) if thrust else 0.0
        self._known_hover = bool(thrust)
        # a geometry that was only assumed must first be seen to be right
        self._sign_known = airframe.source is not AirframeSource.ASSUMED
        self._flipped = False
        self._against = 0  # solutions that spoke for the other sign
        self._outlier = outlier_ratio(n, c.outlier_chance, c.outlier)
        self.answer: Answer | None = None
        self.gate: Reason | None = None
        self._stretches: deque[Stretch] = deque()
        self._unsolved = 0
        self._early: Array = np.zeros(0)  # s of the rotors at the flight's beginning, at most
        self.forget()

    def imu(self, t: float, ax: float, ay: float, airborne: bool) -> bool:
        """Take a sample; return whether there is a new answer."""
        if not self.tracker.imu(t, ax, ay):
            return False
        made = self.tracker.take()
        if made is None or not airborne:
            self.gate = Reason.ON_GROUND if not airborne else Reason.RATE_TOO_LOW
            return False
        if not self._known_hover:
            self._usual = max(self._usual, float(made.speed.mean()))
        if not self._flies(made):
            self.gate = Reason.ROTORS_BELOW_HOVER
            return False
        self.gate = None
        if made.t - self._stretches[-1].t > FORGET_AFTER:
            self.forget()
            self.gate = None
        self._stretches.append(made)
        self._unsolved += 1
        if self.answer is not None and self._unsolved < self.config.every:
            return False
        self._unsolved = 0
        self.answer = self._solve(made.t)
        if self.answer is not None and len(self._early) == 0:
            flown = sum(self._flies(stretch) for stretch in self._stretches) * self.tracker.stretch
            if flown >= self.config.early:
                self._early = self.answer.fit.s + 2.0 * self.answer.fit.std()
        return self.answer is not None

    def set_filter(self, new: ImuFilter) -> None:
        """Take what is said of the filter on board."""
        if repr(new) != repr(self.tracker.filter):
            self.tracker.set_filter(new)
            self.forget()

    def forget(self) -> None:
        """Another flight: nothing of the last one counts."""
        count = math.ceil(max(self.config.windows) / self.tracker.stretch)
        # full from the start, so that the state keeps its size
        blank = [self.tracker.blank() for _ in range(count)]
        self._stretches = deque(blank, maxlen=count)
        self._unsolved = 0
        self._early = np.zeros(0)
        self.answer = None
        self.gate = Reason.SETTLING

    def _flies(self, stretch: Stretch) -> bool:
        return stretch.slowest > self.config.flying * self._usual

    def _solve(self, t: float) -> Answer | None:
        c = self.config
        flown = [stretch for stretch in self._stretches if self._flies(stretch)]
        long, short = c.windows
        flown = [stretch for stretch in flown if t - stretch.t < 2.0 * long]
        if len(flown) * self.tracker.stretch < c.least:
            return None
        k, given, lost = self._choose_length(flown)
        if given is None:
            return None
        other = _fit(flown, k, 1)
        flipped = self._learn_sign(given, other, _mean_speed(flown))
        best = other if flipped and other is not None else given
        against = given if flipped else other
        made = self._answer(t, best, against, flown, k, flipped, long, lost)
        recent = flown[-math.ceil(short / self.tracker.stretch) :]
        if len(recent) == len(flown) or made.verdict.finding is Finding.ROTOR:
            return made
        late = _fit(recent, k, int(flipped))
        if late is None or not self._suspects(late, recent):
            return made
        newer = self._answer(t, late, _fit(recent, k, int(not flipped)), recent, k, flipped, short, lost)
        return newer if newer.verdict.finding is Finding.ROTOR else made

    def _suspects(self, late: Fit, recent: list[Stretch]) -> bool:
        """Return whether damage is present: most often none is, and `judge` need not look for whose."""
        ok_below, _, _ = self._bounds(late, _mean_speed(recent))
        return late.cost(np.zeros(len(ok_below)), ok_below) > self.config.threshold

    def _learn_sign(self, given: Fit, other: Fit | None, speed: Array) -> bool:
        """Return whether the spins are the other way round: doubted only where one sign explains clearly more.

        In hover rotors of both spins may turn at one `speed` (n,) [rad/s]; either sign then finds the line, on
        another rotor, and tells nothing.
        """
        if other is not None:
            c = self.config
            present = given if given.s.sum() > other.s.sum() else other
            b = int(np.argmax(present.s))
            strong = present.s[b] > c.sign_sigmas * present.std()[b] and not self._meets_other_spin(b, speed)
            against = strong and other.s.sum() > c.flip_ratio * given.s.sum()
            self._against = self._against + 1 if against else 0
            if self._against >= c.flip_after:
                self._flipped, self._sign_known = True, True
            elif strong and given.s.sum() > c.sign_ratio * other.s.sum():
                self._flipped, self._sign_known = False, True
        return self._flipped

    def _meets_other_spin(self, rotor: int, speed: Array) -> bool:
        others = speed[self._spins != self._spins[rotor]]
        return bool(np.any(np.abs(others - speed[rotor]) < self.config.one_speed))

    def _choose_length(self, flown: list[Stretch]) -> tuple[int, Fit | None, float]:
        """Return the longest blocks that keep what shorter ones find, their fit, and the power they lose.

        Behind a low-pass only the longest find the line among the noise that folds onto it.
        """
        lengths = self.tracker.lengths
        order = sorted(range(len(lengths)), key=lambda k: lengths[k])
        if self.tracker.filter.cutoff == self.tracker.filter.cutoff:
            return order[-1], _fit(flown, order[-1], 0), 1.0
        most, chosen, best = 0.0, order[0], None
        for k in order:
            found = _fit(flown, k, 0)
            if found is None:
                continue
            total = float(found.s.sum())
            if best is None or total >= self.config.keep * most:
                chosen, best = k, found
            # noise that is not white lifts the sum of short blocks too: only a clear loss counts
            spread = math.sqrt(max(float(found.covariance.sum()), 0.0))
            most = max(most, total - self.config.keep_sigmas * spread)
        lost = most / float(best.s.sum()) if best is not None and most > 0.0 < best.s.sum() else 1.0
        return chosen, best, min(max(lost, 1.0), self.config.most_lost)

    def _answer(
        self,
        t: float,
        best: Fit,
        other: Fit | None,
        flown: list[Stretch],
        length: int,
        flipped: bool,
        window: float,
        lost: float,
    ) -> Answer:
        c = self.config
        speed = _mean_speed(flown)
        gain = np.mean([stretch.gain for stretch in flown], axis=0)
        ok_below, damaged_above, certain = self._bounds(best, speed)
        verdict = judge(best, ok_below, damaged_above, c.threshold, certain, c.own_error)
        if verdict.finding is Finding.OK and other is not None:
            against = judge(other, ok_below, damaged_above, c.threshold, certain, c.own_error)
            if against.finding is not Finding.OK:
                verdict = replace(verdict, finding=Finding.UNKNOWN)
        # the largest, not the sum: of a line that none of its rotors follows the wrong sign finds pieces on several
        if verdict.finding is Finding.ROTOR and other is not None and other.s.max() > best.s.max():
            rival = int(np.argmax(other.s))
            if rival != verdict.rotor:
                verdict = self._undecided(verdict, tuple(sorted((verdict.rotor, rival))))
        if verdict.finding is Finding.ROTOR and not self._sign_known:
            verdict = self._undecided(verdict, tuple(range(len(best.s))))
        largest = _largest(best)
        together = best.tangles(c.inseparable, c.entangled)
        groups = together
        if verdict.alone <= c.abreast_error * verdict.present:
            groups = (*together, abreast(verdict.rotor, self._spins, largest, flown, c.abreast))
        for group in groups:
            if verdict.rotor in group:
                verdict = self._undecided(verdict, group)
        leak = NAN
        if other is not None and best.s.sum() > 0.0:
            leak = math.sqrt(other.s.sum() / best.s.sum())
        seen = np.sqrt(ok_below + math.sqrt(c.threshold) * best.std())
        return Answer(
            t,
            best,
            verdict,
            flipped,
            leak,
            speed,
            gain,
            window,
            self.tracker.lengths[length],
            together,
            seen,
            largest,
            lost,
        )

    def _undecided(self, verdict: Verdict, together: tuple[int, ...]) -> Verdict:
        """Return the verdict where the largest cannot be told from others: one of them, or nothing is known."""
        if self.damage is None and self.baseline is None:
            p = tuple(
                NAN if i in together else verdict.probability[i] for i in range(len(verdict.probability))
            )
            return replace(verdict, finding=Finding.UNKNOWN, rotor=-1, probability=p)
        share = max(verdict.probability[i] for i in together) / len(together)
        p = tuple(share if i in together else q for i, q in enumerate(verdict.probability))
        return replace(verdict, finding=Finding.PRESENT, rotor=-1, probability=p)

    def _bounds(self, best: Fit, speed: Array) -> tuple[Array, Array, float]:
        """Return what is healthy and what is damage (n,), as s, and how sure an answer can be."""
        c = self.config
        n = len(best.s)
        if self.baseline is not None and len(self.baseline.unbalance) == n:
            floor = c.least_amplitude / speed**2
            healthy = np.maximum(c.baseline_ratio * np.array(self.baseline.unbalance), floor) ** 2
            return healthy, 2.0 * healthy, 1.0
        if self.damage is not None:
            full = np.full(n, self.damage * self.damage)
            return c.ok_below**2 * full, c.damaged_above**2 * full, 1.0
        b = int(np.argmax(best.s))
        others = np.delete(best.s + 2.0 * best.std(), b)
        least = float(np.max(c.least_amplitude / speed**2)) ** 2
        grown = len(self._early) == n and best.s[b] > c.grown**2 * self._early[b]
        outlier = min(self._outlier, c.grown_outlier**2) if grown else self._outlier
        healthy = np.full(n, max(outlier * float(others.max()), least))
        return healthy, 2.0 * healthy, 1.0 - c.outlier_chance


def _largest(fit: Fit) -> tuple[int, ...]:
    s, C = fit.s, fit.covariance
    b = int(np.argmax(s))
    spread = np.sqrt(np.maximum(np.diag(C) + C[b, b] - 2.0 * C[b], 0.0))
    return tuple(np.flatnonzero((s[b] - s) <= LARGEST_SIGMAS * spread).tolist())


def abreast(
    rotor: int,
    spins: NDArray[np.int_],
    largest: tuple[int, ...],
    flown: list[Stretch],
    near: tuple[float, float],
) -> tuple[int, ...]:
    """Return the rotor and those whose lines are one peak with its own; empty if there are none.

    Whose a peak is hangs on the errors of the speeds: a rotor of the same spin within the first of `near` [rad/s]
    rms, or one that may as well be the largest within the second.
    """
    if rotor < 0:
        return ()
    speeds = np.array([stretch.speed for stretch in flown])
    apart = np.sqrt(((speeds - speeds[:, rotor, None]) ** 2).mean(axis=0))
    one_peak = (apart < near[0]) & (spins == spins[rotor])
    one_peak[list(largest)] |= apart[list(largest)] < near[1]
    group = tuple(np.flatnonzero(one_peak).tolist())
    return group if len(group) > 1 else ()


def _mean_speed(flown: list[Stretch]) -> Array:
    return np.asarray(np.mean([stretch.speed for stretch in flown], axis=0))


def _fit(flown: list[Stretch], length: int, sign: int) -> Fit | None:
    """Solve a window with blocks of one length; `sign` 1 = all spins flipped."""
    seconds = [second for stretch in flown if len(second := stretch.rows[length])]
    if not seconds:
        return None
    rows = np.concatenate(seconds).astype(np.float64)
    n = rows.shape[1] - 3
    starts = [0, *accumulate([len(each) for each in seconds[:-1]])]
    return fit(rows[:, n + sign], rows[:, :n], rows[:, n + 2], starts)
