"""Plot of one value over many recordings."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ocisac_fast.plots.picture import BLUE, ORANGE, picture


def plot_recordings(
    values: npt.NDArray[np.float64],
    spreads: npt.NDArray[np.float64],
    *,
    path: str | os.PathLike[str],
    label: str,
    flags: Mapping[str, int],
) -> None:
    """Plot a value of each recording with its standard error, and the number of recordings with each flag.

    Args:
        values, spreads: (recordings,) in the order of their paths; NaN: unknown.
        path: ``.png``, ``.pdf`` or ``.svg``.
        label: name of the value.
        flags: number of recordings by name of the flag.
    """
    names = sorted(flags, key=lambda name: flags[name])
    with picture(path, 9.0, 6.0 if names else 4.0) as figure:
        axes = figure.subplots(2 if names else 1, height_ratios=(2, 1) if names else None, squeeze=False)[:, 0]
        place = np.arange(1, len(values) + 1)
        errors = np.where(np.isfinite(spreads), spreads, 0.0)
        axes[0].errorbar(place, values, yerr=errors, fmt=".", color=BLUE, ms=4, lw=0.8)
        axes[0].set(xlabel="recording, in the order of paths", ylabel=label, title="Recordings, with standard errors")
        axes[0].xaxis.get_major_locator().set_params(integer=True)
        if names:
            axes[1].barh(names, [flags[name] for name in names], color=ORANGE)
            axes[1].set(xlabel="recordings", title="Flags")
            axes[1].xaxis.get_major_locator().set_params(integer=True)
