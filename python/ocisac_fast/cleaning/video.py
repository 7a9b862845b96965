"""Removal of bands from the frames of a video: light and shares are carried from frame to frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NoReturn

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning.bands import (
    CleanedFrames,
    CleaningOptions,
    Task,
    collected,
    colours_of,
    estimate_of,
    finished,
    stacked,
)
from ocisac_fast.core.checks import checked


class VideoCleaner:
    """:func:`remove_bands` for the frames of a video, one after the other.

    The first frame is cleaned as a picture. In the following ones a tone keeps its frequency, which becomes more
    precise from frame to frame, and gets its phase from the frame; other lights are found in each frame. Shares move
    with the picture, and become the mean of several estimates. A tone slower than 128 rows per cycle is compared with
    up to 7 frames before, in which the picture stays and the phase advances; until the third frame of a film it is
    left. A frame for which that fails, such as the first of another scene, is cleaned as a picture again.

    Args:
        camera, model, keep, level, options: as in :func:`remove_bands`.
    """

    @checked
    def __init__(
        self,
        camera: Camera,
        *,
        model: Literal["auto", "tone", "chips", "rows"] = "auto",
        keep: Literal["picture", "bands"] = "picture",
        level: Literal["auto", "full", "mean"] = "auto",
        options: CleaningOptions | None = None,
    ) -> None:
        self._camera = camera
        self._task = Task(model, keep, level, options or CleaningOptions())
        self._stream = _core.StreamCleaner(camera._handle, model, self._task.options.noise, self._task.options.toe)

    def __reduce__(self) -> NoReturn:
        """A copy would share the state of its stream."""
        raise TypeError("cannot pickle 'VideoCleaner' object")

    @checked
    def push(self, frame: npt.ArrayLike, *, time: float | None = None) -> CleanedFrames:
        """Clean the next frame, (rows, columns) or (1, rows, columns, colours), rows in time order.

        Args:
            frame: its pixels.
            time: time stamp, s: tells how many frames are missing. Without, none is.

        Returns:
            :class:`CleanedFrames` of this frame.
        """
        return self._cleaned(frame, lambda colours: self._stream.push(colours, time))

    @checked
    def again(self, frame: npt.ArrayLike, ago: int) -> CleanedFrames:
        """Clean a frame before the last one, which :meth:`push` left as it is, under a slow light found since.

        Args:
            frame: its pixels.
            ago: number of frames from it to the last one that was pushed, missing ones counted; 1 or more.

        Returns:
            :class:`CleanedFrames` of it: unchanged where the last frame has no slow light, or another one.
        """
        return self._cleaned(frame, lambda colours: self._stream.again(colours, ago))

    def _cleaned(self, frame: npt.ArrayLike, found: Callable[[list[npt.NDArray[Any]]], Any]) -> CleanedFrames:
        stack = stacked(frame, "frame", self._camera.scan_axis)
        if len(stack) != 1:
            raise ValueError(f"frame: got {len(stack)} frames, allowed: one")
        estimate = estimate_of(stack, found(colours_of(stack)))
        return collected([finished(estimate, self._camera, self._task)], self._camera, np.ndim(frame))

    def forget(self) -> None:
        """Clean the next frame as a picture."""
        self._stream.forget()
