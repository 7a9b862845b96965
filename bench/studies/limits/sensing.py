"""Limits of sensing: motion along the rows, motion from frames alone, contrast suppressed by the exposure."""

from __future__ import annotations

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.reference import tone_gain
from ocisac_fast.sensing.contrast import restore_contrast
from ocisac_fast.sensing.motion import KnownMotion
from ocisac_fast.sensing.region import sense_region
from ocisac_fast.tones.frequency import find_frequency
from studies.chart.scenes import Float64s
from studies.chart.tradeoffs import circular_inverse
from studies.limits.catalogue import Point, limit, rms

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
    flags = Flag(0)
    for bit in Flag:
        if sum(bool(one.flags & bit) for one in found) >= 3:
            flags |= bit
    return Point(speed, rms(plain), rms(errors), rms([one.motion_frequency_std for one in found]), flags)


_SPEEDS = (0.02, 0.05, 0.15, 0.5, 1.751, 3.0)


@limit(
    "motion-along",
    "Motion along the rows",
    sweep="speed against the read-out, m/s",
    error="RMS error of f_x·v, Hz",
    plain="the frequency that a column shows",
    why="The next row looks at another place of the texture: the column shows f_x·(v·T_r + pitch) a row.",
    then="`sense_region` takes the pitch and the texture (or the speed), and a second frame or the direction picks one "
    "of two answers; with less it lists them: AMBIGUOUS_MOTION.",
    spot=1.751,
    fails_by=500.0,
    good=0.05,
    flags=Flag.AMBIGUOUS_MOTION | Flag.AMBIGUOUS_KIND,
)
def _motion_along() -> list[Point]:
    return [_motion(speed, spatial_frequency=_TEXTURE) for speed in _SPEEDS]


@limit(
    "motion-frames",
    "Motion from two frames alone",
    sweep="speed against the read-out, m/s",
    error="RMS error of f_x·v, Hz",
    plain="the frequency that a column shows",
    why="Two frames give f_x·v modulo the frame rate, and a column only with the texture at rest in it.",
    then="Gives the slowest of the answers that fit and lists others, AMBIGUOUS_MOTION, unless `bounds` of the "
    "motion leave one.",
    spot=1.751,
    fails_by=500.0,
    good=0.05,
    flags=Flag.AMBIGUOUS_MOTION | Flag.AMBIGUOUS_KIND,
)
def _motion_frames() -> list[Point]:
    return [_motion(speed) for speed in _SPEEDS]


@limit(
    "restored-contrast",
    "Contrast that the exposure took",
    sweep="f_x·v·T_e",
    error="error of the restored gain",
    plain="DFT divided by sinc(f·T_e)",
    why="Towards the null the division multiplies noise, and what the frame's ends brought, without bound.",
    then="`restore_contrast` gives back up to `max_boost`; what the ends and the boost leave is predicted "
    "(`expected`); noise gives NEAR_NULL, WEAK.",
    spot=0.6,
    fails_by=1.0,
    good=0.02,
    flags=Flag.NEAR_NULL | Flag.WEAK,
)
def _restored_contrast() -> list[Point]:
    points = []
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
        points.append(Point(cycles, plain, rms([one.after - 1.0 for one in found]), stated, found[0].flags))
    return points
