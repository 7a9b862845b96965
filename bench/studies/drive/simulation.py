"""A car drives past a modulated traffic light: the exposure controller in a closed loop with rendered frames.

Every frame has the exposure of the controller, with shot and read noise, gain and saturation. The light's tone
and the road's texture are measured in its pixels, the only input of the controller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.flags import Flag
from ocisac_fast.exposure.choice import best_exposure
from ocisac_fast.exposure.controller import (
    ExposureController,
    ExposureMeasurement,
    MeasuredTone,
    best_noisy_exposure,
)
from ocisac_fast.light.waveforms import Tone, integrate_exposure
from ocisac_fast.tones.frequency import find_frequency

ROWS, COLUMNS, ROW_TIME, FRAME_TIME = 1080, 8, 22.2e-6, 1 / 30
RANGE = (ROW_TIME, 450 * ROW_TIME)  # exposures of the camera, in steps of a row
GAINS = (1.0, 16.0)
LIGHT_FREQUENCY = 500.0
POLICIES = ("controller", "closed form", "best fixed")

_FULL_SCALE = 255.0
_ELECTRONS = 40.0  # per stored value at gain 1
_READ_NOISE = 1.5  # stored values at gain 1
NOISE_LEVEL = _READ_NOISE**2 * _ELECTRONS / _FULL_SCALE  # level at which shot noise equals read noise
_UNSEEN = Flag.NO_TONE | Flag.NO_LIGHT | Flag.WEAK | Flag.NO_SIGNAL


@dataclass(frozen=True, slots=True)
class Drive:
    """Record of a drive, one entry per frame; policies in the order of ``POLICIES``."""

    time: Float64s  # s
    sense_frequency: Float64s  # f_x v, Hz
    seen: Float64s  # (2, frames) f_c and f_x v as measured, Hz; NaN if not detected
    exposure: Float64s  # (policies, frames) for the next frame, s
    gains: Float64s  # (policies, 2, frames) |sinc(f T)| of light and texture in the next frame
    known: Float64s  # (policies, frames) objective by the measurements at the choice, over the largest allowed one
    true: Float64s  # the same by the frequencies of the frame in which the exposure was used
    saturated: Float64s  # share of its pixels


def drive_past_light(
    *,
    seconds: float = 8.0,
    hysteresis: float = 0.01,
    noise_level: float | None = NOISE_LEVEL,
    seed: int = 0,
) -> Drive:
    """Simulate the closed loop frame by frame, with the paper's closed form and the best fixed exposure.

    The closed form uses the same measurements and, like all policies, the camera's steps and the limits of brightness.
    The best fixed exposure maximises, in hindsight, the sum of the true objective over the whole drive.

    Args:
        seconds: length, at least 0.2.
        hysteresis: of the :class:`ExposureController`.
        noise_level: of the controller, by default that of the simulated camera; None: the paper's objective.
        seed: of noise and phases.
    """
    controller = ExposureController(RANGE, step=ROW_TIME, gains=GAINS, hysteresis=hysteresis, noise_level=noise_level)
    random = np.random.default_rng(seed)
    frames = round(seconds / FRAME_TIME)
    time: Float64s = np.arange(frames + 1, dtype=np.float64) * FRAME_TIME
    speed, texture, brightness = _scene(np.asarray(time / seconds, np.float64))
    exposure, gain = 50 * ROW_TIME, 1.0
    steps: list[dict[str, Any]] = []
    for k in range(frames):
        measured = _measure(*_frame(exposure, gain, texture[k] * speed[k], brightness[k], random), exposure, gain)
        chosen = controller.update(measured)
        steps.append({"measured": measured, "chosen": chosen})
        exposure, gain = chosen.exposure, chosen.gain
    return _judged(time, speed * texture, steps)


def _scene(share: Float64s) -> tuple[Float64s, Float64s, Float64s]:
    """Speed (braking, then accelerating), texture (asphalt, cobbles, a coarse lane) and level per second."""
    speed = np.interp(share, (0.0, 0.15, 0.45, 0.6, 1.0), (14.0, 14.0, 4.0, 4.0, 13.0))
    texture = np.select([share < 0.3, share < 0.7], [60.0, 150.0], 40.0)
    shade = np.interp(share, (0.0, 0.5, 0.55, 0.8, 0.85, 1.0), (120.0, 120.0, 45.0, 45.0, 160.0, 160.0))
    return speed, texture, shade


def _frame(
    exposure: float, gain: float, f_sense: float, brightness: float, random: np.random.Generator
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Stored columns of the light and of the road."""
    camera = Camera(ROW_TIME, exposure)

    def stored(tone: Tone, strength: float) -> npt.NDArray[np.uint8]:
        light = strength * brightness * exposure * integrate_exposure(tone, camera, ROWS)[:, None]
        values = np.repeat(light, COLUMNS, axis=1) * _FULL_SCALE
        noise = np.sqrt(_READ_NOISE**2 + values / _ELECTRONS) * random.standard_normal(values.shape)
        return np.clip(np.rint(gain * (values + noise)), 0, _FULL_SCALE).astype(np.uint8)

    phases = random.uniform(0.0, 2.0 * math.pi, 2)
    return stored(Tone(LIGHT_FREQUENCY, phase=phases[0]), 2.0), stored(Tone(f_sense, phase=phases[1]), 1.0)


def _measure(
    light: npt.NDArray[np.uint8], road: npt.NDArray[np.uint8], exposure: float, gain: float
) -> ExposureMeasurement:
    camera = Camera(ROW_TIME, exposure)

    def seen(columns: npt.NDArray[np.uint8]) -> MeasuredTone:
        found = find_frequency(columns, camera, bounds=(60.0, 3000.0), waveform="tone", select=False)
        unseen = found.flags & _UNSEEN or found.snr < 1.0
        return MeasuredTone(math.nan if unseen else found.frequency, snr=found.snr)

    pixels = np.concatenate((light, road), axis=1)
    return ExposureMeasurement(
        [seen(light)],
        [seen(road)],
        exposure=exposure,
        gain=gain,
        level=float(pixels.mean()) / _FULL_SCALE,
        peak=float(np.percentile(pixels, 99.0)) / _FULL_SCALE,
        saturated=float(np.mean(pixels == _FULL_SCALE)),
    )


def _judged(time: Float64s, f_sense: Float64s, steps: list[dict[str, Any]]) -> Drive:
    """Compute the three policies."""
    frames = len(steps)
    seen = np.array([[s["measured"].lights[0].frequency, s["measured"].motions[0].frequency] for s in steps]).T
    bounds = np.array([s["chosen"].bounds for s in steps])
    noise = np.array([s["chosen"].noise_exposure for s in steps])
    after = np.stack([np.full(frames, LIGHT_FREQUENCY), f_sense[1:]])
    exposure = np.stack(
        [
            [s["chosen"].exposure for s in steps],
            _closed_form(seen, bounds),
            _stepped(np.full(frames, _best_fixed(after, bounds, noise)), bounds),
        ]
    )
    known, true = np.empty((3, frames)), np.empty((3, frames))
    for k in range(frames):
        for share, tones in ((known, seen[:, k]), (true, after[:, k])):
            there = ~np.isnan(tones)
            pair = tones[there], np.ones(2)[there]
            if not any(there):
                share[:, k] = 1.0
                continue
            window = (bounds[k, 0], bounds[k, 1])
            best = best_noisy_exposure(*pair, window, noise_exposure=noise[k], step=ROW_TIME)
            share[:, k] = _objective(exposure[:, k], *pair, noise[k]) / best.objective
    gains = np.abs(np.sinc(exposure[:, None] * after))
    saturated = np.array([s["measured"].saturated for s in steps])
    return Drive(time[:-1], f_sense[:-1], seen, exposure, gains, known, true, saturated)


def _objective(exposure: Float64s, frequencies: Float64s, weights: Float64s, noise: float) -> Float64s:
    """Eq. 18 with magnitudes over the noise, one exposure per value."""
    tones = np.abs(np.sinc(np.multiply.outer(exposure, frequencies))) @ weights
    return np.asarray(exposure * tones / np.sqrt(1.0 + exposure / noise))


def _stepped(exposure: Float64s, bounds: Float64s) -> Float64s:
    """The nearest whole number of rows within the bounds of each frame."""
    first, last = np.ceil(bounds[:, 0] / ROW_TIME - 1e-9), np.floor(bounds[:, 1] / ROW_TIME + 1e-9)
    return np.asarray(np.clip(np.rint(exposure / ROW_TIME), first, np.maximum(first, last)) * ROW_TIME)


def _closed_form(seen: Float64s, bounds: Float64s) -> Float64s:
    """Closed form of the measured tones; an undetected tone keeps its last frequency."""
    held = seen.copy()
    for k in range(1, held.shape[1]):
        held[:, k] = np.where(np.isnan(held[:, k]), held[:, k - 1], held[:, k])
    held = np.where(np.isnan(held), LIGHT_FREQUENCY, held)
    return _stepped(np.asarray(best_exposure(held[0], held[1], method="closed-form").exposure), bounds)


def _best_fixed(after: Float64s, bounds: Float64s, noise: Float64s) -> float:
    """The whole number of rows that maximises the sum over the drive, each frame within its bounds."""
    counts = np.arange(round(RANGE[0] / ROW_TIME), round(RANGE[1] / ROW_TIME) + 1) * ROW_TIME
    used = np.stack([_stepped(np.full(noise.size, exposure), bounds) for exposure in counts])
    tones = np.abs(np.sinc(used * after[:, None])).sum(axis=0)
    return float(counts[np.argmax((used * tones / np.sqrt(1.0 + used / noise)).sum(axis=1))])
