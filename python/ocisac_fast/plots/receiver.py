"""Plot of the combined column of a frame with the detected chips."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.core.arrays import in_time_order
from ocisac_fast.plots.picture import BLUE, ORANGE, RED, FilePath, figure_of, panels
from ocisac_fast.receiver.blind import Received

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_received(
    frame: npt.NDArray[Any],
    camera: Camera,
    *,
    received: Received,
    path: FilePath | None = None,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Plot the combined column of a frame with the detected chips and levels.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``; None: not written.
        ax: axes to draw in, one below the other, each with its share of the rows; None: up to four of a new figure.
        frame: (height, width) or (height, width, colours), stored values.
        camera: as for ``receive``.
        received: result of ``receive`` for the frame.
    """
    rows = frame.shape[1 if camera.scan_axis.endswith("x") else 0]
    lines = min(4, max(1, rows // 200)) if ax is None else np.asarray(ax, dtype=object).size
    edges = np.linspace(0, rows, lines + 1)
    found = f"{len(received.bits)} chips of {received.rows_per_chip:.4g} rows" if received.bits else "no chips found"
    with panels(path, ax, (11.0, 1.2 + 1.5 * lines), (lines, 1)) as every:
        for axes, first, last in zip(every, edges[:-1], edges[1:], strict=True):
            draw_chips(frame, camera, axes=axes, received=received, first=first, last=last)
        every[0].set_title(f"Combined column: {found}")
        every[-1].set_xlabel("row")
    return figure_of(every[0])


def draw_chips(
    frame: npt.NDArray[Any], camera: Camera, *, axes: Axes, received: Received, first: float, last: float
) -> None:
    """Draw rows ``first`` to ``last`` of the combined column, the threshold, and a 0 or 1 over every chip."""
    stored = frame[..., received.colour] if frame.ndim == 3 else frame
    light = linear_light(in_time_order(stored, camera.scan_axis), camera)
    used = received.weights if received.weights.sum() > 0.0 else np.full(light.shape[1], 1.0 / light.shape[1])
    signal = light @ used
    axes.plot(np.arange(signal.size), signal, color=BLUE, lw=1.1)
    span = float(np.ptp(signal)) or 1.0
    starts = received.phase + np.arange(len(received.bits) + 1) * received.rows_per_chip
    if received.bits:
        middle = received.levels.mean(axis=0)
        axes.step(starts, np.append(middle, middle[-1]), where="post", color=RED, lw=1.0, ls="--")
    for bit, begin, end in zip(received.bits, starts[:-1], starts[1:], strict=True):
        centre = 0.5 * (begin + end)
        if bit == "1":
            axes.axvspan(begin, end, color=ORANGE, alpha=0.18, lw=0.0)
        if first <= centre < last:
            axes.text(centre, signal.max() + 0.06 * span, bit, ha="center", va="bottom", fontsize="x-small")
    axes.grid(False)
    axes.set(xlim=(first, last), ylim=(signal.min() - 0.08 * span, signal.max() + 0.3 * span), ylabel="light / DN")
