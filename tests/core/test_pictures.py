"""The read-out axis of the camera, colours told from frames, and cameras without a row time."""

import dataclasses

import numpy as np
import pytest

from ocisac_fast import (
    Camera,
    Chips,
    MultiReceiver,
    Receiver,
    SourceTracker,
    detect_sources,
    find_frequency,
    integrate_exposure,
    receive,
    sense,
    transmit,
)
from ocisac_fast.core.arrays import box_in_time_order, in_stored_order, in_time_order, stored_box

AXES = ["y", "-y", "x", "-x"]
CAMERA = Camera(1e-5, 2e-5, frame_time=1 / 30)


def turned(axis):
    return dataclasses.replace(CAMERA, scan_axis=axis)


def lamp(rows=512, columns=96, box=(20, 100, 40, 300)):
    """A lamp of 5 kHz in a part of the picture, (rows, columns) in time order."""
    x, y, width, height = box
    picture = np.full((rows, columns), 60.0)
    light = 1 + 0.8 * np.sin(2 * np.pi * 5e3 * 1e-5 * np.arange(rows))
    picture[y : y + height, x : x + width] = 60 + 100 * light[y : y + height, None]
    return (picture + np.random.default_rng(1).normal(0, 1, picture.shape)).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("axis", AXES)
def test_views_and_boxes_turn_and_return(axis):
    stored = np.arange(2 * 5 * 7).reshape(2, 5, 7)
    view = in_time_order(stored, axis)
    assert np.shares_memory(view, stored)
    np.testing.assert_array_equal(in_stored_order(view, axis), stored)
    box = (1, 2, 3, 1)
    x, y, width, height = stored_box(box, view.shape[1:], axis)
    part = in_time_order(stored[:, y : y + height, x : x + width], axis)
    np.testing.assert_array_equal(part, view[:, 2:3, 1:4])
    assert box_in_time_order((x, y, width, height), view.shape[1:], axis) == box


@pytest.mark.parametrize("axis", AXES)
def test_boxes_are_in_stored_pixels(axis):
    picture, camera = lamp(), turned(axis)
    stored = in_stored_order(picture, axis)
    (found,), (want,) = detect_sources(stored, camera), detect_sources(picture, CAMERA)
    assert found.region == stored_box(want.region, picture.shape, axis)
    assert found.frequency == want.frequency
    tracker, upright = SourceTracker(camera, full_every=2), SourceTracker(CAMERA, full_every=2)
    for _ in range(2):
        (track,), (other,) = tracker.update(stored), upright.update(picture)
        assert track.visible
        assert track.source.region == stored_box(other.source.region, picture.shape, axis)
    (region,), (same,) = sense(stored, camera), sense(picture, CAMERA)
    assert region.region == stored_box(same.region, picture.shape, axis)


@pytest.mark.parametrize("axis", AXES)
def test_receivers_read_any_read_out(axis):
    light = transmit(b"axis").waveform(8e3)
    camera = turned(axis)
    signal = 40 + 120 * integrate_exposure(light, camera, 600)
    stored = in_stored_order(np.repeat(signal[:, None], 24, axis=1).astype(np.uint8), axis)
    want = receive(signal.astype(np.uint8)[:, None] * np.ones(24, np.uint8), CAMERA)[0].bits
    assert receive(stored, camera)[0].bits == want != ""
    grey = Receiver(camera, chip_rate=8e3).push(stored)
    dark = np.full_like(stored, 60)
    colour = Receiver(camera, chip_rate=8e3).push(np.stack([dark, stored, dark], axis=2))
    box = stored_box((4, 0, 16, 600), (600, 24), axis)
    (of_region,) = MultiReceiver(camera, chip_rate=8e3, regions=[box]).push(stored)
    assert of_region.region == box
    assert grey.bits == colour.bits == of_region.received.bits != ""
    assert colour.colour == 1


def test_colours_and_frames_that_are_clear_are_taken():
    picture = np.random.default_rng(2).integers(0, 255, (64, 48, 3), np.uint8)
    assert {r.frame for r in receive(picture[np.newaxis], CAMERA)} == {0}
    assert {r.frame for r in receive(picture[..., np.newaxis], CAMERA)} == set(range(64))


def test_a_camera_without_row_time_gives_rates_per_row():
    chips = np.random.default_rng(3).integers(0, 2, 200)
    light = Chips(chips, 0.2, repeat=True)
    signal = 40 + 120 * integrate_exposure(light, Camera(1.0, 1.0), 600)
    found = receive(signal, Camera(None))[0]
    assert found.chip_rate == pytest.approx(0.2, rel=1e-2)
    picture = lamp()
    assert find_frequency(picture, Camera(None)).frequency == pytest.approx(0.05, rel=1e-2)
    assert find_frequency(picture, Camera(None)).frequency == find_frequency(picture, Camera(1.0)).frequency
    with pytest.raises(ValueError, match=r"exposure: got 0.001, allowed: None where row_time is None"):
        Camera(None, 1e-3)
