"""Drawing of the chart."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ocisac_fast.plots import BLACK, BLUE, GREEN, ORANGE, PURPLE, RED, SKY
from studies.chart.panels import COST, ERROR, FAST_TONE, Measured, Point, pareto_front
from studies.chart.scenes import Scene
from studies.drawing import panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ACROSS = 4
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
_SERIES = {
    "matrix product float32": ("s", RED),
    "matrix product float64": ("^", GREEN),
    "kernel 13 bits": ("o", BLUE),
    "kernel 26 bits": ("D", ORANGE),
}
_SIZES = {"*": 9.0}


def draw(path: str | os.PathLike[str], measured: Measured) -> None:
    """Draw a panel for each scene, four side by side; a legend in the free place, that of the added rows in its own.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        measured: scenes and their points.
    """
    from matplotlib.lines import Line2D

    with panels(path, len(measured) + 1, _ACROSS, 13.0, 3.1, 0.3) as (_, grid, __):
        for axes, (scene, points) in zip(grid, measured, strict=False):
            _draw_panel(axes, scene, points)
        handles: list[Any] = [_handle(family, *look) for family, look in _LOOKS.items()]
        handles.append(_handle("hollow: float32", "o", BLACK, "white"))
        handles.append(Line2D([], [], color=BLUE, lw=0.7, label="line: rows added, D = 1, 2, 4, 8"))
        handles.append(Line2D([], [], color=BLACK, lw=3.5, alpha=0.18, label="Pareto front"))
        grid[-1].set_axis_off()
        grid[-1].legend(handles=handles, loc="upper left", fontsize=9, title="gain methods", alignment="left")


def _draw_panel(axes: Axes, scene: Scene, points: Sequence[Point]) -> None:
    looks = _SERIES if scene is FAST_TONE else _LOOKS
    axes.loglog()
    axes.set_axisbelow(True)
    axes.grid(True, which="major", color="#e4e4e4", lw=0.6)
    front = pareto_front(points)
    axes.step([p.cost for p in front], [p.error for p in front], where="post", color=BLACK, lw=3.5, alpha=0.18)
    for series in {point.method.series for point in points if point.method.series}:
        joined = sorted((p for p in points if p.method.series == series), key=lambda p: p.cost)
        colour = looks[joined[0].family][1]
        axes.plot([p.cost for p in joined], [p.error for p in joined], color=colour, lw=0.7, alpha=0.6)
    for point in points:
        marker, colour = looks[point.family]
        face = "white" if point.method.precision == "float32" else colour
        size = _SIZES.get(marker, 5.5)
        axes.plot([point.cost], [point.error], marker, color=colour, mfc=face, mew=1.0, ms=size, alpha=0.9)
        text = f"{point.method.row_group}" if scene is FAST_TONE else point.method.label
        axes.annotate(text, (point.cost, point.error), (0, 5), textcoords="offset points", ha="center", fontsize=7.5)
    axes.set_title(scene.title, fontsize=10)
    axes.set_xlabel(COST, fontsize=8.5)
    axes.set_ylabel(ERROR, fontsize=8.5)
    axes.tick_params(labelsize=8)
    if scene is FAST_TONE:
        axes.legend(handles=[_handle(name, *look) for name, look in looks.items()], fontsize=7.5)
    axes.axvline(1.0, color=BLACK, lw=1.0, ls=":")  # reading
    axes.axhline(1.0, color=BLACK, lw=1.0, ls=":")  # the Cramér-Rao bound
    axes.set_xlim(left=0.75)
    axes.set_ylim(0.7, max(2.0 if scene is FAST_TONE else 12.0, axes.get_ylim()[1]))


def _handle(label: str, marker: str, colour: str, face: str = "") -> Any:
    from matplotlib.lines import Line2D

    size = _SIZES.get(marker, 5.5)
    return Line2D([], [], marker=marker, color=colour, mfc=face or colour, ls="", ms=size, label=label)
