"""Gains of a region: amplitude over mean, pooled over many columns or pixels without bias by noise."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast._core import lost_at_black, product
from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.sensing.fit import Columns, Fitted, fit, make_model

_CHUNK = 1 << 19  # samples, of which float64 stays in the cache
_MAX_DRAWN = 64  # columns
_JUDGED = (4, 16)  # frames, columns


@dataclass(frozen=True, slots=True)
class Ambient:
    """Light of other origin: (frames, columns) or one value, its standard error; ``shared``: one measurement for all
    columns."""

    mean: Float64s
    std: Float64s
    shared: bool


@dataclass(frozen=True, slots=True)
class PooledGain:
    """Amplitude over mean, its standard error, the mean light and the tone's power over a row's noise variance;
    ``shared``: standard error over that of noise that is independent between columns."""

    gain: float
    std: float
    mean: float
    snr: float
    shared: float = 1.0


def pooled_gain(fitted: Fitted, ambient: Ambient, columns: Columns | None = None) -> PooledGain:
    """sqrt(sum |z|^2 / sum m^2) over columns and frames, with the noise's expectation subtracted from both sums.

    This weights each column by its light, as least squares of one gain does, and is unbiased even if the noise of a
    column exceeds its tone. The standard error comes from the residual of each column, for noise that is independent
    between columns; with ``columns`` from that or the residual of each row, whichever is larger.
    """
    covariance = fitted.model.covariance
    first = fitted.model.first
    c = covariance[np.ix_([0, first, first + 1], [0, first, first + 1])]
    m, z, noise = fitted.mean - ambient.mean, fitted.tone, fitted.noise
    light = float((m**2 - noise * c[0, 0] - ambient.std**2).sum())
    power = float((np.abs(z) ** 2 - noise * (c[1, 1] + c[2, 2])).sum())
    if not (m.mean() > 0.0 and light > 0.0):
        return PooledGain(np.nan, np.nan, float(m.mean()), np.nan)
    gain = float(np.sqrt(max(power, 0.0) / light))
    by = np.stack([-gain * gain * m, z.real, -z.imag]) / light  # half the derivatives of gain^2
    alone = float((noise * np.einsum("ajk,ab,bjk->jk", by, c, by)).sum())
    variance = alone if columns is None else max(alone, _variance_by_rows(columns, fitted, by))
    shared = math.sqrt(variance / alone) if alone > 0.0 else 1.0
    variance += _ambient_variance(by[0], ambient) + (_by_cycles(fitted, by) * fitted.cycles_std) ** 2
    chance = float(((noise / light) ** 2).sum()) * (c[1, 1] ** 2 + c[2, 2] ** 2 + 2 * c[1, 2] ** 2) / 2.0
    both = variance + chance  # variance of gain^2 / 4
    with np.errstate(invalid="ignore"):  # rounding leaves an ill-posed fit a variance below 0
        std = np.sqrt(both) / gain if gain**4 > 4.0 * both else (4.0 * both) ** 0.25
    mean_noise = float(noise.mean())
    snr = max(power, 0.0) / m.size / mean_noise if mean_noise > 0.0 else np.inf
    return PooledGain(gain, float(std), float(m.mean()), float(snr), shared)


def _variance_by_rows(columns: Columns, fitted: Fitted, by: Float64s) -> float:
    """A quarter of the variance of gain^2 by what the fit leaves of each row, whose noise the columns may share."""
    model = fitted.model
    own = model.weights[[0, model.first, model.first + 1]].T
    rows, unknowns = model.design.shape
    of_frames = by.transpose(1, 0, 2)
    spread = 0.0
    for light, parameters, weights in zip(columns.across(of_frames), fitted.parameters, of_frames, strict=True):
        left = light - product(model.design, product(parameters, weights.T))
        spread += float(np.square((own * left).sum(axis=1)).sum())
    return spread * rows / (rows - unknowns) if rows > unknowns else 0.0


def _by_cycles(fitted: Fitted, by: Float64s) -> float:
    """Half the derivative of gain^2 by the frequency, whose error is independent of the other errors."""
    model = fitted.model
    follow = -product(model.weights[[0, model.first, model.first + 1]], model.slope)
    return float(np.einsum("ajk,ap,jpk->", by, follow, fitted.parameters))


def _ambient_variance(by_mean: Float64s, ambient: Ambient) -> float:
    std = np.broadcast_to(ambient.std, by_mean.shape)
    if ambient.shared:
        return float((by_mean * std).sum() ** 2)
    return float(((by_mean * std).sum(axis=0) ** 2).sum())  # one measurement per column for all frames


def error_by_black(region: npt.NDArray[Any], camera: Camera, fitted: Fitted, ambient: Ambient) -> float:
    """Error of the gain by noise that is cut off at black, from the light of some columns of some frames."""
    frames, columns = (
        slice(None, None, 1 + size // most) for size, most in zip(fitted.noise.shape, _JUDGED, strict=True)
    )
    some = Fitted(fitted.model, fitted.parameters[frames, :, columns], fitted.noise[frames, columns], 0.0)
    off = np.broadcast_to(ambient.mean, fitted.noise.shape)[frames, columns]
    true = dataclasses.replace(
        some, parameters=some.parameters - pull_of_black(region[frames, :, columns], camera, some, off)
    )
    steady = Ambient(off, np.zeros(()), shared=True)
    return abs(pooled_gain(true, steady).gain - pooled_gain(some, steady).gain)


def pull_of_black(region: npt.NDArray[Any], camera: Camera, fitted: Fitted, off: Float64s) -> Float64s:
    """Error of the parameters by noise that black cuts off; ``off``: light of each column without the source."""
    model, dark = fitted.model, camera.dark_level
    if region.dtype.kind != "u" or camera.tone_curve != "linear" or region.min() > 0:
        return np.zeros_like(fitted.parameters)
    light = np.stack([product(model.design, one) for one in fitted.parameters])
    noise = fitted.noise
    if region.shape[1] > 2:  # without what is slow
        noise = np.minimum(noise, np.square(np.diff(region.astype(np.float64), 2, axis=1)).mean(axis=1) / 6.0)
    deviation = np.sqrt(np.maximum(noise - 1.0 / 12.0, 1e-4))
    lost = np.where(region == 0, lost_at_black(light + dark, deviation[:, None], off[:, None] + dark), 0.0)
    return np.stack([product(model.weights, one) for one in lost])


def is_rounded(region: npt.NDArray[Any], camera: Camera, fitted: Fitted, ambient: Ambient, gain: PooledGain) -> bool:
    """True if rounding to whole values may shift the gain by half its standard error: light x by
    -exp(-2 pi^2 sigma^2)/pi sin(2 pi x) beside noise sigma, which columns of one wall have alike."""
    if region.dtype.kind not in "iu" or camera.tone_curve != "linear":
        return False
    model = fitted.model
    left = np.exp(-2.0 * np.pi**2 * np.maximum(fitted.noise - 1.0 / 12.0, 0.0)) / np.pi
    if not 2.0 * left.max() * (1.0 + gain.gain) > 0.5 * gain.std * gain.mean:
        return False
    true = fitted.parameters.copy()
    for parameters, most in zip(true, left, strict=True):
        light = product(model.design, parameters) + camera.dark_level
        parameters += product(model.weights, most * np.sin(2.0 * np.pi * light))
    shifted = pooled_gain(dataclasses.replace(fitted, parameters=true), ambient).gain
    return not abs(shifted - gain.gain) < 0.5 * gain.std


def contrast_range(fitted: Fitted) -> float:
    """(max - min)/(max + min) of the fitted rows without noise, median of up to 64 columns of the first frame."""
    parameters = fitted.parameters[0]
    columns = np.linspace(0, parameters.shape[1] - 1, min(parameters.shape[1], _MAX_DRAWN)).round().astype(int)
    model = fitted.model
    chosen = parameters[:, columns]
    waves = slice(model.first, model.first + 2 * len(model.harmonics))
    rows = model.design[:, waves] @ chosen[waves] + chosen[0]
    top, bottom = rows.max(axis=0), rows.min(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.median((top - bottom) / (top + bottom)))


def over_frames(region: npt.NDArray[Any], camera: Camera, advance: float, fitted: Fitted) -> Fitted | None:
    """Fit of every pixel's course over the frames at ``advance`` cycles per frame.

    None where the tone cannot be resolved: fewer than 6 frames, less than a cycle, or less than half a cycle from half
    the frame rate. Harmonics and other tones alias to arbitrary frequencies; they are subtracted as fitted in the
    columns.
    """
    count, rows, columns = region.shape
    at = abs(advance)
    if not (count >= 6 and at * count >= 1.0 and (0.5 - at) * count >= 0.5):
        return None
    model = make_model(count, at, (1,), (), degree=0)
    step = max(1, _CHUNK // (count * columns))
    parts = [fit(_course(region, camera, fitted, slice(top, top + step)), model) for top in range(0, rows, step)]
    parameters = np.concatenate([part.parameters for part in parts], axis=2)
    return Fitted(model, parameters, np.concatenate([part.noise for part in parts], axis=1), 0.0)


def _course(region: npt.NDArray[Any], camera: Camera, fitted: Fitted, rows: slice) -> Columns:
    """Pixels of some rows as columns of one frame, whose rows are the frames; without harmonics and other tones."""
    beside = fitted.model.first + 2
    part = region[:, rows]
    if beside < fitted.model.design.shape[1]:
        part = linear_light(part, camera) - fitted.model.design[rows, beside:] @ fitted.parameters[:, beside:]
        camera = Camera(1.0)
    return Columns(part.reshape(1, len(region), -1), camera)
