"""Stored frames as sums of linear light over blocks of pixels, and back as stored values under steady light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import (
    light_per_step,
    linear_light,
    saturation_level,
    stored_values,
    type_maximum,
    white_level,
)
from ocisac_fast.cleaning.toe import lifted, lowered, slope, with_toe

FloatArray = npt.NDArray[np.float64]

_WHOLE = 1 << 19  # pixels of a picture up to which every pixel has a share of its own
_SUMS, _MAX_MERGED = 1 << 19, 8  # means of neighbouring columns in larger ones, and columns in each
_BLOCKS = 1 << 17  # shares in larger ones: they vary slowly, and blocks average noise and texture
_LONGEST_BLOCK, _FLATTEST_BLOCK = 16, 4  # rows; columns over rows: wide ones blur oblique edges of the light
_NOISE_ROWS = 1 << 18  # pixels whose differences estimate the noise

Stack = npt.NDArray[Any]


class StoredFrames:
    """Frames (frames, rows, columns, colours) as stored, and their light where neighbouring columns are averaged.

    Attributes:
        light, variance: (frames, rows, merged columns, colours) linear light and its noise variance, infinite where
            all pixels are saturated.
        merged: number of columns in each mean.
        white: light of a white pixel.
        noise: standard deviation of a pixel, DN.
        toe: of the tone curve.
    """

    def __init__(self, stack: Stack, camera: Camera, noise: float | None, toe: float) -> None:
        self.stack, self._camera = stack, camera
        self.white = white_level(camera, stack.dtype) - camera.dark_level
        self.noise = noise_of(stack) if noise is None else noise
        self.merged = min(-(-stack[0, ..., 0].size // _SUMS), _MAX_MERGED)
        self.set_toe(toe)

    def set_toe(self, toe: float) -> None:
        """Convert with another toe of the tone curve."""
        self.toe = toe
        self._table = _table(self.stack.dtype, self._camera, self.noise, toe, self.white)
        frames, _, _, colours = self.stack.shape
        sums = [[self._sums(self.stack[k, ..., c]) for c in range(colours)] for k in range(frames)]
        self.light, self.variance = (
            np.stack([np.stack([one[part] for one in of_frame], axis=-1) for of_frame in sums]) for part in (0, 1)
        )

    def _sums(self, stored: Stack) -> tuple[FloatArray, FloatArray]:
        if self._table is not None:
            return _core.merge_columns(
                np.ascontiguousarray(stored), self.merged, self._table.light, self._table.variance
            )
        return merged(*self._of_floats(stored), self.merged, axis=1)

    def _of_floats(self, stored: Stack) -> tuple[FloatArray, FloatArray]:
        variance = (self.noise * light_per_step(stored, self._camera)) ** 2
        variance[stored >= saturation_level(self._camera, stored.dtype)] = np.inf
        return with_toe(linear_light(stored, self._camera), variance, self.toe, self.white)

    def restored(
        self, frame: int, colour: int, shares: BlockShares, rows: FloatArray, level: float, max_gain: float
    ) -> tuple[Stack, npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
        """Stored values under steady light, marks, and the share of each pixel."""
        assert self._table is not None
        return _core.restore_picture(
            np.ascontiguousarray(self.stack[frame, ..., colour]),
            np.ascontiguousarray(shares.share),
            shares.rows,
            shares.columns,
            rows,
            level,
            max_gain,
            self._table.light,
            self._table.variance,
            self._table.bounds,
        )

    @property
    def by_table(self) -> bool:
        """Stored values are integers, which :meth:`restored` takes."""
        return self._table is not None

    def linear(self, frame: int, colour: int) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Linear light of each pixel, and which ones are saturated."""
        stored = self.stack[frame, ..., colour]
        saturated = np.asarray(stored >= saturation_level(self._camera, stored.dtype))
        return lifted(linear_light(stored, self._camera), self.toe, self.white), saturated

    def stored(self, light: FloatArray) -> Stack:
        """Stored values of linear light."""
        return stored_values(lowered(light, self.toe, self.white), self._camera, self.stack.dtype)


@dataclass(frozen=True, slots=True, eq=False)
class BlockShares:
    """Shares (rows, columns) of blocks of pixels, ``rows`` by ``columns`` large."""

    share: FloatArray
    rows: int = 1
    columns: int = 1

    def enlarged(self, shape: tuple[int, int]) -> FloatArray:
        """The share of each pixel, interpolated between the centres of the blocks."""
        values = self.share
        for axis, block in enumerate((self.rows, self.columns)):
            if block == 1:
                continue
            last = values.shape[axis] - 1
            at = np.clip((np.arange(shape[axis]) + 0.5) / block - 0.5, 0.0, last)
            before = at.astype(int)
            weight = np.expand_dims(at - before, 1 - axis)
            one, two = values.take(before, axis), values.take(np.minimum(before + 1, last), axis)
            values = one + weight * (two - one)
        return values


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Linear light and noise variance of all stored values, and the light at which one value changes to the next."""

    light: FloatArray
    variance: FloatArray
    bounds: FloatArray


def _table(dtype: np.dtype[Any], camera: Camera, noise: float, toe: float, white: float) -> _Table | None:
    if dtype.kind != "u" or dtype.itemsize > 2:
        return None
    top = int(type_maximum(dtype))
    values = np.arange(top + 1).astype(dtype)
    light = linear_light(values, camera)
    variance = (noise * light_per_step(values, camera)) ** 2 * slope(light, toe, white) ** 2
    variance[values >= saturation_level(camera, dtype)] = np.inf
    between = _core.linear_light(np.arange(top) + 0.5, camera._handle, float(top))
    lit = np.maximum.accumulate(lifted(light, toe, white))
    return _Table(lit, variance, np.maximum.accumulate(lifted(between, toe, white)))


def block_size(shape: tuple[int, int], most: int, merged: int) -> tuple[int, int]:
    """Rows, ``most`` if possible, and columns of the blocks of a picture (rows, columns)."""
    pixels = shape[0] * shape[1]
    if pixels <= _WHOLE:
        return 1, 1
    each = pixels / _BLOCKS
    rows = max(1, min(most, _LONGEST_BLOCK, round(np.sqrt(each))))
    return rows, merged * -(-min(round(each / rows), _FLATTEST_BLOCK * rows) // merged)


def merged(light: FloatArray, variance: FloatArray, count: int, axis: int) -> tuple[FloatArray, FloatArray]:
    """Means of ``count`` neighbours along an axis that are not saturated, and their variance."""
    if count == 1:
        return light, variance
    known = np.isfinite(variance)
    if known.all():
        size = _sums(np.ones(light.shape[axis]), count, 0).reshape(-1, *[1] * (light.ndim - 1 - axis))
        return _sums(light, count, axis) / size, _sums(variance, count, axis) / size**2
    number, value, spread = (
        _sums(part, count, axis)
        for part in (known.astype(float), np.where(known, light, 0.0), np.where(known, variance, 0.0))
    )
    some = np.maximum(number, 1.0)
    return value / some, np.where(number > 0, spread / some**2, np.inf)


def _sums(values: FloatArray, count: int, axis: int) -> FloatArray:
    """Sums of ``count`` neighbours along an axis, by slices, which are long; the last sum has what is left."""
    every = [values[(slice(None),) * axis + (slice(k, None, count),)] for k in range(min(count, values.shape[axis]))]
    total = every[0].copy()
    for part in every[1:]:
        total[(slice(None),) * axis + (slice(part.shape[axis]),)] += part
    return total


def noise_of(stack: Stack) -> float:
    """Noise, DN, from second differences along the rows, where bands cancel; at least half a step of integers."""
    noise = 0.5 if stack.dtype.kind == "u" else 1e-4 * max(float(np.abs(stack).max()), 1e-100)
    if stack.shape[2] < 3:
        return noise
    every = max(2, stack.size // _NOISE_ROWS)
    values = np.asarray(stack[:, ::every], np.float64)
    bend = np.abs(values[:, :, 2:] - 2 * values[:, :, 1:-1] + values[:, :, :-2])
    return max(noise, float(np.median(bend)) / float(0.6745 * np.sqrt(6.0)))
