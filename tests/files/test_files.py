"""Recordings as files: every kind there and back, what a file says of itself, and what is refused."""

import contextlib
import errno
import io
import math
import os
import re
import select
import stat
import struct
import subprocess
import sys
import time
import types
import warnings
import zlib
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import av
import numpy as np
import PIL.Image as image_module
import pytest
from hypothesis import given, settings, strategies as st

from ocisac_fast.cli.outputs import read_input
from ocisac_fast.files import FileError, FileWarning, atomic_path, open_recording, read_frames, write_frames, writing
from ocisac_fast.files.films import FirstFilm
from ocisac_fast.files.parts import Ending
from ocisac_fast.files.reading import cut_recording
from ocisac_fast.files.videos import Prefixed, open_video


def random_frames(shape, dtype, seed=0):
    random = np.random.default_rng(seed)
    if np.dtype(dtype).kind == "f":
        return random.standard_normal(shape).astype(dtype)
    return random.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)


@pytest.mark.parametrize("suffix", [".npy", ".png", ".tif", ".mkv", ".mp4"])
def test_equal_frames_are_equal_files(suffix, tmp_path):
    """Matroska's numbers of a film and of its stream were random."""
    for name in "ab":
        write_frames(tmp_path / f"{name}{suffix}", random_frames((1, 64, 48), np.uint8))
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize(
    ("suffix", "dtype", "shape"),
    [
        (suffix, dtype, shape)
        for suffix, dtypes, shapes in [
            (".png", (np.uint8, np.uint16), [(1, 47, 65), (1, 47, 65, 3), (1, 1, 1)]),
            (".tif", (np.uint8, np.uint16), [(1, 47, 65), (4, 47, 65), (1, 47, 65, 3)]),
            (".tiff", (np.float32,), [(3, 47, 65)]),
            (".mkv", (np.uint8, np.uint16), [(1, 47, 65), (5, 47, 65), (3, 47, 65, 3), (2, 1, 1)]),
            (".MKV", (np.uint8,), [(2, 47, 65)]),
            (".mp4", (np.uint8,), [(5, 48, 64), (3, 47, 65)]),
            (".npy", (np.uint8, np.uint16, np.float32, np.float64), [(1, 47, 65), (3, 47, 65), (3, 47, 65, 3)]),
        ]
        for dtype in dtypes
        for shape in shapes
    ],
)
def test_every_kind_comes_back_bit_for_bit(tmp_path, suffix, dtype, shape):
    frames = random_frames(shape, dtype)
    path = tmp_path / f"recording{suffix}"
    write_frames(path, frames, frame_rate=120)
    recording = read_frames(path)
    assert recording.frames.dtype == dtype
    assert np.array_equal(recording.frames, frames)
    assert recording.response.tone_curve == "linear"
    assert recording.response.dark_level == 0.0
    assert recording.response.white_level in (None, 255.0 if dtype == np.uint8 else 65535.0)
    assert os.listdir(tmp_path) == [path.name]
    if recording.kind == "video":
        assert recording.frame_rate == pytest.approx(120)


@given(st.integers(1, 40), st.integers(2, 40), st.sampled_from([np.uint8, np.uint16]), st.integers(1, 3), st.booleans())
@settings(max_examples=settings.default.max_examples // 5, deadline=None)
def test_any_size_survives_a_lossless_video(tmp_path_factory, rows, columns, dtype, count, colour):
    frames = random_frames((count, rows, columns) + ((3,) if colour else ()), dtype, seed=rows * 41 + columns)
    path = tmp_path_factory.mktemp("video") / "recording.mkv"
    write_frames(path, frames)
    assert np.array_equal(read_frames(path).frames, frames)


def encoded_video(path, pixels, planes, size=None, codec="ffv1", color_range=0, transfer=2):
    """A video of one frame whose planes hold exactly these values."""
    height, width = size or planes[0].shape
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, pixels
        stream.codec_context.color_range, stream.codec_context.color_trc = color_range, transfer
        frame = av.VideoFrame(width, height, pixels)
        for plane, values in zip(frame.planes, planes, strict=True):
            stored = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
            lines = np.zeros((plane.buffer_size // plane.line_size, plane.line_size), np.uint8)
            lines[: len(stored), : stored.shape[1]] = stored
            plane.update(lines.tobytes())
        frame.color_range, frame.pts = color_range, 0
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.mark.parametrize(
    ("pixels", "bits", "color_range", "levels"),
    [("yuv420p", 8, 0, (16, 235)), ("yuv420p", 8, 1, (16, 235)), ("yuv420p", 8, 2, (0, 255)),
     ("yuv420p10le", 10, 1, (64, 940))],
)  # fmt: skip
def test_luma_is_read_as_coded_with_its_bits_and_range(tmp_path, pixels, bits, color_range, levels):
    dtype, spare = (np.uint8, 0) if bits == 8 else (np.uint16, 16 - bits)
    luma = random_frames((46, 66), dtype) >> spare  # 66 columns: the decoder pads its lines
    chroma = random_frames((23, 33), dtype, seed=1) >> spare
    encoded_video(tmp_path / "v.mkv", pixels, [luma, chroma, chroma], color_range=color_range)
    recording = read_frames(tmp_path / "v.mkv")
    assert np.array_equal(recording.frames[0], luma)
    assert (recording.response.dark_level, recording.response.white_level) == levels


@pytest.mark.parametrize(("pixels", "first"), [("yuyv422", 0), ("uyvy422", 1)])
def test_packed_luma_is_taken_apart(tmp_path, pixels, first):
    packed = random_frames((20, 34, 2), np.uint8)
    encoded_video(tmp_path / "v.nut", pixels, [packed], size=(20, 34), codec="rawvideo")
    assert np.array_equal(read_frames(tmp_path / "v.nut").frames[0], packed[..., first])


@pytest.mark.parametrize(
    ("transfer", "curve", "gamma"), [(1, "gamma", 1.95), (4, "gamma", 2.2), (8, "linear", None), (13, "srgb", None)]
)
def test_the_stream_names_its_tone_curve(tmp_path, transfer, curve, gamma):
    luma, chroma = random_frames((16, 16), np.uint8), np.full((8, 8), 128, np.uint8)
    encoded_video(tmp_path / "v.mkv", "yuv420p", [luma, chroma, chroma], transfer=transfer)
    response = read_frames(tmp_path / "v.mkv").response
    assert response.tone_curve == curve
    assert gamma is None or response.gamma == gamma


def test_colour_of_a_video_on_request(tmp_path):
    frames = random_frames((2, 16, 16, 3), np.uint8)
    write_frames(tmp_path / "v.mkv", frames)
    assert np.array_equal(read_frames(tmp_path / "v.mkv", colour=True).frames, frames)
    planes = [np.full((16, 16), 81, np.uint8), np.full((8, 8), 90, np.uint8), np.full((8, 8), 240, np.uint8)]
    encoded_video(tmp_path / "red.mkv", "yuv420p", planes, color_range=1)
    red, green, blue = read_frames(tmp_path / "red.mkv", colour=True).frames[0, 8, 8]
    assert red > 240
    assert max(green, blue) < 20


@pytest.mark.parametrize("width", [128, 100])
def test_frames_of_a_video_stay_as_they_were_while_others_are_decoded(tmp_path, width):
    """Also where they are read in the decoder's memory, which predicts later frames from earlier ones."""
    frames = np.random.default_rng(0).integers(0, 256, (24, 96, width)).astype(np.uint8)
    path = tmp_path / "v.mkv"
    with av.open(path, "w") as file:
        stream = file.add_stream("libx264", rate=30, options={"qp": "0", "bf": "3", "g": "12"})
        stream.width, stream.height, stream.pix_fmt = width, 96, "gray"
        for frame in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="gray")))
        file.mux(stream.encode())
    with open_recording(path) as opened:
        read = list(opened)
    assert all(frame.flags.c_contiguous and not frame.flags.writeable for frame in read)
    np.testing.assert_array_equal(np.stack(read), frames)


def test_a_video_has_the_name_of_a_pattern_of_pictures(tmp_path):
    frames = random_frames((3, 32, 32), np.uint8)
    write_frames(tmp_path / "v.mkv", frames)
    (tmp_path / "v.mkv").rename(tmp_path / "img%03d.png")
    assert np.array_equal(read_frames(tmp_path / "img%03d.png").frames, frames)


def test_a_long_video_is_read_frame_by_frame(tmp_path):
    frames = random_frames((7, 32, 32), np.uint8)
    write_frames(tmp_path / "v.mkv", frames)
    with open_recording(tmp_path / "v.mkv") as stream:
        read = list(stream)
    assert np.array_equal(read, frames)
    with pytest.raises(FileError, match="read it frame by frame"):
        read_frames(tmp_path / "v.mkv", max_bytes=3 * 1024)


def png(chunks, pixels):
    """A grey PNG of 8 or 16 bits with extra chunks before its pixels."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    height, width = pixels.shape
    lines = np.zeros((height, width * pixels.itemsize + 1), np.uint8)
    lines[:, 1:] = pixels.astype(pixels.dtype.newbyteorder(">")).view(np.uint8)
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8 * pixels.itemsize, 0, 0, 0, 0))
    body = b"".join(chunk(name, data) for name, data in chunks)
    return b"\x89PNG\r\n\x1a\n" + header + body + chunk(b"IDAT", zlib.compress(lines.tobytes())) + chunk(b"IEND", b"")


def icc_chunk(curve, description=b"some display"):
    """An iCCP chunk with a profile of a description and one curve."""
    tags, body = b"", b""
    for name, data in ((b"desc", b"desc\0\0\0\0" + description + b"\0"), (b"gTRC", curve)):
        tags += struct.pack(">4sII", name, 132 + 2 * 12 + len(body), len(data))
        body += data
    return b"iCCP", b"p\0\0" + zlib.compress(bytes(128) + struct.pack(">I", 2) + tags + body)


@pytest.mark.parametrize(
    ("chunk", "curve", "gamma", "stated_by"),
    [
        (None, "linear", None, ""),
        ((b"sRGB", b"\0"), "srgb", None, "PNG sRGB chunk"),
        ((b"gAMA", struct.pack(">I", 45455)), "gamma", 2.2, "PNG gAMA chunk"),
        ((b"gAMA", struct.pack(">I", 100000)), "linear", None, "PNG gAMA chunk"),
        (icc_chunk(b"curv" + bytes(8)), "linear", None, "ICC profile"),
        (icc_chunk(b"curv\0\0\0\0" + struct.pack(">IH", 1, 461)), "gamma", 461 / 256, "ICC profile"),
        (icc_chunk(b"para\0\0\0\0" + struct.pack(">HHi", 0, 0, 157286)), "gamma", 2.4, "ICC profile"),
        (icc_chunk(b"", b"sRGB IEC61966-2.1"), "srgb", None, "ICC profile"),
        ((b"iCCP", b"p\0\0" + zlib.compress(b"broken")), "linear", None, ""),
        ((b"cICP", bytes([9, 18, 0, 1])), "hlg", None, "PNG cICP chunk"),
        ((b"cICP", bytes([9, 16, 0, 1])), "pq", None, "PNG cICP chunk"),
        ((b"cICP", bytes([9, 2, 0, 1])), "linear", None, ""),
    ],
)
def test_a_png_tells_its_tone_curve(tmp_path, chunk, curve, gamma, stated_by):
    pixels = random_frames((5, 7), np.uint8)
    (tmp_path / "p.png").write_bytes(png([chunk] if chunk else [], pixels))
    recording = read_frames(tmp_path / "p.png")
    assert np.array_equal(recording.frames[0], pixels)
    assert (recording.response.tone_curve, recording.response.stated_by) == (curve, stated_by)
    assert gamma is None or recording.response.gamma == pytest.approx(gamma, rel=1e-4)


@pytest.mark.parametrize(
    ("chunks", "tail"),
    [([(b"gAMA", b"\0\1\x86\xa0")] * 100_000, b""), ([], b"P1 \n#" * 40_000)],
    ids=["chunks", "tail"],
)
def test_a_picture_is_opened_in_time_proportional_to_its_size(tmp_path, chunks, tail):
    """Each chunk was added to a copy of those before it, each byte of the tail read for each comment before it."""
    pixels = random_frames((5, 7), np.uint8)
    (tmp_path / "p.png").write_bytes(png(chunks, pixels) + tail)
    began = time.process_time()
    with open_recording(tmp_path / "p.png") as stream:
        assert np.array_equal(next(iter(stream)), pixels)
        assert len(stream.picture.chunks) == 16 * bool(chunks)
    assert time.process_time() - began < 5


@pytest.mark.parametrize(("dtype", "unit"), [(np.uint8, 1), (np.uint16, 256)])
@pytest.mark.parametrize("is_full", [True, False])
def test_a_png_tells_its_range(tmp_path, dtype, unit, is_full):
    (tmp_path / "p.png").write_bytes(png([(b"cICP", bytes([9, 13, 0, is_full]))], random_frames((5, 7), dtype)))
    response = read_frames(tmp_path / "p.png").response
    assert (response.dark_level, response.white_level) == ((0, None) if is_full else (16 * unit, 235 * unit))


@pytest.mark.parametrize("orientation", [1, 6])
def test_exif_gives_the_curve_and_never_turns_the_picture(tmp_path, orientation):
    pixels = np.full((16, 24, 3), 90, np.uint8)
    exif = image_module.Exif()
    exif[0x0112] = orientation
    exif.get_ifd(0x8769)[0xA001] = 1
    image_module.fromarray(pixels).save(tmp_path / "p.jpg", exif=exif.tobytes(), quality=95)
    recording = read_frames(tmp_path / "p.jpg")
    assert recording.frames.shape == (1, 16, 24, 3)
    assert recording.response.tone_curve == "srgb"


def test_alpha_is_dropped_and_a_palette_becomes_colours(tmp_path):
    rgb, alpha = random_frames((9, 11, 3), np.uint8), random_frames((9, 11, 1), np.uint8, seed=1)
    image_module.fromarray(np.concatenate([rgb, alpha], axis=-1)).save(tmp_path / "rgba.png")
    assert np.array_equal(read_frames(tmp_path / "rgba.png").frames[0], rgb)
    image_module.fromarray(np.concatenate([rgb[..., :1], alpha], axis=-1)).save(tmp_path / "la.png")
    assert np.array_equal(read_frames(tmp_path / "la.png").frames[0], rgb[..., 0])
    image_module.fromarray(rgb).quantize(256).save(tmp_path / "palette.png")
    assert np.abs(read_frames(tmp_path / "palette.png").frames[0].astype(int) - rgb).max() <= 2
    image_module.fromarray(rgb[..., 0] > 99).save(tmp_path / "bits.png")
    assert np.array_equal(read_frames(tmp_path / "bits.png").frames[0], np.where(rgb[..., 0] > 99, 255, 0))


def test_pnm_values_are_those_stored(tmp_path):
    pixels = random_frames((9, 11), np.uint16) >> 6
    (tmp_path / "p.pgm").write_bytes(b"P5\n# ten bits\n11 9\n1023\n" + pixels.astype(">u2").tobytes())
    recording = read_frames(tmp_path / "p.pgm")
    assert np.array_equal(recording.frames[0], pixels)
    assert recording.response.white_level == 1023
    (tmp_path / "p.ppm").write_bytes(2 * (b"P6 1 2 255\n" + bytes(range(6))))
    assert np.array_equal(read_frames(tmp_path / "p.ppm").frames, np.stack(2 * [np.arange(6).reshape(2, 1, 3)]))


@pytest.mark.parametrize(("pixels", "channels"), [("rgba64be", 4), ("ya16be", 2)])
def test_deep_pictures_with_alpha_keep_sixteen_bits(tmp_path, pixels, channels):
    values = random_frames((9, 11, channels), np.uint16)
    context = av.CodecContext.create("png", "w")
    context.width, context.height, context.pix_fmt, context.time_base = 11, 9, pixels, Fraction(1, 25)
    frame = av.VideoFrame(11, 9, pixels)
    lines = np.zeros((9, frame.planes[0].line_size), np.uint8)
    lines[:, : 11 * 2 * channels] = values.astype(">u2").view(np.uint8).reshape(9, -1)
    frame.planes[0].update(lines.tobytes())
    (tmp_path / "p.png").write_bytes(b"".join(bytes(p) for p in [*context.encode(frame), *context.encode(None)]))
    assert np.array_equal(read_frames(tmp_path / "p.png").frames[0], values[..., :-1].squeeze())


def test_npy_is_read_frame_by_frame_and_its_shapes_are_understood(tmp_path):
    path = tmp_path / "a.npy"
    for shape, want in [((5,), (1, 5, 1)), ((5, 4), (1, 5, 4)), ((3, 5, 4), (3, 5, 4)), ((2, 5, 4, 3), (2, 5, 4, 3))]:
        values = random_frames(shape, np.float64)
        np.save(path, values)
        recording = read_frames(path)
        assert recording.frames.shape == want
        assert np.array_equal(recording.frames.reshape(shape), values)
    np.save(path, np.asfortranarray(values))
    assert np.array_equal(read_frames(path).frames, values)


def test_npy_that_is_cut_short_while_it_is_read_is_refused(tmp_path):
    """In a child: of a mapped file, the pages that are gone would end the process."""
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((8, 512, 512), np.uint8))
    code = f"""
import os
from ocisac_fast.files import FileError, open_recording
with open_recording({str(path)!r}) as stream:
    frames = iter(stream)
    print(next(frames).sum())
    os.truncate({str(path)!r}, 1000)
    try:
        print(sum(frame.sum() for frame in frames))
    except FileError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    first, last = done.stdout.splitlines()
    assert first == "0"
    assert re.search(r"a\.npy: truncated", last)


@pytest.mark.parametrize(
    ("shape", "fortran"), [((200_000, 200_000), False), ((3, 100_000, 50_000), False), ((3, 2, 9 << 30), True)]
)
def test_a_frame_of_many_gigabytes_is_refused_before_it_is_read(tmp_path, shape, fortran):
    """Sparse: it takes no room on the disk, and all of the memory."""
    path = tmp_path / "a.npy"
    with open(path, "wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "|u1", "fortran_order": fortran, "shape": shape})
        file.truncate(file.tell() + math.prod(shape))
    with open_recording(path) as stream, pytest.raises(FileError, match=r"a\.npy: more than 4096 MiB"):
        next(iter(stream))


def test_arrays_one_after_the_other_are_read_in_a_file_as_in_a_pipe(tmp_path):
    frames = np.arange(4 * 6 * 5, dtype=np.uint8).reshape(4, 6, 5)
    with open(tmp_path / "two.npy", "wb") as file:
        np.save(file, frames)
        np.save(file, frames[::-1])
    np.testing.assert_array_equal(read_frames(tmp_path / "two.npy").frames, np.concatenate([frames, frames[::-1]]))
    with open(tmp_path / "two.npy", "ab") as file:
        file.write(b"more")
    with pytest.raises(FileError, match=r"two\.npy: after the array: bytes that are no \.npy file"):
        read_frames(tmp_path / "two.npy")


@pytest.mark.parametrize("shape", ["1+" * 4000 + "1", "~" * 3000 + "1", "-" * 9000 + "1", "(" * 9000])
def test_a_header_nested_too_deeply_is_damaged(tmp_path, shape):
    header = f"{{'descr':'|u1','fortran_order':False,'shape':({shape},)}}\n".encode()
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header)
    with pytest.raises(FileError, match=r"a\.npy: damaged \.npy file"):
        read_frames(tmp_path / "a.npy")


PEAK = """
import sys
from ocisac_fast.files import FileError, read_frames

def peak():
    status = open("/proc/self/status").read()
    return int(status.split("VmHWM:")[1].split()[0])

read_frames(sys.argv[1])  # small, and all that is imported
before = peak()
try:
    read_frames(sys.argv[2], max_bytes=int(sys.argv[3]))
except FileError as error:
    print(error)
print(peak() - before)
"""

LIMITED = """
import resource, sys
import numpy as np
from ocisac_fast.files import read_frames, write_frames

limit, size, path = sys.argv[1:]
frames = np.random.default_rng(0).integers(0, 255, (1 if path in ("a.png", "a.jpg") else 8, 480, 640), np.uint8)
for imported in (".png", ".mkv", ".jpg"):
    write_frames("small" + imported, frames[:1, :16, :16])
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
most = int(size) + (used if limit == "RLIMIT_AS" else 0)
resource.setrlimit(getattr(resource, limit), (most, most))
try:
    read_frames(path) if limit == "RLIMIT_AS" else write_frames(path, frames)
except (OSError, ValueError) as error:
    print(type(error).__name__, error)
"""


def within(limit, size, path, folder):
    command = [sys.executable, "-c", LIMITED, limit, str(size), path]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


@pytest.mark.skipif(sys.platform != "linux", reason="limits of processes as Linux has them")
def test_more_frames_than_memory_holds_are_read_one_by_one(tmp_path):
    page = image_module.fromarray(np.zeros((8000, 8000), np.uint8))
    page.save(tmp_path / "a.tif", save_all=True, append_images=[page] * 9, compression="tiff_lzw")
    message = r"FileError a\.tif: Unable to allocate 610. MiB .* frame by frame \(open_recording\)\n"
    assert re.fullmatch(message, within("RLIMIT_AS", 400 << 20, "a.tif", tmp_path))


@pytest.mark.skipif(sys.platform != "linux", reason="limits of processes as Linux has them")
@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".npy", ".png", ".tif", ".jpg"])
def test_a_file_that_finds_no_room_is_named(tmp_path, suffix):
    said = within("RLIMIT_FSIZE", 20_000, f"a{suffix}", tmp_path)
    assert re.fullmatch(rf"OSError \[Errno .*\] .*: 'a\{suffix}'\n", said)
    assert not (tmp_path / f"a{suffix}").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
@pytest.mark.parametrize("compression", ["raw", "tiff_deflate"])
def test_pages_of_a_tiff_are_held_once(tmp_path, compression):
    """Peak memory: the frames, the file and one page; of more than is allowed, what is allowed."""
    path = tmp_path / "pages.tif"
    page = np.zeros((5000, 5000), np.uint8)
    images = [image_module.fromarray(page) for _ in range(6)]
    small = tmp_path / "small.tif"
    images[0].crop((0, 0, 8, 8)).save(small, "TIFF", compression=compression)
    images[0].save(path, "TIFF", compression=compression, save_all=True, append_images=images[1:])
    limits = {4 << 30: len(images), 4 * page.nbytes: 4}
    for max_bytes, kept in limits.items():
        done = subprocess.run(
            [sys.executable, "-c", PEAK, small, path, str(max_bytes)], capture_output=True, text=True, check=True
        )
        *told, peak = done.stdout.splitlines()
        assert len(told) == (kept < len(images))
        allowed = kept * page.nbytes + path.stat().st_size + page.nbytes + (32 << 20)  # Pillow's blocks
        assert int(peak) * 1024 < allowed, (peak, allowed)


@pytest.mark.parametrize("suffix", [".png", ".webp"])
@pytest.mark.parametrize("shape", [(3, 20, 30), (4, 20, 30, 3)])
def test_all_frames_of_an_animation_are_read(tmp_path, suffix, shape):
    frames = random_frames(shape, np.uint8)
    if suffix == ".webp" and frames.ndim == 3:  # WebP has colours alone
        frames = frames[..., None].repeat(3, axis=-1)
    first, *more = (image_module.fromarray(frame) for frame in frames)
    first.save(tmp_path / f"a{suffix}", save_all=True, append_images=more, lossless=True)
    recording = read_frames(tmp_path / f"a{suffix}")
    assert np.array_equal(recording.frames, frames)
    with open_recording(tmp_path / f"a{suffix}") as stream:
        assert stream.frame_count == len(frames)


def test_interlaced_video_is_refused(tmp_path):
    path = tmp_path / "fields.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        stream.options = {"flags": "+ildct+ilme", "field_order": "tt"}
        for _ in range(3):
            frame = av.VideoFrame.from_ndarray(random_frames((96, 64), np.uint8), format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(FileError, match=r"fields\.mkv: interlaced: .*separatefields"):
        read_frames(path)


def npy_bytes(array):
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def picture_bytes(picture, kind):
    buffer = io.BytesIO()
    image_module.fromarray(picture).save(buffer, kind)
    return buffer.getvalue()


def damaged_files():
    picture = random_frames((64, 48), np.uint8)
    absurd_array, absurd = io.BytesIO(), {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    np.lib.format.write_array_header_1_0(absurd_array, absurd)
    grey = png([], picture)
    absurd_png = bytearray(grey)
    absurd_png[16:24] = struct.pack(">II", 10**6, 10**6)
    absurd_png[29:33] = struct.pack(">I", zlib.crc32(bytes(absurd_png[12:29])))
    jpeg = picture_bytes(picture, "JPEG")
    tiff, bmp, webp, bitmap = *(picture_bytes(picture, kind) for kind in ("TIFF", "BMP", "WEBP")), b"P4 8 2\n00"
    plain, pgm = b"P2 1 2 255\n7 8\n", b"P5 1 2 255\n00"
    further = {
        **{f"two {kind}, {pad!r}": (grey, pad, grey) for kind, pad in (("png", b"\n"), ("png", bytes(16)))},
        **{f"two tiff, {pad!r}": (tiff, pad, tiff) for pad in (b"", b"\n")},
        "two webp, a byte": (webp, b"x", webp),
        "two bmp, a byte": (bmp, b"\n", bmp),
        "two plain pgm": (plain, plain),
        "two bitmaps": (bitmap, bitmap),
        "pgm, plain pgm": (pgm, plain),
        "pgm, bitmap": (pgm, bitmap),
        "two pgm, a byte": (pgm, b"\n", pgm),
        "png, jpeg": (grey, jpeg),
        "jpeg, png": (jpeg, grey),
        "jpeg, text, jpeg": (jpeg, b"some text", jpeg),
        "tiff, png": (tiff, grey),
    }
    return {
        **{name: (b"".join(pieces), "a further picture after the first") for name, pieces in further.items()},
        "jpegs of two sizes": (jpeg + picture_bytes(picture[:50], "JPEG"), r"frame 1 is \(50, 48\) after frames of"),
        "png, matroska": (grey + b"\x1a\x45\xdf\xa3\x9f" + bytes(40), "a film after the picture"),
        "bmp, mp4": (bmp + b"\0\0\0\x1cftypisom" + bytes(40), "a film after the picture"),
        "empty": (b"", "empty"),
        "text": (b"certainly not a picture\n" * 20, "not a picture, a video or a .npy array"),
        "half a png": (grey[: len(grey) // 2], "truncated"),
        "png without its last bytes": (grey[:-6], "truncated"),
        "half a jpeg": (jpeg[: len(jpeg) // 2], "truncated"),
        "png header": (grey[:20], "truncated"),
        "absurd png": (bytes(absurd_png), "absurd size"),
        "half a pgm": (b"P5 100 100 255\n" + bytes(500), "truncated"),
        "pgm without a size": (b"P5 abc\n", "damaged PNM header"),
        "pgm of nothing": (b"P5 0 100 255\n", "PNM picture of 0 x 100"),
        "two sizes of pgm": (b"P5 1 2 255\n00P5 2 2 255\n0000", "PNM pictures of several sizes"),
        "a pgm and a half": (b"P5 1 2 255\n00P5 1 2 255\n0", "truncated: PNM picture of 1 x 2"),
        "two png": (2 * grey, "a further picture after the first, allowed: one"),
        **{f"two {kind}": (2 * picture_bytes(picture, kind), "a further picture") for kind in ("BMP", "WEBP")},
        "half an array": (npy_bytes(picture)[:-9], "truncated"),
        "absurd array": (absurd_array.getvalue(), "truncated|more than 4096 MiB"),
        "array header": (npy_bytes(picture)[:30], r"damaged \.npy file"),
        "objects": (npy_bytes(np.array([{}], dtype=object)), "array of object"),
        "strings": (npy_bytes(np.array(["a"])), "array of <U1"),
        "no rows": (npy_bytes(np.zeros((0, 5))), r"array of shape \(0, 5\)"),
        "playlist": (b"#EXTM3U\n#EXT-X-TARGETDURATION:5\n#EXTINF:5,\n/etc/passwd\n", "not a picture, a video"),
        "subtitles": (b"1\n00:00:01,000 --> 00:00:02,000\nhello\n\n" * 9, "not a picture, a video"),
    }


@pytest.mark.parametrize("case", sorted(damaged_files()))
@pytest.mark.parametrize("piped", [False, True])
def test_what_is_no_recording_is_refused_by_name(tmp_path, monkeypatch, case, piped):
    data, message = damaged_files()[case]
    path = tmp_path / "damaged.bin"
    path.write_bytes(data)
    with path.open("rb") as file:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(file))
        with pytest.raises(FileError, match=message) as refusal:
            read_frames("-" if piped else path)
    assert str(refusal.value).startswith("standard input: " if piped else f"{path}: ")
    assert "\n" not in str(refusal.value)


@pytest.fixture(scope="module")
def files_of_every_kind(tmp_path_factory):
    """Bytes of small files of every kind that is read."""
    folder = tmp_path_factory.mktemp("kinds")
    frames = random_frames((3, 24, 36), np.uint8)
    for name, values in [
        *((f"a.{suffix}", frames) for suffix in ("mkv", "mp4", "tif", "npy")),
        ("a.png", frames[0]),
        ("deep.png", random_frames((1, 24, 36, 3), np.uint16)),
        ("deep.tif", random_frames((1, 24, 36, 3), np.uint16)),
    ]:
        write_frames(folder / name, values)
    for name in ("a.jpg", "a.pgm", "a.bmp", "a.webp", "a.gif"):
        image_module.fromarray(frames[0]).save(folder / name)
    return [path.read_bytes() for path in sorted(folder.iterdir())]


class Reader:
    """A child process that reads files: a crash or a hang there does not end the run."""

    CODE = """
import sys, warnings
from ocisac_fast.files import FileError, FileWarning, read_frames
warnings.simplefilter("ignore", FileWarning)
for line in sys.stdin:
    try:
        print("read" if read_frames(line[:-1]).frames.size else "nothing", flush=True)
    except FileError:
        print("refused", flush=True)
    except Exception as error:
        print(repr(error), flush=True)
"""
    LONGEST = 120.0  # s; on a busy machine, too

    def __init__(self):
        self.child = None

    def outcome(self, path):
        if self.child is None:
            command = [sys.executable, "-W", "error", "-c", self.CODE]
            self.child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.child.stdin.write(f"{path}\n")
        self.child.stdin.flush()
        if not select.select([self.child.stdout], [], [], self.LONGEST)[0]:
            self.end()
            return "no end"
        return self.child.stdout.readline().strip() or f"ended with {self.end()}"

    def end(self):
        child, self.child = self.child, None
        if child is None:
            return None
        child.kill()
        with child:
            return child.wait()


@pytest.fixture(scope="module")
def reader():
    reader = Reader()
    yield reader
    reader.end()


@given(st.data())
@settings(max_examples=2 * settings.default.max_examples, deadline=None)
def test_damage_is_survived_or_refused(files_of_every_kind, reader, tmp_path_factory, data):
    damaged = bytearray(data.draw(st.sampled_from(files_of_every_kind)))
    span = data.draw(st.sampled_from([min(300, len(damaged)), len(damaged)]))
    for place, value in data.draw(st.lists(st.tuples(st.integers(0, span - 1), st.integers(0, 255)), max_size=12)):
        damaged[place] = value
    path = tmp_path_factory.getbasetemp() / "damaged"
    path.write_bytes(damaged[: data.draw(st.sampled_from([len(damaged), len(damaged) // 2, len(damaged) - 1]))])
    assert reader.outcome(path) in ("read", "refused")


def test_a_reader_that_crashes_or_hangs_is_replaced(tmp_path, reader, monkeypatch):
    monkeypatch.setattr(Reader, "CODE", Reader.CODE.replace("    try:", "    eval(line)\n    try:", 1))
    monkeypatch.setattr(Reader, "LONGEST", 5.0)
    reader.end()
    assert reader.outcome("__import__('os').kill(__import__('os').getpid(), 7)") == "ended with -7"
    assert reader.outcome("__import__('time').sleep(60)") == "no end"
    reader.end()


def test_missing_files_and_directories_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_frames(tmp_path / "missing.png")
    with pytest.raises(IsADirectoryError):
        read_frames(tmp_path)
    write_frames(tmp_path / "a.npy", np.zeros((9, 9), np.uint8))
    with pytest.raises(NotADirectoryError):
        read_frames(f"{tmp_path / 'a.npy'}/")


@pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
def test_a_truncated_video_gives_its_whole_frames_and_a_warning(tmp_path, suffix):
    frames = random_frames((12, 120, 160), np.uint8)
    path = tmp_path / f"v{suffix}"
    write_frames(path, frames)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.warns(FileWarning, match=r"truncated or damaged video: \d"):
        recording = read_frames(path)
    assert 3 <= len(recording.frames) <= 6
    assert np.array_equal(recording.frames, frames[: len(recording.frames)])


def film_of(path, form, codec, pixels):
    """20 frames of noise, encoded for any container."""
    with av.open(str(path), "w", format=form) as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = 160, 120, pixels
        for k, luma in enumerate(random_frames((20, 120, 160), np.uint8)):
            frame = av.VideoFrame.from_ndarray(luma, format="gray").reformat(format=pixels)
            frame.pts, frame.time_base = k, Fraction(1, 30)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


FILMS = {
    "matroska": ("ffv1", "gray"),
    "mjpeg": ("mjpeg", "yuvj420p"),
    "avi": ("mjpeg", "yuvj420p"),
    "h264": ("libx264", "yuv420p"),
    "mpegts": ("libx264", "yuv420p"),
    "nut": ("ffv1", "gray"),
}


@pytest.fixture(scope="module", params=["y4m", *FILMS])
def film(request, tmp_path_factory):
    """A film of each kind, and its frames."""
    path = tmp_path_factory.mktemp("film") / "whole"
    if request.param == "y4m":
        planes = random_frames((20, 160 * 120 * 3 // 2), np.uint8)
        head = b"YUV4MPEG2 W160 H120 F30:1 Ip A1:1 C420jpeg\n"
        path.write_bytes(head + b"".join(b"FRAME\n" + each.tobytes() for each in planes))
    else:
        film_of(path, request.param, *FILMS[request.param])
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a whole film nothing is said
        return path, read_frames(path).frames


@pytest.mark.parametrize("cut", [150, 600, 1000, 4000, 9000])
def test_a_film_cut_anywhere_gives_frames_of_the_whole_and_a_warning(tmp_path, film, cut):
    path, frames = film
    (tmp_path / "cut").write_bytes(path.read_bytes()[:-cut])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        left = read_frames(tmp_path / "cut").frames
    whole = {frame.tobytes() for frame in frames}
    assert len(left)
    assert {frame.tobytes() for frame in left} <= whole
    if len(left) < len(frames):
        assert re.search(rf"truncated or damaged video: {len(left)}( of 20)? frames are whole", str(said[0].message))


def test_without_memory_a_film_is_not_called_damaged(tmp_path, monkeypatch):
    from ocisac_fast.files import parts, video_writing

    def without_memory(*_):
        av.error.err_check(-errno.ENOMEM)

    film_of(tmp_path / "film", "matroska", *FILMS["matroska"])
    monkeypatch.setattr(parts.Ending, "decoded", without_memory)
    with pytest.raises(FileError, match="read it frame by frame"):
        read_frames(tmp_path / "film")
    with open_recording(tmp_path / "film") as stream, pytest.raises(MemoryError):
        next(iter(stream))

    def picture(writer, *_):
        writer.stream = types.SimpleNamespace(encode=without_memory)

    monkeypatch.setattr(video_writing._Writer, "picture", picture)
    with pytest.raises(MemoryError):
        write_frames(tmp_path / "out.mkv", random_frames((2, 8, 8), np.uint8))


@pytest.mark.parametrize("kind", ["y4m", "matroska"])
def test_a_film_cut_by_a_byte_is_noticed_through_a_pipe_too(tmp_path, kind):
    path = tmp_path / "film"
    if kind == "y4m":
        path.write_bytes(b"YUV4MPEG2 W8 H8 F30:1 Ip A1:1 Cmono\n" + (b"FRAME\n" + bytes(64)) * 5)
    else:
        film_of(path, kind, *FILMS[kind])
    count = len(read_frames(path).frames)
    code = "from ocisac_fast.files import read_frames; print(len(read_frames('-').frames))"
    for cut, warned in ((0, False), (1, True)):
        data = path.read_bytes()[: path.stat().st_size - cut]
        done = subprocess.run([sys.executable, "-c", code], input=data, capture_output=True, check=True)
        assert (b"truncated or damaged video" in done.stderr) == warned
        assert int(done.stdout) == count - (warned and kind == "y4m")


@pytest.mark.parametrize("suffix", [".npy", ".png", ".tif", ".mkv", ".mp4"])
def test_standard_input_takes_every_kind(tmp_path, suffix):
    frames = random_frames((1, 48, 64), np.uint8)
    write_frames(tmp_path / f"r{suffix}", frames)
    code = "from ocisac_fast.files import read_frames; import sys; sys.stdout.buffer.write(read_frames('-').frames)"
    with (tmp_path / f"r{suffix}").open("rb") as file:
        cat = subprocess.Popen(["cat"], stdin=file, stdout=subprocess.PIPE)
        done = subprocess.run([sys.executable, "-c", code], stdin=cat.stdout, capture_output=True)
        cat.stdout.close()
        cat.wait()
    assert done.stderr == b""
    assert done.stdout == frames.tobytes()


@pytest.mark.parametrize(
    ("name", "frames", "message"),
    [
        ("a.gif", np.zeros((4, 4), np.uint8), "suffix: got '.gif', allowed: .png"),
        ("a", np.zeros((4, 4), np.uint8), "suffix: got ''"),
        ("a.png", np.zeros((2, 4, 4), np.uint8), "several frames, a PNG or JPEG picture holds one"),
        ("a.png", np.zeros((4, 4), np.float32), "frames of float32, this kind of file holds uint8, uint16"),
        ("a.png", [], "no frame to write"),
        ("a.npy", [], "no frame to write"),
        ("a.mkv", [], "no frame to write"),
        ("a.mp4", np.zeros((4, 4), np.uint16), "frames of uint16, this kind of file holds uint8"),
        ("a.mp4", np.zeros((1, 4, 4, 3), np.uint8), "colour frames"),
        ("a.mkv", np.zeros((1, 4, 4, 2), np.uint8), r"frame of shape \(4, 4, 2\)"),
        ("a.mkv", [np.zeros((4, 4), np.uint8), np.zeros((4, 5), np.uint8)], "frame 1 is uint8"),
        ("a.tif", [np.zeros((4, 4), np.uint8), np.zeros((4, 5), np.uint8)], "different shapes or types"),
    ],
)
def test_what_a_kind_cannot_hold_is_refused_and_leaves_nothing(tmp_path, name, frames, message):
    with pytest.raises(FileError, match=message):
        write_frames(tmp_path / name, frames)
    assert os.listdir(tmp_path) == []


def test_an_error_half_way_keeps_what_was_there(tmp_path):
    path = tmp_path / "v.mkv"
    path.write_bytes(b"before")

    def frames():
        yield np.zeros((16, 16), np.uint8)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_frames(path, frames())
    assert path.read_bytes() == b"before"
    assert os.listdir(tmp_path) == ["v.mkv"]


def test_a_file_is_written_with_the_usual_permissions(tmp_path):
    before = os.umask(0o027)
    try:
        with atomic_path(tmp_path / "a.txt") as temporary:
            temporary.write_text("whole")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(
    ("target", "missing"),
    [("none/new.png", "none"), ("none/../p.png", r"none/\.\."), ("p.png/../p.png", r"p\.png/\.\.")],
)
@pytest.mark.parametrize("by_link", [False, True])
def test_a_path_through_a_missing_folder_names_that_folder(tmp_path, target, missing, by_link):
    """Where the system finds no file, none is replaced; no frame is made."""
    path = tmp_path / "link.png" if by_link else f"{tmp_path}/{target}"
    write_frames(tmp_path / "p.png", np.zeros((8, 8), np.uint8))
    if by_link:
        path.symlink_to(target)
    before, frames = (tmp_path / "p.png").read_bytes(), iter([np.ones((8, 8), np.uint8)])
    error = NotADirectoryError if target.startswith("p.png/") else FileNotFoundError
    with pytest.raises(error, match=rf"irectory.*: '.*/({missing}|link\.png|{target})'"):
        write_frames(path, frames)
    assert len(list(frames)) == 1
    assert (tmp_path / "p.png").read_bytes() == before


def test_what_a_link_points_to_is_written(tmp_path):
    (tmp_path / "there").mkdir()
    target, link, dangling = tmp_path / "there" / "real.npy", tmp_path / "link.npy", tmp_path / "dangling.npy"
    target.write_bytes(b"before")
    target.chmod(0o604)
    link.symlink_to(target)
    dangling.symlink_to(tmp_path / "there" / "new.npy")
    frames = random_frames((2, 3, 4), np.uint8)
    for path in (link, dangling):
        write_frames(path, frames)
        assert path.is_symlink()
        assert np.array_equal(read_frames(path).frames, frames)
    assert target.stat().st_mode & 0o777 == 0o604
    assert sorted(os.listdir(tmp_path / "there")) == ["new.npy", "real.npy"]
    loop = tmp_path / "loop.npy"
    loop.symlink_to(loop)
    with pytest.raises(OSError, match="symbolic links"):
        write_frames(loop, frames)
    assert loop.is_symlink()


def test_what_is_no_file_gets_the_bytes(tmp_path):
    fifo = tmp_path / "frames.npy"
    os.mkfifo(fifo)
    frames = random_frames((2, 30, 40), np.uint8)
    with ThreadPoolExecutor(1) as pool:
        read = pool.submit(fifo.read_bytes)
        write_frames(fifo, frames)
        assert np.array_equal(np.load(io.BytesIO(read.result(10))), frames)
    assert stat.S_ISFIFO(fifo.stat().st_mode)
    with atomic_path("/dev/null") as temporary:
        temporary.write_text("gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    with pytest.raises(IsADirectoryError), atomic_path(tmp_path):
        pass
    assert os.listdir(tmp_path) == [fifo.name]


@pytest.mark.parametrize("mode", [0o400, 0o640, 0o755])
def test_a_file_keeps_its_mode_and_its_bytes_where_it_may_not_be_written(tmp_path, mode):
    path = tmp_path / "a.npy"
    path.write_bytes(b"before")
    path.chmod(mode)
    refused = mode == 0o400 and os.geteuid() != 0  # root may write everything
    with pytest.raises(PermissionError) if refused else contextlib.nullcontext():
        write_frames(path, np.zeros((4, 4), np.uint8))
    assert path.stat().st_mode & 0o777 == mode
    assert (path.read_bytes() == b"before") == refused


@pytest.mark.parametrize("length", [251, 252, 255])
def test_the_longest_names_can_be_written(tmp_path, length):
    path = tmp_path / ("n" * (length - 4) + ".npy")
    write_frames(path, np.zeros((4, 4), np.uint8))
    assert os.listdir(tmp_path) == [path.name]


def test_reading_never_warns_of_large_pictures(tmp_path):
    write_frames(tmp_path / "large.png", np.zeros((9500, 9500), np.uint8))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_frames(tmp_path / "large.png").frames.shape == (1, 9500, 9500)


def test_libraries_are_asked_for_when_they_are_missing(tmp_path, monkeypatch):
    write_frames(tmp_path / "p.png", np.zeros((4, 4), np.uint8))
    write_frames(tmp_path / "v.mkv", np.zeros((4, 4), np.uint8))
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(FileError, match=r"needs pillow: pip install pillow"):
        read_frames(tmp_path / "p.png")
    with pytest.raises(FileError, match=r"needs av: pip install av"):
        read_frames(tmp_path / "v.mkv")


def piped(code, *pieces):
    """Output of a program whose standard input gets bytes, each piece when the one before has brought a line."""
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        lines = []
        for piece in pieces:
            process.stdin.write(piece)
            process.stdin.flush()
            lines.append(process.stdout.readline().decode().strip())
        process.stdin.close()
        return lines, process.stdout.read().decode().split("\n")[:-1], process.stderr.read().decode()


SUMS = """
import warnings, sys
from ocisac_fast.files import open_recording
warnings.showwarning = lambda message, *_, **__: print("warning:", message, flush=True)
try:
    with open_recording("-", raw=RAW) as stream:
        for frame in stream:
            print(frame.dtype, frame.shape, int(frame.astype(float).sum()), flush=True)
except ValueError as error:
    print(error)
"""


def test_arrays_by_standard_input_come_frame_by_frame():
    frames = random_frames((3, 7, 5), np.uint16)
    data, size = npy_bytes(frames), frames[0].nbytes
    begin = len(data) - 3 * size
    expected = [f"uint16 (7, 5) {frame.sum()}" for frame in frames]
    pieces = [data[: begin + size], data[begin + size : begin + 2 * size], data[begin + 2 * size :]]
    lines, rest, _ = piped(SUMS.replace("RAW", "None"), *pieces, npy_bytes(np.asfortranarray(frames[1])))
    assert (lines, rest) == ([*expected, expected[1]], [])
    lines, rest, _ = piped(SUMS.replace("RAW", "None"), data[: begin + size + 9])
    assert lines == expected[:1]
    assert rest == [f"standard input: truncated: {size + 9} bytes of numbers, its header announces {3 * size}"]
    _, rest, _ = piped(SUMS.replace("RAW", "None"), data + b"more of it")
    assert rest[-1] == "standard input: after the array: bytes that are no .npy file"


def test_an_mp4_whose_index_is_before_its_frames_is_read_from_a_pipe_as_it_comes(tmp_path):
    """It was spooled to its end, which a live stream has not; what came before the pipe ended is read."""
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w", options={"movflags": "frag_keyframe+empty_moov"}) as container:
        stream = container.add_stream("libx264", rate=30)
        stream.height, stream.width, stream.pix_fmt, stream.options = 48, 64, "yuv420p", {"g": "1"}
        for frame in random_frames((120, 48, 64), np.uint8):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    data, whole = path.read_bytes(), [f"uint8 (48, 64) {frame.sum()}" for frame in read_frames(path).frames]
    begin = data[: len(data) * 3 // 4]
    lines, rest, _ = piped(SUMS.replace("RAW", "None"), begin, data[len(begin) :])
    assert (len(whole), lines + rest) == (120, whole)
    lines, (*rest, last), _ = piped(SUMS.replace("RAW", "None"), begin)
    assert (lines + rest, len(rest) > 80) == (whole[: 1 + len(rest)], True)
    assert last.startswith("warning: standard input: truncated or damaged video")


JOINED = {
    "a.mp4": {},  # the index behind the frames
    "b.mp4": {"movflags": "faststart"},
    "c.mp4": {"movflags": "frag_keyframe+empty_moov"},  # places of fragments within the file
    "d.mp4": {"movflags": "frag_keyframe+empty_moov+default_base_moof"},
    "a.mov": {"movflags": "faststart"},
    "a.asf": {},
    "a.avi": {},
}


@pytest.mark.parametrize("name", JOINED)
def test_a_further_film_is_named_and_left_out(tmp_path, name):
    """Nothing was said of one in a pipe, and fragments of it were read with the index of the first."""
    path = tmp_path / name
    with av.open(str(path), "w", options=JOINED[name]) as container:
        stream = container.add_stream("mpeg4" if name.endswith("asf") else "libx264", rate=30)
        stream.height, stream.width, stream.pix_fmt, stream.options = 48, 64, "yuv420p", {"g": "5"}
        for frame in random_frames((20, 48, 64), np.uint8):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    data = path.read_bytes()
    path.write_bytes(2 * data)
    with pytest.warns(FileWarning, match="a further film after the first, which is left out"):
        assert len(read_frames(path).frames) == 20
    assert cut_recording(path, 5) is None
    path.write_bytes(data + b"\x1a\x45\xdf\xa3\x9f" + bytes(99))  # Matroska
    with pytest.warns(FileWarning, match="a further film after the first, which is left out"):
        assert len(read_frames(path).frames) == 20
    command = [sys.executable, "-c", SUMS.replace("RAW", "None")]
    for films, warned in ((1, []), (2, ["standard input: a further film after the first, which is left out"])):
        done = subprocess.run(command, input=films * data, capture_output=True, check=True, timeout=60, text=False)
        lines = done.stdout.decode().splitlines()
        assert (len(lines[:20]), lines[20:]) == (20, [f"warning: {text}" for text in warned])


@pytest.mark.parametrize("kind", ["PCX", "SGI"])
def test_a_further_picture_of_a_kind_that_ffmpeg_reads_is_named(tmp_path, kind):
    path = tmp_path / "a.picture"
    with image_module.fromarray(random_frames((1, 48, 64), np.uint8)[0]) as image:
        image.save(path, kind)
    assert len(read_frames(path).frames) == 1
    path.write_bytes(2 * path.read_bytes())
    with pytest.warns(FileWarning, match="a further picture after the first, which is left out"):
        assert len(read_frames(path).frames) == 1


def test_further_video_tracks_are_named(tmp_path):
    """The first of them was read, which may be a preview, and nothing was said."""
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        frames = random_frames((12, 48, 64), np.uint8)
        tracks = [container.add_stream("ffv1", rate=30, options={"g": "1"}) for _ in range(2)]
        for track in tracks:
            track.height, track.width, track.pix_fmt = 48, 64, "gray"
        for track, count in zip(tracks, (3, 12), strict=True):
            for frame in frames[:count]:
                container.mux(track.encode(av.VideoFrame.from_ndarray(frame, format="gray")))
            container.mux(track.encode(None))
    with pytest.warns(FileWarning, match=r"a.mkv: video track \d is read, 1 more left out"):
        read_frames(path)
    assert cut_recording(path, 2) is None


def test_what_follows_a_film_in_a_pipe_is_skipped_in_pieces_of_any_size():
    boxes = struct.pack(">I4s16x", 24, b"ftyp") + struct.pack(">I4sQ24x", 1, b"mdat", 40) + b"\0\0\0\x08free"
    for size in (1, 7, 4096):
        pipe = io.BytesIO(boxes + boxes + boxes)
        film = FirstFilm(Prefixed(b"", pipe))
        assert film.is_followed
        film, read = FirstFilm(Prefixed(boxes[:9], io.BytesIO(boxes[9:] + boxes))), b""
        while piece := film.read(size):
            read += piece
        assert (read[: len(boxes)], len(read) < len(boxes) + 24) == (boxes, True)  # less than a head

    class Endless(io.RawIOBase):
        def read(self, size=-1):
            return bytes(np.random.default_rng(1).integers(0, 256, size, np.uint8))

    assert not FirstFilm(Prefixed(boxes, Endless())).is_followed  # no box: nobody waits for the end


def test_many_boxes_of_an_mp4_are_read_together():
    reads = []

    class File(io.BytesIO):
        def read(self, size=-1):
            reads.append(size)
            return super().read(size)

    boxes = 100_000
    file = File(struct.pack(">I4s8x", 16, b"ftyp") + boxes * struct.pack(">I4s", 8, b"free"))
    assert not FirstFilm(file).is_followed
    assert file.tell() == 0
    assert len(reads) < 8 * boxes / 4000
    with pytest.raises(FileError, match="not a picture, a video"):
        open_video(Prefixed(b"", file), "of a pipe")
    assert len(reads) < boxes  # few are looked at


def overwritten(path):
    with path.open("r+b") as file:
        file.write(npy_bytes(random_frames((9, 48, 64), np.uint8, 1)))


def cut(path):
    os.truncate(path, 300)


def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path):
    """The answer was a mixture of two recordings, without a word."""
    path = tmp_path / "a.npy"
    for change in (overwritten, cut):
        write_frames(path, random_frames((9, 48, 64), np.uint8))
        with open_recording(path) as stream:
            next(iter(stream))
            change(path)
            with pytest.raises(FileError, match=f"^{path}: "):
                list(stream)


@pytest.mark.parametrize("suffix", ["npy", "raw"])
@pytest.mark.parametrize(("is_standard", "count"), [(False, 12), (True, 9), (True, 12)])
def test_a_file_that_is_overwritten_is_refused_as_it_grows_and_as_standard_input(
    suffix, is_standard, count, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    frames = [random_frames((number, 48, 64), np.uint8, number) for number in (9, count)]
    before, after = (npy_bytes(each) if suffix == "npy" else each.tobytes() for each in frames)
    path = tmp_path / "a"
    path.write_bytes(before)
    (tmp_path / "-").write_bytes(after)  # no standard input
    with path.open() as opened, monkeypatch.context() as patch:
        patch.setattr(sys, "stdin", opened)
        with open_recording("-" if is_standard else path, raw="64x48" if suffix == "raw" else None) as stream:
            next(iter(stream))
            with path.open("r+b") as file:
                file.write(after)
            with pytest.raises(FileError, match=r"changed while it was read|no .npy file"):
                list(stream)


def test_a_file_that_is_overwritten_is_refused_whose_time_is_as_before(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, random_frames((9, 48, 64), np.uint8))
    time = path.stat().st_mtime_ns
    with open_recording(path) as stream:
        next(iter(stream))
        path.write_bytes(npy_bytes(random_frames((9, 48, 64), np.uint8, 1)))
        os.utime(path, ns=(time, time))
        with pytest.raises(FileError, match="changed while it was read"):
            list(stream)


@pytest.mark.parametrize("then", ["moved", "removed", "replaced"])
@pytest.mark.parametrize("is_overwritten", [False, True])
def test_a_file_that_is_overwritten_is_refused_whatever_becomes_of_its_name(then, is_overwritten, tmp_path):
    path = tmp_path / "a.npy"
    frames = random_frames((9, 48, 64), np.uint8)
    np.save(path, frames)
    with open_recording(path) as stream:
        first = next(iter(stream))
        if is_overwritten:
            with path.open("r+b") as file:
                file.write(npy_bytes(random_frames((9, 48, 64), np.uint8, 1)))
        path.rename(tmp_path / "b.npy")
        if then == "removed":
            (tmp_path / "b.npy").unlink()
        elif then == "replaced":
            np.save(path, frames[:3])
        if is_overwritten:
            with pytest.raises(FileError, match="changed while it was read"):
                list(stream)
        else:
            np.testing.assert_array_equal(np.stack([first, *stream])[1:], frames[1:])


@pytest.mark.parametrize("suffix", ["npy", "raw", "text"])
@pytest.mark.parametrize("head", [0, 3, 5000])
def test_a_pause_of_non_blocking_standard_input_is_no_end(suffix, head, monkeypatch):
    frames = random_frames((9, 48, 64), np.uint8)
    data = npy_bytes(frames) if suffix == "npy" else frames.tobytes()
    reader, writer = os.pipe()
    os.set_blocking(reader, False)

    def write():
        with open(writer, "wb", 0) as file:
            file.write(data[:head])
            time.sleep(0.1)
            file.write(data[head:])

    with open(reader) as pipe, ThreadPoolExecutor() as pool, monkeypatch.context() as patch:
        for name in ("stdin", "__stdin__"):
            patch.setattr(sys, name, pipe)
        pool.submit(write)
        raw = "64x48" if suffix == "raw" else None
        found = read_input("-") if suffix == "text" else read_frames("-", raw=raw).frames.tobytes()
        assert found == frames.tobytes()


def test_a_picture_of_one_frame_refuses_the_second_before_others_are_made(tmp_path):
    frames = iter(np.zeros((9, 4, 4), np.uint8))
    with pytest.raises(FileError, match="several frames"):
        write_frames(tmp_path / "a.png", frames)
    assert len(list(frames)) == 7


def test_a_file_that_grows_moves_or_is_replaced_is_read_as_it_was(tmp_path):
    path = tmp_path / "a.npy"
    frames = random_frames((9, 48, 64), np.uint8)

    def grow():
        with path.open("ab") as file:
            file.write(npy_bytes(frames))

    for change in (
        grow,
        lambda: path.rename(tmp_path / "b.npy"),
        lambda: write_frames(path, frames[:3]),
    ):
        write_frames(path, frames)
        with open_recording(path) as stream:
            first = next(iter(stream))
            change()
            assert np.array_equal([first, *stream][:9], frames)


@pytest.mark.parametrize(("kind", "message"), [("mdat", "an index behind more than 4 MiB"), ("", "not a picture")])
def test_an_mp4_of_a_pipe_without_an_end_is_one_line(kind, message):
    code = "from ocisac_fast.files import read_frames, videos; videos._MOST_SPOOLED = 4 << 20; read_frames('-')"
    pipe = rf"""(printf '\0\0\0\14ftypisom\0\0\0\0{kind}'; cat /dev/zero) | {sys.executable} -c "{code}" """
    done = subprocess.run(["bash", "-c", pipe], capture_output=True, text=True, timeout=60)
    assert f"FileError: standard input: {message}" in done.stderr


@pytest.mark.parametrize(("form", "dtype"), [("5x7", "u1"), ("5x7:gray8", "u1"), ("5x7:gray16le", "<u2")])
def test_raw_frames_by_standard_input_and_from_files(tmp_path, form, dtype):
    frames = random_frames((3, 7, 5), np.dtype(dtype))
    expected = [f"{frame.dtype} (7, 5) {frame.sum()}" for frame in frames]
    data = [frame.tobytes() for frame in frames]
    lines, rest, _ = piped(SUMS.replace("RAW", repr(form)), *data[:2], data[2] + b"rest")
    assert lines == expected
    assert rest == [f"warning: 4 bytes after 3 frames of {frames[0].nbytes} were left out"]
    (tmp_path / "frames.raw").write_bytes(b"".join(data))
    assert np.array_equal(read_frames(tmp_path / "frames.raw", raw=form).frames, frames)
    for left, message in ((data[0][:-1], "truncated"), (b"", "empty")):
        (tmp_path / "frames.raw").write_bytes(left)
        with pytest.raises(FileError, match=message):
            read_frames(tmp_path / "frames.raw", raw=form)


@pytest.mark.parametrize("form", ["", "5", "0x7", "5x7:rgb", "5x7:", "-5x7", "5x7x3"])
def test_raw_formats_that_are_none_are_refused(form):
    with pytest.raises(ValueError, match=r"raw: got .*, allowed: WIDTHxHEIGHT"):
        read_frames("-", raw=form)


@pytest.mark.parametrize("colours", [(), (3,)])
@pytest.mark.parametrize("suffix", [".jpg", ".jpeg"])
def test_jpeg_is_written_nearly_as_it_is(tmp_path, suffix, colours):
    y, x = np.mgrid[:64, :80]
    picture = np.round(120 + 60 * np.sin(y / 9.0) * np.cos(x / 7.0)).astype(np.uint8)
    if colours:
        picture = np.stack([picture, picture // 2, 255 - picture], axis=-1)
    write_frames(tmp_path / f"a{suffix}", [picture])
    (read,) = read_frames(tmp_path / f"a{suffix}").frames
    assert read.shape == picture.shape
    assert np.abs(read.astype(int) - picture).max() <= 6
    with pytest.raises(FileError, match="uint16"):
        write_frames(tmp_path / f"b{suffix}", [picture.astype(np.uint16)])
    with pytest.raises(FileError, match="several frames"):
        write_frames(tmp_path / f"c{suffix}", [picture, picture])


def test_luma_of_a_phone_video_is_of_limited_range(recordings):
    with open_recording(recordings / "phone_video.mp4") as stream:
        assert next(iter(stream)).shape == (1920, 1080)
        assert (stream.response.dark_level, stream.response.white_level) == (16, 235)
        assert (stream.frame_count, round(stream.frame_rate)) == (90, 30)


def test_a_phone_still_says_that_it_is_srgb(recordings):
    recording = read_frames(recordings / "luxapose_rig_a.jpg")
    assert recording.frames.shape == (1, 4352, 7712, 3)
    assert (recording.response.tone_curve, recording.response.stated_by) == ("srgb", "EXIF ColorSpace")


def test_an_array_that_does_not_fit_is_no_success(tmp_path):
    """Files of at most 65,536 bytes; the array has 65,663 with its header."""
    code = (
        "import resource, numpy as np; from ocisac_fast.files import write_frames;"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (65536, 65536));"
        f"write_frames({str(tmp_path / 'a.npy')!r}, [np.zeros((255, 257), np.uint8)])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, "File too large" in done.stderr) == (1, True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "scheme", ["file://", "local://", "simplecache::file://", "simplecache::", "filecache::", "blockcache::", "dir::"]
)
def test_a_file_of_this_machine_has_one_name(tmp_path, scheme):
    write_frames(tmp_path / "a.npy", [np.zeros((9, 9), np.uint8)])
    with pytest.raises(FileError, match="allowed: the path alone of a file of this machine"):
        read_frames(f"{scheme}{tmp_path / 'a.npy'}")


@pytest.mark.parametrize("name", ["mkdir", "open", "fstat", "stat"])
def test_a_signal_while_an_output_is_begun_leaves_no_folder(tmp_path, monkeypatch, name):
    call = getattr(os, name)

    def interrupted(*arguments, **options):
        made = call(*arguments, **options)
        if any(tmp_path.iterdir()):
            raise KeyboardInterrupt
        return made

    monkeypatch.setattr(os, name, interrupted)
    with pytest.raises(KeyboardInterrupt), contextlib.closing(writing._Temporary(tmp_path, "x", ".npy", 0o600)):
        pass
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []


def test_temporary_files_of_many_writers_of_one_name_are_their_own(tmp_path):
    """One that is not locked yet is taken for what a killed process left; another then has its name."""

    def write(_):
        for _ in range(400):
            with contextlib.closing(writing._Temporary(tmp_path, "x", ".npy", 0o600)) as temporary:
                assert os.path.samestat(os.fstat(temporary.file), temporary.path.stat())

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(8)))
    assert list(tmp_path.iterdir()) == []


def test_who_owns_the_folder_cannot_lead_an_output_elsewhere(tmp_path):
    """The temporary's name becomes a link: what it leads to keeps bytes and mode."""
    folder, kept = tmp_path / "out", tmp_path / "kept"
    folder.mkdir()
    kept.mkdir(mode=0o755)
    (kept / "new.npy").write_bytes(b"kept")
    (kept / "new.npy").chmod(0o600)
    (folder / "a.npy").write_bytes(b"old")
    with atomic_path(folder / "a.npy") as temporary:
        (hidden,) = (entry for entry in folder.iterdir() if entry.name.startswith("."))
        hidden.rename(folder / "moved")
        hidden.symlink_to(kept)
        temporary.write_bytes(b"new")
    assert (folder / "a.npy").read_bytes() == b"new"
    assert (kept / "new.npy").read_bytes() == b"kept"
    assert stat.S_IMODE((kept / "new.npy").stat().st_mode) == 0o600


@pytest.mark.parametrize(("name", "curve"), [("p.jpg", "srgb"), ("p.png", "srgb"), ("p.npy", "linear")])
def test_a_film_of_a_picture_states_the_curve_of_its_values(tmp_path, name, curve):
    """It stated linear light, which the values of a JPEG are not."""
    pixels = np.full((32, 48, 3), 120, np.uint8)
    write_frames(tmp_path / name, pixels[np.newaxis])
    with open_recording(tmp_path / name) as source:
        write_frames(tmp_path / "film.mkv", iter(source), frame_rate=30.0, like=source)
    response = read_frames(tmp_path / "film.mkv").response
    assert (response.tone_curve, "transfer characteristics" in response.stated_by) == (curve, True)


class Packet:
    """One that FFmpeg cannot decode."""

    def __init__(self, packet, error):
        self._packet, self._error = packet, error

    def __getattr__(self, name):
        return getattr(self._packet, name)

    def decode(self):
        raise self._error


@pytest.mark.parametrize("first", [0, 2])
@pytest.mark.parametrize(
    ("error", "line"),
    [("BlockingIOError", "this machine starts no further thread"), ("MemoryError", "out of memory")],
)
def test_a_lack_of_the_machine_is_no_damage_of_a_video(first, error, line, tmp_path, monkeypatch, run):
    """Videos were truncated or damaged, or had no frame, where FFmpeg could start no thread."""

    def packets(ending):
        for count, packet in enumerate(before(ending)):
            yield packet if count < first else Packet(packet, getattr(av, error)(11, "lack"))

    path, before = tmp_path / "a.mkv", Ending.packets
    write_frames(path, random_frames((5, 48, 64), np.uint8))
    monkeypatch.setattr(Ending, "packets", packets)
    code, _, err = run("detect", path, "--row-time", "20us")
    assert (code, err[-1]) == (2, f"ocisac: {path}: {line}")
    code, _, err = run("batch", path, "-o", tmp_path / "o", "--workers", 0, "detect", "--row-time", "20us")
    assert (code, err) == (3, [f"ocisac: failed: {path}: {line}"])
