"""Restoration of a moving texture's contrast by the equaliser."""

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
from ocisac_fast.core.results import Result
from ocisac_fast.light.waveforms import Tone, integrate_exposure
from ocisac_fast.sensing.motion import KnownMotion
from ocisac_fast.sensing.region import sense_region
from ocisac_fast.tones.equalization import equalize

_PHASES = 16
_OF_MOTION = Flag.WEAK | Flag.AMBIGUOUS_KIND | Flag.AMBIGUOUS_MOTION  # of one frame, whose motion is stated


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class RestoredContrast(Result):
    """Contrast gain of columns before and after equalisation.

    Attributes:
        before, before_std: gain along the columns before equalisation; |sinc(f T_e)| in theory.
        after, after_std: gain of the equalised columns, away from their ends.
        theory: of ``after`` in long columns, for ``"inverse"``: |H|^2 / max(|H|^2, 1/max_boost^2), 1 where the boost
            suffices; NaN for ``"wiener"``.
        expected: of ``after`` in columns of this length without noise, where the equaliser cannot separate the texture
            from a null less than a cycle in the frame away; NaN for ``"wiener"``.
        snr_before, snr_after: power ratio of tone to noise before and after equalisation; noise dominates the picture
            below 1.
        columns: float64 array of the equalised columns, of the shape of the argument.
        flags: those of :func:`sense_region` before equalisation; WEAK: ``after`` is below three standard errors.
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
    *,
    method: Literal["inverse", "wiener"] = "inverse",
    noise: npt.ArrayLike | None = None,
    max_boost: float = 10.0,
    depth: float = 1.0,
) -> RestoredContrast:
    """Equalise the columns of a moving texture and measure its contrast before and after.

    The exposure reduces the contrast to |sinc(f_x v T_e)| (eq. 16). :func:`equalize` multiplies by the inverse, up to
    ``max_boost``. It amplifies tone and noise at f_x v equally, so the relative standard error of the contrast does not
    change; noise at other frequencies dominates the look of a column. Valid for motion across the rows: along them, the
    frequency in a column differs from that of the light in a pixel.

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
    ends = math.ceil(2.0 * camera.exposure / camera.row_period)  # rows affected by the ends of the frame
    inner = min(ends, rows // 4)
    if not (
        rows * camera.row_period >= 4.0 * camera.exposure and (rows - 2 * inner) * camera.row_period * frequency >= 1.0
    ):
        raise ValueError(f"columns: got {rows} rows, allowed: four exposures and two cycles of {frequency} Hz or more")
    before = sense_region(_grey(array), camera, frequency, depth=depth, motion=KnownMotion(axis="across"))
    found, report = equalize(array, camera, method=method, noise=noise, max_boost=max_boost, report=True)
    light = Camera(camera.row_time, camera.exposure)
    middle = found[..., inner : rows - inner, :] if found.ndim > 1 else found[inner : rows - inner]
    after = sense_region(_grey(middle), light, frequency, depth=depth, motion=KnownMotion(axis="across"))
    response = abs(float(np.sinc(frequency * camera.exposure)))
    share = math.sqrt(rows / (rows - 2 * inner))  # increase of the standard error by the excluded rows
    relative = min(before.gain_std / before.gain, 1.0) if before.gain > 0.0 else 1.0
    after_std = max(after.gain_std, after.gain * relative * share)
    row_noise = _row_noise(array, camera, before.contrast, before.mean, before.snr * depth**2)
    gained = float(np.sqrt(np.mean(np.square(report.noise_gain)))) * row_noise
    amplitude = after.contrast * after.mean
    flags = before.flags & ~_OF_MOTION
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
    """Add the axis of one colour, since three columns would resemble a colour picture."""
    return columns[..., np.newaxis] if columns.ndim == 3 else columns


def _expected(camera: Camera, frequency: float, rows: int, inner: int, max_boost: float) -> float:
    """Gain of an equalised full-depth texture without noise, over all phases."""
    phases = 2.0 * np.pi * np.arange(_PHASES) / _PHASES
    columns = [integrate_exposure(Tone(frequency, amplitude=2.0, phase=phase), camera, rows) for phase in phases]
    restored = equalize(np.stack(columns, axis=1), camera, max_boost=max_boost)
    return sense_region(restored[inner : rows - inner], camera, frequency).gain


def _row_noise(array: npt.NDArray[Any], camera: Camera, contrast: float, mean: float, snr: float) -> float:
    """RMS noise of a row, from amplitude^2 / noise^2."""
    if math.isfinite(snr) and snr > 0.0:
        return contrast * mean / math.sqrt(snr)
    return 0.0 if snr > 0.0 else float(linear_light(array, camera).std())
