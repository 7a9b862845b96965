"""Pictures: PNG, JPEG, TIFF, PNM, BMP, WebP, with all stored bits and without colour management.

Pillow reads them. It reduces 16-bit colour to 8 bits; FFmpeg (PyAV) decodes those pictures.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ocisac_fast.files import films
from ocisac_fast.files.extras import ffmpeg, opened_video, pillow, pyav, steps
from ocisac_fast.files.profiles import response_of_picture
from ocisac_fast.files.raw import read_whole
from ocisac_fast.files.recording import FileError, Frame, LightResponse, PictureFormat, RecordingStream

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS = ("PNG", "JPEG", "TIFF", "PPM", "BMP", "WEBP")
_OF_FRAMES = ("PNG", "TIFF", "WEBP")  # that may hold several; further ones of a JPEG are previews
_PNM_HEADER = re.compile(rb"P([56])" + rb"(?:\s|#[^\n]*\n)+(\d{1,9})" * 3 + rb"\s")
JPEG = b"\xff\xd8\xff"
_PNG_END = b"IEND\xaeB`\x82"
_MARKER = re.compile(rb"\xff([\xc0-\xcf\xd9-\xfe])")  # of a JPEG; compressed data contains none of these
_PADDING = re.compile(rb"[\0\s]*(?:\xff+(?=[\0\s\xff])[\0\s]*)*")  # between the JPEGs of a camera
_OWN_PICTURES = re.compile(rb"MPF\0|ns\.google\.com/photos")  # previews, depths and gain maps of the same photograph
_BEGINNING = re.compile(
    rb"\xff\xd8\xff(?:[\xc0-\xdf\xfe]\0|[\xe0-\xef]..\w\w)|\x89PNG\r\n\x1a\n|RIFF....WEBP"
    rb"|(?<!Exif\0\0)(?<!Nikon\0....)(?:II[*+]\0|MM\0[*+])|BM....\0\0\0\0....[\x0c-\x7c]\0\0\0"
    rb"|P[1-6]\s+(?:#[^\n]{0,99}\n\s*){0,4}\d+\s+\d+\s"  # bounded: each "P1 #" may begin a comment up to the end
    rb"|(?P<film>" + films.BEGINNING + rb")",
    re.DOTALL,
)
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_PIECES = ((273, 279), (324, 325))  # offsets and sizes of strips, of tiles
_TIFF_BITS_PER_SAMPLE, _TIFF_PHOTOMETRIC, _TIFF_SAMPLE_FORMAT = 258, 262, 339
_BAND_PIXELS = 1 << 20
_MOST_BYTES, _MOST_TIFF_BYTES = 1 << 30, 4 << 30
ORIENTATION = 0x0112  # EXIF
_LUMA = np.array([299, 587, 114])  # thousandths, ITU-R BT.601: exact for integers
_STORED = {2: "FLIP_LEFT_RIGHT", 3: "ROTATE_180", 4: "FLIP_TOP_BOTTOM", 5: "TRANSPOSE", 6: "ROTATE_90", 7: "TRANSVERSE"}
_STORED[8] = "ROTATE_270"
_KEPT_CHUNKS = (b"cHRM", b"cICP", b"gAMA", b"iCCP", b"sRGB", b"pHYs", b"eXIf")


def is_picture(head: bytes) -> bool:
    """Return True if a file that begins with these bytes (12 or more) is a picture of a supported kind."""
    starts = (b"\x89PNG\r\n", JPEG, *TIFF, b"BM")
    return (
        head.startswith(starts)
        or (head[:1] == b"P" and head[1:2] in b"123456" and head[2:3] in b" \t\r\n#")
        or (head[:4] == b"RIFF" and head[8:12] == b"WEBP")
    )


def most_bytes(head: bytes) -> int:
    """The most bytes of a picture that begins with ``head``; a TIFF may have many pages."""
    return _MOST_TIFF_BYTES if head.startswith((b"II", b"MM")) else _MOST_BYTES


def next_jpeg(data: bytes | bytearray, at: int = 2, is_whole: bool = False) -> tuple[int, bool, bool]:
    """Where to go on in a JPEG as it arrives, whether that is behind its end, whether a further one begins there."""
    while not is_whole and (found := _MARKER.search(data, at)):
        at, is_whole = found.end(), found[1] == b"\xd9"
        size = 0 if is_whole else int.from_bytes(data[at : at + 2], "big")  # of a segment, such as EXIF
        if not is_whole and at + size + 1 >= len(data):
            return found.start(), False, False
        at += size
    if not is_whole or (padding := _PADDING.match(data, at)) is None:
        return max(at, len(data) - 1), False, False
    at = padding.end()
    return at, True, data.startswith(JPEG, at) and not _OWN_PICTURES.search(data, 0, at)


def are_jpegs(data: bytes) -> bool:
    """Return True if JPEGs follow each other; a smaller one is a preview of the first."""
    second, _, follows = next_jpeg(data)
    if not follows:
        return False
    with _refusals():
        first, other = (pillow().open(io.BytesIO(data[begin:]), formats=("JPEG",)).size for begin in (0, second))
    return any(other[k] >= first[k] for k in (0, 1))


def grey_levels(path: Path, max_pixels: int) -> Frame:
    """Return the first picture of a file as (rows, columns), stored values scaled to 0 to 1; colour as luma.

    Raises:
        FileError: no such picture, or more than ``max_pixels``.
    """
    with path.open("rb") as file:
        data = read_whole(file, _MOST_BYTES)
    with _refusals(), pillow().open(io.BytesIO(data), formats=FORMATS) as image:
        if image.width * image.height > max_pixels:
            raise FileError(f"picture of {image.width} x {image.height}, allowed: at most {max_pixels} pixels")
    with contextlib.closing(open_picture(data)) as stream:
        frame, response = next(iter(stream)), stream.response
    white = response.white_level or (1.0 if frame.dtype.kind == "f" else np.iinfo(frame.dtype).max)
    grey: Frame = frame if frame.ndim == 2 else frame @ _LUMA / 1000
    return (grey - response.dark_level) / (white - response.dark_level)


def open_picture(data: bytes) -> RecordingStream:
    """Open a picture as one frame; pages of TIFF and pictures of an animated PNG or WebP as frames, as shown."""
    if data[:2] in (b"P5", b"P6"):
        frames, response = _binary_pnm(data)
        return RecordingStream.of_array(frames, "picture", response)
    if data[:4] == b"\x89PNG" and b"IEND" not in data:
        raise FileError("truncated: PNG without its end")
    with _refusals():
        image = pillow().open(io.BytesIO(data), formats=FORMATS)
        form = _format(image, data)
        samples = _samples(image, data)
        response = response_of_picture(image, form.chunks, *samples)
        pages = getattr(image, "n_frames", 1) if image.format in _OF_FRAMES else 1
        _require_single(data, _end(image, data, pages))
        image.seek(0)
    decoded = _frames(image, data, pages, samples, form.alphas)
    return RecordingStream(decoded, "picture", response, frame_count=pages, close=image.close, picture=form)


def _format(image: Image, data: bytes) -> PictureFormat:
    exif, orientation = image.getexif(), image.getexif().get(ORIENTATION)
    if image.format == "TIFF":  # its other tags tell where this file holds its pixels
        exif = pillow().Exif()
        exif.update({} if orientation is None else {ORIENTATION: orientation})
    options = {"icc_profile": image.info.get("icc_profile"), "exif": exif.tobytes() if exif else None}
    kept = {name: value for name, value in options.items() if value}
    return PictureFormat(orientation, kept, _kept_chunks(data) if image.format == "PNG" else b"", [])


def _kept_chunks(png: bytes) -> bytes:
    """Chunks before the pixels that hold for other pixels as well: of each kind the last, which Pillow takes."""
    kept, at = {}, 8
    while (kind := png[at + 4 : at + 8]) not in (b"IDAT", b""):
        size = 12 + int.from_bytes(png[at : at + 4], "big")
        if kind in _KEPT_CHUNKS:
            kept[kind] = png[at : at + size]
        at += size
    return b"".join(kept.values())


def _end(image: Image, data: bytes, pages: int) -> int:
    """Where an open picture ends, or a place close before it."""
    if data.startswith(b"\x89PNG"):
        return data.index(_PNG_END) + len(_PNG_END) if _PNG_END in data else len(data)
    if data.startswith(b"BM"):
        return int.from_bytes(data[2:6], "little") or len(data)
    if data.startswith(b"RIFF"):
        return 8 + int.from_bytes(data[4:8], "little")
    if data.startswith(JPEG):
        end, _, follows = next_jpeg(data)
        is_preview = follows and not are_jpegs(data)
        own = is_preview or _OWN_PICTURES.search(data, 0, end) or data.endswith(b"SEFT")  # a trailer of Samsung
        return len(data) if own else end
    if data.startswith(TIFF):
        image.seek(pages - 1)
        tags = image.tag_v2  # type: ignore[attr-defined]
        pieces = (piece for at, size in _PIECES for piece in zip(tags.get(at, ()), tags.get(size, ()), strict=False))
        return max(map(sum, pieces), default=len(data))
    return image.height * -(-image.width // 8) if data.startswith(b"P4") else 2


def _require_single(data: bytes, end: int) -> None:
    """FileError if a further picture begins at ``end`` or behind it; JPEGs of a TIFF may be its previews."""
    for found in _BEGINNING.finditer(data, end):
        if data.startswith(TIFF) and data.startswith(JPEG, found.start()):
            continue
        if found["film"]:
            raise FileError("a film after the picture, allowed: one of them")
        raise FileError("a further picture after the first, allowed: one (several of JPEG or PNM, or a TIFF of pages)")


def _binary_pnm(data: bytes) -> tuple[Frame, LightResponse]:
    """Read PGM and PPM, one or several after the other, with their stored values; their maximum is the white level."""
    frames, largest, end = list[Frame](), 0, 0
    while not frames or data[end : end + 2] in (b"P5", b"P6"):
        frame, white, end = _one_pnm(data, end)
        if frames and (frame.shape != frames[0].shape or white != largest):
            raise FileError("PNM pictures of several sizes or largest values, allowed: one")
        frames.append(frame)
        largest = white
    _require_single(data, end)
    return np.stack(frames), LightResponse(white_level=float(largest), stated_by="PNM header", assumed_for="PNM")


def _one_pnm(data: bytes, start: int) -> tuple[Frame, int, int]:
    """The picture that begins there, its largest value and its end."""
    header = _PNM_HEADER.match(data, start)
    if header is None:
        raise FileError("damaged PNM header")
    width, height, largest = (int(header[k]) for k in (2, 3, 4))
    shape = (height, width) if header[1] == b"5" else (height, width, 3)
    dtype, count = np.dtype(np.uint8 if largest < 256 else ">u2"), math.prod(shape)
    if count == 0 or not 1 <= largest <= 65535:
        raise FileError(f"PNM picture of {width} x {height}, largest value {largest}")
    end = header.end() + count * dtype.itemsize
    if end > len(data):
        raise FileError(f"truncated: PNM picture of {width} x {height} with {len(data) - header.end()} bytes of pixels")
    pixels = np.frombuffer(data, dtype, count, header.end())
    return pixels.astype(dtype.newbyteorder("="), copy=False).reshape(shape), largest, end


@contextlib.contextmanager
def _refusals() -> Iterator[None]:
    """Convert Pillow's errors to :class:`FileError`."""
    image_module = pillow()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # cameras make large pictures; Pillow still rejects absurd sizes
            yield
    except image_module.DecompressionBombError as error:
        raise FileError("absurd size: more pixels than any camera has") from error
    except image_module.UnidentifiedImageError as error:
        raise FileError("damaged or not a picture") from error
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, KeyError, TypeError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"truncated or damaged picture ({' '.join(str(error).split())})") from error


def _frames(
    image: Image, data: bytes, pages: int, samples: tuple[int, str], alphas: list[Frame | None]
) -> Iterator[Frame]:
    """Decode one page at a time; pages that the caller drops are freed."""
    for page in range(pages):
        yield _without_alpha(_page(image, data, page, pages, samples), alphas)


def _without_alpha(frame: Frame, alphas: list[Frame | None]) -> Frame:
    """The frame without its opacity, which is appended to ``alphas``."""
    colours = frame.shape[2] if frame.ndim == 3 else 1
    alphas.append(frame[..., -1].copy() if colours in (2, 4) else None)
    return frame if colours in (1, 3) else np.ascontiguousarray(frame[..., 0] if colours == 2 else frame[..., :3])


def _page(image: Image, data: bytes, page: int, pages: int, samples: tuple[int, str]) -> Frame:
    """A page with its opacity as last colour."""
    with _refusals():
        if page:
            image.seek(page)
        orientation = image.getexif().get(ORIENTATION)
        image.load()  # decodes everything: FFmpeg below would fill in the missing part of a truncated file
        deep = _is_deep_colour(image, data)
        if deep and pages > 1:
            raise FileError("several pages of 16-bit colour, allowed: one")
        frame = _deep_colour(data) if deep else _pixels(_as_stored(image, orientation))
        if _samples(image, data) != samples:
            raise FileError("pages of several BitsPerSample or SampleFormat, allowed: one")
        bits, kind = samples
        if kind != "f" and bits == 8 * frame.itemsize:  # Pillow's modes are unsigned of 8 bits and signed of 32
            frame = frame.view(f"{kind}{frame.itemsize}")
        if page == pages - 1:
            image.close()
        return frame


def _as_stored(image: Image, orientation: int | None) -> Image:
    """Undo the turn that Pillow gives a loaded TIFF picture."""
    if image.format != "TIFF" or orientation not in _STORED or ORIENTATION in image.tag_v2:  # type: ignore[attr-defined]
        return image
    return image.transpose(getattr(pillow().Transpose, _STORED[orientation]))


def _samples(image: Image, data: bytes) -> tuple[int, str]:
    """Bits, 8 or more, and type ("u", "i" or "f") of the samples that the file states."""
    if image.format != "TIFF":
        return 16 if image.format == "PNG" and data[24] == 16 else 8, "u"
    tags = image.tag_v2  # type: ignore[attr-defined]
    bits = max(8, *tags.get(_TIFF_BITS_PER_SAMPLE, ()))
    if tags.get(_TIFF_PHOTOMETRIC) == 0 and bits > 8:  # which Pillow leaves as they are
        raise FileError(f"white as 0 (PhotometricInterpretation) in {bits} bits, allowed: black as 0, or 8 bits")
    return bits, {2: "i", 3: "f"}.get(max(tags.get(_TIFF_SAMPLE_FORMAT, (1,))), "u")


def _pixels(image: Image) -> Frame:
    """Values of a loaded picture, copied one band of rows at a time since Pillow needs twice the size of its output."""
    width, height = image.size
    step = max(_BAND_PIXELS // width, 1)
    bands = (image.crop((0, top, width, min(top + step, height))) for top in range(0, height, step))
    values: Frame = np.empty(0)
    for index, band in enumerate(bands):
        part = _values(band, image.format)
        if index == 0:
            values = np.empty((height, *part.shape[1:]), part.dtype)
        values[index * step : index * step + len(part)] = part
    return values


def _values(image: Image, kind: str | None) -> Frame:
    """Pixel values, with opacity that is a colour's own; a palette is converted to RGB."""
    mode = image.mode
    if mode == "1":
        image = image.convert("L")
    elif mode in ("P", "PA"):
        image = image.convert("RGBA" if mode == "PA" or "transparency" in image.info else "RGB")
    elif mode in ("La", "RGBa", "RGBX"):
        return np.asarray(image)[..., : len(mode) - 1].squeeze(-1 if len(mode) == 2 else ())
    elif mode not in ("L", "LA", "RGB", "RGBA", "F", "I", "I;16", "I;16B", "I;16L", "I;16N"):
        raise FileError(f"picture of mode {mode}, allowed: grey or RGB")
    values = np.asarray(image)
    if mode == "I" and kind in ("PNG", "PPM"):  # older Pillows store 16 bits in 32
        values = values.astype(np.uint16)
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def _is_deep_colour(image: Image, data: bytes) -> bool:
    """Return True if the file holds several colours of 16 bits, of which Pillow keeps 8."""
    if image.format == "PNG":
        return data[24] == 16 and data[25] in (2, 4, 6)  # bit depth, colour type of IHDR
    if image.format == "TIFF":
        bits = image.tag_v2.get(_TIFF_BITS_PER_SAMPLE, (1,))  # type: ignore[attr-defined]
        return len(bits) > 1 and max(bits) == 16
    return False


def _deep_colour(data: bytes) -> Frame:
    av = pyav()
    try:
        with opened_video(io.BytesIO(data)) as container:
            with ffmpeg():
                frame = next(steps(container.decode(video=0)))
            has_alpha = frame.format.name.startswith(("ya", "rgba"))
            values = np.ascontiguousarray(frame.to_ndarray(format="rgba64le" if has_alpha else "rgb48le"))
            return values[..., [0, 3]] if frame.format.name.startswith("ya") else values
    except (av.FFmpegError, StopIteration, IndexError) as error:
        raise FileError(f"16-bit colour that cannot be decoded ({error})") from error
