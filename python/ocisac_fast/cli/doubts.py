"""Warnings where a result is probably not that of a light, although its standard error is small."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.files.recording import Frame
from ocisac_fast.tones import tone_gain

_SIGNIFICANT = 5.0  # standard errors; the phase is then known to 0.2 rad
_FEWEST_COLUMNS = 8
_LEAST_SPREAD = 1e-3  # of the largest mean: columns that are alike tell no line
_COHERENT = 0.5  # of 1: all columns in phase; texture: about 0
_STILL = 0.995  # the same of the frames
_FEWEST_FRAMES = 4
_STEP = 0.1  # cycles over all frames, by which a light in step turns
_LARGE_SHARE = 0.05  # of the light
_SURE = 10.0  # standard errors
_BETTER = 4.0  # ratio of powers: half the residual


def warn_of_texture(frames: Frame, camera: Camera, frequency: float, advance: float | None = None) -> bool:
    """Warn if the tone of (frames, rows, columns) is not that of a light, and return True then.

    ``advance``: its cycles a frame, where known.

    A light has one phase in all columns of a frame, and another phase in the next frame unless its period divides the
    frame time; a texture has neither.
    """
    found = tone_gain(frames[:1], camera, frequency)
    significant = found.gain > _SIGNIFICANT * found.gain_std
    amplitude = (found.gain * found.mean)[significant]
    if amplitude.size >= _FEWEST_COLUMNS and _resultant(found.phase[significant], amplitude) < _COHERENT:
        _warn("columns show the tone at different phases: probably a texture, not a light")
        return True
    if len(frames) < _FEWEST_FRAMES:
        return False
    pooled = tone_gain(frames, camera, frequency, pooled=True)
    significant = pooled.gain > _SIGNIFICANT * pooled.gain_std
    is_still = bool(significant.all()) and _resultant(pooled.phase, np.ones(len(frames))) > _STILL
    if is_still:
        apart = None if advance is None else abs(advance - round(advance))
        if apart is None:
            _warn("the tone is at the same rows in all frames: a texture, or a light in step with the frames")
        elif apart * len(frames) > _STEP:
            _warn(f"the tone is at the same rows in all frames: a texture; a light turns by {apart:.2g} cycles a frame")
        else:
            _warn("the tone is at the same rows in all frames, as a light is at a whole number of cycles a frame")
    return is_still


def warn_of_calibration(seconds: float) -> None:
    """Warn that the tone of a calibration may be no light's; ``seconds``: of a frame's rows."""
    too_long = f" (a frame would last {seconds:.3g} s: is the frequency in kHz?)" if seconds > 1.0 else ""
    _warn(f"the tone may be no light's{too_long}: give --region x,y,w,h within the lamp")


def is_unmeasured(facts: dict[str, Any]) -> bool:
    """True if there is no gain, or one of less than a cycle in the rows and nothing of it; ``facts``: as printed."""
    return math.isnan(facts["gain"]) or {"few_cycles", "weak"} <= set(facts["flags"])


def warn_of_gain(facts: dict[str, Any], row_period: float, whole_picture: bool) -> bool:
    """Warn if the gain of a recording is none or probably biased, and return True then; ``facts``: its JSON object."""
    if whole_picture and "model_misfit" in facts["flags"]:
        _warn(
            "the light varies along the columns or from frame to frame, or contradicts --exposure, --waveform or "
            "--dark-level, which biases the gain: choose frames of one scene, or give --region x,y,w,h within the lamp"
        )
        return True
    if is_unmeasured(facts):
        cycles = facts["frequency_hz"] * facts["rows"] * row_period
        few = f": the rows show {cycles:.3g} cycles of the tone: is the frequency in kHz?"
        _warn("no gain was measured" + (few if "few_cycles" in facts["flags"] else ""))
        return True
    if facts["snr_db"] < 0.0 and not {"weak", "near_null"} & set(facts["flags"]):
        _warn(f"the tone is {-facts['snr_db']:.0f} dB below what else varies along the rows, which may resemble it")
        return True
    return False


def warn_of_other_light(columns: Frame, camera: Camera, frequency: float, options: dict[str, Any]) -> bool:
    """Warn if a part of the light of (rows, columns) has no tone, and return True then; ``options`` of `tone_gain`."""
    found = other_light(columns, camera, frequency, options)
    if found is None:
        return False
    _warn(
        f"the gain rises with the light of the columns: about {found[0]:.3g} DN are other light or a dark level "
        f"(--background, --dark-level); without them the gain is {found[1]:.3g}"
    )
    return True


def warn_of_waveform(columns: Frame, camera: Camera, frequency: float, options: dict[str, Any]) -> bool:
    """Warn if a square wave fits (rows, columns) better than the tone of ``options``, and return True then."""
    column, seen = linear_light(columns, camera).mean(axis=-1), Camera(camera.row_time, camera.exposure)
    as_waves = [{**options, "waveform": waveform} for waveform in ("tone", "square")]
    tone, square = (float(np.squeeze(tone_gain(column, seen, frequency, **each).snr)) for each in as_waves)
    if not square > _BETTER * tone:
        return False
    _warn("the harmonics are those of a square wave, whose gain is another: give --waveform square")
    return True


def other_light(
    columns: Frame, camera: Camera, frequency: float, options: dict[str, Any]
) -> tuple[float, float] | None:
    """Light without the tone, DN, and the gain of the rest; None if there is no sign of such light.

    A lamp that does not light all columns alike tells this: amplitudes over means are a line, through the origin if all
    light is the lamp's. Light of other origin, or a dark level, moves it to the right.
    """
    found = tone_gain(columns, camera, frequency, **{**options, "pooled": False})
    used = np.isfinite(found.gain_std) & (found.gain_std > 0.0) & (found.mean > 0.0)
    if used.sum() < _FEWEST_COLUMNS or np.ptp(found.mean[used]) < _LEAST_SPREAD * found.mean[used].max():
        return None
    mean, weight = found.mean[used], 1.0 / (found.gain_std * found.mean)[used]
    line, covariance = np.polyfit(mean, (found.gain * found.mean)[used], 1, w=weight, cov="unscaled")
    slope, misses = line[0], weight * (found.gain[used] * mean - np.polyval(line, mean))
    if not slope > 0.0:
        return None
    other = -line[1] / slope  # DN at which the amplitude is 0
    scatter = max(1.0, float(misses @ misses) / (used.sum() - 2))
    ratio = np.array([other, 1.0])
    spread = math.sqrt(scatter * float(ratio @ covariance @ ratio)) / slope
    least = max(_SURE * spread, _LARGE_SHARE * float(np.average(mean, weights=weight**2)))
    return (float(other), float(slope)) if other >= least else None


def _resultant(phases: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]) -> float:
    """Length of the weighted mean of e^{jφ}: 1 for equal phases."""
    return float(abs(np.exp(1j * phases) @ weights) / weights.sum())


def _warn(message: str) -> None:
    warnings.warn(message, stacklevel=2)
