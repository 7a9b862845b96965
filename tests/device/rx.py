"""ocisac-rx as a process that is given frames of a light."""

import json
import subprocess

import numpy as np

import ocisac_fast as ocisac
from ocisac_fast import Camera

ROW_TIME, EXPOSURE, ROWS, COLUMNS = 22.2e-6, 100e-6, 720, 40
CAMERA = Camera(ROW_TIME, EXPOSURE, frame_time=1 / 30)


def command(receiver, *options, width=COLUMNS):
    """The program with the size of its frames and their row time."""
    return [receiver, "--size", f"{width}x{ROWS}", "--row-time", "22.2us", *options]


def run(receiver, frames, *options, width=COLUMNS):
    words = command(receiver, "--exposure", "100us", *options, width=width)
    return subprocess.run(words, input=frames, capture_output=True, timeout=60, check=False)


def start(receiver, *options, **pipes):
    """The program, running; its standard streams are pipes unless they are given."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE) | pipes
    return subprocess.Popen(command(receiver, *options), **pipes)


def lines_of(done):
    """The objects of the frames, and the totals at the end."""
    assert done.returncode == 0, done.stderr
    *frames, last = [json.loads(line) for line in done.stdout.splitlines()]
    return frames, last["totals"]


def recording(waveform, frames=3, dtype="uint8", dark=20.0, swing=200.0, noise=2.0, columns=COLUMNS):
    """(frames, rows, columns) of noisy frames."""
    light = ocisac.integrate_exposure(waveform, CAMERA, ROWS, frames=frames)
    noises = noise * np.random.default_rng(2).standard_normal((frames, ROWS, columns))
    return np.rint(dark + swing * light[:, :, None] + noises).clip(0, np.iinfo(dtype).max).astype(dtype)
