"""Warnings where a result is probably not that of a light."""

import re
from pathlib import Path

import numpy as np
import pytest

from ocisac_fast.files import write_frames

TESTBED = ("--row-time", "22.2us", "--exposure", "2404us")
TEXTURE = "ocisac: warning: columns show the tone at different phases: probably a texture, not a light"
STILL = "ocisac: warning: the tone is at the same rows in all frames: a texture, or a light in step with the frames"

SQUARE_WAVE = "ocisac: warning: the harmonics are those of a square wave, whose gain is another: give --waveform square"


def checkerboard(rng, side):
    row, column = np.mgrid[:480, :640]
    return 30 + 180 * ((row // side + column // side) % 2) + rng.normal(0, 2, (480, 640))


def blocks(rng, side):
    return rng.normal(110, 25, (480 // side, 640 // side)).repeat(side, 0).repeat(side, 1)


@pytest.mark.parametrize(("pattern", "side"), [(checkerboard, 8), (checkerboard, 40), (blocks, 8), (blocks, 20)])
def test_a_pattern_is_no_light(run, tmp_path, pattern, side):
    for seed in range(3):
        path = tmp_path / f"{seed}.png"
        write_frames(path, pattern(np.random.default_rng(seed), side).clip(0, 255).astype(np.uint8))
        code, _, err = run("calibrate", path, "--frequency", "500Hz", "--scan-axis", "y")
        refused = code == 2 and "within the lamp" in err[-1]  # nothing stands out of its noise
        assert refused or (code, err) == (0, [TEXTURE])


def test_stripes_that_stand_still_are_no_light(run, tmp_path):
    rng = np.random.default_rng(0)
    stripes = 100 + 60 * np.sin(np.arange(480) / 8.0)[:, np.newaxis] + rng.normal(0, 2, (6, 480, 64))
    write_frames(tmp_path / "stripes.mkv", stripes.astype(np.uint8))
    assert run("calibrate", tmp_path / "stripes.mkv", "--frequency", "500Hz")[2] == [STILL]


@pytest.mark.parametrize("noise", [1, 12])
def test_a_light_is_a_light(run, square, noise):
    path = square("s.mkv", "--frames", 5, "--noise", noise, "--swing", 100, "--dark-level", 60)
    assert run("calibrate", path, "--frequency", "500Hz")[2] == []
    assert run("gain", path, "--frequency", "0.0111", "--waveform", "square")[2] == []
    doubts = [SQUARE_WAVE] if noise == 1 else []  # else: below the noise
    assert run("gain", path, "--frequency", "0.0111")[2] == doubts


def test_a_tone_in_a_texture_is_not_measured_in_silence(run, tmp_path):
    write_frames(tmp_path / "texture.png", blocks(np.random.default_rng(1), 8).clip(0, 255).astype(np.uint8))
    code, _, err = run("gain", tmp_path / "texture.png", "--frequency", "500Hz", *TESTBED)
    assert (code, len(err)) == (0, 1)
    assert re.fullmatch("ocisac: warning: the tone is [0-9]+ dB below what else varies .*", err[0])


@pytest.mark.parametrize("ambient", [0, 8, 40])
def test_other_light_is_told_by_columns_of_a_lamp_that_fades_out(run, square, ambient):
    """Without it there is no warning; with it the warning has its brightness, and the gain that theory gives."""
    width = ("--lamp-width", 30, "--columns", 96, "--exposure", "400us", "--noise", 2, "--swing", 150)
    for seed in range(4):
        path = square(f"{seed}.png", *width, "--dark-level", 16 + ambient, "--seed", seed, "--force")
        known = ("--waveform", "square", "--row-time", "22.2us", "--exposure", "400us", "--dark-level", 16)
        code, _, err = run("gain", path, "--frequency", "500Hz", *known)
        assert (code, len(err)) == (0, int(ambient > 0))
        if ambient:
            told = re.search(r"about ([0-9.]+) DN are other light .* the gain is ([0-9.]+)$", err[0])
            assert told is not None
            assert float(told[1]) == pytest.approx(ambient, abs=1)
            assert float(told[2]) == pytest.approx(np.sinc(500 * 400e-6), rel=0.02)


def test_the_testbed_needs_a_region(run, facts, tmp_path):
    scene = Path(__file__).parents[2] / "examples" / "testbed.toml"
    (made,) = facts("simulate", scene, "-o", tmp_path / "testbed.png")
    command = ("gain", made["file"], *TESTBED, "--frequency", "500Hz", "--waveform", "square")
    code, _, err = run(*command)
    assert (code, len(err)) == (0, 1)
    assert err[0].endswith("give --region x,y,w,h within the lamp")
    (got,) = facts(*command, "--region", "440,260,200,200")
    assert got["gain"] == pytest.approx(got["theory"], abs=5 * got["gain_std"])
