"""The exposure's response, and exposure integration in NumPy's extended precision."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.waveforms import (
    Chips,
    Constant,
    Product,
    Samples,
    SquareWave,
    Sum,
    Tone,
    TriangleWave,
    Waveform,
)

Long = npt.NDArray[np.longdouble]


def exposure_response(frequency: npt.ArrayLike, exposure: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """As :func:`ocisac_fast.exposure_response`: sinc(f T_e) exp(-j pi f T_e), phase reduced to one period."""
    cycles = np.asarray(frequency, dtype=np.float64) * np.asarray(exposure, dtype=np.float64)
    return np.asarray(np.sinc(cycles) * np.exp(-1j * np.pi * np.fmod(cycles, 2.0)))


_TURN = 2 * np.arccos(np.longdouble(-1))
_NODES, _WEIGHTS = (np.longdouble(values) for values in np.polynomial.legendre.leggauss(20))


def integrate_exposure(
    waveform: Waveform,
    camera: Camera,
    rows: int | npt.ArrayLike,
    start: float = 0.0,
    frames: int | npt.ArrayLike | None = None,
    out: npt.NDArray[np.float64] | None = None,
) -> npt.NDArray[np.float64]:
    """Mean light over the exposure of each row, (F(t_n) - F(t_n - T_e)) / T_e.

    F is the antiderivative, with t counted in periods or chips from a whole number of them near t_n - T_e. Products are
    integrated numerically: 20 Gauss-Legendre nodes between all edges and at least twice per period. All values are long
    double, with an error of about 1e-18 of the number of periods.
    """
    assert camera.exposure is not None
    ends = np.longdouble(start) + _numbers(rows) * np.longdouble(camera.row_period)
    if frames is not None:
        assert camera.frame_time is not None
        ends = ends + _numbers(frames)[:, np.newaxis] * np.longdouble(camera.frame_time)
    exposure = np.longdouble(camera.exposure)
    means = _means(waveform, ends, exposure) if exposure > 0 else _values(waveform, ends)
    result = means.astype(np.float64)
    if out is None:
        return result
    out[...] = result
    return out


def sample_waveform(waveform: Waveform, times: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """The waveform's value at given times, by its definition."""
    return _values(waveform, np.asarray(times, dtype=np.longdouble)).astype(np.float64)


def _numbers(numbers: int | npt.ArrayLike) -> Long:
    array = np.asarray(numbers)
    return (np.arange(int(array)) if array.ndim == 0 else array).astype(np.longdouble)


def _cycles(waveform: Any, times: Long) -> Long:
    """Periods or chips since the beginning of the first."""
    if isinstance(waveform, Tone | SquareWave | TriangleWave):
        return np.asarray(np.longdouble(waveform.frequency) * times + np.longdouble(waveform.phase) / _TURN)
    rate = waveform.chip_rate if isinstance(waveform, Chips) else waveform.sample_rate
    return np.asarray(np.longdouble(rate) * (times - np.longdouble(waveform.start)))


def _corners(waveform: Chips | Samples, first: int, last: int) -> tuple[Long, Long]:
    """Light at the beginning and at the end of the chips or intervals first .. last - 1."""
    index = np.arange(first, last + 1)
    if isinstance(waveform, Samples):
        count = len(waveform.values)
        index = index % count if waveform.repeat else np.clip(index, 0, count - 1)
        values = waveform.values[index].astype(np.longdouble)
        return values[:-1], values[1:]
    index = index[:-1]
    count = len(waveform.levels)
    inside = (index >= 0) & (index < count) | waveform.repeat
    levels = np.where(inside, waveform.levels[index % count], 0.0) * np.longdouble(waveform.amplitude)
    return levels, levels


def _values(waveform: Waveform, times: Long) -> Long:
    if isinstance(waveform, Constant):
        return np.full(times.shape, np.longdouble(waveform.level))
    if isinstance(waveform, Sum):
        return np.asarray(np.sum([_values(part, times) for part in waveform.parts], axis=0))
    if isinstance(waveform, Product):
        return np.asarray(np.prod([_values(part, times) for part in waveform.parts], axis=0))
    cycles = _cycles(waveform, times)
    if isinstance(waveform, Tone):
        swing = np.longdouble(waveform.depth) / 2 * np.cos(_TURN * (cycles - np.rint(cycles)))
        return np.asarray(np.longdouble(waveform.amplitude) * (swing + np.longdouble(0.5)))
    if isinstance(waveform, TriangleWave):
        distance = np.abs(cycles - np.rint(cycles))
        swing = np.longdouble(waveform.depth) / 2 * (1 - 4 * distance)
        return np.asarray(np.longdouble(waveform.amplitude) * (swing + np.longdouble(0.5)))
    if isinstance(waveform, SquareWave):
        bright = np.abs(cycles - np.floor(cycles + 0.5)) < np.longdouble(waveform.duty) / 2
        return np.where(bright, np.longdouble(waveform.amplitude), np.longdouble(0))
    assert isinstance(waveform, Chips | Samples)
    if isinstance(waveform, Chips) and (waveform.rise or waveform.fall):
        return _decays(waveform, cycles)[0]
    whole = np.floor(cycles).astype(np.int64)
    first = int(whole.min())
    at_begin, at_end = _corners(waveform, first, int(whole.max()) + 1)
    return np.asarray(at_begin[whole - first] + (cycles - whole) * (at_end - at_begin)[whole - first])


def _means(waveform: Waveform, ends: Long, exposure: np.longdouble) -> Long:
    if isinstance(waveform, Constant):
        return np.full(ends.shape, np.longdouble(waveform.level))
    if isinstance(waveform, Sum):
        return np.asarray(np.sum([_means(part, ends, exposure) for part in waveform.parts], axis=0))
    if isinstance(waveform, Product):
        level = np.prod([np.longdouble(part.level) for part in waveform.parts if isinstance(part, Constant)])
        changing = [part for part in waveform.parts if not isinstance(part, Constant)]
        if len(changing) == 1:
            return np.asarray(level * _means(changing[0], ends, exposure))
        return np.array([_quadrature(waveform, end, exposure) for end in ends.ravel()]).reshape(ends.shape)
    begins = _cycles(waveform, ends - exposure)
    if isinstance(waveform, Tone | SquareWave | TriangleWave) and waveform.frequency == 0:
        return _values(waveform, ends)
    if isinstance(waveform, Tone | SquareWave | TriangleWave):
        length, begins = np.longdouble(waveform.frequency) * exposure, begins - np.floor(begins)
        mean = (_wave_antiderivative(begins + length, waveform) - _wave_antiderivative(begins, waveform)) / length
        if isinstance(waveform, SquareWave):
            return np.asarray(np.longdouble(waveform.amplitude) * mean)
        return np.asarray(np.longdouble(waveform.amplitude) / 2 * (1 + np.longdouble(waveform.depth) * mean))
    assert isinstance(waveform, Chips | Samples)
    rate = waveform.chip_rate if isinstance(waveform, Chips) else waveform.sample_rate
    length = np.longdouble(rate) * exposure
    if isinstance(waveform, Chips) and (waveform.rise or waveform.fall):
        sums = _decays(waveform, np.stack([begins, begins + length]))[1]
        return np.asarray((sums[1] - sums[0]) / length)
    first = int(np.floor(begins.min()))
    at_begin, at_end = _corners(waveform, first, int(np.floor((begins + length).max())) + 1)
    light = np.concatenate([[np.longdouble(0)], np.cumsum((at_begin + at_end) / 2)])

    def antiderivative(cycles: Long) -> Long:
        cell = np.floor(cycles).astype(np.int64)
        part = cycles - cell
        cell = cell - first
        return np.asarray(light[cell] + part * at_begin[cell] + part**2 / 2 * (at_end - at_begin)[cell])

    return np.asarray((antiderivative(begins + length) - antiderivative(begins)) / length)


def _decays(chips: Chips, times: Long) -> tuple[Long, Long]:
    """Light of chips with time constants, and its integral from the first chip needed on, at times in chips.

    In a chip y = level + (y_0 - level) exp(-u/T). From 45 time constants before the first time on, whose light at that
    instant does not matter.
    """
    cell = np.floor(times).astype(np.int64)
    settling = int(np.ceil(45 * max(chips.rise, chips.fall))) + 1
    first = int(cell.min()) - settling
    levels = np.asarray(_corners(chips, first, int(cell.max()) + 1)[0])
    heights, sums = np.zeros((2, levels.size), np.longdouble)
    constants = np.full(levels.size, np.longdouble(1))
    light, total = np.longdouble(0), np.longdouble(0)
    for k, level in enumerate(levels):
        constant = np.longdouble(chips.rise if light < level else chips.fall)
        if constant > 0:
            heights[k], constants[k] = light - level, constant
        sums[k] = total
        light = level + heights[k] * np.exp(-1 / constants[k])
        if k >= settling:
            total += level - heights[k] * constants[k] * np.expm1(-1 / constants[k])
    part, at = times - cell, cell - first
    left = -part / constants[at]
    decayed = -constants[at] * np.expm1(left)
    return levels[at] + heights[at] * np.exp(left), sums[at] + part * levels[at] + heights[at] * decayed


def _wave_antiderivative(cycles: Long, wave: Tone | SquareWave | TriangleWave) -> Long:
    """Antiderivative of the light over cycles: a square wave from 0 to 1, others from -1 to 1."""
    if isinstance(wave, Tone):
        return np.asarray(np.sin(_TURN * cycles) / _TURN)
    if isinstance(wave, SquareWave):
        whole = np.floor(cycles + 0.5)
        half = np.longdouble(wave.duty) / 2
        return np.asarray(2 * half * whole + np.clip(cycles - whole, -half, half))
    part = cycles - np.rint(cycles)
    return np.asarray(part - 2 * part * np.abs(part))


def _quadrature(waveform: Waveform, end: np.longdouble, exposure: np.longdouble) -> np.longdouble:
    begin = end - exposure
    edges = _edges(waveform, begin, end)
    steps = int(np.ceil(2 * _fastest(waveform) * float(exposure))) + 1
    knots = np.unique(np.concatenate([edges, begin + exposure * np.arange(steps + 1) / np.longdouble(steps)]))
    half = np.diff(knots) / 2
    values = _values(waveform, (knots[:-1] + half)[:, np.newaxis] + half[:, np.newaxis] * _NODES)
    return np.longdouble(np.sum(half * (values @ _WEIGHTS)) / (2 * np.sum(half)))


def _edges(waveform: Waveform, begin: np.longdouble, end: np.longdouble) -> Long:
    """Instants in the interval at which the light or its slope jumps."""
    if isinstance(waveform, Sum | Product):
        return np.concatenate([_edges(part, begin, end) for part in waveform.parts])
    if isinstance(waveform, Constant | Tone) or (
        isinstance(waveform, SquareWave | TriangleWave) and waveform.frequency == 0
    ):
        return np.zeros(0, np.longdouble)
    first, last = (_cycles(waveform, np.asarray(time)) for time in (begin, end))
    whole = np.arange(int(np.floor(first)), int(np.floor(last)) + 2).astype(np.longdouble)
    rate: float
    if isinstance(waveform, SquareWave):
        half, rate = np.longdouble(waveform.duty) / 2, waveform.frequency
        whole = np.concatenate([whole - half, whole + half])
    elif isinstance(waveform, TriangleWave):
        rate, whole = waveform.frequency, np.concatenate([whole, whole + np.longdouble(0.5)])
    else:
        rate = waveform.chip_rate if isinstance(waveform, Chips) else waveform.sample_rate  # type: ignore[attr-defined]
    times = begin + (whole - first) / np.longdouble(rate)
    return np.asarray(times[(times > begin) & (times < end)])


def _fastest(waveform: Waveform) -> float:
    """The highest frequency in the product or sum of its tones."""
    if isinstance(waveform, Sum | Product):
        frequencies = [_fastest(part) for part in waveform.parts]
        return sum(frequencies) if isinstance(waveform, Product) else max(frequencies)
    return waveform.frequency if isinstance(waveform, Tone) else 0.0
