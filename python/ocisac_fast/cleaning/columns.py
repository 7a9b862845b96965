"""Estimation of the row light from a picture in bundles of columns."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core

FloatArray = npt.NDArray[np.float64]

_MAX_COLUMNS, _LEAST_COLUMNS, _MAX_SAMPLES = 192, 48, 1 << 17  # bundles of columns, and their rows
_SLOWEST_ROWS = 128  # rows; slower changes of the light cannot be distinguished from the picture


def block_rows(rows: int, lag: int) -> int:
    """Rows whose means show the shares of columns as well as each does: few against the lag, 512 means at least."""
    return max(1, min(lag // 4, rows // 512))


def merged(values: FloatArray, count: int) -> FloatArray:
    """Means of ``count`` neighbouring rows."""
    if count == 1:
        return values
    starts = np.arange(0, len(values), count)
    counts = np.diff(np.append(starts, len(values)))
    return np.asarray(np.add.reduceat(values, starts, axis=0) / counts.reshape(-1, *[1] * (values.ndim - 1)))


class Columns:
    """A picture in at most 192 bundles of columns, and least-squares estimates of its row light."""

    def __init__(self, light: FloatArray, variance: FloatArray, share: FloatArray | None = None) -> None:
        """``share``: of the light in each column, where it is known."""
        self.light, self.variance = _bundled(light, variance)
        self._share = None
        if share is not None:
            width = -(-len(share) // self.light.shape[1])
            starts = np.arange(0, len(share), width)
            self._share = np.add.reduceat(share, starts) / np.diff(np.append(starts, len(share)))

    def refined(
        self, rows: FloatArray, basis: FloatArray | None = None, deviation: float = np.inf, steps: int = 6
    ) -> tuple[FloatArray, FloatArray]:
        """Refine a row light of mean 1; returns it with its scale kept, and the weight of each row, at most 1.

        ``basis`` (rows, terms) restricts the result to its span; ``deviation``: expected deviation from ``rows``.
        """
        of_columns = self._share_of_columns(rows)
        most = max(float(np.quantile(of_columns, 0.95)), 1e-3)
        # One share per column: with a share per pixel, a group of rows could have any swing.
        share = np.broadcast_to(np.clip(of_columns / most, 0.02, 1.0), self.light.shape)
        return self._refined(share, np.maximum(1 + most * (rows - 1), 0.0), basis, deviation, steps)

    def depth(self, rows: FloatArray) -> float:
        """Mean share of a row light of mean 1."""
        return float(self._share_of_columns(rows).mean())

    def misfit(self, rows: FloatArray, lag: int) -> float:
        """Misfit of rows ``lag`` apart after division by a light of mean 1."""
        share = self._share_of_columns(rows)
        return _core.row_misfit(self.light[None], self.variance[None], rows[None], share, lag)

    def _share_of_columns(self, rows: FloatArray) -> FloatArray:
        if self._share is not None:
            return self._share
        lit = np.maximum(rows, 0.0)[None]
        count = block_rows(len(rows), _core.comparison_lag(lit))
        light, variance = (merged(values, count) for values in (self.light, self.variance / count))
        return np.asarray(_core.light_share(light[None], variance[None], merged(lit.T, count).T, False).mean(axis=0))

    def free(self) -> tuple[FloatArray, FloatArray]:
        """Estimate the row light without a model or initial value."""
        rows = _without_trend(_row_means(self.light, self.variance))
        share = np.ones(self.light.shape)  # relative to the columns with the largest share
        rows, certainty = self._refined(share, rows / rows.mean())
        for _ in range(2):
            rows, certainty = self.refined(scaled(_without_trend(rows)))
        return scaled(_without_trend(rows)), certainty

    def _refined(
        self,
        share: FloatArray,
        rows: FloatArray,
        basis: FloatArray | None = None,
        deviation: float = np.inf,
        steps: int = 6,
    ) -> tuple[FloatArray, FloatArray]:
        rows, certainty = _core.refine_row_light(
            self.light[None], self.variance[None], share, rows, steps, basis, deviation
        )
        return rows, certainty / max(float(certainty.max()), 1e-300)


def alike_colours(light: FloatArray, variance: FloatArray) -> list[list[int]]:
    """Groups of colours of (rows, columns, colours) with nearly the same course and depth, largest swing first."""
    rows = np.stack([_row_means(light[..., k], variance[..., k]) for k in range(light.shape[2])])
    basis = slow_terms(rows.shape[1])
    swings = rows - (basis @ np.linalg.lstsq(basis, rows.T, rcond=None)[0]).T
    deviation = np.sqrt(np.mean(swings**2, axis=1)) + 1e-100
    depth = deviation / np.maximum(rows.mean(axis=1), 1e-300)
    alike = swings @ swings.T / len(basis) / np.outer(deviation, deviation)
    groups: list[list[int]] = []
    left = sorted(range(len(rows)), key=lambda k: -deviation[k])
    while left:
        best = left[0]
        groups.append([k for k in left if k == best or (alike[k, best] > 0.9 and depth[k] > 0.7 * depth[best])])
        left = [k for k in left if k not in groups[-1]]
    return groups


def scaled(rows: FloatArray) -> FloatArray:
    """Scale rows to mean 1 and the darkest ones to 0: the part of the light that is certainly modulated."""
    rows = np.minimum(rows, 1.5 * np.quantile(rows, 0.95))  # limits outliers above full light
    low, mean = float(np.quantile(rows, 0.02)), float(rows.mean())
    if mean - low < 1e-9 * max(abs(mean), 1e-300):
        return np.ones_like(rows)
    dark = np.maximum((rows - low) / (mean - low), 0.0)
    return np.asarray(dark / dark.mean())


def explained(rows: FloatArray, model: FloatArray, weight: FloatArray) -> float:
    """Share of the rows' weighted variance that the model explains."""
    mean = float(np.average(rows, weights=weight))
    swing = float(weight @ (rows - mean) ** 2)
    return 1.0 - float(weight @ (rows - model) ** 2) / swing if swing > 0.0 else 0.0


def slow_terms(rows: int) -> FloatArray:
    """(rows, terms) cosines of the periods above `_SLOWEST_ROWS`, with a constant."""
    place = (np.arange(rows) + 0.5) / rows
    return np.cos(np.pi * np.outer(place, np.arange(1 + 2 * rows // _SLOWEST_ROWS)))


def _bundled(light: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Average neighbouring columns, since all columns of a row have the same light."""
    most = max(_LEAST_COLUMNS, min(_MAX_COLUMNS, _MAX_SAMPLES // light.shape[0]))
    width = -(-light.shape[1] // most)
    if width == 1:
        return np.ascontiguousarray(light), np.ascontiguousarray(variance)
    starts = np.arange(0, light.shape[1], width)
    counts = np.diff(np.append(starts, light.shape[1]))
    return np.add.reduceat(light, starts, axis=1) / counts, np.add.reduceat(variance, starts, axis=1) / counts**2


def _row_means(light: FloatArray, variance: FloatArray) -> FloatArray:
    """Row means over the columns that are valid in most rows."""
    useful = np.isfinite(variance)
    columns = useful.mean(axis=0) >= min(0.9, float(useful.mean(axis=0).max()))
    kept = useful & columns
    count = kept.sum(axis=1)
    means = np.where(kept, light, 0.0).sum(axis=1) / np.maximum(count, 1)
    at = np.flatnonzero(count)
    return np.maximum(np.interp(np.arange(len(means)), at, means[at]), 0.0) if len(at) else np.ones(len(means))


def _without_trend(rows: FloatArray) -> FloatArray:
    """Divide by the slow changes along the column, which are attributed to the picture."""
    if not float(rows.mean()) > 0.0:
        return np.ones_like(rows)
    basis = slow_terms(len(rows))
    trend = basis @ np.linalg.lstsq(basis, rows, rcond=None)[0]
    return np.asarray(rows / np.maximum(trend, 0.1 * float(rows.mean())))
