"""``ocisac sense``."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from typing import TYPE_CHECKING, Any, Literal

import click

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.output import decibels, emit_json, emit_table, flag_names, number, quantity, rate, with_spread
from ocisac_fast.cli.outputs import writes
from ocisac_fast.cli.pictures import (
    FILE_PATH,
    PictureOptions,
    grey_of,
    json_option,
    open_pictures,
    picture_options,
    plot_option,
    rows_and_columns,
    stack,
)
from ocisac_fast.cli.units import FREQUENCY, LENGTH, Quantity
from ocisac_fast.files.recording import Frame

if TYPE_CHECKING:
    from ocisac_fast.sensing import SensedRegion

_BOX = ("x", "y", "width", "height")
_HEADER = ("region", "kind", *_BOX, "frequency", "f_x v", "gain", "theory", "speed", "SNR", "flags")
_DIRECTIONS: dict[str | None, Literal[-1, 0, 1]] = {"with": 1, "against": -1}


@click.command(short_help="Moving textures and lights in a recording: gain, motion, speed.")
@click.argument("file", type=FILE_PATH)
@click.option(
    "--frames", type=click.IntRange(1), default=8, show_default=True, help="Number of successive frames used."
)
@click.option("--frame-rate", type=FREQUENCY, help="Frame rate of the recording; default: from the file.")
@click.option("--frequency", type=FREQUENCY, help="Frequency in the columns of --region; default: estimated.")
@click.option(
    "--motion", type=click.Choice(["across", "along"]), help="Motion of the texture: across or along the rows."
)
@click.option("--direction", type=click.Choice(list(_DIRECTIONS)), help="Direction of motion along the rows.")
@click.option("--pitch", type=LENGTH, help="Distance of neighbouring pixels in the scene.")
@click.option("--spatial-frequency", type=float, help="Spatial frequency of the texture, cycles per metre.")
@click.option("--speed", type=float, help="Speed of the texture, m/s.")
@click.option("--depth", type=float, default=1.0, show_default=True, help="Contrast of the texture itself.")
@click.option("--background", type=float, help="Background of the light in --region, stored values above dark.")
@click.option("--unlit", type=click.Path(dir_okay=False), help="Recording of the same view without the lights.")
@click.option("--beside", is_flag=True, help="Measure the lights' background beside them.")
@functools.partial(picture_options, scan_axis="y")  # moving stripes look like lights along the other axis
@plot_option("the first frame with its regions")
@writes("plot")
@json_option
def sense(file: str, picture: PictureOptions, plot: str | None, as_json: bool, frames: int, **options: Any) -> None:
    """Measure moving textures and modulated lights in FILE (a picture, a video, a .npy array, or -).

    For each region: frequency in its columns, motion-induced frequency f_x v, contrast gain (eq. 16), speed. --region
    is measured as one region; without it, lights and moving textures are detected. Several successive frames separate
    textures from lights, and motion along the rows from motion across them.
    """
    if picture.row_time is None:
        for name in ("frame_rate", "speed"):
            if options[name] is not None:
                raise click.UsageError(f"--{name.replace('_', '-')}: needs --row-time")
    view, camera = _read(file, picture, frames, options.pop("frame_rate"))
    regions = _regions(view, camera, picture, options)
    if plot is not None:
        from ocisac_fast.plots import plot_regions

        plot_regions(view[0, ..., 0], camera, path=plot, regions=regions)
    facts = [_facts(region, picture) for region in regions]
    if as_json:
        rows, columns = rows_and_columns(view.shape[1:], camera)
        emit_json({"frames": len(view), "rows": rows, "columns": columns, "regions": facts})
        return
    table = [_row(k, one, picture) for k, one in enumerate(facts)]
    emit_table("", _HEADER, table, left=("kind", "flags"))


def _read(file: str, picture: PictureOptions, max_frames: int, frame_rate: Quantity | None) -> tuple[Frame, Camera]:
    """The first frames in grey, (frames, height, width, 1), and their camera."""
    with open_pictures(file, picture) as pictures:
        view = stack([grey_of(frame) for frame in itertools.islice(pictures.frames, max_frames)])
        camera = pictures.camera
    if frame_rate is not None:
        if not (math.isfinite(frame_rate) and frame_rate > 0.0):
            raise ValueError(f"--frame-rate: got {frame_rate}, allowed: a finite number above 0")
        camera = dataclasses.replace(camera, frame_time=1.0 / float(frame_rate))
    return view, camera


def _regions(view: Frame, camera: Camera, picture: PictureOptions, options: dict[str, Any]) -> list[SensedRegion]:
    from ocisac_fast.sensing import KnownMotion, background_light, sense as sense_picture, sense_region

    frequency = picture.check_frequency("--frequency", options.pop("frequency"))
    background, unlit, beside = options.pop("background"), options.pop("unlit"), options.pop("beside")
    direction, axis = _DIRECTIONS.get(options.pop("direction"), 0), options.pop("motion")
    light: dict[str, Any] = {"waveform": picture.waveform, "duty": picture.duty, "depth": options.pop("depth")}
    motion = KnownMotion(axis=axis, direction=direction, **options)
    dark = None if unlit is None else _read(unlit, picture, len(view), None)[0]
    if picture.region is None:
        for name, value in (("frequency", frequency), ("background", background)):
            if value is not None:
                raise click.UsageError(f"--{name}: needs --region")
        return sense_picture(view, camera, unlit=dark, beside=beside, motion=motion, **light)
    if beside:
        raise click.UsageError("--beside: not with --region")
    if dark is not None and background is not None:
        raise click.UsageError("--background: not with --unlit")
    measured = background if dark is None else background_light(dark, camera)
    return [sense_region(view, camera, frequency, background=measured, motion=motion, **light)]


def _facts(region: SensedRegion, picture: PictureOptions) -> dict[str, Any]:
    facts = {
        **picture.in_picture(region.region)._asdict(),
        "kind": region.kind,
        "frequency_hz": region.frequency,
        "frequency_std_hz": region.frequency_std,
        "motion_frequency_hz": region.motion_frequency,
        "motion_frequency_std_hz": region.motion_frequency_std,
        "motion_candidates_hz": region.motion_candidates,
        "direction": region.direction,
        "gain": region.gain,
        "gain_std": region.gain_std,
        "frames_gain": region.frames_gain,
        "frames_gain_std": region.frames_gain_std,
        "theory": region.theory,
        "contrast": region.contrast,
        "contrast_range": region.contrast_range,
        "mean": region.mean,
        "background_given": region.background_given,
        "speed_m_s": region.speed,
        "speed_std_m_s": region.speed_std,
        "spatial_frequency_per_m": region.spatial_frequency,
        "spatial_frequency_std_per_m": region.spatial_frequency_std,
        "cycles_per_column": region.cycles_per_column,
        "cycles_per_frame": region.cycles_per_frame,
        "snr_db": decibels(region.snr),
        "flags": flag_names(region.flags),
    }
    return picture.in_units(facts)


def _row(index: int, region: dict[str, Any], picture: PictureOptions) -> list[str]:
    unit = "hz" if picture.in_hertz else "cycles_per_row"
    return [
        str(index),
        region["kind"],
        *(str(region[name]) for name in _BOX),
        rate(region[f"frequency_{unit}"], region[f"frequency_std_{unit}"], picture.in_hertz, 6),
        rate(region[f"motion_frequency_{unit}"], region[f"motion_frequency_std_{unit}"], picture.in_hertz, 6),
        with_spread(region["gain"], region["gain_std"], "", 4),
        quantity(region["theory"], "", 4),
        number(region["speed_m_s"], "m/s", 5),
        number(region["snr_db"], "dB", 3),
        ", ".join(region["flags"]),
    ]
