"""Recordings for the command line."""

import pytest

TESTBED = ("--row-time", "22.2us", "--exposure", "622us")
DARK = ("--dark-level", "16")  # so that noise is not clipped at 0


@pytest.fixture
def square(facts, tmp_path):
    """A recording of a 500 Hz square wave at 622 us as a file of any kind."""

    def make(name, *more):
        light = ("--waveform", "square", "--frequency", "500Hz", "--phase", "1", "--noise", "2", "--columns", 64)
        facts("simulate", *light, *TESTBED, *DARK, *more, "-o", tmp_path / name)
        return tmp_path / name

    return make
