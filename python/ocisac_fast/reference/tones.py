"""Gains of constant and varying tones, and the equaliser, column by column from their equations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.flags import Flag
from ocisac_fast.reference.camera import linear_light, saturation_level
from ocisac_fast.tones.gain import ToneGain
from ocisac_fast.tones.varying_tone import VaryingToneGain


def tone_gain(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: npt.ArrayLike,
    method: Literal["fit", "dft"] = "fit",
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    background: npt.ArrayLike = 0.0,
    *,
    pooled: bool = False,
) -> ToneGain:
    """As :func:`ocisac_fast.tone_gain`: ``numpy.linalg.lstsq`` on the design matrix, ``numpy.fft.rfft`` for the DFT.

    Flags, such as those of multiples of half the row rate and of few cycles, are equal, except QUANTISED and that of
    pooled columns that cancel, which are missing. So are harmonics above half the row rate, which a square wave is
    fitted with where it is the only tone: they are tested by their truth.
    """
    stored = np.asarray(columns)
    light = linear_light(stored, camera)
    shape = light.shape
    light = light.reshape((1, -1, 1) if light.ndim == 1 else (-1, *shape[-2:]))
    at_the_top = np.asarray(stored >= saturation_level(stored, camera))
    saturated = np.asarray(at_the_top.reshape(light.shape).any(axis=1))
    ambient = np.broadcast_to(np.asarray(background, dtype=np.float64), (light.shape[0], light.shape[2]))
    if pooled:
        light, ambient, saturated = _pool(light, ambient, saturated)
    tones = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    estimate = _dft if method == "dft" else _fit
    ratio = 1.0 if waveform == "tone" else 2 * np.sinc(duty)
    harmonics_of = (lambda _: [1]) if waveform == "tone" else _square_harmonics(duty)
    results = []
    for frame, b, s in zip(light, ambient, saturated, strict=True):
        fits = zip(tones, estimate(frame, tones * camera.row_period, harmonics_of), strict=True)
        gains = [_gain(parts, flags, f, camera, ratio, b, s) for f, (parts, flags) in fits]
        results.append([np.stack(values) for values in zip(*gains, strict=True)])
    arrays = [np.stack(values, axis=1) for values in zip(*results, strict=True)]  # (tones, frames, columns)
    if camera.exposure is not None:  # more than a light of full depth has
        full_depth = np.abs(np.sinc(tones * camera.exposure))[:, np.newaxis, np.newaxis]
        with np.errstate(invalid="ignore"):
            arrays[-1][arrays[0] - 4.0 * arrays[1] > full_depth + 0.01] |= np.uint32(Flag.MODEL_MISFIT)
    out_shape = np.shape(frequency) + shape[:-2] + (() if pooled else shape[-1:] * (len(shape) > 1))
    return ToneGain(*(values.reshape(out_shape) for values in arrays))


def _pool(
    light: Float64s, ambient: Float64s, saturated: npt.NDArray[np.bool_]
) -> tuple[Float64s, Float64s, npt.NDArray[np.bool_]]:
    """Combine the columns of each frame, weighted by brightness, without saturated ones if others remain."""
    weights = np.maximum(light.mean(axis=1) - ambient, 0.0)
    dark = np.flatnonzero(~weights.any(axis=1))
    weights[dark] = (ambient == ambient.min(axis=1, keepdims=True))[dark]
    clean = np.where(saturated, 0.0, weights)
    only_saturated = np.asarray(~np.asarray(clean.any(axis=1)))
    weights = np.where(only_saturated[:, None], weights, clean)
    weights = weights / weights.sum(axis=1, keepdims=True)
    column = np.einsum("jnc,jc->jn", light, weights)[:, :, None]
    return column, (weights * ambient).sum(axis=1, keepdims=True), only_saturated[:, None]


def _square_harmonics(duty: float) -> Any:
    def harmonics(cycles_per_row: float) -> list[int]:
        above = range(2, int(0.5 / cycles_per_row) + 2)
        return [1, *(h for h in above if h * cycles_per_row < 0.5 and abs(np.sinc(h * duty)) > 1e-9)]

    return harmonics


def _phase(cycles_per_row: float, rows: npt.ArrayLike) -> Float64s:
    """2 pi cycles_per_row row, with whole cycles subtracted in extended precision."""
    cycles = np.longdouble(cycles_per_row) * np.asarray(rows, dtype=np.longdouble)
    return np.asarray(2 * np.pi * (cycles - np.rint(cycles)).astype(np.float64))


def _at_half_row_rate(c: float) -> bool:
    """True at a multiple of half the row rate, to the rounding of f T_r."""
    return bool(abs(2 * c - np.rint(2 * c)) <= 8 * np.finfo(float).eps * c)


def _fit(frame: Float64s, cycles: Float64s, harmonics_of: Any) -> Any:
    """For each tone: (mean, a, b, noise variance, unit covariance of them), with y = mean + a cos + b sin at row 0."""
    rows = frame.shape[0]
    flags = [Flag(0)] * len(cycles)
    fundamentals, harmonics = [], []
    for k, c in enumerate(cycles):
        if c * rows < 1:
            flags[k] |= Flag.FEW_CYCLES
        if c > 0.5:
            flags[k] |= Flag.ALIASED
        if _at_half_row_rate(c) or rows <= 1 + 2 * len(cycles):
            flags[k] |= Flag.UNRESOLVABLE
            continue
        fundamentals.append((k, c))
        harmonics += [(k, h * c) for h in harmonics_of(c) if h > 1]
    used = list(fundamentals)
    for k, c in sorted(harmonics, key=lambda pair: pair[1]):
        taken = any(abs(c - other) < 0.25 / rows for _, other in used)
        if taken or 2 * (2 * len(used) + 3) > rows + 2 or _at_half_row_rate(c):
            flags[k] |= Flag.HARMONICS_DROPPED
        else:
            used.append((k, c))
    design = np.ones((rows, 1 + 2 * len(used)))
    for j, (_, c) in enumerate(used):
        phase = _phase(c, np.arange(rows))
        design[:, 1 + 2 * j], design[:, 2 + 2 * j] = np.cos(phase), np.sin(phase)
    solution, _, rank, singular = np.linalg.lstsq(design, frame, rcond=None)
    freedom = rows - rank
    with np.errstate(divide="ignore", invalid="ignore"):
        noise = ((frame - design @ solution) ** 2).sum(axis=0) / freedom
    inverse = np.linalg.pinv(design)
    covariance = inverse @ inverse.T
    for k in range(len(cycles)):
        position = [j for j, (tone, _) in enumerate(fundamentals) if tone == k]
        pick = [0, 1 + 2 * position[0], 2 + 2 * position[0]] if position else [0, 0, 0]
        if singular[0] > 1e6 * singular[-1]:
            flags[k] |= Flag.ILL_CONDITIONED
        if rank < design.shape[1]:
            flags[k] |= Flag.UNRESOLVABLE
        yield (*solution[pick], noise, covariance[np.ix_(pick, pick)]), flags[k]


def _dft(frame: Float64s, cycles: Float64s, _harmonics_of: Any) -> Any:
    """Steps 1-4 of the paper; the noise is the residual without mean and bin."""
    rows = frame.shape[0]
    spectrum = np.fft.fft(frame, axis=0)
    for c in cycles:
        m = round(c * rows) % rows
        flags = Flag(0)
        if c * rows < 1:
            flags |= Flag.FEW_CYCLES
        if c > 0.5:
            flags |= Flag.ALIASED
        if abs(c * rows - round(c * rows)) > 0.01:
            flags |= Flag.OFF_BIN
        if m == 0 or 2 * m == rows or rows < 4:
            flags |= Flag.UNRESOLVABLE
        mean = spectrum[0].real / rows
        line = 2 / rows * spectrum[m]
        rest = ((frame - mean) ** 2).sum(axis=0) - np.abs(line) ** 2 * rows / 2
        noise = np.maximum(rest, 0) / (rows - 3) if rows > 3 else np.full_like(mean, np.nan)
        yield (mean, line.real, -line.imag, noise, np.diag([1 / rows, 2 / rows, 2 / rows])), flags


def _gain(
    parts: Any,
    flags: Flag,
    frequency: float,
    camera: Camera,
    ratio: float,
    ambient: Float64s,
    saturated: Any,
) -> tuple[Float64s, ...]:
    """Gain, its standard error by the delta method, phase, mean, signal-to-noise ratio and flags of each column."""
    mean, a, b, noise, covariance = parts
    mean = mean - ambient
    power = a**2 + b**2
    with np.errstate(divide="ignore", invalid="ignore"):
        direction = np.stack([a, b]) / np.sqrt(power)
        across = np.stack([-direction[1], direction[0]])
        radial = noise * np.einsum("ic,ij,jc->c", direction, covariance[1:, 1:], direction)
        tangential = noise * np.einsum("ic,ij,jc->c", across, covariance[1:, 1:], across)
        amplitude = np.sqrt(np.maximum(power - tangential, 0))
        gradient = np.stack([-amplitude / mean, *direction]) / mean  # of amplitude/mean
        variance = noise * np.einsum("ic,ij,jc->c", gradient, covariance, gradient)
        gain = amplitude / mean / ratio
        std = np.sqrt(np.maximum(variance, 0)) / ratio
        snr = (gain * mean) ** 2 / noise
    phase = np.arctan2(-b, a)
    if camera.exposure is not None:
        phase = phase - np.angle(
            np.sinc(frequency * camera.exposure) * np.exp(-1j * np.pi * frequency * camera.exposure)
        )
        if abs(np.sinc(frequency * camera.exposure)) < 0.05:
            flags |= Flag.NEAR_NULL
    phase = -((np.pi - phase) % (2 * np.pi) - np.pi)
    masks = np.full(mean.shape, int(flags), dtype=np.uint32)
    masks[saturated] |= np.uint32(Flag.SATURATED)
    masks[~(mean > 0)] |= np.uint32(Flag.NO_LIGHT)
    unknown = (masks & np.uint32(Flag.UNRESOLVABLE | Flag.NO_LIGHT)) != 0
    weak = (power < 9 * radial) | (power <= (1e-9 * mean) ** 2)
    masks[~unknown & weak] |= np.uint32(Flag.WEAK)
    values = [np.where(unknown, np.nan, x) for x in (gain, std, phase)]
    return (*values, mean, np.where(unknown, np.nan, snr), masks)


legendre = np.polynomial.legendre


def varying_tone_gain(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: float,
    degree: int = 2,
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    background: npt.ArrayLike = 0.0,
    *,
    steady: ToneGain,
    folded: tuple[Sequence[int], float] = ((), 0.0),
) -> VaryingToneGain:
    """As :func:`ocisac_fast.varying_tone_gain`: ``numpy.linalg.pinv`` of the design, column by column.

    ``steady``: the gain of the same columns by :func:`ocisac_fast.tone_gain`, whose bias is estimated; ``folded``: the
    square wave's harmonics above half the row rate in both, and the relative error by others.
    """
    light = linear_light(np.asarray(columns), camera)
    cycles = frequency * camera.row_period
    rows = light.shape[0] if light.ndim == 1 else light.shape[-2]
    every = [1] if waveform == "tone" else _square_harmonics(duty)(cycles)
    harmonics, flags = _usable(every, rows, cycles, degree)
    if cycles * rows < 1 + degree / 2:
        flags |= Flag.FEW_CYCLES
    design = np.hstack([_design(rows, cycles, harmonics, degree), _design(rows, cycles, folded[0], 0)[:, 1:]])
    singular = np.linalg.svd(design, compute_uv=False)
    parameters = design.shape[1]
    results = np.full((5, *steady.gain.shape), np.nan)
    masks = np.array(steady.flags | np.uint32(flags), dtype=np.uint32)
    if rows <= parameters or singular[-1] < 1e-13 * singular[0]:
        return _result(results, masks | np.uint32(Flag.UNRESOLVABLE))
    if singular[-1] < 1e-6 * singular[0]:
        masks |= np.uint32(Flag.ILL_CONDITIONED)

    terms = degree + 1
    inverse = np.linalg.pinv(design)
    steady_harmonics = [
        h
        for i, h in enumerate([*every, *folded[0]])
        if i == 0 or (2 * (2 * i + 3) <= rows + 2 and not _at_half_row_rate(h * cycles))
    ]
    weights = np.vstack([inverse[: 3 * terms], np.linalg.pinv(_design(rows, cycles, steady_harmonics, 0))[:3]])
    covariance = weights @ weights.T
    ratio = 1.0 if waveform == "tone" else 2 * np.sinc(duty)
    ambient = np.broadcast_to(np.asarray(background, dtype=np.float64), steady.gain.shape)
    for index in np.ndindex(steady.gain.shape):
        y = light[(*index[:-1], slice(None), *index[-1:])] if index else light
        found = weights @ y
        noise = ((y - design @ (inverse @ y)) ** 2).sum() / (rows - parameters)
        mean = found[0] - ambient[index]
        results[(2, *index)] = mean
        mask = Flag(int(masks[index])) & ~Flag.WEAK
        if not mean > 0:
            mask |= Flag.NO_LIGHT
        if not mask & (Flag.NO_LIGHT | Flag.UNRESOLVABLE):
            amplitude, slope = _amplitude(found, noise * covariance, terms)
            slope /= mean
            slope[0] -= amplitude / mean**2
            gain = amplitude / mean / ratio
            folding = folded[1] * gain
            std = np.hypot(np.sqrt(noise * slope @ covariance @ slope) / ratio, folding)
            size = np.hypot(*found[-2:])
            own = np.zeros_like(slope)
            own[-2:] = found[-2:] / size / (found[-3] - ambient[index])
            own[-3] = -size / (found[-3] - ambient[index]) ** 2
            bias = steady.gain[index] - gain
            bias_std = np.hypot(np.sqrt(noise * (own - slope) @ covariance @ (own - slope)) / ratio, folding)
            if gain < max(3 * std, 1e-9):
                mask |= Flag.WEAK
            if abs(bias) > max(4 * bias_std, steady.gain_std[index], 1e-9):
                mask |= Flag.MODEL_MISFIT
            across, more, left = _out_of_step(y, design, cycles, found, terms)
            missing = np.sqrt(2 * across / rows) / (mean * ratio)
            if across > _chance_energy(more) * left and np.hypot(gain, missing) > gain + max(std, 0.1 * gain, 1e-9):
                mask |= Flag.MODEL_MISFIT
            results[(slice(None), *index)] = gain, std, mean, bias, bias_std
        masks[index] = int(mask)
    return _result(results, masks)


def _result(values: Float64s, flags: npt.NDArray[np.uint32]) -> VaryingToneGain:
    gain, gain_std, mean, bias, bias_std = values
    return VaryingToneGain(gain, gain_std, mean, bias, bias_std, flags)


def _usable(every: list[int], rows: int, cycles: float, degree: int) -> tuple[list[int], Flag]:
    kept = list(every)
    highest = 0.5 - (degree + 1) / (2 * rows)
    while len(kept) > 1 and (kept[-1] * cycles > highest or 2 * (degree + 1) * (1 + 2 * len(kept)) > rows):
        kept.pop()
    return kept, Flag.HARMONICS_DROPPED if len(kept) < len(every) else Flag(0)


def _design(rows: int, cycles: float, harmonics: Sequence[int], degree: int) -> Float64s:
    """Legendre polynomials, alone and times cosine and sine of each harmonic, phases from the middle row."""
    u = np.arange(rows) - (rows - 1) / 2
    polynomials = legendre.legvander(2 * u / rows, degree)
    parts = [polynomials]
    for h in harmonics:
        angle = _phase(h * cycles, u)[:, None]
        parts += [polynomials * np.cos(angle), polynomials * np.sin(angle)]
    return np.hstack(parts)


def _out_of_step(y: Float64s, design: Float64s, cycles: float, found: Float64s, terms: int) -> tuple[float, int, float]:
    """Energy of the fundamental times further polynomials that the design leaves, a quarter of a cycle off the
    fundamental's phase; how many, 0 where they are not told apart; and the variance of a row that is left."""
    rows, parameters = design.shape
    apart = min(abs((cycles + 0.5) % 1.0 - 0.5), 0.5 - abs((cycles + 0.5) % 1.0 - 0.5))
    every = int(min(16, 2 * apart * rows - 1))
    more = every - terms
    if more <= 0 or 2 * (parameters + 2 * more) > rows:
        return 0.0, 1, 0.0
    waves = _design(rows, cycles, [1], every - 1)[:, every:]
    added = np.hstack([waves[:, terms:every], waves[:, every + terms :]])
    basis = np.linalg.qr(design)[0]
    rest = y - basis @ (basis.T @ y)
    own, triangle = np.linalg.qr(added - basis @ (basis.T @ added))
    sums = np.sign(np.diag(triangle)) * (own.T @ rest)
    left = (rest @ rest - sums @ sums) / (rows - parameters - 2 * more)
    cosine, sine = found[[terms, 2 * terms]]
    across = (cosine * sums[more:] - sine * sums[:more]) / np.hypot(cosine, sine)
    return float(across @ across), more, float(left)


def _chance_energy(count: int) -> float:
    """Energy of so many noise terms of variance 1 that chance exceeds once in a million (Wilson and Hilferty)."""
    spread = 2 / (9 * count)
    return float(count * (1 - spread + 4.8 * np.sqrt(spread)) ** 3)


def _amplitude(found: Float64s, covariance: Float64s, terms: int) -> tuple[float, Float64s]:
    """Mean over x of the tone's amplitude (eight Gauss-Legendre points) and its derivatives."""
    places, shares = legendre.leggauss(8)
    slope = np.zeros(len(found))
    amplitude = 0.0
    for polynomials, share in zip(legendre.legvander(places, terms - 1), shares / 2, strict=True):
        cosine = polynomials @ found[terms : 2 * terms]
        sine = polynomials @ found[2 * terms : 3 * terms]
        length = np.hypot(cosine, sine)
        if length == 0:
            continue
        along, across = np.zeros(len(found)), np.zeros(len(found))
        along[terms : 3 * terms] = np.concatenate([cosine * polynomials, sine * polynomials]) / length
        across[terms : 3 * terms] = np.concatenate([-sine * polynomials, cosine * polynomials]) / length
        amplitude += share * np.sqrt(max(length**2 - across @ covariance @ across, 0.0))
        slope += share * along
    return float(amplitude), slope


def amplitude_spectrum(signal: Float64s) -> Float64s:
    """Amplitude over mean at (0 ... 2 rows) / (4 rows) cycles per row, with a Hann window."""
    rows, mean = len(signal), signal.mean()
    window = np.sin(np.pi * (np.arange(rows) + 0.5) / rows) ** 2
    lines = np.exp(-2j * np.pi * np.outer(np.arange(2 * rows + 1) / (4 * rows), np.arange(rows)))
    scale = window.sum() * (mean if mean > 0.0 else 1.0)
    return np.asarray(2.0 * np.abs(lines @ ((signal - mean) * window)) / scale)


def equalize(columns: npt.ArrayLike, camera: Camera, *, max_boost: float = 10.0) -> Float64s:
    """Subtract the line, extend the ends by linear prediction, multiply the DFT by G, add the shifted line.

    The method ``inverse``; uses np.fft, np.linalg and np.polynomial; see docs/explanation/tones.md.
    """
    light = linear_light(np.asarray(columns), camera)
    assert camera.exposure is not None
    exposure_rows = camera.exposure / camera.row_period
    axis = -2 if light.ndim > 1 else 0
    by_column = np.moveaxis(light, axis, -1)
    rows = by_column.shape[-1]
    result = np.empty(by_column.shape)
    if exposure_rows == 0:
        return light
    if exposure_rows >= rows:
        result[...] = by_column.mean(axis=-1, keepdims=True)
        return np.moveaxis(result, -1, axis)
    weights = continuation(rows, exposure_rows)
    for index in np.ndindex(*by_column.shape[:-1]):
        result[index] = _equalize_column(by_column[index], exposure_rows, weights, max_boost)
    return np.moveaxis(result, -1, axis)


def covariance(rows_apart: npt.ArrayLike, exposure_rows: float) -> Float64s:
    """Covariance of two rows: white light after the exposure, plus a smooth course of 100 times its variance."""
    k = np.abs(np.asarray(rows_apart, dtype=np.float64))
    smooth = 100 / (1 + (k / (2 * exposure_rows + 16)) ** 2)
    return np.asarray(np.maximum(0, 1 - k / max(exposure_rows, 1)) + smooth)


def continuation(rows: int, exposure_rows: float) -> Float64s:
    """(predicted, used) weights that extrapolate from the last rows, the nearest first, with a fade to 0."""
    used = min(int(np.ceil(4 * exposure_rows)) + 16, 1024, rows)
    predicted = min(int(np.ceil(4 * exposure_rows)) + 32, 1024, rows)
    seen, ahead = np.arange(used), np.arange(1, predicted + 1)
    among = covariance(np.subtract.outer(seen, seen), exposure_rows) + 0.001 * max(exposure_rows, 1) * np.eye(used)
    between = covariance(np.add.outer(ahead, seen), exposure_rows)
    fade = 0.5 + 0.5 * np.cos(np.pi * ahead / (predicted + 1))
    return np.asarray(fade[:, None] * np.linalg.solve(among, between.T).T)


def optimal_length(length: int) -> int:
    """The smallest length >= ``length`` with no prime factors other than 2, 3 and 5."""
    while True:
        rest = length
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return length
        length += 1


def _equalize_column(column: Float64s, exposure_rows: float, weights: Float64s, max_boost: float) -> Float64s:
    rows = len(column)
    n = np.arange(rows)
    line = np.polynomial.Polynomial.fit(n, column, 1) if rows > 1 else np.polynomial.Polynomial([column[0]])
    residual = column - line(n)
    predicted, used = weights.shape
    length = optimal_length(rows + 2 * predicted)
    f = np.arange(length // 2 + 1) / length
    h = np.sinc(f * exposure_rows)
    after = weights @ residual[::-1][:used]
    before = (weights @ residual[:used])[::-1]
    extended = np.concatenate([residual, after, np.zeros(length - rows - 2 * predicted), before])
    gain = h / np.maximum(h**2, max_boost**-2) * np.exp(1j * np.pi * f * exposure_rows)
    return np.asarray(np.fft.irfft(np.fft.rfft(extended) * gain, length)[:rows] + line(n + exposure_rows / 2))
