"""Gains from samples other than dense linear bytes: pools of frames, the library's calls, and peers.

Peers look up light in a table first, transpose what is smallest, and keep buffers; each returns a gain per column (one,
pooled) of a tone on a bin of the DFT, where all methods must agree.
"""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Callable, Iterator
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

    limit: times reading the stored bytes: the aim, or the bound that bench/README.md measures.
    bounded: its arithmetic alone, which may lie above the aim, is measured in the same run.
    """

    name: str
    frames: Callable[[Array], Array]  # from dense linear bytes (rows, columns)
    camera: Camera
    limit: float
    asked: dict[str, Any] = dataclasses.field(default_factory=dict)
    columns: Callable[[Array], Array] = lambda frame: frame  # the view that is handed over
    peers: bool = True
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

    def light(self) -> npt.NDArray[np.float32] | None:
        """Table of light, None for linear samples."""
        if self.camera.tone_curve == "linear":
            return None
        largest = int(self.camera.white_level or 255)
        values = np.arange(largest + 1, dtype=np.uint8 if largest < 256 else np.uint16)
        return np.asarray(reference.linear_light(values, self.camera)).astype(np.float32)


def read(frame: Array) -> int:
    """Add up all bytes of a frame."""
    return _core.read_bytes(frame.reshape(-1).view(np.uint8))


def _twelve_bits(frame: Array) -> Array:
    return frame.astype(np.uint16) * 16 + 5


def _colours(frame: Array) -> Array:
    return np.ascontiguousarray(np.stack([frame // 2, frame, 255 - frame], axis=-1))


def _yuyv(frame: Array) -> Array:
    return np.ascontiguousarray(np.stack([frame, np.full_like(frame, 128)], axis=-1))


def _nv12(frame: Array) -> Array:
    return np.ascontiguousarray(np.concatenate([frame, np.full_like(frame[::2], 128)]))


def _turned(frame: Array) -> Array:
    return np.ascontiguousarray(frame.T)


def _same(frame: Array) -> Array:
    return frame


LINEAR, SRGB = Camera(ROW_TIME), Camera(ROW_TIME, tone_curve="srgb")
RAW, RAW_SRGB = (Camera(ROW_TIME, white_level=4095, tone_curve=curve) for curve in ("linear", "srgb"))
WIDE = _core.simd_target().startswith("AVX3")
CASES = [
    Stored("sRGB bytes, tone", _same, SRGB, 6.0 if WIDE else 8.0, bounded=True),
    Stored("sRGB bytes, square wave", _same, SRGB, 40.0, {"waveform": "square"}, peers=False, bounded=True),
    Stored("uint16, tone, efficiency 1", _twelve_bits, RAW, 3.0, bounded=True),
    Stored("uint16, tone, efficiency 0.99", _twelve_bits, RAW, 2.5, {"efficiency": 0.99}, peers=False, bounded=True),
    Stored("uint16, square wave", _twelve_bits, RAW, 20.0, {"waveform": "square"}, peers=False, bounded=True),
    Stored("uint16 with a tone curve, tone", _twelve_bits, RAW_SRGB, 10.0),
    Stored("float32, tone, efficiency 1", lambda frame: (frame / 255).astype(np.float32), LINEAR, 2.5),
    Stored(
        "float32, tone, efficiency 0.99",
        lambda frame: (frame / 255).astype(np.float32),
        LINEAR,
        2.5,
        {"efficiency": 0.99},
        peers=False,
    ),
    Stored("bytes, rows across", _turned, Camera(ROW_TIME, scan_axis="x"), 4.0),
    Stored("one colour of RGB bytes", _colours, LINEAR, 2.5, columns=lambda frame: frame[..., 1]),
    Stored("luma of YUYV bytes", _yuyv, LINEAR, 3.0, columns=lambda frame: frame[..., 0], peers=False),
    Stored("luma of NV12 bytes", _nv12, LINEAR, 3.0, columns=lambda frame: frame[: 2 * len(frame) // 3], peers=False),
    Stored("bytes, columns pooled", _same, LINEAR, 4.0, {"pooled": True}),
]


def _lines(spectrum: Array, k: int) -> Array:
    return np.asarray(2.0 * np.abs(spectrum[..., k]) / np.abs(spectrum[..., 0]))


def _signals(case: Stored, frame: Array, transpose: Call) -> Array:
    """Columns of light along the last axis, float32."""
    view, table = case.columns(frame), case.light()
    if case.camera.scan_axis == "x":
        across = view
    elif case.asked.get("pooled"):
        weights = view.mean(axis=0, dtype=np.float32)
        return np.asarray(view.astype(np.float32) @ weights)
    else:
        across = transpose(view)
    return across.astype(np.float32, copy=False) if table is None else table[across]


def numpy_rfft(case: Stored, k: int) -> Call:
    """``numpy.fft.rfft``, after a look-up by an index array."""
    return lambda frame: _lines(np.fft.rfft(_signals(case, frame, lambda view: np.ascontiguousarray(view.T))), k)


def cv2_dft(case: Stored, k: int) -> Call:
    """``cv2.transpose``, ``cv2.LUT`` for bytes, ``cv2.dft`` with ``DFT_ROWS``."""
    import cv2

    cv2.setNumThreads(1)
    table = case.light()

    def estimate(frame: Array) -> Array:
        if table is not None and frame.dtype == np.uint8:
            signals = cv2.LUT(cv2.transpose(frame), table)
        else:
            signals = _signals(case, frame, lambda view: cv2.transpose(np.ascontiguousarray(view)))
        packed = cv2.dft(np.atleast_2d(signals), flags=cv2.DFT_ROWS)
        gains = 2.0 * np.hypot(packed[:, 2 * k - 1], packed[:, 2 * k]) / np.abs(packed[:, 0])
        return gains if signals.ndim > 1 else gains[0]

    return estimate


PEERS = {"numpy": ("numpy", numpy_rfft), "cv2": ("cv2", cv2_dft)}


def peers_of(case: Stored, k: int, missing: list[str]) -> Iterator[tuple[str, Call]]:
    """The peers that are installed."""
    for name, (library, make) in PEERS.items() if case.peers else ():
        if importlib.util.find_spec(library) is None:
            missing.append(name)
        else:
            yield name, make(case, k)


def pool_of(case: Stored, dense: Array, size: int) -> list[Array]:
    """Frames of `size` bytes in all: more than the caches."""
    first = case.frames(dense[0])
    return [case.frames(dense[i % len(dense)]) for i in range(max(4, -(-size // first.nbytes)))]
