"""Warnings where a result is probably not that of a light, although its standard error is small."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.files.recording import Frame

_SIGNIFICANT = 5.0  # standard errors; the phase is then known to 0.2 rad
_FEWEST_COLUMNS = 8
_COHERENT = 0.5  # of 1: all columns in phase; texture: about 0
_STILL = 0.995  # the same of the frames
_FEWEST_FRAMES = 4


def warn_of_texture(frames: Frame, camera: Camera, frequency: float) -> None:
    """Warn if the tone of (frames, rows, columns) is not that of a light.

    A light has one phase in all columns of a frame, and another phase in the next frame unless its period divides the
    frame time; a texture has neither.
    """
    from ocisac_fast.tones import tone_gain

    found = tone_gain(frames[:1], camera, frequency)
    significant = found.gain > _SIGNIFICANT * found.gain_std
    amplitude = (found.gain * found.mean)[significant]
    if amplitude.size >= _FEWEST_COLUMNS and _resultant(found.phase[significant], amplitude) < _COHERENT:
        _warn("columns show the tone at different phases: probably a texture, not a light")
        return
    if len(frames) < _FEWEST_FRAMES:
        return
    pooled = tone_gain(frames, camera, frequency, pooled=True)
    significant = pooled.gain > _SIGNIFICANT * pooled.gain_std
    if significant.all() and _resultant(pooled.phase, np.ones(len(frames))) > _STILL:
        _warn("the tone is at the same rows in all frames: a texture, or a light in step with the frames")


def warn_of_gain(facts: dict[str, Any], whole_picture: bool) -> bool:
    """Warn if the gain of a recording is probably biased, and return True then; ``facts`` as in its JSON object."""
    if whole_picture and "model_misfit" in facts["flags"]:
        _warn("the light varies along the columns, which biases the gain: give --region x,y,w,h within the lamp")
        return True
    if facts["snr_db"] < 0.0 and not {"weak", "near_null"} & set(facts["flags"]):
        _warn(f"the tone is {-facts['snr_db']:.0f} dB below what else varies along the rows, which may resemble it")
        return True
    return False


def _resultant(phases: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]) -> float:
    """Length of the weighted mean of e^{jφ}: 1 for equal phases."""
    return float(abs(np.exp(1j * phases) @ weights) / weights.sum())


def _warn(message: str) -> None:
    warnings.warn(message, stacklevel=2)
