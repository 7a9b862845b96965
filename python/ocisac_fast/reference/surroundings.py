"""Other tones and distortion in a column of a periodic light, from their equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

MAX_TONES = 3
PEAK = 20.0  # of the residual's periodogram over its noise floor, above which a tone is significant
EXPLAINED = 0.05  # max. share of the residual's energy above the noise that may remain beside the tones
CORRELATED = 6.0  # standard errors of a correlation from row to row above which a residual is not white


@dataclass(frozen=True)
class Light:
    """A fitted light: cycles per row, cycles in an exposure (NaN: not known), duty of a square wave (0: a tone)."""

    cycles: float
    exposure_cycles: float = np.nan
    duty: float = 0.0


@dataclass(frozen=True)
class Surroundings:
    """Components of a column besides its lights.

    Attributes:
        tones: cycles per row of additive tones to be fitted with the lights.
        inseparable: True if one of them is within one cycle per frame of a light.
        distortion: amplitude of the harmonics that fit neither waveform nor exposure, over that of the light; 0 if it
            is not significant.
    """

    tones: tuple[float, ...] = ()
    inseparable: bool = False
    distortion: float = 0.0


def is_white(residual: FloatArray) -> bool:
    """True if the correlations at lags 1 and 2 are those of white noise."""
    energy = residual @ residual
    correlations = [abs(residual[lag:] @ residual[:-lag]) for lag in (1, 2)]
    return bool(max(correlations) <= CORRELATED / np.sqrt(residual.size) * energy)


def surroundings(column: FloatArray, lights: list[Light]) -> Surroundings:
    """Additive tones and harmonic distortion of a column of linear light, (rows,)."""
    rows = column.size
    harmonics = _comb(lights, rows)
    if not harmonics:
        return Surroundings()
    steady = _basis(harmonics, rows, 0)
    distortion = max(_distortion(column - column.mean(), light, harmonics, steady) for light in lights)
    for degree in (0, 2):  # of the light's course along the rows
        basis = steady if degree == 0 else _basis(harmonics, rows, degree)
        tones = _search(column, basis)
        if tones is None:
            continue
        if any(_modulates(tones, light.cycles, rows) for light in lights):
            continue
        near = any(abs(tone - light.cycles) * rows < 1 for tone in tones for light in lights)
        return Surroundings(tuple(tones), near, distortion)
    return Surroundings((), False, distortion)


def _comb(lights: list[Light], rows: int) -> list[float]:
    """All harmonics of the lights below half the row rate, ascending, at least a quarter of a bin apart."""
    every = sorted(h * light.cycles for light in lights for h in range(1, rows) if h * light.cycles < 0.5 - 0.5 / rows)
    kept: list[float] = []
    for cycles in every:
        if not kept or cycles - kept[-1] > 0.25 / rows:
            kept.append(cycles)
    return kept[: rows // 8]


def _basis(harmonics: list[float], rows: int, degree: int) -> FloatArray:
    """Orthonormal basis of polynomials times the mean and each harmonic, (rows, parameters)."""
    u = np.arange(rows) - (rows - 1) / 2
    polynomials = np.polynomial.legendre.legvander(2 * u / rows, degree)
    parts = [polynomials]
    for cycles in harmonics:
        if (2 * len(parts) + 1) * (degree + 1) > rows // 2:
            break
        wave = _wave(cycles, rows)
        parts += [polynomials * wave[:, :1], polynomials * wave[:, 1:]]
    return np.linalg.qr(np.hstack(parts))[0]


def _wave(cycles: float, rows: int) -> FloatArray:
    angle = 2 * np.pi * cycles * (np.arange(rows) - (rows - 1) / 2)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _beside(basis: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors - basis @ (basis.T @ vectors))


def _floor(residual: FloatArray) -> float:
    """Variance of white noise: median of the upper half of the periodogram over that of an exponential variate."""
    power = np.abs(np.fft.rfft(residual)) ** 2 / residual.size
    return float(np.median(power[power.size // 2 :]) / np.log(2))


def _energy(cycles: float, basis: FloatArray, residual: FloatArray) -> float:
    """Energy that a tone explains beside the basis."""
    wave = _beside(basis, _wave(cycles, residual.size))
    if np.linalg.norm(wave) ** 2 < 1e-3 * residual.size:
        return 0.0
    return float((np.linalg.qr(wave)[0].T @ residual) @ (np.linalg.qr(wave)[0].T @ residual))


def _search(column: FloatArray, basis: FloatArray) -> list[float] | None:
    """Tones that leave white noise; None without tones, or if three do not explain the residual."""
    rows = column.size
    first = residual = _beside(basis, column)
    floor = _floor(residual)
    excess = residual @ residual - floor * rows
    tones: list[float] = []
    while len(tones) < MAX_TONES:
        power = np.abs(np.fft.rfft(residual, 4 * rows)) ** 2 / rows
        power[:4] = 0  # below one cycle
        peak = int(np.argmax(power))
        if power[peak] < PEAK * floor:
            return None
        grid = (peak + np.arange(-4, 5)) / (4 * rows)
        grid = np.clip(grid, 1 / rows, 0.5 - 1 / rows)
        tones.append(float(grid[int(np.argmax([_energy(cycles, basis, residual) for cycles in grid]))]))
        tones, residual = _refine(tones, basis, first)
        left = residual @ residual - floor * rows
        if left < max(EXPLAINED * excess, 4 * floor * np.sqrt(2 * rows)):
            return None if min(tones) * rows < 1.2 else tones
    return None


def _refine(tones: list[float], basis: FloatArray, column: FloatArray) -> tuple[list[float], FloatArray]:
    """Gauss-Newton on all frequencies together; also what is left of ``column``."""
    rows = column.size
    u = np.arange(rows) - (rows - 1) / 2
    for _ in range(6):
        waves = np.hstack([_wave(tone, rows) for tone in tones])
        beside = _beside(basis, waves)
        levels = np.linalg.lstsq(beside, column, rcond=1e-6)[0]
        slopes = np.stack(
            [
                2 * np.pi * u * (levels[2 * k + 1] * waves[:, 2 * k] - levels[2 * k] * waves[:, 2 * k + 1])
                for k in range(len(tones))
            ],
            axis=1,
        )
        both = np.hstack([beside, _beside(basis, slopes)])
        steps = np.linalg.lstsq(both, column, rcond=1e-6)[0][2 * len(tones) :]
        moves = np.clip(steps, -0.25 / rows, 0.25 / rows)
        tones = [float(np.clip(tone + move, 1 / rows, 0.5 - 1 / rows)) for tone, move in zip(tones, moves, strict=True)]
    beside = _beside(basis, np.hstack([_wave(tone, rows) for tone in tones]))
    return tones, np.asarray(column - beside @ np.linalg.lstsq(beside, column, rcond=1e-6)[0])


def _modulates(tones: list[float], cycles: float, rows: int) -> bool:
    """True for sidebands of a light that varies along the rows: f + d and d, or f + d and f - d."""
    sides = [(tone - cycles) * rows for tone in tones]
    slow = any(
        abs(abs(side) - tone * rows) < 0.6 or abs(side) < 0.3 for side in sides for tone in tones if tone * rows < 3
    )
    pairs = any(abs(a + b) < 0.6 for k, a in enumerate(sides) for b in sides[:k])
    return slow or pairs


def _distortion(column: FloatArray, light: Light, harmonics: list[float], basis: FloatArray) -> float:
    """:func:`harmonic_distortion` of all harmonics in a column."""
    rows = column.size
    last = int(0.5 / light.cycles * (1 - 1 / rows))
    orders = [h for h in range(1, last + 1) if min(abs(h * light.cycles - np.array(harmonics))) < 1e-12]
    if not orders:
        return 0.0
    design = np.hstack([np.ones((rows, 1)), *[_wave(h * light.cycles, rows) for h in orders]])
    levels = np.linalg.lstsq(design, column, rcond=None)[0][1:]
    residual = _beside(basis, column)
    noise = 2 / rows * (residual @ residual) / max(rows - basis.shape[1], 1)
    return harmonic_distortion(light, orders, levels[::2] - 1j * levels[1::2], float(noise))


def harmonic_distortion(light: Light, orders: list[int], lines: npt.NDArray[np.complex128], variance: float) -> float:
    """Relative amplitude of what waveform and exposure do not explain of the harmonics; 0 where not significant.

    Args:
        light: of which the harmonics are.
        orders: of the harmonics, the first 1.
        lines: a - jb of each, for a cos + b sin over the rows from the middle.
        variance: of a and b.
    """
    orders_of = np.asarray(orders)
    size = abs(lines[0])
    known = light.duty and light.exposure_cycles >= 0 and abs(np.sinc(light.exposure_cycles)) >= 0.05
    if not known or orders_of.size < 2 or orders_of[0] != 1 or not size > 0:
        return 0.0

    def ratios(exposure_cycles: float) -> FloatArray:
        duty = np.sin(np.pi * orders_of * light.duty) / (orders_of * np.sin(np.pi * light.duty))
        return np.asarray(duty * np.sinc(orders_of * exposure_cycles) / abs(np.sinc(exposure_cycles)))

    ratio = ratios(light.exposure_cycles)[1:]
    slope = size * (ratios(1.001 * light.exposure_cycles) - ratios(0.999 * light.exposure_cycles))[1:] / 0.002
    turned = lines * np.conj((lines[0] / size * np.sign(np.sinc(light.exposure_cycles))) ** orders_of)
    along, across = (turned.real[1:] - size * ratio), turned.imag[1:]
    # Harmonics above half the row rate fold onto these: their RMS, from the envelope of the first of them.
    beyond = 0.5 / light.cycles
    variance += (0.3 * size / (beyond * max(1.0, np.pi * beyond * light.exposure_cycles))) ** 2
    variance_along, variance_across = variance * (1 + ratio**2), variance * (1 + (orders_of[1:] * ratio) ** 2)
    square = float((slope**2 / variance_along).sum())
    longer = float((along * slope / variance_along).sum()) / square if square > 0 else 0.0
    along = along - np.clip(longer, -0.1, 0.1) * slope  # exposures up to 10 % off are admitted
    misfit = (along**2 / variance_along + across**2 / variance_across).sum()
    freedom = 2 * along.size
    if misfit < freedom + 6 * np.sqrt(2 * freedom) + 12:
        return 0.0
    return float(np.sqrt((along**2 + across**2).sum()) / size)
