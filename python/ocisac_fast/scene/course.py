"""Bounds of a waveform before its integration: limits, mean, and deviation of the exposure's mean from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import numpy as np

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
    sample_waveform,
)

_MAX_LINES = 64

Lines = list[tuple[float, complex]]  # waveform = sum of Re(a * exp(2j pi f t))


@dataclass(frozen=True)
class Course:
    """Bounds of a waveform."""

    low: float  # limits, with high
    high: float
    mean: float  # over all time; the middle of the limits if there is none
    stray: float  # bound on |mean over an exposure - mean|
    swing: float  # bound on the range of the antiderivative of waveform - mean, over the exposure; infinite: unknown
    slope: float  # largest, 1/s; infinite: edges, or unknown
    lines: Lines | None  # the waveform as a sum of cosines; None if it is not one

    @property
    def steady(self) -> bool:
        return self.stray == 0

    @property
    def most(self) -> float:
        """Largest magnitude."""
        return max(abs(self.low), abs(self.high))


def check_light(waveform: Waveform) -> None:
    """Raise ValueError for an object that is not a waveform, and for light below 0."""
    low = limits(waveform)[0]
    if not low >= -1e-12:
        raise ValueError(f"waveform: got light down to {low:g}, allowed: 0 or above")


def limits(waveform: Waveform) -> tuple[float, float]:
    """Lowest and highest light, or bounds on them."""
    if isinstance(waveform, Sum):
        ends = [limits(part) for part in waveform.parts]
        return sum(low for low, _ in ends), sum(high for _, high in ends)
    if isinstance(waveform, Product):
        return reduce(_product_limits, [limits(part) for part in waveform.parts])
    values = _extremes(waveform)
    return min(values), max(values)


def _product_limits(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    values = [x * y for x in a for y in b]
    return min(values), max(values)


def _extremes(waveform: Waveform) -> list[float]:
    if isinstance(waveform, Constant):
        return [waveform.level]
    if isinstance(waveform, (Tone, TriangleWave)):
        return [waveform.amplitude / 2 * (1 + sign * waveform.depth) for sign in (-1, 1)]
    if isinstance(waveform, SquareWave):
        return [0.0, waveform.amplitude]
    if isinstance(waveform, Chips):
        levels = waveform.amplitude * waveform.levels
        return [*([] if waveform.repeat else [0.0]), float(levels.min()), float(levels.max())]
    if isinstance(waveform, Samples):
        return [float(waveform.values.min()), float(waveform.values.max())]
    raise ValueError(f"waveform: got {type(waveform).__name__}, allowed: the waveforms of this package")


def _lines(waveform: Waveform) -> Lines | None:
    if isinstance(waveform, Constant):
        return [(0.0, complex(waveform.level))]
    if isinstance(waveform, Tone):
        half = waveform.amplitude / 2
        wave = half * waveform.depth * complex(math.cos(waveform.phase), math.sin(waveform.phase))
        if waveform.frequency == 0:
            return [(0.0, complex(half + wave.real))]
        return [(0.0, complex(half)), (waveform.frequency, wave)]
    if isinstance(waveform, (Sum, Product)):
        parts = [_lines(part) for part in waveform.parts]
        found: Lines = []
        for index, part in enumerate(parts):
            if part is None:
                return None
            together = isinstance(waveform, Sum) or index == 0
            found = found + part if together else _product_lines(found, part)
            if len(found) > _MAX_LINES:
                return None
        return found
    return None


def _product_lines(first: Lines, second: Lines) -> Lines:
    found: Lines = []
    for f, a in first:
        for g, b in second:
            if f == 0 or g == 0:
                found.append((f + g, a.real * b if f == 0 else a * b.real))
            else:
                low = a * b.conjugate() / 2 if f >= g else a.conjugate() * b / 2
                found += [(f + g, a * b / 2), (abs(f - g), complex(low.real) if f == g else low)]
    return found


def _one_period(waveform: Waveform, exposure: float) -> tuple[float, float] | None:
    """Mean of a periodic waveform, and range of the antiderivative of waveform - mean over the exposure."""
    if isinstance(waveform, SquareWave):
        if waveform.frequency == 0:
            return float(sample_waveform(waveform, 0.0)), 0.0
        spread = abs(waveform.amplitude) * waveform.duty * (1 - waveform.duty)
        return waveform.amplitude * waveform.duty, spread / (waveform.frequency * exposure)
    if isinstance(waveform, TriangleWave):
        if waveform.frequency == 0:
            return float(sample_waveform(waveform, 0.0)), 0.0
        swing = abs(waveform.amplitude) / 2 * waveform.depth
        return waveform.amplitude / 2, swing / (4 * waveform.frequency * exposure)  # half a period of one sign
    if isinstance(waveform, Chips) and waveform.repeat and not waveform.rise and not waveform.fall:
        levels = waveform.amplitude * waveform.levels
        sums = np.concatenate([[0.0], np.cumsum(levels - levels.mean())])
        return float(levels.mean()), float(np.ptp(sums)) / (waveform.chip_rate * exposure)
    if isinstance(waveform, Samples) and waveform.repeat:
        values = waveform.values - waveform.values.mean()
        sums = np.concatenate([[0.0], np.cumsum((values + np.roll(values, -1)) / 2)])
        between = float(np.ptp(values)) / 4  # max. distance of a parabola from its chord
        return float(waveform.values.mean()), (float(np.ptp(sums)) + 2 * between) / (waveform.sample_rate * exposure)
    return None


def course(waveform: Waveform, exposure: float) -> Course:
    """Compute the bounds of a waveform under an exposure (s)."""
    low, high = limits(waveform)
    lines = _lines(waveform)
    middle, half = (low + high) / 2, (high - low) / 2
    if lines is not None:
        mean = sum(a.real for f, a in lines if f == 0)
        stray = sum(abs(a) * abs(float(np.sinc(f * exposure))) for f, a in lines if f > 0)
        swing = sum(abs(a) / (math.pi * f * exposure) for f, a in lines if f > 0)
        slope = sum(abs(a) * 2 * math.pi * f for f, a in lines)
        return Course(low, high, mean, stray, swing, slope, lines)
    repeated = _one_period(waveform, exposure)
    if repeated is not None:
        mean, swing = repeated
        return Course(low, high, mean, min(swing, max(high - mean, mean - low)), swing, math.inf, None)
    if isinstance(waveform, Sum):
        parts = [course(part, exposure) for part in waveform.parts]
        total = (sum(part.mean for part in parts), sum(part.stray for part in parts), sum(part.swing for part in parts))
        return Course(low, high, *total, math.inf, None)
    return Course(low, high, middle, half, math.inf, math.inf, None)
