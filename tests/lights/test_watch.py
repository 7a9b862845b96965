"""The lights of every frame of a video, searched now and then and followed in between."""

import numpy as np
import pytest
from test_sources import CAMERA, add_lamp, scene, stored

from ocisac_fast import Camera, Chips, SquareWave, detect_sources
from ocisac_fast.lights import tracker
from ocisac_fast.lights.recognition import KnownLight
from ocisac_fast.lights.watch import watch_lights

SHAPE = (360, 480)


def frame_of(places, seed=0, texture=0.0, shape=SHAPE):
    """Lamps (row, column, frequency, swing) of 50 rows before a still texture, with a phase and noise of this frame."""
    picture, random = scene(*shape, seed=seed)
    blocks = np.random.default_rng(99).normal(0.0, texture, (shape[0] // 20 + 1, shape[1] // 20 + 1))
    picture += np.kron(blocks, np.ones((20, 20)))[: shape[0], : shape[1]]
    for row, column, frequency, swing in places:
        if swing:
            add_lamp(picture, row, column, 25, SquareWave(frequency, phase=random.uniform(-3, 3)), swing=swing)
    return stored(picture)


def video(places_of, frames, **options):
    return [frame_of(places_of(k), seed=k, **options) for k in range(frames)]


def watch(frames, search_every=8, camera=CAMERA):
    return list(watch_lights(frames, camera, search_every))


def searched(count):
    """The first four frames are, and then every eighth."""
    return [k < 4 or (k - 3) % 8 == 0 for k in range(count)]


def at(seen, column):
    """The light of a frame at a column and its number; None without one."""
    found = [(s, n) for s, n in zip(seen.sources, seen.numbers, strict=True) if abs(s.x + s.width / 2 - column) < 25]
    return found[0] if found else None


def assert_agrees(one, other, row, column):
    """Measurements of a light agree within their standard errors; its box is that of a lamp of 50 rows, to a cycle."""
    assert abs(one.gain - other.gain) < 4 * np.hypot(one.gain_std, other.gain_std)
    assert abs(one.frequency - other.frequency) < 4 * np.hypot(one.frequency_std, other.frequency_std)
    edges = one.x, one.y, one.x + one.width, one.y + one.height
    for a, b in zip(edges, (column - 25, row - 25, column + 25, row + 25), strict=True):
        assert abs(a - b) <= 12


@pytest.mark.parametrize("texture", [0.0, 10.0])
@pytest.mark.parametrize("speed", [0.0, 0.2, 4.0])
def test_followed_lights_are_those_of_a_search_of_each_frame(speed, texture):
    frames = video(
        lambda k: [(120 + speed * k / 2, 100 + speed * k, 9000.0, 120.0), (240, 330 - speed * k, 13000.0, 60.0)],
        20,
        texture=texture,
    )
    followed, each = watch(frames), watch(frames, 1)
    assert [one.searched for one in followed] == searched(20)
    assert all(one.searched for one in each)
    for one, other in zip(followed, each, strict=True):
        k = one.frame
        for row, column in ((120 + speed * k / 2, 100 + speed * k), (240, 330 - speed * k)):
            assert_agrees(at(one, column)[0], at(other, column)[0], row, column)
        assert at(one, 100 + speed * one.frame)[1] == at(followed[0], 100)[1]


def test_phases_of_a_standing_light_advance_with_the_clock():
    camera = Camera(CAMERA.row_time, CAMERA.exposure, frame_time=0.011)
    found = watch(video(lambda k: [(180, 240, 9000.0, 120.0)], 6), camera=camera)
    phases = [np.random.default_rng(k) for k in range(6)]
    for seen, random in zip(found, phases, strict=True):
        random.standard_normal(SHAPE)  # the noise, drawn first
        (source,) = seen.sources
        away = source.phase - random.uniform(-3, 3)
        drift = 2 * np.pi * 180 * camera.row_time * (source.frequency - 9000.0)  # extrapolated from the box to row 0
        assert abs(np.angle(np.exp(1j * (away + drift)))) < 0.15


@pytest.mark.parametrize("appears", [9, 11, 45])
def test_a_light_that_appears_is_found_within_eight_frames(appears):
    places = [(120, 100, 9000.0, 120.0), (240, 330, 13000.0, 60.0)]
    found = watch(video(lambda k: places[: 1 + (k >= appears)], appears + 10))
    first = next(seen.frame for seen in found if at(seen, 330))
    assert appears <= first <= appears + 8
    assert at(found[-1], 100)[1] == at(found[0], 100)[1] != at(found[-1], 330)[1]


def test_a_light_that_the_first_frame_hides_is_found_in_the_next():
    found = watch(video(lambda k: [(120, 100, 9000.0, 120.0 * (k > 0))], 12))
    assert [len(seen.sources) for seen in found] == [0] + [1] * 11
    assert [seen.searched for seen in found] == searched(12)


def test_a_video_without_lights_is_searched_as_rarely(monkeypatch):
    searches = []
    monkeypatch.setattr(tracker, "detect_sources", lambda *_, **__: searches.append(1) or [])
    found = watch(video(lambda _: [], 24))
    assert [seen.searched for seen in found] == searched(24)
    assert not searches


def test_a_light_that_vanishes_is_gone_at_once():
    found = watch(video(lambda k: [(120, 100, 9000.0, 120.0), (240, 330, 13000.0, 60.0 * (k < 6))], 16))
    assert [at(seen, 330) is not None for seen in found] == [k < 6 for k in range(16)]
    assert len({at(seen, 100)[1] for seen in found}) == 1
    assert [seen.searched for seen in found] == [k < 4 or 7 <= k <= 14 for k in range(16)]


def test_a_light_that_changes_its_frequency_is_another():
    found = watch(video(lambda k: [(180, 240, 9000.0 if k < 6 else 12000.0, 120.0)], 16))
    for seen in found[:6] + found[8:]:
        (source,) = seen.sources
        assert source.frequency == pytest.approx(9000.0 if seen.frame < 6 else 12000.0, rel=0.02)
    assert found[-1].numbers != found[0].numbers


def sending(rows, radius):
    """Frames of a lamp of that radius, at a row of each frame, that sends random chips."""
    bits = np.random.default_rng(0).integers(0, 2, (len(rows), 100)).astype(float)
    for k, row in enumerate(rows):
        picture, _ = scene(480, 480, seed=k)
        add_lamp(picture, row, 220, radius, Chips(bits[k].tolist(), 1 / (6 * CAMERA.row_time)))
        yield stored(picture)


def test_a_light_that_sends_data_is_followed():
    found = watch(sending([240] * 12, 110))
    assert [seen.searched for seen in found] == searched(12)
    for seen in found:
        (source,) = seen.sources
        assert source.carries_data
        assert seen.numbers == [0]
        assert abs(source.x + source.width / 2 - 220) < 20


def test_bursts_of_data_at_other_rows_are_found_in_each_frame():
    frames = list(sending([110, 240, 370] * 4, 100))
    for one, other in zip(watch(frames), watch(frames, 1), strict=True):
        assert [s.region for s in one.sources] == [s.region for s in other.sources]


def test_a_reflection_stays_one():
    def mirrored(k):
        picture, random = scene(seed=k)
        waveform = SquareWave(8000.0, phase=random.uniform(-3, 3))
        add_lamp(picture, 300, 400, 50, waveform, swing=150.0)
        add_lamp(picture, 250, 150, 26, waveform, swing=25.0)
        return stored(picture)

    for seen in watch([mirrored(k) for k in range(8)]):
        (reflection,) = [s for s in seen.sources if s.reflection_of is not None]
        assert abs(seen.sources[reflection.reflection_of].x - 350) < 12


def test_the_command_line_says_which_lights_were_followed(tmp_path, run, facts):
    np.save(tmp_path / "v.npy", np.stack(video(lambda _: [(120, 100, 9000.0, 120.0), (240, 330, 13000.0, 60.0)], 6)))
    command = ("detect", tmp_path / "v.npy", "--row-time", "10us", "--exposure", "30us", "--scan-axis", "y")
    for options, expected in (([], searched(6)), (["--search-every", 1], [True] * 6)):
        frames = facts(*command, *options)
        assert [frame["frame"] for frame in frames] == list(range(6))
        for frame, whole in zip(frames, expected, strict=True):
            assert sorted(source["light"] for source in frame["sources"]) == [0, 1]
            assert all(source["searched"] is whole for source in frame["sources"])
    code, _, err = run(*command, "--search-every", 0)
    assert code == 2
    assert "--search-every" in err[-1]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 9])
def test_each_frame_comes_once(count):
    frames = video(lambda _: [(120, 100, 9000.0, 120.0)], count)
    for search_every in (1, 30):
        found = watch(iter(frames), search_every)
        assert [seen.frame for seen in found] == list(range(count))
        assert all(np.array_equal(seen.pixels, frame) for seen, frame in zip(found, frames, strict=True))
        assert all(len(seen.sources) == 1 for seen in found)


def test_one_picture_is_searched_as_by_detect_sources():
    frame = frame_of([(120, 100, 9000.0, 120.0), (240, 330, 13000.0, 60.0)])
    (seen,) = watch([frame])
    assert seen.sources == detect_sources(frame, CAMERA)


def test_a_frame_of_another_shape_or_type_is_searched():
    places = [(120, 100, 9000.0, 120.0)]
    others = frame_of(places, shape=(300, 400)), frame_of(places).astype(np.uint16)
    found = watch([*video(lambda _: places, 6), *others])
    assert [seen.searched for seen in found] == [*searched(6), True, True]
    assert all(len(seen.sources) == 1 for seen in found)


def test_only_the_frame_asked_for_is_searched_and_compared():
    frames = np.stack(video(lambda _: [(120, 100, 9000.0, 120.0)], 4))
    every = detect_sources(frames, CAMERA)
    for frame in range(4):
        assert detect_sources(frames, CAMERA, frame=frame) == [one for one in every if one.frame == frame]
    with pytest.raises(ValueError, match="frame: got 4, allowed: a frame of those given"):
        detect_sources(frames, CAMERA, frame=4)


@pytest.mark.parametrize("moved", [(0, 0), (0, 3), (3, 0), (0, -9), (-9, 0), (5, -5)])
def test_a_light_is_recognised_where_it_moved(moved):
    frame = frame_of([(180, 240, 9000.0, 120.0)])
    (source,) = detect_sources(frame, CAMERA)
    later = frame_of([(180 + moved[0], 240 + moved[1], 9000.0, 120.0)], seed=1)
    found = KnownLight(frame, CAMERA, source).measure(later, (source.x, source.y))
    assert abs(found.y - source.y - moved[0]) <= 1
    assert abs(found.x - source.x - moved[1]) <= 1
    assert found.gain == pytest.approx(source.gain, abs=4 * np.hypot(found.gain_std, source.gain_std))


@pytest.mark.parametrize(
    "places",
    [[], [(180, 300, 9000.0, 120.0)], [(180, 240, 10000.0, 120.0)], [(180, 240, 9000.0, 50.0)], [(30, 60, 9e3, 120.0)]],
)
def test_what_looks_otherwise_is_not_recognised(places):
    """Nothing, too far away, another frequency, much fainter; and a box that would lie outside of the frame."""
    frame = frame_of([(180, 240, 9000.0, 120.0)])
    (source,) = detect_sources(frame, CAMERA)
    light = KnownLight(frame, CAMERA, source)
    assert light.measure(frame_of(places, seed=1), (source.x, source.y)) is None
    assert light.measure(frame, (-3, source.y)) is None
    assert light.measure(frame[:-1], (source.x, source.y)) is None
