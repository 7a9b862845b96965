"""Drawing of the catalogue, one panel per entry."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ocisac_fast.plots import BLACK, BLUE, RED
from studies.drawing import panels
from studies.limits.catalogue import Limit, Point

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ACROSS = 4
_DECADES = 10.0  # range of a panel below the largest error


def draw(path: str | os.PathLike[str], measured: Sequence[tuple[Limit, Sequence[Point]]]) -> None:
    """Draw all entries, four side by side: errors along the sweep.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        measured: entries and their points.
    """
    with panels(path, len(measured), _ACROSS, 11.6, 2.25, 0.5) as (figure, grid, _):
        for axes, (limit, points) in zip(grid, measured, strict=True):
            _draw_panel(axes, limit, points)
        _draw_legend(figure)


def _draw_panel(axes: Axes, limit: Limit, points: Sequence[Point]) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    x = np.array([point.x for point in points])
    plain, library, stated = (np.array([getattr(p, name) for p in points]) for name in ("plain", "library", "stated"))
    axes.set_yscale("log")
    if x.min() > 0.0 and x.max() > 20.0 * x.min():
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())
        if x.max() < 200.0 * x.min():
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    top = 2.0 * max(np.nanmax(plain), np.nanmax(library))
    values = np.concatenate([plain, library, stated[stated > 0.0]])
    bottom = max(0.5 * np.nanmin(values[values > 0.0]), top * 10.0**-_DECADES)
    axes.plot(x, np.maximum(stated, bottom), color=BLUE, lw=4.0, alpha=0.25, solid_capstyle="round")
    axes.plot(x, np.maximum(plain, bottom), "s-", color=RED, ms=5.0, lw=2.2)
    axes.plot(x, np.maximum(library, bottom), "-", color=BLUE, lw=1.2)
    for point in points:
        _draw_answer(axes, point, point.answered(limit), bottom)
    axes.set_ylim(bottom / 1.5, top)
    axes.set_title(limit.title, fontsize=9)
    axes.set_xlabel(limit.sweep, fontsize=8, labelpad=1.5)
    axes.set_ylabel(limit.error, fontsize=7.5, labelpad=1.5)
    axes.tick_params(labelsize=7)


def _draw_answer(axes: Axes, point: Point, answer: str, bottom: float) -> None:
    if np.isnan(point.library):
        axes.plot([point.x], [bottom], "D", color=BLUE, mfc="white", ms=5.0, clip_on=False)
        axes.annotate("NaN", (point.x, bottom), xytext=(5, 3), textcoords="offset points", fontsize=7, color=BLUE)
        return
    flagged = point.flags or point.lost
    look = "X" if answer == "silent" else "D" if flagged else "o"
    colour = BLACK if answer == "silent" else BLUE
    size = 6.0 if answer == "silent" else 4.5 if flagged else 3.5
    axes.plot([point.x], [max(point.library, bottom)], look, color=colour, mfc="white" if flagged else colour, ms=size)


def _draw_legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=RED, marker="s", lw=2.2, ms=5, label="plain method"),
        Line2D([], [], color=BLUE, marker="o", ms=4, label="library"),
        Line2D([], [], color=BLUE, marker="D", mfc="white", ms=5, label="library, flagged"),
        Line2D([], [], color=BLUE, lw=4.0, alpha=0.25, label="standard error that it reports"),
        Line2D([], [], color=BLACK, marker="X", ls="", ms=6, label="library, wrong and silent"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=9)
