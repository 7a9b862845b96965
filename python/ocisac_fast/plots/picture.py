"""Common style of all plots, drawn without a display (matplotlib).

Colours are those of Okabe and Ito, suitable for colour-blind readers.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ocisac_fast.core.checks import shown
from ocisac_fast.files import FileError, atomic_path
from ocisac_fast.files.extras import matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FilePath = str | os.PathLike[str]

BLACK, ORANGE, SKY, GREEN, BLUE, RED, PURPLE = (
    "#222222",
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#0072B2",
    "#D55E00",
    "#CC79A7",
)
_SERIES = (BLUE, ORANGE, GREEN, SKY, PURPLE, RED, BLACK)
_LINES = ("-", "--", "-.", ":")
_SUFFIXES = (".png", ".pdf", ".svg")
CREATOR = "ocisac_fast"  # stated by files
_LOOK: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": "medium",
    "axes.titleweight": "bold",
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.12,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": "small",
    "svg.hashsalt": "ocisac",
}


@contextlib.contextmanager
def picture(path: FilePath, width: float, height: float) -> Iterator[Figure]:
    """A figure of the given size in inches in the package's style, written atomically: ``.png``, ``.pdf`` or ``.svg``.

    Raises:
        FileError: another suffix, or matplotlib is missing.
    """
    with _figure(path, (width, height)) as figure:
        yield figure


@contextlib.contextmanager
def panels(
    path: FilePath | None,
    ax: Axes | Sequence[Axes] | None,
    size: tuple[float, float],
    grid: tuple[int, int] = (1, 1),
    **arrangement: Any,
) -> Iterator[list[Axes]]:
    """Axes of a plot in the package's style, row by row.

    Args:
        path: of the file that is written atomically, ``.png``, ``.pdf`` or ``.svg``; None: none.
        ax: axes to draw in, as many as the grid has; None: those of a new figure, which is pyplot's where no file is
            written, so that notebooks show it.
        size: inches of a new figure.
        grid: rows and columns of axes.
        arrangement: as for ``Figure.subplots``.

    Raises:
        FileError: another suffix, or matplotlib is missing.
        ValueError: another number of axes.
    """
    if ax is None:
        with _figure(path, size) as figure:
            yield list(figure.subplots(*grid, squeeze=False, **arrangement).flat)
        return
    drawn: list[Axes] = list(np.ravel(np.asarray(ax, dtype=object)))
    if len(drawn) != grid[0] * grid[1]:
        raise ValueError(f"ax: got {len(drawn)} axes, allowed: {grid[0] * grid[1]}")
    with _figure(path, size, figure_of(drawn[0])):
        yield drawn


@contextlib.contextmanager
def _figure(path: FilePath | None, size: tuple[float, float], figure: Figure | None = None) -> Iterator[Figure]:
    """A figure, or the given one, in the package's style; afterwards it is written to ``path``."""
    if path is not None and (suffix := Path(path).suffix.lower()) not in _SUFFIXES:
        raise FileError(f"{os.fspath(path)}: suffix: got {shown(suffix)}, allowed: {', '.join(_SUFFIXES)}")
    # A file's look does not depend on a matplotlibrc, which the working folder may hold; a notebook's does.
    base = ["default"] if path is not None and figure is None else []
    with matplotlib("matplotlib.style").context([*base, _LOOK]):
        if figure is None and path is None:
            figure = matplotlib("matplotlib.pyplot").figure(figsize=size, layout="constrained")
        elif figure is None:
            figure = matplotlib("matplotlib.figure").Figure(figsize=size, layout="constrained")
        is_interactive = matplotlib().is_interactive()  # notebooks say so with their first figure
        yield figure
        if path is not None:
            with atomic_path(path) as temporary:
                drawn = io.BytesIO()  # matplotlib's errors of a full disk are not the system's
                figure.savefig(drawn, dpi=120, format=temporary.suffix[1:], metadata={"Creator": CREATOR})
                temporary.write_bytes(drawn.getvalue())
    matplotlib().interactive(is_interactive)


def figure_of(axes: Axes) -> Figure:
    """The figure that holds the axes."""
    return cast("Figure", axes.figure)


def series(count: int) -> list[dict[str, Any]]:
    """Colour and line of ``count`` series that differ, in print too: seven colours; more are shades, dark to light."""
    if count <= len(_SERIES):
        return [{"color": colour, "ls": "-"} for colour in _SERIES[:count]]
    from matplotlib import colormaps

    shades = colormaps["viridis"](np.linspace(0.0, 0.92, count))
    return [{"color": tuple(shade), "ls": _LINES[k % len(_LINES)]} for k, shade in enumerate(shades)]
