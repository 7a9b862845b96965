"""Drawing of all panels."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ocisac_fast.plots import BLACK, BLUE, GREEN, ORANGE, PURPLE, RED, SKY
from studies.chart.measuring import Point, pareto_front
from studies.chart.panels import Panel
from studies.drawing import panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ACROSS = 3
_FLOOR = 1e-16  # drawn for an error of 0
_LOOKS: dict[str, tuple[str, str]] = {
    "rounded bin (paper)": ("o", RED),
    "windowed DFT: Hann": ("s", SKY),
    "windowed DFT: flat-top": ("D", SKY),
    "zero-padded DFT": ("^", PURPLE),
    "interpolated DFT": ("v", PURPLE),
    "DTFT": ("X", GREEN),
    "Goertzel": ("P", GREEN),
    "fit": ("o", ORANGE),
    "fit with harmonics": ("*", BLUE),
}
_OTHERS = [("o", BLUE), ("s", RED), ("^", GREEN), ("D", ORANGE), ("v", PURPLE), ("P", SKY), ("X", BLACK)]
_SIZES = {"*": 9.0}


def draw(path: str | os.PathLike[str], measured: Sequence[tuple[Panel, Sequence[Point]]]) -> None:
    """Draw all panels, three side by side; panels without labels share one legend.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        measured: panels and their points.
    """
    with panels(path, len(measured), _ACROSS, 10.4, 3.1, 0.3) as (figure, grid, free):
        for axes, (panel, points) in zip(grid, measured, strict=True):
            _draw_panel(axes, panel, points)
        _draw_legend(figure, free, measured)


def _draw_panel(axes: Axes, panel: Panel, points: Sequence[Point]) -> None:
    looks = _looks(points)
    axes.loglog()
    axes.set_axisbelow(True)
    axes.grid(True, which="major", color="#e4e4e4", lw=0.6)
    if panel.limits:
        _draw_limits(axes)
    front = pareto_front(points)
    for problem in dict.fromkeys(p.problem for p in front):
        own = [p for p in front if p.problem == problem]
        axes.step([p.cost for p in own], [_height(p) for p in own], where="post", color=BLACK, lw=3.5, alpha=0.18)
    for series in {point.series for point in points if point.series}:
        joined = sorted((p for p in points if p.series == series), key=lambda p: p.cost)
        axes.plot(
            [p.cost for p in joined], [_height(p) for p in joined], color=looks[joined[0].family][1], lw=0.7, alpha=0.6
        )
    for point in points:
        if math.isfinite(point.error):
            _draw_point(axes, point, *looks[point.family])
    _label(axes, points, looks, panel.labelled)
    axes.set_title(panel.title, fontsize=10)
    axes.set_xlabel(panel.cost, fontsize=8.5)
    axes.set_ylabel(panel.error, fontsize=8.5)
    axes.tick_params(labelsize=8)
    if panel.limits:
        axes.set_xlim(left=0.75)
        axes.set_ylim(0.7, max(12.0, axes.get_ylim()[1]))
    else:
        _plain_ticks(axes)
        axes.margins(0.12)


def _plain_ticks(axes: Axes) -> None:
    """Use numbers instead of powers if an axis spans less than two decades."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        if high < 100.0 * low:
            subs = (1.0, 2.0, 3.0, 5.0) if high > 3.0 * low else (1.0, 1.1, 1.2, 1.3, 1.5, 1.7, 2.0, 2.5)
            axis.set_major_locator(LogLocator(subs=subs))
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axis.set_minor_formatter(NullFormatter())


def _looks(points: Sequence[Point]) -> dict[str, tuple[str, str]]:
    families = dict.fromkeys(point.family for point in points)
    others = [family for family in families if family not in _LOOKS]
    return {**_LOOKS, **{family: _OTHERS[k % len(_OTHERS)] for k, family in enumerate(others)}}


def _height(point: Point) -> float:
    return max(point.error, _FLOOR)


def _draw_limits(axes: Axes) -> None:
    axes.axvline(1.0, color=BLACK, lw=1.0, ls=":")
    axes.axhline(1.0, color=BLACK, lw=1.0, ls=":")
    axes.annotate("reading", (1.0, 0.97), xycoords=("data", "axes fraction"), xytext=(3, 0),
                  textcoords="offset points", rotation=90, va="top", fontsize=7.5)  # fmt: skip
    axes.annotate("Cramér-Rao bound", (0.98, 1.0), xycoords=("axes fraction", "data"), xytext=(0, -3),
                  textcoords="offset points", ha="right", va="top", fontsize=7.5)  # fmt: skip


def _draw_point(axes: Axes, point: Point, marker: str, colour: str) -> None:
    face = "white" if point.precision == "float32" else colour
    axes.plot(
        [point.cost], [_height(point)], marker, color=colour, mfc=face, mew=1.0, ms=_SIZES.get(marker, 5.5), alpha=0.9
    )


def _label(axes: Axes, points: Sequence[Point], looks: dict[str, tuple[str, str]], legend: bool) -> None:
    """Label the points; families by colour, in a small legend if one has several points."""
    families = list(looks)
    for k, point in enumerate(points):
        below = (k + families.index(point.family)) % 2 == 1 and bool(point.series) and legend
        axes.annotate(
            point.label,
            (point.cost, _height(point)),
            xytext=(0, -5 if below else 5),
            textcoords="offset points",
            ha="center",
            va="top" if below else "bottom",
            fontsize=7.5,
            color=looks[point.family][1],
        )
    several = [family for family in looks if sum(point.family == family for point in points) > 1]
    if legend and several:
        handles = [_handle(family, *looks[family]) for family in several]
        axes.legend(handles=handles, fontsize=7.5, loc="best", handletextpad=0.3, borderaxespad=0.1)


def _handle(label: str, marker: str, colour: str, hollow: bool = False, **look: Any) -> Any:
    from matplotlib.lines import Line2D

    face = "white" if hollow else colour
    return Line2D([], [], marker=marker, color=colour, mfc=face, ls="", ms=_SIZES.get(marker, 5.5), label=label, **look)


def _draw_legend(figure: Figure, free: Sequence[Axes], measured: Sequence[tuple[Panel, Sequence[Point]]]) -> None:
    """Draw the legend of the panels without labels: in a free panel, else above all."""
    from matplotlib.lines import Line2D

    shared = [point for panel, points in measured if not panel.labelled for point in points]
    if not shared:
        return
    looks = _looks(shared)
    families = [family for family in looks if any(point.family == family for point in shared)]
    handles: list[Any] = [_handle(family, *looks[family]) for family in families]
    handles.append(_handle("hollow: float32", "o", BLACK, hollow=True))
    handles.append(Line2D([], [], color=BLUE, lw=0.7, label="line: rows added, D = 1, 2, 4, 8"))
    handles.append(Line2D([], [], color=BLACK, lw=3.5, alpha=0.18, label="Pareto front"))
    if free:
        free[0].legend(handles=handles, loc="upper left", fontsize=9, title="gain methods", alignment="left")
    else:
        figure.legend(handles=handles, loc="outside upper center", ncols=4, fontsize=9)
