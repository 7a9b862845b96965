"""Limits of stored values: clipping, tone curves, waveforms, quantisation, no light."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.light.waveforms import SquareWave, integrate_exposure
from ocisac_fast.tones.gain import tone_gain
from studies.chart.scenes import Scene
from studies.limits.catalogue import Point, compared, limit
from studies.limits.plain_methods import fitted_gain, gain_of_frame, rounded_bin_gain, transform_gain

_BASE = Scene("limits", "", 12.0, rows=720, columns=200)


@limit("Clipping", "peak of the light, DN", spot=320, fails_by=0.03, good=0.005, flags=Flag.SATURATED)
def _clipping() -> Iterator[Point]:
    for peak in (180, 230, 260, 290, 320, 400, 600):
        yield gain_of_frame(peak, dataclasses.replace(_BASE, mean=peak / 1.504), rounded_bin_gain)


@limit("A saturated core", "share of columns that saturate", spot=0.4, fails_by=0.02, good=0.005, flags=Flag.SATURATED)
def _saturated_core() -> Iterator[Point]:
    for share in (0.0, 0.1, 0.2, 0.4, 0.7, 0.95, 1.0):
        random = np.random.default_rng(7)
        brightness = np.where(np.arange(40) < share * 40, 3.5, 1.0)
        light = _BASE.light(random.random(30)).T[:, :, None] * brightness  # (frames, rows, columns)
        frames = np.clip(np.rint(light + 2.0 * random.standard_normal(light.shape)), 0, 255).astype(np.uint8)
        found = tone_gain(frames, _BASE.camera, _BASE.frequency, pooled=True)
        plain = rounded_bin_gain(_BASE, frames.mean(axis=2).T)
        yield compared(share, _BASE.gain, plain, found)


@limit("Ambient light", "ambient light / source", spot=1.0, fails_by=0.2, good=0.005)
def _ambient() -> Iterator[Point]:
    for ratio in (0.0, 0.03, 0.1, 0.3, 1.0, 2.0):
        random = np.random.default_rng(14)
        scene = dataclasses.replace(_BASE, mean=60.0)
        light = scene.light(random.random(200)) + 60.0 * ratio + 2.0 * random.standard_normal((scene.rows, 200))
        frame = np.clip(np.rint(light), 0, 255).astype(np.uint8)
        found = tone_gain(frame, scene.camera, scene.frequency, background=60.0 * ratio)
        yield compared(ratio, scene.gain, rounded_bin_gain(scene, frame), found)


@limit("Gamma", "gamma of the picture", spot=2.2, fails_by=0.15, good=0.005)
def _gamma() -> Iterator[Point]:
    for gamma in (1.0, 1.2, 1.5, 1.8, 2.2, 2.6):
        random = np.random.default_rng(8)
        light = (_BASE.light(random.random(_BASE.columns)) + 10.0) / 255.0  # 10 DN of ambient light, given below
        stored = 255.0 * light ** (1.0 / gamma) + random.standard_normal(light.shape)
        frame = np.clip(np.rint(stored), 0, 255).astype(np.uint8)
        camera = Camera(_BASE.row_time, _BASE.camera.exposure, tone_curve="gamma", gamma=gamma)
        found = tone_gain(frame, camera, _BASE.frequency, background=10.0)
        flat = frame - 255.0 * (10.0 / 255.0) ** (1.0 / gamma)
        yield compared(gamma, _BASE.gain, rounded_bin_gain(_BASE, flat), found)


@limit("PWM duty other than half", "duty", spot=0.2, fails_by=0.3, good=0.01)
def _duty() -> Iterator[Point]:
    for duty in (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95):
        scene = dataclasses.replace(_BASE, exposure_cycles=0.3, waveform="square")
        random = np.random.default_rng(9)
        phases = random.uniform(-np.pi, np.pi, 50)
        rows = [
            integrate_exposure(SquareWave(scene.frequency, duty=duty, amplitude=1, phase=p), scene.camera, scene.rows)
            for p in phases
        ]
        light = 20.0 + 200.0 * np.stack(rows, axis=1) + 2.0 * random.standard_normal((scene.rows, 50))
        frame = np.clip(np.rint(light), 0, 255).astype(np.uint8)
        found = tone_gain(frame, scene.camera, scene.frequency, waveform="square", duty=duty, background=20.0)
        yield compared(duty, scene.gain, rounded_bin_gain(scene, frame - 20.0), found)


@limit(
    "Constant columns",
    "level, DN",
    "RMS gain that is read",
    spot=1,
    fails_by=0.03,
    good=1e-3,
    flags=Flag.WEAK | Flag.NO_LIGHT,
)
def _constant() -> Iterator[Point]:
    for level in (0.3, 1, 3, 10, 30, 100):
        noise = np.random.default_rng(10).standard_normal((_BASE.rows, _BASE.columns))
        frame = np.clip(np.rint(level + noise), 0, 255).astype(np.uint8)
        found = tone_gain(frame, _BASE.camera, _BASE.frequency)
        yield compared(level, 0.0, transform_gain(_BASE, frame), found)


@limit(
    "Quantisation of a faint signal",
    "amplitude, DN",
    "RMS error / amplitude",
    spot=0.1,
    fails_by=0.5,
    good=0.1,
    flags=Flag.WEAK | Flag.QUANTISED,
)
def _faint() -> Iterator[Point]:
    for amplitude in (0.03, 0.1, 0.3, 1.0, 3.0, 10.0):
        random = np.random.default_rng(11)
        scene = dataclasses.replace(_BASE, cycles=12.37, depth=amplitude / 100.0, exposure_cycles=1e-3)
        offset = random.random(200)  # uniform between two codes
        frame = np.rint(scene.light(random.random(200)) + offset).astype(np.uint8)
        found = tone_gain(frame, scene.camera, scene.frequency)
        truth = amplitude / (100.0 + offset)
        yield compared(amplitude, truth, fitted_gain(scene, frame), found, 100.0 / amplitude)
