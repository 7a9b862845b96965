"""Gain of tones, as the equations say it."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.reference.light import linear_light, saturation_level
from ocisac_fast.tones.gain import ToneGain

FloatArray = npt.NDArray[np.float64]


def tone_gain(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: npt.ArrayLike,
    method: Literal["fit", "dft"] = "fit",
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    background: npt.ArrayLike = 0.0,
    efficiency: float = 1.0,
    threads: int = 1,
    *,
    pooled: bool = False,
) -> ToneGain:
    """As :func:`ocisac_fast.tone_gain`: ``numpy.linalg.lstsq`` on the design matrix, ``numpy.fft.rfft`` for the DFT.

    ``efficiency`` and ``threads`` change nothing here. Flags of frequencies on multiples of half the row rate, few
    cycles and the like are the same.
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
    whole_numbers = stored.dtype in (np.uint8, np.uint16) and camera.tone_curve == "linear" and not pooled
    tones = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    estimate = _fit if method == "fit" else _dft
    ratio = 1.0 if waveform == "tone" else 2 * np.sinc(duty)
    harmonics_of = _only_fundamental if waveform == "tone" else _square_harmonics(duty)
    results = []
    for frame, b, s in zip(light, ambient, saturated, strict=True):
        per_tone = [
            _gain(parts, frame_flags, f, camera, ratio, b, s, whole_numbers)
            for f, (parts, frame_flags) in zip(
                tones, estimate(frame, tones * camera.row_time, harmonics_of), strict=True
            )
        ]
        results.append([np.stack(values) for values in zip(*per_tone, strict=True)])
    arrays = [np.stack(values, axis=1) for values in zip(*results, strict=True)]  # (tones, frames, columns)
    out_shape = np.shape(frequency) + shape[:-2] + (() if pooled else shape[-1:] * (len(shape) > 1))
    return ToneGain(*(values.reshape(out_shape) for values in arrays))


def _pool(
    light: FloatArray, ambient: FloatArray, saturated: npt.NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Columns of each frame combined with weights by brightness, saturated ones left out where others remain."""
    weights = np.maximum(light.mean(axis=1) - ambient, 0.0)
    lit = np.asarray(weights.any(axis=1))
    weights[~lit] = 1.0
    clean = np.where(saturated, 0.0, weights)
    only_saturated = np.asarray(~np.asarray(clean.any(axis=1)))
    weights = np.where(only_saturated[:, None], weights, clean)
    weights = weights / weights.sum(axis=1, keepdims=True)
    column = np.einsum("jnc,jc->jn", light, weights)[:, :, None]
    return column, (weights * ambient).sum(axis=1, keepdims=True), only_saturated[:, None]


def _only_fundamental(_cycles_per_row: float) -> list[int]:
    return [1]


def _square_harmonics(duty: float) -> Any:
    def harmonics(cycles_per_row: float) -> list[int]:
        above = range(2, int(0.5 / cycles_per_row) + 2)
        return [1, *(h for h in above if h * cycles_per_row < 0.5 and abs(np.sinc(h * duty)) > 1e-9)]

    return harmonics


def _phase(cycles_per_row: float, rows: npt.ArrayLike) -> FloatArray:
    """2 pi cycles_per_row row, with the whole cycles taken off in extended precision."""
    cycles = np.longdouble(cycles_per_row) * np.asarray(rows, dtype=np.longdouble)
    return np.asarray(2 * np.pi * (cycles - np.rint(cycles)).astype(np.float64))


def _at_half_row_rate(c: float) -> bool:
    """At a multiple of half the row rate, but for the rounding of f T_r."""
    return bool(abs(2 * c - np.rint(2 * c)) <= 8 * np.finfo(float).eps * c)


def _fit(frame: FloatArray, cycles: FloatArray, harmonics_of: Any) -> Any:
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


def _dft(frame: FloatArray, cycles: FloatArray, _harmonics_of: Any) -> Any:
    """Steps 1-4 of the paper; the residual beside the mean and the bin counts as noise."""
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


def _rounding_pull(amplitude: FloatArray, noise: FloatArray) -> FloatArray:
    """RMS pull of rounding on an amplitude, in steps (Widrow's series, RMS over the place between two codes)."""
    own = np.where((amplitude < 1) & (noise < 0.3), 0.0, np.maximum(noise - 1 / 12, 0))
    return np.asarray(0.1111 / np.sqrt(np.maximum(amplitude, 0.1)) * np.exp(-2 * np.pi**2 * own))


def _gain(
    parts: Any,
    flags: Flag,
    frequency: float,
    camera: Camera,
    ratio: float,
    ambient: FloatArray,
    saturated: Any,
    whole_numbers: bool,
) -> tuple[FloatArray, ...]:
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
    if whole_numbers:
        with np.errstate(invalid="ignore"):
            pulled = _rounding_pull(amplitude, noise) > np.sqrt(radial)
        masks[~unknown & ~weak & pulled] |= np.uint32(Flag.QUANTISED)
    values = [np.where(unknown, np.nan, x) for x in (gain, std, phase)]
    return (*values, mean, np.where(unknown, np.nan, snr), masks)
