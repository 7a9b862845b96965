"""`ocisac clean` on films: containers, codecs, time stamps, turn for display, and runs that are stopped."""

from __future__ import annotations

import json
import signal
import struct
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from ocisac_fast.files import read_frames

TURN = (0, 65536, 0, -65536, 0, 0, 120 << 16, 0, 1 << 30)  # as phones held upright write it
TIMES = [0, 3000, 6100, 12000, 15003]  # of 90 kHz: the rate varies
ROWS, COLUMNS = 120, 160
CLEAN = ("--scan-axis", "y", "--row-time", "10us")
CAN_TURN = hasattr(av.video.stream.VideoStream, "set_display_matrix")


def write_film(path, *, codec="libx264", pixels="yuv420p", banded=True, count=5, turned=True):
    y, x = np.mgrid[:ROWS, :COLUMNS]
    random = np.random.default_rng(5)
    with av.open(str(path), "w") as container:
        options = {"libx265": {"x265-params": "log-level=none", "crf": "8"}, "libx264": {"crf": "8"}}
        stream = container.add_stream(codec, rate=30, options=options.get(codec, {}))
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, pixels
        context = stream.codec_context
        context.time_base, context.color_trc, context.colorspace = Fraction(1, 90_000), 13, 1
        context.color_range = 1
        if turned and CAN_TURN:
            stream.set_display_matrix(TURN)
        container.metadata["title"] = "a lamp"
        for k in range(count):
            light = 0.7 + 0.3 * np.cos(2 * np.pi * y / 24 + k) * banded
            scene = np.stack([60 + x * 0.6, 60 + y, 128 + 60 * np.sin(x / 30)], axis=-1) * light[..., None]
            scene += random.normal(0, 1, scene.shape)
            frame = av.VideoFrame.from_ndarray(scene.clip(0, 255).astype(np.uint8), format="rgb24")
            frame = frame.reformat(format=pixels, dst_colorspace="ITU709", dst_color_range="MPEG")
            frame.pts = TIMES[k] if k < len(TIMES) else 3000 * (k + 1)
            frame.time_base = Fraction(1, 90_000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def facts_of(path):
    """Codec, pixel format, transfer, turn and times of a film."""
    with av.open(str(path)) as container:
        context = container.streams.video[0].codec_context
        name = context.codec.name
        frames = list(container.decode(video=0))
        turn = frames[0].side_data.get("DISPLAYMATRIX")
        times = [float(frame.pts * frame.time_base) for frame in frames]
        stated = name, context.pix_fmt, int(context.color_trc), container.metadata.get("title")
        return stated, None if turn is None else struct.unpack("=9i", bytes(turn)), np.array(times)


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
@pytest.mark.parametrize(
    ("codec", "pixels"), [("libx264", "yuv420p"), ("libx265", "yuv420p"), ("libx265", "yuv420p10le")]
)
def test_a_film_stays_what_it_was(tmp_path, run, codec, pixels, suffix):
    source, target = tmp_path / f"in{suffix}", tmp_path / f"out{suffix}"
    write_film(source, codec=codec, pixels=pixels)
    code, out, err = run("clean", source, target, *CLEAN, "--json")
    assert (code, len(out), err) == (0, len(TIMES), ["cleaned 5 of 5 frames"])
    (stated, turn, times), (kept, kept_turn, kept_times) = facts_of(source), facts_of(target)
    assert kept == stated
    np.testing.assert_allclose(kept_times, times, atol=1e-4)
    if CAN_TURN and suffix != ".mkv":
        assert kept_turn == turn == TURN
    assert kept_turn == turn


def test_the_quality_can_be_chosen(tmp_path, run):
    write_film(tmp_path / "in.mp4")
    sizes = []
    for crf in (5, 30):
        assert run("clean", tmp_path / "in.mp4", tmp_path / "out.mp4", *CLEAN, "--crf", crf, "--force")[0] == 0
        sizes.append((tmp_path / "out.mp4").stat().st_size)
    assert sizes[0] > 3 * sizes[1]
    assert run("clean", tmp_path / "in.mp4", tmp_path / "out.mp4", *CLEAN, "--force")[1][-1] == "cleaned 5 of 5 frames"
    code, _, err = run("clean", tmp_path / "in.mp4", tmp_path / "out.mp4", *CLEAN, "--crf", 60, "--force")
    assert code == 2
    assert "--crf" in err[0]


def test_a_film_without_bands_is_not_written_again(tmp_path, run):
    write_film(tmp_path / "in.mp4", banded=False)
    code, out, err = run("clean", tmp_path / "in.mp4", tmp_path / "out.mp4", *CLEAN, "--json")
    reasons = {json.loads(line)["unchanged"] for line in out}
    assert code == 0
    assert "" not in reasons
    code, out, nothing = run("clean", tmp_path / "in.mp4", tmp_path / "out.mp4", *CLEAN)
    assert (code, nothing) == (0, [])
    assert err == out[-1:]
    assert out[-1].startswith("cleaned 0 of 5 frames, 5 unchanged: ")
    assert out[-1].endswith("out.mp4 is not written")
    assert not (tmp_path / "out.mp4").exists()
    (tmp_path / "out.mp4").write_bytes(b"older")
    code, out, _ = run("clean", tmp_path / "in.mp4", tmp_path / "out.mp4", *CLEAN, "--force")
    assert code == 3
    assert out[-1].endswith("out.mp4 is not written, and holds what it held before")
    assert (tmp_path / "out.mp4").read_bytes() == b"older"


def test_unchanged_frames_are_coded_as_they_were_decoded(tmp_path):
    from ocisac_fast.files import open_recording, write_frames

    write_film(tmp_path / "in.mp4")
    with open_recording(tmp_path / "in.mp4", colour=True) as stream:
        write_frames(tmp_path / "out.mp4", iter(stream), like=stream, crf=0)
    planes = []
    for name in ("in.mp4", "out.mp4"):
        with av.open(str(tmp_path / name)) as container:
            planes.append([frame.to_ndarray() for frame in container.decode(video=0)])
    np.testing.assert_array_equal(*planes)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("keep", [False, True])
def test_a_run_that_is_stopped_leaves_nothing_or_a_film_that_plays(tmp_path, keep, number):
    source, target = tmp_path / "in.mp4", tmp_path / "out.mp4"
    write_film(source, count=400)
    command = [sys.executable, "-m", "ocisac_fast.cli", "clean", str(source), str(target), *CLEAN, "--json"]
    with subprocess.Popen(
        command + ["--keep-partial"] * keep, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        first = [process.stdout.readline() for _ in range(3)]  # lines come as frames are done
        assert [json.loads(line)["frame"] for line in first] == [0, 1, 2]
        process.send_signal(number)
        rest, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number, err
    done = 3 + len(rest.splitlines())
    assert done < 400
    assert [path.name for path in Path(tmp_path).iterdir() if path.name.startswith(".")] == []
    assert target.exists() == keep
    if keep:
        assert len(facts_of(target)[2]) == done


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("name", ["in.mkv", "in.npy"])
def test_a_run_that_is_stopped_while_it_waits_for_more_of_a_pipe(tmp_path, name, keep, number):
    """PyAV drops what interrupts its reads: the run went on with the part of the film that was there, as its whole.

    A handler that only notes a signal does not end a read: with --keep-partial the run waited on.
    """
    source, target = tmp_path / name, tmp_path / "out.mkv"
    write_film(tmp_path / "in.mkv", count=60)
    if name == "in.npy":
        np.save(source, read_frames(tmp_path / "in.mkv").frames)
    target.write_bytes(b"before")
    words = ["clean", "-", str(target), *CLEAN, "--json", "--force", *["--keep-partial"] * keep]
    command, pipes = [sys.executable, "-m", "ocisac_fast.cli", *words], dict.fromkeys(("stdin", "stdout", "stderr"), -1)
    with subprocess.Popen(command, **pipes) as process:
        whole = source.read_bytes()
        process.stdin.write(whole[: 3 * len(whole) // 4])
        process.stdin.flush()
        done = [process.stdout.readline() for _ in range(5)]
        time.sleep(2)  # till all that came is decoded
        process.send_signal(number)
        try:
            process.wait(30)  # its input stays open
        finally:
            process.kill()
        rest, err = process.stdout.read(), process.stderr.read()
    assert process.returncode == 128 + number, err
    assert b"Traceback" not in err
    if keep:
        assert len(facts_of(target)[2]) == len(done) + rest.count(b"\n") < 60
    else:
        assert target.read_bytes() == b"before"
