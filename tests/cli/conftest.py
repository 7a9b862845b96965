"""Runs of the command line, and recordings for it."""

import json

import pytest

TESTBED = ("--row-time", "22.2us", "--exposure", "622us")
DARK = ("--dark-level", "16")  # so that noise is not clipped at 0


@pytest.fixture
def run(capsys, monkeypatch):
    """Runs the command line in this process: code, lines of standard output, lines of standard error."""
    import warnings

    from ocisac_fast.cli import main

    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # put back after each run

    def call(*arguments):
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out.splitlines(), captured.err.splitlines()

    return call


@pytest.fixture
def facts(run):
    """Runs a command with --json, which must succeed: its objects."""

    def call(*arguments):
        code, out, err = run(*arguments, "--json")
        assert (code, err) == (0, [])
        return [json.loads(line, parse_constant=pytest.fail) for line in out]

    return call


@pytest.fixture
def square(facts, tmp_path):
    """A recording of a 500 Hz square wave at 622 us as a file of any kind."""

    def make(name, *more):
        light = ("--waveform", "square", "--frequency", "500Hz", "--phase", "1", "--noise", "2", "--columns", 64)
        facts("simulate", *light, *TESTBED, *DARK, *more, "-o", tmp_path / name)
        return tmp_path / name

    return make
