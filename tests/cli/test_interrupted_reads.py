"""Signals that come as FFmpeg reads or seeks: PyAV ignores what their handlers raise, and FFmpeg ends the film."""

from __future__ import annotations

import importlib
import signal
import sys
import time

import click
import numpy as np
import pytest

from ocisac_fast.cli import main
from ocisac_fast.cli.application import run
from ocisac_fast.files import FileWarning, cut_recording, extras, read_frames, write_frames

LIGHT = ("--frequency", "500Hz", "--row-time", "22.2us", "--exposure", "622us")
COMMANDS = {
    "gain": ("gain", "film.mkv", *LIGHT),
    "receive": ("receive", "film.mkv", "--row-time", "22.2us", "--chip-rate", "8kHz"),
    "detect": ("detect", "film.mkv", "--row-time", "22.2us"),
    "clean": ("clean", "film.mkv", "out.mkv", "--row-time", "22.2us"),
    "batch": ("batch", "film.mkv", "-o", "out", "--workers", "0", "--max-frames", "2", "gain", *LIGHT),
}
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


@pytest.fixture
def film(square, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return square("film.mkv", "--frames", 12, "--columns", 480)


def signal_at(monkeypatch, name, number, at):
    """Send a signal as the call is entered, which is where Python handles it."""
    calls = []

    def entered(file, *arguments):
        calls.append(name)
        if len(calls) == at:
            signal.raise_signal(number)
        return own(file, *arguments)

    own = getattr(extras._Read, name, lambda file, *arguments: getattr(file._file, name)(*arguments))
    monkeypatch.setattr(extras._Read, name, entered, raising=False)
    return calls


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("name", "at"), [("read", 1), ("read", 3), ("read", 9), ("seek", 1), ("seek", 2)])
def test_a_signal_as_a_read_begins_ends_the_command(film, monkeypatch, tmp_path, capsys, command, name, at):
    number = list(CODES)[(len(command) + at) % 3]
    calls = signal_at(monkeypatch, name, number, at)
    hooks = sys.unraisablehook, sys.excepthook
    assert main(list(COMMANDS[command])) == CODES[number]
    assert len(calls) >= at
    assert (sys.unraisablehook, sys.excepthook) == hooks
    assert not list(tmp_path.rglob("out*/**/*.parquet"))
    assert not (tmp_path / "out.mkv").exists()
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("number", CODES)
def test_a_signal_as_an_import_ends_ends_the_command(number, capsys, monkeypatch):
    """In a function that each import calls then, Python ignores what is raised: 5 of 1000 signals in a start-up."""
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)

    def entered(frame, event, _):
        if event == "call" and frame.f_code.co_qualname == "_get_module_lock.<locals>.cb":
            sys.setprofile(None)
            signal.raise_signal(number)

    def work():
        sys.setprofile(entered)
        importlib.import_module("colorsys")
        time.sleep(5)

    hook = sys.unraisablehook
    assert run([], click.Command("work", callback=work)) == CODES[number]
    assert sys.unraisablehook == hook
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("read", [read_frames, lambda path: cut_recording(path, 2)])
def test_an_interrupt_as_a_read_begins_is_raised(film, monkeypatch, read):
    signal_at(monkeypatch, "read", signal.SIGINT, 4)
    with pytest.raises(KeyboardInterrupt):
        read(film)
    assert len(read_frames(film).frames) == 12


def test_two_signals_at_once_are_an_interrupt(film, monkeypatch):
    """As of a terminal that closes: the second comes while the first one's exception is reported."""

    def stop(*_):
        signal.raise_signal(signal.SIGINT)  # handled as soon as Python runs anything
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        signal_at(monkeypatch, "read", signal.SIGTERM, 3)
        with pytest.raises(KeyboardInterrupt):
            read_frames(film)
    finally:
        signal.signal(signal.SIGTERM, before)


def test_zeros_behind_a_film_are_not_read_to_their_end(tmp_path, monkeypatch):
    """As of a camera that reserves the file's space and loses its power."""
    path = tmp_path / "film.mkv"
    write_frames(path, np.random.default_rng(0).integers(0, 255, (6, 60, 80), np.uint8))
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.truncate(size + (40 << 20))
    monkeypatch.setattr(extras, "_MOST_BYTES", 1 << 20)
    read = []
    whole = extras._Read.read
    monkeypatch.setattr(extras._Read, "read", lambda file, count: read.append(data := whole(file, count)) or data)
    with pytest.warns(FileWarning, match="film.mkv: truncated or damaged video: 6 frames are whole"):
        assert len(read_frames(path).frames) == 6
    assert sum(map(len, read)) < size + (3 << 20)
    assert cut_recording(path, 2) is None
