"""A lamp that shines steadily has no chips, whatever its shape along the rows, and hides none of those that follow."""

import numpy as np
import pytest

from ocisac_fast import Camera, Chips, Receiver, integrate_exposure, transmit

ROWS, ROW_TIME = 900, 22e-6
ALONG = 1 - 0.3 * np.linspace(0, 1, ROWS)  # of the lamp, along the rows
ACROSS = np.exp(-0.5 * ((np.arange(64) - 31.5) / 26) ** 2)


def films(seed, *, rows_per_chip, exposure, steady, frames):
    """Frames of (rows, 64), the first `steady` of which have constant light, and the camera; `exposure` in chips."""
    random = np.random.default_rng(seed)
    camera = Camera(ROW_TIME, exposure * rows_per_chip * ROW_TIME, frame_time=1 / 30)
    chips = Chips(transmit(random.bytes(64)).chips, 1 / (rows_per_chip * ROW_TIME))
    for frame in range(frames):
        light = 1.0 if frame < steady else integrate_exposure(chips, camera, ROWS, start=frame / 30)
        picture = 20 + 120 * np.outer(ALONG * light, ACROSS) + random.normal(0, 2, (ROWS, 64))
        yield np.clip(np.rint(picture), 0, 255).astype(np.uint8), camera


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 29, 30, 35, 49])
def test_steady_light_is_no_chips_that_the_exposure_hides(seed):
    random = np.random.default_rng(seed)
    rows_per_chip, exposure = random.uniform(4.8, 8), 2 * random.uniform(0.97, 1.03)
    for pixels, camera in films(seed, rows_per_chip=rows_per_chip, exposure=exposure, steady=4, frames=4):
        received = Receiver(camera, chip_rate=1 / (rows_per_chip * ROW_TIME)).push(pixels)
        assert not received.bits or received.error_rate > 0.01


@pytest.mark.parametrize("seed", range(6))
def test_chips_after_steady_light_are_read_at_once(seed):
    random = np.random.default_rng(seed)
    rows_per_chip, exposure = random.uniform(5, 8), random.uniform(0.6, 3.8)
    receiver = None
    for frame, (pixels, camera) in enumerate(
        films(seed, rows_per_chip=rows_per_chip, exposure=exposure, steady=6, frames=9)
    ):
        receiver = receiver or Receiver(camera, chip_rate=1 / (rows_per_chip * ROW_TIME))
        received = receiver.push(pixels)
        assert bool(received.bits) == (frame >= 6)
        assert not received.bits or received.error_rate < 0.01
