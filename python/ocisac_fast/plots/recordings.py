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
    with picture(path, 9.0, 6.0) as figure:
        top, bottom = figure.subplots(2, height_ratios=(2, 1))
        place = np.arange(1, len(values) + 1)
        errors = np.where(np.isfinite(spreads), spreads, 0.0)
        top.errorbar(place, values, yerr=errors, fmt=".", color=BLUE, ms=4, lw=0.8)
        top.set(xlabel="recording, in the order of paths", ylabel=label, title="Recordings, with standard errors")
        names = sorted(flags, key=lambda name: flags[name])
        bottom.barh(names, [flags[name] for name in names], color=ORANGE)
        bottom.set(xlabel="recordings", title="Flags" if names else "Flags: none")
