"""Pictures without the bands of a light, and what the light's bits gain by it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import box_pictures
import cleaning
import numpy as np
import numpy.typing as npt
import pytest
from box_pictures import Array, psnr

from ocisac_fast import (
    Camera,
    Chips,
    SquareWave,
    Tone,
    _core,
    integrate_exposure,
    receive,
    reference,
    remove_bands,
    subtract_still,
)
from ocisac_fast.camera.linear_light import linear_light, stored_values
from ocisac_fast.cleaning import CleaningOptions, Mark, VideoCleaner
from ocisac_fast.cleaning.stored import lowered
from ocisac_fast.files import read_frames, write_frames

ROWS, COLUMNS = 256, 200
CAMERA = Camera(1e-5, exposure=4e-5)


def boxes(seed: int, rows: int = ROWS, columns: int = COLUMNS) -> Array:
    return box_pictures.boxes(seed, rows, columns, 0.1, 1.0)


def scene(light: Array, seed: int = 0, noise: float = 1.5) -> tuple[Array, Array, Array]:
    """Picture with bands, clean picture and share: texture under ambient light and a lamp cut by a shadow's edge."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    lamp = 70.0 / (1 + np.exp((x + 0.3 * y - 150) / 1.5)) + 8.0
    albedo = boxes(seed)
    clean, share = albedo * (lamp + 40.0), lamp / (lamp + 40.0)
    read = clean * (1 + share * (light[:, None] - 1))
    return read + noise * np.random.default_rng(seed).standard_normal(read.shape), clean, share


def row_light(kind: str, start: float = 0.0) -> Array:
    bits = np.random.default_rng(3).integers(0, 2, 64)
    waves = {
        "tone": Tone(5e3),
        "square": SquareWave(7e3),
        "chips": Chips(np.stack([bits, 1 - bits], axis=1).ravel().tolist(), 17e3, repeat=True),
    }
    light = integrate_exposure(waves[kind], CAMERA, ROWS, start=start)
    return np.asarray(light / light.mean())


def by_row_means(read: Array) -> list[Array]:
    """Divided by the row mean over its trend, for several lengths of trend."""
    mean = read.mean(axis=1)
    trends = [np.convolve(np.pad(mean, n, "reflect"), np.ones(2 * n + 1) / (2 * n + 1), "valid") for n in (10, 20, 40)]
    return [read / (mean / trend)[:, None] for trend in trends]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("period", [9.0, 47.0])
def test_shares_of_a_large_picture_are_those_of_blocks(dtype: type, period: float) -> None:
    """As near to the oracle as a share for each pixel; integers, by tables, as floats."""
    rows, columns = 720, 960
    light = 1 + 0.9 * np.cos(2 * np.pi * np.arange(rows) / period)
    y, x = np.mgrid[:rows, :columns]
    lamp = 70.0 / (1 + np.exp((x + 0.3 * y - 600) / 4)) + 8.0
    clean, share = boxes(4, rows, columns) * (lamp + 40.0), lamp / (lamp + 40.0)
    left = 1 + share * (light[:, None] - 1)
    read = np.clip(np.rint(clean * left + 1.5 * np.random.default_rng(4).standard_normal(clean.shape)), 0, 255)
    done = remove_bands(read.astype(dtype), Camera(1e-5, white_level=255.0), light=light, level="mean")
    kept = left > 0.15
    assert done.share.shape == read.shape
    assert psnr(done.frames, clean, kept) > psnr(read / left, clean, kept) - 1.2
    assert np.abs(done.share - share).mean() < 0.02


@pytest.mark.parametrize("kind", ["tone", "square", "chips"])
@pytest.mark.parametrize("given_light", [True, False])
def test_rendered_scenes(kind: str, given_light: bool) -> None:
    """Better than by row means by 6 dB; not far from the oracle."""
    light = row_light(kind)
    read, clean, share = scene(light)
    left = 1 + share * (light[:, None] - 1)
    kept = left > 0.15
    stored = np.clip(np.rint(read), 0, 255).astype(np.uint8)
    done = remove_bands(stored, CAMERA, light=light if given_light else None, level="mean")
    got = psnr(done.frames, clean, kept)
    assert got > 6 + max(psnr(plain, clean, kept) for plain in by_row_means(read))
    if given_light:
        assert got > psnr(read / left, clean, kept) - 1.3  # a shadow's edge costs most
        assert done.model == ("given",)
    else:
        assert done.model[0] == ("chips" if kind == "chips" else "tone")


@pytest.mark.parametrize("seed", [7, 8])
def test_lines_of_text_do_not_pass_for_a_harmonic(seed: int) -> None:
    random = np.random.default_rng(seed)
    albedo = np.full((360, 480), 0.8)
    for top in range(20, 320, 30):  # twice a cycle of the tone
        for left in range(20, 440, 12):
            stroke = random.integers(0, 4)
            albedo[top : top + 16, left + 2 * stroke : left + 2 * stroke + 3] = 0.12
            albedo[top + 4 * stroke : top + 4 * stroke + 3, left : left + 9] = 0.12
    light = 1 + 0.9 * np.cos(2 * np.pi * np.arange(360) / 60)
    read = 144 * albedo * (1 + 0.6 * (light[:, None] - 1)) + 1.5 * random.standard_normal(albedo.shape)
    done = remove_bands(read, CAMERA, model="tone", level="mean")
    second = np.abs(np.fft.rfft(done.light))[12] / np.abs(np.fft.rfft(done.light))[6]
    assert second < 0.06  # 0.2 to 0.3 where the fit starts with the rows' harmonics
    assert psnr(done.frames, 144 * albedo, np.full(albedo.shape, True)) > 38


def test_fully_lit_rows_stay_and_a_blur_fails() -> None:
    """A blur along the columns removes bands, but also removes texture and darkens fully lit rows."""
    light = row_light("chips")
    read, _, _ = scene(light)
    stored = np.clip(np.rint(read), 0, 255).astype(np.uint8)
    done = remove_bands(stored, CAMERA)
    lit = done.light >= np.quantile(done.light, 0.95)
    assert 5 < lit.sum() < ROWS / 2

    def change_of_lit_rows(picture: npt.NDArray[np.generic]) -> float:
        return float(np.abs(np.float64(picture[lit]) - stored[lit]).mean() / stored[lit].mean())

    def correlation(picture: npt.NDArray[np.generic]) -> float:
        rows = np.where(done.marks == Mark.RESTORED, picture, np.nan)
        rows = np.nanmean(rows[:, :100], axis=1)
        return abs(float(np.corrcoef(rows, done.light)[0, 1]))

    blurs = [np.apply_along_axis(np.convolve, 0, np.float64(stored), np.ones(n) / n, "same") for n in (7, 9)]
    assert change_of_lit_rows(done.frames) < 0.02
    assert all(change_of_lit_rows(blur) > 0.04 for blur in blurs)
    assert 20 * np.log10(correlation(stored) / correlation(done.frames)) > 12  # texture alone correlates as much
    assert all(20 * np.log10(correlation(stored) / correlation(blur)) < 12 for blur in blurs)


def test_saturated_pixels_are_left_alone_and_dark_ones_marked() -> None:
    light = row_light("square")
    light = (light - light.min()) / (1 - light.min())
    read, _, _ = scene(light, noise=0.5)
    read[60:200, 20:60] = 400 * light[60:200, None]
    stored = np.clip(np.rint(read), 0, 255).astype(np.uint8)
    done = remove_bands(stored, CAMERA, light=light)
    saturated = stored >= 250
    assert saturated.any()
    np.testing.assert_array_equal(done.marks == Mark.SATURATED, saturated)
    np.testing.assert_array_equal(done.frames[saturated], stored[saturated])
    dark = done.marks == Mark.DARK
    assert (dark[60:200, 25:55].mean(axis=1) > 0.5).sum() > 5  # the rows without light in what the lamp alone lights
    assert (light[dark.any(axis=1)] < 0.3).all()
    filled = remove_bands(stored, CAMERA, light=light, options=CleaningOptions(fill=True))
    np.testing.assert_array_equal(filled.marks, done.marks)
    np.testing.assert_array_equal(filled.frames[~dark], done.frames[~dark])
    assert filled.frames[dark].mean() > 2 * done.frames[dark].mean()


@pytest.mark.parametrize("level", ["full", "mean"])
def test_the_picture_is_the_equation_of_the_share_and_light_found(level: Literal["full", "mean"]) -> None:
    """v (1 + q (L_full - 1)) / (1 + q (L_n - 1))."""
    read, _, truth = (part[:64, 128:160].astype(np.float32) for part in scene(row_light("tone")))  # the shadow's edge
    done = remove_bands(read, CAMERA, level=level, options=CleaningOptions(noise=1.5, max_gain=1e6))
    rows = done.light
    share = done.share
    assert np.median(np.abs(share - truth)) < 0.1
    full = rows.max() if level == "full" else 1.0
    clean = read * (1 + share * (full - 1)) / (1 + share * (rows[:, None] - 1))
    np.testing.assert_allclose(done.frames, clean, rtol=1e-4)


def test_what_stays_is_subtracted_as_the_reference_does() -> None:
    stored = np.clip(np.rint(scene(row_light("tone"))[0]), 0, 255).astype(np.uint8)[:64, :24]
    frames = np.stack([stored, stored // 2, stored // 3])
    np.testing.assert_allclose(subtract_still(frames, CAMERA), reference.subtract_still(frames, CAMERA), atol=1e-9)


def test_light_whose_sums_are_no_numbers_is_refused() -> None:
    frames = np.full((3, 8, 8), 1.7e308)
    with pytest.raises(ValueError, match="frames: got light from"):
        subtract_still(frames, CAMERA)
    with pytest.raises(ValueError, match="still: got light from"):
        subtract_still(np.ones((3, 8, 8)), CAMERA, still=frames[0])


@pytest.mark.parametrize("white", [None, 1e300])
def test_levels_that_a_type_does_not_hold_are_not_reached(white: float | None) -> None:
    frame = np.full((64, 8), 3e38, np.float32) * np.linspace(0.5, 1, 64, dtype=np.float32)[:, None]
    cleaned = remove_bands(frame, Camera(1e-5, exposure=4e-5, white_level=white))
    assert not (cleaned.marks & Mark.SATURATED).any()
    np.testing.assert_array_equal(cleaned.frames, frame)


def test_bands_and_picture_add_up() -> None:
    light = row_light("tone")
    read, _, _ = scene(light)
    bands = remove_bands(read, CAMERA, light=light, keep="bands")
    picture = remove_bands(read, CAMERA, light=light, level="mean")
    kept = bands.marks == Mark.RESTORED
    steady = picture.frames * (1 - bands.share)  # what the lamp leaves when it is off
    np.testing.assert_allclose((steady + bands.frames)[kept], read[kept], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_types_colours_and_tone_curve(dtype: type) -> None:
    light = row_light("tone")
    full = 1.0 if np.dtype(dtype).kind == "f" else float(np.iinfo(dtype).max)
    camera = Camera(1e-5, tone_curve="srgb", white_level=full)
    read, clean, _ = scene(light, noise=0.3)
    colours = np.stack([read, 0.6 * read, 0.3 * read], axis=2)[None] * full / 255
    stored = stored_values(colours, camera, np.dtype(dtype))
    frames = np.asfortranarray(stored)[:, :, ::-1]
    done = remove_bands(frames, camera, light=light, level="mean")
    assert done.frames.dtype == dtype
    assert done.frames.shape == done.marks.shape == done.share.shape == frames.shape
    got = linear_light(done.frames[0, :, ::-1, 1], camera) * 255 / full
    kept = done.marks[0, :, ::-1, 1] == Mark.RESTORED
    assert psnr(got, 0.6 * clean, kept) > 40


def test_frames_of_a_still_scene_help_each_other() -> None:
    """Shares from three frames, one of them without the light, at a few cycles and in noise."""
    lights = np.stack(
        [1 + 0.9 * np.cos(2 * np.pi * (np.arange(ROWS) / 90 + k / 3)) for k in range(2)] + [np.zeros(ROWS)]
    )
    read = np.stack([scene(light, noise=0)[0] for light in lights])
    read += 3 * np.random.default_rng(0).standard_normal(read.shape)
    _, _, share = scene(lights[0])
    errors = [
        np.sqrt(np.mean((remove_bands(read, CAMERA, light=lights, still=still).share[0] - share) ** 2))
        for still in (False, True)
    ]
    assert errors[1] < 0.75 * errors[0]
    assert errors[1] < 0.08


def error_rate(frames: Array, chips: Array, rows_per_chip: float, starts: Array) -> float:
    """Share of wrong bits, chips that were not received counted as guessed."""
    wrong = count = 0.0
    for frame, start in zip(receive(frames, CAMERA, chip_rate=1 / (rows_per_chip * 1e-5)), starts, strict=False):
        whole = int(ROWS / rows_per_chip) - 2
        count += whole
        bits = np.array([int(bit) for bit in frame.bits], int)[:whole]
        first = int(np.rint((frame.phase - start) / rows_per_chip)) if len(bits) else 0
        sent = chips[(first + np.arange(len(bits))) % len(chips)]
        wrong += np.sum(bits != sent) + 0.5 * (whole - len(bits))
    return wrong / count


def test_a_faint_light_over_a_busy_background_is_received() -> None:
    """Bit error rate of a swing of 3 DN over boxes of 10 to 100: without and with the still picture subtracted."""
    random = np.random.default_rng(7)
    chips, rows_per_chip = random.integers(0, 2, 4096).astype(float), 6.3
    frames, starts = [], []
    for k in range(9):
        at = (np.arange(ROWS * 8) / 8 + 391.3 * k) / rows_per_chip
        light = chips[at.astype(int)].reshape(ROWS, 8).mean(axis=1)
        starts.append(-391.3 * k)
        frames.append(100 * boxes(5) + 3 * light[:, None] + random.standard_normal((ROWS, COLUMNS)))
    stored = np.clip(np.rint(np.stack(frames)), 0, 255).astype(np.uint8)
    without = error_rate(stored, chips, rows_per_chip, np.array(starts))
    subtracted = error_rate(subtract_still(stored, CAMERA), chips, rows_per_chip, np.array(starts))
    assert without > 0.2
    assert subtracted < 0.02
    still = np.rint(100 * boxes(5)).astype(np.uint8)
    assert error_rate(subtract_still(stored, CAMERA, still=still), chips, rows_per_chip, np.array(starts)) < 0.02


def test_toe_and_its_inverse() -> None:
    light = np.concatenate([-np.geomspace(300, 1e-3, 50), [0.0], np.geomspace(1e-3, 300, 50)])
    for toe in (0.0, 0.01, 0.5):
        stored = lowered(light, toe, 255.0)
        np.testing.assert_allclose(_core.lifted_light(stored, toe, 255.0), light, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("toe", [0.0, 1 / 8])
def test_a_toe_is_found_where_there_is_one(toe: float) -> None:
    """Chips that alone light boxes, through a tone curve with a toe: rows half lit are too dark for what is dim."""
    camera = Camera(1e-5, exposure=4e-5, tone_curve="srgb", white_level=255.0)
    bits = np.random.default_rng(3).integers(0, 2, 64)
    light = integrate_exposure(Chips(bits.tolist(), 17e3, repeat=True), camera, ROWS)
    clean = 130 * boxes(2) * np.exp(-0.015 * np.arange(COLUMNS))
    read = clean * (0.03 + 0.97 * light[:, None]) + 0.3 * np.random.default_rng(0).standard_normal(clean.shape)
    stored = stored_values(lowered(read, toe, 255.0), camera, np.dtype(np.uint8))
    done = remove_bands(stored, camera)
    assert done.model == ("chips",)
    assert (done.toe[0] > 0) == (toe > 0)
    kept = light > 0.2
    truth = np.broadcast_to(stored_values(lowered(clean, toe, 255.0), camera, np.dtype(np.float64)), stored.shape)
    got, plain = (
        remove_bands(stored, camera, options=CleaningOptions(toe=value)).frames for value in (done.toe[0], 0.0)
    )
    np.testing.assert_array_equal(got, done.frames)
    kept = np.broadcast_to(kept[:, None], stored.shape)
    assert psnr(got, truth, kept) >= psnr(plain, truth, kept) + (1.0 if toe > 0 else 0.0)


def test_a_picture_without_light_stays() -> None:
    """With a reason, for a picture and in a stream; a given light is believed."""
    cleaner = VideoCleaner(CAMERA)
    for picture in (np.full((64, 40), 90, np.uint8), np.zeros((64, 40), np.uint8), np.full((64, 40), 255, np.uint8)):
        for done in (remove_bands(picture, CAMERA), cleaner.push(picture), cleaner.push(picture)):
            np.testing.assert_array_equal(done.frames, picture)
            assert done.unchanged == ("no bands: all rows have the same light",)
            assert not done.share.any()
    np.testing.assert_array_equal(remove_bands(np.zeros((8, 1), np.uint8), CAMERA).frames, 0)
    given = remove_bands(np.full((64, 40), 90, np.uint8), CAMERA, light=1 + np.arange(64) % 2)
    assert given.unchanged == ("",)


def test_the_command_says_why_a_black_picture_stays(tmp_path: Path, run: Any, facts: Any) -> None:
    np.save(tmp_path / "black.npy", np.zeros((1, 64, 40), np.uint8))
    line = ("clean", tmp_path / "black.npy", tmp_path / "clean.npy", "--row-time", "10us", "--force")
    code, out, _ = run(*line, "--json")
    found, table = json.loads(*out), " ".join(run(*line)[1])
    assert (code, found["unchanged"]) == (0, "no bands: all rows have the same light")
    assert found["frequency_hz"] is None
    assert "no bands" in table
    assert "nan" not in table


def under_a_tone(picture: Array, shift: npt.ArrayLike = 0.0, cycles: float = 12.0, depth: float = 0.8) -> npt.NDArray:
    """Bytes of a picture (0 to 1) under a lamp whose bands are moved by rows for each column, and ambient light."""
    rows = np.arange(len(picture))[:, None] + np.asarray(shift)
    lamp = 1 + depth * np.cos(2 * np.pi * cycles * rows / len(picture))
    noise = np.random.default_rng(1).standard_normal(picture.shape)
    return np.clip(np.rint(picture * (40.0 + 60.0 * lamp) + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(3))
def test_what_cleaning_leaves_is_measured(seed: int) -> None:
    done = remove_bands(under_a_tone(boxes(seed)), CAMERA)
    assert done.unchanged == ("",)
    assert done.light_left[0] < 0.3
    assert abs(done.texture_change[0]) < 1.0
    assert done.slow_bands[0] == 0.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("keep", ["picture", "bands"])
def test_a_picture_that_cleaning_would_make_worse_stays(seed: int, keep: Literal["picture", "bands"]) -> None:
    columns = np.arange(COLUMNS) / COLUMNS
    tilted = under_a_tone(boxes(seed), 60.0 * columns)  # three cycles from side to side
    for stored in (tilted, under_a_tone(boxes(seed), depth=0.0)):
        done = remove_bands(stored, CAMERA, keep=keep)
        assert done.unchanged[0]
        np.testing.assert_array_equal(done.frames, stored if keep == "picture" else 0)
        assert not done.share.any()


@pytest.mark.parametrize("name", ["picture.png", "video.mkv"])
def test_command(tmp_path: Path, name: str, run: Any) -> None:
    lights = [row_light("tone", start) for start in (0.0, 70e-6)][: 1 if name == "picture.png" else 2]
    greys = [np.clip(np.rint(scene(light)[0]), 0, 255).astype(np.uint8)[::-1].T for light in lights]  # rows go left
    frames = np.stack([np.stack([grey, grey // 2, grey // 3], axis=2) for grey in greys])
    source, target, marks = tmp_path / name, tmp_path / f"clean_{name}", tmp_path / "marks.npy"
    write_frames(source, frames)
    camera = ("--scan-axis", "-x", "--row-time", "10us", "--tone-curve", "linear")
    line = ("clean", source, target, *camera, "--marks", marks)
    code, out, _ = run(*line, "--json")
    told = [json.loads(row) for row in out]
    assert code == 0
    assert [(one["model"], one["toe"], one["unchanged"]) for one in told] == [("tone", 0.0, "")] * len(frames)
    assert all(one["light_left"] < 0.5 for one in told)
    cleaned = read_frames(target, colour=True).frames
    in_time_order = frames.swapaxes(1, 2)[:, ::-1]
    each = remove_bands(in_time_order, Camera(1e-5)).frames
    cleaner = VideoCleaner(Camera(1e-5))
    in_turn = np.concatenate([cleaner.push(one[None]).frames for one in in_time_order])
    expected = each if name == "picture.png" else in_turn
    np.testing.assert_array_equal(cleaned, expected[:, ::-1].swapaxes(1, 2))
    run(*line, "--each", "--force")
    np.testing.assert_array_equal(read_frames(target, colour=True).frames, each[:, ::-1].swapaxes(1, 2))
    assert read_frames(marks).frames.shape == frames.shape[:3]
    _, out, _ = run(*line, "--toe", "0.125", "--force", "--json")
    assert [json.loads(row)["toe"] for row in out] == [0.125] * len(frames)
    assert "light left" in " ".join(run(*line, "--force")[1])
    code, _, err = run(*line, "--toe", "2", "--force")
    assert (code, err[-1].endswith("toe: got 2.0, allowed: 0 to 1")) == (2, True)


RECORDINGS = ("poster_nlos.jpg", "underwater_0.jpeg", "underwater_2.jpeg")


@pytest.mark.nightly
@pytest.mark.parametrize("name", RECORDINGS)
def test_recordings(recordings: Path, name: str) -> None:
    """Bands of real cameras go, lit rows and texture stay, which a blur fails."""
    found = cleaning.recording(recordings / name)
    for measured in found:
        assert (measured["lit_rows_changed"] < 0.03) == (measured["name"] == "remove_bands"), measured
        assert (abs(measured["detail_db"]) <= 1) == (measured["name"] == "remove_bands"), measured
    assert found[0]["correlation_taken_db"] > 20


def test_mains_light_of_a_real_picture(recordings: Path) -> None:
    """24.4 dB as stored; the best gain for each row and colour reaches 33.2 dB."""
    found = cleaning.mains(recordings)
    assert found["cleaned"] > 32, found


@pytest.mark.parametrize("depths", [(0.4, 0.25, 0.45), (0.3, 0.35, 0.3)])
def test_every_colour_has_its_own_flicker(depths: tuple[float, float, float]) -> None:
    """A lamp that changes colour over a cycle: phases of 20 and -25 degrees of two colours against the third."""
    phases, row = np.radians([0.0, 20.0, -25.0]), np.arange(ROWS)
    light = np.stack([1 + d * np.cos(2 * np.pi * row / 61 + p) for d, p in zip(depths, phases, strict=True)], axis=-1)
    clean = 120 * np.stack([boxes(seed) for seed in (1, 1, 2)], axis=-1)
    noise = 1.5 * np.random.default_rng(1).standard_normal(clean.shape)
    read = clean * light[:, None] + noise
    done = remove_bands(read[np.newaxis], CAMERA, level="mean")
    assert done.light.shape == (1, ROWS, 3)
    found = np.exp(-2j * np.pi * row / 61) @ (done.light[0] - 1)
    turned = np.angle(found * np.exp(-1j * phases))
    np.testing.assert_allclose(turned, 0, atol=np.radians(4))
    kept = np.ones(clean.shape, bool)
    assert psnr(done.frames[0], clean, kept) > psnr(read / light[:, None], clean, kept) - 3


@pytest.mark.parametrize("seed", range(3))
def test_a_light_that_lights_all_alike_has_one_share(seed: int) -> None:
    """Smooth texture of the size of the bands: shares by pixel would follow it. The shadow's edge needs them."""
    light = row_light("tone")
    random = np.random.default_rng(seed)
    size = np.hypot(*np.meshgrid(np.fft.fftfreq(ROWS), np.fft.rfftfreq(COLUMNS), indexing="ij"))
    waves = np.maximum(size, 1 / COLUMNS) ** -1.3 * np.exp(2j * np.pi * random.random(size.shape))
    field = np.fft.irfft2(waves, (ROWS, COLUMNS))
    clean = 80 * np.exp(0.3 * field / field.std())
    read = clean * (1 + 0.5 * (light[:, None] - 1)) + random.standard_normal(clean.shape)
    even = remove_bands(read, CAMERA, light=light, level="mean")
    assert np.ptp(even.share) == 0
    assert even.share[0, 0] == pytest.approx(0.5, abs=0.02)
    shaded = remove_bands(scene(light, seed)[0], CAMERA, light=light)
    assert np.ptp(shaded.share) > 0.3


@pytest.mark.parametrize("seed", [1, 6, 7, 9, 21])
def test_bars_in_a_part_of_the_columns_are_the_pictures_though_some_frames_show_no_chips(seed: int) -> None:
    random = np.random.default_rng(seed)
    share, period, start = random.uniform(0.3, 0.8), random.uniform(15, 35), random.uniform(0, 6)
    picture = np.full((480, 200), 60.0)
    picture[:, int(200 * (1 - share)) :] += 30 * np.sign(np.sin(2 * np.pi * np.arange(480) / period + start))[:, None]
    stored = np.clip(np.rint(picture + random.normal(size=(4, 480, 200))), 0, 255).astype(np.uint8)
    done = remove_bands(stored, Camera(22.2e-6, exposure=50e-6, frame_time=1 / 30))
    np.testing.assert_array_equal(done.frames, stored)


@pytest.mark.parametrize(("frames", "still"), [(2, False), (2, True), (5, False), (5, True)])
def test_bars_at_the_same_rows_of_all_frames_are_the_pictures(frames: int, still: bool) -> None:
    """As of blinds in steady light; one frame could not tell."""
    y, x = np.mgrid[:480, :240]
    bars = 150 * (0.4 + 0.4 * (y // 20 % 2)) * (0.8 + 0.2 * np.sin(x / 31))
    noise = np.random.default_rng(frames).normal(0, 1.5, (frames, *bars.shape))
    stored = np.clip(np.rint(bars + noise), 0, 255).astype(np.uint8)
    done = remove_bands(stored, Camera(22.2e-6, frame_time=1 / 29.7), still=still)
    assert all(done.unchanged)
    np.testing.assert_array_equal(done.frames, stored)
