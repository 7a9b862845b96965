"""Frames of a video cleaned one after the other: light and shares are carried on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from box_pictures import Array, boxes, psnr

from ocisac_fast import Camera, remove_bands
from ocisac_fast.cleaning import VideoCleaner
from ocisac_fast.files import write_frames

ROWS, COLUMNS, FRAMES = 320, 400, 10
CAMERA = Camera(1e-5)
PERIOD, STEP = 37.3, 0.37  # rows per cycle; cycles from frame to frame


def albedo(seed: int, rows: int, columns: int) -> Array:
    return boxes(seed, rows, columns, 0.1, 0.9, ground=0.4, count=80)


def shown(light: Array, picture: Array, lamp: Array, seed: int) -> tuple[npt.NDArray[np.uint8], Array]:
    clean = picture * (50 + lamp)
    read = clean + picture * lamp * (light[:, None] - 1)
    read += 1.5 * np.random.default_rng(seed).standard_normal(read.shape)
    return np.clip(np.rint(read), 0, 255).astype(np.uint8), clean


def video(
    seed: int, speed: tuple[float, float], lamp: str = "part", frames: int = FRAMES
) -> Iterator[tuple[npt.NDArray[np.uint8], Array]]:
    """Stored and clean frames; the camera turns by ``speed`` pixels a frame over a scene lit in part."""
    margin = int(max(speed) * frames) + 1
    picture = albedo(seed, ROWS + margin, COLUMNS + margin)
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    lit = {"part": 6 + 84 / (1 + np.exp((x + 0.35 * y - 0.65 * COLUMNS) / 3)), "even": np.full(picture.shape, 70.0)}
    for k in range(frames):
        light = 1 + 0.9 * np.cos(2 * np.pi * (np.arange(ROWS) / PERIOD + STEP * k))
        part = np.s_[int(speed[0] * k) :, int(speed[1] * k) :]
        yield shown(light, picture[part][:ROWS, :COLUMNS], lit[lamp][part][:ROWS, :COLUMNS], 100 * seed + k)


@pytest.mark.parametrize("speed", [(0.0, 0.0), pytest.param((1.0, 4.0), marks=pytest.mark.nightly), (3.0, 7.0)])
@pytest.mark.parametrize("lamp", ["part", "even"])
def test_frames_are_as_good_as_cleaned_alone(speed: tuple[float, float], lamp: str) -> None:
    cleaner, behind = VideoCleaner(CAMERA, level="mean"), []
    for stored, clean in video(11, speed, lamp):
        done = cleaner.push(stored)
        assert done.unchanged == ("",)
        assert done.model == ("tone",)
        behind.append(psnr(remove_bands(stored, CAMERA, level="mean").frames, clean) - psnr(done.frames, clean))
    assert max(behind) < 0.3
    assert abs(behind[0]) == 0.0
    frequency = float(done.frequency[0])
    assert abs(frequency - 1e5 / PERIOD) < 1e-3 * frequency


def test_the_frequency_becomes_more_precise() -> None:
    errors = []
    for seed in range(4):
        cleaner = VideoCleaner(CAMERA)
        found = [float(cleaner.push(stored).frequency[0]) for stored, _ in video(seed, (0.0, 0.0), "even", 8)]
        errors.append([abs(found[k] - 1e5 / PERIOD) for k in (0, -1)])
    first, last = np.sqrt(np.mean(np.square(errors), axis=0))
    assert last < first


def test_colours_keep_lights_of_their_own() -> None:
    row = np.arange(ROWS)
    phases = np.radians([0.0, 25.0, -30.0])
    cleaner = VideoCleaner(CAMERA, level="mean")
    picture = np.stack([albedo(seed, ROWS, COLUMNS) for seed in (1, 1, 2)], axis=-1)
    for k in range(4):
        lights = [1 + 0.8 * np.cos(2 * np.pi * (row / PERIOD + STEP * k) + phase) for phase in phases]
        both = [shown(light, picture[..., c], np.full((ROWS, COLUMNS), 60.0), k) for c, light in enumerate(lights)]
        stored, clean = (np.stack([one[part] for one in both], axis=-1) for part in (0, 1))
        done = cleaner.push(stored[None])
        assert done.frames.shape == (1, ROWS, COLUMNS, 3)
        assert done.light.shape == (1, ROWS, 3)
        found = np.exp(-2j * np.pi * row / PERIOD) @ (done.light[0] - 1)
        turned = np.angle(found * np.exp(-1j * (phases + 2 * np.pi * STEP * k)))
        np.testing.assert_allclose(turned, 0, atol=np.radians(5))
        assert psnr(done.frames[0], clean) > 38


@pytest.mark.parametrize("shape", [(8, 1), (9, 3), (200, 1), (8, 60)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("kind", ["noise", "tone", "black", "white"])
def test_frames_of_any_size_and_content(shape: tuple[int, int], dtype: type, kind: str) -> None:
    random, cleaner = np.random.default_rng(0), VideoCleaner(Camera(1e-5, white_level=255.0))
    for k in range(3):
        light = 1 + 0.8 * np.cos(2 * np.pi * (np.arange(shape[0]) / 7.3 + 0.3 * k))
        values = {
            "noise": random.uniform(0, 200, shape),
            "tone": np.broadcast_to(100 * light[:, None], shape),
            "black": np.zeros(shape),
            "white": np.full(shape, 255.0),
        }
        done = cleaner.push(values[kind].astype(dtype))
        assert done.frames.shape == shape
        assert np.isfinite(done.frames.astype(float)).all()


def test_a_chip_light_is_found_in_every_frame_once_a_second_one_shows_that_it_moves() -> None:
    bits = np.random.default_rng(5).integers(0, 2, 400).astype(float)
    picture, lamp = albedo(4, ROWS, COLUMNS), np.full((ROWS, COLUMNS), 70.0)
    cleaner, frames = VideoCleaner(CAMERA, level="mean"), []
    for k in range(3):
        fine = bits[((np.arange(4 * ROWS) / 4 + 500 * k) / 6.2).astype(int)]
        light = fine.reshape(ROWS, 4).mean(axis=1)
        stored, clean = shown(light / light.mean(), picture, lamp, k)
        frames.append((stored, clean))
        done = cleaner.push(stored)
        assert bool(done.unchanged[0]) == (k == 0)
        for number in (0, 1) if k == 1 else (k,) if k > 1 else ():
            stored, clean = frames[number]
            own = cleaner.again(stored, k - number) if number < k else done
            alone = remove_bands(stored, CAMERA, level="mean")
            assert own.model == alone.model == ("chips",)
            assert psnr(own.frames, clean) > psnr(alone.frames, clean) - 0.3


def test_lines_of_text_are_no_chips() -> None:
    """They stand still, or move with the picture."""
    for step in (0, 3):
        cleaner = VideoCleaner(CAMERA)
        for k in range(3):
            picture = albedo(9, ROWS + 40, COLUMNS)
            for line in range(10):
                picture[40 + 29 * line : 50 + 29 * line, 40:180] *= 0.3
            moved = picture[step * k : step * k + ROWS]
            assert cleaner.push(shown(np.ones(ROWS), moved, np.full(moved.shape, 70.0), k)[0]).unchanged[0]


def test_frames_before_a_slow_light_was_sure_are_cleaned_again() -> None:
    camera = Camera(1e-5, frame_time=1 / 240)
    picture = albedo(3, ROWS, COLUMNS)
    frames = []
    for k in range(6):
        at = np.arange(ROWS) * 1e-5 + k / 240
        frames.append(shown(1 + 0.3 * np.cos(2 * np.pi * 100 * at), picture, np.full(picture.shape, 70.0), k))
    cleaner = VideoCleaner(camera, level="mean")
    left = [k for k, (stored, _) in enumerate(frames) if cleaner.push(stored).unchanged[0]]
    assert left
    assert left[-1] < len(frames) - 1
    for k in left:
        stored, clean = frames[k]
        done = cleaner.again(stored, len(frames) - 1 - k)
        assert done.unchanged == ("",)
        assert psnr(done.frames * (clean / done.frames.clip(1)).mean(), clean) > 32
    other, _ = shown(np.ones(ROWS), albedo(4, ROWS, COLUMNS), np.full(picture.shape, 70.0), 0)
    assert cleaner.again(other, 1).unchanged[0]
    with pytest.raises(ValueError, match="ago"):
        cleaner.again(stored, 0)


@pytest.mark.parametrize("off", [{2, 3}, {0, 1, 2, 3}, {4}, {1, 3}, {5, 6, 7}], ids=str)
@pytest.mark.parametrize("seed", [0, 1])
def test_lamp_that_is_off_for_some_frames_keeps_its_frequency(off: set[int], seed: int) -> None:
    """Frames without light are not compared with lit ones as if a slower tone were in both."""
    random = np.random.default_rng(seed)
    picture = 150 * albedo(seed, ROWS, COLUMNS)
    cleaner = VideoCleaner(Camera(2e-5, frame_time=1 / 30))
    for k in range(10):
        angle = 2 * np.pi * 1000 * (2e-5 * np.arange(ROWS) + k / 30)
        light = 0.6 + (0.0 if k in off else 0.4) * np.cos(angle)
        stored = np.clip(np.rint(picture * light[:, None] + random.normal(0, 1, picture.shape)), 0, 255)
        done = cleaner.push(stored.astype(np.uint8))
        left = (done.frames / picture).mean(axis=1)
        assert left.std() < 0.04 * left.mean(), k  # 0.47 under the lamp
        assert bool(done.unchanged[0]) == (k in off)
        assert k in off or done.frequency[0] == pytest.approx(1000, abs=1)


@pytest.mark.parametrize("off", [{1}, {4}, {2, 3}, {3, 4, 5}], ids=str)
@pytest.mark.parametrize("frequency", [60, 100])
def test_slow_lamp_that_is_off_for_some_frames_puts_no_bands_in(frequency: float, off: set[int]) -> None:
    """Half the light, of opposite phase in two frames, explains how they differ as well as a lamp that goes off."""
    random, camera = np.random.default_rng([*off]), Camera(6e-5, frame_time=1 / 30)
    picture, cleaner, lit = 150 * albedo(3, ROWS, COLUMNS), VideoCleaner(camera), 0
    stored = []
    for k in range(8):
        wave = np.cos(2 * np.pi * frequency * (camera.row_time * np.arange(ROWS) + k / 30) + 1)
        light = 0.3 if k in off else 0.65 + 0.35 * wave
        stored.append(picture * np.broadcast_to(light, ROWS)[:, None] + random.normal(0, 1, picture.shape))
        stored[k] = np.clip(np.rint(stored[k]), 0, 255).astype(np.uint8)
        done = [cleaner.push(stored[k])] + [cleaner.again(stored[k - ago], ago) for ago in range(1, min(k, 3) + 1)]
        for ago, one in enumerate(done):
            assert k - ago not in off or one.unchanged[0]
        lit += not done[0].unchanged[0]
    assert lit >= 3


def test_light_that_the_rows_deny_is_left() -> None:
    """Smooth shades are periodic over two to four cycles by chance, but in each group of columns otherwise."""
    y, x = np.fft.fftfreq(300)[:, None], np.fft.rfftfreq(200)
    cleaned = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        slope = (1.2, 1.5, 2.0)[seed % 3]
        spectrum = random.normal(size=(300, 101)) + 1j * random.normal(size=(300, 101))
        shades = np.fft.irfft2(spectrum / np.maximum(np.hypot(y, x), 1 / 300) ** slope, s=(300, 200))
        shades = 128 + 40 * shades / shades.std() + random.normal(0, 1.5, shades.shape)
        cleaned += not remove_bands(np.clip(np.rint(shades), 0, 255).astype(np.uint8), Camera(2e-5)).unchanged[0]
    assert cleaned == 0


@pytest.mark.parametrize("seed", range(4))
def test_a_slow_lamp_beside_a_fast_one_is_removed_too(seed: int) -> None:
    random = np.random.default_rng(seed)
    periods, steps = (random.uniform(150, 220), random.uniform(50, 90)), random.uniform(0.1, 0.4, 2)
    picture, cleaner, gains = boxes(seed, 480, 440, 0.3, 0.9, ground=0.5, count=60), VideoCleaner(CAMERA), []
    for k in range(9):
        turns = 2 * np.pi * (np.arange(480)[:, None] / periods + steps * k)
        light = 1 + np.cos(turns) @ [0.2, 0.15]
        part = picture[:, 4 * k :][:, :400]
        stored, clean = shown(light, part, np.full(part.shape, 170.0), 100 * seed + k)
        done = cleaner.push(stored)
        gains.append(psnr(done.frames, clean) - psnr(stored, clean))
    assert min(gains) > -0.1
    assert np.median(gains) > 8  # 4 to 6 where the fast one alone is removed
    assert done.slow_bands == (0,)


SHAPES = {
    "sine": np.sin,
    "triangle": lambda turns: 2 / np.pi * np.arcsin(np.sin(turns)),
    "slats": lambda turns: np.clip(1.6 * np.sin(turns), -1, 1),
    "lines": lambda turns: 2 * np.exp(-(((turns / (2 * np.pi) % 1 - 0.5) / 0.12) ** 2)) - 1,
}


def ribs(shape: str, seed: int, share: float) -> npt.NDArray[np.uint8]:
    """Ten frames of even ribs in a share of the columns, in steady light."""
    random = np.random.default_rng(seed)
    turns = 2 * np.pi * np.arange(240)[:, None] / random.uniform(8, 50) + random.uniform(0, 6)
    picture = np.full((240, 320), 110.0)
    picture[:, : int(320 * share)] += 40 * SHAPES[shape](turns)
    picture[:, int(320 * share) :] += random.normal(0, 3, 320 - int(320 * share))
    return np.clip(np.rint(picture + random.normal(0, 1, (10, 240, 320))), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("share", [1.0, 0.33])
@pytest.mark.parametrize("shape", SHAPES)
def test_ribs_that_stand_still_are_the_pictures(shape: str, share: float) -> None:
    """Slats and ruled lines, whose waveform is that of a tone: only the first frame that shows one cannot tell."""
    for seed in (1, 2, 3):
        frames, camera = ribs(shape, seed, share), Camera(2e-5, frame_time=1 / 59.94)
        assert all(remove_bands(frames[:4], camera, still=True).unchanged)
        assert all(remove_bands(frames[:4], camera).unchanged)
        cleaner = VideoCleaner(camera)
        assert sum(not cleaner.push(frame).unchanged[0] for frame in frames) <= 1


@pytest.mark.parametrize(("frame_time", "is_light"), [(1 / 50, True), (1 / 51.5, False), (None, False)])
def test_a_tone_at_the_same_rows_is_a_light_if_a_frame_takes_whole_cycles(
    frame_time: float | None, is_light: bool
) -> None:
    """A display flickers at 250 Hz; the camera's frame time decides."""
    camera, light = Camera(1e-4, frame_time=frame_time), 1 + 0.6 * np.cos(2 * np.pi * 250 * 1e-4 * np.arange(ROWS))
    picture = albedo(3, ROWS, COLUMNS)
    cleaner = VideoCleaner(camera)
    for k in range(4):
        stored, clean = shown(light, picture, np.full(picture.shape, 70.0), k)
        done = cleaner.push(stored)
        assert k == 0 or bool(done.unchanged[0]) != is_light
        assert not is_light or psnr(done.frames, clean) > psnr(stored, clean) + 6


def test_a_film_of_ribs_is_not_written_again(tmp_path: Path, run: Any) -> None:
    """Its first frame waits for the second, which shows that the ribs stand still."""
    write_frames(tmp_path / "ribs.mkv", ribs("slats", 1, 1.0)[:5])
    times = "--row-time", "20us", "--frame-rate", "59.94"
    code, _, err = run("clean", tmp_path / "ribs.mkv", tmp_path / "clean.mkv", *times)
    assert (code, (tmp_path / "clean.mkv").exists()) == (0, False), err
