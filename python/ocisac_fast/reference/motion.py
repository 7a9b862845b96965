"""Displacement of a picture between two frames, and pictures moved with it, in plain NumPy.

The mean displacement is the peak of the phase correlation; what remains is the least-squares solution of the
gradients' equation in a window about each pixel (Lucas and Kanade 1981), held to 0 where there is no texture.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_REACH = 4  # half width of a window, pixels
_ROUNDS = 2
_MIN_SIDE = 4  # pixels
_HOLD = 2e-4  # mean squared gradient that halves a displacement: texture of 1.4 percent a pixel
_UNLIKE = 0.1  # difference of the displaced picture, in a window
_MAX_STEP = 2.0  # pixels, of what the mean displacement leaves


def picture_motion(before: FloatArray, after: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(rows, columns) arrays of the way, down and right in pixels, of each pixel of ``after`` since ``before``.

    Pictures of fewer than 4 rows or columns are taken to stand still.
    """
    if min(after.shape) < _MIN_SIDE:
        return np.zeros(after.shape), np.zeros(after.shape)
    down, right = _mean_displacement(before, after)
    ways = np.full(after.shape, down), np.full(after.shape, right)
    for _ in range(_ROUNDS):
        there = moved_picture(before, *ways)
        gradients = np.gradient(0.5 * (there + after))
        change = there - after
        rr, rc, cc, rt, ct = (
            _window_mean(one * other)
            for one, other in (
                (gradients[0], gradients[0]),
                (gradients[0], gradients[1]),
                (gradients[1], gradients[1]),
                (gradients[0], change),
                (gradients[1], change),
            )
        )
        rr, cc = rr + _HOLD, cc + _HOLD
        scale = rr * cc - rc**2
        steps = (cc * rt - rc * ct) / scale, (rr * ct - rc * rt) / scale
        ways = tuple(way + np.clip(step, -_MAX_STEP, _MAX_STEP) for way, step in zip(ways, steps, strict=True))  # type: ignore[assignment]
    return ways


def picture_change(before: FloatArray, after: FloatArray) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Displacement of the picture, and where the displaced picture is unlike the frame."""
    ways = picture_motion(before, after)
    rows, columns = (np.arange(length).reshape(-1, *[1] * (1 - axis)) for axis, length in enumerate(after.shape))
    outside = (rows - ways[0] < -0.5) | (rows - ways[0] > after.shape[0] - 0.5)
    outside |= (columns - ways[1] < -0.5) | (columns - ways[1] > after.shape[1] - 0.5)
    return *ways, outside | (_window_mean(np.abs(moved_picture(before, *ways) - after)) > _UNLIKE)


def moved_picture(values: FloatArray, down: FloatArray, right: FloatArray) -> FloatArray:
    """Values at the place where each pixel was; those of the border beyond it."""
    rows, columns = values.shape
    down = np.clip(np.arange(rows)[:, None] - down, 0, rows - 1)
    right = np.clip(np.arange(columns) - right, 0, columns - 1)
    top, left = np.minimum(down.astype(int), max(rows - 2, 0)), np.minimum(right.astype(int), max(columns - 2, 0))
    below, beside = min(columns, values.size - 1) if rows > 1 else 0, 1 if columns > 1 else 0
    flat, at = values.ravel(), top * columns + left
    down, right = down - top, right - left
    upper = flat[at] * (1 - right) + flat[at + beside] * right
    lower = flat[at + below] * (1 - right) + flat[at + below + beside] * right
    return np.asarray(upper * (1 - down) + lower * down)


def _mean_displacement(before: FloatArray, after: FloatArray) -> tuple[float, float]:
    """Peak of the phase correlation, refined by a parabola along each axis."""
    window = np.outer(np.hanning(before.shape[0] + 2)[1:-1], np.hanning(before.shape[1] + 2)[1:-1])
    one, two = (np.fft.rfft2((values - values.mean()) * window) for values in (before, after))
    cross = two * one.conj()
    size = np.abs(cross)
    peak = np.fft.irfft2(cross / (size + 1e-3 * size.mean() + 1e-300), before.shape)
    place = np.unravel_index(int(np.argmax(peak)), peak.shape)
    result = []
    for axis, at in enumerate(place):
        line = np.take(peak, place[1 - axis], axis=1 - axis)
        length = len(line)
        left, middle, right = (float(line[(at + k) % length]) for k in (-1, 0, 1))
        bend = left - 2 * middle + right
        part = 0.5 * (left - right) / bend if bend < 0 else 0.0
        result.append(float((at + length // 2) % length - length // 2) + part)
    return result[0], result[1]


def _window_mean(values: FloatArray) -> FloatArray:
    """Means over windows of 9 × 9 pixels, those of the border repeated beyond it."""
    for axis in (0, 1):
        reach = min(_REACH, values.shape[axis] - 1)
        width = 2 * reach + 1
        padded = np.pad(values, [(reach + 1, reach) if k == axis else (0, 0) for k in (0, 1)], mode="edge")
        sums = np.cumsum(padded, axis=axis)
        length = values.shape[axis]
        values = (sums.take(range(width, width + length), axis) - sums.take(range(length), axis)) / width
    return values
