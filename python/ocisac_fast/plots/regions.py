"""Plots of a frame with the boxes of lights or of sensed regions."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.lights.sources import LightSource
from ocisac_fast.plots.picture import BLUE, GREEN, ORANGE, PURPLE, SKY, FilePath, panels
from ocisac_fast.sensing.region import SensedRegion

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@contextlib.contextmanager
def _over_frame(path: FilePath | None, ax: Axes | None, frame: npt.NDArray[Any]) -> Iterator[Axes]:
    """Axes in stored pixels over the frame."""
    rows, columns = frame.shape
    step = max(1, max(rows, columns) // 2000)
    with panels(path, ax, (9.0, float(np.clip(9.0 * rows / columns, 3.0, 12.0)))) as (axes,):
        extent = (0, columns, rows, 0)
        axes.imshow(frame[::step, ::step], cmap="gray", extent=extent, aspect="equal", interpolation="nearest")
        axes.set_xlabel("x / pixels")
        axes.set_ylabel("y / pixels")
        yield axes


def plot_sources(
    frame: npt.NDArray[Any],
    camera: Camera,
    *,
    sources: list[LightSource],
    path: FilePath | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Plot a frame with box, number and frequency of every detected light; reflections are dashed.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), axes to draw in; None: none, those of a new figure.
        frame: (height, width), stored values.
        camera: as for ``detect_sources``.
        sources: result of ``detect_sources`` for the frame.
    """
    from matplotlib.patches import Rectangle

    with _over_frame(path, ax, frame) as axes:
        for index, source in enumerate(sources):
            colour = ORANGE if source.reflection_of is None else BLUE
            style = "-" if source.reflection_of is None else "--"
            corner = (source.x, source.y)
            axes.add_patch(Rectangle(corner, source.width, source.height, fill=False, ec=colour, ls=style, lw=1.2))
            text = f"{index}: {source.frequency:.4g} {_unit(camera)}"
            axes.annotate(text, corner, (0, 3), textcoords="offset points", color=colour, fontsize=8)
    return axes


def plot_regions(
    frame: npt.NDArray[Any],
    camera: Camera,
    *,
    regions: Sequence[SensedRegion],
    path: FilePath | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Plot a frame with box and kind of every region, and an arrow for a known motion.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), axes to draw in; None: none, those of a new figure.
        frame: (height, width), stored values.
        camera: as for ``sense``.
        regions: result of ``sense`` for the frame.
    """
    with _over_frame(path, ax, frame) as axes:
        for index, region in enumerate(regions):
            _draw_region(axes, index, camera, region)
        axes.grid(False)
    return axes


def _unit(camera: Camera) -> str:
    return "cycles per row" if camera.row_time is None else "Hz"


def _draw_region(axes: Axes, index: int, camera: Camera, region: SensedRegion) -> None:
    from matplotlib.patches import Rectangle

    colour = {"light": ORANGE, "moving": SKY, "still": GREEN}.get(region.kind, PURPLE)
    style = "--" if region.flags & (Flag.AMBIGUOUS_KIND | Flag.AMBIGUOUS_MOTION) else "-"
    corner = (region.x, region.y)
    axes.add_patch(Rectangle(corner, region.width, region.height, fill=False, ec=colour, ls=style, lw=1.6))
    frequency = region.frequency if region.kind == "light" else region.motion_frequency
    lines = [
        f"{index}: {region.kind}, {frequency:.5g} {_unit(camera)}",
        f"gain {region.gain:.4f} ± {region.gain_std:.1g}",
    ]
    if np.isfinite(region.speed) and region.kind == "moving":
        lines.append(f"{region.speed:.4g} m/s")
    box = {"boxstyle": "square,pad=0.2", "fc": "black", "ec": "none", "alpha": 0.6}
    at = (region.x + 0.02 * region.width, region.y + 0.02 * region.height)
    axes.annotate(
        "\n".join(lines), at, (3, -3), textcoords="offset points", color=colour, fontsize=8, va="top", bbox=box
    )
    if region.kind == "moving" and region.direction:
        x, y = region.x + 0.5 * region.width, region.y + 0.6 * region.height
        along = abs(region.cycles_per_column) <= 4.0 * region.cycles_per_column_std
        downwards = along != camera.scan_axis.endswith("x")
        turn = -1 if along and camera.scan_axis.startswith("-") else 1
        across, down = (0.0, 0.25 * region.height) if downwards else (0.25 * region.width, 0.0)
        across, down = across * region.direction * turn, down * region.direction * turn
        axes.annotate(
            "",
            (x + across, y + down),
            (x - across, y - down),
            arrowprops={"arrowstyle": "->", "color": colour, "lw": 2.0},
        )
