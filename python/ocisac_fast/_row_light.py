"""The light of every row of a banded picture, found from the picture itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera import Camera
from ocisac_fast.flags import Flag

FloatArray = npt.NDArray[np.float64]

MODELS = ("auto", "tone", "chips", "rows")
_MOST_COLUMNS = 192
_SLOWEST_ROWS = 128  # a light that changes slower than this cannot be told from the picture
# Share of the rows' swing that a model explains before it is taken for the light.
_ENOUGH_OF_TONE, _ENOUGH_OF_CHIPS = 0.5, 0.955


@dataclass(frozen=True, slots=True, eq=False)
class RowLight:
    """Light of each row, mean 1; how bright a row is that is fully lit; which model, its frequency (Hz) or NaN."""

    light: FloatArray
    full: float
    model: str
    frequency: float


@dataclass(frozen=True, slots=True)
class Kernels:
    """The core's, or the reference's."""

    light_share: Callable[[FloatArray, FloatArray, FloatArray], FloatArray] = _core.light_share
    refine_row_light: Callable[[FloatArray, FloatArray, FloatArray, FloatArray, int], tuple[FloatArray, FloatArray]] = (
        _core.refine_row_light
    )


def find_row_light(light: FloatArray, variance: FloatArray, camera: Camera, model: str, kernels: Kernels) -> RowLight:
    """From one channel of linear light (rows, columns) and its noise variance (infinite: tells nothing)."""
    grey, spread = _bundled(light, variance)
    rows = _without_trend(_row_means(grey, spread))
    rows /= rows.mean()
    share = np.ones(grey.shape)  # relative to the columns that show the light most
    rows, _ = kernels.refine_row_light(grey[None], spread[None], share, rows, 6)
    for _ in range(2):
        light_now = scaled(_without_trend(rows))
        of_columns = kernels.light_share(grey[None], spread[None], light_now[None]).mean(axis=0)
        most = max(float(np.quantile(of_columns, 0.95)), 1e-3)
        # One for a column: with a share of its own, a group of rows could have any swing.
        share[:] = np.clip(of_columns / most, 0.02, 1.0)
        rows, certainty = kernels.refine_row_light(grey[None], spread[None], share, 1 + most * (light_now - 1), 6)
    rows = scaled(_without_trend(rows))
    weight = certainty / max(float(certainty.max()), 1e-300)
    if model in ("auto", "tone"):
        tone = _tone(rows, weight, camera, always=model == "tone")
        if tone is not None:
            return tone
    if model in ("auto", "chips"):
        chips = _chips(rows, weight, camera, always=model == "chips")
        if chips is not None:
            return chips
    return RowLight(rows, float(np.quantile(rows, 0.95)), "rows", float("nan"))


def lit_channels(light: FloatArray, variance: FloatArray) -> list[int]:
    """Of (rows, columns, channels) those to add up: the one that swings most, and those that swing with it as deep."""
    rows = np.stack([_row_means(light[..., k], variance[..., k]) for k in range(light.shape[2])])
    basis = _slow(rows.shape[1])
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


def _bundled(light: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Neighbouring columns added: the light of a row is the same in all."""
    width = -(-light.shape[1] // _MOST_COLUMNS)
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


def _slow(rows: int) -> FloatArray:
    """(rows, terms) cosines of periods above the slowest that the light may have."""
    place = (np.arange(rows) + 0.5) / rows
    return np.cos(np.pi * np.outer(place, np.arange(1 + 2 * rows // _SLOWEST_ROWS)))


def _without_trend(rows: FloatArray) -> FloatArray:
    """Divided by what changes slowly along the column: the picture, not the light."""
    if not float(rows.mean()) > 0.0:
        return np.ones_like(rows)
    basis = _slow(len(rows))
    trend = basis @ np.linalg.lstsq(basis, rows, rcond=None)[0]
    return np.asarray(rows / np.maximum(trend, 0.1 * float(rows.mean())))


def _explained(rows: FloatArray, model: FloatArray, weight: FloatArray) -> float:
    mean = float(np.average(rows, weights=weight))
    swing = float(weight @ (rows - mean) ** 2)
    return 1.0 - float(weight @ (rows - model) ** 2) / swing if swing > 0.0 else 0.0


def _tone(rows: FloatArray, weight: FloatArray, camera: Camera, always: bool) -> RowLight | None:
    """Mean, harmonics and slow terms by least squares at the frequency found; None where that is not the light."""
    from ocisac_fast.frequency import find_frequency

    found = find_frequency(rows[:, None], Camera(row_time=1.0))
    if not np.isfinite(found.frequency) or (Flag.NO_TONE in found.flags and not always):
        return None
    order = np.arange(1, found.harmonics + 1)
    order = order[order * found.frequency < 0.5]
    cycles = 2 * np.pi * (np.outer(np.arange(len(rows)), order * found.frequency) % 1.0)
    periodic = np.concatenate([np.cos(cycles), np.sin(cycles)], axis=1)
    basis = np.concatenate([_slow(len(rows)), periodic], axis=1)
    root = np.sqrt(weight)
    fitted = np.linalg.lstsq(basis * root[:, None], rows * root, rcond=None)[0]
    if not always and _explained(rows, basis @ fitted, weight) < _ENOUGH_OF_TONE:
        return None
    tone = periodic @ fitted[-periodic.shape[1] :]
    tone -= tone.mean()
    darkest = -float(tone.min())
    light = 1.0 + tone / darkest if darkest > 1e-9 else np.ones_like(tone)
    return RowLight(light, float(light.max()), "tone", found.frequency / camera.row_time)


def _chips(rows: FloatArray, weight: FloatArray, camera: Camera, always: bool) -> RowLight | None:
    """The chips received, each with the response that the rows show best; None where that is not the light."""
    from ocisac_fast.receiver import receive

    got = receive(rows[:, None], camera)[0]
    if len(got.bits) < 8 or Flag.NO_SIGNAL in got.flags:
        return None
    bits = np.array([float(bit) for bit in got.bits])
    responses = _chip_responses(bits, len(rows), got.rows_per_chip, got.phase)
    basis = np.concatenate([_slow(len(rows)), responses], axis=1)
    inside = np.zeros(len(rows), bool)
    first = got.phase + got.rows_per_chip
    inside[max(int(first), 0) : max(int(first + (len(bits) - 2) * got.rows_per_chip), 0)] = True
    if inside.sum() < 4 * basis.shape[1]:
        return None
    root = np.sqrt(weight[inside])
    fitted = np.linalg.lstsq(basis[inside] * root[:, None], rows[inside] * root, rcond=None)[0]
    if not always and _explained(rows[inside], basis[inside] @ fitted, weight[inside]) < _ENOUGH_OF_CHIPS:
        return None
    count = responses.shape[1]
    chips = responses @ fitted[-count:] + (basis[:, :-count] @ fitted[:-count]).mean()
    light = scaled(np.where(inside, chips, rows))  # rows of cut chips keep their own light
    return RowLight(light, float(np.quantile(light, 0.95)), "chips", got.chip_rate)


def _chip_responses(bits: FloatArray, rows: int, rows_per_chip: float, phase: float) -> FloatArray:
    """(rows, knots): bright chips put through tents; light = sum over knots of response(knot) times theirs."""
    knots = np.arange(-1.0, 2.001, 0.25)  # chips after the beginning of a chip's ramp
    since = (np.arange(rows)[:, None] - phase) / rows_per_chip - np.arange(len(bits))  # (rows, chips)
    tents = [(np.maximum(0.0, 1.0 - np.abs(since - knot) / 0.25) * bits).sum(axis=1) for knot in knots]
    return np.stack(tents, axis=1)
