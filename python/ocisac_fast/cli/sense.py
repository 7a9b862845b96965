"""``ocisac sense``."""

from __future__ import annotations

import dataclasses
import itertools
import math
import warnings
from collections.abc import Callable
from typing import Annotated, Any, Literal

import click

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.command import command
from ocisac_fast.cli.errors import SOME_FAILED
from ocisac_fast.cli.output import (
    emit_json,
    emit_table,
    facts_of,
    is_collected,
    number,
    quantity,
    rate,
    with_spread,
)
from ocisac_fast.cli.outputs import INPUT, OUTPUT, PLOTS, draw
from ocisac_fast.cli.pictures import PictureOptions, grey_of, open_pictures, rows_and_columns, with_colours
from ocisac_fast.cli.units import FREQUENCY, LENGTH, Quantity
from ocisac_fast.core import Flag
from ocisac_fast.core.regions import Region
from ocisac_fast.files.recording import Frame, gathered
from ocisac_fast.sensing import KnownMotion, SensedRegion, background_light, sense_region
from ocisac_fast.sensing.kind import step_allowance
from ocisac_fast.sensing.picture import SEARCHED, find_periodic
from ocisac_fast.sensing.region import Request

_BOX = ("x", "y", "width", "height")
_HEADER = ("region", "kind", *_BOX, "frequency", "f_x v", "gain", "theory", "speed", "SNR", "flags")
_SPARE = ("theory", "SNR", "f_x v", "height", "width", "y", "x")
_KEYS = (
    "kind frequency_hz frequency_std_hz motion_frequency_hz motion_frequency_std_hz motion_candidates_hz direction "
    "gain gain_std frames_gain frames_gain_std theory contrast contrast_range mean background_given speed_m_s "
    "speed_std_m_s spatial_frequency_per_m spatial_frequency_std_per_m cycles_per_column cycles_per_frame snr_db flags"
)
_CLEAR_EVIDENCE = 5.0  # a coincidence has a probability below e^-5
_DIRECTIONS: dict[str | None, Literal[-1, 0, 1]] = {"with": 1, "against": -1}


@dataclasses.dataclass(frozen=True, kw_only=True)
class SenseOptions:
    """Options that state known properties of textures and lights."""

    frequency: Annotated[Quantity | None, FREQUENCY, "Frequency in the columns of --region; default: estimated."] = None
    motion: Annotated[Literal["across", "along"] | None, "Motion of the texture: across or along the rows."] = None
    direction: Annotated[Literal["with", "against"] | None, "Direction of motion along the rows."] = None
    pitch: Annotated[Quantity | None, LENGTH, "Distance of neighbouring pixels in the scene."] = None
    spatial_frequency: Annotated[float | None, "Spatial frequency of the texture, cycles per metre."] = None
    speed: Annotated[float | None, "Speed of the texture, m/s."] = None
    depth: Annotated[float, "Contrast of the texture itself."] = 1.0
    background: Annotated[float | None, "Background of the light in --region, stored values above dark."] = None
    unlit: Annotated[str | None, INPUT, "Recording of the same view without the lights."] = None
    beside: Annotated[bool, "Measure the lights' background beside them."] = False


@command
def sense(
    file: Annotated[str, INPUT],
    *,
    frames: Annotated[int, click.IntRange(1), "Number of successive frames used."] = 8,
    options: SenseOptions,
    picture: PictureOptions,
    plot: Annotated[str | None, OUTPUT, f"Draw the first frame with its regions ({PLOTS})."] = None,
    as_json: bool,
) -> None:
    """Measure moving textures and modulated lights in FILE (a picture, a video, a .npy array, or -).

    For each region: frequency in its columns, motion-induced frequency f_x v, contrast gain (eq. 16), speed. --region
    is measured as one region, and without a tone in it the exit code is 3; without the option, lights and moving
    textures are detected. Several successive frames separate textures from lights, and motion along the rows from
    motion across them.
    """
    if picture.row_time is None and options.speed is not None:
        raise click.UsageError("--speed: needs --row-time")
    with open_pictures(file, picture, axis_of_light=False) as pictures:
        greys = (grey_of(frame) for frame in itertools.islice(pictures.frames, frames))
        count = min(frames, pictures.frame_count or frames)
        first = gathered(itertools.islice(greys, SEARCHED), min(count, SEARCHED))
        dark = None if options.unlit is None else _read_unlit(options.unlit, picture, count)
        found = _along_best_axis(first, pictures.camera, picture, options, dark)
        kept = gathered((found.part.cut(frame) for frame in itertools.chain(first, greys)), count)
    regions = found.measure(kept) if len(kept) > len(first) else found.regions
    camera = found.camera
    draw(plot, "plot_regions", first[0], camera, regions=regions)
    facts = [_facts(region, picture) for region in regions]
    axis = camera.scan_axis
    if as_json:
        rows, columns = rows_and_columns(first.shape[1:], camera)
        emit_json({"frames": len(kept), "rows": rows, "columns": columns, "regions": facts, "scan_axis": axis})
    else:
        emit_table(
            f"scan axis {axis}" if picture.names(axis) else "",
            picture.headings(_HEADER),
            [_row(k, one, picture) for k, one in enumerate(facts)],
            left=("kind", "flags"),
            spare=_SPARE,
        )
    if picture.region is not None and math.isnan(regions[0].gain):
        raise click.exceptions.Exit(SOME_FAILED)


def _read_unlit(file: str, picture: PictureOptions, max_frames: int) -> Frame:
    """The first frames of the view without the lights, in grey."""
    with open_pictures(file, picture, axis_of_light=False) as pictures:
        greys = (grey_of(frame) for frame in itertools.islice(pictures.frames, max_frames))
        return gathered(greys, min(max_frames, pictures.frame_count or max_frames))


@dataclasses.dataclass(frozen=True)
class _Found:
    """Regions along an axis, and how they are measured in more frames."""

    camera: Camera
    regions: list[SensedRegion]  # of the first frames
    part: Region  # of the picture as stored, which measure needs of all frames
    measure: Callable[[Frame], list[SensedRegion]]  # of (frames, height, width) of that part


def _along_best_axis(
    first: Frame, camera: Camera, picture: PictureOptions, options: SenseOptions, dark: Frame | None
) -> _Found:
    """Find regions along the stated axis, or along y or x, whichever has more evidence of being read along it.

    Moving stripes look like lights along the other axis, but their phases do not advance from frame to frame as they do
    from row to row. Without evidence, an axis along which there is nothing yields to one with a light. The other axis
    is tried only where not everything along the first one is clearly in step.
    """
    found = _found(first, camera, picture, options, dark)
    evidence, stated = _axis_evidence(found), picture.scan_axis != "auto"
    if (stated and is_collected()) or (evidence > _CLEAR_EVIDENCE and all(map(_in_step, found.regions))):
        return found
    other = dataclasses.replace(camera, scan_axis="y" if camera.scan_axis.endswith("x") else "x")
    crossed = _found(first, other, picture, options, dark)
    seen = [one for one in found.regions if one.kind != "unknown"]
    alone = evidence == 0.0 and not seen and any(one.kind == "light" for one in crossed.regions)
    if not (alone or _axis_evidence(crossed) > evidence):
        return found
    if not stated:
        return crossed
    warnings.warn(
        f"--scan-axis: got {picture.scan_axis}, but what is seen along {other.scan_axis} is more probably read in "
        f"time: probably --scan-axis {other.scan_axis}",
        stacklevel=2,
    )
    return found


def _axis_evidence(found: _Found) -> float:
    """Logarithm of 1 over the probability that the phase of the clearest region in step is a coincidence."""
    tolerance, least = KnownMotion().timing_tolerance, 1.0
    frame_time = math.nan if found.camera.frame_time is None else found.camera.frame_time
    for one in filter(_in_step, found.regions):
        drift, expected = one.frequency_std * frame_time, one.frequency * frame_time
        least = min(least, 2.0 * step_allowance(one.cycles_per_frame_std, drift, expected, tolerance))
    return -math.log(least)


def _in_step(region: SensedRegion) -> bool:
    """True if the phase advances from frame to frame as it does from row to row: a light, or motion across the rows."""
    if region.flags & (Flag.AMBIGUOUS_KIND | Flag.AMBIGUOUS_MOTION):
        return False
    return region.kind == "light" or math.isclose(region.motion_frequency, region.frequency)


def _found(first: Frame, camera: Camera, picture: PictureOptions, options: SenseOptions, dark: Frame | None) -> _Found:
    frequency, beside = picture.check_frequency("--frequency", options.frequency), options.beside
    unlit = None if dark is None else with_colours(dark)
    motion = KnownMotion(
        axis=options.motion,
        direction=_DIRECTIONS.get(options.direction, 0),
        pitch=options.pitch,
        spatial_frequency=options.spatial_frequency,
        speed=options.speed,
    )
    light: dict[str, Any] = {"waveform": picture.waveform, "duty": picture.duty, "depth": options.depth}
    light["motion"] = motion
    if picture.region is None:
        for name, value in (("frequency", frequency), ("background", options.background)):
            if value is not None:
                raise click.UsageError(f"--{name}: needs --region")
        request = Request(**light)
        found = find_periodic(with_colours(first), camera)
        regions = found.measure(with_colours(first), request, unlit, beside=beside)
        inner = found.cut(beside=beside)
        inner_dark = None if dark is None else with_colours(inner.part.cut(dark))
        return _Found(
            camera,
            regions,
            inner.part,
            lambda frames: inner.measure(with_colours(frames), request, inner_dark, beside=beside),
        )
    if beside:
        raise click.UsageError("--beside: not with --region")
    if dark is not None and options.background is not None:
        raise click.UsageError("--background: not with --unlit")
    measured = options.background if unlit is None else background_light(unlit, camera)

    def measure(frames: Frame) -> list[SensedRegion]:
        return [sense_region(with_colours(frames), camera, frequency, background=measured, **light)]

    height, width = first.shape[1:]
    return _Found(camera, measure(first), Region(0, 0, width, height), measure)


def _facts(region: SensedRegion, picture: PictureOptions) -> dict[str, Any]:
    return picture.in_units({**picture.in_picture(region.region)._asdict(), **facts_of(region, _KEYS)})


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
