"""The light of every row of a banded picture, found from the picture itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning.chip_light import chip_light
from ocisac_fast.cleaning.columns import Columns, FloatArray
from ocisac_fast.cleaning.tone_light import tone_light

MODELS = ("auto", "tone", "chips", "rows")
_ENOUGH_OF_TONE = 0.5  # share of the rows' swing that a tone explains before it is taken for the light
_SURELY_TONE = 0.9  # the same before chips are looked for


@dataclass(frozen=True, slots=True, eq=False)
class RowLight:
    """Light of each row, mean 1; how bright a row is that is fully lit; which model, its frequency (Hz) or NaN."""

    light: FloatArray
    full: float
    model: str
    frequency: float


def find_row_light(light: FloatArray, variance: FloatArray, camera: Camera, model: str) -> RowLight:
    """From one colour of linear light (rows, columns) and its noise variance (infinite: tells nothing)."""
    picture = Columns(light, variance)
    rows, weight = picture.free()
    tries = {
        "tone": (("tone", None),),
        "chips": (("chips", None),),
        "auto": (("tone", _SURELY_TONE), ("chips", None), ("tone", _ENOUGH_OF_TONE)),
    }
    for kind, enough in tries.get(model, ()):
        if kind == "tone":
            tone = tone_light(picture, rows, weight, camera.row_period, enough)
            if tone is not None:
                return RowLight(tone.light, float(tone.light.max()), "tone", tone.frequency)
        else:
            chips = chip_light(picture, rows, weight, camera.row_period, always=model == "chips")
            if chips is not None:
                return RowLight(chips.light, float(np.quantile(chips.light, 0.95)), "chips", chips.rate)
    return RowLight(rows, float(np.quantile(rows, 0.95)), "rows", float("nan"))
