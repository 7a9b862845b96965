"""Common drawing of all studies."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ocisac_fast.files import atomic_path
from ocisac_fast.plots import picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@contextlib.contextmanager
def panels(
    path: str | os.PathLike[str], count: int, across: int, width: float, height: float, margin: float
) -> Iterator[tuple[Figure, list[Axes], list[Axes]]]:
    """A figure of ``count`` panels; yields it, the panels, and the free axes.

    Args:
        path: ``.png`` (256 colours), ``.pdf`` or ``.svg``.
        count, across: number of panels, and panels side by side.
        width: of the figure, inches.
        height: of a panel, inches.
        margin: added to the panels' heights, inches.
    """
    down = -(-count // across)
    with picture(path, width, height * down + margin) as figure:
        grid = list(figure.subplots(down, across, squeeze=False).flat)
        for axes in grid[count:]:
            axes.set_axis_off()
        yield figure, grid[:count], grid[count:]
    if str(path).lower().endswith(".png"):
        shrink(path)


def shrink(path: str | os.PathLike[str]) -> None:
    """Reduce to 256 colours, which suffice for lines and markers."""
    from PIL import Image

    with Image.open(path) as drawn:
        few = drawn.convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    with atomic_path(path) as temporary:
        few.save(temporary, format="PNG", optimize=True)
