"""The lens's point-spread function: a truncated Gaussian over the pixels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ocisac_fast.scene.geometry import Array, Pinhole

_REACH = 6.0  # standard deviations


def margin(lens: Pinhole) -> int:
    """Radius of the point-spread function in pixels."""
    return math.ceil(_REACH * lens.blur)


def left_out(lens: Pinhole) -> float:
    """Bound on the error of the truncation, whose light is added to the rest, as a share of the brightest pixel."""
    if not lens.blur:
        return 0.0
    return 4.0 * math.erfc((margin(lens) + 0.5) / (math.sqrt(2.0) * lens.blur))  # removed and added, on both axes


def widened(lens: Pinhole) -> Pinhole:
    """The lens extended by the margin on every side: its pixel (margin, margin) is (0, 0) of the original."""
    more = margin(lens)
    if not more:
        return lens
    x, y = lens.centre
    return replace(
        lens, columns=lens.columns + 2 * more, rows=lens.rows + 2 * more, principal_point=(x + more, y + more)
    )


def spread(lens: Pinhole, light: Array, top: int, left: int) -> tuple[Array, int, int]:
    """Convolve light on pixels of the widened lens; returns it on pixels of the lens with top and left."""
    more = margin(lens)
    edges = (np.arange(-more, more + 2) - 0.5) / (math.sqrt(2.0) * lens.blur)
    weights = np.diff([math.erf(edge) for edge in edges])
    weights /= weights.sum()
    for axis in (0, 1):
        wide = np.zeros([size + 2 * more * (k == axis) for k, size in enumerate(light.shape)])
        for shift, weight in enumerate(weights):
            cut = [slice(None), slice(None)]
            cut[axis] = slice(shift, shift + light.shape[axis])
            wide[tuple(cut)] += weight * light
        light = wide
    first = top - 2 * more, left - 2 * more  # in pixels of the lens
    begin = [max(0, -place) for place in first]
    end = [
        min(size - place, extent)
        for size, place, extent in zip((lens.rows, lens.columns), first, light.shape, strict=True)
    ]
    cut = [slice(a, max(a, b)) for a, b in zip(begin, end, strict=True)]
    return light[tuple(cut)], first[0] + begin[0], first[1] + begin[1]
