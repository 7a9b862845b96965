"""Frequency search and calibration, written with ``numpy.linalg.lstsq`` on the equations of the model.

One frequency ``f`` (cycles per row) is shared by signals ``y(n) = trend + sum_h a cos(2 pi h f n) + b sin(2 pi h f n)``
with amplitudes of their own. Candidates come from a spectrum and from a grid of few cycles; the best is refined to the
least-squares minimum, and its standard error is the sandwich estimate from the residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_columns
from ocisac_fast.core.flags import Flag
from ocisac_fast.tones.frequency import Calibration, FoundFrequency, ToneColumns

Array = npt.NDArray[np.float64]
Model = tuple[int, list[int]]  # degree of the trend, harmonics


def _blocks(columns: npt.ArrayLike, camera: Camera) -> tuple[Array, npt.NDArray[np.int64], Array]:
    """Sums of neighbouring columns (frames, blocks, rows) without mean; block of each column; saturated share."""
    array = as_columns(columns)
    cube = array.reshape(1, -1, 1) if array.ndim == 1 else array if array.ndim == 3 else array[np.newaxis]
    if not np.all(np.isfinite(cube)):
        raise ValueError("columns: got a value that is not finite, allowed: a finite number")
    frames, _, count = cube.shape
    width = -(-count // min(max(1024 // frames, 1), 64))
    edges = np.arange(0, count, width)
    level = camera.white_level
    if level is None:
        level = float(np.iinfo(array.dtype).max) if array.dtype.kind in "ui" else np.inf
    share = np.add.reduceat((cube >= level).mean(axis=(0, 1)), edges) / np.diff(np.append(edges, count))
    sums = np.swapaxes(np.add.reduceat(cube.astype(float), edges, axis=2), 1, 2)
    centred = sums - sums.mean(axis=2, keepdims=True)
    varies = abs(centred).max(axis=2, keepdims=True) > 1e-13 * abs(sums).max(axis=2, keepdims=True)
    return np.where(varies, centred, 0.0), np.arange(count) // width, share


def _model(f: float, rows: int, most: int) -> Model:
    cycles = f * rows
    degree = 0 if cycles < 2 else 1 if cycles < 4 else 2
    harmonics = [1] + [h for h in range(2, most + 1) if h * f <= 0.5 - 0.5 / rows]
    while len(harmonics) > 1 and rows < 2 * (degree + 1 + 2 * len(harmonics)):
        harmonics.pop()
    return degree, harmonics


@dataclass
class _Fit:
    f: float
    residual: Array  # (rows, signals)
    derivative: Array  # d model / d f, less what the model can imitate
    periodic_energy: Array  # (signals,)
    harmonic_energy: Array  # (harmonics,)
    amplitudes: Array  # (signals, 2) of the first harmonic
    basis: Array

    def rss(self) -> float:
        return float((self.residual**2).sum())

    def step(self) -> float:
        information = (self.derivative**2).sum()
        return float((self.derivative * self.residual).sum() / information) if information > 0 else 0.0


def _fit(y: Array, model: Model, f: float) -> _Fit:
    rows = len(y)
    n = np.arange(rows)
    degree, harmonics = model
    trend = np.stack([np.linspace(-1, 1, rows) ** d for d in range(degree + 1)], axis=1)
    phases = [2 * np.pi * ((h * f * n) % 1) for h in harmonics]
    tones = np.stack([g(p) for p in phases for g in (np.cos, np.sin)], axis=1)
    basis = np.hstack([trend, tones])

    def rest(of: Array, on: Array) -> Array:
        return of - on @ np.linalg.lstsq(on, of, rcond=None)[0]

    coefficients = np.linalg.lstsq(basis, y, rcond=None)[0][degree + 1 :]
    residual = rest(y, basis)
    time = 2 * np.pi * (n - (rows - 1) / 2)[:, np.newaxis]
    derivative = sum(
        h * time * (np.outer(np.cos(p), coefficients[2 * i + 1]) - np.outer(np.sin(p), coefficients[2 * i]))
        for i, (h, p) in enumerate(zip(harmonics, phases, strict=True))
    )
    return _Fit(
        f,
        residual,
        rest(np.asarray(derivative), basis),
        (rest(y, trend) ** 2).sum(axis=0) - (residual**2).sum(axis=0),
        rows / 2 * (coefficients**2).reshape(len(harmonics), 2, -1).sum(axis=(1, 2)),
        coefficients[:2].T,
        basis,
    )


def _refine(y: Array, model: Model, f: float, lower: float, upper: float, max_steps: int = 30) -> _Fit:
    bin_ = 1 / len(y)
    best = _fit(y, model, float(np.clip(f, lower, upper)))
    for _ in range(max_steps):
        step = float(np.clip(best.step(), -0.25 * bin_ / model[1][-1], 0.25 * bin_ / model[1][-1]))
        following = _fit(y, model, float(np.clip(best.f + step, lower, upper)))
        while abs(step) > 1e-5 * bin_ and following.rss() > best.rss():
            step /= 4
            following = _fit(y, model, float(np.clip(best.f + step, lower, upper)))
        moved = following.f - best.f
        best = following
        if abs(moved) <= 1e-12 * bin_:
            break
    return best


def _misfit(fit: _Fit) -> float:
    rows, parameters = fit.basis.shape
    return float((rows * np.log((fit.residual**2).sum(axis=0) + 1e-12) + parameters * np.log(rows)).sum())


def _candidates(y: Array, lower: float, upper: float) -> list[float]:
    rows = len(y)
    length = _optimal_length(2 * rows)
    window = np.sin(np.pi * (np.arange(rows) + 0.5) / rows) ** 2
    power = abs(np.fft.rfft(window[:, np.newaxis] * y, length, axis=0)) ** 2
    share = 2 * power / (window.sum() * (window[:, np.newaxis] * y**2).sum(axis=0))
    f = np.arange(len(share)) / length
    votes = np.where((f >= lower) & (f <= upper), -np.log1p(-np.minimum(share, 0.9999)).sum(axis=1), 0.0)
    here, before, after = votes[1:], votes[:-1], np.append(votes[2:], 0.0)
    peaks = 1 + np.flatnonzero((here > before) & (here >= after))
    strongest = peaks[np.argsort(-votes[peaks], kind="stable")][:5]

    last = upper if (upper - lower) * rows < 4 else min(upper, 4 / rows)
    grid = np.linspace(lower, last, int(np.ceil((last - lower) * rows / 0.25)) + 1) if lower <= last else np.zeros(0)
    misfits = np.array([_misfit(_fit(y, _model(g, rows, 1), g)) for g in grid])
    left, right = np.append(np.inf, misfits[:-1]), np.append(misfits[1:], np.inf)
    return [*f[strongest], *grid[(misfits < left) & (misfits <= right)]]


def _optimal_length(n: int) -> int:
    while True:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 1


def _coarse(signals: Array, lower: float, upper: float) -> float:
    """The fundamental among the candidates; NaN where nothing varies."""
    norm = np.sqrt((signals**2).sum(axis=0))
    y = signals[:, norm > 0] / norm[norm > 0]
    best, least = np.nan, np.inf
    for candidate in _candidates(y, lower, upper) if y.size else []:
        tone = _refine(y, _model(candidate, len(y), 1), candidate, lower, upper, 2)
        fit = _refine(y, _model(tone.f, len(y), 3), tone.f, lower, upper, 2)
        empty_fundamental = fit.harmonic_energy[0] < 0.2 * fit.harmonic_energy.sum()
        if not empty_fundamental and _misfit(fit) < least:
            best, least = fit.f, _misfit(fit)
    return best


def _chance_energy(freedom: int) -> float:
    spread = 2 / (9 * freedom)
    return float(freedom * (1 - spread + 4.8 * np.sqrt(spread)) ** 3)


def _shows_tone(y: Array, f: float) -> bool:
    fit = _fit(y, _model(f, len(y), 1), f)
    rows, parameters = fit.basis.shape
    moving = fit.periodic_energy > 0
    with np.errstate(divide="ignore"):
        ratio = fit.periodic_energy[moving] / (fit.residual**2).sum(axis=0)[moving]
    return bool((rows - parameters) * np.log1p(ratio).sum() > _chance_energy(2 * y.shape[1]))


def _look(parts: Array, group: int, lower: float, upper: float) -> tuple[float, bool, bool]:
    """Coarse frequency; whether the tone stands out in the parts of the frame; whether in their sum."""
    f = _coarse(parts, lower, upper)
    if np.isnan(f) or _shows_tone(parts, f):
        return f, True, False
    if group > 1:
        sums = parts.reshape(len(parts), -1, group).sum(axis=2)
        other = _coarse(sums, lower, upper)
        if not np.isnan(other) and _shows_tone(sums, other):
            return other, False, True
    return f, False, False


def _noise_power(fit: _Fit) -> float:
    rows, parameters = fit.basis.shape
    return float(max(fit.rss(), 1e-14 * fit.periodic_energy.sum()) / ((rows - parameters) * fit.residual.shape[1]))


def _standing_out(fit: _Fit) -> npt.NDArray[np.bool_]:
    return np.asarray(fit.harmonic_energy > _chance_energy(2 * fit.residual.shape[1]) * _noise_power(fit))


def _pruned(fit: _Fit, model: Model) -> Model:
    stands = _standing_out(fit)
    return model[0], [h for h, out in zip(model[1], stands, strict=True) if h == 1 or out]


def _final(y: Array, f: float, lower: float, upper: float, waveform: str) -> tuple[_Fit, Model]:
    model = _model(f, len(y), 1)
    fit = _refine(y, model, f, lower, upper)
    if waveform == "tone":
        return fit, model
    for most in (3, 7, 15, 31):
        wider = _model(fit.f, len(y), most)
        if len(wider[1]) == len(model[1]):
            break
        before, model = model[1][-1], wider
        fit = _refine(y, model, fit.f, lower, upper)
        if waveform == "auto" and _pruned(fit, model)[1][-1] <= before:
            break
    if waveform == "auto" and len(_pruned(fit, model)[1]) < len(model[1]):
        model = _pruned(fit, model)
        fit = _refine(y, model, fit.f, lower, upper)
    return fit, model


def _combined(y: Array, group: int, model: Model, f: float) -> tuple[Array, int]:
    """One or two weighted sums a frame of signals (rows, frames * group)."""
    fit = _fit(y, model, f)
    noise = 2 / len(y) * _noise_power(fit)
    bases = []
    two = False
    for own in fit.amplitudes.reshape(-1, group, 2):
        differences = own - own.mean(axis=0)
        spread, chance = (differences**2).sum(), 2 * (group - 1) * noise
        shrunken = own.mean(axis=0) + (1 - chance / spread if spread > chance else 0.0) * differences
        weights, lengths, _ = np.linalg.svd(shrunken, full_matrices=False)
        bases.append(weights)
        two = two or (group > 1 and lengths[1] ** 2 > max(_chance_energy(group) * noise, 1e-9 * lengths[0] ** 2))
    kept = 2 if two else 1
    parts = y.reshape(len(y), -1, group)
    return np.hstack([parts[:, i] @ weights[:, :kept] for i, weights in enumerate(bases)]), kept


def _std(fit: _Fit, group: int) -> float:
    rows, parameters = fit.basis.shape
    information = (fit.derivative**2).sum()
    if rows <= parameters + 1 or not information > 0:
        return float("nan")
    q = np.linalg.qr(fit.basis)[0]
    leverage = (q**2).sum(axis=1) + (fit.derivative**2).sum(axis=1) / information
    spare = 1 / np.sqrt(np.maximum(1 - leverage, 1e-3))
    scores = (fit.residual * fit.derivative).reshape(rows, -1, group).sum(axis=2) * spare[:, np.newaxis]

    def autocovariance(lag: int) -> float:
        return float((scores[: rows - lag] * scores[lag:]).sum())

    variance = autocovariance(0)
    if variance > 0:
        rho = np.clip(autocovariance(1) / variance, -0.97, 0.97)
        lags = int(min(1.1447 * np.cbrt(4 * rho**2 / (1 - rho**2) ** 2 * rows), rows / 4))
        variance += 2 * sum((1 - lag / (lags + 1)) * autocovariance(lag) for lag in range(1, lags + 1))
    return float(np.sqrt(max(variance, 0.0)) / information)


def _tone_columns(
    fit: _Fit, blocks: Array, block_of: npt.NDArray[np.int64], saturated: Array, select: bool
) -> tuple[npt.NDArray[np.bool_], ToneColumns]:
    frames, count, _ = blocks.shape
    periodic = fit.periodic_energy.reshape(frames, count).sum(axis=0)
    residual = (fit.residual**2).sum(axis=0).reshape(frames, count).sum(axis=0)
    ratio = np.divide(periodic, residual + 1e-6 * periodic, out=np.zeros(count), where=periodic > 0)
    strength = np.divide(periodic, residual + periodic, out=np.zeros(count), where=periodic > 0)
    clear = saturated <= 0.1
    best_clear = ratio[clear].max(initial=0.0)
    eligible = clear if best_clear > 0 and best_clear >= ratio.max() / 8 else np.ones(count, bool)
    used = eligible & (ratio >= ratio[eligible].max() / 8) if select else np.ones(count, bool)
    in_columns = used[block_of]
    too_bright = (in_columns * saturated[block_of]).sum() > 0.1 * in_columns.sum()
    return used, ToneColumns(in_columns, strength[block_of], bool(too_bright))


def find_frequency(
    columns: npt.ArrayLike,
    camera: Camera,
    *,
    bounds: tuple[float, float] | None = None,
    waveform: str = "auto",
    select: bool = True,
) -> FoundFrequency:
    """The frequency of a periodic light; see :func:`ocisac_fast.find_frequency`."""
    if waveform not in ("auto", "tone", "square"):
        raise ValueError(f"waveform: got {waveform}, allowed: auto, tone or square")
    low, high = (0.0, 0.5) if bounds is None else (b * camera.row_time for b in bounds)
    if not (0 <= low < min(high, 0.5)):
        raise ValueError(f"bounds: got {bounds}, allowed: 0 <= low < high, low below half the row rate")
    blocks, block_of, saturated = _blocks(columns, camera)
    rows = blocks.shape[2]
    upper = max(min(high, 0.5 - 0.05 / rows), 0.1 / rows)
    lower = min(max(low if low > 0 else min(1 / rows, upper / 4), 0.1 / rows), upper)
    signals = blocks.reshape(-1, rows).T
    coarse, in_parts, in_sum = _look(signals, blocks.shape[1], lower, upper) if rows >= 8 else (np.nan, False, False)
    if np.isnan(coarse):
        nothing = ToneColumns(np.ones(len(block_of), bool), np.zeros(len(block_of)), False)
        return FoundFrequency(np.nan, np.nan, np.nan, np.nan, 0.0, 0, nothing, Flag.NO_TONE)

    model = _model(coarse, rows, 3)
    used, found = _tone_columns(_fit(signals, model, coarse), blocks, block_of, saturated, select and in_parts)
    parts = blocks[:, used].reshape(-1, rows).T
    group = int(used.sum())
    combined, kept = _combined(parts, group, model, coarse)
    fit, final_model = _final(combined, coarse, lower, upper, waveform)
    f, std = fit.f, _std(fit, kept)

    flags = Flag(0)
    if not (in_parts or in_sum) or not std * rows < 0.25:
        flags |= Flag.NO_TONE
    if f * rows < 2:
        flags |= Flag.FEW_CYCLES
    if f <= lower or f >= upper:
        flags |= Flag.AT_BOUND
    if found.saturated:
        flags |= Flag.SATURATED
    snr = float(fit.periodic_energy.sum() / (_noise_power(fit) * combined.size))
    row_time = camera.row_time
    return FoundFrequency(f / row_time, std / row_time, f, std, snr, final_model[1][-1], found, flags)


def calibrate(
    columns: npt.ArrayLike,
    frequency: float,
    *,
    bounds: tuple[float, float] | None = None,
    waveform: str = "auto",
    select: bool = True,
) -> Calibration:
    """Row time = cycles per row / frequency; see :func:`ocisac_fast.calibrate`."""
    if not (np.isfinite(frequency) and frequency > 0):
        raise ValueError(f"frequency: got {frequency}, allowed: a finite number above 0")
    per_row = None if bounds is None else (bounds[0] * frequency, bounds[1] * frequency)
    found = find_frequency(columns, Camera(row_time=1.0), bounds=per_row, waveform=waveform, select=select)
    return Calibration(found.frequency / frequency, found.frequency_std / frequency, found, found.flags)


def tone_columns(columns: npt.ArrayLike, camera: Camera, frequency: float | None = None) -> ToneColumns:
    """Which columns show the light; see :func:`ocisac_fast.tone_columns`."""
    if frequency is None:
        return find_frequency(columns, camera).columns
    if not (np.isfinite(frequency) and frequency > 0):
        raise ValueError(f"frequency: got {frequency}, allowed: a finite number above 0")
    blocks, block_of, saturated = _blocks(columns, camera)
    rows = blocks.shape[2]
    cycles = frequency * camera.row_time
    alias = float(np.clip(abs(cycles - np.round(cycles)), min(0.1 / rows, 0.25), 0.5 - 0.05 / rows))
    model = _model(alias, rows, 3)
    if rows <= model[0] + 1 + 2 * len(model[1]):
        return ToneColumns(np.ones(len(block_of), bool), np.zeros(len(block_of)), False)
    return _tone_columns(_fit(blocks.reshape(-1, rows).T, model, alias), blocks, block_of, saturated, True)[1]


def pick_colour(
    colours: Sequence[npt.ArrayLike],
    camera: Camera,
    *,
    bounds: tuple[float, float] | None = None,
    waveform: str = "auto",
) -> int:
    """The colour whose frequency has the smallest standard error; see :func:`ocisac_fast.pick_colour`."""
    if not colours:
        raise ValueError("colours: got 0 colours, allowed: at least one")
    found = [find_frequency(c, camera, bounds=bounds, waveform=waveform) for c in colours]
    stds = [np.inf if f.flags & Flag.NO_TONE else f.frequency_std for f in found]
    return int(np.argmin(stds))
