"""Plot of a calibration by pulses: rows over pulse widths, and the ramps with the exposure's box."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ocisac_fast.exposure.pulses import PulseCalibration, box_ramp
from ocisac_fast.plots.picture import BLACK, RED, FilePath, figure_of, panels, series

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_pulses(
    result: PulseCalibration,
    frequency: float,
    duties: Sequence[float],
    *,
    path: FilePath | None = None,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Plot the residuals of lit rows over the lamp's pulse width, and the measured ramps with the fitted box.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``; None: not written.
        ax: two axes to draw in; None: of a new figure.
        result: from ``calibrate_pulses``.
        frequency, duties: as given to it.
    """
    widths = np.asarray(duties) / frequency
    colours = [one["color"] for one in series(len(duties))]
    with panels(path, ax, (11.0, 4.2), (1, 2)) as (left, right):
        fitted = (widths + result.offset) / result.row_time
        for k, (rows, one) in enumerate(zip(result.rows, result.bands, strict=True)):
            colour = colours[k]
            left.errorbar(widths[k] * 1e3, rows - fitted[k], one.whole.std(), fmt="o", color=colour, capsize=3)
            offsets = np.linspace(-12, 12, one.ramps.shape[1])
            for side, style in ((0, "-"), (1, "--")):
                label = f"duty {duties[k]:.0%}, {('rise', 'fall')[side]}"
                right.plot(offsets, np.median(one.ramps[side::2], axis=0), style, color=colour, lw=1.0, label=label)
        box = result.exposure / result.row_time
        offsets = np.linspace(-12, 12, 481)
        right.plot(offsets, box_ramp(offsets, box, result.blur), color=BLACK, lw=1.6, label="box and blur")
        right.plot(offsets, np.clip(offsets / box + 0.5, 0, 1), color=RED, lw=1.0, ls=":", label="box alone")
        left.axhline(0.0, color=BLACK, lw=0.8)
        left.set(
            xlabel="pulse width / ms",
            ylabel="lit rows less fit",
            title=f"T_r = {result.row_time * 1e6:.2f} ± {result.row_time_std * 1e6:.2f} µs",
        )
        title = f"Ramps: a box of {box:.1f} rows, blurred by {result.blur:.1f}"
        right.set(xlabel="rows from half height", ylabel="light", xlim=(-9, 9), title=title)
        right.legend(fontsize=7)
    return figure_of(left)
