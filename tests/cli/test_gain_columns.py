"""Columns of the light that `ocisac gain` measures."""

import json

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast.cli.gain import Light
from ocisac_fast.files import write_frames

COLUMNS = np.arange(40)


@pytest.mark.parametrize(
    "used",
    [COLUMNS >= 0, COLUMNS < 0, COLUMNS >= 35, COLUMNS < 3, COLUMNS // 10 % 2 == 0, COLUMNS * 7 % 5 < 2],
    ids=["all", "none", "last", "first", "blocks", "single ones"],
)
def test_columns_are_those_of_the_light_in_order(used):
    frames = np.random.default_rng(1).integers(0, 255, (3, 7, 40, 2)).astype(np.uint8)
    light = Light("y", 1.0, None, [], 1, used, 0)
    found = light.columns(frames)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, frames[..., 1][..., used])
    runs = np.count_nonzero(np.diff(np.concatenate([[0], used, [0]])) == 1)
    assert np.shares_memory(found, frames) == (runs == 1)


def test_a_film_with_a_cut_is_flagged_and_its_error_is_the_frames_scatter(run, tmp_path):
    camera = ocisac.Camera(22.2e-6, 1e-3, 1 / 30)
    light = 180 * ocisac.integrate_exposure(ocisac.SquareWave(700.0), camera, 480, frames=8)
    light[4:] = 0.4 * light[4:] + 54
    frames = light[:, :, None] + np.random.default_rng(1).normal(0, 1, (8, 480, 40))
    write_frames(tmp_path / "a.npy", np.rint(frames).clip(0, 255).astype(np.uint8))
    code, out, err = run("gain", tmp_path / "a.npy", "--frequency", "700Hz", "--row-time", "22.2us", "--json")
    found = json.loads(out[0])
    assert (code, "model_misfit" in found["flags"]) == (0, True)
    assert found["gain_std"] == pytest.approx(0.3 * found["gain"] / np.sqrt(8), rel=0.6)
    assert "from frame to frame" in err[0]


@pytest.mark.parametrize("kind", ["frozen", "locked", "running"])
def test_errors_that_all_frames_share_are_in_the_standard_error(run, tmp_path, kind):
    """A film that stands still, and a lamp of one phase or of all on rows with a fixed pattern."""
    frames, rows, row_time, exposure = 40, 480, 22.2e-6, 200e-6
    camera = ocisac.Camera(row_time, exposure, frame_time=1 / 30, dark_level=16)
    errors = []
    for seed in range(6):
        random = np.random.default_rng([seed, 7])
        frequency = 30.0 * random.integers(12, 60) + (7.3 if kind == "running" else 0)
        light = 16 + 100 * ocisac.integrate_exposure(ocisac.Tone(frequency), camera, rows, frames=frames)[..., None]
        noise = random.standard_normal((frames, rows, 40))
        pattern = 0 if kind == "frozen" else 1.5 * random.standard_normal((rows, 1))
        pixels = np.rint(light + noise + pattern).clip(0, 255).astype(np.uint8)
        np.save(tmp_path / "film.npy", np.repeat(pixels[:1], frames, 0) if kind == "frozen" else pixels)
        options = ["--row-time", "22.2us", "--exposure", "200us", "--dark-level", "16", "--frame-rate", "30", "--json"]
        _, out, _ = run("gain", tmp_path / "film.npy", "--frequency", f"{frequency}Hz", *options)
        found = json.loads(out[0])
        errors.append((found["gain"] - abs(np.sinc(frequency * exposure))) / found["gain_std"])
    assert np.sqrt(np.mean(np.square(errors))) < 2
