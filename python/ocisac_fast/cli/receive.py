"""``ocisac receive``."""

from __future__ import annotations

import math
from typing import Any

import click

from ocisac_fast.cli.output import emit_json, emit_table, flag_names, progress, quantity
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
    from ocisac_fast import receive as receive_frames

    rate = picture.check_frequency("--chip-rate", chip_rate)
    rows: list[list[str]] = []
    for file in files:
        with open_pictures(file, picture) as pictures:
            count = 0
            for batch in progress(pictures.batches(), "receiving", None if pictures.frame_count != 1 else 1):
                results = receive_frames(batch, pictures.camera, chip_rate=rate, line_code=line_code)
                if plot is not None:
                    from ocisac_fast.plots import plot_received

                    plot_received(plot, batch[0], pictures.camera, results[0])
                    plot = None
                for result in results:
                    facts = {**({"file": file} if len(files) > 1 else {}), **_facts(result, count, batch.shape[1])}
                    if as_json:
                        emit_json(facts)
                    else:
                        rows.append(_row(facts, picture.row_time is not None))
                count += len(batch)
    if not as_json:
        emit_table("", [*(["file"] if len(files) > 1 else []), "frame", *_HEADER], rows)


_HEADER = ("source", "chips", "rows per chip", "chip rate", "SNR", "flags", "bits")


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
        quantity(facts["snr_db"], "dB", 3),
        ", ".join(facts["flags"]) or "none",
        facts["bits"],
    ]
