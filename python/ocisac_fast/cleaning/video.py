"""Removal of bands from the frames of a video: light and shares are carried from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast._core import MOST_SLOW_FRAMES, ColumnBundles, CommonCourse, SlowTone, ToneLight, mode_count
from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning.bands import (
    CleanedFrames,
    CleaningOptions,
    Estimate,
    Task,
    collected,
    estimated,
    finished,
    of_slow_light,
    shares_of,
    stacked,
    verdict_on,
)
from ocisac_fast.cleaning.row_light import RowLight, find_row_light, row_light_of
from ocisac_fast.cleaning.stored import BlockShares, FloatArray, StoredFrames, merged
from ocisac_fast.core.checks import checked

_EVERY, _EVERY_ONE_SHARE = 8, 64  # frames between estimates of the shares: of pixels, of the whole picture
_MAX_ESTIMATES = 6  # whose mean the shares are
_GUIDE = 1 << 15  # blocks of the picture whose displacement is measured
_CUT = 0.5  # of the picture unlike the frame before: another scene
_JUDGED_COLUMNS = 64
_MAX_FREQUENCIES = 64  # frames whose mean frequency is followed
_FLOOR = 0.02  # of the mean light, below which logarithms show noise


@dataclass(frozen=True, slots=True, eq=False)
class _Before:
    """The frame before: lights and shares of the colours, its picture, and what the estimates consist of."""

    lights: list[RowLight]
    shares: list[BlockShares]
    guide: FloatArray
    toe: float
    noise: float
    slow_bands: float
    frames: int  # since the first
    estimates: FloatArray  # of each block's share


class VideoCleaner:
    """:func:`remove_bands` for the frames of a video, one after the other.

    The first frame is cleaned as a picture. In the following ones a tone keeps its frequency, which becomes more
    precise from frame to frame, and gets its phase from the frame; other lights are found in each frame. Shares move
    with the picture, and become the mean of several estimates. A tone slower than 128 rows per cycle is compared with
    up to 7 frames before, in which the picture stays and the phase advances. A frame for which that fails, such as the
    first of another scene, is cleaned as a picture again.

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
        level: Literal["full", "mean"] = "full",
        options: CleaningOptions | None = None,
    ) -> None:
        self._camera = camera
        self._task = Task(model, keep, level, options or CleaningOptions())
        self._before: _Before | None = None
        self._courses: list[CommonCourse] = []  # of the last frames, while no other light is found
        self._slow: SlowTone | None = None

    @checked
    def push(self, frame: npt.ArrayLike) -> CleanedFrames:
        """Clean the next frame, (rows, columns) or (1, rows, columns, colours), rows in time order.

        Returns:
            :class:`CleanedFrames` of this frame.

        Raises:
            ValueError: a wrong shape or type; the message gives what is allowed.
        """
        stack = stacked(frame, "frame", self._camera.scan_axis)
        if len(stack) != 1:
            raise ValueError(f"frame: got {len(stack)} frames, allowed: one")
        found = self._followed(stack) or self._slowly(stack) or self._alone(stack)
        return collected([finished(found, self._task)], self._camera, np.ndim(frame))

    def forget(self) -> None:
        """Clean the next frame as a picture."""
        self._before, self._courses, self._slow = None, [], None

    def _alone(self, stack: npt.NDArray[Any]) -> Estimate:
        if self._courses and len(self._courses[0].modes) != mode_count(stack.shape[1]):
            self._courses = []
        found = estimated(stack, self._camera, None, self._task, self._courses)
        stored, shares = found.stored, found.shares
        self._before = self._slow = None
        if found.slow:
            self._keep_slow(found)
        else:
            self._courses = []
            guide = _guide(_in_blocks(stored, shares[0])[0], found.lights[0], shares)
            slow_bands, count = found.verdicts[0].slow_bands, np.ones(shares[0].share.shape)
            self._before = _Before(found.lights[0], shares, guide, stored.toe, stored.noise, slow_bands, 0, count)
        return found

    def _keep_slow(self, found: Estimate) -> None:
        self._courses = [*self._courses, found.slow[-1].course][1 - MOST_SLOW_FRAMES :]
        self._slow = None if found.unchanged else found.slow[-1].tones[0]

    def _slowly(self, stack: npt.NDArray[Any]) -> Estimate | None:
        """The frame by the slow tone of the ones before; None where that fails."""
        if self._slow is None or len(self._courses[0].modes) != mode_count(stack.shape[1]):
            return None
        stored = StoredFrames(stack, self._camera, self._task.options.noise, self._task.options.toe or 0.0)
        slow = _core.find_slow_lights(stored.light, stored.variance, self._camera._handle, self._courses, self._slow)
        if slow[-1].objection:
            return None
        found = of_slow_light(stored, slow, self._camera)
        self._keep_slow(found)
        return found

    def _followed(self, stack: npt.NDArray[Any]) -> Estimate | None:
        """The frame by what is known of the one before; None where that fails."""
        before = self._before
        if before is None or not _fits(before, stack, self._camera):
            return None
        stored = StoredFrames(stack, self._camera, before.noise, before.toe)
        lights = self._lights(stored, before)
        blocks = _in_blocks(stored, before.shares[0])
        guide = _guide(blocks[0], lights, before.shares)
        *ways, unlike = _core.picture_change(before.guide, guide)
        if np.mean(unlike) > _CUT:
            return None
        shares, estimates = _shares(stored, blocks, lights, before, ways, unlike)
        rows = np.stack([own.light for own in lights])
        verdict = verdict_on(stored, 0, rows, shares, _JUDGED_COLUMNS, before.slow_bands)
        if verdict.objection:
            return None
        self._before = replace(
            before, lights=lights, shares=shares, guide=guide, frames=before.frames + 1, estimates=estimates
        )
        return Estimate(stored, [lights], shares, [verdict], "", [])

    def _lights(self, stored: StoredFrames, before: _Before) -> list[RowLight]:
        """The row light of each colour; colours that had one light have one again."""
        groups: dict[int, list[int]] = {}
        for colour, own in enumerate(before.lights):
            groups.setdefault(id(own), []).append(colour)
        lights: dict[int, RowLight] = {}
        for colours in groups.values():
            light, variance = (values[0][..., colours].sum(axis=-1) for values in (stored.light, stored.variance))
            own = before.lights[colours[0]]
            if own.tone is None:
                found = find_row_light(light, variance, self._camera, own.model)
            else:
                picture = ColumnBundles(
                    light, variance, _share_of_columns(before.shares[colours[0]], light.shape[1], stored)
                )
                tone = _core.followed_tone_light(picture, own.tone)
                weight = 1 / (min(before.frames, _MAX_FREQUENCIES) + 2)
                mean = own.tone.frequency + weight * (tone.frequency - own.tone.frequency)
                found = row_light_of(ToneLight(tone.light, mean, tone.harmonics), self._camera)
            lights.update(dict.fromkeys(colours, found))
        return [lights[colour] for colour in range(len(before.lights))]


def _fits(before: _Before, stack: npt.NDArray[Any], camera: Camera) -> bool:
    rows, columns = stack.shape[1:3]
    block = before.shares[0]
    shape = -(-rows // block.rows), -(-columns // block.columns)
    return block.share.shape == shape and len(before.lights[0].light) == rows and len(before.shares) == stack.shape[3]


def _share_of_columns(shares: BlockShares, columns: int, stored: StoredFrames) -> FloatArray:
    at = np.arange(columns) * stored.merged // shares.columns
    return np.asarray(shares.share.mean(axis=0)[at])


def _in_blocks(stored: StoredFrames, block: BlockShares) -> tuple[FloatArray, FloatArray]:
    """(frames, rows, columns, colours) means of light over blocks, and their variance."""
    light, variance = merged(stored.light, stored.variance, block.columns // stored.merged, axis=2)
    return merged(light, variance, block.rows, axis=1)


def _means(rows: FloatArray, height: int) -> FloatArray:
    """Means of ``height`` neighbours along the last axis."""
    starts = np.arange(0, rows.shape[-1], height)
    return np.asarray(np.add.reduceat(rows, starts, axis=-1) / np.diff(np.append(starts, rows.shape[-1])))


def _guide(light: FloatArray, lights: list[RowLight], shares: list[BlockShares]) -> FloatArray:
    """Logarithm of the cleaned ``light`` of blocks, all colours added, in at most some 32,000 larger blocks."""
    block = shares[0]
    picture = np.zeros(block.share.shape)
    for colour, (own, share) in enumerate(zip(lights, shares, strict=True)):
        rows = _means(own.light, block.rows)
        picture += light[0, ..., colour] / np.maximum(1 + share.share * (rows[:, None] - 1), 0.1)
    count = _guide_size(picture.shape)
    if count > 1:
        known = np.ones(picture.shape)
        for axis in (0, 1):
            picture, known = merged(picture, known, count, axis)
    return np.log(np.maximum(picture, 0.0) + _FLOOR * max(float(picture.mean()), 1e-300))


def _guide_size(shape: tuple[int, ...]) -> int:
    return max(1, round(float(np.sqrt(shape[0] * shape[1] / _GUIDE))))


def _shares(
    stored: StoredFrames,
    blocks: tuple[FloatArray, FloatArray],
    lights: list[RowLight],
    before: _Before,
    ways: Sequence[FloatArray],
    unlike: npt.NDArray[np.uint8],
) -> tuple[list[BlockShares], FloatArray]:
    """Shares of the frame before, moved with the picture, and from time to time joined by estimates of this frame."""
    frames = before.frames + 1
    rows = np.stack([own.light for own in lights])
    if all(np.ptp(own.share) == 0 for own in before.shares):
        if frames % _EVERY_ONE_SHARE:
            return before.shares, before.estimates
        shares = shares_of(stored, rows[None], smooth=lights[0].tone is not None)
        return shares, np.ones(shares[0].share.shape)
    shape, count = before.estimates.shape, _guide_size(before.estimates.shape)
    down, right = (count * BlockShares(way, count, count).enlarged(shape) for way in ways)
    new = np.repeat(np.repeat(unlike, count, axis=0), count, axis=1)[: shape[0], : shape[1]]
    estimates = np.where(new, 0.0, _core.moved_picture(before.estimates, down, right))
    carried = [_core.moved_picture(own.share, down, right) for own in before.shares]
    if frames % _EVERY and frames > 1 and not (estimates < 0.5).mean() > 1 / 16:
        return [replace(own, share=share) for own, share in zip(before.shares, carried, strict=True)], estimates
    block = before.shares[0]
    light, variance = blocks
    weight = 1 / (np.minimum(estimates, _MAX_ESTIMATES - 1) + 1)
    shares = []
    for colour, share in enumerate(carried):
        own = _core.light_share(
            np.ascontiguousarray(light[..., colour]),
            np.ascontiguousarray(variance[..., colour]),
            _means(rows[colour][None], block.rows),
            True,
        )
        shares.append(replace(block, share=share + weight * (own - share)))
    return shares, estimates + 1
