"""The gain of a tone while light and tone vary along the column, and whether they do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_columns
from ocisac_fast.core.checks import checked
from ocisac_fast.tones.gain import FloatArray, background_values, result_shape


@dataclass(frozen=True)
class VaryingToneGain:
    """Gains of a tone that may vary, one value a column, in arrays like those of :class:`ocisac_fast.ToneGain`.

    Attributes:
        gain: the tone's amplitude, mean over the rows, over the mean light and the waveform's ratio at full depth.
        gain_std: its standard error, from the residual; several times that of ``tone_gain`` at few cycles, nearly the
            same at many.
        mean: mean light of the source, DN above dark and background.
        bias: gain of :func:`ocisac_fast.tone_gain` less this one.
        bias_std: standard error of ``bias`` where the assumptions of ``tone_gain`` hold.
        flags: uint32 masks of :class:`ocisac_fast.Flag`; MODEL_MISFIT where ``bias`` is above four ``bias_std`` and
            above the standard error that ``tone_gain`` gives.
    """

    gain: FloatArray
    gain_std: FloatArray
    mean: FloatArray
    bias: FloatArray
    bias_std: FloatArray
    flags: npt.NDArray[np.uint32]


@checked
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
    """Gain of a tone in light with a gradient, or of a frequency that drifts or is not quite the given one.

    ``tone_gain`` assumes a mean and a tone that stay the same down the column. Where they do not, its gain is biased
    and its standard error does not know it. This fits, by least squares,

        y(n) = s(x) + sum_h [a_h(x) cos(2 pi h f T_r n) + b_h(x) sin(2 pi h f T_r n)],   x from -1 to 1 along the rows

    with polynomials s, a_h and b_h, and tells by how much ``tone_gain`` differs. A gradient of the light, of the tone
    or of both is exact while it is a polynomial of the degree. Of frequencies, degree 2 follows half a cycle in the
    frame of error, or a drift of two from its first row to its last, to 1 % of the gain; beyond, and with less than two
    cycles in the frame, it is flagged but not right.

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), as for ``tone_gain``.
        camera: row time, and where known the exposure, tone curve and dark level.
        frequency: of the light, Hz, above 0.
        degree: of the polynomials, 0 to 4.
        waveform: ``"tone"``, or ``"square"``: with its harmonics below half the row rate.
        duty: share of the period in which the square wave is bright, inside (0, 1).
        background: light that is not the source's, DN above dark: one value, or (columns,) or (frames, columns).
        threads: to use at most, 1 to 1024, and never more than processors; the result does not depend on it.

    Returns:
        :class:`VaryingToneGain`. Values that cannot be told are NaN and flagged: UNRESOLVABLE where the rows are too
        few for the model or do not tell its parts apart.

    Raises:
        ValueError: an argument outside its range or of the wrong shape; the message names it.
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
