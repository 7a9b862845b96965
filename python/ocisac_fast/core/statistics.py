"""Means over frames, and whether the frames agree."""

from __future__ import annotations

import math

import numpy as np

from ocisac_fast.core.arrays import Float64s

_CHANCE = 5.0  # standard errors
_SAME = 0.1  # relative difference from most frames


def inverse_variance_weights(spreads: Float64s) -> Float64s:
    """Normalised inverse variances of the frames with a result; equal weights if any variance is 0."""
    known = np.isfinite(spreads)
    inverse = np.zeros_like(spreads)
    inverse[known] = (
        1.0 if (spreads[known] == 0.0).any() else (spreads[known].min(initial=np.inf) / spreads[known]) ** 2
    )
    return inverse / inverse.sum() if known.any() else inverse


def weighted_mean(values: Float64s, weights: Float64s) -> float:
    """Weighted mean over the frames with a result; NaN if there are none."""
    answered = weights > 0.0
    return float(values[answered] @ weights[answered]) if answered.any() else math.nan


def mean_and_std(values: Float64s, spreads: Float64s) -> tuple[float, float]:
    """Mean weighted by inverse variance, and its standard error: by the frames' scatter where it is larger by more
    than chance."""
    weights = inverse_variance_weights(spreads)
    mean, variance = weighted_mean(values, weights), weighted_mean(spreads**2 * weights, weights)
    freedom = np.count_nonzero(weights) - 1
    if freedom > 0:
        scatter = weighted_mean((values - mean) ** 2, weights) / freedom
        if scatter > variance * (1.0 + _CHANCE * math.sqrt(2.0 / freedom)):
            variance = scatter
    return mean, math.sqrt(variance)


def do_differ(values: Float64s, spreads: Float64s) -> bool:
    """True if some values are by a tenth, and by five standard errors, more or less than most: of another light."""
    known = np.isfinite(values) & np.isfinite(spreads)
    if not known.any():
        return False
    typical = np.median(values[known])
    return bool(np.any(np.abs(values - typical)[known] > np.maximum(_SAME * abs(typical), _CHANCE * spreads[known])))
