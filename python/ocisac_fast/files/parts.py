"""Stretches of a long recording that are read by themselves, frame by frame as in the whole."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any

from ocisac_fast.files.recording import FileError, Frame, KeyFrames, Part

_INTRA = 1  # FFmpeg's AV_PICTURE_TYPE_I
_SEEK_BACK = (0, 2, 10)  # seconds; some containers seek by other time stamps than those shown


def every_frame(frame_count: int, max_frames: int) -> KeyFrames | None:
    """Cuts of a recording that can be read from any frame on; None if it is short."""
    return None if frame_count <= max_frames else KeyFrames(list(range(0, frame_count, max_frames)), None, frame_count)


def parts_between(key_frames: KeyFrames, max_frames: int) -> list[Part] | None:
    """Stretches of ``max_frames`` frames or somewhat more; None if there is only one."""
    chosen: list[int] = []  # places in key_frames
    for place, index in enumerate(key_frames.indices):
        if not chosen or index >= key_frames.indices[chosen[-1]] + max_frames:
            chosen.append(place)
    firsts = [key_frames.indices[place] for place in chosen]
    stamps: list[int | None] = [None] * len(chosen)
    if key_frames.stamps is not None:
        stamps = [key_frames.stamps[place] for place in chosen]
    ends = [*zip(firsts, stamps, strict=True), (key_frames.frame_count, None)]
    parts = [Part(first, stop, begin, end) for (first, begin), (stop, end) in pairwise(ends)]
    return parts if len(parts) > 1 else None


def video_key_frames(container: Any, stream: Any, max_frames: int) -> KeyFrames | None:
    """Key frames from the packets of an open video, which is read to its end; None: short, damaged, not to be cut."""
    if 0 < stream.frames <= max_frames or _seconds(container) * float(stream.average_rate or math.inf) <= max_frames:
        return None
    stamps: list[int] = []
    keys: set[int] = set()
    for packet in container.demux(stream):
        if packet.dts is None and packet.size == 0:  # the end
            continue
        if packet.pts is None or packet.is_corrupt or packet.is_discard:
            return None
        stamps.append(packet.pts)
        if packet.is_keyframe:
            keys.add(packet.pts)
    stamps.sort()
    if not stamps or stamps[0] not in keys or len(set(stamps)) < len(stamps):
        return None
    if (0 < stream.frames != len(stamps)) or ends_early(container, stream, len(stamps), stamps[-1] * stream.time_base):
        return None
    indices = [index for index, stamp in enumerate(stamps) if stamp in keys]
    return KeyFrames(indices, [stamps[index] for index in indices], len(stamps))


def ends_early(container: Any, stream: Any, count: int, end: Any) -> bool:
    """Return True if there were fewer frames than the file announces, by their number or else by its duration."""
    if stream.frames:
        return bool(count < stream.frames)
    if container.duration is None or end is None or not stream.average_rate:
        return False
    begin = (container.start_time or 0) * 1e-6
    announced = min(_seconds(container), _own_seconds(stream))  # the file's: of its longest stream, as sound
    return bool(end - begin < announced - 2.5 / float(stream.average_rate))


def _seconds(container: Any) -> float:
    return math.inf if container.duration is None else float(container.duration) * 1e-6


def _own_seconds(stream: Any) -> float:
    """Duration of a stream by its tag in Matroska, "00:00:00.400000000"; infinity without one."""
    try:
        hours, minutes, seconds = stream.metadata.get("DURATION", "").split(":")
        return 3600 * int(hours) + 60 * int(minutes) + float(seconds)
    except ValueError:
        return math.inf


def decoded_part(container: Any, stream: Any, part: Part) -> Iterator[Any]:
    """The decoded frames of a stretch; FileError where they may differ from those of the whole video."""
    count = 0
    for frame in _decoded_from(container, stream, part):
        if frame.is_corrupt or frame.pts is None:
            raise FileError("damaged within a stretch")
        if frame.pts < part.begin:
            continue
        if part.end is not None and frame.pts >= part.end:
            break
        if count == 0 and frame.pts != part.begin:
            raise FileError("a stretch without its first frame")
        yield frame
        count += 1
    require_count(part, count)


def _decoded_from(container: Any, stream: Any, part: Part) -> Iterator[Any]:
    """Frames from an intra-coded key frame at or before the begin of a stretch."""
    if part.first == 0:
        return iter(container.decode(stream))
    for seconds in _SEEK_BACK:
        container.seek(int(part.begin or 0) - round(seconds / stream.time_base), stream=stream)
        frames = iter(container.decode(stream))
        first = next(frames, None)
        if first is not None and first.pts is not None and first.pts <= part.begin:
            if not first.key_frame or int(first.pict_type) != _INTRA:
                break  # refreshed in pieces: decoding is exact from the first frame on only
            return itertools.chain([first], frames)
    raise FileError("no key frame before a stretch")


def require_count(part: Part, count: int) -> None:
    """FileError if a stretch has other frames than announced."""
    if count != part.stop - part.first:
        raise FileError(f"{count} frames in a stretch, its packets announce {part.stop - part.first}")


def counted(part: Part, frames: Iterable[Frame]) -> Iterator[Frame]:
    """Frames of a stretch, with a FileError at the end if there are fewer than announced."""
    count = 0
    for frame in frames:
        yield frame
        count += 1
    require_count(part, count)
