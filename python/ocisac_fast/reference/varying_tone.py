"""Gain of a tone that varies along the column, as the equations say it."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.reference.gain import FloatArray, _at_half_row_rate, _phase, _square_harmonics, tone_gain
from ocisac_fast.reference.light import linear_light
from ocisac_fast.tones.varying_tone import VaryingToneGain

legendre = np.polynomial.legendre


def varying_tone_gain(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: float,
    degree: int = 2,
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    background: npt.ArrayLike = 0.0,
    threads: int = 1,
) -> VaryingToneGain:
    """As :func:`ocisac_fast.varying_tone_gain`: ``numpy.linalg.pinv`` of the design, column by column."""
    light = linear_light(np.asarray(columns), camera)
    steady = tone_gain(columns, camera, frequency, "fit", waveform, duty, background)
    cycles = frequency * camera.row_time
    rows = light.shape[0] if light.ndim == 1 else light.shape[-2]
    every = [1] if waveform == "tone" else _square_harmonics(duty)(cycles)
    harmonics, flags = _usable(every, rows, cycles, degree)
    if cycles * rows < 1 + degree / 2:
        flags |= Flag.FEW_CYCLES
    design = _design(rows, cycles, harmonics, degree)
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
        h for i, h in enumerate(every) if i == 0 or (2 * (2 * i + 3) <= rows + 2 and not _at_half_row_rate(h * cycles))
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
            std = np.sqrt(noise * slope @ covariance @ slope) / ratio
            size = np.hypot(*found[-2:])
            own = np.zeros_like(slope)
            own[-2:] = found[-2:] / size / (found[-3] - ambient[index])
            own[-3] = -size / (found[-3] - ambient[index]) ** 2
            bias = steady.gain[index] - gain
            bias_std = np.sqrt(noise * (own - slope) @ covariance @ (own - slope)) / ratio
            if gain < max(3 * std, 1e-9):
                mask |= Flag.WEAK
            if abs(bias) > max(4 * bias_std, steady.gain_std[index], 1e-9):
                mask |= Flag.MODEL_MISFIT
            results[(slice(None), *index)] = gain, std, mean, bias, bias_std
        masks[index] = int(mask)
    return _result(results, masks)


def _result(values: FloatArray, flags: npt.NDArray[np.uint32]) -> VaryingToneGain:
    gain, gain_std, mean, bias, bias_std = values
    return VaryingToneGain(gain, gain_std, mean, bias, bias_std, flags)


def _usable(every: list[int], rows: int, cycles: float, degree: int) -> tuple[list[int], Flag]:
    kept = list(every)
    highest = 0.5 - (degree + 1) / (2 * rows)
    while len(kept) > 1 and (kept[-1] * cycles > highest or 2 * (degree + 1) * (1 + 2 * len(kept)) > rows):
        kept.pop()
    return kept, Flag.HARMONICS_DROPPED if len(kept) < len(every) else Flag(0)


def _design(rows: int, cycles: float, harmonics: list[int], degree: int) -> FloatArray:
    """Legendre polynomials, alone and times cosine and sine of each harmonic, phases from the middle row."""
    u = np.arange(rows) - (rows - 1) / 2
    polynomials = legendre.legvander(2 * u / rows, degree)
    parts = [polynomials]
    for h in harmonics:
        angle = _phase(h * cycles, u)[:, None]
        parts += [polynomials * np.cos(angle), polynomials * np.sin(angle)]
    return np.hstack(parts)


def _amplitude(found: FloatArray, covariance: FloatArray, terms: int) -> tuple[float, FloatArray]:
    """Mean over x of the tone's amplitude (eight points of Gauss and Legendre) and its derivatives."""
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
