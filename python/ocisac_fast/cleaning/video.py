"""Removal of bands from the frames of a video: light and shares are carried from frame to frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, NoReturn

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning.bands import (
    CleanedFrames,
    CleaningOptions,
    Done,
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
    left. It is searched in what a faster light leaves, too (unless the bands are kept: those are the faster light's). A
    frame for which that fails, such as the first of another scene, is cleaned as a picture again.

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
        noise, toe = self._task.options.noise, self._task.options.toe
        self._stream = _core.StreamCleaner(camera._handle, model, noise, toe)
        self._slow = _core.StreamCleaner(camera._handle, "slow", noise, 0.0)

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
        stack = self._stacked(frame)
        done = self._done(stack, self._stream.push(colours_of(stack), time))
        if self._task.keep == "picture" and done.light.may_leave_slow():
            found = self._slow.push(colours_of(done.pictures), time)
            done.light.join(found[1])
            if not found[1].unchanged:
                slow = self._done(done.pictures, found)
                done = replace(done, pictures=slow.pictures, marks=np.maximum(done.marks, slow.marks))
        else:
            self._slow.forget()
        return collected([done], self._camera, np.ndim(frame))

    @checked
    def again(self, frame: npt.ArrayLike, ago: int) -> CleanedFrames:
        """Clean a frame before the last one, which :meth:`push` left as it is, under a slow light found since.

        Args:
            frame: its pixels.
            ago: number of frames from it to the last one that was pushed, missing ones counted; 1 or more.

        Returns:
            :class:`CleanedFrames` of it: unchanged where the last frame has no slow light, or another one.
        """
        stack = self._stacked(frame)
        done = self._done(stack, self._stream.again(colours_of(stack), ago))
        return collected([done], self._camera, np.ndim(frame))

    def _stacked(self, frame: npt.ArrayLike) -> npt.NDArray[Any]:
        stack = stacked(frame, "frame", self._camera.scan_axis)
        if len(stack) != 1:
            raise ValueError(f"frame: got {len(stack)} frames, allowed: one")
        return stack

    def _done(self, stack: npt.NDArray[Any], found: Any) -> Done:
        return finished(estimate_of(stack, found), self._camera, self._task)

    def forget(self) -> None:
        """Clean the next frame as a picture."""
        self._stream.forget()
        self._slow.forget()
