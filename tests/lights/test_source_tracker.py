"""Lights followed over frames."""

import numpy as np
import pytest
from test_sources import CAMERA, add_lamp, scene, stored

from ocisac_fast import Chips, SourceTracker, SquareWave


def frame_with(places, seed=0, shape=(360, 480)):
    """Lamps (row, column, frequency, swing) of 50 rows; a swing of 0: hidden."""
    picture, random = scene(*shape, seed=seed)
    for row, column, frequency, swing in places:
        if swing:
            add_lamp(picture, row, column, 25, SquareWave(frequency, phase=random.random()), swing=swing)
    return stored(picture)


@pytest.mark.parametrize("full_every", [1, 5])
def test_lights_that_move_and_cross_keep_their_identity(full_every):
    tracker = SourceTracker(CAMERA, full_every=full_every)
    identities = {}
    for k in range(12):
        places = [(150 + k, 60 + 30 * k, 9000.0, 120.0), (230 - k, 420 - 30 * k, 13000.0, 120.0)]
        tracks = tracker.update(frame_with(places, seed=k))
        assert [t.identity for t in tracks] == [0, 1]
        for row, column, frequency, _ in places:
            (track,) = [t for t in tracks if abs(t.frequency / frequency - 1) < 0.05]
            assert track.visible
            assert track.identity == identities.setdefault(frequency, track.identity)
            assert abs(track.source.x + track.source.width / 2 - column) < 26  # one hides the other as they cross
            assert abs(track.source.y + track.source.height / 2 - row) < 26
    assert sorted(round(t.velocity[0], -1) for t in tracks) == [-30.0, 30.0]


def test_a_hidden_light_is_waited_for_and_known_again():
    tracker = SourceTracker(CAMERA, patience=4)
    for k in range(9):
        swing = 0.0 if 3 <= k <= 6 else 120.0
        tracks = tracker.update(frame_with([(180, 80 + 20 * k, 9000.0, swing)], seed=k))
        assert [t.identity for t in tracks] == [0]
        assert tracks[0].hidden == (k - 2 if 3 <= k <= 6 else 0)
        x, y, width, height = tracks[0].region
        assert x <= 80 + 20 * (k + 1) <= x + width
        assert y <= 180 <= y + height
    for k in range(5):
        tracks = tracker.update(frame_with([], seed=20 + k))
    assert tracks == []
    assert [t.identity for t in tracker.update(frame_with([(180, 80, 9000.0, 120.0)]))] == [1]


def test_a_light_that_fades_stays():
    tracker = SourceTracker(CAMERA)
    for k, swing in enumerate((120.0, 60.0, 30.0, 15.0)):
        (track,) = tracker.update(frame_with([(180, 200, 9000.0, swing)], seed=k))
        assert track.visible


def test_a_light_followed_has_a_box_as_good_as_a_full_look_gives():
    """A light that is recognised keeps the size of its first box; the size in full looks changes with the phase."""
    followed, whole = SourceTracker(CAMERA, full_every=100), SourceTracker(CAMERA)
    errors = []
    for k in range(10):
        lamps = [(120 + 5 * k, 80 + 20 * k, 9000.0, 120.0), (250, 300 - 7 * k, 14000.0, 90.0)]
        frame = frame_with(lamps, seed=k)
        pairs = list(zip(followed.update(frame), whole.update(frame), strict=True))
        assert len(pairs) == 2
        for a, b in pairs:
            assert a.visible
            assert abs(a.source.gain - b.source.gain) < 3 * np.hypot(a.source.gain_std, b.source.gain_std)
            row, column, _, _ = min(lamps, key=lambda lamp: abs(lamp[2] - b.frequency))
            errors.append([box_errors(track.source, row, column) for track in (a, b)])
    of_followed, of_whole = np.swapaxes(errors, 0, 1)
    assert of_followed.max() <= 6
    assert of_followed.mean() <= of_whole.mean() + 0.5


def box_errors(source, row, column):
    """Distances of the four edges from those of a lamp of 50 rows."""
    edges = source.x, source.y, source.x + source.width, source.y + source.height
    return [abs(a - b) for a, b in zip(edges, (column - 25, row - 25, column + 25, row + 25), strict=True)]


def test_lights_of_two_frequencies_are_both_seen_while_they_overlap():
    tracker = SourceTracker(CAMERA, full_every=100)
    for k in range(6):
        tracks = tracker.update(
            frame_with([(180, 120 + 15 * k, 9000.0, 120.0), (180, 280 - 15 * k, 14000.0, 120.0)], seed=k)
        )
    assert [(t.identity, t.visible) for t in tracks] == [(0, True), (1, True)]


def test_a_light_that_turns_or_jumps_is_found_in_its_region():
    tracker = SourceTracker(CAMERA, full_every=100)
    for k, column in enumerate((80, 100, 120, 140, 100, 250, 250)):
        (track,) = tracker.update(frame_with([(180, column, 9000.0, 120.0)], seed=k))
        assert track.visible == (k != 5)  # farther than its reach: its region grows
        assert not track.visible or abs(track.source.x + track.source.width / 2 - column) < 6


@pytest.mark.parametrize("full_every", [1, 4])
def test_a_light_that_sends_data_keeps_its_identity(full_every):
    tracker, random = SourceTracker(CAMERA, full_every=full_every), np.random.default_rng(0)
    for k in range(8):
        picture, _ = scene(480, 480, seed=k)
        bits = random.integers(0, 2, 100)
        add_lamp(picture, 240, 200 + 8 * k, 110, Chips(bits.astype(float).tolist(), 1 / (6 * CAMERA.row_time)))
        tracks = tracker.update(stored(picture))
    assert tracks[0].identity == 0
    assert tracks[0].hidden < 4
    assert abs(tracks[0].source.x + tracks[0].source.width / 2 - 250) < 40


def test_frames_may_become_smaller():
    tracker = SourceTracker(CAMERA, full_every=100)
    tracker.update(frame_with([(300, 420, 9000.0, 120.0)]))
    assert [t.visible for t in tracker.update(np.full((40, 30), 20, np.uint8))] == [False]
