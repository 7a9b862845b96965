"""Least-squares fit of :mod:`ocisac_fast.sensing`: one frequency for all columns, free amplitudes and phases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast._core import linear_fit, product
from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.core.arrays import Float64s

Complexes = npt.NDArray[np.complex128]

_SEARCHED = 8  # max. number of blocks of 64 columns in a search
_STEPS = 12
_RIDES = 3
_SETTLED = 1e-3  # of the mean light
_TREND, _WANDER = 4, 12  # degrees: of the slow light, and of what changes a tone's frequency and shape
_NEAR = 1e-9  # relative: weights within a basis
_FEW = 4  # rows for each wave of a basis that is worth its while


@dataclass(frozen=True, slots=True)
class Model:
    """Slow light and, modulating it, a tone with harmonics and others, over the rows of a column, from its middle."""

    cycles: float  # of the tone per row
    tones: tuple[float, ...]  # cycles per row of its harmonics and of the other tones
    harmonics: tuple[int, ...]  # of the tone, 1 first
    shape: Float64s  # (rows,) envelope of the tones, mean 1
    design: Float64s  # (rows, parameters): Legendre polynomials; shape times cosine and sine of harmonics, other tones
    weights: Float64s  # its pseudo-inverse
    covariance: Float64s  # of the parameters, for noise of variance 1
    steering: tuple[int, ...]  # harmonics that estimate the frequency: those below the noise would disturb it
    slope: Float64s  # derivative of design by cycles for these harmonics
    first: int  # index of the fundamental's cosine

    @property
    def stiffening(self) -> Float64s:
        """(rows, parameters): ``slope`` projected onto the complement of ``design``."""
        return np.asarray(self.slope - product(self.design, product(self.weights, self.slope)))


@dataclass(frozen=True, slots=True)
class Fitted:
    """Fit of the columns of a region."""

    model: Model
    parameters: Float64s  # (frames, parameters, columns)
    noise: Float64s  # (frames, columns), variance of a row
    cycles_std: float  # standard error of model.cycles; 0 for a given frequency

    @property
    def mean(self) -> Float64s:
        """(frames, columns) mean light."""
        return np.asarray(self.parameters[:, 0])

    @property
    def tone(self) -> Complexes:
        """(frames, columns), z of Re(z exp(2 pi j cycles n)), n = 0 the middle row."""
        return np.asarray(self.parameters[:, self.model.first] - 1j * self.parameters[:, self.model.first + 1])


def trend_degree(cycles: float) -> int:
    """Degree of the slow light: 0 below 2 cycles in the frame, 1 below 4, 2 below 8, as in ``find_frequency``; else 4,
    which fits a lamp near a wall."""
    return 0 if cycles < 2 else 1 if cycles < 4 else 2 if cycles < 8 else 4


def harmonics_of(duty: float, cycles: float, rows: int, exposure_cycles: float) -> tuple[tuple[int, ...], float]:
    """Harmonics of a square wave: those below half the row rate, limited to the number that half the rows can resolve,
    and those above it that show beside all others; and the relative error of the gain by the rest."""
    below = [h for h in _core.square_wave_harmonics(cycles, duty)[1:] if h * cycles < 0.5 - 1.0 / rows]
    folded, error = _core.folded_harmonics(rows, cycles, duty, exposure_cycles)
    return (1, *below[: max(0, rows // 4 - 4)], *folded), error


def make_model(
    rows: int,
    cycles: float,
    harmonics: Sequence[int],
    others: Sequence[float],
    degree: int | None = None,
    steering: Sequence[int] | None = None,
    shape: Float64s | None = None,
) -> Model:
    """Make a model. ``others``: cycles per row of other tones; ``degree`` of the slow light, by default from the
    cycles; ``steering``: by default all harmonics; ``shape``: by default constant."""
    degree = trend_degree(cycles * rows) if degree is None else degree
    steering = tuple(harmonics) if steering is None else tuple(steering)
    shape = np.ones(rows) if shape is None else shape
    first = degree + 1
    tones = (*(h * cycles for h in harmonics), *others)
    design = _core.tone_design(rows, list(tones), degree)
    design[:, first:] *= shape[:, None]
    from_middle = np.arange(rows) - 0.5 * (rows - 1)
    slope = np.zeros_like(design)
    for place, harmonic in enumerate(harmonics):
        cosine = first + 2 * place
        lever = 2.0 * np.pi * harmonic * from_middle if harmonic in steering else np.zeros(rows)
        slope[:, cosine] = -lever * design[:, cosine + 1]
        slope[:, cosine + 1] = lever * design[:, cosine]
    return Model(cycles, tones, tuple(harmonics), shape, design, *pseudo_inverse(design), steering, slope, first)


def with_tones_shaped_by_light(columns: Columns, model: Model, background: float, others: Sequence[float]) -> Model:
    """The model with tones modulated by the slow light that all columns and frames share: where the light decreases
    along the rows, the tones do too. ``shape`` is constant if that light comes near 0.

    Tones fitted with a wrong shape bias the slow light; three iterations converge for a ratio of 7 to 1.
    """
    for _ in range(_RIDES if model.first > 1 else 0):
        parameters, _squares = columns.project(model.weights, model.tones)
        slow = model.design[:, : model.first] @ parameters[:, : model.first].mean(axis=(0, 2)) - background
        if not slow.min() > 0.1 * slow.mean():
            break
        shape = np.asarray(slow / slow.mean())
        settled = np.abs(shape - model.shape).max() < _SETTLED
        model = make_model(len(shape), model.cycles, model.harmonics, others, model.first - 1, model.steering, shape)
        if settled:
            break
    return model


def with_harmonics_above_noise(fitted: Fitted, others: Sequence[float]) -> Model:
    """The model with its frequency estimated by the harmonics that exceed the noise."""
    model = fitted.model
    spread = np.diagonal(model.covariance)
    chance = 1.0 + max(1.0, 4.0 / np.sqrt(fitted.noise.size))
    steering = [1]
    for place, harmonic in enumerate(model.harmonics[1:], 1):
        part = slice(model.first + 2 * place, model.first + 2 * place + 2)
        noise = float(fitted.noise.sum() * spread[part].sum())
        if float((fitted.parameters[:, part] ** 2).sum()) > chance * noise:
            steering.append(harmonic)
    return make_model(len(model.design), model.cycles, model.harmonics, others, model.first - 1, steering, model.shape)


def pseudo_inverse(design: Float64s) -> tuple[Float64s, Float64s]:
    """Pseudo-inverse and its product with its transpose, by QR, or by singular values if the columns of the design are
    nearly collinear."""
    weights, covariance, condition = linear_fit(design)
    if design.shape[0] >= design.shape[1] and condition < 1e9:
        return weights, covariance
    inverse: Float64s = np.asarray(np.linalg.pinv(design), np.float64)
    return inverse, inverse @ inverse.T


class Columns:
    """The columns of a region over frames, and sums over their rows.

    A model is fitted by several rounds of sums whose weights differ little. ``repeated`` sums are computed from those
    with a basis of all weights near the first ones: polynomials, alone and times its tones. Frames are read once.

    Args:
        frames: (frames, rows, columns) as stored.
        camera: their response, rows in time order.
        repeated: sums are wanted several times.
    """

    def __init__(self, frames: npt.NDArray[Any], camera: Camera, *, repeated: bool = False) -> None:
        self.frames, self.camera = frames, camera
        self._repeated = repeated
        self._holds_bytes = frames.dtype == np.uint8 and camera.tone_curve == "linear"
        self._basis: Float64s | None = None  # (rows, waves), orthonormal
        self._sums = self._squares = self._pairs = np.empty(0)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.frames.shape[1])

    def across(self, weights: Float64s) -> Iterator[Float64s]:
        """(rows, outputs) sums over the columns of each frame, weighted by (frames, outputs, columns)."""
        for frame, of_frame in zip(self.frames, weights, strict=True):
            if self._holds_bytes:  # float32 adds 1e-5 of the noise of bytes
                stored = frame.astype(np.float32, order="C") @ of_frame.T.astype(np.float32)  # one order of the sums
                yield stored.astype(np.float64) - self.camera.dark_level * of_frame.sum(axis=1)
            else:
                yield product(linear_light(frame, self.camera), of_frame.T)

    def project(self, weights: Float64s, tones: Sequence[float]) -> tuple[Float64s, Float64s]:
        """(frames, outputs, columns) weighted sums over the rows, and (frames, columns) sums of squares.

        ``tones``: cycles per row of those in the weights.
        """
        if self._repeated and self._within_basis(weights) is None and self.rows >= _FEW * _waves(len(tones)):
            self._basis = _basis(self.rows, tones)
            self._sums, self._squares = self._read(self._basis.T, limbs=2)
            self._pairs = _pairs(self._sums)
        within = self._within_basis(weights)
        if within is None:
            return self._read(weights)
        return np.stack([product(within, sums) for sums in self._sums]), self._squares

    def products(self, weights: Float64s, tones: Sequence[float]) -> Float64s:
        """(outputs, outputs) products of pairs of the sums of ``project``, summed over frames and columns."""
        within = self._within_basis(weights)
        if within is None:
            return _pairs(self.project(weights, tones)[0])
        return product(product(within, self._pairs), within.T)

    def _within_basis(self, weights: Float64s) -> Float64s | None:
        """The weights in terms of the basis; None where it does not contain them."""
        if self._basis is None:
            return None
        within = product(weights, self._basis)
        rest = np.linalg.norm(weights - product(within, self._basis.T), axis=1)
        return within if bool((rest <= _NEAR * np.linalg.norm(weights, axis=1)).all()) else None

    def _read(self, weights: Float64s, limbs: int = 3) -> tuple[Float64s, Float64s]:
        """``limbs`` of 13 bits for the weights of bytes: an error of 2e-8 (2) or 2e-12 (3) of the largest weight."""
        sums, squares = [], []
        if self._holds_bytes:
            dark, of_rows = self.camera.dark_level, _core.RowWeights(weights, self.rows, 1, limbs)
            for frame in self.frames:
                stored, total, square, _ = _core.project(frame, of_rows)
                sums.append(stored - dark * weights.sum(axis=1)[:, None])
                squares.append(square - 2.0 * dark * total + self.rows * dark**2)
        else:
            for frame in self.frames:
                light = linear_light(frame, self.camera)
                sums.append(product(weights, light))
                squares.append(np.einsum("nk,nk->k", light, light))
        return np.stack(sums), np.stack(squares)


def _pairs(sums: Float64s) -> Float64s:
    flat = sums.swapaxes(0, 1).reshape(sums.shape[1], -1)
    return product(flat, flat.T)


def _waves(tones: int) -> int:
    """Size of the basis."""
    return _TREND + 1 + 2 * tones * (_WANDER + 1)


def _basis(rows: int, tones: Sequence[float]) -> Float64s:
    """(rows, waves) orthonormal: a tone whose frequency or shape changes a little is itself times a polynomial.

    Each wave is even or odd about the middle row, which halves the products in an even number of rows.
    """
    powers = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, rows), _WANDER)
    carriers = _core.tone_design(rows, list(tones), 0)[:, 1:]
    products = (carriers[:, :, None] * powers[:, None, :]).reshape(rows, -1)
    waves = np.hstack([powers[:, : _TREND + 1], products])
    even = (waves * waves[::-1]).sum(axis=0) > 0.0
    parts = [(sign, np.linalg.qr(waves[:, chosen])[0]) for sign, chosen in ((1.0, even), (-1.0, ~even))]
    return np.hstack([0.5 * (part + sign * part[::-1]) for sign, part in parts])


def fit(columns: Columns, model: Model, cycles_std: float = 0.0) -> Fitted:
    """Fit amplitudes and noise of every column at the model's frequency."""
    parameters, squares = columns.project(model.weights, model.tones)
    gram = product(model.design.T, model.design)
    explained = np.stack([np.einsum("pk,pk->k", one, product(gram, one)) for one in parameters])
    spare = columns.rows - model.design.shape[1]
    noise = np.maximum(squares - explained, 0.0) / spare if spare > 0 else np.full_like(squares, np.nan)
    return Fitted(model, parameters, noise, cycles_std)


def refine(columns: Columns, model: Model, others: Sequence[float]) -> Model:
    """Refine the frequency by least squares over all columns and frames: Gauss-Newton from a start within its basin.

    The amplitudes of each column are projected out (variable projection), so a step needs only the products of a few
    row weights with the columns.
    """
    rows, best = columns.rows, model
    reach = 0.25 / (rows * model.steering[-1])
    for _ in range(_STEPS):
        away = best.stiffening
        products = columns.products(np.vstack([best.weights, away.T]), best.tones)
        unknowns = len(best.weights)
        stiffness = float((products[:unknowns, :unknowns] * product(away.T, away)).sum())
        step = float(products[:unknowns, unknowns:].trace()) / stiffness if stiffness > 0 else 0.0
        step = min(max(step, -reach), reach)
        best = make_model(rows, best.cycles + step, best.harmonics, others, best.first - 1, best.steering, best.shape)
        if abs(step) * rows < 1e-10:
            break
    return best


def frequency_std(columns: Columns, fitted: Fitted) -> float:
    """Standard error of the cycles per row: that of white noise or that of the residual row by row, whichever is
    larger, since columns may share their noise."""
    model = fitted.model
    away, design = model.stiffening, model.design
    spread = 0.0
    stiffness = -float(fitted.noise.sum() * (product(away.T, away) * model.covariance).sum())  # bias by noise
    for light, parameters in zip(columns.across(fitted.parameters), fitted.parameters, strict=True):
        products = product(parameters, parameters.T)
        force = np.einsum("np,np->n", away, light - product(design, products))  # on the residual of a row
        spread += float(force @ force)
        stiffness += float((product(away, products) * away).sum())
    rows, unknowns = design.shape
    if not (stiffness > 0.0 and rows > unknowns):
        return float("nan")
    white = float(fitted.noise.mean()) * stiffness
    return float(np.sqrt(max(spread * rows / (rows - unknowns), white)) / stiffness)


def search_columns(frames: npt.NDArray[Any], camera: Camera, others: Sequence[float]) -> npt.NDArray[Any]:
    """Frames for a search: up to eight blocks of 64 columns without the other tones. Columns are not summed, unlike in
    ``find_frequency`` above 64, since a moving texture would cancel."""
    count = min(len(frames), _SEARCHED)
    columns = frames.shape[2]
    blocks = max(1, min(columns // 64, _SEARCHED // count))
    places = np.linspace(0, columns - 1, min(columns, 64 * blocks)).round().astype(int)
    chosen = frames[np.linspace(0, len(frames) - 1, count).round().astype(int)][:, :, places]
    if others:
        light = linear_light(chosen, camera)
        model = make_model(chosen.shape[1], 0.0, (), others, degree=2)
        waves = model.design[:, model.first :]
        chosen = light - waves @ (model.weights[model.first :] @ light)
    if blocks == 1:
        return np.asarray(chosen)
    split = chosen.reshape(count, chosen.shape[1], blocks, 64)
    return np.ascontiguousarray(split.swapaxes(1, 2)).reshape(count * blocks, chosen.shape[1], 64)


@dataclass(frozen=True, slots=True)
class PhaseAdvance:
    """Advance of the tone's phase from one series to the next (columns or frames)."""

    cycles: float  # per step, in (-1/2, 1/2]; NaN for a single series
    std: float  # its standard error


def phase_advance(tones: Complexes, component_variance: float) -> PhaseAdvance:
    """The advance per step that maximises sum_i |sum_k z_ki exp(-2 pi j cycles k)|^2, z of shape (steps, series)."""
    steps = len(tones)
    if steps < 2 or not np.abs(tones).any():
        return PhaseAdvance(float("nan"), float("nan"))
    length = 4 * (1 << (steps - 1).bit_length())
    power = (np.abs(np.fft.fft(tones, length, axis=0)) ** 2).sum(axis=1)
    cycles = float(np.fft.fftfreq(length)[int(power.argmax())])
    place = np.arange(steps) - 0.5 * (steps - 1)
    for _ in range(8):
        still = tones * np.exp(-2j * np.pi * cycles * place)[:, None]
        total, moment, second = still.sum(axis=0), place @ still, place**2 @ still
        pull = float((np.conj(total) * moment).imag.sum())
        curve = float((np.conj(total) * second).real.sum() - (np.abs(moment) ** 2).sum())
        if curve <= 0.0:
            break
        cycles += pull / (2.0 * np.pi * curve)
    mean = still.mean(axis=0)
    stiffness = float((place**2).sum() * (np.abs(mean) ** 2).sum())
    freedom = tones.size - tones.shape[1] - 1
    across = (still * np.exp(-1j * np.angle(mean))).imag
    variance = max(component_variance, float((across**2).sum()) / freedom if freedom > 0 else 0.0)
    std = float(np.sqrt(variance / stiffness)) / (2.0 * np.pi) if stiffness > 0 else float("nan")
    return PhaseAdvance(0.5 - (0.5 - cycles) % 1.0, std)


def phase_spread(tones: Complexes, component_variance: float) -> tuple[float, bool]:
    """Spread of the phases of (frames, columns) about their common phase in each frame: RMS in rad after subtraction of
    the noise, and True if it exceeds the noise by four standard errors."""
    frames, columns = tones.shape
    freedom = frames * (columns - 1)
    if freedom < 1 or not np.abs(tones).any():
        return 0.0, False
    common = np.exp(-1j * np.angle(tones.sum(axis=1, keepdims=True)))
    turned = tones * common
    power = np.abs(tones) ** 2
    beyond = float((turned.imag**2).sum()) / freedom - component_variance
    significant = beyond > 4.0 * component_variance * np.sqrt(2.0 / freedom)
    facing_away = float(power[turned.real < 0.0].sum() / power.sum())
    return float(np.sqrt(max(beyond, 0.0) / power.mean())) + facing_away, bool(significant)
