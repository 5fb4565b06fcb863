"""Spectrogram of the accelerations, and where the rotors' lines lie in it, folded where they alias."""

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, np.dtype[np.float64]]

GAP = 3.0  # usual steps; longer ones are gaps


class Spectrogram(NamedTuple):
    """Attributes
    ----------
    t : (n,) middle of each window [s]. frequency : (k,) [Hz].
    level : (k, n) power density of the three axes together [dB re 1 (m/s²)²/Hz]; NaN where data were missing.
    rate : of the samples [Hz].
    """

    t: Array
    frequency: Array
    level: Array
    rate: float


def spectrogram(t: Array, acceleration: Array, window: float = 1.0, most: int = 400) -> Spectrogram | None:
    """Return the spectrogram of (n, 3) accelerations; None if there is not one whole window.

    Samples are put on an even grid by the nearest neighbour: jitter of arrival is not in `t`, the vehicle's clock.
    Hann windows of `window` s, at most `most` of them.
    """
    steps = np.diff(t)
    if not len(steps) or not (step := float(np.median(steps))) > 0.0:
        return None
    size = max(round(window / step), 16)
    hop = max(size // 2, int((t[-1] - t[0]) / step - size) // most, 1)
    grid = np.arange(t[0], t[-1], step)
    if len(grid) < size:
        return None
    nearest = np.clip(np.searchsorted(t, grid - 0.5 * step), 0, len(t) - 1)
    values = acceleration[nearest]
    missing = (np.abs(t[nearest] - grid) > GAP * step) | ~np.isfinite(values).all(axis=1)
    starts = np.arange(0, len(grid) - size + 1, hop)
    hann = np.hanning(size)
    scale = 2.0 * step / np.sum(hann**2)
    level = np.full((size // 2 + 1, len(starts)), np.nan)
    for k, start in enumerate(starts):
        here = slice(start, start + size)
        if missing[here].any():
            continue
        block = values[here] - values[here].mean(axis=0)
        power = np.abs(np.fft.rfft(block * hann[:, None], axis=0)) ** 2
        level[:, k] = 10.0 * np.log10(scale * power.sum(axis=1) + 1e-12)
    return Spectrogram(
        grid[starts] + 0.5 * window, np.arange(size // 2 + 1) / (size * step), level, 1.0 / step
    )


def folded(frequency: Array, rate: float) -> Array:
    """Return where a line appears in unfiltered samples of `rate` [Hz]: its alias in 0 to rate/2."""
    place = np.mod(frequency, rate)
    return np.minimum(place, rate - place)
