"""Tracking of lights from frame to frame through motion, fading and short occlusion."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Annotated

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import as_grey_frames, box_in_time_order, in_stored_order
from ocisac_fast.core.checks import Count, Within, checked, checked_class
from ocisac_fast.core.regions import Region
from ocisac_fast.core.results import Result
from ocisac_fast.lights.recognition import KnownLight
from ocisac_fast.lights.sources import LightSource, detect_sources, source_of

_SMOOTHING = 0.5  # weight of the latest step in a track's velocity, and of the latest frequency
_SETTLED, _SETTLED_REACH = 3, 0.5  # frames after which a track's velocity is reliable, and its reach from then on
_DEVIATIONS = 4.0  # standard errors within which two frequencies are equal
_RESOLVED = 0.2  # cycles over a box that they may differ by in any case: texture biases the frequency of few cycles


@dataclasses.dataclass(frozen=True, slots=True, repr=False)
class Track(Result):
    """State of a tracked light after a frame.

    Attributes:
        identity: unique number from 0, never reused.
        frame: count of the frame, from 0.
        source: its last detection.
        visible: True if it was detected in this frame.
        hidden: frames since its last detection; 0 if visible.
        age: frames since its first detection.
        velocity: of its box's centre, columns and rows per frame.
        frequency: Hz, averaged over the frames in which it was detected.
        frequency_std: its standard error, Hz.
        region: part of the frame in which it is expected in the next frame; within the frame.
    """

    identity: int
    frame: int
    source: LightSource
    visible: bool
    hidden: int
    age: int
    velocity: tuple[float, float]
    frequency: float
    frequency_std: float
    region: Region


@checked_class
class SourceTracker:
    """Track the identity of lights over the frames of a video.

    A detection is assigned to the nearest predicted track of its frequency, or of tracks that carry data if it does. A
    hidden track moves on with its velocity for ``patience`` frames while its region grows. Between searches of the
    whole frame, a light that looks as when it was found, near its predicted place, is measured there, which takes a
    fiftieth of the time of a refinement; probability, frequency and the size of its box stay. Other visible lights are
    refined at their predicted place, to within two of their cycles; their region is searched only if this fails or the
    light carries data.

    Args:
        camera: as for :func:`detect_sources`.
        patience: frames after which a hidden track ends; 0 or above.
        reach: largest distance from the predicted place, in sizes of the box, for each frame since the last detection;
            above 0.
        full_every: frames between searches of the whole frame, 1 or above. New lights are detected only by these, so
            at most that many frames late.
        false_alarms, min_cycles: as for :func:`detect_sources`.
        reflections: track reflections as well.
        search_hidden: search the regions of hidden tracks; else they are only recognised near their predicted places.

    Raises:
        ValueError: a value out of range; errors of the detection are raised at the first frame.
    """

    def __init__(
        self,
        camera: Camera,
        *,
        patience: Annotated[int, Within(0)] = 15,
        reach: Annotated[float, Within(0.0, 1e6, above=True)] = 1.5,
        full_every: Count = 1,
        false_alarms: float = 0.02,
        min_cycles: float = 2.5,
        reflections: bool = False,
        search_hidden: bool = True,
    ) -> None:
        self._camera = camera
        self._patience, self._reach, self._full_every = patience, reach, full_every
        self._false_alarms, self._min_cycles = false_alarms, min_cycles
        self._reflections, self._search_hidden = reflections, search_hidden
        self._frame = -1
        self._known: dict[int, KnownLight] = {}  # by identity
        self._identities = itertools.count()
        self._tracks: list[Track] = []

    @property
    def tracks(self) -> list[Track]:
        """The tracks after the last frame, the oldest first."""
        return list(self._tracks)

    @checked
    def update(self, frame: npt.ArrayLike, *, sources: list[LightSource] | None = None) -> list[Track]:
        """Process the next frame, (rows, columns); returns all active tracks, the oldest first.

        ``sources``: its lights, where it has been searched already, with its neighbours for instance.
        """
        if np.ndim(frame) == 1:
            raise ValueError("frame: got 1 dimension, allowed: (rows, columns)")
        axis = self._camera.scan_axis
        pixels = as_grey_frames(frame, "frame", axis, single=True)[0]
        shape = (pixels.shape[1], pixels.shape[0]) if axis.endswith("x") else (pixels.shape[0], pixels.shape[1])
        known: dict[int, LightSource] = {}
        if sources is None and self._tracks and (self._frame + 1) % self._full_every:
            known = self._recognised(pixels)
            sources = self._followed(pixels, shape, known)
        elif sources is None:
            picture = in_stored_order(pixels, axis)
            sources = detect_sources(
                picture, self._camera, false_alarms=self._false_alarms, min_cycles=self._min_cycles
            )
        self._advance(sources, shape, known)
        fresh = (track for track in self._tracks if track.visible and track.identity not in known)
        kept = {t.identity: self._known[t.identity] for t in self._tracks if t.identity in self._known}
        self._known = kept | {t.identity: KnownLight(pixels, self._camera, t.source) for t in fresh}
        return self.tracks

    @checked
    def follow(self, sources: list[LightSource], shape: tuple[int, int]) -> list[Track]:
        """:meth:`update` with the lights of the next frame already detected, without its pixels.

        Args:
            sources: lights of one frame; reflections among them are ignored unless they are tracked.
            shape: rows and columns of the frame.
        """
        self._known = {}
        self._advance(sources, shape, {})
        return self.tracks

    def _recognised(self, pixels: npt.NDArray[np.generic]) -> dict[int, LightSource]:
        """By identity: the lights that look as when they were found, near their last or expected places."""
        found = {}
        for track in self._tracks:
            if track.identity in self._known:
                last = track.source.x, track.source.y
                found[track.identity] = self._known[track.identity].measure(pixels, last, _expected_place(track))
        return {identity: source for identity, source in found.items() if source is not None}

    def _followed(
        self, pixels: npt.NDArray[np.generic], shape: tuple[int, int], known: dict[int, LightSource]
    ) -> list[LightSource]:
        """The lights found at or near the predicted places of those that are not recognised."""
        axis = self._camera.scan_axis
        sought = [t for t in self._tracks if t.identity not in known and (t.visible or self._search_hidden)]
        expected = [_looked_for(track, shape, pixels.shape, axis) for track in sought]
        if not expected:
            return []
        seen = _core.follow_sources(pixels, self._camera._handle, expected, self._false_alarms, self._min_cycles)
        found = [source_of(values, pixels.shape, axis) for values in seen]
        return [one for one in found if not any(_doubles(one.region, other.region) for other in known.values())]

    def _advance(self, sources: list[LightSource], shape: tuple[int, int], known: dict[int, LightSource]) -> None:
        """The next frame: those recognised, by identity, and lights to be assigned to the other tracks."""
        self._frame += 1
        lights = [source for source in sources if self._reflections or source.reflection_of is None]
        pairs = sorted(
            (distance, i, k)
            for i, track in enumerate(self._tracks)
            if track.identity not in known
            for k, source in enumerate(lights)
            if (distance := self._distance(track, source)) <= 1.0
        )
        taken: dict[int, int] = {}
        for _, i, k in pairs:
            if i not in taken and k not in taken.values():
                taken[i] = k
        found = {self._tracks[i].identity: lights[k] for i, k in taken.items()} | known
        old = [self._next(track, found.get(track.identity), shape) for track in self._tracks]
        new = [self._begun(light, shape) for k, light in enumerate(lights) if k not in taken.values()]
        self._tracks = [track for track in old if track.hidden <= self._patience] + new

    def _distance(self, track: Track, source: LightSource) -> float:
        """Distance from the predicted place, as a share of the allowed one; infinite for another frequency.

        Lights that carry data have no frequency: between data and a tone half of the allowed distance is added.
        """
        spread = _DEVIATIONS * math.hypot(track.frequency_std, source.frequency_std) + 0.005 * track.frequency
        rows = source.width if self._camera.scan_axis.endswith("x") else source.height
        spread = max(spread, _RESOLVED / (rows * self._camera.row_period))
        data = track.source.carries_data, source.carries_data
        if not any(data) and abs(source.frequency - track.frequency) > spread:
            return math.inf
        steps = track.hidden + 1
        x, y = _centre(track.source)
        dx = source.x + source.width / 2 - x - steps * track.velocity[0]
        dy = source.y + source.height / 2 - y - steps * track.velocity[1]
        size = max(track.source.width, track.source.height)
        return math.hypot(dx, dy) / (self._reach * size * steps) + 0.5 * (data[0] != data[1])

    def _next(self, track: Track, source: LightSource | None, shape: tuple[int, int]) -> Track:
        steps, age = track.hidden + 1, track.age + 1
        if source is None:
            region = self._expected(track.source, track.velocity, steps, False, shape)
            return dataclasses.replace(track, frame=self._frame, visible=False, hidden=steps, age=age, region=region)
        (x0, y0), (x1, y1) = _centre(track.source), _centre(source)
        kept = 0.0 if track.age == 0 else 1.0 - _SMOOTHING  # the first step has no predecessor
        across, down = (x1 - x0) / steps, (y1 - y0) / steps
        velocity = (
            kept * track.velocity[0] + (1.0 - kept) * across,
            kept * track.velocity[1] + (1.0 - kept) * down,
        )
        share = 0.0 if source.frequency == track.source.frequency else _SMOOTHING  # measured there: nothing new
        return Track(
            identity=track.identity,
            frame=self._frame,
            source=source,
            visible=True,
            hidden=0,
            age=age,
            velocity=velocity,
            frequency=(1.0 - share) * track.frequency + share * source.frequency,
            frequency_std=math.hypot((1.0 - share) * track.frequency_std, share * source.frequency_std),
            region=self._expected(source, velocity, 0, age >= _SETTLED, shape),
        )

    def _begun(self, source: LightSource, shape: tuple[int, int]) -> Track:
        return Track(
            identity=next(self._identities),
            frame=self._frame,
            source=source,
            visible=True,
            hidden=0,
            age=0,
            velocity=(0.0, 0.0),
            frequency=source.frequency,
            frequency_std=source.frequency_std,
            region=self._expected(source, (0.0, 0.0), 0, False, shape),
        )

    def _expected(
        self, source: LightSource, velocity: tuple[float, float], hidden: int, settled: bool, shape: tuple[int, int]
    ) -> Region:
        """Region of the next frame: the box moved by its velocity, widened by the reach for each hidden frame."""
        steps = hidden + 1
        reach = min(self._reach, _SETTLED_REACH) if settled else self._reach
        margin = reach * max(source.width, source.height) * steps
        left, top = source.x + steps * velocity[0] - margin, source.y + steps * velocity[1] - margin
        right, bottom = left + source.width + 2 * margin, top + source.height + 2 * margin
        rows, columns = shape
        x, y = min(max(math.floor(left), 0), columns - 1), min(max(math.floor(top), 0), rows - 1)
        width, height = min(math.ceil(right), columns) - x, min(math.ceil(bottom), rows) - y
        return Region(x, y, max(width, 1), max(height, 1))


def _looked_for(
    track: Track, shape: tuple[int, int], turned: tuple[int, ...], scan_axis: str
) -> tuple[Region, float, Region, bool, bool]:
    """Box, frequency and region in the next frame; True if visible; True if it carries data."""
    source, (rows, columns) = track.source, shape
    x, y = _expected_place(track)
    box = box_in_time_order(source.region._replace(x=x, y=y).moved_into(columns, rows), turned, scan_axis)
    region = box_in_time_order(track.region.moved_into(columns, rows), turned, scan_axis)
    return box, track.frequency, region, track.visible, source.carries_data


def _expected_place(track: Track) -> tuple[int, int]:
    """x and y of its box in the next frame."""
    steps, source = track.hidden + 1, track.source
    return round(source.x + steps * track.velocity[0]), round(source.y + steps * track.velocity[1])


def _doubles(a: Region, b: Region) -> bool:
    """True if two boxes share half of the smaller one."""
    return 2 * a.shared_pixels(b) > min(a.pixels, b.pixels)


def _centre(source: LightSource) -> tuple[float, float]:
    return source.x + source.width / 2, source.y + source.height / 2
