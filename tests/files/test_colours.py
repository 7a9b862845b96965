"""Colours of videos: FFmpeg's scaler against the equations of ITU-T H.273, for pixel formats of all kinds."""

from __future__ import annotations

import itertools
import re
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import av
import numpy as np
import numpy.typing as npt
import pytest

from ocisac_fast.files import open_recording, write_frames
from ocisac_fast.files.colours import Conversion, rgb_format, rgb_white

Planes = list[npt.NDArray[Any]]  # Y, Cb, Cr
LUMA_WEIGHTS = {1: (0.2126, 0.0722), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}  # Kr, Kb of BT.709, BT.601, BT.2020
SUBSAMPLING = {"420": (2, 2), "422": (1, 2), "444": (1, 1), "440": (2, 1), "411": (1, 4), "410": (4, 4)}
PACKED = {"yuyv422": "yuyv", "uyvy422": "uyvy", "yvyu422": "yvyu", "y210le": "yuyv", "y212le": "yuyv"}
PACKED |= {"vuya": "vuya", "vuyx": "vuya", "ayuv": "ayuv", "uyva": "uyva", "vyu444": "vyu"}
PACKED |= {"xv36le": "uyva", "xv48le": "uyva", "ayuv64le": "ayuv"}
PACKED_BITS = {"y210le": 10, "y212le": 12, "xv36le": 12, "xv48le": 16, "ayuv64le": 16}
SEMI_PLANAR = {"nv12": "420", "nv21": "420", "nv16": "422", "nv20": "422", "nv24": "444", "nv42": "444"}
ROWS, COLUMNS = 64, 96


class Layout(NamedTuple):
    """Memory of a pixel format; ``step``: rows and columns of luma for one of chroma."""

    step: tuple[int, int]
    bits: int
    dtype: str
    shift: int = 0
    semi_planar: bool = False
    swapped: bool = False
    packed: str = ""


def layout(name: str) -> Layout | None:
    """The layout of Y'CbCr of 8 bits and more; None for rare packed formats and others."""
    if order := PACKED.get(name):
        bits, step = PACKED_BITS.get(name, 8), (1, order.count("y"))
        return Layout(step, bits, "u1" if bits == 8 else "<u2", (16 - bits) % 8, packed=order)
    if match := re.fullmatch(r"yuv[aj]?(4\d\d)p(\d*)(le|be|)", name):
        bits = int(match[2] or 8)
        return Layout(SUBSAMPLING[match[1]], bits, "u1" if bits == 8 else ">u2" if match[3] == "be" else "<u2")
    if match := re.fullmatch(r"(nv\d\d)(le|be|)", name):
        dtype = {"": "u1", "le": "<u2", "be": ">u2"}[match[2]]
        bits = 10 if match[1] == "nv20" else 8
        return Layout(SUBSAMPLING[SEMI_PLANAR[match[1]]], bits, dtype, 0, True, match[1] in ("nv21", "nv42"))
    if match := re.fullmatch(r"p([024])(1[026])(le|be)", name):
        step = SUBSAMPLING[{"0": "420", "2": "422", "4": "444"}[match[1]]]
        return Layout(step, int(match[2]), ">u2" if match[3] == "be" else "<u2", 16 - int(match[2]), True)
    return None


def pixel_formats() -> list[str]:
    """Those with a layout that this FFmpeg's scaler reads."""
    return sorted(name for name in av.video.format.names if layout(name) and not name.startswith("nv20"))


FORMATS = pixel_formats()
WRITTEN = ["yuv420p", "yuv422p", "yuv444p", "yuvj420p", "yuvj422p", "yuvj444p"]
WRITTEN += ["yuv420p10le", "yuv422p10le", "yuv444p10le"]


def light_of(planes: Planes, bits: int, limited: bool, matrix: int) -> npt.NDArray[np.float64]:
    """Red, green and blue, 0 to 1, of Y'CbCr (H.273, equations 26 to 28, 38 to 40)."""
    y, cb, cr = (np.asarray(plane, float) for plane in planes)
    unit, top = 2.0 ** (bits - 8), 2.0**bits - 1
    luma, chroma, dark = (219 * unit, 224 * unit, 16 * unit) if limited else (top, top, 0.0)
    kr, kb = LUMA_WEIGHTS[matrix]
    y, cb, cr = (y - dark) / luma, (cb - 128 * unit) / chroma, (cr - 128 * unit) / chroma
    red, blue = y + 2 * (1 - kr) * cr, y + 2 * (1 - kb) * cb
    return np.stack([red, (y - kr * red - kb * blue) / (1 - kr - kb), blue], axis=-1).clip(0, 1)


def stored_of(light: npt.NDArray[np.float64], bits: int, limited: bool, matrix: int) -> Planes:
    """The inverse of :func:`light_of`, rounded."""
    unit, top = 2.0 ** (bits - 8), 2.0**bits - 1
    luma, chroma, dark = (219 * unit, 224 * unit, 16 * unit) if limited else (top, top, 0.0)
    kr, kb = LUMA_WEIGHTS[matrix]
    red, green, blue = np.moveaxis(light, -1, 0)
    y = kr * red + (1 - kr - kb) * green + kb * blue
    cb, cr = (blue - y) / (2 * (1 - kb)), (red - y) / (2 * (1 - kr))
    return [np.rint(luma * y + dark), *(np.clip(np.rint(chroma * c + 128 * unit), 0, top) for c in (cb, cr))]


def frame_of(name: str, planes: Planes, form: Layout) -> Any:
    """A frame of PyAV with these samples, whose chroma planes are subsampled already."""
    rows, columns = planes[0].shape
    frame = av.VideoFrame(columns, rows, name)
    y, cb, cr = ((plane.astype(np.uint32) << form.shift).astype(form.dtype) for plane in planes)
    every = [y, cb, cr, np.full_like(y, 2**form.bits - 1)][: len(frame.planes)]
    if form.semi_planar:
        every[1] = np.stack([cr, cb] if form.swapped else [cb, cr], axis=-1).reshape(len(cb), -1)
    if form.packed:
        luma = iter([y[:, k :: form.step[1]] for k in range(form.step[1])])
        others = {"u": cb, "v": cr, "a": np.full_like(cb, 2**form.bits - 1)}
        every[0] = np.stack([next(luma) if x == "y" else others[x] for x in form.packed], axis=-1)
    for plane, values in zip(frame.planes, every, strict=True):
        lines = np.zeros((plane.height, plane.line_size), np.uint8)
        samples = np.ascontiguousarray(values.reshape(len(values), -1), form.dtype).view(np.uint8)
        lines[: len(samples), : samples.shape[1]] = samples
        plane.update(lines.tobytes())
    return frame


def planes_of(frame: Any) -> Planes:
    """The samples of a planar frame."""
    form = layout(frame.format.name)
    assert form is not None
    assert not form.semi_planar
    down, across = form.step
    sizes = [(frame.height, frame.width), *[(-(-frame.height // down), -(-frame.width // across))] * 2]
    return [
        np.frombuffer(plane, form.dtype).reshape(plane.height, -1)[:rows, :columns].astype(float)
        for plane, (rows, columns) in zip(frame.planes, sizes, strict=True)
    ]


def blocks(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.kron(values, np.ones((8, 8), values.dtype))


def middle(step: tuple[int, int] = (1, 1)) -> npt.NDArray[np.bool_]:
    """Samples in the middle of blocks of 8 by 8 pixels, where interpolation of chroma stays inside of the block."""
    rows, columns = ((np.arange(0, size, by) % 8) // by for size, by in zip((ROWS, COLUMNS), step, strict=True))
    inside = [np.abs(at - (8 // by - 1) / 2) <= 0.5 for at, by in zip((rows, columns), step, strict=True)]
    both: npt.NDArray[np.bool_] = np.logical_and.outer(*inside)
    return both


@pytest.mark.parametrize("name", FORMATS)
def test_every_pixel_format_becomes_the_colours_of_the_equations(name: str) -> None:
    form = layout(name)
    assert form is not None
    random = np.random.default_rng(sum(name.encode()))
    down, across = form.step
    unit = 2 ** (form.bits - 8)
    for limited, matrix in itertools.product((False,) if "j" in name else (False, True), LUMA_WEIGHTS):
        low, high, top = (16 * unit, 235 * unit, 240 * unit) if limited else (0, 2**form.bits - 1, 2**form.bits - 1)
        y = random.integers(low, high + 1, (ROWS, COLUMNS))
        cb, cr = (blocks(random.integers(low, top + 1, (ROWS // 8, COLUMNS // 8))) for _ in "br")
        convert = Conversion(rgb_format(form.bits > 8), matrix, limited)
        white = rgb_white(limited, form.bits)
        got = convert(frame_of(name, [y, cb[::down, ::across], cr[::down, ::across]], form)).to_ndarray() / white
        error = 255 * (np.minimum(got, 1) - light_of([y, cb, cr], form.bits, limited, matrix))
        assert np.abs(error[middle()]).max() < (0.6 if form.bits == 8 else 0.1), (limited, matrix)
        # Chroma that changes from sample to sample, within the gamut: the mean is kept.
        y, cb, cr = (random.integers(int(at * unit), int((at + 40) * unit), (ROWS, COLUMNS)) for at in (108, 108, 108))
        narrow = [y, cb[::down, ::across], cr[::down, ::across]]
        full = [y, *(np.kron(plane, np.ones(form.step)) for plane in narrow[1:])]
        got = convert(frame_of(name, narrow, form)).to_ndarray() / white
        error = 255 * (got - light_of(full, form.bits, limited, matrix))
        assert np.abs(error.mean(axis=(0, 1))).max() < 0.5, (limited, matrix)


@pytest.mark.parametrize("name", WRITTEN)
def test_colours_are_written_by_the_equations(name: str) -> None:
    form = layout(name)
    assert form is not None
    random, unit = np.random.default_rng(7), 2 ** (form.bits - 8)
    source, white = ("rgb24", 255) if form.bits == 8 else ("rgb48le", 255 * 256)
    for limited, matrix in itertools.product((False,) if "j" in name else (False, True), LUMA_WEIGHTS):
        light = np.stack([blocks(random.random((ROWS // 8, COLUMNS // 8))) for _ in "rgb"], axis=-1)
        values = np.rint(white * light).astype(np.uint8 if form.bits == 8 else np.uint16)
        written = Conversion(name, matrix, limited)(av.VideoFrame.from_ndarray(values, format=source))
        expected = stored_of(values / white, form.bits, limited, matrix)
        for plane, one, other in zip("Ybr", planes_of(written), expected, strict=True):
            step = (1, 1) if plane == "Y" else form.step
            error = (one - other[:: step[0], :: step[1]])[middle(step)] / unit
            assert np.abs(error).max() <= 1, (plane, limited, matrix)
            assert np.abs(error.mean()) < 0.6, (plane, limited, matrix)  # newer FFmpegs round chroma of full range down


@pytest.mark.parametrize(
    ("codec", "pixels"), [("libx265", "yuv420p10le"), ("libx264", "yuv420p10le"), ("libx265", "yuv420p12le")]
)
def test_deep_films_keep_their_colours(tmp_path: Path, codec: str, pixels: str) -> None:
    form, source, target = layout(pixels), tmp_path / "in.mp4", tmp_path / "out.mp4"
    assert form is not None
    colours = np.array([[0.2, 0.5, 0.8, 0.4], [0.7, 0.3, 0.6, 0.5], [0.1, 0.9, 0.5, 0.5]])
    light = np.kron(colours.T.reshape(2, 2, 3), np.ones((32, 48, 1)))
    planes = stored_of(light, form.bits, True, 9)
    with av.open(str(source), "w") as container:
        stream = container.add_stream(codec, rate=30, options={"crf": "8", "x265-params": "log-level=none"})
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, pixels
        stream.codec_context.colorspace, stream.codec_context.color_range = 9, 1
        for k in range(3):
            frame = frame_of(pixels, [planes[0], planes[1][::2, ::2], planes[2][::2, ::2]], form)
            frame.pts, frame.time_base = k, Fraction(1, 30)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    for path in (source, target):
        with open_recording(path, colour=True) as opened:
            frames = np.stack(list(opened))
            assert np.abs((frames / opened.response.white_level - light)[:, middle()]).max() * 255 < 2.5, path
        if path == source:
            with open_recording(source, colour=True) as opened:
                write_frames(target, iter(opened), like=opened)
