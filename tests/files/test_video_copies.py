"""A processed copy of a video keeps its sound, colours and time stamps."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import warnings
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt
import pytest

from ocisac_fast.files import FileError, FileWarning, open_recording, write_frames

TIMES = [0, 3000, 6100, 12000, 15003]  # of 90 kHz: the rate varies
ROWS, COLUMNS = 120, 160
BT709, BT601, LIMITED, FULL = 1, 6, 1, 2


def picture(k: int) -> npt.NDArray[np.uint8]:
    y, x = np.mgrid[:ROWS, :COLUMNS]
    colours = np.stack([40 + x + 5 * k, 40 + y, 128 + 60 * np.sin(x / 30)], axis=-1)
    return np.clip(colours * (0.7 + 0.3 * np.cos(2 * np.pi * y / 24 + k))[..., None], 0, 255).astype(np.uint8)


def make_video(path: Path, pixels: str, matrix: int, limits: int, sound: str, sound_blocks: int = 9) -> None:
    scaler = {BT709: 1, BT601: 5}[matrix]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"qp": "0", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, pixels
        context = stream.codec_context
        context.color_range, context.colorspace, context.color_trc, context.color_primaries = limits, matrix, 1, 1
        context.time_base = Fraction(1, 90_000)
        audio = container.add_stream(sound, rate=48_000, layout="mono")
        audio.metadata["language"] = "deu"
        for k, time in enumerate(TIMES):
            kept = {"format": pixels, "dst_colorspace": scaler, "dst_color_range": limits}
            frame = av.VideoFrame.from_ndarray(picture(k), format="rgb24").reformat(**kept)
            frame.colorspace, frame.color_range, frame.pts, frame.time_base = matrix, limits, time, Fraction(1, 90_000)
            container.mux(stream.encode(frame))
        for k in range(sound_blocks):
            wave = (3000 * np.sin(np.arange(1024) / 20 + 51.2 * k)).astype(np.int16)
            block = av.AudioFrame.from_ndarray(wave[None], format="s16", layout="mono")
            block.sample_rate, block.pts = 48_000, 1024 * k
            container.mux(audio.encode(block))
        container.mux(stream.encode(None))
        container.mux(audio.encode(None))


def languages_of(path: Path) -> list[str | None]:
    with av.open(str(path)) as container:
        return [stream.metadata.get("language") for stream in container.streams.audio]


def sound_of(path: Path) -> list[bytes]:
    with av.open(str(path)) as container:
        return [bytes(packet) for packet in container.demux() if packet.size and packet.stream.type == "audio"]


def stream_of(path: Path) -> tuple[Any, ...]:
    with av.open(str(path)) as container:
        context = container.streams.video[0].codec_context
        stamps = [float(frame.pts * frame.time_base) for frame in container.decode(video=0)]
        return context.pix_fmt, int(context.color_range), int(context.colorspace), int(context.color_trc), stamps


def frames_of(path: Path, *, colour: bool) -> npt.NDArray[Any]:
    with open_recording(path, colour=colour) as stream:
        return np.stack(list(stream)).astype(float)


@pytest.mark.parametrize(
    ("pixels", "matrix", "limits"),
    [
        ("yuv420p", BT709, LIMITED),
        ("yuvj420p", BT601, FULL),
        ("yuv444p", BT601, LIMITED),
        ("yuv422p10le", BT709, LIMITED),
    ],
)
def test_colours_times_and_sound_are_kept(tmp_path: Path, pixels: str, matrix: int, limits: int) -> None:
    source, target = tmp_path / "in.mp4", tmp_path / "out.mp4"
    make_video(source, pixels, matrix, limits, "aac")
    with open_recording(source, colour=True) as stream:
        write_frames(target, iter(stream), frame_rate=30.0, like=stream)
    kept = stream_of(target)
    assert kept[:4] == (pixels, limits, matrix, 1)
    np.testing.assert_allclose(kept[4], np.array(TIMES) / 90_000, atol=1e-4)
    assert sound_of(target) == sound_of(source)
    assert languages_of(target) == ["deu"]
    before, after = frames_of(source, colour=True), frames_of(target, colour=True)
    scale = 257 if pixels.endswith("10le") else 1
    assert np.abs(after - before).mean() < 1.5 * scale
    # A conversion that rounds down costs 1 each.
    assert np.abs((after - before).mean(axis=(0, 1, 2))).max() < 1.3 * scale
    for name in ("out.mkv", "out.npy"):
        with open_recording(source, colour=True) as stream:
            write_frames(tmp_path / name, iter(stream), frame_rate=30.0, like=stream)
        np.testing.assert_array_equal(frames_of(tmp_path / name, colour=True), before)
    stamps = stream_of(tmp_path / "out.mkv")[4]
    np.testing.assert_allclose(np.diff(stamps), np.diff(TIMES) / 90_000, atol=1.1e-3)  # in ms there


@pytest.mark.parametrize("limits", [LIMITED, FULL])
def test_luma_keeps_its_range(tmp_path: Path, limits: int) -> None:
    source, target = tmp_path / "in.mp4", tmp_path / "out.mp4"
    make_video(source, "yuv420p", BT709, limits, "aac")
    with open_recording(source) as stream:
        write_frames(target, iter(stream), frame_rate=30.0, like=stream)
    with open_recording(source) as one, open_recording(target) as other:
        assert one.response == other.response
    np.testing.assert_array_equal(frames_of(target, colour=False), frames_of(source, colour=False))
    np.testing.assert_allclose(stream_of(target)[4], np.array(TIMES) / 90_000, atol=1e-4)


def test_sound_that_the_kind_of_file_cannot_hold_is_named(tmp_path: Path) -> None:
    source = tmp_path / "in.mkv"
    make_video(source, "yuv420p", BT709, LIMITED, "tta")
    with open_recording(source, colour=True) as stream, pytest.warns(FileWarning, match="sound of tta left out"):
        write_frames(tmp_path / "out.mp4", iter(stream), like=stream)
    assert sound_of(tmp_path / "out.mp4") == []


def test_sound_is_the_films_own_whatever_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_video(tmp_path / "12:30.mkv", "yuv420p", BT709, LIMITED, "aac")
    make_video(tmp_path / "b.mkv", "yuv420p", BT709, LIMITED, "aac", 3)
    (tmp_path / "file:b.mkv").write_bytes((tmp_path / "12:30.mkv").read_bytes())
    monkeypatch.chdir(tmp_path)
    for name in ("12:30.mkv", "file:b.mkv"):
        with open_recording(name, colour=True) as stream:
            write_frames("out.mkv", iter(stream), like=stream)
        assert sound_of(tmp_path / "out.mkv") == sound_of(tmp_path / "12:30.mkv")


def test_the_first_frames_come_with_their_sound(tmp_path: Path) -> None:
    source, target = tmp_path / "in.mp4", tmp_path / "out.mp4"
    make_video(source, "yuv420p", BT709, LIMITED, "aac")
    with open_recording(source, colour=True) as stream:
        write_frames(target, itertools.islice(iter(stream), 2), like=stream)
    assert len(frames_of(target, colour=True)) == 2
    seconds = len(sound_of(target)) * 1024 / 48_000
    assert TIMES[1] / 90_000 < seconds < TIMES[1] / 90_000 + 3 * 1024 / 48_000 < len(sound_of(source)) * 1024 / 48_000


@pytest.mark.parametrize(("sound_blocks", "is_cut"), [(9, False), (60, False), (60, True)])
def test_sound_that_is_longer_than_the_pictures_is_no_damage(tmp_path: Path, sound_blocks: int, is_cut: bool) -> None:
    source = tmp_path / "in.mkv"
    make_video(source, "yuv420p", BT709, LIMITED, "aac", sound_blocks)
    if is_cut:
        source.write_bytes(source.read_bytes()[: source.stat().st_size // 3])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert (len(frames_of(source, colour=False)) == len(TIMES)) != is_cut
    assert bool(said) == is_cut


def test_colours_without_a_video_to_follow_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=re.escape("colour frames (use .mkv or .npy)")):
        write_frames(tmp_path / "out.mp4", [picture(0)])


def test_clean_keeps_them(tmp_path: Path, run: Any) -> None:
    source, target = tmp_path / "in.mp4", tmp_path / "out.mp4"
    make_video(source, "yuv420p", BT709, LIMITED, "aac")
    assert run("clean", source, target, "--scan-axis", "y", "--row-time", "10us")[0] == 0
    assert sound_of(target) == sound_of(source)
    assert stream_of(target)[:4] == ("yuv420p", LIMITED, BT709, 1)
    np.testing.assert_allclose(stream_of(target)[4], np.array(TIMES) / 90_000, atol=1e-4)
    rows = [frames_of(path, colour=True)[..., 1].mean(axis=2) for path in (source, target)]
    bands = [np.abs(np.fft.rfft(each, axis=1)[:, 5]) for each in rows]  # of 24 rows per cycle
    assert (bands[1] < 0.6 * bands[0]).all()


@pytest.mark.parametrize("name", ["in.mkv", "in.mp4"])
def test_sound_of_standard_input_is_kept_or_named(tmp_path: Path, name: str) -> None:
    """A file that is redirected can be opened again, a pipe cannot."""
    make_video(tmp_path / name, "yuv420p", BT709, LIMITED, "aac")
    words = [sys.executable, "-m", "ocisac_fast.cli", "clean", "-", "out.mkv", "--row-time", "22.2us", "--region"]
    words += [f"0,0,{COLUMNS},{ROWS}", "--force"]
    for is_pipe in (False, True):
        with (tmp_path / name).open("rb") as file:
            given: dict[str, Any] = {"input": file.read()} if is_pipe else {"stdin": file}
            done = subprocess.run(words, cwd=tmp_path, capture_output=True, timeout=120, check=False, **given)
        assert done.returncode == 0
        assert sound_of(tmp_path / "out.mkv") == ([] if is_pipe else sound_of(tmp_path / name))
        assert (b"warning: the sound of a pipe is left out, allowed: a file" in done.stderr) == is_pipe


@pytest.mark.parametrize("replace", ["file", "pipe", "folder"])
def test_sound_and_tags_are_those_of_the_file_that_was_opened(tmp_path, replace):
    for name in ("a.mkv", "b.mkv"):
        make_video(tmp_path / name, "yuv420p", BT709, LIMITED, "aac")
    with open_recording(tmp_path / "a.mkv") as stream:
        if replace == "file":
            (tmp_path / "b.mkv").replace(tmp_path / "a.mkv")
        else:
            (tmp_path / "a.mkv").unlink()
            (os.mkfifo if replace == "pipe" else os.mkdir)(tmp_path / "a.mkv")
        with pytest.raises(FileError, match=r"a\.mkv: replaced while it was read"):
            write_frames(tmp_path / "out.mkv", iter(stream), like=stream)
    assert not (tmp_path / "out.mkv").exists()
