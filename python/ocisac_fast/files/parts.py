"""Stretches of a long recording that are read by themselves, frame by frame as in the whole."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Any

from ocisac_fast.files.extras import call, called, ffmpeg, pyav, steps
from ocisac_fast.files.recording import FileError, Frame, KeyFrames, Part

_INTRA = 1  # FFmpeg's AV_PICTURE_TYPE_I
JPEGS = "mjpeg"  # FFmpeg's container of JPEGs one after the other; it states no time
HEAD_BYTES = 4096
_JPEG_END, _AFTER_JPEG = b"\xff\xd9", 1024  # bytes that may follow it
_SEGMENT = b"\x18\x53\x80\x67"
_PICTURE_HEAD = 16  # bytes: a picture of the same kind and size begins with them
_FRAME_A_PACKET = ("h264", "hevc", "mpeg2video", "mjpeg", "ffv1")  # unlike VP8, which has frames that are not shown
_UNBOUNDED, _MOST_HELD = ("h264", "mpegts", "nut"), 256  # kinds whose last packet may be cut; packets
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


def video_key_frames(container: Any, stream: Any, ending: Ending, max_frames: int) -> KeyFrames | None:
    """Key frames from the packets of an open video, which is read to its end; None: short, damaged, not to be cut."""
    if 0 < stream.frames <= max_frames or _seconds(container) * float(stream.average_rate or math.inf) <= max_frames:
        return None
    stamps: list[int] = []
    keys: set[int] = set()
    try:
        for packet in ending.packets():
            if packet.dts is None and packet.size == 0:  # the end
                continue
            if packet.pts is None or packet.is_corrupt or packet.is_discard:
                return None
            stamps.append(packet.pts)
            if packet.is_keyframe:
                keys.add(packet.pts)
    except pyav().FFmpegError:  # which reading the whole names
        return None
    stamps.sort()
    if not stamps or stamps[0] not in keys or len(set(stamps)) < len(stamps):
        return None
    if (0 < stream.frames != len(stamps)) or ending.is_early(len(stamps), stamps[-1] * stream.time_base):
        return None
    indices = [index for index, stamp in enumerate(stamps) if stamp in keys]
    return KeyFrames(indices, [stamps[index] for index in indices], len(stamps))


class Ending:
    """The packets of a video to its end, and whether that is the end that was written.

    A container says that a packet is cut where it states sizes (AVI, MP4, FLV). Else the bytes of the file are compared
    with the size of Matroska's segment, of a frame of Y4M and of a packet of a transport stream, and the number of
    frames with that of packets. Only HEVC without a container can be cut in its last frame unnoticed.
    """

    def __init__(self, container: Any, stream: Any, file: Any) -> None:
        """``file``: the `FirstFilm` that the container reads, of a file or of a `Prefixed`."""
        self._container, self._stream, self._file = container, stream, file
        self._codec = stream.codec_context.codec.name
        self._packets = self._frames = self._cut = self._end = 0
        self._has_marks = False  # the JPEGs end as they should
        self._has_another_picture = False

    def packets(self) -> Iterator[Any]:
        """All packets, in the order of decoding."""
        with ffmpeg():
            for packet in steps(self._container.demux(self._stream)):
                self._end = max(self._end, (packet.pos or 0) + packet.size)
                if self.kind == "picture":  # to the end of the file
                    self._has_another_picture |= bytes(packet).count(bytes(packet)[:_PICTURE_HEAD]) > 1
                self._cut += call.is_endless()
                yield packet

    def decoded(self) -> Iterator[Any]:
        """The frames, in the order of display, of the packets that are whole."""
        packets = self.packets()
        is_unbounded = self._codec == "h264" and self._container.format.name in _UNBOUNDED
        for packet in self._without_cut_end(packets) if is_unbounded and self._file.seekable() else packets:
            if packet.size and not self._is_whole(packet):
                self._cut += 1
                continue
            self._packets += packet.size > 0 and not packet.is_discard
            for frame in packet.decode():
                self._frames += 1
                yield frame

    def _without_cut_end(self, packets: Iterator[Any]) -> Iterator[Any]:
        """The packets, a group of pictures later, less the last one if its frame has errors.

        Of H.264 the decoder notices them, but several threads may give a frame before.
        """
        held: list[Any] = []
        for packet in packets:
            if packet.is_keyframe or len(held) == _MOST_HELD:
                yield from held
                held = []
            if packet.size:
                held.append(packet)
        if held and not self._ends_whole(held):
            self._cut += 1
            held.pop()
        yield from held
        yield packet  # which ends the decoding

    def _ends_whole(self, packets: list[Any]) -> bool:
        """Decode packets again, by one thread: the last one's frame is there, without an error."""
        if not packets[0].is_keyframe:  # too long a group
            return True
        context = self._stream.codec_context.codec.create()
        context.extradata, context.thread_count = self._stream.codec_context.extradata, 1
        stamps = [packet.pts for packet in packets]
        good = set()
        for k, packet in enumerate([*packets, None]):
            if packet is not None:
                packet.pts = k
            good |= {frame.pts for frame in context.decode(packet) if not frame.is_corrupt}
        for packet, stamp in zip(packets, stamps, strict=True):
            packet.pts = stamp
        return len(packets) - 1 in good

    def _is_whole(self, packet: Any) -> bool:
        if packet.is_corrupt or self._container.format.name != JPEGS:
            return not packet.is_corrupt
        ends = _JPEG_END in bytes(memoryview(packet)[-_AFTER_JPEG:])
        self._has_marks |= ends
        return ends or not self._has_marks

    def is_early(self, count: int, end: Any) -> bool:
        """Return True if frames are missing after ``count`` of them, the last one at ``end``, s."""
        if self.has_another_film or self._cut or (self._codec in _FRAME_A_PACKET and self._frames < self._packets):
            return True
        if self._stream.frames:
            return bool(count < self._stream.frames)
        return self._is_file_cut() or self._is_short(end)

    @property
    def has_another_film(self) -> bool:
        """True if a further film or picture follows, which is left out."""
        return self._has_another_picture or bool(self._file.is_followed)

    @property
    def kind(self) -> str:
        """``"picture"`` or ``"film"``."""
        return "picture" if self._container.format.name.endswith("_pipe") else "film"

    def _is_file_cut(self) -> bool:
        kind, head = self._container.format.name, self._head()
        if kind == "matroska,webm":
            announced = _segment_end(head)
            return announced is not None and self._size(announced) < announced
        if kind == "mpegts" and b"G" in (head[:1], head[4:5]):  # a time stamp before each packet, of a disc or camera
            return self._size() % (188 if head[:1] == b"G" else 192) > 0
        return kind == "yuv4mpegpipe" and self._size() > self._end

    def _head(self) -> bytes:
        return bytes(self._at(0, os.SEEK_SET, self._file.read) if self._file.seekable() else self._file.first)

    def _size(self, wanted: int = 0) -> int:
        """Bytes of the file; of a pipe those read, up to ``wanted`` if it has more than the container has taken."""
        if self._file.seekable():
            return int(self._at(0, os.SEEK_END, lambda _: self._file.tell()))
        while self._file.count < wanted and self._file.read(HEAD_BYTES):
            pass
        return int(self._file.count)

    def _at(self, offset: int, whence: int, found: Callable[[int], Any]) -> Any:
        place = self._file.tell()
        try:
            self._file.seek(offset, whence)
            return found(HEAD_BYTES)
        finally:
            self._file.seek(place)

    def _is_short(self, end: Any) -> bool:
        """By the duration that the file states."""
        if self._container.duration is None or end is None or not self._stream.average_rate:
            return False
        begin = (self._container.start_time or 0) * 1e-6
        # The file's duration is that of its longest stream, such as sound.
        announced = min(_seconds(self._container), _own_seconds(self._stream))
        return bool(end - begin < announced - 2.5 / float(self._stream.average_rate))


def _segment_end(head: bytes) -> int | None:
    """Where the segment of a Matroska file ends (RFC 8794, 9559); None: not stated, as in a live stream."""
    at = head.find(_SEGMENT) + len(_SEGMENT)
    if at < len(_SEGMENT) or at >= len(head) or head[at] == 0:
        return None
    length = 9 - head[at].bit_length()
    value = int.from_bytes(head[at : at + length], "big") - (1 << 7 * length)  # less the mark of the length
    return None if value == (1 << 7 * length) - 1 else at + length + value


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
        return steps(container.decode(stream))
    for seconds in _SEEK_BACK:
        called(container.seek, int(part.begin or 0) - round(seconds / stream.time_base), stream=stream)
        frames = steps(container.decode(stream))
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
