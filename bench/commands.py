#!/usr/bin/env python3
"""Processor time of commands on a 1080p video, over that of decoding it: gain, receive, detect, sense.

Videos, H.264 as cameras write it: a lamp of 500 px with a tone, or with packets, before a still texture, and one with
a tone in a picture that moves by 4 px a frame. Start-up, in which lights are found and lamps learned, cancels: each
command reads a short and a long cut of a video, and the difference of the least times of several rounds counts.
Decoding is PyAV alone, which makes no array, with as many threads as the commands use: those take processor time too.
"""

from __future__ import annotations

import argparse
import math
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import av
import numpy as np

from ocisac_fast import Camera, Chips, Tone, integrate_exposure
from ocisac_fast.packets import transmit

ROWS, COLUMNS, ROW_TIME, EXPOSURE, RATE, CHIP_RATE, PAN = 1080, 1920, 22.2e-6, 622e-6, 30, 8e3, 4
SHORT = {"tone": 40, "moving": 16, "packets": 76}  # frames; gain selects columns in 32, the payload comes after 54
LIMIT = 0.2  # of decoding
MOVING = "detect, moving"
OWN = {"gain": "tone", "detect": "tone", "sense": "tone", MOVING: "moving", "receive": "packets"}  # videos
DECODE = """import av, sys
file = av.open(sys.argv[1])
file.streams.video[0].thread_type = "AUTO"
for _ in file.decode(video=0): pass"""
CAMERA = ["--row-time", f"{ROW_TIME}", "--exposure", f"{EXPOSURE}", "--scan-axis", "y", "--json"]


def write_video(path: Path, waveform: Tone | Chips, frames: int, pan: int = 0) -> None:
    """A round lamp that shows the waveform, before a texture; both move by ``pan`` columns a frame."""
    random = np.random.default_rng(1)
    y, x = np.mgrid[:ROWS, :COLUMNS]
    coarse = random.normal(0.0, 1.0, (ROWS // 40 + 1, COLUMNS // 40 + 1))
    texture = 70.0 + 12.0 * np.kron(coarse, np.ones((40, 40)))[:ROWS, :COLUMNS]
    lamp = 90.0 * np.clip((260.0 - np.hypot(y - 540.0, x - 900.0)) / 20.0, 0.0, 1.0)
    camera = Camera(ROW_TIME, EXPOSURE, 1.0 / RATE)
    noise = 2.0 * random.standard_normal((ROWS, COLUMNS))
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=RATE, options={"preset": "veryfast", "crf": "20"})
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, "yuv420p"
        for k in range(frames):
            light = integrate_exposure(waveform, camera, ROWS, frames=np.array([k]))[0]
            still = np.roll(texture, pan * k, axis=1) + np.roll(lamp, pan * k, axis=1) * light[:, None]
            picture = still + np.roll(noise, 97 * k, axis=1)
            image = av.VideoFrame.from_ndarray(np.clip(np.rint(picture), 0, 255).astype(np.uint8), format="gray")
            file.mux(stream.encode(image.reformat(format="yuv420p")))
        file.mux(stream.encode())


def seconds_of(command: list[str], path: Path) -> float:
    """Processor time of a process on a recording."""
    run = [str(path) if part == "FILE" else part for part in command]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(run, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(folder: Path, names: list[str], rounds: int, frames: int) -> dict[str, float]:
    """Milliseconds a frame: of decoding each video, and of each command of these."""
    payload = np.random.default_rng(2).bytes(200)
    packets = Chips(transmit(payload).chips, chip_rate=CHIP_RATE, repeat=True)
    videos: dict[str, tuple[Tone | Chips, int]] = {
        "tone": (Tone(500.0), 0),
        "moving": (Tone(500.0), PAN),
        "packets": (packets, 0),
    }
    used = {OWN[name] for name in names}
    paths = {(name, n): folder / f"{name}-{n}.mp4" for name in used for n in (SHORT[name], SHORT[name] + frames)}
    for (name, n), path in paths.items():
        waveform, pan = videos[name]
        write_video(path, waveform, n, pan)
    ocisac = [sys.executable, "-m", "ocisac_fast.cli"]
    decode = [sys.executable, "-c", DECODE, "FILE"]
    commands = {
        "decoding, tone": ("tone", decode),
        "gain": ("tone", [*ocisac, "gain", "FILE", "--frequency", "500", *CAMERA]),
        "detect": ("tone", [*ocisac, "detect", "FILE", *CAMERA]),
        "sense": ("tone", [*ocisac, "sense", "FILE", "--frames", "FRAMES", *CAMERA]),
        "decoding, moving": ("moving", decode),
        MOVING: ("moving", [*ocisac, "detect", "FILE", *CAMERA]),
        "decoding, packets": ("packets", decode),
        "receive": ("packets", [*ocisac, "receive", "FILE", "--packets", "--chip-rate", f"{CHIP_RATE}", *CAMERA]),
    }
    asked = {*names, *(f"decoding, {video}" for video in used)}
    commands = {name: command for name, command in commands.items() if name in asked}
    least = {(name, more): math.inf for name in commands for more in (0, frames)}
    for _ in range(rounds):
        for (name, more), before in least.items():
            video, command = commands[name]
            n = SHORT[video] + more
            now = seconds_of([str(n) if part == "FRAMES" else part for part in command], paths[video, n])
            least[name, more] = min(before, now)
    return {name: 1e3 * (least[name, frames] - least[name, 0]) / frames for name in commands}


def main() -> int:
    """Exit code 1 with --check if a command takes more than a fifth of decoding beside it, except where all moves."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n\n")[0])
    parser.add_argument("--commands", nargs="+", choices=OWN, default=list(OWN))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--frames", type=int, default=90, help="by which the long cut is longer")
    parser.add_argument("--check", action="store_true", help="exit code 1 if a limit is not reached")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = measure(Path(folder), arguments.commands, arguments.rounds, arguments.frames)
    shares = {name: found[name] / found[f"decoding, {OWN[name]}"] - 1 for name in arguments.commands}
    for name, value in found.items():
        share = f"{100 * shares[name]:6.0f} % beside decoding" if name in shares else ""
        print(f"{name:20} {value:7.2f} ms a frame {share}")
    limited = [share for name, share in shares.items() if name != MOVING]
    return 1 if arguments.check and any(share > LIMIT for share in limited) else 0


if __name__ == "__main__":
    sys.exit(main())
