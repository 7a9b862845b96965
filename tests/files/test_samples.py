"""Samples of files have the sign, the white and the range that the files state."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt
import pytest

from ocisac_fast.files import FileError, open_recording, read_frames, write_frames
from ocisac_fast.files.pictures import grey_levels
from ocisac_fast.files.reading import lossless_suffix

ROWS = np.linspace(0, 1, 40)[:, np.newaxis] * np.ones((1, 32))


def write_tiff(
    path: Path, values: npt.NDArray[Any], *, bits: int, photometric: int = 1, kind: int = 1, order: str = "<"
) -> None:
    """Write a page of one colour; ``kind``: SampleFormat, 1: unsigned, 2: signed, 3: float."""
    rows, columns = values.shape
    if bits == 12:
        planes = (values[..., np.newaxis].astype(np.int64) >> np.arange(12)[::-1]) & 1
        pixels = np.packbits(planes.astype(np.uint8).reshape(rows, -1), axis=1).tobytes()
    else:
        pixels = values.astype(values.dtype.newbyteorder(order)).tobytes()
    tags = {256: columns, 257: rows, 258: bits, 259: 1, 262: photometric, 273: 8, 277: 1, 278: rows, 279: len(pixels)}
    entries = b"".join(struct.pack(f"{order}HHII", tag, 4, 1, tags[tag]) for tag in sorted(tags))
    entries += struct.pack(f"{order}HHII", 339, 4, 1, kind)
    head = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HI", 42, 8 + len(pixels))
    path.write_bytes(head + pixels + struct.pack(f"{order}H", len(tags) + 1) + entries + bytes(4))


def stored(dtype: str) -> npt.NDArray[Any]:
    limits = np.iinfo(dtype)
    return np.rint(limits.min + ROWS * (limits.max - limits.min)).astype(dtype)


@pytest.mark.parametrize(
    ("dtype", "kind", "order"),
    [("u1", 1, "<"), ("i1", 2, "<"), ("i1", 2, ">"), ("i2", 2, "<"), ("i2", 2, ">"), ("u4", 1, "<"), ("i4", 2, ">")],
)
def test_integers_of_a_tiff_have_their_sign(tmp_path, dtype, kind, order):
    values = stored(dtype)
    write_tiff(tmp_path / "a.tif", values, bits=8 * values.itemsize, kind=kind, order=order)
    np.testing.assert_array_equal(read_frames(tmp_path / "a.tif").frames[0], values)


def test_a_tiff_whose_white_is_zero_is_inverted_or_refused(tmp_path):
    write_tiff(tmp_path / "a.tif", 255 - stored("u1"), bits=8, photometric=0)
    np.testing.assert_array_equal(read_frames(tmp_path / "a.tif").frames[0], stored("u1"))
    for order, values, kind in [("<", stored("u2"), 1), ("<", ROWS.astype("f4"), 3), (">", ROWS.astype("f4"), 3)]:
        write_tiff(tmp_path / "b.tif", values, bits=8 * values.itemsize, photometric=0, kind=kind, order=order)
        with pytest.raises(FileError, match=r"b\.tif: .*PhotometricInterpretation"):
            read_frames(tmp_path / "b.tif")


LIGHT = (ROWS * 1.5 - 0.1).astype(np.float32)  # also less than black and more than white


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize(("scale", "dtype"), [("-1.0", "<f4"), ("1.0", ">f4"), ("EXR", "<f4")])
def test_grey_floats_are_as_stored(tmp_path, scale, dtype, colour):
    path = tmp_path / "a"
    if scale == "EXR":
        with av.open(path, "w", format="image2", options={"update": "1"}) as container:
            stream = container.add_stream("exr", rate=30)
            stream.height, stream.width = LIGHT.shape
            stream.pix_fmt = "grayf32le"
            frame = av.VideoFrame(stream.width, stream.height, "grayf32le")
            frame.planes[0].update(LIGHT.tobytes())
            container.mux([*stream.encode(frame), *stream.encode(None)])
    else:  # a PFM, whose lines follow each other upwards
        path.write_bytes(f"Pf\n32 40\n{scale}\n".encode() + LIGHT[::-1].astype(dtype).tobytes())
    recording = read_frames(path, colour=colour)
    np.testing.assert_array_equal(recording.frames[0], np.dstack([LIGHT] * 3) if colour else LIGHT)
    assert (recording.response.dark_level, recording.response.white_level) == (0.0, None)
    assert lossless_suffix(path) == ".npy"


@pytest.mark.parametrize("pixels", ["rgb48le", "gbrp16le"])
def test_white_of_deep_colours_without_a_range_is_that_of_the_full_range(tmp_path, pixels):
    with av.open(tmp_path / "a.nut", "w") as container:
        stream = container.add_stream("rawvideo", rate=30)
        stream.height, stream.width, stream.pix_fmt = 40, 32, pixels
        frame = av.VideoFrame(32, 40, pixels)
        for plane in frame.planes:
            plane.update(b"\xff" * plane.buffer_size)
        container.mux([*stream.encode(frame), *stream.encode(None)])
    with open_recording(tmp_path / "a.nut") as recording:
        assert [frame.max() for frame in recording] == [recording.response.white_level] == [65535]


@pytest.mark.parametrize(("bits", "kind", "white"), [(12, 1, 4095), (16, 1, 65535), (16, 2, 32767), (32, 1, 2**32 - 1)])
def test_bits_of_a_tiff_give_its_white(tmp_path, bits, kind, white):
    values = np.rint(ROWS * white).astype({12: "u2", 16: "iu"[kind == 1] + "2", 32: "u4"}[bits])
    write_tiff(tmp_path / "a.tif", values, bits=bits, kind=kind)
    recording = read_frames(tmp_path / "a.tif")
    np.testing.assert_array_equal(recording.frames[0], values)
    assert (recording.response.white_level, recording.response.stated_by) == (white, "TIFF BitsPerSample")


def test_pages_of_several_bits_are_refused(tmp_path):
    """The white level is one for all frames."""
    write_tiff(tmp_path / "a.tif", stored("u2") >> 4, bits=12)
    page = (tmp_path / "a.tif").read_bytes()
    write_tiff(tmp_path / "b.tif", stored("u2"), bits=16)
    other = bytearray((tmp_path / "b.tif").read_bytes()[8:])
    first = int.from_bytes(page[4:8], "little")  # directories: 10 entries of 12 bytes between a count and a next one
    at = len(page) + len(other) - 126
    strip = struct.pack("<HHII", 273, 4, 1, 8)
    other = other.replace(strip, strip[:8] + struct.pack("<I", len(page)))
    (tmp_path / "a.tif").write_bytes(page[: first + 122] + struct.pack("<I", at) + page[first + 126 :] + other)
    with pytest.raises(FileError, match="several BitsPerSample"):
        read_frames(tmp_path / "a.tif")


@pytest.mark.parametrize("transfer", [2, 13])
def test_the_limited_range_of_a_png_holds_for_its_bits(tmp_path, transfer):
    deep = np.repeat(stored("u2")[..., np.newaxis], 3, axis=2)
    for name, values, unit in [("deep", deep, 256), ("grey", stored("u2"), 256), ("bytes", stored("u1"), 1)]:
        path = tmp_path / f"{name}.png"
        write_frames(path, values[np.newaxis])
        whole, chunk = path.read_bytes(), b"cICP" + bytes([9, transfer, 0, 0])
        path.write_bytes(whole[:33] + b"\0\0\0\4" + chunk + struct.pack(">I", zlib.crc32(chunk)) + whole[33:])
        recording = read_frames(path)
        np.testing.assert_array_equal(recording.frames[0], values)
        response = recording.response
        assert (response.dark_level, response.white_level) == (16 * unit, 235 * unit)
        assert response.stated_by == "PNG cICP chunk"


def test_grey_levels_have_the_scale_that_the_file_states(tmp_path):
    """Pillow cuts 16 bits and floats at 255 as it makes them 8."""
    deep = stored("u2")
    write_frames(tmp_path / "a.png", deep)
    write_frames(tmp_path / "b.png", np.repeat(deep[np.newaxis, ..., np.newaxis], 3, axis=3))
    write_frames(tmp_path / "c.tif", (deep / 65535).astype(np.float32))
    write_tiff(tmp_path / "d.tif", deep >> 4, bits=12)
    (tmp_path / "e.pgm").write_bytes(b"P5 32 40 4095\n" + (deep >> 4).astype(">u2").tobytes())
    for path in sorted(tmp_path.iterdir()):
        levels = grey_levels(path, 10_000)
        np.testing.assert_allclose(levels, ROWS, atol=4e-4)
        assert (levels.min(), levels.max()) == (0, 1)
