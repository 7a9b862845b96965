"""``ocisac calibrate``."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import click
import numpy as np

from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.cli.columns import frequency_waveform, one_colour, some_columns
from ocisac_fast.cli.command import command
from ocisac_fast.cli.doubts import warn_of_calibration, warn_of_texture
from ocisac_fast.cli.output import emit, facts_of, flag_names, number, quantity, with_spread
from ocisac_fast.cli.outputs import INPUT
from ocisac_fast.cli.pictures import PictureOptions, open_pictures
from ocisac_fast.cli.units import FREQUENCY, SHARES, Quantity
from ocisac_fast.core.flags import Flag
from ocisac_fast.exposure import PulseBands, calibrate_pulses, pulse_bands
from ocisac_fast.files.recording import FileError
from ocisac_fast.lights import calibrate as measure


@command
def calibrate(
    files: Annotated[tuple[str, ...], INPUT, {"metavar": "FILE...", "nargs": -1}],
    *,
    frequency: Annotated[Quantity, FREQUENCY, "Frequency of the light, below half the row rate."],
    pulses: Annotated[
        tuple[float, ...] | None, SHARES, "Duty of a lamp lit once per frame, one for each FILE: 5%,10%."
    ] = None,
    picture: PictureOptions,
    as_json: bool,
) -> None:
    """Measure the row time T_r with a light of known frequency in FILE (a picture, a video, a .npy array, or -).

    All frames that fit into 64 MiB are used together; without a light there is no answer. With --pulses the light is
    lit at most once per frame; each FILE is a video at one duty, all of one camera and exposure, and all frames are
    used. Two or more duties give T_r at any exposure shorter than the pulses.
    """
    unknown = dataclasses.replace(picture, row_time=None, exposure=None, frame_rate=None)  # the row time is estimated
    if pulses is not None:
        _calibrate_pulses(files, float(frequency), pulses, unknown, as_json)
        return
    if len(files) > 1:
        raise click.UsageError(f"FILE: got {len(files)}, allowed: one without --pulses")
    with open_pictures(files[0], unknown) as pictures:
        axis, camera, frames = pictures.camera.scan_axis, pictures.camera.in_time_order, next(pictures.row_batches())
    waveform = frequency_waveform(picture)
    columns, _ = one_colour(frames, camera, waveform)
    per_row = dataclasses.replace(camera, row_time=1.0, exposure=None)
    result = measure(columns, float(frequency), waveform=waveform)
    found, flags = result.found, flag_names(result.flags)
    if not found.cycles_per_row > 0.0 or Flag.NO_TONE in result.flags:
        raise FileError(f"{files[0]}: no light that varies along the rows was found: --region x,y,w,h within the lamp")
    lit = columns[..., some_columns(found.columns.used)]
    advance = None if picture.frame_rate is None else frequency / picture.frame_rate
    still = warn_of_texture(lit, per_row, found.cycles_per_row, advance)
    if not still and Flag.MODEL_MISFIT in result.flags:
        warn_of_calibration(result.row_time * columns.shape[1])
    cycles = found.cycles_per_row * columns.shape[1]
    facts = {**facts_of(result, "row_time_s row_time_std_s probability"), "frames": len(columns), "scan_axis": axis}
    facts |= {"rows": columns.shape[1], "columns": int(found.columns.used.sum()), "cycles": cycles}
    emit(
        as_json,
        {**facts, "flags": flags},
        {
            "row time": with_spread(result.row_time, result.row_time_std, "s"),
            "cycles per row": with_spread(found.cycles_per_row, found.cycles_per_row_std, ""),
            "cycles in the frame": number(cycles, ""),
            "probability of the light": number(result.probability, ""),
            **({"scan axis": axis} if picture.names(axis) else {}),
            "frames": f"{len(columns)} of {columns.shape[1]} rows",
            "columns": f"{found.columns.used.sum()} of {columns.shape[2]}",
            "flags": ", ".join(flags) or "none",
        },
    )


_PULSE_KEYS = "row_time_s row_time_std_s period_rows period_rows_std exposure_s exposure_std_s offset_s offset_std_s"


def _calibrate_pulses(
    files: tuple[str, ...], frequency: float, duties: tuple[float, ...], picture: PictureOptions, as_json: bool
) -> None:
    if len(files) != len(duties):
        raise click.UsageError(f"--pulses: got {len(duties)} duties, allowed: one for each of {len(files)} files")
    result = calibrate_pulses([_bands(file, picture) for file in files], frequency, duties)
    every = list(zip(files, duties, result.rows, result.pulse_widths, result.bands, strict=True))
    facts = {**facts_of(result, _PULSE_KEYS), "ramp_misfit": result.misfit}
    facts["pulses"] = [
        {"file": file, "duty": duty, "lit_rows": rows, "pulse_width_s": width}
        | {"bands": bands.whole.size, "split_bands": bands.split.size}
        for file, duty, rows, width, bands in every
    ]
    facts["flags"] = result.flags
    lines = {
        "row time": with_spread(result.row_time, result.row_time_std, "s"),
        "period of the lamp": with_spread(result.period_rows, result.period_rows_std, "rows", 5),
        "exposure": with_spread(result.exposure, result.exposure_std, "s", 4),
        "offset of pulses": with_spread(result.offset, result.offset_std, "s", 4),
        "flags": ", ".join(result.flags) or "none",
    }
    for file, _, rows, width, _ in every:
        lines[file] = f"{quantity(rows, '', 5)} rows lit, pulses of {quantity(width, 's', 5)}"
    emit(as_json, facts, lines)


def _bands(file: str, picture: PictureOptions) -> PulseBands:
    """Bands in the mean light of each row."""
    with open_pictures(file, picture, axis_of_light=False) as pictures:  # a band of lit rows does not tell its axis
        means = [linear_light(batch, pictures.camera).mean(axis=(2, 3)) for batch in pictures.row_batches()]
        return pulse_bands(np.concatenate(means))
