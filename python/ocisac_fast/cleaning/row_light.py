"""Estimation of the light of each row of a banded picture from the picture itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning.chip_light import chip_light
from ocisac_fast.cleaning.columns import Columns, FloatArray
from ocisac_fast.cleaning.tone_light import tone_light

MODELS = ("auto", "tone", "chips", "rows")
_ENOUGH_OF_TONE = 0.5  # min. share of the rows' swing that a tone explains
_SURELY_TONE = 0.9  # the same where chips are not tried


@dataclass(frozen=True, slots=True, eq=False)
class RowLight:
    """Light of each row, mean 1; light of a fully lit row; model; its frequency (Hz) or NaN."""

    light: FloatArray
    full: float
    model: str
    frequency: float


def find_row_light(light: FloatArray, variance: FloatArray, camera: Camera, model: str) -> RowLight:
    """Estimate the row light from one colour of linear light (rows, columns) and its noise variance (inf: no data)."""
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
