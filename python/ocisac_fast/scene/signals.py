"""Row integrals that change from frame to frame: tables for the core, or light pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.waveforms import Product, Tone, Waveform, integrate_exposure
from ocisac_fast.scene.geometry import Array
from ocisac_fast.scene.profile import Light, Profile, expose_profile
from ocisac_fast.scene.terms import Moving

Table = npt.NDArray[np.float32]


def _integrate(waveform: Waveform, camera: Camera, rows: npt.NDArray[np.int64], start: float, frame: int) -> Array:
    frames = [frame] if frame else None
    return np.ravel(integrate_exposure(waveform, camera, rows, start=start, frames=frames))


@dataclass(frozen=True)
class RowSignal:
    """One row integral for all pixels of a row: a source, or light on a static surface.

    With a ``rate`` it is that of waveform * cos(2 pi rate t), or of its sine: the moving part of a cosine pattern.
    """

    waveform: Waveform
    top: int
    height: int
    rate: float = 0.0
    sine: bool = False

    def table(self, camera: Camera, start: float, frame: int) -> Table:
        """(height, 1) mean light over each row's exposure."""
        rows = np.arange(self.top, self.top + self.height)
        light = _integrate(self.waveform, camera, rows, start, frame)
        if self.rate:
            tone = Tone(abs(self.rate), phase=-np.pi / 2 if self.sine else 0.0)
            # cos = 2 * (1/2 + cos/2) - 1
            light = 2 * _integrate(Product([self.waveform, tone]), camera, rows, start, frame) - light
        return (-light if self.sine and self.rate < 0 else light).astype(np.float32)[:, np.newaxis]


@dataclass(frozen=True)
class ProfileTable:
    """A moving pattern with edges at ``phases`` phases of each of its lines."""

    waveform: Waveform
    profile: Profile
    rate: float
    phases: int
    steps: int
    top: int
    height: int

    def table(self, camera: Camera, start: float, frame: int) -> Table:
        """(height, lines * phases) mean light over each row's exposure."""
        lines = len(self.profile.levels)
        phase = np.tile((np.arange(self.phases) + 0.5) / self.phases, lines)
        line = np.repeat(np.arange(lines), self.phases)
        rows = np.arange(self.top, self.top + self.height)[:, np.newaxis]
        return _expose(self, camera, start, frame, rows, line, phase).astype(np.float32)

    def index(self, moving: Moving) -> npt.NDArray[np.uint16]:
        """Column of the table for each pixel."""
        phase = moving.periods - np.floor(moving.periods)
        column = np.minimum((phase * self.phases).astype(np.int64), self.phases - 1)
        return (moving.line * self.phases + column).astype(np.uint16)


@dataclass(frozen=True)
class PixelProfile:
    """A moving pattern with edges, pixel by pixel."""

    waveform: Waveform
    profile: Profile
    rate: float
    steps: int
    rows: npt.NDArray[np.int64]  # (pixels,) coordinates
    columns: npt.NDArray[np.int64]
    gains: Array  # (pixels,) values
    phase: Array
    line: npt.NDArray[np.int64]

    def light(self, camera: Camera, start: float, frame: int) -> Table:
        """(pixels,) light over the exposure of each."""
        return (self.gains * _expose(self, camera, start, frame, self.rows, self.line, self.phase)).astype(np.float32)


def _expose(
    part: ProfileTable | PixelProfile,
    camera: Camera,
    start: float,
    frame: int,
    rows: npt.NDArray[np.int64],
    line: npt.NDArray[np.int64],
    phase: Array,
) -> Array:
    assert camera.exposure is not None
    passed = Fraction(part.rate) * (Fraction(start) + frame * Fraction(camera.frame_time or 0.0))
    shift = float(passed % 1)  # of the periods that have passed at the end of the frame's row 0
    light = Light(part.waveform, camera, int(rows.max()) + 1, part.steps, start, frame)
    ends = np.multiply(rows, camera.row_period, dtype=np.float64)
    return expose_profile(part.profile, line, phase, shift, part.rate, ends, camera.exposure, light)
