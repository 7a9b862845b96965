"""The C++ executable, run as a process: raw frames in, JSON lines out."""

import base64
import contextlib
import fcntl
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from rx import COLUMNS, EXPOSURE, ROW_TIME, ROWS, command, lines_of, recording, run, start

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, Flag, SquareWave, _core
from ocisac_fast.cleaning import VideoCleaner

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", ["-", "out"])
def test_a_file_that_is_standard_output_is_not_read(name, receiver, tmp_path):
    path = tmp_path / "out"
    path.write_bytes(bytes(ROWS * COLUMNS))
    with open(path, "ab") as out, open(path, "rb") as read:
        pipes = {"stdin": read, "stdout": out, "stderr": subprocess.PIPE, "cwd": tmp_path}
        done = subprocess.run(command(receiver, name), **pipes, timeout=60, check=False)
    assert (done.returncode, b"allowed: another file than standard output" in done.stderr) == (2, True)
    assert path.read_bytes() == bytes(ROWS * COLUMNS)


@pytest.mark.parametrize(("option", "text"), [("--timestamps", b"0\n"), ("--config", b"stats = true\n")])
def test_a_file_that_is_standard_output_is_no_option_s(option, text, receiver, tmp_path):
    """Lines were appended to the times, and read as further ones."""
    path = tmp_path / "out"
    path.write_bytes(text)
    with open(path, "ab") as out:
        pipes = {"input": bytes(2 * ROWS * COLUMNS), "stdout": out, "stderr": subprocess.PIPE, "cwd": tmp_path}
        done = subprocess.run(command(receiver, option, "out"), **pipes, timeout=60, check=False)
    assert (done.returncode, f"{option}: got out, allowed: another file than".encode() in done.stderr) == (2, True)
    assert path.read_bytes() == text


@pytest.mark.parametrize(("dtype", "name", "scale"), [("uint8", "gray8", 200), ("<u2", "gray16le", 40000)])
@pytest.mark.parametrize("frequency", ["500Hz", None])
def test_gains_are_those_of_the_library(receiver, dtype, name, scale, frequency):
    light = SquareWave(500.0, phase=0.3)
    frames = recording(light, 3, dtype, dark=scale / 10, swing=scale, noise=scale / 100)
    told = [] if frequency is None else ["--frequency", frequency]
    options = ["--waveform", "square", "--dark-level", str(scale / 10), "--no-bits", "--format", name, *told]
    done = run(receiver, frames.tobytes(), *options)
    lines, totals = lines_of(done)
    assert [line["frame"] for line in lines] == [0, 1, 2]
    assert (totals["frames"], totals["torn"]) == (3, 0)
    camera = Camera(ROW_TIME, EXPOSURE, dark_level=scale / 10)
    for line, frame in zip(lines, frames, strict=True):
        assert line["frequency_hz"] == pytest.approx(500, rel=1e-3)
        x, y, width, height = line["region"]
        part = frame[y : y + height, x : x + width]
        want = ocisac.tone_gain(part, camera, line["frequency_hz"], waveform="square", pooled=True)
        assert line["gain"] == pytest.approx(float(want.gain), rel=1e-9)
        assert line["gain_std"] == pytest.approx(float(want.gain_std), rel=1e-6)
        assert line["gain"] == pytest.approx(abs(np.sinc(500 * EXPOSURE)), abs=0.02)


def test_a_power_of_the_tone_curve_is_that_of_the_library(receiver):
    stored = np.rint(255 * (recording(SquareWave(500.0)) / 255) ** (1 / 1.8)).astype(np.uint8)
    done = run(receiver, stored.tobytes(), "--frequency", "500Hz", "--tone-curve", "gamma:1.8", "--no-bits")
    camera = Camera(ROW_TIME, EXPOSURE, tone_curve="gamma", gamma=1.8)
    for line, frame in zip(lines_of(done)[0], stored, strict=True):
        x, y, width, height = line["region"]
        want = ocisac.tone_gain(frame[y : y + height, x : x + width], camera, 500.0, pooled=True)
        assert line["gain"] == pytest.approx(float(want.gain), rel=1e-6)


def test_version_and_help(receiver):
    done = subprocess.run([receiver, "--version"], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.startswith(f"ocisac-rx {_core.version()} (")
    assert "SIMD" in done.stdout
    done = subprocess.run([receiver, "--help"], capture_output=True, text=True, timeout=60, check=True)
    shown = ("--row-time TIME", "--region x,y,w,h", "--payload", "--config FILE", "Required", "Exit codes", "lost")
    assert [option for option in shown if option not in done.stdout] == []
    assert [inner for inner in ("ENUM", "FLOAT", "TEXT", "UINT", "[UNIT]", "{") if inner in done.stdout] == []
    assert not done.stderr
    for word in ("--version", "--help"):
        with open("/dev/full", "w") as full:
            done = subprocess.run([receiver, word], stdout=full, stderr=subprocess.PIPE, timeout=60)
        assert (done.returncode, done.stderr) == (1, b"ocisac-rx: output: No space left on device\n")


def test_bits_are_those_that_were_sent(receiver):
    bits = "".join(np.random.default_rng(4).choice(["0", "1"], 500))
    frames = recording(Chips(bits, 2000.0), frames=1)
    (line,), totals = lines_of(run(receiver, frames.tobytes(), "--frequency", "500Hz"))
    assert totals["bits"] == len(line["bits"])
    assert len(line["bits"]) >= int(ROWS * ROW_TIME * 2000) - 2
    assert line["bits"] in bits
    assert line["chip_rate_hz"] == pytest.approx(2000, rel=5e-3)


def test_a_torn_frame_is_told_and_what_came_before_is_kept(receiver):
    frames = recording(SquareWave(500.0)).tobytes()
    done = run(receiver, frames[:-7], "--frequency", "500Hz")
    lines, totals = lines_of(done)
    assert len(lines) == 2
    assert (totals["frames"], totals["torn"]) == (2, 1)
    assert done.stderr.decode().strip() == "ocisac-rx: frame 2 is torn: 28793 of 28800 bytes; left out"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--size", "0x5"], "--size: got 0x5, allowed: WIDTHxHEIGHT"),
        (["--size", "axb"], "--size: got axb"),
        (["--size", "99999x99999"], "allowed: frames of at most 2^30 bytes"),
        (["--row-time", "0"], "--row-time: got 0"),
        (["--row-time", "22.2"], "--row-time: got 22.2, allowed: at most 1 s"),
        (["--row-time", "22parsec"], "--row-time"),
        (["--exposure", "-1us"], "exposure: got -1e-06, allowed: 0 to "),
        (["--frequency", "0"], "frequency: got 0"),
        (["--frequency", "nan"], "--frequency: nan"),
        (["--format", "rgb"], "--format"),
        (["--nonsense"], "--nonsense"),
        (["/nonexistent/frames"], "input: got /nonexistent/frames"),
        (["--region", "0,0,41,720"], "--region: got 0,0,41,720, allowed: inside the picture of 40x720"),
        (["--region", "0,0,0,720"], "--region: got 0,0,0,720, allowed: x,y,w,h"),
        (["--region=-1,0,2,720"], "--region: got -1,0,2,720, allowed: x,y,w,h"),
        (["--region=2,2,-1,2"], "--region: got 2,2,-1,2, allowed: x,y,w,h"),
        (["--region", "0,0,2,720,"], "--region: got 0,0,2,720,, allowed: x,y,w,h"),
        (["--size=-1x-1"], "--size: got -1x-1, allowed: WIDTHxHEIGHT"),
        (["--size=40x-720"], "--size: got 40x-720, allowed: WIDTHxHEIGHT"),
        (["--frames=-1"], "--frames: got -1, allowed: a whole number"),
        (["--stride=-40"], "--stride: got -40, allowed: a whole number"),
        (["--block-bytes=-1"], "--block-bytes: got -1, allowed: a whole number"),
        (["--line-code", "a\x1b[2J\nb"], "a\\x1b[2J\\x0ab"),
        (["--format", "\u009b2Jgrün"], "--format: got \\x9b2Jgrün"),
        (["--stride", "39"], "--stride: got 39, allowed: at least the 40 bytes"),
        (["--tone-curve", "gamma:0"], "--tone-curve: got gamma:0"),
        (["--line-code", "morse"], "morse"),
        (["--no-bits", "--no-gain"], "--no-bits: got with --no-gain"),
        (["--config", "/nonexistent/rx.toml"], "/nonexistent/rx.toml"),
        (["--config", ""], "--config: got no name, allowed: that of a file"),
        (["--timestamps", ""], "--timestamps: got no name, allowed: that of a file"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(receiver, options, message):
    done = run(receiver, bytes(ROWS * COLUMNS), *options)
    assert done.returncode == 2
    assert done.stdout == b""
    assert done.stderr.decode().count("\n") == 1
    assert message in done.stderr.decode()


def test_why_an_input_cannot_be_opened_is_told(receiver):
    words = [receiver, "--size", "40x720", "--row-time", "22.2us", "a" * 300]
    done = subprocess.run(words, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (1, b"")
    assert done.stderr == b"ocisac-rx: " + b"a" * 300 + b": File name too long\n"


def test_a_row_time_is_needed(receiver):
    done = subprocess.run([receiver, "--size", "40x720"], input=b"", capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr == b"ocisac-rx: --row-time is missing: the time from one row to the next, such as 22.2us\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ('region = "-1,-1,2,2"', b"--region: got -1,-1,2,2, allowed: x,y,w,h"),  # would wrap
        ('tone_curve = "srgb"', b"--config: got tone_curve, allowed: names of options, such as row-time"),
        ('[camera]\nrow-time = "1us"', b"--config: got [camera], allowed: names of options, such as row-time"),
        ("frames: 1", b"--config: got frames: 1, allowed: names of options, such as row-time"),
        ("duty=[-", b"duty: got no value, allowed: one in --config"),
        ("duty = []", b"duty: got no value, allowed: one in --config"),
        ('row-time = ["22.2us", "3us"]', b"row-time: got several values, allowed: one in --config"),
    ],
)
def test_bad_values_of_a_file_of_options_are_refused(receiver, tmp_path, options, message):
    config = tmp_path / "rx.toml"
    config.write_text(options + "\n")
    done = run(receiver, bytes(ROWS * COLUMNS), "--config", config)
    assert (done.returncode, done.stdout) == (2, b"")
    assert message in done.stderr


@pytest.mark.parametrize(
    ("header", "message"),
    [
        *((f"W{COLUMNS} H{ROWS} F30:1 I{mark} Cmono", f"interlacing: got {mark}") for mark in "tbm"),
        ("W5 H\x1b[31m3", "height: got \\x1b[31m3, allowed"),
    ],
)
def test_interlaced_video_and_control_characters_of_a_header_are_refused(receiver, header, message):
    done = run(receiver, f"YUV4MPEG2 {header}\nFRAME\n".encode() + bytes(ROWS * COLUMNS))
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.startswith(f"ocisac-rx: YUV4MPEG2 {message}".encode())


@pytest.mark.parametrize("header", [b"YUV4MPEG2 W32768 H32768 Cmono\n", b"P5 32768 16384 65535\n"])
def test_a_header_alone_takes_no_memory(receiver, header):
    command = [receiver, "--row-time", "22.2us"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdin.write(header + b"FRAME\n" + bytes(1 << 20))  # more than a pipe holds: taken when this returns
        process.stdin.flush()
        assert resident(process) < 2**26
        process.kill()


def feed(process, frames):
    with contextlib.suppress(BrokenPipeError):
        for _ in range(10_000):
            os.write(process.stdin.fileno(), frames)


def wait_until_full(pipe):
    """Until no more bytes come into a pipe that nobody reads."""
    waiting = [-1]
    while len(waiting) < 10 or waiting[-1] == 0 or len(set(waiting[-10:])) > 1:
        waiting.append(int.from_bytes(fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)), sys.byteorder))
        time.sleep(0.05)


@pytest.mark.parametrize("attempt", range(3))
def test_a_signal_is_heard_while_the_reader_of_the_output_stalls(receiver, packets, attempt):
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    with start(receiver, "--frequency", "500Hz", stdout=write, stderr=None) as process:
        writer = threading.Thread(target=feed, args=(process, packets.tobytes()))
        writer.start()
        wait_until_full(read)
        filler = os.open(f"/proc/self/fd/{write}", os.O_WRONLY | os.O_NONBLOCK)
        with contextlib.suppress(BlockingIOError):  # no room for the totals either
            while True:
                os.write(filler, b" ")
        time.sleep(0.1 * attempt)
        process.send_signal(signal.SIGTERM)
        try:
            assert process.wait(timeout=3) == 0
        finally:
            process.kill()
            writer.join()
            for end in (read, write, filler):
                os.close(end)


def test_non_blocking_standard_output_is_waited_for(receiver, packets):
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(write, False)
    options = ("--frequency", "500Hz", "--chip-rate", "11.7kHz")
    with start(receiver, *options, stdout=write, stderr=None) as process:
        os.close(write)
        writer = threading.Thread(target=lambda: (process.stdin.write(8 * packets.tobytes()), process.stdin.close()))
        writer.start()
        with open(read, "rb") as output:
            wait_until_full(output)
            lines = [json.loads(line) for line in output]
        writer.join()
        assert process.wait(timeout=30) == 0
    assert [line["frame"] for line in lines[:-1]] == list(range(8 * len(packets)))


@pytest.mark.parametrize(
    ("redirect", "code", "told"),
    [
        ("<&-", 1, "ocisac-rx: input: Bad file descriptor"),
        (">&-", 1, "ocisac-rx: output: Bad file descriptor"),
        ("2>&-", 0, ""),
        ("<&- >&- 2>&-", 1, ""),
    ],
)
def test_closed_standard_descriptors_end_it(receiver, packets, tmp_path, redirect, code, told):
    frames = tmp_path / "frames"
    frames.write_bytes(packets[:1].tobytes())
    options = f"--size {COLUMNS}x{ROWS} --row-time 22.2us --frequency 500Hz --no-bits"
    done = subprocess.run(
        ["sh", "-c", f'"$0" {options} <"$1" {redirect}', receiver, frames], capture_output=True, text=True, timeout=10
    )
    assert (done.returncode, done.stderr.strip()) == (code, told)


def test_an_empty_input_is_refused(receiver):
    done = run(receiver, b"")
    assert (done.returncode, done.stderr) == (2, b"ocisac-rx: no frames: the input is empty\n")


def test_a_dark_frame_is_answered_with_flags(receiver):
    (line,), _ = lines_of(run(receiver, bytes(ROWS * COLUMNS)))
    assert line["gain"] is None
    assert line["bits"] == ""
    assert line["flags"]


PAYLOAD = bytes(range(40)) + "Größe".encode()
PACKETS = ("--chip-rate", "11.7kHz", "--frame-rate", "30Hz")


@pytest.fixture(scope="module")
def packets():
    """(frames, rows, columns) of a light in the middle columns that sends PAYLOAD over and over."""
    sent = ocisac.transmit(PAYLOAD)
    frames = recording(Chips(sent.chips, 11700.0, repeat=True), 40, dark=15.0, swing=150.0, noise=1.5)
    frames[:, :, :8] = frames[:, :, 30:] = 15
    return frames


def to_y4m(frames):
    head = f"YUV4MPEG2 W{COLUMNS} H{ROWS} F30:1 Cmono\n".encode()
    return head + b"".join(b"FRAME\n" + frame.tobytes() for frame in frames)


def to_pgm(frames):
    return b"".join(f"P5\n{COLUMNS} {ROWS}\n255\n".encode() + frame.tobytes() for frame in frames)


def to_yuyv(frames):
    return np.stack([frames, np.full_like(frames, 128)], axis=-1).tobytes()


def to_nv12(frames):
    chroma = np.full((len(frames), ROWS * COLUMNS // 2), 77, np.uint8)
    return np.concatenate([frames.reshape(len(frames), -1), chroma], axis=1).tobytes()


def to_gray10p(frames):
    values = frames.reshape(-1, 4).astype(np.uint16) * 4 + 3
    low = np.full((len(values), 1), 0xFF, np.uint8)
    return np.concatenate([(values >> 2).astype(np.uint8), low], axis=1).tobytes()


def test_a_payload_is_received_and_told_in_full(receiver, packets):
    lines, totals = lines_of(run(receiver, packets.tobytes(), *PACKETS, "--no-gain"))
    told = [line for line in lines if "payload" in line]
    assert base64.b64decode(told[0]["payload_base64"]) == PAYLOAD
    assert told[0]["payload"] == PAYLOAD.decode(errors="replace")
    assert totals["payloads"] == len(told)
    assert totals["payload_bytes"] == len(told) * len(PAYLOAD)
    assert totals["searches"] == 1
    assert all(line["suggested_exposure_s"] == pytest.approx(1 / 11700, rel=0.01) for line in lines)


@pytest.mark.parametrize(
    ("pack", "options"),
    [
        (to_y4m, ()),
        (to_pgm, ()),
        (to_yuyv, ("--format", "yuyv")),
        (to_nv12, ("--format", "nv12")),
        (to_nv12, ("--format", "yuv420p")),
        (to_gray10p, ("--format", "gray10p")),
        (lambda frames: np.flip(frames, 1).tobytes(), ("--scan-axis=-y",)),
        (lambda frames: frames.tobytes(), ("--region", f"6,0,26,{ROWS}")),
    ],
    ids=["y4m", "pgm", "yuyv", "nv12", "yuv420p", "gray10p", "up", "region"],
)
def test_payload_alone_of_every_way_in(receiver, packets, pack, options):
    done = run(receiver, pack(packets), *PACKETS, "--payload", *options)
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split(PAYLOAD + b"\n")) == {b""}


def test_no_payload_is_exit_code_3(receiver, packets):
    done = run(receiver, packets[:1].tobytes(), *PACKETS, "--payload")
    assert (done.returncode, done.stdout) == (3, b"")


def test_options_come_from_a_toml_file(receiver, packets, tmp_path):
    config = tmp_path / "rx.toml"
    config.write_text(
        f'size = "{COLUMNS}x{ROWS}"\nrow-time = "22.2us"\nexposure = "100us"\n'
        'chip-rate = "11.7kHz"\nframe-rate = 30.0\npayload = true\n'
    )
    done = subprocess.run([receiver, "--config", config], input=packets.tobytes(), capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout[: len(PAYLOAD)] == PAYLOAD


def test_stats_tell_latency_and_memory(receiver, packets):
    done = run(receiver, packets.tobytes(), *PACKETS, "--stats")
    stats = json.loads(done.stderr)["stats"]
    latency = stats["latency_s"]
    assert 0 < latency["p50"] <= latency["p99"] <= latency["max"] < 1
    assert 2**20 < stats["peak_memory_bytes"] < 2**25  # below 32 MB


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_order(receiver, packets, number):
    with start(receiver, "--exposure", "100us", *PACKETS) as process:
        process.stdin.write(packets[:2].tobytes() + b"a frame that has begun")
        process.stdin.flush()
        lines = [json.loads(process.stdout.readline()) for _ in range(2)]  # told at once, though the input goes on
        process.send_signal(number)
        rest, problems = process.communicate(timeout=30)
    assert [line["frame"] for line in lines] == [0, 1]
    assert json.loads(rest)["totals"]["frames"] == 2
    assert (process.returncode, problems) == (0, b"")


def test_a_reader_that_goes_ends_it_in_order(receiver, packets):
    with start(receiver, "--exposure", "100us", *PACKETS) as process:
        process.stdin.write(packets[:1].tobytes())
        process.stdin.flush()
        process.stdout.readline()
        process.stdout.close()
        process.stdin.write(packets[1:2].tobytes())
        process.stdin.flush()
        assert process.wait(timeout=30) == 0
        assert process.stderr.read() == b""


def test_a_fifo_is_waited_for(receiver, packets, tmp_path):
    fifo = tmp_path / "frames"
    os.mkfifo(fifo)
    command = [receiver, str(fifo), "--row-time", "22.2us", "--exposure", "100us", *PACKETS, "--payload"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        fifo.write_bytes(to_y4m(packets))
        assert process.communicate(timeout=60)[0][: len(PAYLOAD)] == PAYLOAD


def example_in_c(receiver, name):
    example = Path(receiver).parents[1] / "tests" / f"ocisac_{name}_example"
    if not example.exists():
        pytest.skip("the examples in C are not built beside ocisac-rx")
    return example


def test_the_example_in_c_receives_the_payload(receiver, packets):
    command = [example_in_c(receiver, "receive"), str(COLUMNS), str(ROWS), "22.2e-6", "11700", "30"]
    done = subprocess.run(command, input=packets.tobytes(), capture_output=True, timeout=60, check=True)
    assert done.stdout[: len(PAYLOAD)] == PAYLOAD
    assert len(done.stderr.splitlines()) == len(packets)
    refused = subprocess.run([*command[:3], "0", *command[4:]], input=b"", capture_output=True, timeout=60)
    assert (refused.returncode, refused.stdout) == (2, b"")
    assert b"row_time: got 0" in refused.stderr


def test_the_example_in_c_cleans_frames(receiver):
    """As VideoCleaner does, to the pixel; another ending for bad arguments."""
    boxes = 60 + 25 * (np.add.outer(np.arange(240) // 41, np.arange(160) // 23) % 4)
    tone = [1 + 0.7 * np.cos(2 * np.pi * (np.arange(240) / 37.3 + 0.37 * k)) for k in range(3)]
    noise = np.random.default_rng(3).standard_normal((3, 240, 160))
    frames = np.rint(boxes * np.array(tone)[:, :, None] / 1.7 + noise).clip(0, 255).astype(np.uint8)
    command = [example_in_c(receiver, "clean"), "160", "240", "1e-5", "30"]
    done = subprocess.run(command, input=frames.tobytes(), capture_output=True, timeout=60, check=True)
    cleaner = VideoCleaner(Camera(1e-5, frame_time=1 / 30), level="full")
    expected = np.concatenate([cleaner.push(frame).frames for frame in frames])
    assert np.array_equal(np.frombuffer(done.stdout, np.uint8), expected.ravel())
    assert done.stderr.decode().count("cleaned") == len(frames)
    black = subprocess.run(command, input=bytes(160 * 240), capture_output=True, timeout=60, check=True)
    assert black.stdout == bytes(160 * 240)
    assert black.stderr == b"frame 0: no bands: all rows have the same light, 0 of the light left\n"
    refused = subprocess.run([*command[:3], "0", "30"], input=b"", capture_output=True, timeout=60)
    assert (refused.returncode, refused.stdout) == (2, b"")
    assert b"row_time: got 0" in refused.stderr


def peak_memory(receiver, frames, *options):
    """Bytes, the least of three runs: pages of the program itself, which come by chance, are half a megabyte."""
    peaks = []
    for _ in range(3):
        done = run(receiver, frames, *options, "--stats")
        assert done.returncode == 0, done.stderr
        peaks.append(json.loads(done.stderr)["stats"]["peak_memory_bytes"])
    return min(peaks)


@pytest.mark.parametrize(
    "options", [PACKETS, ("--no-bits", "--frequency", "500Hz", "--region", "8,0,22,720"), (*PACKETS, "--no-gain")]
)
def test_memory_is_bounded(receiver, packets, options):
    turn = packets.tobytes()
    assert peak_memory(receiver, 12 * turn, *options) <= peak_memory(receiver, 3 * turn, *options) + 2**19


def test_both_programs_give_the_same_lines(receiver, packets, tmp_path, run_command):
    """Every key that lines of `ocisac receive --packets --json` and of ocisac-rx share has the same value."""
    two = np.concatenate([packets, np.roll(packets, 7, axis=0)], axis=2)  # a second light beside it
    short = {
        "one": (packets, [], ["--gain"]),
        "up": (np.flip(packets, 1), ["--scan-axis=-y"], ["--gain", "--scan-axis=-y"]),
        "two": (two, ["--no-gain"], []),
        "blind": (packets[:6], ["--no-gain"], []),
        "none": (np.full_like(packets[:12], 15), ["--no-gain"], []),
        "region": (packets, ["--region", f"6,0,26,{ROWS}"], ["--gain", "--source-region", f"6,0,26,{ROWS}"]),
    }
    for name, (frames, rx_options, python_options) in short.items():
        told = ["--row-time", "22.2us", "--exposure", "100us", *(PACKETS if name != "blind" else PACKETS[2:])]
        size = ["--size", f"{frames.shape[2]}x{ROWS}"]
        done = subprocess.run([receiver, *size, *told, *rx_options], input=frames.tobytes(), capture_output=True)
        lines, _ = lines_of(done)
        path = tmp_path / f"{name}.npy"
        np.save(path, np.ascontiguousarray(frames))
        code, out, _ = run_command("receive", path, "--packets", "--json", *told, *python_options)
        assert (code, [json.loads(line) for line in out]) == (0, lines), name
        assert len(lines) >= len(frames), name
        if len(frames) == len(packets):
            assert any("payload" in line for line in lines), name
        assert {line["source"] for line in lines} >= ({0, 1} if name == "two" else {0}), name


def resident(process):
    """Bytes."""
    return int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.nightly
def test_64_bit_arm_gives_the_same_payload_and_numbers(receiver, packets):
    """Cross-built by `make arm64`, run under qemu-user."""
    sysroot, arm = ROOT / "build/arm64/sysroot", ROOT / "build/aarch64/cpp/apps/ocisac-rx"
    if not arm.exists() or shutil.which("qemu-aarch64") is None:
        pytest.skip("make arm64 has not been run")
    libraries = sysroot / "usr/lib/aarch64-linux-gnu"
    folders = (libraries, libraries / "blas", libraries / "lapack", sysroot / "lib" / libraries.name)
    path = ":".join(map(str, folders))
    emulated = ["qemu-aarch64", "-L", str(sysroot), "-E", f"LD_LIBRARY_PATH={path}", str(arm)]
    given = {"input": packets.tobytes(), "capture_output": True, "timeout": 300}
    options = command(receiver, "--exposure", "100us", *PACKETS)[1:]
    outputs = [lines_of(subprocess.run([*program, *options], **given)) for program in ([receiver], emulated)]
    (here, here_totals), (there, there_totals) = outputs
    assert len(here) == len(there)
    for ours, theirs in zip(here, there, strict=True):
        assert ours["bits"] == theirs["bits"]
        assert ours.get("payload_base64") == theirs.get("payload_base64")
        for name in ("rows_per_chip", "snr_db"):
            assert theirs[name] == pytest.approx(ours[name], rel=1e-9)
    assert here_totals["payloads"] == there_totals["payloads"] > 0


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
@pytest.mark.parametrize("form", [["-f", "yuv4mpegpipe"], ["-f", "rawvideo"], ["-f", "image2pipe", "-c:v", "pgm"]])
def test_a_simulated_file_through_ffmpeg(receiver, tmp_path, form, facts):
    """The README's chain: transmit, simulate, ffmpeg, ocisac-rx."""
    (sent,) = facts("transmit", "--text", "hello from a lamp")
    video = tmp_path / "lamp.mkv"
    light = ("--waveform", "chips", "--bits", sent["levels"], "--chip-rate", "11.7kHz", "--swing", 150, "--noise", 2)
    size = ("--rows", ROWS, "--columns", COLUMNS, "--frames", 40, "--frame-rate", 30, "--dark-level", 20)
    facts("simulate", *light, *size, "--row-time", "22.2us", "--exposure", "100us", "-o", video)
    ffmpeg = ["ffmpeg", "-v", "error", "-i", str(video), "-pix_fmt", "gray", *form, "-"]
    with subprocess.Popen(ffmpeg, stdout=subprocess.PIPE) as pipe:
        receiving = [receiver, "--row-time", "22.2us", "--exposure", "100us", *PACKETS, "--payload"]
        if "rawvideo" in form:
            receiving += ["--size", f"{COLUMNS}x{ROWS}"]
        done = subprocess.run(receiving, stdin=pipe.stdout, capture_output=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"hello from a lamp")


def test_a_lamp_out_of_the_laboratory_through_a_codec(receiver, tmp_path, run_command, facts):
    """transmit, simulate with mains hum, jitter, a slow LED, tilt and texture, H.264 at crf 23; then both receivers."""
    av = pytest.importorskip("av")
    from ocisac_fast.files import read_frames

    payload, columns, rows = "hello out of the laboratory", 256, 1080
    timing = ("--row-time", "22.2us", "--exposure", "622us")
    (sent,) = facts("transmit", "--text", payload)
    light = ("--waveform", "chips", "--chip-rate", "8kHz", "--bits", sent["levels"])
    size = ("--rows", rows, "--columns", columns, "--frames", 8, "--swing", 80, "--dark-level", 25, "--noise", 2)
    wrong = ("--rise", 0.3, "--fall", 0.3, "--lamp-width", 80, "--tilt", 3, "--texture", 0.03, "--hum", 0.25)
    recording, video = tmp_path / "lamp.mkv", tmp_path / "lamp.mp4"
    facts("simulate", *light, *timing, *size, *wrong, "--jitter", "50us", "--seed", 3, "-o", recording)
    with av.open(str(video), "w") as out:
        stream = out.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = columns, rows, "yuvj420p"
        stream.options = {"crf": "23", "preset": "medium", "threads": "1"}
        for frame in read_frames(recording).frames:
            out.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="gray")))
        out.mux(stream.encode(None))
    lossy = np.asarray(read_frames(video).frames)
    assert not np.array_equal(lossy, read_frames(recording).frames)
    packets = ("--chip-rate", "8kHz", *timing)
    code, out, _ = run_command("receive", video, "--packets", "--json", *packets)
    assert code == 0
    assert payload in [json.loads(line).get("payload") for line in out]
    words = [receiver, "--size", f"{columns}x{rows}", *packets, "--frame-rate", "30", "--payload"]
    piped = subprocess.run(words, input=lossy.tobytes(), capture_output=True, timeout=120)
    assert piped.returncode == 0, piped.stderr
    assert piped.stdout.decode().startswith(payload)


@pytest.mark.skipif(shutil.which("gst-launch-1.0") is None, reason="GStreamer is not installed")
@pytest.mark.parametrize(
    ("form", "name"), [("GRAY8", "gray8"), ("YUY2", "yuyv"), ("NV12", "nv12"), ("I420", "yuv420p")]
)
def test_frames_through_gstreamer(receiver, packets, tmp_path, form, name):
    stored = tmp_path / "lamp.raw"
    stored.write_bytes(packets.tobytes())
    parse = f"rawvideoparse width={COLUMNS} height={ROWS} format=gray8 framerate=30/1"
    pipeline = f"filesrc location={stored} ! {parse} ! videoconvert ! video/x-raw,format={form} ! fdsink"
    with subprocess.Popen(["gst-launch-1.0", "-q", *pipeline.split()], stdout=subprocess.PIPE) as pipe:
        size = ["--size", f"{COLUMNS}x{ROWS}", "--format", name, "--row-time", "22.2us", "--exposure", "100us"]
        done = subprocess.run(
            [receiver, *size, *PACKETS, "--payload"], stdin=pipe.stdout, capture_output=True, timeout=60
        )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(PAYLOAD)


def test_flags_have_the_same_names_in_python_and_cpp():
    for bit in Flag:
        assert _core.flag_names(int(bit)) == Flag(bit).names()
    assert len(_core.flag_names(0xFFFFFFFF)) == len(list(Flag))


@pytest.mark.parametrize(
    ("path", "code", "message"),
    [
        ("/proc/self/mem", 1, b"ocisac-rx: --config: Input/output error\n"),
        ("/dev/zero", 2, b"ocisac-rx: --config: got a longer file, allowed: at most 1 MiB\n"),
        ("/dev/full", 2, b"ocisac-rx: --config: got a longer file, allowed: at most 1 MiB\n"),
    ],
)
def test_a_file_of_options_that_cannot_be_read_whole_is_refused(receiver, path, code, message):
    if not os.path.exists(path):
        pytest.skip(f"no {path}")
    done = run(receiver, bytes(ROWS * COLUMNS), "--config", path)
    assert (done.returncode, done.stdout, done.stderr) == (code, b"", message)


def test_a_file_size_limit_is_one_line(receiver, tmp_path):
    """SIGXFSZ ended it without a word."""
    with (tmp_path / "out").open("wb") as out:
        done = subprocess.run(
            command(receiver),
            input=recording(SquareWave(500.0), frames=9).tobytes(),
            stdout=out,
            stderr=subprocess.PIPE,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (512, 512)),
            timeout=60,
            check=False,
        )
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert b"File too large" in done.stderr
