"""Selection of the columns of a recording for an estimate."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.pictures import PictureOptions
from ocisac_fast.files.recording import Frame
from ocisac_fast.lights import pick_colour
from ocisac_fast.tones import tone_columns


def frequency_waveform(picture: PictureOptions) -> str:
    """Waveform of the search: all harmonics for a square light, else those that exceed the noise."""
    return "square" if picture.waveform == "square" else "auto"


def one_colour(frames: Frame, camera: Camera, waveform: str) -> tuple[Frame, int | None]:
    """Select the colour of (frames, rows, columns, colours) that shows a tone best.

    Returns:
        (frames, rows, columns) and the colour's index; None: there is only one.
    """
    if frames.shape[-1] == 1:
        return frames[..., 0], None
    colour = int(pick_colour(list(np.moveaxis(frames, -1, 0)), camera, waveform=waveform))
    return frames[..., colour], colour


def lit_columns(frames: Frame, camera: Camera, frequency: float) -> npt.NDArray[np.bool_]:
    """(columns,) True if the column shows the light of this frequency; all True if none does."""
    cycles = abs((frequency * camera.row_period + 0.5) % 1.0 - 0.5)  # alias of the frequency
    if not cycles > 0.0:
        return np.ones(frames.shape[-1], bool)
    return some_columns(tone_columns(frames, camera, cycles / camera.row_period).used)


def some_columns(used: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The columns used; all if there are none."""
    return used if used.any() else np.ones_like(used)
