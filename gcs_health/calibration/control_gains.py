"""Control effectiveness from whole healthy flights, with its uncertainty.

    a_z = -G_az sum u                       on the level, over all of the flight
    dp/dt = G_p sum l_i u_i                 from changes, frequency by frequency; likewise dq/dt with m_i
    dr/dt = G_r sum s_i u_i + (I_r/I_z) sum s_i dw_i/dt
          = (G_r + j 2 pi f (I_r/I_z) / (2 w)) sum s_i u_i      about the mean speed w

Noise in the speeds and a controller that answers disturbances make the direct regression (S_xy / S_xx) lean
low, noise in the rates makes the inverse one (S_yy / S_xy) lean high. Frequencies count by their coherence, where
both agree, and their geometric mean is taken. Below the bands aerodynamic damping and the position loop bend the
answer, above them stamps and noise do. Half the distance of the two regressions and half the scatter over
frequencies count as uncertainty, besides what a bootstrap over segments of flight shows. The ESC's time shift is
the one at which roll and pitch answer the speeds best.

Source: Strack van Schijndel et al. (2023) section III-C; sheet 1 section 6; sheet 5 section 1. Spectral estimates:
Bendat and Piersol, Random Data, chapter 6.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.calibration.columns import Array, FlightColumns
from gcs_health.calibration.findings import Finding, missing

BLOCK, SEGMENT = 0.02, 1.28  # s
MOMENT_BAND, YAW_BAND, YAW_INERTIA_BAND = (2.0, 12.0), (0.7, 4.0), (2.0, 10.0)  # Hz
SHIFTS = np.arange(-0.03, 0.0501, 0.002)  # s, tried
GAIN = 0.1  # share of what no shift leaves unexplained that the best shift must explain
LEAST_COHERENCE, LEAST_SEGMENTS = 0.3, 6
LEAST_TIME = 5.0  # s of flight
BOOTSTRAPS = 200
TABLE = "effectiveness"
KEYS = ("thrust", "roll", "pitch", "yaw", "yaw_inertia")


def control_gains(flight: FlightColumns, airframe: Airframe) -> list[Finding]:
    """Identify thrust, roll, pitch, yaw, yaw_inertia and the ESC's time shift from one flight."""
    if not flight.has_speeds:
        return [missing(TABLE, key, "no rotor speeds") for key in KEYS]
    if not len(flight.imu):
        return [missing(TABLE, key, "no accelerations and rates") for key in KEYS]
    found = [_thrust(flight)]
    blocks = _Blocks(flight, 0.0)
    if blocks.time < LEAST_TIME:
        why = f"only {blocks.time:.1f} s of flight with rotor speeds"
        return found + [missing(TABLE, key, why) for key in KEYS[1:]]
    shift, told = _shift(flight, airframe, blocks)
    if shift:
        blocks = _Blocks(flight, shift)
    roll, pitch, spin = _arms(airframe)
    found.append(_moment("roll", blocks, roll, 0))
    found.append(_moment("pitch", blocks, pitch, 1))
    found += _yaw(blocks, spin) if spin.all() else [missing(TABLE, key, "spin unknown") for key in KEYS[3:]]
    return [*found, told]


class _Blocks:
    """Means over 20 ms of squared speeds, and the angular accelerations over the same times."""

    def __init__(self, flight: FlightColumns, shift: float) -> None:
        t = flight.imu_t
        usual = float(np.median(np.diff(t))) if len(t) > 1 else math.inf
        size = max(1, round(BLOCK / usual))
        count = (len(t) - 1) // size
        edges = np.arange(count + 1) * size
        span = t[edges[1:]] - t[edges[:-1]]
        squares = flight.squares_at(t - shift)
        middle = 0.5 * (t[edges[1:]] + t[edges[:-1]])
        # the mean of u over the interval that the rates' difference spans
        area = np.concatenate(
            [np.zeros((1, flight.rotors)), 0.5 * (squares[1:] + squares[:-1]) * np.diff(t)[:, None]]
        )
        total = np.cumsum(np.nan_to_num(area), axis=0)
        self.squares = (total[edges[1:]] - total[edges[:-1]]) / span[:, None]
        self.turn = np.diff(flight.imu[edges, 3:6], axis=0) / span[:, None]
        broken = np.concatenate([[0], np.cumsum(~np.isfinite(area).all(axis=1))])
        known = flight.flying(middle) & (span < 2.5 * size * usual)
        known &= (broken[edges[1:] + 1] == broken[edges[:-1] + 1]) & np.isfinite(self.turn).all(axis=1)
        self.step = size * usual
        self.time = float(span[known].sum())
        length = round(SEGMENT / self.step)
        whole = np.convolve(known, np.ones(length, int), "valid") == length if count >= length else known[:0]
        starts, at = [], -length
        for k in np.flatnonzero(whole):
            if k - at >= length // 2:
                starts.append(at := int(k))
        self._rows = np.array(starts, int)[:, None] + np.arange(length)
        self.speed = math.sqrt(float(self.squares[known].mean())) if known.any() else math.nan

    def spectra(self, weights: Array, axis: int, band: tuple[float, float]) -> tuple[Array, Array]:
        """Return frequencies (f,) [Hz] and S_xx, Re S_xy, Im S_xy, S_yy of every segment (segments, f, 4)."""
        x, y = (self.squares @ weights)[self._rows], self.turn[:, axis][self._rows]
        length = self._rows.shape[1]
        window = np.hanning(length)
        X, Y = (np.fft.rfft((v - v.mean(axis=1, keepdims=True)) * window) for v in (x, y))
        cross = np.conj(X) * Y
        frequency = np.asarray(np.fft.rfftfreq(length, self.step), dtype=np.float64)
        kept = (frequency >= band[0]) & (frequency <= band[1])
        parts = [np.abs(X) ** 2, cross.real, cross.imag, np.abs(Y) ** 2]
        return frequency[kept], np.stack(parts, axis=-1)[:, kept]


def _arms(airframe: Airframe) -> tuple[Array, Array, Array]:
    """Return the signed, normalised arms of roll and pitch, and the spins."""
    x = np.array([rotor.position[0] for rotor in airframe.rotors])
    y = np.array([rotor.position[1] for rotor in airframe.rotors])
    return -y / abs(y).max(), x / abs(x).max(), np.array([rotor.spin for rotor in airframe.rotors], float)


def _thrust(flight: FlightColumns) -> Finding:
    t = flight.imu_t
    total = flight.squares_at(t).sum(axis=1)
    az = flight.imu[:, 2]
    known = flight.flying(t) & np.isfinite(total) & np.isfinite(az)
    if known.sum() < 2 or t[known][-1] - t[known][0] < LEAST_TIME:
        return missing(TABLE, "thrust", "less than 5 s of flight")
    rows = np.stack([-az[known] * total[known], total[known] ** 2], axis=1)
    _, second = np.unique(np.floor(t[known]), return_inverse=True)
    sums = np.zeros((int(second.max()) + 1, 2))
    np.add.at(sums, second, rows)
    value, std = _bootstrap(sums, lambda s: float(s[0] / s[1]))
    hover = math.sqrt(9.80665 / (flight.rotors * value))
    return Finding(TABLE, "thrust", (value,), (std,), f"hover at {hover:.0f} rad/s")


def _shift(flight: FlightColumns, airframe: Airframe, blocks: _Blocks) -> tuple[float, Finding]:
    """Return the time to add to rotor stamps [s] and the finding of it."""
    roll, pitch, _ = _arms(airframe)

    def fit(at: _Blocks) -> float:
        return (_r2(at, roll, 0) + _r2(at, pitch, 1)) / 2

    zero = fit(blocks)
    fits = np.array([fit(_Blocks(flight, float(shift))) for shift in SHIFTS])
    best = int(fits.argmax())
    if fits[best] < 0.2 or 1.0 - fits[best] > (1.0 - GAIN) * (1.0 - zero):
        if zero < 0.2:
            return 0.0, missing("telemetry", "rotor_delay", f"too little excitation (R² {zero:.2f})")
        why = f"no shift answers clearly better than none (R² {zero:.2f})"
        return 0.0, Finding("telemetry", "rotor_delay", (0.0,), (0.004,), why)
    shift = float(SHIFTS[best])
    why = f"R² {zero:.2f} without, {fits[best]:.2f} with"
    return shift, Finding("telemetry", "rotor_delay", (shift,), (0.002,), why)


def _r2(blocks: _Blocks, weights: Array, axis: int) -> float:
    """Share of the angular acceleration that the speeds explain within the band."""
    _, spectra = blocks.spectra(weights, axis, MOMENT_BAND)
    if not spectra.size:
        return 0.0
    xx, xy, _, yy = spectra.sum(axis=(0, 1))
    return float(xy * xy / (xx * yy)) if xx > 0.0 and yy > 0.0 and xy > 0.0 else 0.0


class _Transfer(NamedTuple):
    """Answer per frequency (f,), between direct and inverse regression; weights = coherence / (1 - coherence)."""

    real: Array
    imaginary: Array
    coherence: Array
    weights: Array


def _transfer(segments: int, spectra: Array) -> _Transfer:
    """Return the answer from summed spectra (f, 4) of so many segments."""
    xx, re, im, yy = np.moveaxis(spectra, -1, 0)
    coherence = (re**2 + im**2) / np.maximum(xx * yy, 1e-300)
    coherence = np.clip((segments * coherence - 1.0) / max(segments - 1, 1), 1e-6, 0.995)  # its own bias off
    raised = 1.0 / (xx * np.sqrt(coherence))
    return _Transfer(re * raised, im * raised, coherence, coherence / (1.0 - coherence))


def _moment(key: str, blocks: _Blocks, arms: Array, axis: int) -> Finding:
    _, spectra = blocks.spectra(arms, axis, MOMENT_BAND)
    return _finding(key, blocks, spectra, lambda answer: answer.real)


def _yaw(blocks: _Blocks, spin: Array) -> list[Finding]:
    """Find both yaw gains: the real part, and the slope of the imaginary part over frequency."""
    _, low = blocks.spectra(spin, 2, YAW_BAND)
    frequency, high = blocks.spectra(spin, 2, YAW_INERTIA_BAND)
    per_hertz = blocks.speed / math.pi / frequency
    return [
        _finding("yaw", blocks, low, lambda answer: answer.real),
        _finding("yaw_inertia", blocks, high, lambda answer: answer.imaginary * per_hertz),
    ]


def _finding(key: str, blocks: _Blocks, spectra: Array, part: Callable[[_Transfer], Array]) -> Finding:
    segments = len(spectra)
    if segments < LEAST_SEGMENTS:
        return missing(TABLE, key, f"only {segments} unbroken stretches of {SEGMENT:g} s")
    whole = _transfer(segments, spectra.sum(axis=0))
    coherence = _mean(whole.weights, whole.coherence)
    if coherence < LEAST_COHERENCE:
        return missing(TABLE, key, f"the flight excites it too little (coherence {coherence:.2f})")

    def gain(sums: Array) -> float:
        answer = _transfer(segments, sums)
        return _mean(answer.weights, part(answer))

    value, chance = _bootstrap(spectra, gain)
    scatter = math.sqrt(_mean(whole.weights, (part(whole) - value) ** 2))
    gap = -0.5 * math.log(coherence)  # from the geometric mean to either regression, in logarithms
    std = math.hypot(chance, value * gap / math.sqrt(3.0), 0.5 * scatter)
    if value < 2.0 * std:
        return missing(TABLE, key, f"{value:.2g} ± {std:.1g}: not told from nothing")
    why = f"coherence {coherence:.2f} over {blocks.time:.0f} s"
    return Finding(TABLE, key, (value,), (std,), why)


def _mean(weights: Array, values: Array) -> float:
    return float((weights * values).sum() / weights.sum())


def _bootstrap(sums: Array, of: Callable[[Array], float]) -> tuple[float, float]:
    """Return a statistic of the summed parts (parts, ...) and its spread, drawing parts with replacement."""
    rng = np.random.default_rng(0)
    drawn = [of(sums[rng.integers(len(sums), size=len(sums))].sum(axis=0)) for _ in range(BOOTSTRAPS)]
    return of(sums.sum(axis=0)), float(np.std(drawn))
