"""Simulated recordings of a modulated light."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.waveforms import Waveform, integrate_exposure

_MAX_PIXELS = 1 << 28


def simulate_frames(
    waveform: Waveform,
    camera: Camera,
    rows: int,
    columns: int,
    frames: int = 1,
    *,
    start: float = 0.0,
    swing: float = 200.0,
    dark_level: float = 0.0,
    noise: float = 0.0,
    dtype: npt.DTypeLike = np.uint8,
    seed: int = 0,
) -> Iterator[npt.NDArray[Any]]:
    """Simulate frames filled by a light: dark_level + swing * p_n + noise, with p_n from ``integrate_exposure``.

    Args:
        waveform: the light.
        camera: its row time and exposure, and its frame time for more than one frame.
        rows, columns, frames: 1 or more, up to 2^28 pixels a frame.
        start: the end of the exposure of row 0 of frame 0, s.
        swing: stored values (DN) from no light to light 1; finite.
        dark_level: stored value (DN) of no light; finite.
        noise: standard deviation of the noise, DN, normal, independent in every pixel; 0 or above.
        dtype: uint8 and uint16 are rounded to nearest and clipped; float32 and float64 are neither.
        seed: of the noise; the same seed gives the same frames.

    Yields:
        (rows, columns) arrays of ``dtype``; one frame at a time is in memory.

    Raises:
        ValueError: a value outside its range, at the call.
    """
    for name, count in (("rows", rows), ("columns", columns), ("frames", frames)):
        if not 1 <= count <= _MAX_PIXELS:
            raise ValueError(f"{name}: got {count}, allowed: from 1 to {_MAX_PIXELS}")
    if rows * columns > _MAX_PIXELS:
        raise ValueError(f"rows x columns: got {rows} x {columns}, allowed: up to {_MAX_PIXELS} pixels")
    for name, value in (("swing", swing), ("dark_level", dark_level), ("noise", noise)):
        if not math.isfinite(value) or (name == "noise" and value < 0):
            raise ValueError(f"{name}: got {value}, allowed: finite{', 0 or above' if name == 'noise' else ''}")
    if seed < 0:
        raise ValueError(f"seed: got {seed}, allowed: 0 or above")
    kind = np.dtype(dtype)
    if kind not in (np.uint8, np.uint16, np.float32, np.float64):
        raise ValueError(f"dtype: got {kind}, allowed: uint8, uint16, float32, float64")
    if frames == 1:
        first = integrate_exposure(waveform, camera, rows, start=start)[np.newaxis]
    else:
        first = integrate_exposure(waveform, camera, rows, start=start, frames=[0])
    random = np.random.default_rng(seed)

    def frame(number: int) -> npt.NDArray[Any]:
        light = first if number == 0 else integrate_exposure(waveform, camera, rows, start=start, frames=[number])
        values = np.repeat(dark_level + swing * light[0], columns).reshape(rows, columns)
        if noise:
            values += noise * random.standard_normal(values.shape)
        if kind.kind == "f":
            return values.astype(kind)
        stored: npt.NDArray[Any] = np.clip(np.rint(values), 0, np.iinfo(kind).max).astype(kind)
        return stored

    return (frame(number) for number in range(frames))
