"""A processed copy of a picture keeps its opacity, EXIF orientation and colour profile; JPEGs in a row are a film."""

from __future__ import annotations

import io
import os
import struct
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image, ImageCms as cms

from ocisac_fast.files import open_recording, read_frames, write_frames
from ocisac_fast.files.writing import _deep_picture

ORIENTATION, MAKER = 0x0112, 0x010F
PROFILE = cms.ImageCmsProfile(cms.createProfile("sRGB")).tobytes()
MODES = {1: "L", 2: "LA", 3: "RGB", 4: "RGBA"}
PIXELS = np.random.default_rng(3).integers(0, 1 << 16, (40, 30, 4)).astype(np.uint16)


def make(path: Path, colours: int, deep: bool, orientation: int) -> None:
    values = PIXELS[..., :colours] if deep else (PIXELS[..., :colours] >> 8).astype(np.uint8)
    if deep and colours > 1:
        path.write_bytes(_deep_picture(values, "PNG" if path.suffix == ".png" else "TIFF"))
        return
    exif = Image.Exif()
    exif[ORIENTATION], exif[MAKER] = orientation, "a camera"
    tags: dict[str, Any] = {"tiffinfo": {ORIENTATION: orientation}} if path.suffix == ".tif" else {"exif": exif}
    Image.fromarray(values.squeeze()).save(path, icc_profile=PROFILE, **tags)


def copied(source: Path, target: Path) -> None:
    with open_recording(source) as stream:
        write_frames(target, iter(stream), like=stream)


def contents(path: Path) -> tuple[npt.NDArray[Any], npt.NDArray[Any] | None, int | None, bytes | None]:
    with open_recording(path) as stream:
        (frame,) = stream
        assert stream.picture is not None
        return frame, stream.picture.alphas[0], stream.picture.orientation, stream.picture.options.get("icc_profile")


@pytest.mark.parametrize("target", [".png", ".tif"])
@pytest.mark.parametrize("kind", [".png", ".tif"])
@pytest.mark.parametrize("deep", [False, True])
@pytest.mark.parametrize("colours", MODES)
def test_opacity_orientation_and_profile_are_kept(
    tmp_path: Path, colours: int, deep: bool, kind: str, target: str
) -> None:
    if deep and colours == 2 and ".tif" in (kind, target):
        pytest.skip("FFmpeg's TIFF has no grey with opacity of 16 bits")
    make(tmp_path / f"a{kind}", colours, deep, 6)
    copied(tmp_path / f"a{kind}", tmp_path / f"b{target}")
    (pixels, alpha, *stated), (kept, kept_alpha, *said) = (contents(tmp_path / n) for n in (f"a{kind}", f"b{target}"))
    np.testing.assert_array_equal(kept, pixels)
    assert (alpha is None) == (colours in (1, 3))
    np.testing.assert_array_equal(kept_alpha, alpha)
    assert said == stated
    assert stated == ([None, None] if deep and colours > 1 else [6, PROFILE])


@pytest.mark.parametrize("orientation", range(1, 9))
def test_pixels_of_a_tiff_are_those_stored(tmp_path: Path, orientation: int) -> None:
    make(tmp_path / "a.tif", 3, False, orientation)
    np.testing.assert_array_equal(read_frames(tmp_path / "a.tif").frames[0], (PIXELS[..., :3] >> 8).astype(np.uint8))


def test_a_jpeg_keeps_its_exif_data(tmp_path: Path) -> None:
    make(tmp_path / "a.jpg", 3, False, 8)
    for name in ("b.jpg", "b.png"):
        copied(tmp_path / "a.jpg", tmp_path / name)
        with Image.open(tmp_path / name) as kept:
            assert (kept.getexif()[ORIENTATION], kept.getexif()[MAKER]) == (8, "a camera")
            assert kept.info["icc_profile"] == PROFILE


def test_a_palette_keeps_its_opacity(tmp_path: Path) -> None:
    values = (PIXELS >> 8).astype(np.uint8)
    Image.fromarray(values).quantize(method=2).save(tmp_path / "a.png")
    copied(tmp_path / "a.png", tmp_path / "b.png")
    with Image.open(tmp_path / "a.png") as stored, Image.open(tmp_path / "b.png") as kept:
        np.testing.assert_array_equal(kept, stored.convert("RGBA"))


def jpeg(level: int, size: tuple[int, int] = (64, 48), **options: Any) -> bytes:
    made = io.BytesIO()
    Image.new("RGB", size, (level, level, level)).save(made, "JPEG", **options)
    return made.getvalue()


@pytest.mark.parametrize("piped", [False, True])
def test_jpegs_one_after_the_other_are_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piped: bool) -> None:
    levels = list(range(10, 250, 20))
    path: str | Path = tmp_path / "film.jpg"
    Path(path).write_bytes(b"".join(jpeg(level) for level in levels))
    if piped:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(open(path, "rb")))  # noqa: SIM115
        path = "-"
    recording = read_frames(path)
    assert (recording.kind, recording.frame_rate) == ("video", None)
    assert recording.response.tone_curve == "srgb"
    np.testing.assert_allclose(recording.frames.mean(axis=(1, 2)), levels, atol=1)


def test_a_jpeg_with_a_preview_or_a_thumbnail_is_one_picture(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x927C] = jpeg(9, (16, 12))  # a maker's note
    made = io.BytesIO()
    image = Image.new("RGB", (64, 48), (80, 80, 80))
    image.save(made, "MPO", save_all=True, append_images=[image])
    for data in (jpeg(80) + jpeg(80, (16, 12)), jpeg(80, exif=exif), made.getvalue(), jpeg(80) + bytes(9)):
        (tmp_path / "a.jpg").write_bytes(data)
        recording = read_frames(tmp_path / "a.jpg")
        assert (recording.kind, recording.frames.shape) == ("picture", (1, 48, 64, 3))


@pytest.mark.parametrize("padding", [b"\n", b"\xff\xff", bytes(128), bytes(5000)])
@pytest.mark.parametrize("is_pipe", [False, True])
def test_jpegs_with_padding_between_them_are_frames(tmp_path: Path, padding: bytes, is_pipe: bool) -> None:
    path = tmp_path / "camera"
    if not is_pipe:
        path.write_bytes(b"".join(jpeg(level) + padding for level in (50, 60, 70)))
        assert len(read_frames(path).frames) == 3
        return
    os.mkfifo(path)
    if (child := os.fork()) == 0:
        with open(path, "wb", 0) as sink:
            for level in (50, 60, 70):
                for piece in (jpeg(level)[:-1], b"\xd9", padding[:-1], padding[-1:]):
                    sink.write(piece)
                    time.sleep(0.02)
        os._exit(0)
    with open_recording(path) as stream:
        assert [round(float(frame.mean()), -1) for frame in stream] == [50, 60, 70]
    os.waitpid(child, 0)


def test_pictures_of_the_same_photograph_are_no_further_ones(tmp_path: Path) -> None:
    first, other = jpeg(80), jpeg(90)

    def noted(note: bytes) -> bytes:
        return first[:2] + b"\xff\xe1" + struct.pack(">H", len(note) + 2) + note + first[2:]

    pages = io.BytesIO()
    image = Image.new("RGB", (64, 48), (80, 80, 80))
    image.save(pages, "TIFF")
    for data in (
        noted(b"http://ns.google.com/photos/1.0/container/") + other,
        noted(b"Exif\0\0II*\0" + 2 * jpeg(9, (16, 12))),
        first + b"\0\0\1\x0a\x10\0\0\0DualShot_Extra_1" + other + b"SEFH\x6a\0\0\0SEFT",
        first + np.random.default_rng(0).bytes(100_000),
        pages.getvalue() + noted(b"Exif\0\0II*\0"),
        pages.getvalue() + b"Nikon\0\2\x11\0\0MM\0*\0\0\0\x08",  # notes of a camera
    ):
        (tmp_path / "a").write_bytes(data)
        recording = read_frames(tmp_path / "a")
        assert (recording.kind, recording.frames.shape) == ("picture", (1, 48, 64, 3))
    image.save(tmp_path / "a.tif", save_all=True, append_images=[image, image])  # Pillow begins each as a file
    assert len(read_frames(tmp_path / "a.tif").frames) == 3


def test_frames_of_a_pipe_come_one_by_one(tmp_path: Path) -> None:
    fifo = tmp_path / "camera"
    os.mkfifo(fifo)
    if (child := os.fork()) == 0:
        with open(fifo, "wb") as sink:
            sink.write(b"".join(jpeg(level) for level in (50, 60, 70)))
        os._exit(0)
    with open_recording(fifo) as stream:
        assert [round(float(frame.mean()), -1) for frame in stream] == [50, 60, 70]
    os.waitpid(child, 0)
