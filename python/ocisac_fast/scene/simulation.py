"""Simulated recordings of a modulated light."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import Finite, NotNegative, Positive, Within, checked
from ocisac_fast.light.waveforms import Waveform, integrate_exposure
from ocisac_fast.scene.effects import RECTIFIED_MAINS, Effects
from ocisac_fast.scene.geometry import MAX_PIXELS, Pixels

_TEXTURE_SCALES = ((8.0, 0.2), (40.0, 0.8))  # standard deviation of a Gaussian in px, its share of the variance


@checked
def simulate_frames(
    waveform: Waveform,
    camera: Camera,
    rows: Pixels,
    columns: Pixels,
    frames: Pixels = 1,
    *,
    start: float = 0.0,
    swing: Finite = 200.0,
    dark_level: Finite = 0.0,
    noise: NotNegative = 0.0,
    lamp: npt.ArrayLike = 1.0,
    ambient: Waveform | None = None,
    reflectance: npt.ArrayLike = 1.0,
    jitter: NotNegative = 0.0,
    effects: Mapping[str, float] | None = None,
    dtype: npt.DTypeLike = np.uint8,
    seed: Annotated[int, Within(0)] = 0,
) -> Iterator[npt.NDArray[Any]]:
    """Simulate frames: dark_level + swing * reflectance * (lamp * p_n + ambient_n) + noise.

    p_n and ambient_n are the means of ``waveform`` and of ``ambient`` over the exposure of row n, from
    ``integrate_exposure``.

    Args:
        waveform: the light.
        camera: its row time and exposure, and its frame time for more than one frame.
        rows, columns, frames: 1 or more, up to 2^28 pixels a frame.
        start: the end of the exposure of row 0 of frame 0, s.
        swing: stored values (DN) from no light to light 1; finite.
        dark_level: stored value (DN) of no light; finite.
        noise: standard deviation of the noise, DN, normal, independent in every pixel; 0 or above.
        lamp: share of the light that reaches a pixel, broadcast to (rows, columns), such as `lamp_bar`; finite.
        ambient: light on the whole picture, such as mains hum, in units of the light; None: none.
        reflectance: factor on all light in a pixel, broadcast to (rows, columns), such as `texture`; finite.
        jitter: frames start up to so many seconds early or late, uniformly distributed; 0 or above.
        effects: levels of `scene.effects.EFFECTS`, which cameras and senders have; None: none.
        dtype: uint8 and uint16 are rounded to nearest and clipped; float32 and float64 are neither.
        seed: of noise and jitter; the same seed gives the same frames.

    Yields:
        (rows, columns) arrays of ``dtype``; one frame at a time is in memory.
    """
    if rows * columns > MAX_PIXELS:
        raise ValueError(f"rows x columns: got {rows} x {columns}, allowed: up to {MAX_PIXELS} pixels")
    kind = np.dtype(dtype)
    if kind not in (np.uint8, np.uint16, np.float32, np.float64):
        raise ValueError(f"dtype: got {kind}, allowed: uint8, uint16, float32, float64")
    shares = _as_map("lamp", lamp, rows, columns)
    factors = swing * _as_map("reflectance", reflectance, rows, columns)
    random, clock = np.random.default_rng(seed), np.random.default_rng([seed, 1])

    device = None
    if effects:
        if kind.kind == "f":
            raise ValueError(f"dtype: got {kind}, allowed: uint8 or uint16 with effects")
        device = Effects(effects, camera, rows, seed)
        waveform = device.light(waveform)

    def exposed(light: Waveform, frame: int, begin: float) -> Float64s:
        if device is not None:
            return device.exposed(light, begin + frame * (camera.frame_time or 0.0))
        numbers = None if frames == 1 else [frame]
        return integrate_exposure(light, camera, rows, start=begin, frames=numbers).reshape(rows, 1)

    def light_of(frame: int) -> Float64s:
        begin = start + (clock.uniform(-jitter, jitter) if jitter else 0.0) + (device.delay() if device else 0.0)
        light = shares * exposed(waveform, frame, begin)
        if ambient is not None:
            light = light + exposed(ambient, frame, begin)
        if device is not None:
            light = light + device.daylight(frame) + device.mains * exposed(RECTIFIED_MAINS, frame, begin)
        return dark_level + factors * light

    def stored(frame: int, light: Float64s) -> npt.NDArray[Any]:
        values = np.broadcast_to(light, (rows, columns))
        if device is not None:
            values = device.seen(values, frame, float(np.iinfo(kind).max))
        if noise:
            values = values + noise * random.standard_normal((rows, columns))
        if device is not None:
            return device.stored(values, kind)
        if kind.kind == "f":
            return values.astype(kind)
        limited: npt.NDArray[Any] = np.clip(np.rint(values), 0, np.iinfo(kind).max).astype(kind)
        return limited

    first = light_of(0)  # checks waveforms and camera
    return (stored(frame, first if frame == 0 else light_of(frame)) for frame in range(frames))


@checked
def lamp_bar(rows: int, columns: int, width: Positive, *, tilt: float = 0.0) -> Float64s:
    """Share of its light that reaches each pixel from a bar along the rows through the middle of the picture.

    Args:
        rows, columns: of the picture.
        width: standard deviation of its Gaussian profile along the columns, px, above 0.
        tilt: rad from upright, inside (-pi/2, pi/2); positive: to the right towards the last row.

    Returns:
        (rows, columns), 1 on the middle line.
    """
    if not abs(tilt) < math.pi / 2:
        raise ValueError(f"tilt: got {tilt}, allowed: inside (-pi/2, pi/2) rad")
    down, across = np.ogrid[:rows, :columns]
    middle = (columns - 1) / 2 + math.tan(tilt) * (down - (rows - 1) / 2)
    return np.asarray(np.exp(-0.5 * ((across - middle) / width) ** 2))


@checked
def texture(rows: int, columns: int, contrast: NotNegative, *, seed: int = 0) -> Float64s:
    """Reflectance of a rough wall: exp(contrast * z), z a Gaussian random field of variance 1.

    z is the sum of two fields of white noise, smoothed by Gaussians of 8 and 40 px, with 0.2 and 0.8 of the variance;
    it continues periodically at the edges of the picture.

    Args:
        rows, columns: of the picture.
        contrast: standard deviation of the logarithm, 0 or above.
        seed: of the field.
    """
    random = np.random.default_rng(seed)
    frequencies = np.fft.fftfreq(rows)[:, np.newaxis] ** 2 + np.fft.rfftfreq(columns) ** 2
    log = np.zeros((rows, columns))
    for scale, share in _TEXTURE_SCALES:
        response = np.exp(-2 * (math.pi * scale) ** 2 * frequencies)
        power = np.mean(np.fft.irfft2(response, s=log.shape) ** 2) * log.size
        spectrum = np.fft.rfft2(random.standard_normal(log.shape)) * response
        log += math.sqrt(share / power) * np.fft.irfft2(spectrum, s=log.shape)
    return np.asarray(np.exp(contrast * log))


def _as_map(name: str, values: npt.ArrayLike, rows: int, columns: int) -> Float64s:
    array = np.asarray(values, dtype=np.float64)
    try:
        np.broadcast_to(array, (rows, columns))
    except ValueError:
        raise ValueError(f"{name}: got shape {array.shape}, allowed: one that fits ({rows}, {columns})") from None
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: got values that are not finite, allowed: finite values")
    return array
