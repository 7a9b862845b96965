"""The lights of every frame of a video: the picture is searched now and then, and its lights are followed."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.lights.sources import LightSource, detect_sources
from ocisac_fast.lights.tracker import SourceTracker, Track

Frame = npt.NDArray[Any]

GROUP = 4  # frames that are compared in a search
_ALERT = 8  # frames that are searched after one that misses a light
_FOREVER = 1 << 62  # frames


@dataclass(frozen=True, slots=True)
class SeenLights:
    """The lights of a frame."""

    frame: int  # index from 0
    pixels: Frame
    searched: bool  # True if all of it was searched, False if lights were followed only
    sources: list[LightSource]  # the most probable first
    numbers: list[int]  # of the lights, the same in all frames


def watch_lights(
    frames: Iterable[Frame], camera: Camera, search_every: int, group: int = GROUP, **options: Any
) -> Iterator[SeenLights]:
    """Yield the lights of each frame.

    A search covers a whole frame and compares it with its neighbours in a group. The first four frames are searched,
    also those of another shape or type, so that a light is found that not every frame shows. Between searches the
    lights found are followed (:class:`SourceTracker`). After a frame that misses one the next eight are searched: it
    may be faint, or a burst of data that begins at other rows in each frame.

    Args:
        frames: (rows, columns) as stored.
        camera: as for ``detect_sources``.
        search_every: frames from a search to the next. 1: each frame is searched by itself and compared, in groups
            that follow each other.
        group: number of frames that are compared; 1: none, and lights are numbered in each frame by itself.
        options: false_alarms and min_cycles of ``detect_sources``.
    """
    watch = _Watch(camera, options)
    index = 0
    for some in _groups(frames, group):
        if search_every == 1:
            found = detect_sources(np.stack(some), camera, **options)
            for k, frame in enumerate(some):
                lights = [one for one in found if one.frame == k]
                if group == 1:
                    yield SeenLights(index, frame, True, lights, list(range(len(lights))))
                else:
                    yield watch.searched(index + k, frame, lights)
            index += len(some)
            continue
        for k, frame in enumerate(some):
            if watch.is_due(frame, search_every):
                found = detect_sources(np.stack(some), camera, frame=k, **options)
                yield watch.searched(index + k, frame, found)
            else:
                yield watch.followed(index + k, frame)
        index += len(some)


class _Watch:
    """The lights of now."""

    def __init__(self, camera: Camera, options: dict[str, Any]) -> None:
        self._camera = camera
        self._tracker = SourceTracker(camera, full_every=_FOREVER, reflections=True, search_hidden=False, **options)
        self._origins: dict[int, int] = {}  # number of a reflection: that of its light
        self._since, self._alert, self._first = 0, 0, GROUP
        self._kind: tuple[Any, ...] = ()

    def is_due(self, frame: Frame, search_every: int) -> bool:
        """True if the frame is to be searched."""
        self._since += 1
        missing = any(track.hidden == 1 for track in self._tracker.tracks)  # seen in the frame before the last
        self._alert = _ALERT if missing else max(self._alert - 1, 0)
        if (frame.shape, frame.dtype) != self._kind:
            self._first = GROUP
        return bool(self._first or self._alert) or self._since >= search_every

    def searched(self, index: int, frame: Frame, sources: list[LightSource]) -> SeenLights:
        """Go on with the lights of a search."""
        numbers = {id(track.source): track.identity for track in self._tracker.update(frame, sources=sources)}
        self._origins = {
            numbers[id(one)]: numbers[id(sources[one.reflection_of])]
            for one in sources
            if one.reflection_of is not None
        }
        self._kind = (frame.shape, frame.dtype)
        self._since = 0
        self._first = max(self._first - 1, 0)
        return self._seen(index, frame, True)

    def followed(self, index: int, frame: Frame) -> SeenLights:
        """Go on without a search."""
        self._tracker.update(frame, sources=None if self._tracker.tracks else [])
        return self._seen(index, frame, False)

    def _seen(self, index: int, frame: Frame, searched: bool) -> SeenLights:
        visible = sorted((one for one in self._tracker.tracks if one.visible), key=lambda one: -one.source.probability)
        numbers = [one.identity for one in visible]
        sources = [self._with_origin(one, index, numbers) for one in visible]
        return SeenLights(index, frame, searched, sources, numbers)

    def _with_origin(self, track: Track, index: int, numbers: list[int]) -> LightSource:
        origin = self._origins.get(track.identity)
        return dataclasses.replace(
            track.source, frame=index, reflection_of=numbers.index(origin) if origin in numbers else None
        )


def _groups(frames: Iterable[Frame], count: int) -> Iterator[list[Frame]]:
    """Frames of one shape and type in groups, the last by up to one larger: neighbours tell lights from textures."""
    waiting: list[Frame] = []
    for frame in frames:
        if waiting and (frame.shape, frame.dtype) != (waiting[0].shape, waiting[0].dtype):
            yield waiting
            waiting = []
        elif len(waiting) > count or (count == 1 and waiting):
            yield waiting[:count]
            waiting = waiting[count:]
        waiting.append(frame)
    if waiting:
        yield waiting
