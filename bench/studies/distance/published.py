"""Figures that others published, with their parameters, beside those of this library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from ocisac_fast.camera.camera import Camera
from ocisac_fast.chips import ChipClock, chip_llr, closest_pair_distance, expose_chips
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.light.waveforms import Chips, SquareWave, integrate_exposure
from ocisac_fast.lights import detect_sources
from ocisac_fast.packets import encode_line_code

# Matus et al., Sensors 20 (2020) 757: largest correlation with the chips sent; clipped at a share of the peak.
MATUS_CHIP, MATUS_EXPOSURE = 1 / 3600, 300e-6  # s
MATUS = {1.0: 0.887, 0.6: 0.859, 0.4: 0.748}
# Rajagopal et al., IPSN 2014: lights this far apart.
RAJAGOPAL = tuple(2000.0 + 200.0 * k for k in range(1, 30))  # Hz

_SAMPLES = 240  # rows a chip, so that the rows' times do not matter


def correlation_after_exposure(chips: Sequence[int], chip: float, exposure: float, clipped: float = 1.0) -> float:
    """Largest correlation over all shifts between periodic chips and their exposed rows.

    Args:
        chips: 0 and 1, repeated.
        chip, exposure: s.
        clipped: rows are clipped at this share of their peak, above 0 to 1.
    """
    rows = _SAMPLES * len(chips)
    camera = Camera(chip / _SAMPLES, exposure)
    seen = integrate_exposure(Chips(np.array(chips, np.uint8), 1 / chip, repeat=True), camera, rows)
    seen = np.minimum(seen, clipped * seen.max())
    sent = np.repeat(np.asarray(chips, np.float64), _SAMPLES)
    if seen.std() == 0.0:
        return 0.0
    products = np.fft.irfft(np.fft.rfft(sent - sent.mean()) * np.conj(np.fft.rfft(seen - seen.mean())), rows)
    return float(products.max() / (rows * sent.std() * seen.std()))


@dataclass(frozen=True)
class ErrorCount:
    """Wrong chips of all."""

    wrong: int
    chips: int

    @property
    def bound(self) -> float:
        """Upper end of the error rate at 95 %: that of the mean of a Poisson count."""
        return float(chi2.ppf(0.95, 2 * self.wrong + 2)) / 2 / self.chips


def long_exposure_errors(
    exposure_chips: float, noise: float, chips: int, *, rows_per_chip: float = 4.0, seed: int = 0
) -> tuple[ErrorCount, float]:
    """Count wrong chips of Manchester code after a long exposure, with a known channel; and Q(d/2 sigma).

    d is the distance of the two closest sequences. Sequences that differ in a swapped pair of chips an exposure, from a
    frame's end on, differ by half of d² only, as the frame does not show where they begin. Every further pair is half
    as probable, since its chips have to fit, so chips within ten exposures of an end are not counted.

    Args:
        exposure_chips: exposure, chips, at most 15.
        noise: of a row, standard deviation over the swing.
        chips: number of chips to detect, about.
        rows_per_chip: at least 1.
        seed: of bits, phases and noise.
    """
    random = np.random.default_rng(seed)
    rows, wrong, counted = 4320, 0, 0
    reach, margin = math.ceil(exposure_chips / 2) + 1, math.ceil(10 * exposure_chips)
    while counted < chips:
        count = math.ceil(rows / rows_per_chip) + 2 * reach
        bits = random.integers(0, 2, count // 2 + 1).astype(np.uint8)
        sent = encode_line_code(bits, "manchester")[:count].astype(np.float64)
        clock = ChipClock(
            rows_per_chip=rows_per_chip,
            phase=float(random.uniform(0.0, rows_per_chip)),
            exposure_rows=exposure_chips * rows_per_chip,
        )
        light = expose_chips(sent, rows, clock, first=-reach) + noise * random.standard_normal(rows)
        llr = chip_llr(light, clock, noise=noise, first=-reach, count=count)
        inner = slice(margin, count - margin)
        wrong += int(np.count_nonzero((llr[inner] > 0) != sent[inner]))
        counted += count - 2 * margin
    distance = closest_pair_distance(rows_per_chip, exposure_chips * rows_per_chip)
    return ErrorCount(wrong, counted), 0.5 * math.erfc(distance / (2.0 * noise) / math.sqrt(2.0))


def simultaneous_lights(
    frequencies: Sequence[float], *, row_time: float = 18.9e-6, exposure: float = 60e-6, seed: int = 0
) -> tuple[int, int]:
    """Lights of these frequencies side by side in a picture of 1080 by 1920: how many are found, and how many false.

    A light is found if a source lies on it within a tenth of a kilohertz; every other source is false.
    """
    random = np.random.default_rng(seed)
    across = 6
    down = -(-len(frequencies) // across)
    height, width = 1080 // down, 1920 // across
    camera = Camera(row_time, exposure)
    picture = np.full((1080, 1920), 20.0)
    places = []
    y, x = np.mgrid[:height, :width]
    glow = np.exp(-(((x - width / 2) / (0.18 * width)) ** 4) - ((y - height / 2) / (0.25 * height)) ** 4)
    for k, frequency in enumerate(frequencies):
        top, left = height * (k // across), width * (k % across)
        wave = SquareWave(frequency, phase=float(random.uniform(0.0, 2.0 * math.pi)))
        light = integrate_exposure(wave, camera, height, start=top * row_time)
        picture[top : top + height, left : left + width] += 150.0 * glow * light[:, np.newaxis]
        places.append((left + width / 2, top + height / 2))
    picture += 2.0 * random.standard_normal(picture.shape)
    sources = detect_sources(np.clip(np.rint(picture), 0, 255).astype(np.uint8), camera, false_alarms=0.05)
    found: set[int] = set()
    false = 0
    for source in sources:
        on = [
            k
            for k, (x0, y0) in enumerate(places)
            if source.x <= x0 < source.x + source.width and source.y <= y0 < source.y + source.height
            if abs(source.frequency - frequencies[k]) < 100.0
        ]
        found.update(on)
        false += not on
    return len(found), false


@dataclass(frozen=True)
class OneRowSymbols:
    """Error rates at a symbol a row: of maximum likelihood, and of three zero-forcing taps, by offset in rows."""

    offsets: Float64s
    detected: Float64s
    three_taps: Float64s


def one_row_symbol_errors(noise: float, *, symbols: int = 20_000, seed: int = 0) -> OneRowSymbols:
    """A symbol a row, an exposure of one row, and an offset between both: each row sees two symbols.

    The rows are y(n) = (1 - o)·s(n) + o·s(n - 1) + noise (Zhang et al., arXiv 2602.08474; third tap: the LED).

    Args:
        noise: of a row, standard deviation over the swing.
        symbols: for each offset.
        seed: of symbols and noise.
    """
    random = np.random.default_rng(seed)
    offsets = np.arange(0.0, 0.51, 0.05)
    detected, three_taps = [], []
    for offset in offsets:
        sent = random.integers(0, 2, symbols).astype(np.float64)
        rows = (1.0 - offset) * sent + offset * np.concatenate(([sent[0]], sent[:-1]))
        rows = rows + noise * random.standard_normal(symbols)
        # Row n is exposed over n - 1/2 .. n + 1/2, and symbol k begins at k - 1/2 + offset.
        clock = ChipClock(rows_per_chip=1.0, phase=float(offset) - 0.5, exposure_rows=1.0)
        llr = chip_llr(rows, clock, noise=noise, first=-1, count=symbols + 1)[1:]
        inner = slice(4, symbols - 4)
        detected.append(np.mean((llr[inner] > 0) != sent[inner]))
        taps = _three_taps(float(offset))
        equalised = np.convolve(rows - 0.5, taps, mode="full")[1 : 1 + symbols]
        three_taps.append(np.mean((equalised[inner] > 0) != sent[inner]))
    return OneRowSymbols(offsets, np.array(detected), np.array(three_taps))


def _three_taps(offset: float) -> Float64s:
    """The three taps whose product with (1 - o, o) is nearest to an impulse, by least squares, delayed by one."""
    channel = np.array([1.0 - offset, offset])
    convolution = np.stack([np.convolve(np.eye(3)[k], channel) for k in range(3)], axis=1)
    target = np.zeros(4)
    target[1] = 1.0
    return np.asarray(np.linalg.lstsq(convolution, target, rcond=None)[0])
