"""``ocisac calibrate``."""

from __future__ import annotations

import dataclasses

import click

from ocisac_fast.cli.columns import frequency_waveform, one_colour
from ocisac_fast.cli.output import emit_facts, emit_json, flag_names, with_spread
from ocisac_fast.cli.pictures import PictureOptions, json_option, open_pictures, picture_options
from ocisac_fast.cli.units import FREQUENCY, Quantity


@click.command(short_help="Row time of a camera, from a light of known frequency.")
@click.argument("file")
@click.option("--frequency", type=FREQUENCY, required=True, help="Of the light, below half the row rate.")
@picture_options
@json_option
def calibrate(file: str, frequency: Quantity, picture: PictureOptions, as_json: bool) -> None:
    """Measure the row time T_r with a light of known frequency in FILE (a picture, a video, a .npy array, or -).

    All frames that fit into 64 MiB are used together.
    """
    from ocisac_fast.tones import calibrate as measure

    unknown = dataclasses.replace(picture, row_time=None, exposure=None)  # what it is to find, and what it needs not
    with open_pictures(file, unknown) as pictures:
        frames = next(pictures.batches())
    waveform = frequency_waveform(picture)
    columns, _ = one_colour(frames, pictures.camera, waveform)
    result = measure(columns, float(frequency), waveform=waveform)
    found, flags = result.found, flag_names(result.flags)
    if as_json:
        facts = {"row_time_s": result.row_time, "row_time_std_s": result.row_time_std, "frames": len(columns)}
        emit_json({**facts, "rows": columns.shape[1], "columns": int(found.columns.used.sum()), "flags": flags})
        return
    emit_facts(
        "",
        {
            "row time": with_spread(result.row_time, result.row_time_std, "s"),
            "cycles per row": with_spread(found.cycles_per_row, found.cycles_per_row_std, ""),
            "frames": f"{len(columns)} of {columns.shape[1]} rows",
            "columns": f"{found.columns.used.sum()} of {columns.shape[2]}",
            "flags": ", ".join(flags) or "none",
        },
    )
