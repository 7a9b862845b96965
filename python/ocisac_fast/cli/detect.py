"""``ocisac detect``."""

from __future__ import annotations

import math
import statistics
from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import click
import numpy as np

from ocisac_fast.cli.command import command
from ocisac_fast.cli.output import emit_json, emit_table, facts_of, number, progress, quantity, rate
from ocisac_fast.cli.outputs import INPUT, OUTPUT, PLOTS, draw
from ocisac_fast.cli.pictures import PictureOptions, grey_of, open_pictures
from ocisac_fast.files import Part
from ocisac_fast.lights import LightSource
from ocisac_fast.lights.watch import watch_lights

_HEADER = ("light", "x", "y", "width", "height", "probability", "frequency", "gain", "SNR", "data", "remark")

_SPARE = ("probability", "data", "gain", "SNR")
_SUMMARY = ("light", "in frames", "first x", "first y", "frequency", "gain", "SNR", "data")

_MOST_FRAMES = 1024  # of a light's medians: a stream may have no end

_KEYS = (
    "probability frequency_hz frequency_std_hz gain gain_std phase_rad mean snr_db carries_data reflection_of reason "
    "flags"
)


@command
def detect(
    file: Annotated[str, INPUT],
    *,
    false_alarms: Annotated[float, "Max. expected number in a picture without a light; up to 1."] = 0.01,
    min_cycles: Annotated[float, "Min. cycles in a light's box."] = 2.5,
    search_every: Annotated[
        int,
        click.IntRange(1),
        "Frames between searches for new lights; lights found are followed. 1: search every frame by itself.",
    ] = 8,
    picture: PictureOptions,
    plot: Annotated[str | None, OUTPUT, f"Draw the first frame with the boxes of its lights ({PLOTS})."] = None,
    as_json: bool,
) -> None:
    """Detect every modulated light in FILE (a picture, a video, a .npy array, or -).

    Colours are averaged unless --channel selects one. x, y are the top left corner of a light's box in stored pixels.
    Each frame gives one object; the most probable light comes first, and a light keeps its number.

    The first four frames are searched, eight after one that misses a light, and one in --search-every: new lights
    appear that much later. In between a light that looks as before is measured where it is; frequency, size and
    probability stay. Others are refined.
    """
    options = {"false_alarms": false_alarms, "min_cycles": min_cycles}
    header = True
    firsts: dict[int, dict[str, Any]] = {}
    frames: Counter[int] = Counter()
    seen: dict[int, deque[dict[str, Any]]] = defaultdict(lambda: deque(maxlen=_MOST_FRAMES))
    last: dict[str, Any] = {}
    try:
        for found in detected_lights(file, picture, options, plot, search_every=search_every):
            if as_json:
                emit_json(found)
                continue
            title = "" if found["frames"] == 1 else f"frame {found['frame']}"
            if picture.names(found["scan_axis"]) and found["frame"] == 0:
                title = f"{title}, scan axis {found['scan_axis']}".removeprefix(", ")
            rows = [_row(source, found["sources"], picture) for source in found["sources"]]
            if rows or header:
                emit_table(title, picture.headings(_HEADER), rows, left=("remark",), spare=picture.headings(_SPARE))
            header, last = False, found
            for source in found["sources"]:
                firsts.setdefault(source["light"], source)
                frames[source["light"]] += 1
                seen[source["light"]].append(source)
    finally:  # after an interrupt too
        if last.get("frame", 0) > 0:
            rows = [_summary(first, frames[light], seen[light], picture) for light, first in sorted(firsts.items())]
            title = f"lights of {last['frame'] + 1} frames"
            emit_table(title, picture.headings(_SUMMARY), rows, spare=("data", "first x", "first y"))


def detected_lights(
    file: str,
    picture: PictureOptions,
    options: dict[str, Any],
    plot: str | None = None,
    part: Part | None = None,
    search_every: int = 1,
    group: int = 4,
) -> Iterator[dict[str, Any]]:
    """The JSON object of each frame, of all frames or of a part, as ``watch_lights`` sees them."""
    first = 0 if part is None else part.first
    with open_pictures(file, picture, part) as pictures:
        count = pictures.frame_count
        greys = (grey_of(frame) for frame in progress(pictures.frames, "detecting", count))
        for seen in watch_lights(greys, pictures.camera, search_every, group, **options):
            if first + seen.frame == 0:
                draw(plot, "plot_sources", seen.pixels, pictures.camera, sources=seen.sources)
            yield {
                "frame": first + seen.frame,
                "frames": count,
                "sources": [
                    _facts(one, {"light": number, "searched": seen.searched}, picture)
                    for one, number in zip(seen.sources, seen.numbers, strict=True)
                ],
                "scan_axis": pictures.camera.scan_axis,
            }


def _facts(source: LightSource, seen: dict[str, Any], picture: PictureOptions) -> dict[str, Any]:
    box = picture.in_picture(source.region)._asdict()
    facts = facts_of(source, _KEYS)
    if picture.waveform == "square":
        facts |= {name: facts[name] / (2.0 * np.sinc(picture.duty)) for name in ("gain", "gain_std")}
    return picture.in_units({**box, **facts, **seen})


def _row(source: dict[str, Any], every: list[dict[str, Any]], picture: PictureOptions) -> list[str]:
    unit = "hz" if picture.in_hertz else "cycles_per_row"
    remark = source["reason"]
    if source["reflection_of"] is not None:
        remark = f"reflection of {every[source['reflection_of']]['light']} (by {remark})"
    elif remark:
        remark = f"parts merged ({remark})"
    return [
        str(source["light"]),
        *(str(source[name]) for name in ("x", "y", "width", "height")),
        f"{source['probability']:.2f}",
        rate(source[f"frequency_{unit}"], source[f"frequency_std_{unit}"], picture.in_hertz, 5),
        quantity(source["gain"], "", 3),
        number(source["snr_db"], "dB", 3),
        "yes" if source["carries_data"] else "no",
        remark,
    ]


def _summary(first: dict[str, Any], frames: int, every: Sequence[dict[str, Any]], picture: PictureOptions) -> list[str]:
    """The row of a light in the summary of a film: medians over the last frames that show it."""
    unit = "hz" if picture.in_hertz else "cycles_per_row"

    def median(key: str) -> float:
        known = [one[key] for one in every if one[key] is not None and math.isfinite(one[key])]
        return statistics.median(known) if known else math.nan

    return [
        str(first["light"]),
        str(frames),
        *(str(first[name]) for name in ("x", "y")),
        rate(median(f"frequency_{unit}"), None, picture.in_hertz, 5),
        quantity(median("gain"), "", 3),
        number(median("snr_db"), "dB", 3),
        "yes" if sum(one["carries_data"] for one in every) * 2 > len(every) else "no",
    ]
