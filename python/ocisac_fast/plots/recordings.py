"""Plot of one value over many recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ocisac_fast.plots.picture import BLUE, ORANGE, FilePath, figure_of, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_recordings(
    values: npt.NDArray[np.float64],
    spreads: npt.NDArray[np.float64],
    *,
    label: str,
    flags: Mapping[str, int],
    path: FilePath | None = None,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Plot a value of each recording with its standard error, and the number of recordings with each flag.

    Args:
        values, spreads: (recordings,) in the order of their paths; NaN: unknown.
        path: ``.png``, ``.pdf`` or ``.svg``; None: not written.
        ax: one, or with flags two, axes to draw in; None: of a new figure.
        label: name of the value.
        flags: number of recordings by name of the flag.
    """
    from matplotlib.ticker import MaxNLocator

    names = sorted(flags, key=lambda name: flags[name])
    ratios = {"height_ratios": (2, 1)} if names else {}
    with panels(path, ax, (9.0, 6.0 if names else 4.0), (1 + bool(names), 1), **ratios) as axes:
        place = np.arange(1, len(values) + 1)
        errors = np.where(np.isfinite(spreads), spreads, 0.0)
        axes[0].errorbar(place, values, yerr=errors, fmt=".", color=BLUE, ms=4, lw=0.8)
        axes[0].set(xlabel="recording, in the order of paths", ylabel=label, title="Recordings, with standard errors")
        axes[0].xaxis.set_major_locator(MaxNLocator(integer=True))
        if names:
            axes[1].barh(names, [flags[name] for name in names], color=ORANGE)
            axes[1].set(xlabel="recordings", title="Flags")
            axes[1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure_of(axes[0])
