"""``ocisac clean``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.output import emit_json, emit_table, number, progress, rate
from ocisac_fast.cli.outputs import writes
from ocisac_fast.cli.pictures import FILE_PATH, PictureOptions, json_option, picture_options, select, stack
from ocisac_fast.files import open_recording, write_frames
from ocisac_fast.files.recording import Frame, RecordingStream

if TYPE_CHECKING:
    from ocisac_fast.cleaning import VideoCleaner

_HEADER = (
    "frame", "light", "frequency or chip rate", "share", "toe", "saturated", "too dark", "light left", "texture",
    "remark",
)  # fmt: skip


@click.command(short_help="The picture without the light's bands, or the bands alone.")
@click.argument("source", metavar="IN", type=FILE_PATH)
@click.argument("target", metavar="OUT", type=FILE_PATH)
@click.option("--keep", type=click.Choice(["picture", "bands"]), default="picture", show_default=True)
@click.option(
    "--model",
    type=click.Choice(["auto", "tone", "chips", "rows"]),
    default="auto",
    show_default=True,
    help="Model of the light; rows: arbitrary.",
)
@click.option(
    "--level",
    type=click.Choice(["full", "mean"]),
    default="full",
    show_default=True,
    help="Level of the steady light: that of the brightest rows, or the mean.",
)
@click.option("--fill", is_flag=True, help="Interpolate pixels that are too dark to restore.")
@click.option("--still", is_flag=True, help="Static scene: clean all frames together.")
@click.option("--each", is_flag=True, help="Clean every frame of a video by itself: slower, nothing is carried on.")
@click.option(
    "--max-gain", type=float, default=8.0, show_default=True, help="Rows that need a larger gain are too dark."
)
@click.option(
    "--toe", type=float, help="Toe of the tone curve, 0 to 1: dim light is stored darker. Default: estimated."
)
@click.option("--marks", type=click.Path(dir_okay=False), help="Picture of the marks: 0, saturated 128, too dark 255.")
@picture_options
@writes("target", "marks")
@json_option
def clean(
    source: str,
    target: str,
    picture: PictureOptions,
    marks: str | None,
    as_json: bool,
    max_gain: float,
    fill: bool,
    toe: float | None,
    each: bool,
    **options: Any,
) -> None:
    """Write IN (a picture, a video, a .npy array, or -) to OUT, restored to steady light.

    OUT is .png, .jpg, .tif, .mkv (FFV1), .mp4 or .npy; with --region it contains the region alone. Saturated pixels are
    unchanged; rows too dark to restore are marked. Each colour has a light of its own where colours differ. The result
    is measured; a frame that cleaning would make worse stays as it is. The last column gives the reason, and bands that
    are left. In a video the light
    is carried from frame to frame; a video written as a video keeps its sound and time stamps.
    """
    from ocisac_fast.cleaning import CleaningOptions

    options["options"] = CleaningOptions(max_gain=max_gain, fill=fill, toe=toe)
    with open_recording(source, colour=picture.channel != "y", raw=picture.raw) as stream:
        cleaner = _Cleaner(picture, marks is not None, stream if stream.kind == "video" and not each else None, options)
        shown = progress(stream, "cleaning", stream.frame_count)
        rate = stream.frame_rate
        frames = cleaner.frames(shown, lambda first: picture.camera_for(stream, first, usual={"PNG": "srgb"}))
        write_frames(target, frames, frame_rate=rate or 30.0, like=stream)
    if marks is not None:
        write_frames(marks, cleaner.marks)
    if as_json:
        for facts in cleaner.facts:
            emit_json(facts)
    else:
        emit_table("", _HEADER, [_row(facts, picture.in_hertz) for facts in cleaner.facts], left=("remark",))
    if not cleaner.facts:
        raise click.ClickException(f"{source}: no frame in it")


class _Cleaner:
    """Cleans frames in stored order; collects the results."""

    def __init__(
        self, picture: PictureOptions, mark: bool, carried: RecordingStream | None, options: dict[str, Any]
    ) -> None:
        """``carried``: the video through which the light is carried from frame to frame."""
        self.facts: list[dict[str, Any]] = []
        self.marks: list[Frame] = []
        self._picture = picture
        self._mark = mark
        self._carried = carried
        self._options = options
        self._video: VideoCleaner | None = None

    def frames(self, stored: Iterable[Frame], camera_of: Any) -> Iterator[Frame]:
        camera: Camera | None = None
        waiting: list[Frame] = []
        for raw in stored:
            camera = camera or camera_of(raw)
            view = select(raw, self._picture)
            if view.dtype.kind == "f" and raw.dtype.kind == "u":  # channel y
                view = np.rint(view).astype(raw.dtype)
            if self._options["still"]:
                waiting.append(view)
                continue
            yield from self._cleaned([view], camera)
        if waiting and camera is not None:
            if any(view.shape != waiting[0].shape for view in waiting):
                raise ValueError("--still: frames of different sizes")
            yield from self._cleaned(waiting, camera)

    def _cleaned(self, views: list[Frame], camera: Camera) -> Iterator[Frame]:
        from ocisac_fast.cleaning import Mark, VideoCleaner, remove_bands

        if self._carried is not None and not self._options["still"]:
            options = {name: value for name, value in self._options.items() if name != "still"}
            self._video = self._video or VideoCleaner(camera, **options)
            number = len(self.facts)
            time = self._carried.time_of(number)
            done = self._video.push(stack(views), time=None if time is None else float(time))
        else:
            done = remove_bands(stack(views), camera, **self._options)
        for k, (frame, marks) in enumerate(zip(done.frames, done.marks, strict=True)):
            self.facts.append(
                self._picture.in_units(
                    {
                        "frame": len(self.facts),
                        "scan_axis": camera.scan_axis,
                        "model": done.model[k],
                        "frequency_hz": float(done.frequency[k]),
                        "share": float(done.share[k].mean()),
                        "toe": float(done.toe[k]),
                        "saturated": float((marks == Mark.SATURATED).mean()),
                        "too_dark": float((marks == Mark.DARK).mean()),
                        "light_left": float(done.light_left[k]),
                        "texture_change_db": float(done.texture_change[k]),
                        "slow_bands": float(done.slow_bands[k]),
                        "unchanged": done.unchanged[k],
                        "remark": done.remarks[k],
                    }
                )
            )
            if self._mark:
                self.marks.append(np.array([0, 128, 255], np.uint8)[marks.max(axis=2)])
            yield np.ascontiguousarray(frame.reshape(views[0].shape))


def _row(facts: dict[str, Any], in_hertz: bool) -> list[str]:
    return [
        str(facts["frame"]),
        facts["model"],
        rate(facts["frequency_hz" if in_hertz else "frequency_cycles_per_row"], None, in_hertz, 5),
        f"{100 * facts['share']:.3g} %",
        f"{facts['toe']:.3g}",
        *(f"{100 * facts[name]:.3g} %" for name in ("saturated", "too_dark", "light_left")),
        number(facts["texture_change_db"], "dB", 2),
        facts["remark"],
    ]
