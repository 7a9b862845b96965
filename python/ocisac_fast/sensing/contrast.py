"""The contrast of a moving texture, given back by the equaliser."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.core.arrays import as_columns, in_stored_order
from ocisac_fast.core.checks import checked
from ocisac_fast.core.flags import Flag
from ocisac_fast.light.waveforms import Tone, integrate_exposure
from ocisac_fast.sensing.region import sense_region
from ocisac_fast.tones.equalization import equalize

_PHASES = 16


@dataclass(frozen=True, slots=True, eq=False)
class RestoredContrast:
    """Contrast gain of columns before and after equalisation.

    Attributes:
        before, before_std: gain along the columns as they are; |sinc(f T_e)| in theory.
        after, after_std: gain of the equalised columns, away from their ends.
        theory: of ``after`` in long columns, for ``"inverse"``: |H|^2 / max(|H|^2, 1/max_boost^2), 1 where the boost
            suffices; NaN for ``"wiener"``.
        expected: of ``after`` in columns of so many rows without noise, whose ends keep the equaliser from telling the
            texture from a null that is less than a cycle in the frame away; NaN for ``"wiener"``.
        snr_before, snr_after: power of the tone over that of the noise, of the columns as they are and equalised: below
            1 the eye sees noise.
        columns: float64 array of the shape of the columns given: the equalised columns.
        flags: NEAR_NULL: |sinc| < 0.05; WEAK: noise has ended it, ``after`` is below three standard errors.
    """

    before: float
    before_std: float
    after: float
    after_std: float
    theory: float
    expected: float
    snr_before: float
    snr_after: float
    columns: npt.NDArray[np.float64]
    flags: Flag


@checked
def restore_contrast(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: float,
    method: Literal["inverse", "wiener"] = "inverse",
    noise: npt.ArrayLike | None = None,
    *,
    max_boost: float = 10.0,
    depth: float = 1.0,
) -> RestoredContrast:
    """Equalise the columns of a moving texture and tell how much of its contrast came back.

    The exposure leaves |sinc(f_x v T_e)| of the contrast (eq. 16); :func:`equalize` multiplies by its inverse, up to
    ``max_boost``, and noise with it: tone and noise at f_x v grow alike, so that the relative standard error of the
    contrast stays what it was, while the noise of all other frequencies decides what a column looks like. For motion
    across the rows; along them a column holds another frequency than the light of a pixel.

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), rows in time order; at least four exposures and
            two cycles long.
        camera: row time, exposure and response.
        frequency: f_x v, Hz, above 0.
        method, noise, max_boost: as for ``equalize``.
        depth: contrast of the texture itself.

    Returns:
        :class:`RestoredContrast`.

    Raises:
        ValueError: no exposure in ``camera``, columns too short, or as for ``equalize`` and ``sense_region``.
    """
    array = as_columns(columns, scan_axis=camera.scan_axis)
    scan_axis, camera = camera.scan_axis, camera.in_time_order
    if camera.exposure is None:
        raise ValueError("camera.exposure: got None, allowed: the exposure time in seconds")
    rows = array.shape[0 if array.ndim < 3 else 1]
    ends = math.ceil(2.0 * camera.exposure / camera.row_period)  # rows that the frame's ends disturb
    inner = min(ends, rows // 4)
    if not (
        rows * camera.row_period >= 4.0 * camera.exposure and (rows - 2 * inner) * camera.row_period * frequency >= 1.0
    ):
        raise ValueError(f"columns: got {rows} rows, allowed: four exposures and two cycles of {frequency} Hz or more")
    before = sense_region(_grey(array), camera, frequency, depth=depth, motion="across")
    found, report = equalize(array, camera, method, noise, max_boost=max_boost, report=True)
    light = Camera(camera.row_time, camera.exposure)
    middle = found[..., inner : rows - inner, :] if found.ndim > 1 else found[inner : rows - inner]
    after = sense_region(_grey(middle), light, frequency, depth=depth, motion="across")
    response = abs(float(np.sinc(frequency * camera.exposure)))
    share = math.sqrt(rows / (rows - 2 * inner))  # of the standard error, for rows left out
    relative = min(before.gain_std / before.gain, 1.0) if before.gain > 0.0 else 1.0
    after_std = max(after.gain_std, after.gain * relative * share)
    row_noise = _row_noise(array, camera, before.contrast, before.mean, before.snr * depth**2)
    gained = float(np.sqrt(np.mean(np.square(report.noise_gain)))) * row_noise
    amplitude = after.contrast * after.mean
    flags = before.flags & (Flag.NEAR_NULL | Flag.SATURATED | Flag.NO_LIGHT | Flag.FEW_CYCLES | Flag.UNRESOLVABLE)
    if not after.gain > 3.0 * after_std:
        flags |= Flag.WEAK
    return RestoredContrast(
        before.gain,
        before.gain_std,
        after.gain,
        after_std,
        response**2 / max(response**2, max_boost**-2.0) if method == "inverse" else math.nan,
        _expected(light, frequency, rows, inner, max_boost) if method == "inverse" else math.nan,
        0.5 * before.snr * depth**2,
        0.5 * amplitude**2 / gained**2 if gained > 0.0 else math.inf,
        in_stored_order(found, scan_axis),
        flags,
    )


def _grey(columns: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """As frames of one colour: a stack of three columns is no colour picture here."""
    return columns[..., np.newaxis] if columns.ndim == 3 else columns


def _expected(camera: Camera, frequency: float, rows: int, inner: int, max_boost: float) -> float:
    """What the equaliser makes of a full-depth texture without noise, over all phases."""
    phases = 2.0 * np.pi * np.arange(_PHASES) / _PHASES
    columns = [integrate_exposure(Tone(frequency, 2.0, phase), camera, rows) for phase in phases]
    restored = equalize(np.stack(columns, axis=1), camera, max_boost=max_boost)
    return sense_region(restored[inner : rows - inner], camera, frequency).gain


def _row_noise(array: npt.NDArray[Any], camera: Camera, contrast: float, mean: float, snr: float) -> float:
    """RMS noise of a row, from amplitude^2 / noise^2."""
    if math.isfinite(snr) and snr > 0.0:
        return contrast * mean / math.sqrt(snr)
    return 0.0 if snr > 0.0 else float(linear_light(array, camera).std())
