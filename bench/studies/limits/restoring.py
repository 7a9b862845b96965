"""Limits of equalisation, nulls of the response and exposures longer than the frame, and of the removal of bands."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from grounds import add_boxes

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning import remove_bands
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.light.waveforms import Tone, Waveform, integrate_exposure, sample_waveform
from ocisac_fast.tones.equalization import equalize
from studies.limits.catalogue import Point, limit, rms
from studies.limits.plain_methods import circular_inverse

_ROW_TIME = 22.2e-6
_NO_LIMIT = 1e12  # boost
_NOISE = 0.01  # of the swing


def _restored(light: Waveform, frequency: float, x: float, rows: int, exposure_rows: float) -> Point:
    """RMS errors / swing at least two exposures from the ends, if there are such rows, for light of the given highest
    frequency with 1 % noise."""
    camera = Camera(_ROW_TIME, exposure_rows * _ROW_TIME)
    starts = np.linspace(0.0, 0.05, 40)
    blurred = np.stack([integrate_exposure(light, camera, rows, start=start) for start in starts], axis=1)
    truth = sample_waveform(light, np.arange(rows)[:, None] * _ROW_TIME + starts)
    columns = blurred + _NOISE * np.random.default_rng(12).standard_normal(blurred.shape)
    restored, report = equalize(columns, camera, report=True)
    ends = min(round(2 * exposure_rows), rows // 3)
    inner = slice(ends, rows - ends)

    def error(values: Float64s) -> float:
        return rms((values - truth)[inner])

    plain = error(circular_inverse(columns, camera, _NO_LIMIT))
    lost = any(low <= frequency <= high for low, high in report.frequencies_lost)
    return Point(x, plain, error(restored), _NOISE * rms(report.noise_gain), lost=lost)


@limit("Sinc null: equalisation", "exposure, rows", "RMS error / swing, 1 % noise", spot=24, fails_by=10.0, good=0.05)
def _null_equalisation() -> Iterator[Point]:
    for exposure_rows in (1.5, 3, 6, 12, 24, 45):
        highest = 0.3 / (exposure_rows * _ROW_TIME)  # well inside the first lobe
        light = Tone(highest, amplitude=0.5) + Tone(0.45 * highest, amplitude=0.5, phase=1.0)
        yield _restored(light, highest, exposure_rows, 1080, exposure_rows)


@limit(
    "Exposure longer than the frame",
    "exposure / frame",
    "RMS error / swing, 1 % noise",
    spot=2.0,
    fails_by=100.0,
    good=0.06,
    silent=(0.5,),
)
def _long_exposure() -> Iterator[Point]:
    frequency = 1.6 / (240 * _ROW_TIME)
    shares = (0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 4.0)
    for share in shares:
        yield _restored(Tone(frequency), frequency, share, 240, share * 240)


def _picture_with_a_horizon(random: np.random.Generator, rows: int = 360, columns: int = 96) -> Float64s:
    """Boxes of other brightness, DN; the lower two thirds are darker."""
    picture = np.full((rows, columns), 60.0)
    add_boxes(picture, random, (8, 90), (36.0, 120.0), count=40, margin=10)
    picture[rows // 3 :] *= 0.7
    return picture


def _cleaned(cycles: float, seeds: tuple[int, ...] = (1, 2, 3)) -> Point:
    """RMS errors / mean after one gain, of pictures under a lamp that gives half of the light, noise 1 DN."""
    plain: list[float] = []
    library: list[float] = []
    said = 0
    for seed in seeds:
        random = np.random.default_rng(seed)
        clean = _picture_with_a_horizon(random)
        camera = Camera(_ROW_TIME, 100e-6)
        lamp = integrate_exposure(Tone(cycles / (len(clean) * _ROW_TIME)), camera, len(clean))
        banded = clean * (0.5 + lamp)[:, None] + random.standard_normal(clean.shape)
        stored = np.clip(np.rint(banded), 0, 255).astype(np.uint8)
        done = remove_bands(stored, camera)
        said += done.remarks[0] != ""
        for values, errors in ((stored / stored.mean(axis=1, keepdims=True), plain), (done.frames * 1.0, library)):
            gain = (values * clean).sum() / (values * values).sum()
            errors.append(rms((gain * values - clean) / clean.mean()))
    return Point(cycles, rms(plain), rms(library), math.nan, lost=2 * said > len(seeds))


@limit(
    "Bands over a picture",
    "cycles in the picture",
    "RMS error / mean after one gain",
    spot=12,
    fails_by=0.15,
    good=0.07,
    silent=(2.0,),
)
def _bands() -> Iterator[Point]:
    for cycles in (0.5, 1.0, 1.5, 2.0, 3.0, 6.0, 12.0, 24.0, 48.0):
        yield _cleaned(cycles)
