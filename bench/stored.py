"""Gains from samples other than dense linear bytes, for bench/speed.py: pools of frames and the library's calls."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import Camera, _core, reference, tone_gain

Array = npt.NDArray[Any]
Call = Callable[[Array], Array]
ROW_TIME = 22.2e-6


@dataclasses.dataclass(frozen=True)
class Stored:
    """Frames of one format and what is asked of them.

    limit: times reading the stored bytes.
    bounded: its arithmetic alone, which may lie above the aim, is measured in the same run.
    """

    name: str
    frames: Callable[[Array], Array]  # from dense linear bytes (rows, columns)
    camera: Camera
    limit: float
    asked: dict[str, Any] = dataclasses.field(default_factory=dict)
    columns: Callable[[Array], Array] = lambda frame: frame  # the view that is handed over
    bounded: bool = False

    def gains(self, frequency: float) -> Call:
        """The library's estimator."""
        return lambda frame: tone_gain(self.columns(frame), self.camera, frequency, **self.asked).gain

    def expected(self, frame: Array, frequency: float) -> Array:
        """By the NumPy reference, all rows singly."""
        asked = {name: value for name, value in self.asked.items() if name != "efficiency"}
        view = self.columns(frame)
        in_time_order = view.T if self.camera.scan_axis == "x" else view
        return np.asarray(reference.tone_gain(in_time_order, self.camera, frequency, **asked).gain)


def read(frame: Array) -> int:
    """Add up all bytes of a frame."""
    return _core.read_bytes(frame.reshape(-1).view(np.uint8))


def _twelve_bits(frame: Array) -> Array:
    return frame.astype(np.uint16) * 16 + 5


def _floats(frame: Array) -> Array:
    return (frame / 255).astype(np.float32)


def _dense(*parts: Array) -> Array:
    """Samples of a pixel side by side."""
    return np.ascontiguousarray(np.stack(parts, axis=-1))


LINEAR, SRGB = Camera(ROW_TIME), Camera(ROW_TIME, tone_curve="srgb")
RAW, RAW_SRGB = (Camera(ROW_TIME, white_level=4095, tone_curve=curve) for curve in ("linear", "srgb"))
WIDE = _core.simd_target().startswith("AVX3")
CASES = [
    Stored("sRGB bytes, tone", np.asarray, SRGB, 6.0 if WIDE else 8.0, bounded=True),
    Stored("sRGB bytes, square wave", np.asarray, SRGB, 40.0, {"waveform": "square"}, bounded=True),
    Stored("uint16, tone, efficiency 1", _twelve_bits, RAW, 3.0, bounded=True),
    Stored("uint16, tone, efficiency 0.99", _twelve_bits, RAW, 2.5, {"efficiency": 0.99}, bounded=True),
    Stored("uint16, square wave", _twelve_bits, RAW, 20.0, {"waveform": "square"}, bounded=True),
    Stored("uint16 with a tone curve, tone", _twelve_bits, RAW_SRGB, 10.0),
    Stored("float32, tone, efficiency 1", _floats, LINEAR, 2.5),
    Stored("float32, tone, efficiency 0.99", _floats, LINEAR, 2.5, {"efficiency": 0.99}),
    Stored("bytes, rows across", lambda f: np.ascontiguousarray(f.T), Camera(ROW_TIME, scan_axis="x"), 4.0),
    Stored("one colour of RGB bytes", lambda f: _dense(f // 2, f, 255 - f), LINEAR, 2.5, columns=lambda f: f[..., 1]),
    Stored("luma of YUYV bytes", lambda f: _dense(f, 0 * f + 128), LINEAR, 3.0, columns=lambda f: f[..., 0]),
    Stored(
        "luma of NV12 bytes",
        lambda f: np.concatenate([f, 0 * f[::2] + 128]),
        LINEAR,
        3.0,
        columns=lambda f: f[: 2 * len(f) // 3],
    ),
    Stored("bytes, columns pooled", np.asarray, LINEAR, 4.0, {"pooled": True}),
]


def pool_of(case: Stored, dense: Array, size: int) -> list[Array]:
    """Frames of `size` bytes in all: more than the caches."""
    first = case.frames(dense[0])
    return [case.frames(dense[i % len(dense)]) for i in range(max(4, -(-size // first.nbytes)))]
