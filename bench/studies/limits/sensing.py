"""Limits of sensing: motion along the rows, motion from frames alone, contrast suppressed by the exposure."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.flags import Flag
from ocisac_fast.reference import tone_gain
from ocisac_fast.sensing.contrast import restore_contrast
from ocisac_fast.sensing.motion import KnownMotion
from ocisac_fast.sensing.region import sense_region
from ocisac_fast.tones.frequency import find_frequency
from studies.limits.catalogue import Point, limit, rms, shared_flags
from studies.limits.plain_methods import circular_inverse

_ROW_TIME, _FRAME_TIME, _EXPOSURE = 22.2e-6, 1 / 30, 622e-6
_TEXTURE, _PITCH = 230.0, 1e-4  # cycles per metre, metres per row
_CAMERA = Camera(_ROW_TIME, _EXPOSURE, _FRAME_TIME)


def _along(speed: float, frames: int, seed: int) -> Float64s:
    """A texture that moves along the rows against the read-out, mean 100, noise 2."""
    j, n, _ = np.ogrid[:frames, :720, :10]
    f = _TEXTURE * speed
    turns = _TEXTURE * _PITCH * n + f * (n * _ROW_TIME + j * _FRAME_TIME - 0.5 * _EXPOSURE)
    light = 100.0 * (1.0 + np.sinc(f * _EXPOSURE) * np.cos(2.0 * np.pi * turns)) + np.zeros((frames, 720, 10))
    return np.asarray(light + 2.0 * np.random.default_rng(seed).standard_normal(light.shape))


def _motion(speed: float, spatial_frequency: float | None = None) -> Point:
    """Errors of f_x v over six pairs of frames."""
    frames = [_along(speed, 2, seed) for seed in range(6)]
    truth = _TEXTURE * speed
    plain = [find_frequency(one[0], _CAMERA).frequency - truth for one in frames]
    known = KnownMotion(pitch=_PITCH, spatial_frequency=spatial_frequency)
    found = [sense_region(one, _CAMERA, motion=known) for one in frames]
    errors = [one.motion_frequency - truth for one in found]
    flags = shared_flags(np.array([one.flags for one in found], np.uint32))
    return Point(speed, rms(plain), rms(errors), rms([one.motion_frequency_std for one in found]), flags)


_SPEEDS = (0.02, 0.05, 0.15, 0.5, 1.751, 3.0)


_limit_of_speed = functools.partial(
    limit,
    sweep="speed against the read-out, m/s",
    error="RMS error of f_x·v, Hz",
    spot=1.751,
    fails_by=500.0,
    good=0.05,
    flags=Flag.AMBIGUOUS_MOTION | Flag.AMBIGUOUS_KIND,
)


@_limit_of_speed("Motion along the rows")
def _motion_along() -> Iterator[Point]:
    for speed in _SPEEDS:
        yield _motion(speed, spatial_frequency=_TEXTURE)


@_limit_of_speed("Motion from two frames alone")
def _motion_frames() -> Iterator[Point]:
    for speed in _SPEEDS:
        yield _motion(speed)


@limit(
    "Contrast that the exposure took",
    "f_x·v·T_e",
    "error of the restored gain",
    spot=0.6,
    fails_by=1.0,
    good=0.02,
    flags=Flag.NEAR_NULL | Flag.WEAK,
)
def _restored_contrast() -> Iterator[Point]:
    frequency = 350.2
    for cycles in (0.3, 0.6, 0.8, 0.9, 0.99, 1.1, 1.3, 1.5):
        camera = Camera(_ROW_TIME, cycles / frequency)
        n, k = np.ogrid[:1080, :12]
        turns = frequency * n * _ROW_TIME - 0.5 * cycles - 0.2 * k
        light = 100.0 * (1.0 + np.sinc(cycles) * np.cos(2.0 * np.pi * turns))
        pictures = [light + 2.0 * np.random.default_rng(s).standard_normal(light.shape) for s in range(4)]
        found = [restore_contrast(columns, camera, frequency) for columns in pictures]
        divided = circular_inverse(pictures[0], camera, 1e12)
        plain = rms(tone_gain(divided, Camera(_ROW_TIME), frequency).gain - 1.0)
        stated = rms([np.hypot(one.after_std, one.expected - 1.0) for one in found])
        yield Point(cycles, plain, rms([one.after - 1.0 for one in found]), stated, found[0].flags)
