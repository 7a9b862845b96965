"""``ocisac clean``."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from typing import Annotated, Any, Literal

import click
import numpy as np

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning import CleanedFrames, CleaningOptions, Mark, VideoCleaner, remove_bands
from ocisac_fast.cli.command import command
from ocisac_fast.cli.errors import SOME_FAILED
from ocisac_fast.cli.output import emit_json, emit_summary, emit_table, number, progress, rate
from ocisac_fast.cli.outputs import INPUT, OUTPUT
from ocisac_fast.cli.pictures import PictureOptions, cropped, frames_of, select, stack
from ocisac_fast.files import open_recording, write_frames
from ocisac_fast.files.recording import KEPT_FRAMES, Frame, RecordingStream
from ocisac_fast.files.video_writing import USUAL_CRF
from ocisac_fast.files.writing import most_frames

_LOSSY = ("h264", "hevc")
_WAITING = KEPT_FRAMES - 1  # unchanged frames that wait for what the next ones show
_HEADER = (
    "frame", "light", "frequency or chip rate", "share", "toe", "saturated", "too dark", "light left", "texture",
    "remark",
)  # fmt: skip


@command
def clean(
    source: Annotated[str, INPUT, {"metavar": "IN"}],
    target: Annotated[str, OUTPUT, {"metavar": "OUT"}],
    *,
    keep: Annotated[Literal["picture", "bands"], "What OUT shows."] = "picture",
    model: Annotated[Literal["auto", "tone", "chips", "rows"], "Model of the light; rows: arbitrary."] = "auto",
    level: Annotated[
        Literal["auto", "full", "mean"],
        "Level of the steady light: that of the brightest rows, or the mean; auto: the mean of a tone, else full.",
    ] = "auto",
    fill: Annotated[bool, "Interpolate pixels that are too dark to restore."] = False,
    still: Annotated[bool, "Static scene: clean all frames together."] = False,
    each: Annotated[bool, "Clean every frame by itself: slower, nothing is carried on."] = False,
    max_gain: Annotated[float, "Rows that need a larger gain are too dark."] = 8.0,
    toe: Annotated[
        float | None, "Toe of the tone curve, 0 to 1: dim light is stored darker. Default: estimated."
    ] = None,
    crf: Annotated[float | None, click.FloatRange(0, 51), f"Quality of H.264 and HEVC; default: {USUAL_CRF:g}."] = None,
    keep_partial: Annotated[bool, "After Ctrl-C keep OUT with the frames done, instead of nothing."] = False,
    marks: Annotated[str | None, OUTPUT, "Picture of the marks: 0, saturated 128, too dark 255."] = None,
    picture: PictureOptions,
    as_json: bool,
) -> None:
    """Write IN (a picture, a video, a .npy array, or -) to OUT, restored to steady light.

    OUT is .png, .jpg, .tif, .mkv, .mp4, .mov or .npy; with --region it contains the region alone. Saturated pixels are
    unchanged; rows too dark to restore are marked. Each colour has a light of its own where colours differ. The result
    is measured; a frame that cleaning would make worse stays as it is, and where that is so for every frame, OUT is not
    written (an older one stays, and the exit code is 3, else 0). The last column gives the reason, and bands that are
    left. The light is carried from frame to frame; a video written as a video keeps its sound, time stamps and turn for
    display, and HEVC stays HEVC.
    """
    options: dict[str, Any] = {"keep": keep, "model": model, "level": level, "still": still}
    options["options"] = CleaningOptions(max_gain=max_gain, fill=fill, toe=toe)
    with (
        frames_of(source),
        open_recording(source, colour=picture.channel != "y", raw=picture.raw) as stream,
        _stopping(keep_partial) as stop,
    ):
        if picture.frame_rate is not None:
            stream.frame_rate = float(picture.frame_rate)
            picture = dataclasses.replace(picture, frame_rate=None)  # the stream's camera has it
        is_carried = not each and not still and stream.frame_count not in (1, 2)
        cleaner = _Cleaner(picture, stream, is_carried, marks is not None, options, stop, as_json)
        most = math.inf if marks is None else most_frames(marks)
        frames = cleaner.frames(_at_most(most, progress(stream, "cleaning", stream.frame_count)))
        if crf is None and picture.channel == "auto" and stream.video is not None and stream.video.codec in _LOSSY:
            crf = USUAL_CRF
        with contextlib.suppress(_Unchanged):
            write_frames(target, frames, frame_rate=stream.frame_rate or 30.0, like=stream, crf=crf)
    if not cleaner.facts and stop:
        signal.raise_signal(stop[0])
    if marks is not None:
        write_frames(marks, cleaner.marks)
    if cleaner.lost is not None:
        raise cleaner.lost
    if not cleaner.facts:
        raise click.ClickException(f"{source}: no frame in it")
    if not as_json:
        rows = [_row(facts, picture.in_hertz) for facts in cleaner.facts]
        emit_table("", _HEADER, rows, left=("remark",), spare=("toe", "saturated", "too dark"))
    if cleaner.reasons or len(cleaner.facts) > 1:
        emit_summary(cleaner.summary(target), as_json)
    if stop:
        signal.raise_signal(stop[0])  # whose handler is the usual one again
    if cleaner.is_source and os.path.isfile(target):
        raise click.exceptions.Exit(SOME_FAILED)


def _at_most(most: float, frames: Iterable[Frame]) -> Iterator[Frame]:
    for count, frame in enumerate(frames):
        if count == most:  # before the others are cleaned
            raise click.UsageError("--marks: got a picture of one frame, allowed: .tif, .mkv or .npy for several")
        yield frame


class _Unchanged(Exception):
    """No frame was changed: there is nothing to write."""


@contextlib.contextmanager
def _stopping(keep_partial: bool) -> Iterator[_Signals]:
    """With ``keep_partial`` Ctrl-C, SIGTERM and SIGHUP wait until a frame is done."""
    asked = _Signals()
    before = {}
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if keep_partial else ():
            before[number] = signal.signal(number, asked.note)
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Stopped(BaseException):
    """A signal came while a frame was read."""


class _Signals(list[int]):
    """The numbers of those that came: they interrupt reading, which may wait for ever, and nothing else."""

    _is_reading = False

    def note(self, number: int, _: Any) -> None:
        self.append(number)
        if self._is_reading:
            self._is_reading = False
            raise _Stopped

    def read(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """The frames before a signal."""
        ahead = iter(frames)
        with contextlib.suppress(_Stopped):
            while True:
                self._is_reading = True
                frame = None if self else next(ahead, None)
                self._is_reading = False
                if frame is None:
                    break
                yield frame


@dataclasses.dataclass
class _Cleaner:
    """Cleans frames in stored order; collects the results."""

    _picture: PictureOptions
    _stream: RecordingStream
    _is_carried: bool  # the light, from frame to frame
    _mark: bool
    _options: dict[str, Any]
    _stop: _Signals
    _as_json: bool
    facts: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    marks: list[Frame] = dataclasses.field(default_factory=list)
    reasons: Counter[str] = dataclasses.field(default_factory=Counter)
    lost: OSError | None = None  # lines of JSON
    _video: VideoCleaner | None = None
    _read: int = 0
    _unsure: list[tuple[int, Frame, CleanedFrames]] = dataclasses.field(default_factory=list)
    _is_lit: bool = False  # a frame was cleaned
    _first: tuple[Frame, CleanedFrames] | None = None  # that one, which waits for the next

    def frames(self, stored: Iterable[Frame]) -> Iterator[Frame]:
        camera: Camera | None = None
        waiting: list[Frame] = []
        for raw in self._stop.read(stored):
            form, region = self._stream.picture, self._picture.region
            if form is not None and region is not None and form.alphas[-1] is not None:
                form.alphas[-1] = cropped(form.alphas[-1], region)
            camera = camera or self._picture.camera_for(self._stream, raw, usual={"PNG": "srgb"})
            view = select(raw, self._picture)
            if view.dtype.kind == "f" and raw.dtype.kind == "u":  # channel y
                view = np.rint(view).astype(raw.dtype)
            if self._options["still"]:
                waiting.append(view)
                continue
            yield from self._carried(view, camera) if self._is_carried else self._together([view], camera)
        if self._stop and not self.facts:
            raise _Unchanged
        if camera is not None:
            if self._first is not None:
                yield from self._results([self._first[0]], self._first[1], camera)
            yield from self._decided(camera)
        if waiting and camera is not None:
            yield from self._together(waiting, camera)
        if self.is_source:
            raise _Unchanged

    @property
    def is_source(self) -> bool:
        """True if the result is the whole source as it was."""
        whole = self._picture.region is None and self._picture.channel == "auto" and self._options["keep"] == "picture"
        return whole and 0 < self.reasons.total() == len(self.facts)

    def summary(self, target: str) -> str:
        """The number of cleaned frames, and why others are unchanged."""
        count, unchanged = len(self.facts), self.reasons.total()
        text = f"cleaned {count - unchanged} of {count} frame{'s' * (count > 1)}"
        text += "".join(f", {number} unchanged: {reason}" for reason, number in self.reasons.most_common())
        before = ", and holds what it held before" * os.path.isfile(target)
        return f"{text}; {target} is not written{before}" if self.is_source else text

    def _carried(self, view: Frame, camera: Camera) -> Iterator[Frame]:
        """The next frame of a film; unchanged ones wait for some frames, which may show a slow light."""
        options = {name: value for name, value in self._options.items() if name != "still"}
        video = self._video = self._video or VideoCleaner(camera, **options)
        time, rate = self._stream.time_of(self._read), self._stream.frame_rate
        place = self._read if time is None or not rate else round(time * Fraction(rate))
        self._read += 1
        done = video.push(stack([view]), time=None if time is None else float(time))
        if self._first is not None:  # one picture does not show that its bands are lines
            (first, alone), self._first = self._first, None
            yield from self._results(
                [first], done if done.unchanged[0].endswith("lines of the picture") else alone, camera
            )
        if done.unchanged[0]:
            if len(self._unsure) == _WAITING:
                _, first, rejected = self._unsure.pop(0)
                yield from self._results([first], rejected, camera)
            self._unsure.append((place, view, done))
            return
        yield from self._decided(camera, lambda then, before: video.again(stack([before]), place - then))
        if self._is_lit:
            yield from self._results([view], done, camera)
        else:
            self._is_lit, self._first = True, (view, done)

    def _decided(self, camera: Camera, again: Callable[[int, Frame], CleanedFrames] | None = None) -> Iterator[Frame]:
        """The frames that wait; ``again`` cleans them, by their places, under what a later one has shown."""
        unsure, self._unsure = self._unsure, []
        for place, view, rejected in unsure:
            done = again(place, view) if again is not None else rejected
            yield from self._results([view], rejected if done.unchanged[0] else done, camera)

    def _together(self, views: list[Frame], camera: Camera) -> Iterator[Frame]:
        yield from self._results(views, remove_bands(stack(views), camera, **self._options), camera)

    def _results(self, views: list[Frame], done: CleanedFrames, camera: Camera) -> Iterator[Frame]:
        for k, (frame, marks) in enumerate(zip(done.frames, done.marks, strict=True)):
            facts = self._picture.in_units(
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
            self.facts.append(facts)
            if self._mark:
                self.marks.append(np.array([0, 128, 255], np.uint8)[marks.max(axis=2)])
            if done.unchanged[k]:
                self.reasons[done.unchanged[k]] += 1
            as_decoded = done.unchanged[k] and self._options["keep"] == "picture"
            yield views[k] if as_decoded else np.ascontiguousarray(frame.reshape(views[0].shape))
            if self._as_json:
                try:
                    emit_json(facts)
                except OSError as error:  # nobody reads the lines, or a disk is full: OUT is written nevertheless
                    self.lost = error


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
