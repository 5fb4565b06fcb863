"""The paper's own detection, identification and quantification, as printed.

    detection        k over [0, 1] in windows of 1 s, moved by 0.1 s; fault if k / sigma_k > t_0.95   (23)-(25)
    identification   whose residuals are white: Q = N (N+2) sum r_l² / (N - l) <= chi²_0.95(20)       (26)-(28)
    quantification   k +- t_0.975 sigma_k, sigma_k the Cramér-Rao bound                               (29), (40)

Two things are read otherwise than printed, since they cannot be meant: (25) has its direction reversed, and (22)
lacks sigma² (sheet 4 section 3). The least RSS is found directly, where the paper descends to it. The printed
intervals cover 9-66 % in the sheet's measurements, and .05 a window is no alarm rate: `recommended` is for use.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from gcs_health.estimators.contract import Reason
from gcs_health.estimators.pooled_ar_model import Array, PooledModel, direction, minimise, spread
from gcs_health.estimators.pooled_ar_watch import ModelWatch, WatchConfig
from gcs_health.samples import BoomReading, ImuReading

NORMAL = NormalDist()  # some thousand degrees of freedom: t is normal


@dataclass(frozen=True, slots=True)
class PaperConfig:
    """The paper's choices."""

    detection: int = 10  # blocks of 0.1 s
    alpha: float = 0.05
    lags: int = 20
    white: float = 31.41  # chi²_0.95(20)


@dataclass(frozen=True, slots=True)
class PaperView:
    """One rotor: k and printed std of the value window, t of the detection window, Q; full = no block is missing."""

    k: float
    std: float
    t: float
    q: float
    white: bool
    full: bool


class PaperWatch:
    """One signal through the models of all rotors."""

    def __init__(self, model: PooledModel, config: PaperConfig) -> None:
        self.model, self.config = model, config
        self._watch = ModelWatch(model, WatchConfig(), config.lags)
        self._value = round(model.value_window * model.rate / model.block)
        self.views: dict[int, PaperView] = {}

    def feed(self, reading: ImuReading | BoomReading) -> bool:
        """Take one sample; return whether the answer is new."""
        if type(reading) is not self._watch.takes or not self._watch.feed(reading):
            return False
        if len(self._watch.blocks) >= self.config.detection:
            self.views = {rotor: self._view(rotor) for rotor in self.model.rotors}
        return True

    def missing(self, t: float, stale_after: float) -> tuple[Reason, ...]:
        """Return why there is no answer at time t [s]."""
        missing = self._watch.missing(t, stale_after)
        return missing or (() if self.views else (Reason.FILLING,))

    def probability(self, rotor: int) -> float:
        """Return that of a fault of this rotor: .9 at the t-test's critical point, for those with white residuals."""
        if not self.views[rotor].full:
            return 0.0
        anywhere = max(2.0 * NORMAL.cdf(view.t) - 1.0 for view in self.views.values())
        accepted = [one for one, view in self.views.items() if view.white] or list(self.views)
        return anywhere / len(accepted) if rotor in accepted else min(anywhere, 1.0 - anywhere)

    @property
    def detected(self) -> bool:
        """Whether any model's t passes the critical point."""
        return any(view.t > NORMAL.inv_cdf(1.0 - self.config.alpha) for view in self.views.values())

    def _view(self, rotor: int) -> PaperView:
        blocks = np.array([grams[rotor] for _, grams in self._watch.blocks])
        k, sigma = self._value_of(blocks[-self.config.detection :, 0])
        t = k / sigma
        k, sigma = self._value_of(blocks[:, 0])
        q = self._whiteness(blocks.sum(axis=0), k, len(blocks) * self.model.block)
        return PaperView(k, sigma, t, q, q <= self.config.white, len(blocks) >= self._value)

    def _value_of(self, blocks: Array) -> tuple[float, float]:
        k = np.clip(minimise(blocks.sum(axis=0)[None]), 0.0, 1.0)
        sure = spread(blocks[None], k, float(len(blocks) * self.model.block))
        return float(k[0]), max(math.sqrt(float(sure.crlb[0])), 1e-12)

    def _whiteness(self, lagged: Array, k: float, count: int) -> float:
        q = direction(k, lagged.shape[-1] - 1)
        r = np.einsum("i,lij,j->l", q, lagged, q)
        lag = np.arange(1, len(r))
        return float(count * (count + 2.0) * np.sum((r[1:] / max(r[0], 1e-300)) ** 2 / (count - lag)))
