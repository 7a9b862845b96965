"""The lights of every frame of a video: the picture is searched now and then, and its lights are followed."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_grey_frames, box_in_time_order
from ocisac_fast.core.regions import Region
from ocisac_fast.lights.sources import LightSource, detect_sources
from ocisac_fast.lights.tracker import SourceTracker, Track

Frame = npt.NDArray[Any]

GROUP = 4  # frames that are compared in a search
UNCHANGED = 10  # intervals after which a picture that seems unchanged is searched
SAVED = 3  # searches, of intervals without one
_LOOKS = 8  # frames between comparisons with the picture last searched
_TILE = 32  # rows
_STEP, _SUMMED = 4, 8  # every fourth column, in groups of eight
_WIDE = 8  # groups
_SKIPPED = 4  # rows: an estimate of the noise needs some
_CLEAR = 8.0  # energy of a change over that of the noise
_STEPS = 1.5  # DN^2 of integers: a light of amplitude 1 appears, the least that a search detects; compression makes 1
_BESIDE = 0.25  # of the size of a light, around it: its faint rim changes as it does
_FOREVER = 1 << 62  # frames


@dataclass(frozen=True, slots=True)
class SeenLights:
    """The lights of a frame.

    Attributes:
        frame: index from 0.
        pixels: the frame.
        searched: True if all of it was searched, False if lights were followed only.
        sources: the most probable first.
        numbers: of the lights, the same in all frames.
    """

    frame: int
    pixels: Frame
    searched: bool
    sources: list[LightSource]
    numbers: list[int]


def watch_lights(
    frames: Iterable[Frame], camera: Camera, search_every: int, group: int = GROUP, **options: Any
) -> Iterator[SeenLights]:
    """Yield the lights of each frame.

    A search covers a whole frame and compares it with its neighbours in a group. The first four frames are searched,
    also those of another shape or type, so that a light is found that not every frame shows. Between searches the
    lights found are followed (:class:`SourceTracker`). After a frame that misses one the next eight are searched: it
    may be faint, or a burst of data that begins at other rows in each frame. Another search needs a reason: the picture
    beside the lights has changed since the last one, which is tested in every eighth frame. There is one such search in
    ``search_every`` frames on average; up to three that were saved while there was no reason come at once. Without a
    reason a search comes after ten times as many frames.

    Args:
        frames: (rows, columns) as stored.
        camera: as for ``detect_sources``.
        search_every: 1: each frame is searched by itself and compared, in groups that follow each other.
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
    """The lights of now, and the picture in which they were searched."""

    def __init__(self, camera: Camera, options: dict[str, Any]) -> None:
        self._camera = camera
        self._tracker = SourceTracker(camera, full_every=_FOREVER, reflections=True, search_hidden=False, **options)
        self._origins: dict[int, int] = {}  # number of a reflection: that of its light
        self._overview: _Overview | None = None
        self._places: list[Region] = []  # of the lights in it
        self._since, self._alert, self._saved, self._first = 0, 0, float(SAVED), GROUP
        self._kind: tuple[Any, ...] = ()

    def is_due(self, frame: Frame, search_every: int) -> bool:
        """True if the frame is to be searched."""
        self._since, self._saved = self._since + 1, min(self._saved + 1.0 / search_every, SAVED)
        missing = any(track.hidden == 1 for track in self._tracker.tracks)  # seen in the frame before the last
        self._alert = _LOOKS if missing else max(self._alert - 1, 0)
        if (frame.shape, frame.dtype) != self._kind:
            self._first = GROUP
        if self._first or self._alert or self._since >= UNCHANGED * search_every:
            return True
        if self._saved < 1.0 or self._since % min(_LOOKS, search_every):
            return False
        lights = [track.source.region for track in self._tracker.tracks if track.visible]
        return self._overview is not None and self._overview.is_changed(
            _Overview(frame, self._camera), [*self._places, *lights]
        )

    def searched(self, index: int, frame: Frame, sources: list[LightSource]) -> SeenLights:
        """Go on with the lights of a search."""
        numbers = {id(track.source): track.identity for track in self._tracker.update(frame, sources=sources)}
        self._origins = {
            numbers[id(one)]: numbers[id(sources[one.reflection_of])]
            for one in sources
            if one.reflection_of is not None
        }
        self._overview, self._kind = _Overview(frame, self._camera), (frame.shape, frame.dtype)
        self._places = [one.region for one in sources]
        self._since = 0
        if not (self._first or self._alert):
            self._saved = max(self._saved - 1.0, 0.0)
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


class _Overview:
    """Mean of every fourth column of a frame, in groups of eight: (rows, groups), rows in time order."""

    def __init__(self, frame: Frame, camera: Camera) -> None:
        pixels = as_grey_frames(frame, "frame", camera.scan_axis, single=True)[0]
        self._camera, self._shape = camera, pixels.shape
        sampled = pixels[:, ::_STEP]
        summed = min(_SUMMED, sampled.shape[1])
        groups = sampled.shape[1] // summed
        some = sampled[:, : summed * groups].astype(np.float32, order="C")
        self._light = some.reshape(-1, groups, summed) @ np.full(summed, 1.0 / summed, np.float32)
        self._least = _STEPS if pixels.dtype.kind == "u" else 0.0

    def is_changed(self, now: _Overview, lights: list[Region]) -> bool:
        """True if the picture outside of the lights changed by more than noise, in a tile or in eight beside."""
        change = now._light - self._light
        least = _CLEAR * _noise(change) + self._least
        rows, groups = change.shape
        for light in lights:
            box = box_in_time_order(light, self._shape, self._camera.scan_axis)
            x, y = round(_BESIDE * box.width) + _TILE, round(_BESIDE * box.height) + _TILE
            first, last = max(box.x - x, 0) // (_STEP * _SUMMED), (box.right + x) // (_STEP * _SUMMED) + 1
            change[max(box.y - y, 0) : box.bottom + y, first:last] = 0.0
        tiles = change[: rows // _TILE * _TILE].reshape(-1, _TILE, groups)
        wide = np.add.reduceat(tiles, np.arange(0, groups, _WIDE), axis=2) / _WIDE
        return any(
            bool((np.square(one).mean(axis=1) > most).any()) for one, most in ((tiles, least), (wide, least / _WIDE))
        )


def _noise(change: npt.NDArray[np.float32]) -> float:
    """Variance, from the median of mixed differences, which is robust against edges and stripes."""
    mixed, terms = change[1::_SKIPPED] - change[:-1:_SKIPPED], 2.0
    if mixed.shape[1] > 1:
        mixed, terms = mixed[:, 1:] - mixed[:, :-1], 4.0
    return float(np.median(np.abs(mixed)) / 0.6745) ** 2 / terms if mixed.size else 0.0


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
