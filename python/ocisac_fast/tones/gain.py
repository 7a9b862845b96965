"""The normalised gain of tones in pixel columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s, as_columns
from ocisac_fast.core.checks import Threads, check_arguments
from ocisac_fast.core.results import Result

_NO_BACKGROUND = np.zeros(0)


@dataclass(frozen=True, repr=False)
class ToneGain(Result):
    """Gains of one or more tones, one value per column.

    Every array has the shape of the columns without the axis of rows: () for (rows,), (columns,) for (rows, columns),
    (frames, columns) for (frames, rows, columns); pooled columns have no axis of columns. An array of frequencies adds
    a first axis of tones. Values that cannot be estimated are NaN and flagged.

    Attributes:
        gain: 2|X(f)|/X(0) over the waveform's own ratio at full depth (eq. 24); |sinc(f T_e)| in theory. The bias of
            the magnitude by noise is subtracted; below three standard errors (flag WEAK) a part of it remains.
        gain_std: standard error of ``gain``, from the residual of the column. Few rows leave few degrees of freedom
            (rows less 3, and 2 for each harmonic): intervals are those of Student's t. With 8 rows gain +- 1.96
            gain_std holds 89 %, +- 2.57 gain_std 95 %. Of pooled columns it includes the noise that black cuts off.
        phase: phase of the light's fundamental at t = 0, the end of row 0's exposure, in (-pi, pi]; the delay of half
            an exposure is compensated where the camera's exposure is known. Its standard error in rad is gain_std over
            gain, or up to 8 % less.
        mean: mean light of the source, DN above dark and background.
        snr: signal-to-noise ratio G^2 mean^2 / (noise variance of a row), a plain ratio (eq. 13); over gain^2 it is
            that of eq. 14, before the exposure.
        flags: uint32 masks of :class:`ocisac_fast.Flag`.
    """

    gain: Float64s
    gain_std: Float64s
    phase: Float64s
    mean: Float64s
    snr: Float64s
    flags: npt.NDArray[np.uint32]


def tone_gain(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: npt.ArrayLike,
    *,
    method: Literal["fit", "robust", "dft"] = "fit",
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    background: npt.ArrayLike = 0.0,
    efficiency: float = 1.0,
    threads: Threads = 1,
    pooled: bool = False,
) -> ToneGain:
    """Normalised gain of tones in every pixel column, with its standard error.

    Method ``"fit"`` solves mean + tone + harmonics by least squares at the exact frequency (cf. IEEE Std 1057).
    ``"robust"`` also fits other tones that the strongest columns of a frame show, such as mains hum or another lamp,
    and flags distortion and rows that deviate (docs/explanation/tones.md). A clean frame of 1080 x
    1920 bytes takes 60 % longer, others many times as long.
    ``"dft"`` is the paper's: the DFT's bin nearest to the tone (eqs. 24-25, figure 8), biased unless the tone completes
    whole cycles in the frame (flag OFF_BIN). What leaks counts as noise there, whose part of
    the magnitude is subtracted: up to 3e-4 even in light without noise. Both assume a mean and a tone that are constant
    along the column; :func:`varying_tone_gain` tests this.

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), rows in time order; ``Camera`` defines the meaning
            of stored values. Any strides, no copy for uint8, uint16, float32 and float64.
        camera: row time, and where known the exposure, tone curve and dark level.
        frequency: of the light, Hz, above 0; one value or a (tones,) array, fitted together. Above half the row rate
            the tone is measured at its alias (flag ALIASED).
        method: ``"fit"``, ``"robust"`` or ``"dft"``.
        waveform: ``"tone"``, or ``"square"``: all harmonics of a square wave below half the row rate are fitted too, up
            to eight above at their aliases, and the gain is that of its fundamental. Others that may bias it by half a
            standard error have the ratios of duty and exposure, or are flagged (HARMONICS_DROPPED). Harmonics of
            another waveform, as of a tone that has none, are flagged MODEL_MISFIT where the exposure is known.
        duty: share of the period in which the square wave is bright, inside (0, 1).
        background: light of other origin, DN above dark: one value, or (columns,) or (frames, columns). An unsubtracted
            background lowers the gain to the source's share times |sinc|.
        efficiency: min. share of the fit's statistical efficiency, in (0, 1]. Integers, float32 and, below 1, linear
            float64 are fitted in one streaming pass over the pixels, in any layout; below 1, 2, 4 or 8 rows are added
            first where the share allows it and it is faster (of one tone in linear bytes none with AVX-512, where no
            share is lost, and at most two with AVX2 on AMD processors). The estimate stays unbiased. Where no rows are
            added, as at 1, it agrees with the fit in float64 to a thousandth of ``gain_std`` for bytes (weights have 13
            bits or more: 1e-7 of the variance) and for integers with a tone curve (light in float32), to 1e-8 for
            linear uint16 and float32, whose noise below 1e-7 of the light, as rounding to float32 makes, counts as
            none. float64 at 1, floats with a tone curve, less than a cycle in the frame and nearly collinear tones are
            fitted in float64, many times slower; converting to float64 selects that fit.
        threads: maximum number, 1 to 1024, at most that of processors; the result does not depend on it.
        pooled: combine the columns of a frame first, weighted by brightness above the background, without saturated
            columns. Columns that show the tone at phases that cancel are flagged MODEL_MISFIT (16 rows of 16 columns
            are asked, in which the tone is half of what varies or more).

    Returns:
        :class:`ToneGain`.

    Raises:
        ValueError: an argument outside its range or of the wrong shape; the message names it.
    """
    # Most arguments need no conversion. By position: by name the call takes 3 us more.
    if type(camera) is Camera and camera.scan_axis == "y":
        results = _core.tone_gain_as_given(
            columns, camera._handle, frequency, method, waveform, duty, background, efficiency, threads, pooled
        )
        if results is not None:
            return ToneGain(*results)
    check_arguments(tone_gain, locals())
    array = as_columns(columns, scan_axis=camera.scan_axis)
    light = background_values(background, array)
    results = _core.tone_gain(
        array, camera._handle, frequency, method, waveform, duty, light, efficiency, threads, pooled
    )
    return ToneGain(*results)


def result_shape(columns: npt.NDArray[Any]) -> tuple[int, ...]:
    """Shape of a result with one value per column."""
    return columns.shape[:-2] + columns.shape[-1:] * (columns.ndim > 1)


def background_values(background: npt.ArrayLike | float, columns: npt.NDArray[Any]) -> Float64s:
    """The background in the form that the core reads: empty for none, one value, or one per column and frame."""
    if isinstance(background, float):
        return np.array((background,)) if background else _NO_BACKGROUND
    values = np.asarray(background, dtype=np.float64)
    if values.size == 1:
        return values.reshape(1)
    shape = result_shape(columns)
    try:  # broadcast_to takes 5 us
        return np.ascontiguousarray(values if values.shape == shape else np.broadcast_to(values, shape)).reshape(-1)
    except ValueError:
        raise ValueError(f"background: got shape {values.shape}, allowed: one value or {shape}") from None
