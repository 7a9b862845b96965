"""``ocisac receive``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import click

from ocisac_fast.cli.output import emit_json, emit_table, flag_names, number, progress, quantity
from ocisac_fast.cli.pictures import PictureOptions, json_option, open_pictures, picture_options, plot_option
from ocisac_fast.cli.units import FREQUENCY, Quantity


@click.command(short_help="Bits of the lights in a recording.")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--chip-rate", type=FREQUENCY, help="Chips per second; else found in every frame.")
@click.option("--line-code", type=click.Choice(["none"]), default="none", show_default=True)
@picture_options
@plot_option("the combined column of the first frame with its chips")
@json_option
def receive(
    files: tuple[str, ...],
    chip_rate: Quantity | None,
    line_code: str,
    picture: PictureOptions,
    plot: str | None,
    as_json: bool,
) -> None:
    """Receive on-off keyed bits from FILE... (pictures, videos, .npy arrays, or -); 1 is bright.

    Columns, channel and chip rate are found. Chips cut by the edges of a frame are left out.
    """
    rate = picture.check_frequency("--chip-rate", chip_rate)
    every = []
    for file in files:
        for facts in _received(file, picture, plot, {"chip_rate": rate, "line_code": line_code}):
            named = {"file": file, **facts} if len(files) > 1 else facts
            if as_json:
                emit_json(named)
            else:
                every.append(named)
        plot = None  # the first frame of the first file
    if not as_json:
        header = [*(["file"] if len(files) > 1 else []), "frame", *_HEADER]
        emit_table("", header, [_row(facts, picture.row_time is not None) for facts in every], left=("flags",))
        for facts in every:
            click.echo(facts["bits"] or "no bits")


_HEADER = ("source", "chips", "rows per chip", "chip rate", "SNR", "flags")


def _received(
    file: str, picture: PictureOptions, plot: str | None, options: dict[str, Any]
) -> Iterator[dict[str, Any]]:
    """The JSON objects of a file, as its frames are read."""
    from ocisac_fast import receive as receive_frames

    with open_pictures(file, picture) as pictures:
        count = 0
        for batch in progress(pictures.batches(), "receiving", 1 if pictures.frame_count == 1 else None):
            results = receive_frames(batch, pictures.camera, **options)
            if plot is not None and count == 0:
                from ocisac_fast.plots import plot_received

                plot_received(plot, batch[0], pictures.camera, results[0])
            for result in results:
                yield _facts(result, count, batch.shape[1])
            count += len(batch)


def _facts(result: Any, first_frame: int, rows: int) -> dict[str, Any]:
    """The JSON object of a frame and source."""
    return {
        "frame": first_frame + int(result.frame),
        "source": int(result.source),
        "rows": rows,
        "bits": result.bits,
        "rows_per_chip": result.rows_per_chip,
        "chip_rate_hz": result.chip_rate,
        "snr_db": 10.0 * math.log10(result.snr) if result.snr > 0.0 else math.nan,
        "flags": flag_names(result.flags),
    }


def _row(facts: dict[str, Any], in_hertz: bool) -> list[str]:
    rate = quantity(facts["chip_rate_hz"], "Hz") if in_hertz else f"{quantity(facts['chip_rate_hz'], '')} a row"
    return [
        *([facts["file"]] if "file" in facts else []),
        str(facts["frame"]),
        str(facts["source"]),
        str(len(facts["bits"])),
        quantity(facts["rows_per_chip"], "", 5),
        rate,
        number(facts["snr_db"], "dB", 3),
        ", ".join(facts["flags"]) or "none",
    ]
