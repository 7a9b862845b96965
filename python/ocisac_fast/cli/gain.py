"""``ocisac gain``."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import click
import numpy as np
import numpy.typing as npt

from ocisac_fast._core import project
from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.cli.columns import frequency_waveform, lit_columns, one_colour, some_columns
from ocisac_fast.cli.command import command
from ocisac_fast.cli.csv_files import write_csv
from ocisac_fast.cli.doubts import is_unmeasured, warn_of_gain, warn_of_other_light, warn_of_texture, warn_of_waveform
from ocisac_fast.cli.errors import SOME_FAILED
from ocisac_fast.cli.output import (
    decibels,
    emit,
    flag_names,
    number,
    plain,
    progress,
    quantity,
    rate,
    with_spread,
)
from ocisac_fast.cli.outputs import INPUT, OUTPUT, PLOTS, draw
from ocisac_fast.cli.pictures import PictureOptions, open_pictures
from ocisac_fast.cli.units import FREQUENCY_OR_AUTO, Quantity
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.statistics import do_differ, inverse_variance_weights, mean_and_std, weighted_mean
from ocisac_fast.files import Part
from ocisac_fast.files.recording import Frame
from ocisac_fast.light.response import exposure_response
from ocisac_fast.tones import find_frequency, tone_gain, varying_tone_gain


@command
def gain(
    file: Annotated[str, INPUT],
    *,
    frequency: Annotated[Quantity | str, FREQUENCY_OR_AUTO, "Frequency of the light; auto: estimated."],
    method: Annotated[Literal["fit", "robust", "dft"], "Estimator; robust: against other tones."] = "fit",
    background: Annotated[float | None, "Light of other origin, in stored values above dark."] = None,
    threads: Annotated[int, "Number of threads."] = 1,
    per_column: Annotated[
        str | None, OUTPUT, {"metavar": "FILE"}, "Write the gain of every column and frame to a CSV file."
    ] = None,
    picture: PictureOptions,
    plot: Annotated[
        str | None,
        OUTPUT,
        f"Draw the spectrum with the fitted tone, and the column before and after equalisation ({PLOTS}).",
    ] = None,
    as_json: bool,
) -> None:
    """Measure the normalised gain of a tone in FILE (a picture, a video, a .npy array, or -).

    The columns that show the light are selected in the first frames, unless --region is given, and pooled, weighted by
    brightness. Each frame gives a gain; the result is the mean weighted by inverse variance, its error by their scatter
    where that is larger. Frames that differ by a tenth, as of a cut, have the flag model_misfit.
    Without a gain the exit code is 3.
    """
    options = tone_options(picture, method=method, background=background, threads=threads)
    measured = frame_gains(file, picture, frequency, options, per_column=per_column is not None)
    light, mean = measured.light, measured.mean()
    if per_column is not None:
        write_csv(per_column, measured.every_column(picture))
    shown = {"frequency": light.frequency, "gain": mean["gain"], "waveform": picture.waveform}
    draw(plot, "plot_gain", measured.columns, measured.camera, **shown)
    facts = {**measured.facts(mean, background is not None), "frames": measured.frame_count}
    doubtful = warn_of_gain(facts, measured.camera.row_period, picture.region is None) or math.isnan(light.frequency)
    if not doubtful and not warn_of_other_light(measured.columns, measured.camera, light.frequency, options):
        is_texture = warn_of_texture(measured.columns[np.newaxis], measured.camera, light.frequency)
        if not is_texture and picture.waveform == "tone" and method == "fit":
            warn_of_waveform(measured.columns, measured.camera, light.frequency, options)
    emit(
        as_json,
        picture.in_units(facts),
        {
            "frequency": rate(light.frequency, light.frequency_std, picture.in_hertz),
            picture.gain_name: with_spread(mean["gain"], mean["gain_std"], "", 5),
            "theory |sinc(f T_e)|": quantity(facts["theory"], "", 5),
            "signal-to-noise ratio": number(facts["snr_db"], "dB", 4),
            "mean": number(mean["mean"], "DN"),
            **({"scan axis": light.scan_axis} if picture.names(light.scan_axis) else {}),
            "frames": f"{measured.frame_count} of {facts['rows']} rows",
            "columns": f"{facts['columns']}",
            "flags": ", ".join(facts["flags"]) or "none",
        },
    )
    if is_unmeasured(facts):
        raise click.exceptions.Exit(SOME_FAILED)


@dataclasses.dataclass(frozen=True)
class Light:
    """Properties of the light from the first frames: frequency and columns."""

    scan_axis: str  # of the camera that the first frames were read with
    frequency: float  # in the units of the camera; NaN: none was found
    frequency_std: float | None
    flags: list[str]  # names of the flags of all frames
    colour: int | None  # its index; None: there is only one
    used: npt.NDArray[np.bool_]  # (columns,) the columns that show the light
    misfit: int  # MODEL_MISFIT if the first frame's mean column varies, against the assumption of tone_gain; else 0

    def columns(self, frames: Frame) -> Frame:
        """The selected columns of the selected colour; a view if they are neighbours."""
        one = frames[..., self.colour or 0]
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.used, [False]]).astype(np.int8)))
        runs = [one[..., first:last] for first, last in zip(edges[::2], edges[1::2], strict=True)]
        return runs[0] if len(runs) == 1 else np.concatenate([*runs, one[..., :0]], axis=-1)

    def pooled(self, background: float) -> tuple[slice, npt.NDArray[np.float64]]:
        """The columns that are pooled, from the first to the last selected one, and their background, (1, columns).

        Those between them are not left out by a copy: all of their light is background, which gives them no weight.
        """
        places = np.flatnonzero(self.used)
        span = slice(places[0], places[-1] + 1)
        return span, np.where(self.used[span], background, np.finfo(np.float64).max)[np.newaxis]


@dataclasses.dataclass(frozen=True)
class FrameGains:
    """Gains of single frames."""

    camera: Camera
    light: Light
    values: dict[str, npt.NDArray[Any]]  # (frames,) gain, gain_std, phase, mean, snr, flags; empty: no tone was found
    columns: Frame  # (rows, columns) of the first frame, those used
    frame_count: int
    shared: tuple[float, float, float] | None = None  # of the mean of all frames: arguments of _shared_std
    column_values: dict[str, npt.NDArray[Any]] = dataclasses.field(default_factory=dict)  # (frames, columns)

    def facts(self, frame: dict[str, Any], background_given: bool) -> dict[str, Any]:
        """The JSON object of a frame, or of a mean of frames, with these values."""
        light, exposure = self.light, None if math.isnan(self.light.frequency) else self.camera.exposure
        flags = flag_names(frame["flags"] | light.misfit)
        return {
            "frequency_hz": light.frequency,
            "frequency_std_hz": light.frequency_std,
            "gain": frame["gain"],
            "gain_std": frame["gain_std"],
            "theory": None if exposure is None else float(abs(exposure_response(light.frequency, exposure))),
            "snr_db": decibels(frame["snr"]),
            "rows": self.columns.shape[0],
            "columns": self.columns.shape[1],
            "flags": light.flags + [name for name in flags if name not in light.flags],
            "phase_rad": frame["phase"],
            "mean": frame["mean"],
            "background_given": background_given,
            "colour": light.colour,
            "scan_axis": light.scan_axis,
        }

    def every_frame(self, first: int, background_given: bool) -> Iterator[dict[str, Any]]:
        """The JSON object of each frame, counted from ``first``; without a tone one object, of no frame."""
        if math.isnan(self.light.frequency):
            yield {"frame": None, **self.facts(_NO_TONE, background_given)}
        for index in range(len(self.values["gain"])):
            frame = {name: values[index] for name, values in self.values.items()}
            yield {"frame": first + index, **self.facts(frame, background_given)}

    def every_column(self, picture: PictureOptions) -> list[dict[str, Any]]:
        """The JSON object of each frame and column; columns (with read-out along x, rows) of the stored picture."""
        values, region = self.column_values, picture.region
        across = "y" if self.light.scan_axis.endswith("x") else "x"
        first = 0 if region is None else getattr(region, across)
        names = {mask: flag_names(mask) for mask in np.unique(values["flags"]).tolist()} if values else {}
        return [
            plain(
                {
                    "frame": frame,
                    "column": first + column,
                    "used": self.light.used[column],
                    "gain": values["gain"][frame, column],
                    "gain_std": values["gain_std"][frame, column],
                    "phase_rad": values["phase"][frame, column],
                    "mean": values["mean"][frame, column],
                    "snr_db": decibels(float(values["snr"][frame, column])),
                    "flags": names[int(values["flags"][frame, column])],
                }
            )
            for frame, column in (np.ndindex(values["gain"].shape) if values else ())
        ]

    def mean(self) -> dict[str, Any]:
        """Values of all frames together, weighted by inverse variance."""
        if math.isnan(self.light.frequency):
            return _NO_TONE
        values, weights = self.values, inverse_variance_weights(self.values["gain_std"])
        gain, gain_std = mean_and_std(values["gain"], values["gain_std"])
        if self.shared is not None:
            gain_std = float(np.fmax(gain_std, _shared_std(gain, *self.shared)))
        changed = do_differ(values["gain"], values["gain_std"])
        return {
            "gain": gain,
            "gain_std": gain_std,
            "phase": float(values["phase"][0]),
            "mean": weighted_mean(values["mean"], weights),
            "snr": weighted_mean(values["snr"], weights),
            "flags": int(np.bitwise_or.reduce(values["flags"])) | (Flag.MODEL_MISFIT if changed else 0),
        }


_NO_TONE = {**dict.fromkeys(("gain", "gain_std", "phase", "mean", "snr"), math.nan), "flags": 0}
_FRAME_VALUES = ("gain", "gain_std", "phase", "mean", "snr", "flags")
_BYTES_AT_ONCE = 1 << 21  # a frame of 1080p: copies stay in the cache, and their memory is used again


def tone_options(
    picture: PictureOptions, *, method: str, background: float | None, threads: int, **_: Any
) -> dict[str, Any]:
    """Options of ``tone_gain``, of the arguments of the command."""
    shape = {"waveform": picture.waveform, "duty": picture.duty}
    return {"method": method, "background": background or 0.0, "threads": threads, **shape}


def frame_gains(
    file: str,
    picture: PictureOptions,
    frequency: Quantity | str,
    options: dict[str, Any],
    part: Part | None = None,
    light: Light | None = None,
    per_column: bool = False,
) -> FrameGains:
    """Gains of all frames of a recording, or of a part.

    The light is estimated from the first batch of frames unless it is given; the gain of a frame depends on no other
    frame.
    """
    with open_pictures(file, picture, part) as pictures:
        camera, batches = pictures.camera.in_time_order, pictures.row_batches(_BYTES_AT_ONCE)
        first = next(batches)
        at_once = max(_BYTES_AT_ONCE // first[0].nbytes, 1)
        parts = (first[k : k + at_once] for k in range(0, len(first), at_once))
        if light is None:
            light = _find_light(first, pictures.camera, picture, frequency, options)
        columns = light.columns(first[:1])[0]
        if math.isnan(light.frequency):
            return FrameGains(camera, light, {name: np.zeros(0) for name in _FRAME_VALUES}, columns, len(first))
        gains, of_columns = [], []
        span, of_span = light.pooled(options["background"])
        pooled_options = {**options, "background": of_span, "pooled": True}
        weights = np.maximum(
            linear_light(first[0, ..., light.colour or 0][..., span], camera).mean(axis=0) - of_span, 0.0
        )
        course = np.zeros(len(columns))
        total = None if pictures.frame_count is None else math.ceil(pictures.frame_count / at_once)
        for batch in progress(itertools.chain(parts, batches), "measuring", total):
            every = batch[..., light.colour or 0]
            gains.append(tone_gain(every[..., span], camera, light.frequency, **pooled_options))
            course += _course(every[..., span], camera, weights)
            if per_column:
                of_columns.append(tone_gain(every, camera, light.frequency, **options))
    values = _joined(gains)
    count, shared = len(values["gain"]), None
    if count > 1 and weights.any():
        steady = Camera(camera.row_time, camera.exposure)
        of_all = tone_gain(course / (count * weights.sum()), steady, light.frequency, **options)
        ratio = 2.0 * float(np.sinc(options["duty"])) if options["waveform"] == "square" else 1.0
        shared = float(of_all.gain), float(of_all.gain_std), 2.0 / ratio**2
    return FrameGains(camera, light, values, columns, count, shared, _joined(of_columns) if of_columns else {})


def _shared_std(gain: float, of_all: float, of_all_std: float, tone: float) -> float:
    """Standard error by what all frames share: of the mean, and of the tone by as much as one phase is left of it in
    the mean of all frames. ``tone``: variance of a gain by its tone's error over that by the mean's and gain 1."""
    return of_all_std * math.sqrt((tone * (of_all / gain) ** 2 + gain**2) / (tone + of_all**2)) if gain > 0.0 else 0.0


def _course(frames: Frame, camera: Camera, weights: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(rows,) linear light of all frames and columns, by weights (1, columns)."""
    if camera.tone_curve != "linear":
        return np.asarray((linear_light(frames, camera) @ weights[0]).sum(axis=0))
    stored = np.stack([project(frame.T, weights, 1, 2)[0][0] for frame in frames])
    return np.asarray(stored.sum(axis=0) - len(frames) * camera.dark_level * weights.sum())


def _joined(gains: list[Any]) -> dict[str, npt.NDArray[Any]]:
    return {name: np.concatenate([getattr(each, name) for each in gains]) for name in _FRAME_VALUES}


def find_light(file: str, picture: PictureOptions, frequency: Quantity | str, options: dict[str, Any]) -> Light:
    """Estimate the light from the first frames, as ``frame_gains`` does."""
    with open_pictures(file, picture) as pictures:
        return _find_light(next(pictures.row_batches()), pictures.camera, picture, frequency, options)


def _find_light(
    frames: Frame, stored: Camera, picture: PictureOptions, frequency: Quantity | str, options: dict[str, Any]
) -> Light:
    given = picture.check_frequency("--frequency", frequency)
    camera, waveform = stored.in_time_order, frequency_waveform(picture)
    columns, colour = one_colour(frames, camera, waveform)
    flags: list[str] = []
    spread = None
    used = np.ones(columns.shape[-1], bool)
    if given is None:
        found = find_frequency(columns, camera, waveform=waveform, select=picture.region is None)
        given, spread, used = found.frequency, found.frequency_std, some_columns(found.columns.used)
        flags = flag_names(found.flags)
    elif picture.region is None:
        used = lit_columns(columns, camera, given)
    light = Light(stored.scan_axis, given, spread, flags, colour, used, misfit=0)
    if options["method"] == "dft" or math.isnan(given):
        return light
    return dataclasses.replace(light, misfit=_misfit(light.columns(frames[:1])[0], camera, given, options))


def _misfit(columns: Frame, camera: Camera, frequency: float, options: dict[str, Any]) -> int:
    """MODEL_MISFIT if the mean column of a frame varies, against the assumption of ``tone_gain``; else 0."""
    column = linear_light(columns, camera).mean(axis=-1)
    names = ("waveform", "duty", "background")
    found = varying_tone_gain(column, Camera(camera.row_time), frequency, **{name: options[name] for name in names})
    return int(found.flags) & Flag.MODEL_MISFIT
