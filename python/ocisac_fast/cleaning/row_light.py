"""Light of each row of a banded picture, estimated from the picture itself."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast._core import ColumnBundles, ModelledLight, ToneLight
from ocisac_fast.camera.camera import Camera

FloatArray = npt.NDArray[np.float64]

MODELS = ("auto", "tone", "chips", "rows")


@dataclass(frozen=True, slots=True, eq=False)
class RowLight:
    """Light of each row, mean 1; light of a fully lit row; model; its frequency (Hz) or NaN."""

    light: FloatArray
    full: float
    model: str
    frequency: float
    tone: ToneLight | None = field(default=None, repr=False)


def find_colour_lights(light: FloatArray, variance: FloatArray, camera: Camera, model: str) -> list[RowLight]:
    """Estimate the row light of each colour of (rows, columns, colours) and its noise variance (inf: no data).

    Colours of one light have the same object.
    """
    found, of_colour = _core.find_colour_lights(light, variance, model)
    lights = [_in_hertz(one, camera) for one in found]
    return [lights[k] for k in of_colour]


def find_row_light(light: FloatArray, variance: FloatArray, camera: Camera, model: str) -> RowLight:
    """Estimate the row light of a picture (rows, columns)."""
    return _in_hertz(_core.find_row_light(ColumnBundles(light, variance), model), camera)


def _in_hertz(found: ModelledLight, camera: Camera) -> RowLight:
    return RowLight(found.light, found.full, found.model, found.frequency / camera.row_period, found.tone)


def row_light_of(tone: ToneLight, camera: Camera) -> RowLight:
    """The light of the rows under a tone."""
    light = tone.light
    return RowLight(light, float(light.max()), "tone", tone.frequency / camera.row_period, tone)
