"""Writing of videos, frame by frame; a processed copy of a video keeps its sound, colours and time stamps."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from ocisac_fast.files.colours import Conversion
from ocisac_fast.files.extras import NO_THREAD, ffmpeg, opened_video, pyav, steps
from ocisac_fast.files.profiles import transfer_stating
from ocisac_fast.files.recording import FileError, FileWarning, Frame, LightResponse, RecordingStream, VideoFormat

CODECS = {".mkv": "ffv1", ".mp4": "libx264", ".mov": "libx264"}
USUAL_CRF = 10.0  # no difference can be seen
_LIMITED_RANGE, _FULL_RANGE, _RGB_MATRIX = 1, 2, 0
_SUBSAMPLED = ("yuv420p", "yuv422p", "yuv444p", "yuvj420p", "yuvj422p", "yuvj444p")
_DEEP = ("yuv420p10le", "yuv422p10le", "yuv444p10le")
_DEEPER = ("yuv420p12le", "yuv422p12le", "yuv444p12le")  # HEVC
_FILE_TAGS = ("major_brand", "minor_version", "compatible_brands", "encoder", "duration", "vendor_id")


def write_video(
    path: Path, frames: Iterable[Frame], frame_rate: float, like: RecordingStream | None, crf: float | None
) -> None:
    """Write one frame at a time. Without a video as ``like`` the stream states full range and the curve of ``like``, or
    linear transfer."""
    av = pyav()
    if not 0 < frame_rate < float("inf"):
        raise FileError(f"frame_rate: got {frame_rate}, allowed: above 0")
    if crf is not None and not 0 <= crf <= 51:
        raise FileError(f"crf: got {crf}, allowed: 0 to 51")
    source = None if like is None else like.video
    transfer = transfer_stating(LightResponse() if like is None else like.response)  # of what is no video
    suffix = path.suffix.lower()
    codec = CODECS[suffix]
    if source is not None and (codec != "ffv1" or crf is not None):
        codec = "libx265" if source.codec == "hevc" else "libx264"
    # Matroska's numbers are random unless bits are to be the same; an index in front can be read from a pipe.
    options = {"fflags": "+bitexact"} if suffix == ".mkv" else {"movflags": "+faststart"}
    with av.open(str(path), "w", options=options) as container, contextlib.ExitStack() as opened:
        writer: _Writer | None = None
        sound: Iterator[Any] = iter(())
        for count, raw in enumerate(frames):
            frame = np.asarray(raw)
            if writer is None:
                writer = _Writer(container, codec, frame, frame_rate, source, crf, transfer)
                sound = _sound(av, container, like, opened)
            writer.check(frame, count)
            time = None if like is None else like.time_of(count)
            try:
                with ffmpeg():
                    picture = writer.picture(frame, count, time)
                    packets = writer.stream.encode(picture)
            except av.FFmpegError as error:
                rows, columns = frame.shape[:2]
                lack = f", or {NO_THREAD}" if isinstance(error, av.ExternalError) else ""  # which x264 does not tell
                raise FileError(f"{codec} cannot hold frames of {columns} x {rows} pixels{lack}") from error
            container.mux(packets)
            _copy_until(container, sound, float(picture.pts * writer.time_base))
        if writer is None:
            raise FileError("frames: no frame to write")
        container.mux(writer.stream.encode(None))
        if like is None or next(iter(like), None) is None:  # else these were the first of its frames
            _copy_until(container, sound, float("inf"))


class _Writer:
    """The video stream of a container."""

    def __init__(
        self,
        container: Any,
        codec: str,
        first: Frame,
        frame_rate: float,
        source: VideoFormat | None,
        crf: float | None,
        transfer: int,
    ) -> None:
        check_frame(first, (np.uint8, np.uint16) if codec == "ffv1" or source is not None else (np.uint8,))
        self._shape, self._dtype, self._source = first.shape, first.dtype, source
        self._array_format, stored = _formats(codec, first, source)
        rate = Fraction(frame_rate).limit_denominator(100_000)
        self.stream = container.add_stream(codec, rate=rate, options=_options(codec, first, crf))
        self.stream.height, self.stream.width = first.shape[:2]
        self.stream.pix_fmt = stored
        self.time_base = 1 / rate if source is None else source.time_base
        self._rate, self._last = rate, -1
        context = self.stream.codec_context
        context.time_base = self.time_base
        is_converted = stored.startswith("yuv")
        is_luma = first.ndim == 2 or is_converted
        self._range = _LIMITED_RANGE if source is not None and source.limited and is_luma else _FULL_RANGE
        context.color_range = self._range
        context.color_trc = transfer if source is None else source.transfer
        self._convert: Conversion | None = None
        if codec == "libx265" and container.format.name in ("mp4", "mov"):
            context.codec_tag = "hvc1"  # without it Apple's players refuse the film
        if source is not None:
            context.color_primaries = source.primaries
            context.colorspace = self._matrix = source.matrix if is_converted or first.ndim == 2 else _RGB_MATRIX
            if is_converted:
                self._convert = Conversion(stored, source.matrix, self._range == _LIMITED_RANGE)
            self._keep_shape(source)

    def _keep_shape(self, source: VideoFormat) -> None:
        """The shape of pixels, and the turn for display."""
        if source.pixel_aspect is not None:
            self.stream.codec_context.sample_aspect_ratio = source.pixel_aspect
        if source.display_matrix is not None:
            if hasattr(self.stream, "set_display_matrix"):
                self.stream.set_display_matrix(source.display_matrix)
            else:
                message = "the turn for display is lost, allowed: PyAV 18 or later, which can write it"
                warnings.warn(message, FileWarning, stacklevel=2)

    def check(self, frame: Frame, count: int) -> None:
        if frame.shape != self._shape or frame.dtype != self._dtype:
            raise FileError(f"frame {count} is {frame.dtype} {frame.shape} after frames of {self._dtype} {self._shape}")

    def picture(self, frame: Frame, count: int, time: Fraction | None) -> Any:
        """The frame, converted to the stream's format, with its time stamp; a frame of the source as it was decoded."""
        decoded = () if self._source is None else self._source.decoded
        picture = next((picture for values, picture in decoded if values is frame), None)
        if picture is not None and picture.format.name == self.stream.pix_fmt:
            picture.pict_type = 0  # the encoder chooses
        else:
            picture = pyav().VideoFrame.from_ndarray(np.ascontiguousarray(frame), format=self._array_format)
            if self._convert is not None:
                picture = self._convert(picture)
                picture.colorspace = self._matrix
            picture.color_range = self._range
        at = Fraction(count) / self._rate if time is None else time
        picture.pts = self._last = max(round(at / self.time_base), self._last + 1)
        picture.time_base = self.time_base
        return picture


def _formats(codec: str, frame: Frame, source: VideoFormat | None) -> tuple[str, str]:
    """Pixel formats of the frame's values and of the stream."""
    deep = frame.dtype == np.uint16
    if frame.ndim == 2:
        grey = "gray16le" if deep else "gray"
        if codec != "ffv1" and deep:
            raise FileError("frames of uint16, this kind of file holds uint8 (use .mkv or .npy)")
        return grey, grey
    if codec == "ffv1":
        return ("gbrp16le", "gbrp16le") if deep else ("rgb24", "bgr0")  # FFV1's own order
    if source is None:
        raise FileError("colour frames (use .mkv or .npy)")
    kept = (*_DEEP, *(_DEEPER if codec == "libx265" else ())) if deep else _SUBSAMPLED
    odd = frame.shape[0] % 2 or frame.shape[1] % 2
    stored = source.pixel_format if source.pixel_format in kept and not odd else kept[2 if odd else 0]
    return "rgb48le" if deep else "rgb24", stored


def _options(codec: str, frame: Frame, crf: float | None) -> dict[str, str]:
    """Options of the encoder; grey without a crf is lossless."""
    if codec == "ffv1":
        return {}
    lossless = crf is None and frame.ndim == 2
    quality = {"crf": f"{USUAL_CRF if crf is None else crf:g}"}
    if codec == "libx265":
        return {"preset": "veryfast", "x265-params": f"log-level=error:lossless={lossless:d}", **quality}
    return {"preset": "veryfast", **({"qp": "0"} if lossless else quality)}


def _sound(av: Any, container: Any, like: RecordingStream | None, opened: contextlib.ExitStack) -> Iterator[Any]:
    """Add the sound's streams of the video to the container, and its tags; returns their packets, which are copied."""
    if like is None or like.video is None:
        return iter(())
    if like.video.path is None:
        if like.video.has_sound:
            warnings.warn("the sound of a pipe is left out, allowed: a file", FileWarning, stacklevel=2)
        return iter(())
    path = like.video.path
    original = opened.enter_context(opened_video(opened.enter_context(_again(like.video))))
    for ours, theirs in ((container, original), (container.streams.video[0], original.streams.best("video"))):
        ours.metadata.update(_tags(theirs))
    copies = {}
    for audio in original.streams.audio:
        codec = audio.codec_context.codec
        name = getattr(codec, "canonical_name", codec.name)
        if name not in container.supported_codecs:
            warnings.warn(
                f"{path}: sound of {name} left out, this kind of file cannot hold it", FileWarning, stacklevel=2
            )
            continue
        if hasattr(container, "add_stream_from_template"):
            copies[audio.index] = container.add_stream_from_template(audio)
        else:  # PyAV before 14
            copies[audio.index] = container.add_stream(template=audio)
        copies[audio.index].metadata.update(_tags(audio))
    return _copied(original, copies)


def _tags(of: Any) -> dict[str, str]:
    """Tags of a container or a stream (title, language) but for those of the file itself."""
    return {name: text for name, text in of.metadata.items() if name.lower() not in _FILE_TAGS}


def _again(video: VideoFormat) -> Any:
    """The file of a video, opened once more.

    Raises:
        FileError: another file, or a pipe, has its name now.
    """
    if video.status is None:
        return video.path.open("rb")
    file = os.open(video.path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    if not os.path.samestat(os.fstat(file), video.status):
        os.close(file)
        raise FileError(f"{video.path}: replaced while it was read")
    return os.fdopen(file, "rb")


def _copied(original: Any, copies: dict[int, Any]) -> Iterator[Any]:
    for packet in steps(original.demux([original.streams[index] for index in copies])) if copies else ():
        if packet.dts is not None:
            packet.stream = copies[packet.stream.index]
            yield packet


def _copy_until(container: Any, packets: Iterator[Any], time: float) -> None:
    """Copy packets to the first after ``time``, s."""
    for packet in packets:
        container.mux(packet)
        if float(packet.dts * packet.time_base) > time:
            return


def check_frame(frame: Frame, dtypes: tuple[type, ...]) -> None:
    """Reject a type or shape that a kind of file cannot hold."""
    if frame.dtype not in dtypes:
        names = ", ".join(np.dtype(dtype).name for dtype in dtypes)
        raise FileError(f"frames of {frame.dtype}, this kind of file holds {names}")
    if frame.ndim not in (2, 3) or (frame.ndim == 3 and frame.shape[2] != 3) or frame.size == 0:
        raise FileError(f"frame of shape {frame.shape}, allowed: (rows, columns) or (rows, columns, 3)")
