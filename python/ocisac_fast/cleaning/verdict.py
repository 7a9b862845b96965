"""What cleaning achieved, measured on the result, and whether the picture is better left alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.cleaning.columns import FloatArray, misfit, slow_terms

_GROUPS = 24  # of columns
MAX_JUDGED_COLUMNS = 256  # of a picture
MIN_LEFT = 1 / 8  # lower bound of a light that is a divisor
_FLOOR = 0.01  # of the mean light, below which logarithms show noise
_MIN_GAIN = 0.03  # of the log-likelihood of a pair of pixels; texture without a light gives less
_HALF_LEFT, _MUCH_LEFT = 0.5, 0.6  # of the row light
_MIN_LEVEL = 0.25  # coherence of level bands; of a light on part of the picture 0.4 and more
_MAX_WORSE = 0.25  # share of the columns


@dataclass(frozen=True, slots=True)
class Verdict:
    """Measured on one colour of a frame, or averaged over its colours.

    Attributes:
        light_left: swing of the row light in the columns after cleaning, over that before.
        texture_change: energy of texture after cleaning over that before, dB.
        gain: decrease of the misfit of rows a few apart.
        worse: share of the columns whose misfit increases.
        level: coherence of the bands over the columns, 1 for level bands, 0 for tilted ones.
        slow_bands: amplitude, relative to the light, of bands above 128 rows that are left; 0 if none are likely.
        energy: of the row light's swing in the columns before cleaning.
    """

    light_left: float
    texture_change: float
    gain: float
    worse: float
    level: float
    slow_bands: float
    energy: float

    @property
    def objection(self) -> str:
        """Why the picture is better left alone; "" where it is not."""
        if self.light_left > 1.0:
            return "the bands would be stronger than before"
        if self.gain < _MIN_GAIN and (self.light_left > _HALF_LEFT or self.gain < 0.0):
            return "no light of the rows: they would differ as much as before"
        if self.light_left > _MUCH_LEFT and self.level < _MIN_LEVEL:
            return "bands that tilt or curve"
        if self.light_left > _MUCH_LEFT and self.worse > _MAX_WORSE:
            return "some columns would get worse"
        return ""


def judged(light: FloatArray, variance: FloatArray, rows: FloatArray, share: FloatArray, slow_bands: float) -> Verdict:
    """Compare one colour (rows, columns) of linear light before and after division by its row light with its shares.

    ``variance``: of the noise before, infinite for pixels without data; ``slow_bands``: see :class:`Verdict`.
    """
    before = light
    left = np.maximum(1 + share * (rows[:, None] - 1), MIN_LEFT)
    after = before / left
    lag = _core.comparison_lag(rows[None])
    pairs = ((before, variance), (after, variance / left**2))
    whole = [misfit(values, spread, lag) for values, spread in pairs]
    parts = np.array_split(np.arange(left.shape[1]), min(_GROUPS, left.shape[1]))
    grown = [np.diff([misfit(values[:, part], spread[:, part], lag) for values, spread in pairs]) > 0 for part in parts]
    kept = np.isfinite(variance) & (left > MIN_LEFT)
    first, second = _group_means(before, np.isfinite(variance)), _group_means(after, kept)
    course = _course(rows)
    swings, swings_left = course.T @ first, course.T @ second
    energy = float((swings**2).sum())
    mean = swings.mean(axis=1)
    return Verdict(
        light_left=float(np.sqrt((swings_left**2).sum() / energy)) if energy > 0 else 0.0,
        texture_change=_decibels(_texture(after, kept), _texture(before, kept)),
        gain=whole[0] - whole[1],
        worse=float(np.mean(grown)),
        level=float(mean @ mean) * swings.shape[1] / energy if energy > 0 else 1.0,
        slow_bands=slow_bands,
        energy=energy,
    )


def mean_verdict(verdicts: list[Verdict]) -> Verdict:
    """The mean of each number, weighted by the energy of the row light's swing: dark colours show noise."""
    weights = np.array([one.energy for one in verdicts])
    weights = weights if weights.sum() > 0 else np.ones(len(verdicts))
    return Verdict(
        *(float(np.average([getattr(one, name) for one in verdicts], weights=weights)) for name in Verdict.__slots__)
    )


def _group_means(light: FloatArray, kept: npt.NDArray[np.bool_]) -> FloatArray:
    """(rows, groups) mean light of groups of columns; the mean of the group in rows that lack pixels."""
    starts = np.unique(np.linspace(0, light.shape[1], _GROUPS, endpoint=False).astype(int))
    sums = np.add.reduceat(np.where(kept, light, 0.0), starts, axis=1)
    counts = np.add.reduceat(kept, starts, axis=1, dtype=np.int64)
    whole = counts >= np.maximum(0.8 * counts.max(axis=0), 1)
    values = sums / np.maximum(counts, 1)
    means = np.where(whole, values, 0.0).sum(axis=0) / np.maximum(whole.sum(axis=0), 1)
    return np.asarray(np.where(whole, values, means))


def _course(rows: FloatArray) -> FloatArray:
    """(rows, 2): orthonormal course of the row light and its derivative, which a shift adds, without slow changes."""
    slow, _ = np.linalg.qr(slow_terms(len(rows)))
    terms = np.stack([rows - rows.mean(), np.gradient(rows)], axis=1)
    fast = terms - slow @ (slow.T @ terms)
    u, sizes, _ = np.linalg.svd(fast, full_matrices=False)
    return np.asarray(u * (sizes > 1e-9 * max(float(sizes.max()), 1e-300)))


def _texture(light: FloatArray, kept: npt.NDArray[np.bool_]) -> float:
    """Energy of the mixed differences of log light over rows and columns, in which bands and gains cancel."""
    across = np.diff(np.log(np.maximum(light, 0.0) + _FLOOR * max(float(light.mean()), 1e-300)), axis=1)
    valid = kept[1:, 1:] & kept[:-1, 1:] & kept[1:, :-1] & kept[:-1, :-1]
    mixed = (across[1:] - across[:-1])[valid]
    return float(np.mean(mixed**2)) if mixed.size else 0.0


def _decibels(after: float, before: float) -> float:
    return float(10 * np.log10(after / before)) if after > 0 and before > 0 else 0.0
