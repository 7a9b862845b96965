"""The gain of a tone in light that varies along the column, and a test of constancy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s, as_columns
from ocisac_fast.core.checks import Threads, Within, checked
from ocisac_fast.core.results import Result
from ocisac_fast.tones.gain import background_values, result_shape


@dataclass(frozen=True, repr=False)
class VaryingToneGain(Result):
    """Gains of a tone that may vary, one value per column, in arrays like those of :class:`ocisac_fast.ToneGain`.

    Attributes:
        gain: the tone's amplitude, mean over the rows, over the mean light and the waveform's ratio at full depth.
        gain_std: its standard error, from the residual; several times that of ``tone_gain`` at few cycles, nearly equal
            at many.
        mean: mean light of the source, DN above dark and background.
        bias: gain of :func:`ocisac_fast.tone_gain` minus this one.
        bias_std: standard error of ``bias`` under the assumptions of ``tone_gain``.
        flags: uint32 masks of :class:`ocisac_fast.Flag`; MODEL_MISFIT if ``bias`` is above four ``bias_std`` and above
            the standard error of ``tone_gain``, or if the tone is out of step with the polynomials too, so that both
            gains are wrong.
    """

    gain: Float64s
    gain_std: Float64s
    mean: Float64s
    bias: Float64s
    bias_std: Float64s
    flags: npt.NDArray[np.uint32]


@checked
def varying_tone_gain(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: float,
    *,
    degree: Annotated[int, Within(0, 4)] = 2,
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    background: npt.ArrayLike = 0.0,
    threads: Threads = 1,
) -> VaryingToneGain:
    """Gain of a tone in light with a gradient, or of a frequency that drifts or differs slightly from the given one.

    ``tone_gain`` assumes a mean and a tone that are constant along the column. Otherwise its gain is biased by more
    than its standard error expresses. The model here, fitted by least squares, is

        y(n) = s(x) + sum_h [a_h(x) cos(2 pi h f T_r n) + b_h(x) sin(2 pi h f T_r n)],   x from -1 to 1 along the rows

    with polynomials s, a_h and b_h; the difference from ``tone_gain`` is returned too. The gain is exact for gradients
    of light and tone that are polynomials of the degree. With degree 2 a frequency error of half a cycle in the frame,
    or a drift of two cycles from the first row to the last, changes the gain by up to 1 %. Beyond that, and with less
    than two cycles in the frame, the gain is flagged but wrong.

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), as for ``tone_gain``.
        camera: row time, and where known the exposure, tone curve and dark level.
        frequency: of the light, Hz, above 0.
        degree: of the polynomials, 0 to 4.
        waveform: ``"tone"``, or ``"square"``: with its harmonics below half the row rate.
        duty: share of the period in which the square wave is bright, inside (0, 1).
        background: light of other origin, DN above dark: one value, or (columns,) or (frames, columns).
        threads: maximum number, 1 to 1024, at most that of processors; the result does not depend on it.

    Returns:
        :class:`VaryingToneGain`. Values that cannot be estimated are NaN and flagged: UNRESOLVABLE if the rows are too
        few for the model or its terms are collinear.
    """
    array = as_columns(columns, scan_axis=camera.scan_axis)
    results = _core.varying_tone_gain(
        columns=array,
        camera=camera._handle,
        frequency=frequency,
        degree=degree,
        waveform=waveform,
        duty=duty,
        background=background_values(background, array),
        threads=threads,
    )
    shape = result_shape(array)
    return VaryingToneGain(*(values.reshape(shape) for values in results))
