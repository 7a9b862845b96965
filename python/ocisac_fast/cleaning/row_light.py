"""Estimation of the light of each row of a banded picture from the picture itself."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast._core import ColumnBundles, ToneLight
from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning.chip_light import chip_light

FloatArray = npt.NDArray[np.float64]

MODELS = ("auto", "tone", "chips", "rows")
_ENOUGH_OF_TONE = 0.5  # min. share of the rows' swing that a tone explains
_SURELY_TONE = 0.9  # the same where chips are not tried
_AGREEMENT = 0.995  # min. correlation of a colour's tone with that of its group: 6 degrees of phase
_SAME_CYCLES = 0.5  # max. difference of the cycles in a frame of two colours of one light


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

    The light of discharge lamps and of phosphors changes colour over a cycle. Colours of similar course are added.
    Other groups have tone or chips of their own if their frequency is that of the strongest group, else its light.
    Tones are then fitted to every colour at their mean frequency.
    """
    groups = _core.alike_colours(light, variance)
    pictures = [ColumnBundles(light[..., group].sum(axis=2), variance[..., group].sum(axis=2)) for group in groups]
    main = find_row_light(pictures[0], camera, model)
    found = [main]
    for picture in pictures[1:]:
        own = main if main.model == "rows" else find_row_light(picture, camera, model)
        away = abs(own.frequency - main.frequency) * len(main.light) * camera.row_period
        found.append(own if own.model == main.model and away < _SAME_CYCLES else main)
    by_colour = [found[next(k for k, group in enumerate(groups) if c in group)] for c in range(light.shape[2])]
    if main.tone is None or len(by_colour) == 1:
        return by_colour
    weights = [picture.depth(one.light) ** 2 for picture, one in zip(pictures, found, strict=True)]
    frequency = camera.row_period * float(np.average([one.frequency for one in found], weights=weights))
    return [
        _tone_of_colour(ColumnBundles(light[..., c], variance[..., c]), one, frequency, camera.row_period)
        for c, one in enumerate(by_colour)
    ]


def _tone_of_colour(picture: ColumnBundles, of_group: RowLight, frequency: float, row_time: float) -> RowLight:
    """The tone of a colour at a given frequency, cycles per row; that of its group where they agree."""
    assert of_group.tone is not None
    own = _core.tone_light_at(picture, of_group.tone, frequency)
    agrees = np.corrcoef(own.light, of_group.light)[0, 1] > _AGREEMENT
    return of_group if agrees else row_light_of(own, row_time)


def row_light_of(tone: ToneLight, row_time: float) -> RowLight:
    """The light of the rows under a tone."""
    light = tone.light
    return RowLight(light, float(light.max()), "tone", tone.frequency / row_time, tone)


def find_row_light(picture: ColumnBundles, camera: Camera, model: str) -> RowLight:
    """Estimate the row light of a picture."""
    rows, weight = picture.free()
    tries = {
        "tone": (("tone", None),),
        "chips": (("chips", None),),
        "auto": (("tone", _SURELY_TONE), ("chips", None), ("tone", _ENOUGH_OF_TONE)),
    }
    for kind, enough in tries.get(model, ()):
        if kind == "tone":
            tone = _core.find_tone_light(picture, rows, weight, enough)
            if tone is not None:
                return row_light_of(tone, camera.row_period)
        else:
            chips = chip_light(picture, rows, weight, camera.row_period, always=model == "chips")
            if chips is not None:
                return RowLight(chips.light, float(np.quantile(chips.light, 0.95)), "chips", chips.rate)
    return RowLight(rows, float(np.quantile(rows, 0.95)), "rows", float("nan"))
