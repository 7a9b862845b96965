"""A rectangle of pixels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.checks import checked


class Region(NamedTuple):
    """A rectangle of pixels; equal to the tuple (x, y, width, height).

    Attributes:
        x, y: first column and first row; rows are in time order, unless a name contains ``stored``.
        width, height: columns and rows.
    """

    x: int
    y: int
    width: int
    height: int

    @property
    def right(self) -> int:
        """The first column behind it."""
        return self.x + self.width

    @property
    def bottom(self) -> int:
        """The first row behind it."""
        return self.y + self.height

    @property
    def pixels(self) -> int:
        return self.width * self.height

    @checked
    def shared_pixels(self, other: Region) -> int:
        """Number of pixels in the intersection."""
        across = min(self.right, other.right) - max(self.x, other.x)
        down = min(self.bottom, other.bottom) - max(self.y, other.y)
        return max(across, 0) * max(down, 0)

    @checked
    def touches(self, other: Region) -> bool:
        """They share a pixel or an edge."""
        return self.x <= other.right and other.x <= self.right and self.y <= other.bottom and other.y <= self.bottom

    @checked
    def hull(self, other: Region) -> Region:
        """The smallest region that contains both."""
        x, y = min(self.x, other.x), min(self.y, other.y)
        return Region(x, y, max(self.right, other.right) - x, max(self.bottom, other.bottom) - y)

    @checked
    def is_inside(self, columns: int, rows: int) -> bool:
        """It is not empty and inside of a picture."""
        inside = self.x >= 0 and self.y >= 0 and self.right <= columns and self.bottom <= rows
        return inside and self.width > 0 and self.height > 0

    @checked
    def moved_into(self, columns: int, rows: int) -> Region:
        """Cut to the size of a picture and moved inside."""
        width, height = min(self.width, columns), min(self.height, rows)
        return Region(min(max(self.x, 0), columns - width), min(max(self.y, 0), rows - height), width, height)

    @checked
    def cut(self, frames: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """A view of its pixels in (..., rows, columns)."""
        frames = np.asarray(frames)
        if frames.ndim < 2:
            raise ValueError(f"frames: got {frames.ndim} dimensions, allowed: (..., rows, columns)")
        return frames[..., self.y : self.bottom, self.x : self.right]
