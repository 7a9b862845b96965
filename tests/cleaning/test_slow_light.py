"""Light slower than 128 rows per cycle: mains at some cycles a picture, in one frame and in several."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import box_pictures
import cleaning_scenes
import numpy as np
import numpy.typing as npt
import pytest
from box_pictures import Array, psnr

from ocisac_fast import Camera, remove_bands
from ocisac_fast.cleaning import CleaningOptions, VideoCleaner
from ocisac_fast.files import open_recording

ROWS, COLUMNS = 400, 200
CAMERA = Camera(1e-5)


def boxes(seed: int) -> Array:
    return box_pictures.boxes(seed, ROWS, COLUMNS, 0.3, 1.0)


def under(picture: Array, cycles: float, depth: npt.ArrayLike, shift: npt.ArrayLike = 0.0, seed: int = 1) -> Array:
    """Bytes under a lamp; ``depth``, ``shift`` (cycles): of each column."""
    angle = 2 * np.pi * (cycles * (np.arange(len(picture)) + 0.5)[:, None] / len(picture) + np.asarray(shift))
    noise = np.random.default_rng(seed).standard_normal(picture.shape)
    light = 1 + np.asarray(depth) * np.cos(angle)
    return np.clip(np.rint(120 * picture * light + noise), 0, 255).astype(np.uint8)


def decibels(picture: npt.NDArray[np.generic], clean: Array) -> float:
    """PSNR to the clean picture after the best gain."""
    values = picture.astype(float)
    gain = (values * clean).sum() / (values**2).sum()
    return psnr(gain * values, clean)


@pytest.mark.parametrize(("cycles", "depth"), [(1.4, 0.4), (2.0, 0.5), (2.6, 0.2)])
@pytest.mark.parametrize("seed", range(3))
def test_a_tone_of_few_cycles_is_removed_from_one_picture(cycles: float, depth: float, seed: int) -> None:
    picture = boxes(seed)
    stored = under(picture, cycles, depth)
    done = remove_bands(stored, CAMERA)
    assert done.unchanged == ("",)
    assert done.remarks == ("",)
    assert done.frequency[0] == pytest.approx(cycles / (ROWS * CAMERA.row_period), rel=0.1)
    assert done.light_left[0] < 0.3
    assert decibels(done.frames, 120 * picture) > decibels(stored, 120 * picture) + 8


@pytest.mark.parametrize("seed", range(4))
def test_a_picture_without_slow_bands_has_none(seed: int) -> None:
    """A sky's gradient and a vignette are the picture's own."""
    y, x = np.mgrid[-1 : 1 : ROWS * 1j, -1 : 1 : COLUMNS * 1j]
    for shade in (np.ones_like(y), np.exp(-0.4 * y), 1 / (1 + 0.3 * (x**2 + y**2)) ** 2):
        done = remove_bands(under(boxes(seed) * shade, 0.0, 0.0), CAMERA)
        assert done.unchanged[0]
        assert done.slow_bands[0] == 0.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("shape", ["tilted", "half as tilted", "curved", "an arc"])
def test_bands_of_other_shapes_are_refused_or_left_and_told(seed: int, shape: str) -> None:
    place = np.linspace(0, 1, COLUMNS)
    shifts = {"tilted": place, "half as tilted": 0.5 * place, "curved": 2 * (2 * place - 1) ** 2}
    stored = under(boxes(seed), 2.0, 0.5, shifts.get(shape, 0.5 * (2 * place - 1) ** 2))
    done = remove_bands(stored, CAMERA)
    assert "unchanged" in done.remarks[0] or "left" in done.remarks[0]
    if done.unchanged[0]:
        np.testing.assert_array_equal(done.frames, stored)


def test_a_lamp_on_part_of_the_columns_is_refused() -> None:
    stored = under(boxes(1), 2.0, np.where(np.arange(COLUMNS) < 0.6 * COLUMNS, 0.5, 0.0))
    assert remove_bands(stored, CAMERA).unchanged[0]


@pytest.mark.parametrize(("cycles", "depth"), [(1.0, 0.06), (1.7, 0.1)])
def test_three_frames_show_what_one_does_not(cycles: float, depth: float) -> None:
    """A horizon hides the bands; in three frames it stays, and their phase advances."""
    picture = boxes(5) * np.where(np.arange(ROWS) < 180, 1.0, 0.5)[:, None]
    stored = np.stack([under(picture, cycles, depth, 0.3 * k, seed=k) for k in range(3)])
    assert all(remove_bands(stored, CAMERA).unchanged)
    done = remove_bands(stored, CAMERA, still=True)
    assert done.unchanged == ("",) * 3
    for k in range(3):
        assert decibels(done.frames[k], 120 * picture) > decibels(stored[k], 120 * picture) + 4


def test_a_video_is_cleaned_once_its_frames_show_the_bands() -> None:
    picture = boxes(5) * np.where(np.arange(ROWS) < 180, 1.0, 0.5)[:, None]
    cleaner = VideoCleaner(CAMERA)
    for k in range(6):
        stored = under(picture, 1.2, 0.12, 0.3 * k, seed=k)
        done = cleaner.push(stored)
        if k >= 3:
            assert not done.unchanged[0]
            assert decibels(done.frames, 120 * picture) > decibels(stored, 120 * picture) + 5


def test_the_command_takes_the_time_stamps_of_a_video(tmp_path: Path, run: Any) -> None:
    numbers = [0, 1, 2, 3, 5, 6, 8]
    with av.open(str(tmp_path / "gaps.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, "gray"
        for number in numbers:
            frame = av.VideoFrame.from_ndarray(under(boxes(5), 1.2, 0.12, 0.3 * number, seed=number), format="gray")
            frame.pts, frame.time_base = number, Fraction(1, 30)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    run("clean", tmp_path / "gaps.mkv", tmp_path / "clean.npy", "--row-time", "10us", "--channel", "y")
    with open_recording(tmp_path / "gaps.mkv", colour=False) as stored:
        rate = stored.frame_rate
        assert rate is not None
        cleaner, sure = VideoCleaner(Camera(1e-5, frame_time=1 / rate, white_level=255.0)), 0
        for frame, number, cleaned in zip(stored, numbers, np.load(tmp_path / "clean.npy"), strict=True):
            values = np.rint(frame).astype(np.uint8)
            done = cleaner.push(values, time=number / 30)
            sure += not done.unchanged[0]
            assert (cleaned == done.frames).all() == (not done.unchanged[0])  # others are cleaned once it is sure
    assert sure >= 4


def test_regular_stamps_change_nothing() -> None:
    frames = [under(boxes(5), 1.2, 0.12, 0.3 * k, seed=k) for k in range(6)]
    stamped, counted = (VideoCleaner(Camera(1e-5, frame_time=1 / 30)) for _ in range(2))
    for k, frame in enumerate(frames):
        np.testing.assert_array_equal(stamped.push(frame, time=k / 30).frames, counted.push(frame).frames)


@pytest.mark.parametrize("times", [[0, 1, 2, 3, 2], [0, 1, 2, 3, 3.5], [0, 1, 2, 3, 100], [0, 1, 2, 3, None]])
def test_after_stamps_that_do_not_tell_slow_light_is_searched_again(times: list[float | None]) -> None:
    """As in a first frame: earlier ones would be compared at wrong phases."""
    frames = [under(boxes(5), 1.2, 0.12, 0.3 * k, seed=k) for k in range(5)]
    cleaner = VideoCleaner(Camera(1e-5, frame_time=1.0))
    for frame, time in zip(frames, times, strict=True):
        done = cleaner.push(frame, time=time)
    first = VideoCleaner(Camera(1e-5, frame_time=1.0)).push(frames[-1])
    np.testing.assert_array_equal(done.frames, first.frames)
    with pytest.raises(ValueError, match="time: got inf"):
        cleaner.push(frames[0], time=np.inf)


@pytest.mark.parametrize("advance", [1 / 3, 0.43, 0.57])
def test_the_frames_after_them_clean_the_first_two_under_a_slow_light(advance: float) -> None:
    """One frame shows the bands, but neither the phase step nor another slow tone."""
    picture = boxes(5)
    cleaner = VideoCleaner(CAMERA)
    stored = [under(picture, 2.6, 0.4, advance * k, seed=k) for k in range(4)]
    assert ["those after it show" in cleaner.push(one).unchanged[0] for one in stored[:2]] == [True] * 2
    for k in (2, 3):
        for ago, done in enumerate(
            [cleaner.push(stored[k])] + [cleaner.again(stored[k - ago], ago) for ago in range(1, k + 1)]
        ):
            assert done.unchanged == ("",)
            assert done.share.mean() == pytest.approx(0.4, abs=0.06)
            assert decibels(done.frames, 120 * picture) > decibels(stored[k - ago], 120 * picture) + 8


def test_a_light_that_becomes_another_is_found_without_the_frames_before() -> None:
    """Their tone explains the new frame's own rows no better than by chance, so they are not compared."""
    picture, cleaner = boxes(5), VideoCleaner(CAMERA)
    for k, (cycles, shift) in enumerate([(2.6, 0.3 * k) for k in range(4)] + [(1.7, 0.2 * k) for k in range(4)]):
        stored = under(picture, cycles, 0.4, shift, seed=k)
        done = cleaner.push(stored)
        before, after = (decibels(one, 120 * picture) for one in (stored, done.frames))
        assert after > before - 0.1


@pytest.mark.parametrize(("still", "cycles"), [((0.6, 0.0), 1.0), ((0.7, 0.03), 1.1)])
def test_frames_in_which_two_lamps_cancel_are_left(still: tuple[float, float], cycles: float) -> None:
    """One stands, like a shade: without the other one its bands show."""
    picture, cleaner = boxes(0), VideoCleaner(CAMERA)
    place, cleaned = (np.arange(ROWS) + 0.5) / ROWS - 0.5, 0
    for k in range(7):
        turns = still[0] * place + still[1] * k, cycles * place + k / 3 + 0.5
        light = 1 + np.array([0.25, 0.2]) @ np.cos(2 * np.pi * np.array(turns))
        noise = np.random.default_rng(k).normal(0, 2, picture.shape)
        stored = np.clip(np.rint(120 * picture * light[:, None] + noise), 0, 255).astype(np.uint8)
        done = cleaner.push(stored)
        cleaned += not done.unchanged[0]
        assert decibels(done.frames, 120 * picture) > decibels(stored, 120 * picture) - 0.1
    assert cleaned >= 2


@pytest.mark.parametrize(
    ("lamps", "phase"),
    [
        (((0.81, -0.071), (1.12, 0.276)), 0.5),  # three frames show one tone, which leaves some of what differs
        (((0.73, -0.089), (1.04, 0.309)), 0.1),  # the other one is as good as the two in three frames
    ],
)
def test_the_first_frames_are_left_where_two_lamps_that_move_cancel(
    lamps: tuple[tuple[float, float], tuple[float, float]], phase: float
) -> None:
    picture, cleaner, waiting, gains = boxes(5), VideoCleaner(CAMERA), list[npt.NDArray[np.uint8]](), list[float]()
    cycles, steps = np.transpose(lamps)
    for k in range(4):
        turns = cycles[:, None] * ((np.arange(ROWS) + 0.5) / ROWS - 0.5) + (steps * k + [0, phase])[:, None]
        light = 1 + np.array([0.18, 0.17]) @ np.cos(2 * np.pi * turns)
        noise = np.random.default_rng(k).normal(0, 2, picture.shape)
        stored = np.clip(np.rint(120 * picture * light[:, None] + noise), 0, 255).astype(np.uint8)
        done = cleaner.push(stored)
        waiting.append(stored)
        if not done.unchanged[0]:
            again = [cleaner.again(one, len(waiting) - 1 - n) for n, one in enumerate(waiting[:-1])]
            found = [one.frames for one in again] + [done.frames]
            gains += [
                decibels(one, 120 * picture) - decibels(before, 120 * picture)
                for one, before in zip(found, waiting, strict=True)
            ]
            waiting.clear()
    assert min(gains) > -0.1
    assert max(gains) > 5


def test_highlights_do_not_burn() -> None:
    """Rows of mean light would lift bright objects of dark rows beyond white: they stay below it."""
    picture = boxes(2)
    picture[60:90, 20:120] = 1.9
    stored = under(picture, 2.0, 0.4, 0.125)
    assert (stored >= 254).mean() < 0.002
    done = remove_bands(stored, CAMERA)
    assert done.unchanged == ("",)
    assert (done.frames >= 254).mean() < (stored >= 254).mean() + 0.002
    assert decibels(done.frames, 120 * picture) > decibels(stored, 120 * picture) + 6
    filled = remove_bands(stored, CAMERA, options=CleaningOptions(fill=True)).frames
    assert filled.max() == done.frames.max() < 254


def test_a_slow_lamp_on_a_part_of_the_picture_is_followed() -> None:
    """A third of the columns have a quarter of the light: with one share for all they would become worse."""
    _, camera, _, frames = cleaning_scenes.film(917, 720, "srgb")
    cleaner = VideoCleaner(camera)
    done = [cleaner.push(lit.stored[np.newaxis]) for lit in frames[:4]]
    assert [one.unchanged for one in done[2:]] == [("",), ("",)]
    for one, lit in zip(done[2:], frames[2:4], strict=True):
        assert decibels(one.frames[0], lit.truth) > decibels(lit.stored, lit.truth) + 10


def test_shades_of_steady_lamps_on_a_wall_are_no_slow_light() -> None:
    """Smooth shades of about a cycle: far columns have little of them, neighbouring ones nearly the same."""
    random = np.random.default_rng(0)
    y, x = np.mgrid[:720, :720]
    for _ in range(12):
        width, wall = random.uniform(80, 300), np.full(y.shape, 0.2)
        for level in (1.0, 0.6):
            row, column = random.uniform(0, 720, 2)
            wall += level / (1 + ((y - row) ** 2 + (x - column) ** 2) / width**2) ** 1.5
        stored = np.clip(np.rint(60 * wall / wall.mean() + random.normal(0, 1, wall.shape)), 0, 255).astype(np.uint8)
        assert (remove_bands(stored, CAMERA).frames == stored).all()


@pytest.mark.parametrize("curve", ["linear", "srgb"])
@pytest.mark.parametrize("noise", [0.2, 2.0])
@pytest.mark.parametrize("rows", [720, 1080, 2160])
def test_walls_that_fade_to_black_are_left(rows, noise, curve):
    """The logarithm of an evenly fading wall is bent as one cycle of a deep tone is."""
    random = np.random.default_rng(rows)
    place = np.linspace(0, 1, rows)[:, np.newaxis]
    for brightest in (30, 80, 160, 230):
        for darkest in (0, 5):
            fade = 1 - place if brightest == 80 else place
            wall = darkest + (brightest - darkest) * fade + random.normal(0, noise, (rows, 100))
            stored = np.clip(np.rint(wall), 0, 255).astype(np.uint8)
            done = remove_bands(stored, Camera(22.2e-6, tone_curve=curve))
            change = np.abs(done.frames.astype(float) - stored).mean(axis=1).max()
            assert "".join(done.unchanged) or change < 5
