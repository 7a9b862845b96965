"""A picture in bundles of columns, and the light of its rows that fits them best."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core

FloatArray = npt.NDArray[np.float64]

_MAX_COLUMNS = 192
_SLOWEST_ROWS = 128  # a light that changes slower than this cannot be told from the picture
_TEXTURE = 0.05  # relative difference of neighbours below which nothing is told
_MIN_LEFT = 0.02  # of a light, where it is divided by


class Columns:
    """A picture in at most 192 bundles of columns, and the light of its rows that fits them best."""

    def __init__(self, light: FloatArray, variance: FloatArray) -> None:
        self.light, self.variance = _bundled(light, variance)

    def refined(
        self, rows: FloatArray, basis: FloatArray | None = None, deviation: float = np.inf, steps: int = 6
    ) -> tuple[FloatArray, FloatArray]:
        """Light of each row from a light of mean 1, scaled like it, and the certainty of each, at most 1.

        ``basis`` (rows, terms): nothing else is added; ``deviation``: from ``rows``, about.
        """
        of_columns = self._share_of_columns(rows)
        most = max(float(np.quantile(of_columns, 0.95)), 1e-3)
        # One for a column: with a share of its own, a group of rows could have any swing.
        share = np.broadcast_to(np.clip(of_columns / most, 0.02, 1.0), self.light.shape)
        return self._refined(share, np.maximum(1 + most * (rows - 1), 0.0), basis, deviation, steps)

    def misfit(self, rows: FloatArray, lag: int) -> float:
        """Mean of log(texture^2 + relative difference^2) of rows ``lag`` apart, divided by a light of mean 1: lower is
        likelier. Edges of the picture are few and count little."""
        left = np.maximum(1 + self._share_of_columns(rows) * (rows[:, None] - 1), _MIN_LEFT)
        light, variance = self.light / left, self.variance / left**2
        difference, mean = light[lag:] - light[:-lag], 0.5 * (light[lag:] + light[:-lag])
        spread = difference**2 + variance[lag:] + variance[:-lag]
        told = (mean > 0.0) & np.isfinite(spread)
        return float(np.mean(np.log(_TEXTURE**2 + spread[told] / mean[told] ** 2))) if told.any() else 0.0

    def _share_of_columns(self, rows: FloatArray) -> FloatArray:
        lit = np.maximum(rows, 0.0)[None]
        return np.asarray(_core.light_share(self.light[None], self.variance[None], lit, False).mean(axis=0))

    def free(self) -> tuple[FloatArray, FloatArray]:
        """The same with nothing known of the rows."""
        rows = _without_trend(_row_means(self.light, self.variance))
        share = np.ones(self.light.shape)  # relative to the columns that show the light most
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


def lit_colours(light: FloatArray, variance: FloatArray) -> list[int]:
    """Of (rows, columns, colours) those to add up: the one that swings most, and those that swing with it as deep."""
    rows = np.stack([_row_means(light[..., k], variance[..., k]) for k in range(light.shape[2])])
    basis = slow_terms(rows.shape[1])
    swings = rows - (basis @ np.linalg.lstsq(basis, rows.T, rcond=None)[0]).T
    deviation = np.sqrt(np.mean(swings**2, axis=1)) + 1e-100
    depth = deviation / np.maximum(rows.mean(axis=1), 1e-300)
    best = int(np.argmax(deviation))
    alike = swings @ swings[best] / len(basis) / (deviation * deviation[best])
    return [k for k in range(len(rows)) if k == best or (alike[k] > 0.9 and depth[k] > 0.7 * depth[best])]


def scaled(rows: FloatArray) -> FloatArray:
    """Mean 1 and the darkest rows dark: as much of the light as is sure to be modulated."""
    rows = np.minimum(rows, 1.5 * np.quantile(rows, 0.95))  # no single row is brighter than the light
    low, mean = float(np.quantile(rows, 0.02)), float(rows.mean())
    if mean - low < 1e-9 * max(abs(mean), 1e-300):
        return np.ones_like(rows)
    dark = np.maximum((rows - low) / (mean - low), 0.0)
    return np.asarray(dark / dark.mean())


def explained(rows: FloatArray, model: FloatArray, weight: FloatArray) -> float:
    """Share of the rows' swing."""
    mean = float(np.average(rows, weights=weight))
    swing = float(weight @ (rows - mean) ** 2)
    return 1.0 - float(weight @ (rows - model) ** 2) / swing if swing > 0.0 else 0.0


def slow_terms(rows: int) -> FloatArray:
    """(rows, terms) cosines of periods above the slowest that the light may have."""
    place = (np.arange(rows) + 0.5) / rows
    return np.cos(np.pi * np.outer(place, np.arange(1 + 2 * rows // _SLOWEST_ROWS)))


def _bundled(light: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Neighbouring columns added: the light of a row is the same in all."""
    width = -(-light.shape[1] // _MAX_COLUMNS)
    if width == 1:
        return np.ascontiguousarray(light), np.ascontiguousarray(variance)
    starts = np.arange(0, light.shape[1], width)
    counts = np.diff(np.append(starts, light.shape[1]))
    return np.add.reduceat(light, starts, axis=1) / counts, np.add.reduceat(variance, starts, axis=1) / counts**2


def _row_means(light: FloatArray, variance: FloatArray) -> FloatArray:
    """Of the columns that tell something in most rows."""
    useful = np.isfinite(variance)
    columns = useful.mean(axis=0) >= min(0.9, float(useful.mean(axis=0).max()))
    kept = useful & columns
    count = kept.sum(axis=1)
    means = np.where(kept, light, 0.0).sum(axis=1) / np.maximum(count, 1)
    at = np.flatnonzero(count)
    return np.maximum(np.interp(np.arange(len(means)), at, means[at]), 0.0) if len(at) else np.ones(len(means))


def _without_trend(rows: FloatArray) -> FloatArray:
    """Divided by what changes slowly along the column: the picture, not the light."""
    if not float(rows.mean()) > 0.0:
        return np.ones_like(rows)
    basis = slow_terms(len(rows))
    trend = basis @ np.linalg.lstsq(basis, rows, rcond=None)[0]
    return np.asarray(rows / np.maximum(trend, 0.1 * float(rows.mean())))
