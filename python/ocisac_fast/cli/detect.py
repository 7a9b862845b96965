"""``ocisac detect``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import click
import numpy as np

from ocisac_fast.cli.output import decibels, emit_json, emit_table, flag_names, number, progress, quantity, rate
from ocisac_fast.cli.outputs import writes
from ocisac_fast.cli.pictures import (
    FILE_PATH,
    PictureOptions,
    grey_of,
    json_option,
    open_pictures,
    picture_options,
    plot_option,
)
from ocisac_fast.files import Part
from ocisac_fast.files.recording import Frame

_GROUP = 4  # frames
_HEADER = ("light", "x", "y", "width", "height", "probability", "frequency", "gain", "SNR", "data", "remark")


@click.command(short_help="Modulated lights in a recording.")
@click.argument("file", type=FILE_PATH)
@click.option(
    "--false-alarms",
    type=float,
    default=0.02,
    show_default=True,
    help="Max. expected number in a picture without a light; up to 1.",
)
@click.option("--min-cycles", type=float, default=2.5, show_default=True, help="Min. cycles in a light's box.")
@picture_options
@plot_option("the first frame with the boxes of its lights")
@writes("plot")
@json_option
def detect(
    file: str, false_alarms: float, min_cycles: float, picture: PictureOptions, plot: str | None, as_json: bool
) -> None:
    """Detect every modulated light in FILE (a picture, a video, a .npy array, or -).

    Colours are averaged unless --channel selects one. x, y are the top left corner of a light's box in stored pixels.
    Each frame gives one object; the most probable light comes first.
    """
    options = {"false_alarms": false_alarms, "min_cycles": min_cycles}
    header = True
    for found in detected_lights(file, picture, options, plot):
        if as_json:
            emit_json(found)
            continue
        title = "" if found["frames"] == 1 else f"frame {found['frame']}"
        if picture.names(found["scan_axis"]) and found["frame"] == 0:
            title = f"{title}, scan axis {found['scan_axis']}".removeprefix(", ")
        rows = [_row(k, source, picture) for k, source in enumerate(found["sources"])]
        if rows or header:
            emit_table(title, _HEADER, rows, left=("remark",))
        header = False


def detected_lights(
    file: str,
    picture: PictureOptions,
    options: dict[str, Any],
    plot: str | None = None,
    part: Part | None = None,
    group: int = _GROUP,
) -> Iterator[dict[str, Any]]:
    """The JSON object of each frame, of all frames or of a part; ``group``: number of frames that are compared."""
    from ocisac_fast.lights import detect_sources

    first = 0 if part is None else part.first
    with open_pictures(file, picture, part) as pictures:
        count = pictures.frame_count
        index = first
        for greys in _groups((grey_of(frame) for frame in progress(pictures.frames, "detecting", count)), group):
            found = detect_sources(np.stack(greys), pictures.camera, **options)
            if plot is not None and index == 0:
                from ocisac_fast.plots import plot_sources

                of_first = [source for source in found if source.frame == 0]
                plot_sources(greys[0], pictures.camera, path=plot, sources=of_first)
            for k in range(len(greys)):
                sources = [_facts(source, picture) for source in found if source.frame == k]
                yield {"frame": index + k, "frames": count, "sources": sources, "scan_axis": pictures.camera.scan_axis}
            index += len(greys)


def _groups(frames: Iterator[Frame], count: int) -> Iterator[list[Frame]]:
    """Frames of one shape and type in groups, the last by up to one larger: neighbours tell lights from textures."""
    waiting: list[Frame] = []
    for frame in frames:
        if waiting and (frame.shape, frame.dtype) != (waiting[0].shape, waiting[0].dtype):
            yield waiting
            waiting = []
        elif len(waiting) > count or (count == 1 and waiting):
            yield waiting[:count]
            waiting = waiting[count:]
        waiting.append(frame)
    if waiting:
        yield waiting


def _facts(source: Any, picture: PictureOptions) -> dict[str, Any]:
    facts = {
        **picture.in_picture(source.region)._asdict(),
        "probability": source.probability,
        "frequency_hz": source.frequency,
        "frequency_std_hz": source.frequency_std,
        "gain": source.gain,
        "gain_std": source.gain_std,
        "phase_rad": source.phase,
        "mean": source.mean,
        "snr_db": decibels(source.snr),
        "carries_data": source.carries_data,
        "reflection_of": source.reflection_of,
        "reason": source.reason,
        "flags": flag_names(source.flags),
    }
    return picture.in_units(facts)


def _row(index: int, source: dict[str, Any], picture: PictureOptions) -> list[str]:
    unit = "hz" if picture.in_hertz else "cycles_per_row"
    remark = source["reason"]
    if source["reflection_of"] is not None:
        remark = f"reflection of {source['reflection_of']} (by {remark})"
    elif remark:
        remark = f"parts merged ({remark})"
    return [
        str(index),
        *(str(source[name]) for name in ("x", "y", "width", "height")),
        f"{source['probability']:.2f}",
        rate(source[f"frequency_{unit}"], source[f"frequency_std_{unit}"], picture.in_hertz, 5),
        quantity(source["gain"], "", 3),
        number(source["snr_db"], "dB", 3),
        "yes" if source["carries_data"] else "no",
        remark,
    ]
