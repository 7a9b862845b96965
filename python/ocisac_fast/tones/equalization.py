"""Compensation of the exposure's low-pass response in the columns of a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypedDict, TypeVar, Unpack, overload

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s, as_columns, in_time_order
from ocisac_fast.core.checks import Threads, checked
from ocisac_fast.core.results import Result

Light = TypeVar("Light", Float64s, npt.NDArray[np.float32])


@dataclass(frozen=True, slots=True, repr=False)
class EqualizerReport(Result):
    """Limits of a result of :func:`equalize`.

    Attributes:
        frequencies_lost: (bands, 2), Hz; ascending lower and upper ends of the bands restored to less than half of
            their amplitude (mean over the columns). The last band ends at infinity: frequencies above half the row rate
            are lost.
        noise_gain: RMS noise of the result over that of the rows, away from the ends; one value per column.
        noise: RMS noise of the rows assumed by ``"wiener"``, in linear light; one value per column, 0 for
            ``"inverse"``.
        rows_extrapolated: number of rows at the end, half an exposure, whose light no row integrated completely.
    """

    frequencies_lost: Float64s
    noise_gain: Float64s
    noise: Float64s
    rows_extrapolated: int


class _Options(TypedDict, total=False):
    method: Literal["inverse", "wiener"]
    noise: npt.ArrayLike | None
    max_boost: float
    threads: int


@overload
def equalize(
    columns: npt.ArrayLike,
    camera: Camera,
    *,
    out: None = ...,
    report: Literal[False] = ...,
    **options: Unpack[_Options],
) -> Float64s: ...
@overload
def equalize(
    columns: npt.ArrayLike, camera: Camera, *, out: Light, report: Literal[False] = ..., **options: Unpack[_Options]
) -> Light: ...
@overload
def equalize(
    columns: npt.ArrayLike, camera: Camera, *, out: None = ..., report: Literal[True], **options: Unpack[_Options]
) -> tuple[Float64s, EqualizerReport]: ...
@overload
def equalize(
    columns: npt.ArrayLike, camera: Camera, *, out: Light, report: Literal[True], **options: Unpack[_Options]
) -> tuple[Light, EqualizerReport]: ...
@checked
def equalize(
    columns: npt.ArrayLike,
    camera: Camera,
    *,
    method: Literal["inverse", "wiener"] = "inverse",
    noise: npt.ArrayLike | None = None,
    max_boost: float = 10.0,
    threads: Threads = 1,
    out: npt.NDArray[Any] | None = None,
    report: bool = False,
) -> npt.NDArray[Any] | tuple[npt.NDArray[Any], EqualizerReport]:
    """Light at the end of every row's exposure, from rows that hold its mean over the exposure.

    The least-squares line of each column is subtracted. The rest is extended beyond its ends by linear prediction and
    multiplied in the frequency domain by

        G(f) = H / max(|H|^2 + noise^2 / S(f), 1 / max_boost^2) * exp(j pi f T_e),   H = sinc(f T_e)

    and gets its line back, half an exposure earlier. For ``"inverse"`` the noise term is 0, so that G = 1/H wherever
    |H| >= 1/max_boost, and G falls to 0 at the nulls of H. For ``"wiener"`` a polynomial that leaves nothing but noise,
    or tones, are taken off as well and come back as their light; S(f), the light's power density in what is left, and
    the noise are estimated together (docs/explanation/tones.md). Constants and ramps are exact where the exposure is
    shorter than the frame.

    The result estimates the light at t_n; where it changes within a row, ``"wiener"`` estimates its mean over a row
    time about t_n.

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), rows in time order; finite.
        camera: row time, exposure and tone curve. An exposure of 0 returns the light unchanged; an exposure of all rows
            or more returns the mean of the column.
        method: ``"inverse"`` or ``"wiener"``.
        noise: RMS noise of a row for ``"wiener"``, in linear light (DN above dark), 0 or above: a scalar or one value
            a column ((columns,) or (frames, columns)); None: estimated with the light's spectrum, for each column.
            0, or fewer than 16 rows, gives the inverse.
        max_boost: largest factor at any frequency, 1 to 1e6: 20 log10(max_boost) dB.
        threads: number of threads, 1 to 1024; the result does not depend on it.
        out: float64 or float32 array of the same shape for the result; it may be ``columns`` itself. With float32 all
            is computed in float32, which is exact to 1e-5 of a column's largest light (at ``max_boost`` 10).
        report: also return an :class:`EqualizerReport`.

    Returns:
        ``out``, or a float64 array of the same shape: linear light above the dark level on the scale of DN, row n at
        the time n T_r when its exposure ends. The last half exposure is extrapolated. With ``report`` a tuple (array,
        report).

    Raises:
        ValueError: no exposure in ``camera``, columns that are not finite, an argument outside its range or shape.
    """
    array = as_columns(columns, scan_axis=camera.scan_axis)
    stored = np.empty(np.shape(columns)) if out is None else out
    if stored.shape != np.shape(columns):
        raise ValueError(f"out: got shape {stored.shape}, allowed: {np.shape(columns)}, the shape of columns")
    result = in_time_order(stored, camera.scan_axis)
    if np.may_share_memory(array, result):
        array = array.copy()
    per_column = (*array.shape[:-2], *array.shape[-1:]) if array.ndim > 1 else ()
    values = _noise(noise, per_column)
    lost, gain, used = _core.equalize(array, camera._handle, method, values, max_boost, threads, result)
    if not report:
        return stored
    rows = array.shape[0 if array.ndim < 3 else 1]
    extrapolated = min(rows, int(np.ceil(0.5 * (camera.exposure or 0.0) / camera.row_period)))
    return stored, EqualizerReport(lost, gain.reshape(per_column), used.reshape(per_column), extrapolated)


@checked
def lost_frequencies(camera: Camera, *, max_boost: float = 10.0) -> Float64s:
    """Bands that ``equalize(..., method="inverse")`` restores to less than half of their amplitude.

    These are |sinc(f T_e)| < 1 / (sqrt(2) max_boost), and everything above half the row rate.

    Args:
        camera: row time and exposure.
        max_boost: 1 to 1e6.

    Returns:
        (bands, 2) float64, Hz, ascending; the last band ends at infinity.

    Raises:
        ValueError: no exposure in ``camera``, or ``max_boost`` outside its range.
    """
    return _core.lost_frequencies(camera._handle, max_boost)


def _noise(noise: npt.ArrayLike | None, per_column: tuple[int, ...]) -> Float64s:
    """The noise in the form that the core reads: empty for None, one value, or one per column."""
    if noise is None:
        return np.empty(0)
    values: npt.NDArray[Any] = np.asarray(noise, dtype=np.float64)
    if values.ndim == 0:
        return values.reshape(1)
    if values.shape not in {per_column, per_column[-1:]}:
        raise ValueError(f"noise: got shape {values.shape}, allowed: a scalar or {per_column}, one value a column")
    return np.broadcast_to(values, per_column).ravel()
