"""ocisac-rx where a result is missing or the stream may not be what was stated: why, on standard error."""

import contextlib
import fcntl
import json
import os
import resource
import signal
import subprocess
import threading
import time

import numpy as np
import pytest
from rx import COLUMNS, ROWS, command, recording, run, start

import ocisac_fast as ocisac
from ocisac_fast import Chips, SquareWave

PAYLOAD = b"ab\ncd"
PACKETS = ("--chip-rate", "11.7kHz", "--payload")


@pytest.fixture(scope="module")
def packets():
    sent = ocisac.transmit(PAYLOAD)
    return recording(Chips(sent.chips, 11700.0, repeat=True), 40, dark=15.0, swing=150.0, noise=1.5).tobytes()


# Payloads


@pytest.mark.parametrize(
    ("delimiter", "begin", "end"),
    [((), b"", b"\n"), (("newline",), b"", b"\n"), (("none",), b"", b""), (("length",), b"\0\0\0\5", b"")],
)
def test_payloads_end_with_a_newline_or_nothing_or_begin_with_their_length(receiver, packets, delimiter, begin, end):
    options = ("--delimiter", *delimiter) if delimiter else ()
    done = run(receiver, packets, *PACKETS, "--frame-rate", "30", *options)
    assert (done.returncode, done.stderr) == (0, b"")
    assert set(done.stdout.split(begin + PAYLOAD + end)) == {b""}


def test_a_delimiter_is_of_payloads_alone(receiver):
    done = run(receiver, b"", "--delimiter", "newline")
    assert (done.returncode, done.stderr) == (2, b"ocisac-rx: --delimiter: got no --payload, allowed: --payload\n")


# Times


def with_times(folder, times):
    path = folder / "times.txt"
    path.write_text("# timecode format v2\n" + "".join(f"{time:.3f}\n" for time in times))
    return ("--timestamps", str(path))


@pytest.mark.parametrize("rate", [(), ("--frame-rate", "30")])
def test_times_join_frames_and_count_the_missing(receiver, packets, tmp_path, rate):
    kept = [k for k in range(40) if k not in (3, 4, 11)]
    frames = b"".join(packets[k * ROWS * COLUMNS : (k + 1) * ROWS * COLUMNS] for k in kept)
    times = [5000.0 + 1000.0 * k / 30.0 for k in kept]
    done = run(receiver, frames, *PACKETS[:-1], "--no-gain", *with_times(tmp_path, times), *rate)
    *lines, last = map(json.loads, done.stdout.splitlines())
    assert done.returncode == 0
    assert [line["frame"] for line in lines] == kept
    assert [line["time_s"] for line in lines] == pytest.approx([time / 1e3 for time in times], abs=1e-6)
    assert [line["frames_missing"] for line in lines if line["frames_missing"]] == [2, 1]
    assert last["totals"]["missing"] == 3
    assert last["totals"]["payloads"] > 0


@pytest.mark.parametrize("kind", ["file", "fifo"])
def test_times_are_waited_for_as_a_camera_writes_them(receiver, packets, tmp_path, kind):
    """The file is made with the first frame; a line comes after its frame, and in two parts."""
    path, size = tmp_path / "times.txt", ROWS * COLUMNS
    if kind == "fifo":
        os.mkfifo(path)
    with start(receiver, "--no-bits", "--timestamps", path, stderr=None) as program, path.open("w") as times:
        assert program.stdin is not None
        for k in range(4):
            program.stdin.write(packets[k * size : (k + 1) * size])
            program.stdin.flush()
            for part in (f"{k}", "0.5\n"):
                time.sleep(0.05)
                print(part, end="", file=times, flush=True)
        *lines, last = map(json.loads, program.communicate(timeout=60)[0].splitlines())
    assert [line["time_s"] for line in lines] == [0.0005, 0.0105, 0.0205, 0.0305]
    assert (last["totals"]["frames"], last["totals"]["missing"], program.returncode) == (4, 0, 0)


@pytest.mark.parametrize("order", [["frames", "times"], ["times", "frames"]])
def test_pipes_of_frames_and_times_are_opened_in_any_order(receiver, packets, tmp_path, order):
    """The writer opens one after the other, each when the receiver has: they waited for each other."""
    for name in order:
        os.mkfifo(tmp_path / name)
    with start(receiver, "--timestamps", tmp_path / "times", tmp_path / "frames", preexec_fn=_heed) as program:
        arguments = tmp_path, order, packets[: ROWS * COLUMNS]
        threading.Thread(target=_write_pipes, args=arguments, daemon=True).start()
        try:
            out, err = program.communicate(timeout=20)
        finally:
            program.kill()
    assert (json.loads(out.splitlines()[0])["time_s"], program.returncode, err) == (0.005, 0, b"")


def _write_pipes(folder, order, frame):
    with contextlib.ExitStack() as opened:
        pipes = {name: opened.enter_context((folder / name).open("wb", buffering=0)) for name in order}
        pipes["frames"].write(frame)
        pipes["times"].write(b"5\n")


@pytest.mark.parametrize(
    ("times", "message"), [([0.0], "fewer times than frames"), ([10.0, 5.0, 20.0], "ascending times in ms, one a line")]
)
def test_times_without_meaning_are_refused(receiver, packets, tmp_path, times, message):
    done = run(receiver, packets[: 3 * ROWS * COLUMNS], *PACKETS, *with_times(tmp_path, times))
    assert done.returncode == 2
    assert message in done.stderr.decode()
    done = run(receiver, packets, *PACKETS, *with_times(tmp_path, [1e299, 1e300, 1e301]))
    assert b"ascending times" in done.stderr
    assert run(receiver, packets, *PACKETS, "--timestamps", str(tmp_path / "none")).returncode == 1


@contextlib.contextmanager
def _comments(path, text):
    """A writer of times whose pipe is always full of lines without one, until its reader goes."""

    def write():
        with contextlib.suppress(BrokenPipeError), path.open("wb", buffering=0) as times:
            fcntl.fcntl(times, fcntl.F_SETPIPE_SZ, 1 << 20)
            while True:
                times.write(text)

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    yield
    writer.join(timeout=10)


_WRITERS = {
    "none": lambda _: contextlib.nullcontext(),
    "silent": lambda path: path.open("w"),
    "comments": lambda path: _comments(path, b"#\n" * 500_000),
    "empty": lambda path: _comments(path, b"\n" * 500_000),
}


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("writer", _WRITERS)
def test_a_signal_ends_the_wait_for_times(receiver, packets, tmp_path, writer, number):
    path = tmp_path / "times"
    os.mkfifo(path)
    with start(receiver, "--timestamps", path, preexec_fn=_heed) as program, contextlib.ExitStack() as killed:
        killed.callback(program.kill)
        program.stdin.write(packets[: ROWS * COLUMNS])
        program.stdin.flush()
        with _WRITERS[writer](path):
            time.sleep(0.5)
            program.send_signal(number)
            _, err = program.communicate(timeout=10)
    assert (program.returncode, err) == (0, b"")


def _heed():
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs ignore it


@pytest.mark.parametrize("writer", ["silent", "comments"])
def test_a_writer_without_times_is_an_error_after_a_while(receiver, packets, tmp_path, writer):
    os.mkfifo(tmp_path / "times")
    times = tmp_path / "times"
    with start(receiver, "--timestamps", times, stdout=None) as program, contextlib.ExitStack() as killed:
        killed.callback(program.kill)
        with _WRITERS[writer](times):
            _, err = program.communicate(packets[: ROWS * COLUMNS], timeout=10)
    assert program.returncode == 2
    assert b"fewer times than frames" in err


def test_a_file_of_times_without_lines_takes_no_memory(receiver, packets):
    done = subprocess.run(
        command(receiver, "--timestamps", "/dev/zero"),
        input=packets[: ROWS * COLUMNS],
        capture_output=True,
        timeout=20,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30)),
    )
    message = b"ocisac-rx: --timestamps: got /dev/zero, allowed: a file with lines of fewer than 4096 characters\n"
    assert (done.returncode, done.stderr) == (2, message)


# Why there is nothing


@pytest.mark.parametrize(
    ("frames", "options", "why"),
    [
        (1, ("--frame-rate", "30"), "headers of 1 blocks, "),
        (6, ("--line-code", "8b10b"), "but no header of a packet; --line-code, --block-bytes, --lengthened"),
        (6, ("--line-code", "8b10b"), "packets are joined over frames with --frame-rate only"),
        (6, ("--frame-rate", "30", "--block-bytes", "200"), "a block of 200 bytes is 3246 chips, a frame shows 187"),
    ],
)
def test_why_there_is_no_payload(receiver, packets, frames, options, why):
    done = run(receiver, packets[: frames * ROWS * COLUMNS], *PACKETS, *options)
    assert (done.returncode, done.stdout) == (3, b"")
    begin = f"ocisac-rx: no payload in {frames} frame{'s' * (frames > 1)}: chips in {frames} of them, "
    assert done.stderr.decode().startswith(begin)
    assert why in done.stderr.decode()


def test_without_a_light_there_is_no_payload(receiver):
    done = run(receiver, bytes(3 * ROWS * COLUMNS), *PACKETS)
    assert (done.returncode, done.stdout) == (3, b"")
    assert done.stderr.decode().startswith("ocisac-rx: no payload in 3 frames: no light with chips was found; ")


# Size and format of raw frames


def scene(frames, rng, columns=240, texture=30.0):
    """(frames, rows, columns) of a tone's bands on a still texture; (rows, columns / 2) of its two colour planes."""
    picture = rng.normal(0, texture, (ROWS // 16, columns // 8)).repeat(16, 0).repeat(8, 1)
    wave = SquareWave(500.0, phase=rng.uniform(0, 6))
    bands = recording(wave, frames, dark=15.0, swing=100.0, noise=1.5, columns=columns).astype(float)
    colour = rng.normal(128, texture / 2, (2, ROWS // 16, columns // 16)).repeat(8, 1).repeat(8, 2)
    return (bands + 40 + picture).clip(0, 255).astype(np.uint8), colour.clip(0, 255).astype(np.uint8)


def gray8(luma, _):
    return luma.tobytes()


def yuv420p(luma, colour):
    return b"".join(frame.tobytes() + colour.tobytes() for frame in luma)


def nv12(luma, colour):
    return yuv420p(luma, np.moveaxis(colour, 0, -1))


def yuyv(luma, colour):
    pairs = np.moveaxis(colour, 0, -1).repeat(2, 0).reshape(luma.shape[1:])
    return np.stack([luma, np.broadcast_to(pairs, luma.shape)], axis=-1).tobytes()


def gray10le(luma, _):
    return (luma.astype("<u2") * 4 + 1).tobytes()


KINDS = {"gray8": gray8, "yuv420p": yuv420p, "nv12": nv12, "yuyv": yuyv, "gray10le": gray10le}


@pytest.mark.parametrize("texture", [0.0, 10.0, 40.0])
@pytest.mark.parametrize("sent", KINDS)
@pytest.mark.parametrize("stated", ["gray8", "yuv420p", "gray16le"])
def test_a_format_that_was_forgotten_is_warned_of(receiver, stated, sent, texture):
    luma, colour = scene(12, np.random.default_rng(0), texture=texture)
    done = run(receiver, KINDS[sent](luma, colour), "--no-bits", "--format", stated, width=240)
    same = sent == stated or {sent, stated} == {"yuv420p", "nv12"}
    same |= stated == "gray16le" and sent in ("yuyv", "gray10le")  # of the same size
    found = [line for line in done.stderr.decode().splitlines() if "may be meant" in line]
    if same:
        assert found == []
    elif texture > 0.0:  # a light that fills the picture evenly hides other formats, but not grey chroma
        assert len(found) == 1
        assert sent in found[0]


def test_grey_chroma_is_noticed_where_the_light_fills_the_picture(receiver):
    luma, _ = scene(12, np.random.default_rng(0), texture=0.0)
    chroma = np.full((2, ROWS // 2, 120), 128, np.uint8)
    done = run(receiver, yuv420p(luma, chroma), "--no-bits", width=240)
    assert done.stderr == (
        b"ocisac-rx: warning: successive frames of 240x720 in gray8 differ as parts of other frames do: "
        b"--format yuv420p or nv12 may be meant\n"
    )


@pytest.mark.parametrize("texture", [3.0, 10.0, 40.0])
@pytest.mark.parametrize(("columns", "stated"), [(160, 64), (160, 96), (320, 200), (320, 320), (160, 160)])
def test_another_width_is_warned_of(receiver, columns, stated, texture):
    """A whole number of frames of either size: the length of the stream tells nothing."""
    luma, _ = scene(2 * stated // 8, np.random.default_rng(1), columns, texture)
    done = run(receiver, luma.tobytes(), "--no-bits", width=stated)
    found = [line for line in done.stderr.decode().splitlines() if "--size or --stride may be wrong" in line]
    assert len(found) == (columns != stated)
    if found:
        assert int(found[0].partition("distance of ")[2].partition(" bytes")[0]) % columns == 0


@pytest.mark.parametrize(
    "name", ["mains_dark_room.png", "laser_stripes_cup.png", "fabric_wall.png", "lcd_no_bands.png"]
)
def test_width_and_format_of_real_recordings_are_doubted_where_they_are_wrong(receiver, recordings, name):
    from ocisac_fast.files import read_frames

    picture = read_frames(recordings / "world" / name).frames[0]
    picture = picture if picture.ndim == 2 else picture[..., 1]
    rows, columns = (size // 4 * 4 for size in picture.shape)
    stream = np.repeat(picture[np.newaxis, :rows, :columns], 8, 0).astype(np.uint8)
    words = ["--size", f"{columns}x{rows}", "--row-time", "22.2us", "--no-bits"]
    done = subprocess.run([receiver, *words], input=stream.tobytes(), capture_output=True, timeout=60, check=False)
    assert b"may be wrong" not in done.stderr
    for sent in (stream, stream.astype("<u2") * 256 + stream[:, ::-1]):
        wide = [receiver, *words, "--format", "gray16le"]
        done = subprocess.run(wide, input=sent.tobytes(), capture_output=True, timeout=60, check=False)
        assert (b"--format gray8 may be meant" in done.stderr) == (sent is stream)
        assert done.returncode == 0


def test_a_still_dark_scene_is_not_warned_of(receiver):
    frames = np.random.default_rng(0).normal(16, 1.5, (8, ROWS, 240)).clip(0, 255).astype(np.uint8)
    assert run(receiver, frames.tobytes(), "--no-bits", width=240).stderr == b""


def test_a_file_that_is_no_whole_number_of_frames_is_warned_of(receiver, tmp_path):
    path = tmp_path / "lamp.raw"
    path.write_bytes(bytes(3 * COLUMNS * ROWS // 2))
    done = run(receiver, b"", path, "--no-bits")
    first, *_ = done.stderr.decode().splitlines()
    assert first == (
        "ocisac-rx: warning: 43200 bytes are no whole number of frames of 40x720 in gray8 (28800 bytes each): "
        "--size or --format may be wrong; gray12p, yuv420p or nv12 would fit"
    )


def test_names_are_of_any_case(receiver, packets):
    upper = (
        "--CHIP-RATE",
        "11.7KHZ",
        "--Payload",
        "--Format",
        "GRAY8",
        "--line-code",
        "Manchester",
        "--frame-rate",
        "30",
    )
    done = run(receiver, packets, *upper, "--Tone-Curve", "LINEAR", "--delimiter", "NEWLINE")
    assert (done.returncode, done.stderr) == (0, b"")
    assert set(done.stdout.split(PAYLOAD + b"\n")) == {b""}


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("--frame-rate", "30", "--exposure", "50"), "an exposure longer than the frame time, "),
        (("--frame-rate", "30", "--chip-rate", "12"), "a chip longer than the frame time, "),
        (("--frame-rate", "1e9", "--exposure", "0"), "rows longer than the frame time, "),
        (("--chip-rate", "12"), ""),
        (("--frame-rate", "30", "--chip-rate", "11.7kHz"), ""),
    ],
)
def test_times_longer_than_the_frame_time_are_warned_of(receiver, packets, options, what):
    found = run(receiver, packets[: 2 * ROWS * COLUMNS], *options).stderr.decode()
    assert found.startswith(f"ocisac-rx: warning: {what}") if what else found == ""
