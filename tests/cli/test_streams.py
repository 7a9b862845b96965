"""Standard input, output and error that are closed or full, as under cron, daemons and on full disks."""

import io
import json
import os
import re
import resource
import select
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ocisac_fast.files import read_frames, write_frames
from ocisac_fast.packets.transmission import transmit

OCISAC = [sys.executable, "-m", "ocisac_fast.cli"]
GAIN = ["--frequency", "500Hz", "--row-time", "22.2us", "--exposure", "1ms"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Pictures: a.png, of whose gain is warned since the lamp does not fill the columns, and b.png, where it does."""
    folder = tmp_path_factory.mktemp("streams")
    rows = np.arange(360)[:, np.newaxis]
    light = 60 + 100 * (1 + np.cos(2 * np.pi * 500 * 22.2e-6 * rows)) / 2
    write_frames(folder / "a.png", np.where((rows > 90) & (rows < 270), light, 5).astype(np.uint8).repeat(32, 1))
    write_frames(folder / "b.png", light.astype(np.uint8).repeat(32, 1))
    return folder


def run(folder, words, streams):
    """Exit code and standard error, where it is neither closed nor full."""
    closed = [number for number, state in enumerate(streams) if state == "closed"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*OCISAC, *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=full if streams[1] == "full" else subprocess.DEVNULL,
            stderr=full if streams[2] == "full" else subprocess.PIPE,
            preexec_fn=lambda: [os.close(number) for number in closed],
            timeout=60,
        )
    return done.returncode, (done.stderr or b"").decode()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@pytest.mark.parametrize(
    ("streams", "code"),
    [
        (("closed", "", ""), 0),
        (("", "closed", ""), 0),
        (("", "", "closed"), 0),
        (("closed", "closed", "closed"), 0),
        (("", "full", ""), 2),
        (("", "", "full"), 0),
        (("", "full", "full"), 2),
    ],
)
def test_the_work_is_done_and_the_exit_code_is_right(streams, code, folder):
    found, err = run(folder, ["gain", "a.png", *GAIN], streams)
    assert (found, "Traceback" in err) == (code, False)
    if code == 2 and not streams[2]:
        assert err.splitlines()[-1] == "ocisac: No space left on device"
    assert run(folder, ["detect", "missing.png"], streams)[0] == 2
    (folder / "out.png").unlink(missing_ok=True)
    run(folder, ["clean", "b.png", "out.png", "--row-time", "22.2us"], streams)
    assert (folder / "out.png").stat().st_size > 100


@pytest.mark.parametrize("workers", ["0", "1"])
def test_workers_measure_without_standard_error(workers, folder, tmp_path):
    """They got it closed, and the first file that they opened got its number."""
    words = ["batch", "a.png", "b.png", "-o", str(tmp_path / "o"), "--workers", workers, "gain", *GAIN]
    for streams in (("", "", "closed"), ("closed", "closed", "closed")):
        assert run(folder, [*words[:5], "--again", *words[5:]] if (tmp_path / "o").exists() else words, streams)[0] == 0
        assert len(list((tmp_path / "o").rglob("*-all.parquet"))) == 2


def test_a_closed_output_is_no_file_s_number(folder):
    """The first file that is opened would get number 1, and what a library prints would go into it."""
    program = (
        "import os, sys; from ocisac_fast.cli import main; code = main(sys.argv[1:]); "
        "print('more', flush=True); os.write(1, b'more'); sys.exit(code)"
    )
    words = ["gain", "a.png", *GAIN, "--csv", "out.csv", "--force"]
    unheard = {"stderr": subprocess.DEVNULL, "preexec_fn": lambda: os.close(1)}
    subprocess.run([sys.executable, "-c", program, *words], cwd=folder, timeout=60, check=True, **unheard)
    assert "more" not in (folder / "out.csv").read_text()


@pytest.mark.parametrize(
    ("words", "label"),
    [
        (["gain", "b.png", *GAIN, "--per-column", "/dev/stdout", "--force"], "--per-column"),
        (["gain", "out", *GAIN, "--raw", "6x20"], "FILE"),
        (["receive", "out", "--raw", "6x20", "--row-time", "22.2us", "--json"], "FILE..."),
        (["receive", "-", "--raw", "6x20", "--row-time", "22.2us", "--json"], "FILE..."),
    ],
)
def test_a_file_that_is_standard_output_is_neither_read_nor_replaced(words, label, folder):
    """As input it grew without an end; as an output it was replaced, and what was printed lost."""
    (folder / "out").write_bytes(bytes(24000))
    with open(folder / "out", "ab") as out, open(folder / "out", "rb") as read:
        done = subprocess.run(
            [*OCISAC, *words], cwd=folder, stdin=read, stdout=out, stderr=subprocess.PIPE, text=True, timeout=30
        )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith(f"ocisac: {label}: got ")
    assert "which is standard output too, allowed: another file" in done.stderr
    assert (folder / "out").read_bytes() == bytes(24000)


def test_a_configuration_in_the_working_folder_is_not_read(tmp_path):
    """That of matplotlib is the first that it looks for, before any that a variable names; a pipe is waited for."""
    os.mkfifo(tmp_path / "matplotlibrc")
    words = ["lamp", "--exposures", "1/50s,1/100s", "--plot", "a.png"]
    subprocess.run([*OCISAC, *words], cwd=tmp_path, stdout=subprocess.DEVNULL, check=True, timeout=30)
    assert (tmp_path / "a.png").stat().st_size > 1000


@pytest.mark.parametrize("kind", ["pipe", "device"])
@pytest.mark.parametrize("name", ["fonts", "matplotlibrc", "mine"])
def test_settings_and_a_list_of_fonts_without_an_end_are_refused(name, kind, tmp_path):
    """Those of matplotlib: a pipe was waited for, a device filled memory."""
    from matplotlib.font_manager import FontManager

    path = tmp_path / (f"fontlist-v{FontManager.__version__}.json" if name == "fonts" else name)
    os.mkfifo(path) if kind == "pipe" else path.symlink_to("/dev/zero")
    words = ["lamp", "--exposures", "1/50s,1/100s", "--plot", str(tmp_path / "a.png")]
    done = subprocess.run(
        [*OCISAC, *words],
        env={**os.environ, "MPLCONFIGDIR": str(tmp_path), **({"MATPLOTLIBRC": str(path)} if name == "mine" else {})},
        capture_output=True,
        text=True,
        timeout=30,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30)),
    )
    assert (done.returncode, done.stderr) == (2, f"ocisac: {path}: a pipe or device, allowed: a file, or none\n")


@pytest.mark.parametrize("words", [["info"], ["gain", "b.png", *GAIN], ["clean", "b.png", "c.png"]])
@pytest.mark.parametrize("form", [[], ["--json"]])
def test_a_closed_pipe_has_its_exit_code_and_the_work_is_done(words, form, folder):
    (folder / "c.png").unlink(missing_ok=True)
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as closed:
        assert subprocess.run([*OCISAC, *words, *form], cwd=folder, stdout=closed, timeout=60).returncode == 141
    assert (folder / "c.png").exists() == (words[0] == "clean")


@pytest.fixture(scope="module")
def chips(folder):
    """A payload, and what `ocisac transmit` prints of it: more than a pipe holds."""
    (folder / "payload").write_bytes(bytes(range(250)) * 8)
    write_frames(folder / "b.npy", read_frames(folder / "b.png").frames.repeat(60, 0))
    return subprocess.run([*OCISAC, "transmit", "payload"], cwd=folder, capture_output=True, check=True).stdout


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_pipe_that_takes_a_part_at_a_time_gets_all(unbuffered, chips, folder):
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with open(writer) as pipe, open(reader, "rb") as read:
        child = subprocess.Popen([*OCISAC, "transmit", "payload"], cwd=folder, stdout=pipe, env=environment)
        pipe.close()
        found = read.read(1)
        time.sleep(0.2)  # until the pipe is full
        assert (found + read.read() == chips, child.wait(60)) == (True, 0)


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("words", [["transmit", "payload"], ["receive", "b.npy", "--json"]])
def test_an_output_that_takes_a_part_and_no_more_is_one_line(words, unbuffered, chips, folder):
    limit = (1 << 12,) * 2
    with open(folder / "out", "wb") as out:
        options = {"env": {**os.environ, "PYTHONUNBUFFERED": unbuffered}, "cwd": folder, "timeout": 120}
        options["preexec_fn"] = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        done = subprocess.run([*OCISAC, *words], stdout=out, stderr=subprocess.PIPE, **options)
    assert (done.returncode, done.stderr) == (2, b"ocisac: File too large\n")
    assert (folder / "out").stat().st_size == limit[0]


@pytest.mark.parametrize("command", ["detect", "receive"])
def test_results_in_a_file_are_all_there_beside_progress_on_a_terminal(command, folder, tmp_path):
    """Those printed while the bar was shown went to the terminal."""
    write_frames(tmp_path / "film.npy", np.stack(6 * [read_frames(folder / "b.png").frames[0]]))
    terminal, stderr = os.openpty()
    with open(tmp_path / "out", "w") as out:
        words = [*OCISAC, command, "film.npy", "--row-time", "22.2us", "--json"]
        done = subprocess.run(words, cwd=tmp_path, stdout=out, stderr=stderr, timeout=60, check=False)
    os.close(stderr)
    os.close(terminal)
    frames = [json.loads(line)["frame"] for line in (tmp_path / "out").read_text().splitlines()]
    assert (done.returncode, frames) == (0, [0, 1, 2, 3, 4, 5])


@pytest.fixture(scope="module")
def frames():
    """Frames of 8 columns and 480 rows with packets of 15 000 chips per second; an exposure of 44.4 us."""
    chips = transmit(b"Hello").chips.astype(float)
    light = chips[(np.arange(2500 * 480 * 4) * 22.2e-6 / 4 * 15e3).astype(int) % len(chips)]
    rows = np.convolve(light, np.ones(8) / 8, "same")[::4].reshape(-1, 480, 1)
    return (40 + 150 * rows + np.random.default_rng(1).normal(0, 1, (2500, 480, 8))).astype(np.uint8)


STREAM = ["--row-time", "22.2us", "--chip-rate", "15kHz", "--packets"]


@pytest.mark.parametrize(("words", "ahead"), [(["receive", *STREAM], 0), (["detect", "--row-time", "22.2us"], 8)])
def test_rows_of_a_live_stream_are_printed_as_they_come(words, ahead, frames):
    """Those of `receive` were kept to the end; after an interrupt `detect` had no summary."""
    command = [*OCISAC, words[0], "-", "--raw", "8x480", *words[1:]]
    heard = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731 - a shell's background jobs ignore it
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, preexec_fn=heard, **pipes) as child:
        shown, deadline = b"", time.monotonic() + 30
        for number in (7, 15):  # its row is there before the next frame, of `detect` some frames later
            child.stdin.write(frames[number - 7 + ahead * (number > 7) : number + 1 + ahead].tobytes())
            child.stdin.flush()
            while not re.search(rf"(?m)^ +(frame )?{number} ".encode(), shown):
                assert select.select([child.stdout], [], [], max(deadline - time.monotonic(), 0))[0], shown
                piece = os.read(child.stdout.fileno(), 1 << 16)
                assert piece, child.stderr.read()
                shown += piece
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=20)
    assert (child.returncode, err, b"frames" in out) == (130, b"", True)


PEAK = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.parametrize("options", [[], ["--table", "t.csv"]])
def test_memory_does_not_grow_with_a_stream(options, frames, tmp_path):
    """It grew by 13.5 KB a frame, with a table by 4 KB."""
    most = []
    for count in (100, 2500):
        frames[:count].tofile(tmp_path / "film")
        words = [*OCISAC, "receive", "film", "--raw", "8x480", *STREAM, "--force", *options]
        done = subprocess.run([sys.executable, "-c", PEAK, *words], cwd=tmp_path, stdout=subprocess.PIPE, check=True)
        most.append(int(done.stdout))
    assert most[1] - most[0] < 6000  # KiB


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("words", [STREAM, STREAM[:-1]])
def test_what_came_before_a_signal_is_printed(words, number, frames):
    """First rows that wait for others, and frames that were gathered, were lost; the header announces more of them."""
    command = [*OCISAC, "receive", "-", *words]
    heard = lambda: signal.signal(number, signal.SIG_DFL)  # noqa: E731 - a shell's background jobs ignore some
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    announced = io.BytesIO()
    np.save(announced, frames[:30])
    with subprocess.Popen(command, preexec_fn=heard, **pipes) as child:
        child.stdin.write(announced.getvalue()[: -24 * frames[0].nbytes])
        child.stdin.flush()
        time.sleep(3)  # till all of it is read
        child.send_signal(number)
        out, err = child.communicate(timeout=20)
    assert (child.returncode, err, out.count(b" dB ")) == (128 + number, b"", 6)


@pytest.mark.parametrize("words", [STREAM, STREAM[:-1]])
def test_what_came_before_an_error_is_printed(words, frames, tmp_path):
    np.save(tmp_path / "film.npy", frames[:30])
    with open(tmp_path / "film.npy", "ab") as film:
        film.write((tmp_path / "film.npy").read_bytes()[:-1])
    done = subprocess.run([*OCISAC, "receive", tmp_path / "film.npy", *words], capture_output=True, timeout=60)
    assert (done.returncode, done.stdout.count(b" dB "), b"truncated" in done.stderr) == (2, 59, True)
