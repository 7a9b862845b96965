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
