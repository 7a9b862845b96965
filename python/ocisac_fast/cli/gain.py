"""``ocisac gain``."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator
from typing import Any

import click
import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.columns import frequency_waveform, lit_columns, one_colour, some_columns
from ocisac_fast.cli.output import emit_facts, emit_json, flag_names, number, progress, quantity, rate, with_spread
from ocisac_fast.cli.pictures import PictureOptions, json_option, open_pictures, picture_options, plot_option
from ocisac_fast.cli.units import FREQUENCY_OR_AUTO, Quantity
from ocisac_fast.files.recording import Frame
from ocisac_fast.light.response import exposure_response


@click.command(short_help="Gain of a tone in a recording, and its theoretical value.")
@click.argument("file")
@click.option("--frequency", type=FREQUENCY_OR_AUTO, required=True, help="Frequency of the light; auto: estimated.")
@click.option("--method", type=click.Choice(["fit", "robust", "dft"]), default="fit", show_default=True)
@click.option("--background", type=float, help="Light of other origin, in stored values above dark.")
@click.option("--threads", type=int, default=1, show_default=True)
@picture_options
@plot_option("the spectrum with the fitted tone, and the column before and after equalisation")
@json_option
def gain(
    file: str,
    frequency: Quantity | str,
    method: str,
    background: float | None,
    threads: int,
    picture: PictureOptions,
    plot: str | None,
    as_json: bool,
) -> None:
    """Measure the normalised gain of a tone in FILE (a picture, a video, a .npy array, or -).

    The columns that show the light are selected in the first frames, unless --region is given, and pooled, weighted by
    brightness. Each frame gives a gain; the result is the mean weighted by inverse variance.
    """
    options = {"method": method, "background": background or 0.0, "threads": threads}
    measured = _measure(file, picture, frequency, options)
    if plot is not None:
        from ocisac_fast.plots import plot_gain

        plot_gain(
            measured.columns,
            measured.camera,
            path=plot,
            frequency=measured.frequency,
            gain=measured.gain,
            waveform=picture.waveform,
        )
    facts = picture.in_units(measured.facts(background is not None))
    if as_json:
        emit_json(facts)
        return
    emit_facts(
        "",
        {
            "frequency": rate(measured.frequency, measured.frequency_std, picture.in_hertz),
            "gain": with_spread(measured.gain, measured.gain_std, "", 5),
            "theory |sinc(f T_e)|": quantity(facts["theory"], "", 5),
            "signal-to-noise ratio": number(facts["snr_db"], "dB", 4),
            "mean": number(measured.mean, "DN"),
            "frames": f"{measured.frames} of {facts['rows']} rows",
            "columns": f"{facts['columns']}",
            "flags": ", ".join(facts["flags"]) or "none",
        },
    )


@dataclasses.dataclass(frozen=True)
class _Measured:
    camera: Camera
    frequency: float
    frequency_std: float | None
    gain: float
    gain_std: float
    phase: float
    mean: float
    snr: float
    flags: list[str]
    frames: int
    columns: Frame  # (rows, columns) of the first frame, those used
    colour: int | None

    def facts(self, background_given: bool) -> dict[str, Any]:
        """The JSON object."""
        exposure = None if math.isnan(self.frequency) else self.camera.exposure
        return {
            "frequency_hz": self.frequency,
            "frequency_std_hz": self.frequency_std,
            "gain": self.gain,
            "gain_std": self.gain_std,
            "theory": None if exposure is None else float(abs(exposure_response(self.frequency, exposure))),
            "snr_db": 10.0 * math.log10(self.snr) if self.snr > 0.0 else math.nan,
            "rows": self.columns.shape[0],
            "columns": self.columns.shape[1],
            "flags": self.flags,
            "frames": self.frames,
            "phase_rad": self.phase,
            "mean": self.mean,
            "background_given": background_given,
            "colour": self.colour,
        }


@dataclasses.dataclass(frozen=True)
class _Light:
    """Properties of the light from the first frames: frequency and columns."""

    frequency: float
    frequency_std: float | None
    flags: list[str]
    colour: int | None
    used: npt.NDArray[np.bool_]  # (columns,)

    def columns(self, frames: Frame) -> Frame:
        """The selected columns of the selected colour; a view if all are selected."""
        one = frames[..., self.colour or 0]
        return one if self.used.all() else one[..., self.used]


def _find_light(frames: Frame, camera: Camera, picture: PictureOptions, frequency: float | None) -> _Light:
    from ocisac_fast.tones import find_frequency

    waveform = frequency_waveform(picture)
    columns, colour = one_colour(frames, camera, waveform)
    if frequency is None:
        found = find_frequency(columns, camera, waveform=waveform, select=picture.region is None)
        flags = flag_names(found.flags)
        return _Light(found.frequency, found.frequency_std, flags, colour, some_columns(found.columns.used))
    everywhere = np.ones(columns.shape[-1], bool)
    used = lit_columns(columns, camera, frequency) if picture.region is None else everywhere
    return _Light(frequency, None, [], colour, used)


def _measure(file: str, picture: PictureOptions, frequency: Quantity | str, options: dict[str, Any]) -> _Measured:
    """Estimate the light from the first batch of frames, and the gains from all frames."""
    from ocisac_fast.tones import tone_gain

    given = picture.check_frequency("--frequency", frequency)
    options = {**options, "waveform": picture.waveform, "duty": picture.duty, "pooled": True}
    with open_pictures(file, picture) as pictures:
        camera, batches = pictures.camera.in_time_order, pictures.row_batches()
        first = next(batches)
        light = _find_light(first, camera, picture, given)
        if math.isnan(light.frequency):
            return _unanswered(light, camera, first)
        gains = [
            tone_gain(light.columns(batch), camera, light.frequency, **options)
            for batch in _shown(itertools.chain([first], batches), pictures.frame_count, len(first))
        ]
    values = {name: np.concatenate([getattr(part, name) for part in gains]) for name in _FRAME_VALUES}
    weights = _weights(values["gain_std"])
    mask = np.bitwise_or.reduce(values["flags"])
    if options["method"] != "dft":
        mask |= _misfit(light.columns(first)[0], camera, light.frequency, options)
    flags = flag_names(mask)
    return _Measured(
        camera=camera,
        frequency=light.frequency,
        frequency_std=light.frequency_std,
        gain=_mean(values["gain"], weights),
        gain_std=math.sqrt(_mean(values["gain_std"] ** 2 * weights, weights)),
        phase=float(values["phase"][0]),
        mean=_mean(values["mean"], weights),
        snr=_mean(values["snr"], weights),
        flags=light.flags + [name for name in flags if name not in light.flags],
        frames=len(values["gain"]),
        columns=light.columns(first)[0],
        colour=light.colour,
    )


def _misfit(columns: Frame, camera: Camera, frequency: float, options: dict[str, Any]) -> int:
    """MODEL_MISFIT if the mean column of a frame varies, against the assumption of ``tone_gain``; else 0."""
    from ocisac_fast.camera.linear_light import linear_light
    from ocisac_fast.core import Flag
    from ocisac_fast.tones import varying_tone_gain

    column = linear_light(columns, camera).mean(axis=-1)
    names = ("waveform", "duty", "background")
    found = varying_tone_gain(column, Camera(camera.row_time), frequency, **{name: options[name] for name in names})
    return int(found.flags) & Flag.MODEL_MISFIT


def _unanswered(light: _Light, camera: Camera, frames: Frame) -> _Measured:
    """Result without a tone: no gain, only flags."""
    columns = light.columns(frames)
    unknown = dict.fromkeys(("frequency", "frequency_std", "gain", "gain_std", "phase", "mean", "snr"), math.nan)
    return _Measured(camera, **unknown, flags=light.flags, frames=len(columns), columns=columns[0], colour=light.colour)


_FRAME_VALUES = ("gain", "gain_std", "phase", "mean", "snr", "flags")


def _shown(batches: Iterator[Frame], frame_count: int | None, batch_frames: int) -> Iterator[Frame]:
    total = None if frame_count is None else math.ceil(frame_count / batch_frames)
    return progress(batches, "measuring", total)


def _weights(spreads: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Normalised inverse variances of the frames with a result; equal weights if any variance is 0."""
    known = np.isfinite(spreads)
    inverse = np.zeros_like(spreads)
    inverse[known] = 1.0 if (spreads[known] == 0.0).any() else spreads[known] ** -2.0
    return inverse / inverse.sum() if known.any() else inverse


def _mean(values: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]) -> float:
    """Weighted mean over the frames with a result; NaN if there are none."""
    answered = weights > 0.0
    return float(values[answered] @ weights[answered]) if answered.any() else math.nan
