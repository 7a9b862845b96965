"""`receive` flags bits of rows between which the read-out paused, and no others."""

import numpy as np
import pytest

from ocisac_fast import Camera, Chips, Flag, integrate_exposure, receive

ROWS, ROW_TIME = 900, 20e-6


def frame(seed, pause):
    """(rows, 16) of random chips of 2.5 to 7 rows; rows from a random one on are read `pause` rows later."""
    random = np.random.default_rng(seed)
    rows_per_chip = random.uniform(2.5, 7)
    camera = Camera(ROW_TIME, 0.4 * rows_per_chip * ROW_TIME)
    chips = Chips(random.integers(0, 2, 600), 1 / (rows_per_chip * ROW_TIME))
    lost = round(pause * rows_per_chip)
    light = integrate_exposure(chips, camera, ROWS + lost, start=20 * ROW_TIME)
    at = random.integers(ROWS // 3, 2 * ROWS // 3)
    column = np.r_[light[:at], light[at + lost :]]
    picture = 30 + 150 * column[:, None] + random.normal(0, 2, (ROWS, 16))
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8), camera, lost % rows_per_chip / rows_per_chip


@pytest.mark.parametrize("seed", range(12))
def test_a_pause_that_moves_the_chips_is_flagged(seed):
    pixels, camera, moved = frame(seed, pause=np.random.default_rng(seed + 100).uniform(0.3, 4))
    (found,) = receive(pixels[None], camera)
    if 0.25 < moved < 0.75:  # less is seen where edges are sharp, a whole chip never
        assert found.flags & Flag.MODEL_MISFIT or not found.bits


@pytest.mark.parametrize("seed", range(12))
def test_rows_read_evenly_are_not_flagged(seed):
    pixels, camera, _ = frame(seed, pause=0)
    (found,) = receive(pixels[None], camera)
    assert found.bits
    assert not found.flags & Flag.MODEL_MISFIT
