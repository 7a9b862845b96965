"""Sensing of regions: gains against theory, motion, kinds, any array, refusals."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Flag
from ocisac_fast.sensing import BackgroundLight, KnownMotion, MeasuredFrequency
from ocisac_fast.sensing.fit import harmonics_of

ROW_TIME, FRAME_TIME = 22.2e-6, 1 / 30
SPEED = 1.751
EXPOSURES = (622e-6, 1202e-6, 2404e-6, 4981e-6)


class Measured(NamedTuple):
    frequency: float
    frequency_std: float


def camera(exposure=1202e-6, frame_time=FRAME_TIME):
    return Camera(ROW_TIME, exposure, frame_time)


def places(rows, columns, frames):
    """Frame, row and column numbers, to be broadcast."""
    return np.ogrid[:frames, :rows, :columns]


def texture(frames, rows, columns, fx, speed, *, per_row=0.0, per_column=0.2, exposure=1202e-6, noise=2.0, seed=0):
    """A full-depth cosine of mean 100 under eq. 7; per_row and per_column: cycles of it at rest."""
    j, n, k = places(rows, columns, frames)
    f = fx * speed
    turns = f * (n * ROW_TIME + j * FRAME_TIME - exposure / 2) - per_row * n - per_column * k
    light = 100 * (1 + np.sinc(f * exposure) * np.cos(2 * np.pi * turns))
    return light + noise * np.random.default_rng(seed).standard_normal(light.shape)


def grating(frames, rows, columns, fx, speed, per_column=0.2, noise=2.0, seed=0):
    """A square wave that moves across the rows, through the library's exposure integration."""
    phases = -2 * np.pi * per_column * np.arange(columns)
    waves = [ocisac.SquareWave(fx * speed, amplitude=200.0, phase=phase) for phase in phases]
    seen = [ocisac.integrate_exposure(wave, camera(), rows, start=0.0, frames=frames) for wave in waves]
    light = np.stack(seen, axis=-1)
    return light + noise * np.random.default_rng(seed).standard_normal(light.shape)


def lamp(frames, rows, columns, frequency, *, mean=100.0, exposure=1202e-6, noise=2.0, seed=0):
    tone = ocisac.Tone(frequency, amplitude=2 * mean)
    light = ocisac.integrate_exposure(tone, camera(exposure), rows, start=0.0, frames=frames)
    light = light[..., None] * np.ones(columns)
    return light + noise * np.random.default_rng(seed).standard_normal(light.shape)


MOVING, LIGHT = ({"kind": kind, "theory": abs(np.sinc(f * 1202e-6))} for kind, f in (("moving", 350.2), ("light", 517)))
BACKWARDS = {"motion_frequency": 402.73, "direction": -1, "kind": "moving", "theory": abs(np.sinc(402.73 * 1202e-6))}
FORWARDS = {**BACKWARDS, "direction": 1}
ALONG = {"rows": 240, "columns": 8, "fx": 230, "per_row": 0.023, "per_column": 0}

# Frames, what is given, and the truth. A number is held to four of its standard errors.
CASES = {
    "across": (
        texture(1, 240, 12, 200, SPEED),
        {"motion": KnownMotion(axis="across")},
        {**MOVING, "motion_frequency": 350.2},
    ),
    "across, frames": (
        texture(6, 241, 12, 200, SPEED),
        {"motion": KnownMotion(pitch=1e-3)},
        {**MOVING, "motion_frequency": 350.2, "speed": SPEED, "spatial_frequency": 200, "cycles_per_column": -0.2},
    ),
    "square": (
        grating(7, 240, 5, 200, SPEED),
        {"waveform": "square", "motion": KnownMotion(spatial_frequency=200.0)},
        {**MOVING, "motion_frequency": 350.2, "speed": SPEED, "cycles_per_frame": 350.2 / 30 - 12},
    ),
    "along": (texture(6, speed=-SPEED, **ALONG), {"motion": KnownMotion(pitch=1e-4, speed=SPEED)}, BACKWARDS),
    "along, texture known": (
        texture(2, speed=SPEED, **ALONG),
        {"motion": KnownMotion(pitch=1e-4, spatial_frequency=230.0)},
        {**FORWARDS, "speed": SPEED},
    ),
    "along, two frames only": (
        texture(2, speed=SPEED, **ALONG),
        {},
        {"kind": "moving", "flags": Flag.AMBIGUOUS_MOTION, "frequency": 0.023 / ROW_TIME - 402.73},
    ),
    "along, one frame": (
        texture(1, speed=SPEED, **ALONG),
        {"motion": KnownMotion(axis="along", pitch=1e-4, spatial_frequency=230.0)},
        {"kind": "moving", "flags": Flag.AMBIGUOUS_MOTION, "frequency": 0.023 / ROW_TIME - 402.73},
    ),
    "still": (
        texture(3, 240, 8, 230, 0.0, per_row=0.023, per_column=0.1),
        {},
        {"kind": "still", "motion_frequency": 0.0, "cycles_per_column": 0.1, "theory": 1.0, "cycles_per_frame": 0.0},
    ),
    "by whole cycles a frame": (
        texture(3, speed=3.0, **ALONG),
        {"motion": KnownMotion(pitch=1e-4, spatial_frequency=230.0)},
        {"kind": "moving", "motion_frequency": 690, "theory": abs(np.sinc(690 * 1202e-6)), "cycles_per_frame": 0.0},
    ),
    "light": (
        lamp(8, 240, 9, 517.0) + 30,
        {"background": BackgroundLight(np.full(9, 30.0), np.full(9, 0.3))},
        {**LIGHT, "frequency": 517, "cycles_per_column": 0.0, "background_given": True},
    ),
    "light, known": (
        lamp(8, 240, 9, 517.0) + 30,
        {"frequency": 517.0, "background": 30, "others": [300]},
        {**LIGHT, "frequency": 517, "frames_gain": abs(np.sinc(517 * 1202e-6))},
    ),
    "light, one picture": (lamp(1, 240, 9, 517.0), {}, {**LIGHT, "frequency": 517, "flags": Flag.AMBIGUOUS_KIND}),
    "light, measured": (
        lamp(3, 240, 9, 517.0),
        {"frequency": Measured(517.1, 0.2)},
        {**LIGHT, "frequency": 517, "frequency_std": 0.2, "background_given": False},
    ),
    "weak": (lamp(2, 240, 5, 517.0, noise=150.0), {"frequency": 517.0}, {"frequency": 517}),
    "nothing": (lamp(3, 240, 9, 517.0, mean=0.0) + 100, {}, {"kind": "unknown"}),
    "one column": (lamp(1, 240, 1, 517.0)[0, :, 0], {}, {"frequency": 517, "theory": abs(np.sinc(517 * 1202e-6))}),
    "light above half the row rate": (
        lamp(2, 240, 4, 31e3, exposure=20e-6),
        {"frequency": 31e3},
        {"frequency": 31e3, "kind": "light"},
    ),
    "too few rows": (
        lamp(1, 9, 4, 9e3, exposure=20e-6),
        {"frequency": 9e3, "others": [5e3, 3e3, 7e3]},
        {"kind": "unknown", "flags": Flag.UNRESOLVABLE},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_found_is_the_truth(case):
    frames, told, truth = CASES[case]
    how = camera(20e-6) if case in ("light above half the row rate", "too few rows") else camera()
    grey = frames[..., np.newaxis] if np.ndim(frames) == 3 else frames  # however few columns
    found = ocisac.sense_region(grey, how, **told)
    for name, value in truth.items():
        got = getattr(found, name)
        if name == "flags":
            assert got & value, name
        elif isinstance(value, (str, bool, int)) and not name.endswith("frequency"):
            assert got == value, name
        elif name in ("theory", "frequency_std"):
            assert got == pytest.approx(value, rel=0.01), name
        else:
            assert got == pytest.approx(value, abs=4 * getattr(found, f"{name}_std") + 1e-9), name
    if "theory" in truth:
        assert found.gain == pytest.approx(truth["theory"], abs=4 * found.gain_std)
        assert found.contrast == pytest.approx(found.gain * (4 / np.pi if told.get("waveform") else 1))
        noise = 2.0**2
        assert found.snr == pytest.approx(found.gain**2 * found.mean**2 / noise, rel=0.25)
        assert found.mean == pytest.approx(100.0, abs=2.0)
    assert (found.height, found.width) == (frames.shape[-2:] if frames.ndim > 1 else (240, 1))


def scores_of_the_testbed(shape, first_seed):
    """Eq. 16 at the sensing settings of table 2: errors of gain and f_x v, from the same frames, in standard errors."""
    scores = []
    for fx in (100, 200, 500):
        for exposure in EXPOSURES if shape == "cosine" else (1202e-6,):
            seed = first_seed + int(fx + exposure * 1e6)
            if shape == "cosine":
                frames, told = texture(1, 720, 40, fx, SPEED, exposure=exposure, seed=seed), {}
            else:
                frames, told = grating(1, 720, 40, fx, SPEED, seed=seed), {"waveform": "square"}
            found = ocisac.sense_region(frames, camera(exposure), motion=KnownMotion(axis="across"), **told)
            assert found.kind == "moving"
            theory = abs(np.sinc(fx * SPEED * exposure))
            scores += [(found.gain - theory) / found.gain_std]
            scores += [(found.motion_frequency - fx * SPEED) / found.motion_frequency_std]
    return np.array(scores)


@pytest.mark.parametrize("shape", ["cosine", "grating"])
def test_gains_and_frequencies_of_the_testbed_pass_a_chi_square_test(shape):
    scores = scores_of_the_testbed(shape, 0)
    assert (scores**2).sum() < {24: 42.98, 6: 16.81}[len(scores)]  # quantiles of chi-square at 99 %
    assert np.abs(scores).max() < 4


@pytest.mark.nightly
@pytest.mark.parametrize("shape", ["cosine", "grating"])
def test_gains_and_frequencies_of_the_testbed_at_ten_other_seeds(shape):
    scores = np.concatenate([scores_of_the_testbed(shape, 10000 * seed) for seed in range(1, 11)])
    assert (scores**2).sum() < {240: 293.89, 60: 88.38}[len(scores)]
    assert np.abs(scores).max() < 4


def test_the_frequency_reaches_the_cramer_rao_bound():
    amplitude, rows, columns = 100 * np.sinc(350.2 * 1202e-6), 720, 10
    bound = np.sqrt(24 * 2.0**2 / (amplitude**2 * columns * rows * (rows**2 - 1))) / (2 * np.pi * ROW_TIME)
    found = [ocisac.sense_region(texture(1, rows, columns, 200, SPEED, seed=s), camera()) for s in range(40)]
    told = np.mean([one.motion_frequency_std for one in found])
    errors = [one.motion_frequency - 200 * SPEED for one in found]
    assert bound < told < 1.1 * bound
    assert 0.75 * bound < np.sqrt(np.mean(np.square(errors))) < 1.25 * bound


def test_faint_and_noisy_harmonics_feign_no_precision():
    views = (grating(1, 720, 6, 100, SPEED, noise=6.0, seed=s) for s in range(6, 16))
    found = [ocisac.sense_region(view, camera(), waveform="square") for view in views]
    scores = [(one.frequency - 175.1) / one.frequency_std for one in found]
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_columns_share_their_noise_and_the_standard_error_knows():
    random = np.random.default_rng(5)
    errors, told = [], []
    for seed in range(20):
        frames = texture(1, 360, 20, 400, SPEED, per_column=0.01, noise=1.0, seed=seed)
        frames = frames + 8 * random.standard_normal((360, 1))
        found = ocisac.sense_region(frames, camera(), motion=KnownMotion(axis="across"))
        errors.append(found.frequency - 400 * SPEED)
        told.append(found.frequency_std)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) / np.mean(told) < 1.4


@pytest.mark.parametrize("columns", [100, 700])
def test_wide_regions_of_fine_stripes_keep_their_texture(columns):
    frames = texture(2, 360, columns, 200, SPEED, per_column=0.21)
    found = ocisac.sense_region(frames, camera(), motion=KnownMotion(pitch=1.05e-3))
    assert found.kind == "moving"
    assert found.cycles_per_column == pytest.approx(-0.21, abs=4 * found.cycles_per_column_std)
    assert found.speed == pytest.approx(SPEED, abs=4 * found.speed_std)
    assert found.spatial_frequency == pytest.approx(200, abs=4 * found.spatial_frequency_std)
    assert found.direction == 1
    assert not found.flags


def test_speed_and_texture_give_each_other():
    frames = texture(1, 720, 20, 200, SPEED)
    by_texture = ocisac.sense_region(frames, camera(), motion=KnownMotion(axis="across", spatial_frequency=200.0))
    assert by_texture.speed == pytest.approx(SPEED, abs=4 * by_texture.speed_std)
    assert by_texture.speed_std == pytest.approx(by_texture.motion_frequency_std / 200)
    by_speed = ocisac.sense_region(frames, camera(), motion=KnownMotion(axis="across", speed=SPEED))
    assert by_speed.spatial_frequency == pytest.approx(200, abs=4 * by_speed.spatial_frequency_std)


@pytest.mark.parametrize("stated", [{"spatial_frequency": 200.0}, {"speed": SPEED}])
@pytest.mark.parametrize("wrong", [1.0, 0.7, 2.0])
def test_a_texture_that_contradicts_what_is_stated_is_flagged(stated, wrong):
    frames = texture(1, 720, 20, 200, SPEED, per_column=-0.21)
    ((name, value),), pitch = stated.items(), 0.21 / 200
    found = ocisac.sense_region(
        frames, camera(), motion=KnownMotion(axis="across", pitch=pitch, **{name: wrong * value})
    )
    assert bool(found.flags & Flag.MODEL_MISFIT) == (wrong != 1)


PITCH = 1e-4


def along(frames, fx, speed, seed=0):
    return texture(frames, 720, 20, fx, speed, per_row=fx * PITCH, per_column=0.0, seed=seed)


@pytest.mark.parametrize("fx", [100, 230, 510])
@pytest.mark.parametrize("speed", [-SPEED, -0.05, 0.3, SPEED])
@pytest.mark.parametrize("known", ["texture", "speed"])
def test_motion_along_the_rows_with_direction_and_pitch(fx, speed, known):
    told = {"spatial_frequency": float(fx)} if known == "texture" else {"speed": abs(speed)}
    told |= {"pitch": PITCH, "direction": int(np.sign(speed)), "axis": "along", "bounds": (0.0, 2.0 * fx)}
    found = ocisac.sense_region(along(1, fx, speed), camera(), motion=KnownMotion(**told))
    assert found.kind == "moving"
    assert found.motion_frequency == pytest.approx(fx * abs(speed), abs=4 * found.motion_frequency_std)
    assert found.direction == np.sign(speed)
    assert found.gain == pytest.approx(abs(np.sinc(fx * speed * 1202e-6)), abs=4 * found.gain_std)
    assert found.theory == pytest.approx(abs(np.sinc(fx * speed * 1202e-6)), abs=0.01)
    assert not found.flags & Flag.AMBIGUOUS_MOTION


@pytest.mark.parametrize("speed", [-SPEED, -0.2, 0.3, SPEED])
def test_motion_along_the_rows_with_two_frames_needs_no_direction(speed):
    known = {"pitch": PITCH, "spatial_frequency": 230.0}
    found = ocisac.sense_region(along(2, 230, speed), camera(), motion=KnownMotion(**known))
    assert found.motion_frequency == pytest.approx(230 * abs(speed), abs=4 * found.motion_frequency_std)
    assert found.direction == np.sign(speed)
    assert not found.flags & Flag.AMBIGUOUS_MOTION
    alone = ocisac.sense_region(along(1, 230, speed), camera(), motion=KnownMotion(axis="along", **known))
    assert found.motion_frequency_std < 0.25 * alone.motion_frequency_std


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("error", [0.98, 1.02, 1.05])
@pytest.mark.parametrize("axis", ["across", "along"])
def test_motion_that_a_wrong_row_time_feigns_is_flagged(axis, error, seed):
    """The other axis, or a motion faster than the read-out, fits three frames by chance."""
    random = np.random.default_rng([seed, axis == "along"])
    flagged = 0
    for _ in range(12):
        fx, speed, pitch = random.uniform(60, 200), random.uniform(2, 6), 5e-4
        still = {"across": {"per_column": fx * pitch}, "along": {"per_row": fx * pitch, "per_column": 0.0}}[axis]
        frames = texture(3, 300, 20, fx, speed, exposure=2e-4, noise=1.0, seed=seed, **still)
        known = KnownMotion(pitch=pitch, spatial_frequency=fx)
        right, wrong = (ocisac.sense_region(frames, Camera(ROW_TIME * k, 2e-4, FRAME_TIME), motion=known)
                        for k in (1.0, error))  # fmt: skip
        flagged += bool(right.flags)
        assert right.flags or right.speed == pytest.approx(speed, abs=5 * right.speed_std)
        assert wrong.flags or wrong.speed == pytest.approx(speed, rel=1.5 * abs(error - 1))
    assert flagged <= 4


def test_slow_motion_along_the_rows_with_two_frames_and_bounds_needs_no_texture():
    found = ocisac.sense_region(along(2, 230, 0.05), camera(), motion=KnownMotion(pitch=PITCH, bounds=(0.0, 14.9)))
    assert found.motion_frequency == pytest.approx(11.5, abs=4 * found.motion_frequency_std)
    assert found.spatial_frequency == pytest.approx(230, abs=4 * found.spatial_frequency_std)
    assert found.speed == pytest.approx(0.05, abs=4 * found.speed_std)
    assert found.direction == 1
    assert not found.flags


def test_ambiguous_motion_is_flagged_with_all_candidates():
    """One frame, texture known, direction not: the truth is among the candidates."""
    known = KnownMotion(axis="along", pitch=PITCH, spatial_frequency=230.0)
    found = ocisac.sense_region(along(1, 230, SPEED), camera(), motion=known)
    assert found.flags & Flag.AMBIGUOUS_MOTION
    assert min(abs(np.array(found.motion_candidates) - 230 * SPEED)) < 4 * found.motion_frequency_std
    two = ocisac.sense_region(along(2, 230, SPEED), camera())
    assert two.flags & Flag.AMBIGUOUS_MOTION
    assert len(two.motion_candidates) > 2
    nothing = ocisac.sense_region(along(1, 230, SPEED), camera(), motion=KnownMotion(axis="along"))
    assert math.isnan(nothing.motion_frequency)
    assert nothing.flags & Flag.AMBIGUOUS_MOTION


def test_what_is_told_against_the_pictures_is_flagged():
    told = KnownMotion(axis="along", direction=1, pitch=PITCH, spatial_frequency=100.0, bounds=(0, 500))
    found = ocisac.sense_region(along(1, 230, -SPEED), camera(), motion=told)
    assert found.flags & Flag.MODEL_MISFIT
    assert math.isnan(found.motion_frequency)
    two = ocisac.sense_region(along(2, 230, SPEED), camera(), motion=KnownMotion(pitch=PITCH, spatial_frequency=233.0))
    assert two.flags & (Flag.MODEL_MISFIT | Flag.AMBIGUOUS_MOTION)


def test_a_texture_that_moves_by_whole_cycles_a_frame_may_be_at_rest():
    frames = along(2, 230, 3.0)  # 23 cycles a frame
    found = ocisac.sense_region(frames, camera())
    assert found.kind == "still"
    assert found.flags & Flag.AMBIGUOUS_MOTION
    assert found.motion_candidates[1] == pytest.approx(30, abs=0.1)
    for told in ({"spatial_frequency": 230.0}, {"speed": 3.0}):
        known = ocisac.sense_region(frames, camera(), motion=KnownMotion(pitch=PITCH, **told))
        assert known.kind == "moving"
        assert known.motion_frequency == pytest.approx(690, abs=4 * known.motion_frequency_std)
    motion = KnownMotion(pitch=PITCH, spatial_frequency=230.0, direction=1)
    rest = ocisac.sense_region(along(2, 230, 0.0), camera(), motion=motion)
    assert rest.kind == "still"
    assert not rest.flags


@pytest.mark.parametrize("frequency", [200.0, 517.0, 1731.0, 7919.0])
def test_a_light_is_told_from_textures_that_show_the_same_rows(frequency):
    exposure = 100e-6
    light = ocisac.sense_region(lamp(3, 720, 30, frequency, exposure=exposure), camera(exposure))
    assert light.kind == "light"
    assert light.cycles_per_column == pytest.approx(0, abs=4 * light.cycles_per_column_std)
    assert light.gain == pytest.approx(light.theory, abs=4 * light.gain_std)
    stripes = texture(3, 720, 30, frequency, 1.0, per_column=0.01, exposure=exposure)
    across = ocisac.sense_region(stripes, camera(exposure))
    assert across.kind == "moving"
    per_row = (frequency + 37.1) * ROW_TIME
    stripes = texture(3, 720, 30, 37.1, 1.0, per_row=per_row, per_column=0.0, exposure=exposure)
    found = ocisac.sense_region(stripes, camera(exposure))
    assert found.kind == "moving" or found.flags & Flag.AMBIGUOUS_KIND


def test_a_frame_time_that_is_slightly_off_is_flagged_and_a_tolerance_helps():
    frames = lamp(3, 720, 30, 517.0)
    off = Camera(ROW_TIME, 1202e-6, FRAME_TIME * 1.0004)
    assert ocisac.sense_region(frames, off).flags & Flag.AMBIGUOUS_KIND
    assert ocisac.sense_region(frames, off).kind == "light"
    assert not ocisac.sense_region(frames, off, motion=KnownMotion(timing_tolerance=1e-3)).flags


@pytest.mark.parametrize("shape", ["cosine", "grating"])
def test_gains_over_frames_are_those_along_columns(shape):
    frames = texture(16, 360, 20, 200, SPEED) if shape == "cosine" else grating(16, 360, 20, 200, SPEED)
    found = ocisac.sense_region(frames, camera(), waveform="tone" if shape == "cosine" else "square")
    theory = np.sinc(200 * SPEED * 1202e-6)
    assert found.frames_gain == pytest.approx(theory, abs=4 * found.frames_gain_std)
    assert found.gain == pytest.approx(theory, abs=4 * found.gain_std)
    assert found.frames_gain_std < 3e-4


def test_a_light_and_a_texture_on_the_same_pixels():
    """The paper's joint case: both tones in every column, f_x v and both gains from the same frames."""
    scores = []
    for seed in range(6):
        sensing = texture(3, 720, 30, 200, SPEED, seed=seed)
        frames = sensing + 0.6 * lamp(3, 720, 30, 517.0, noise=0.0)
        unlit = texture(3, 720, 30, 200, SPEED, seed=100 + seed)
        moving = ocisac.sense_region(
            frames, camera(), others=[517.0], background=60.0, bounds=(250, 450), motion=KnownMotion(pitch=1e-3)
        )
        assert moving.kind == "moving"
        beside = ocisac.background_light(unlit, camera(), tones=[moving.frequency])
        light = ocisac.sense_region(frames, camera(), 517.0, others=[moving.frequency], background=beside)
        assert light.kind == "light"
        assert light.background_given
        scores.append((light.gain - np.sinc(517 * 1202e-6)) / light.gain_std)
        scores.append((moving.gain - np.sinc(200 * SPEED * 1202e-6)) / moving.gain_std)
        scores.append((moving.motion_frequency - 200 * SPEED) / moving.motion_frequency_std)
    assert np.sum(np.square(scores)) < 34.81  # chi-square of 18 at 99 %
    assert np.abs(scores).max() < 4


@pytest.mark.parametrize(
    ("levels", "noise", "top", "clipped"),
    [
        ((20, 100), 3.0, 255, False),
        ((0, 3), 3.0, 255, True),
        ((252, 262), 3.0, 255, True),
        ((4060, 4150), 30, 4095, True),
    ],
)
def test_a_background_is_flagged_where_its_light_is_clipped(levels, noise, top, clipped):
    """Where black cuts off noise, that is in the standard error too."""
    flags, scores = [], []
    for seed in range(20):
        random = np.random.default_rng(seed)
        level = random.uniform(*levels)
        stored = np.rint(level + noise * random.standard_normal((400, 20))).clip(0, top)
        unlit = stored.astype(np.uint8 if top == 255 else np.uint16)
        pooled, single = (ocisac.background_light(unlit, camera(), pooled=pooled) for pooled in (True, False))
        assert pooled.flags == single.flags
        flags.append(bool(pooled.flags & Flag.SATURATED))
        scores += [(pooled.mean - level) / pooled.std, *(single.mean - level) / single.std]
    assert flags == [clipped] * 20
    assert np.abs(scores).max() < 5 or levels[0] > 200
    light = ocisac.sense_region(
        lamp(1, 720, 20, 517.0), camera(), 517.0, background=BackgroundLight(0.0, 0.1, pooled.flags)
    )
    assert bool(light.flags & Flag.SATURATED) == clipped


def test_a_background_of_two_rows_at_black_has_a_standard_error():
    unlit = np.random.default_rng(0).integers(0, 3, (2, 40)).astype(np.uint8)
    assert np.isfinite(ocisac.background_light(unlit, camera()).std).all()


def test_background_beside_a_light():
    beside = ocisac.background_light(np.full((720, 12), 40.0) + np.arange(12), camera(), pooled=True)
    assert beside.mean == pytest.approx(45.5)
    assert beside.std == pytest.approx(np.std(np.arange(12), ddof=1) / np.sqrt(12))
    light = ocisac.sense_region(lamp(2, 720, 20, 517.0) + 45.5, camera(), 517.0, background=beside)
    sure = ocisac.sense_region(lamp(2, 720, 20, 517.0) + 45.5, camera(), 517.0, background=45.5)
    assert light.gain == pytest.approx(sure.gain, rel=1e-3)
    assert light.gain_std == pytest.approx(np.hypot(sure.gain_std, light.gain * beside.std / 100), rel=1e-2)


def test_a_texture_of_little_contrast():
    noise = np.random.default_rng(3).normal(0, 2, (720, 30))
    frames = 100 + 0.3 * (texture(1, 720, 30, 200, SPEED, noise=0.0) - 100) + noise
    found = ocisac.sense_region(frames, camera(), depth=0.3, motion=KnownMotion(axis="across"))
    assert found.gain == pytest.approx(found.theory, abs=4 * found.gain_std)
    assert found.contrast == pytest.approx(0.3 * found.gain)
    assert found.contrast_range == pytest.approx(found.contrast, rel=0.03)


def test_limits_are_flagged():
    frames, across = texture(1, 720, 20, 200, SPEED), KnownMotion(axis="across")
    for flag, view, told in (
        (Flag.FEW_CYCLES, texture(1, 720, 20, 40, SPEED), {"motion": across, "bounds": (30, 200)}),
        (Flag.NEAR_NULL, texture(1, 720, 20, 475, SPEED), {"motion": across, "frequency": 475 * SPEED}),
        (Flag.NO_LIGHT, frames, {"background": 150.0}),
        (Flag.WEAK, texture(1, 720, 2, 200, SPEED, noise=2000.0), {"frequency": 350.2}),
        (Flag.SATURATED, (2 * frames).clip(0, 255).astype(np.uint8), {}),
        (Flag.UNRESOLVABLE, frames, {"frequency": 0.5 / ROW_TIME}),
    ):
        found = ocisac.sense_region(view, camera(), **told)
        assert found.flags & flag
        assert flag not in (Flag.NO_LIGHT, Flag.UNRESOLVABLE) or math.isnan(found.gain)


def test_a_measured_frequency_is_given_with_its_standard_error():
    frames = lamp(2, 240, 9, 517.0)
    found = ocisac.find_frequency(frames[0], camera())
    assert isinstance(found, MeasuredFrequency)
    assert ocisac.sense_region(frames, camera(), found).frequency_std == found.frequency_std
    assert ocisac.sense_region(frames, camera(), found.frequency).frequency_std == 0.0


def irregular(frames, starts, speed=SPEED, shake=0.0, seed=0):
    """A texture that moves across the rows, in frames that begin at ``starts`` (s) and are shifted by up to ``shake``
    rows."""
    random = np.random.default_rng(seed)
    n, k = np.arange(720)[:, None], np.arange(12)
    shifts = shake * random.uniform(-1, 1, frames)
    f = 200 * speed
    turns = [
        f * ((n + shift) * ROW_TIME + start - 601e-6) - 0.2 * k for start, shift in zip(starts, shifts, strict=True)
    ]
    light = 100 * (1 + np.sinc(f * 1202e-6) * np.cos(2 * np.pi * np.array(turns)))
    return light + 2 * random.standard_normal(light.shape)


@pytest.mark.parametrize("frames", [2, 3, 8])
@pytest.mark.parametrize("seed", range(6))
def test_irregular_frames_widen_the_error_and_time_stamps_restore_it(frames, seed):
    starts = FRAME_TIME * np.arange(frames) + 2e-4 * np.random.default_rng(seed).uniform(-1, 1, frames)
    moving = irregular(frames, starts, seed=seed)
    blind = ocisac.sense_region(moving, camera())
    assert abs(blind.motion_frequency - 350.2) < 4 * blind.motion_frequency_std
    told = ocisac.sense_region(moving, camera(), motion=KnownMotion(frame_times=tuple(starts)))
    assert told.kind == "moving"
    assert not told.flags
    assert told.motion_frequency == pytest.approx(350.2, abs=4 * told.motion_frequency_std)
    assert told.motion_frequency_std < 0.5


@pytest.mark.parametrize("seed", range(6))
def test_a_shaking_camera_and_a_wrong_row_time_are_within_the_standard_error(seed):
    starts = FRAME_TIME * np.arange(3)
    shaken = ocisac.sense_region(irregular(3, starts, shake=1.0, seed=seed), camera())
    assert abs(shaken.motion_frequency - 350.2) < 4 * shaken.motion_frequency_std
    off = dataclasses.replace(camera(), row_time=(1.01 if seed % 2 else 0.99) * ROW_TIME)
    slow = ocisac.sense_region(irregular(3, starts, seed=seed), off)
    assert abs(slow.motion_frequency - 350.2) < 4 * slow.motion_frequency_std
    assert slow.flags & Flag.AMBIGUOUS_MOTION


def test_a_frame_time_shorter_than_the_rows_take_is_flagged():
    frames = lamp(4, 400, 24, 700.0)
    for frame_time, flagged in ((FRAME_TIME, False), (300 * ROW_TIME, True), (1e-3, True)):
        found = ocisac.sense_region(frames, camera(frame_time=frame_time), 700.0)
        assert bool(found.flags & Flag.MODEL_MISFIT) == flagged


@pytest.mark.parametrize("more", [0.0, 40.0])
def test_a_film_of_a_texture_whose_light_changes_is_flagged(more):
    frames = texture(6, 720, 20, 200, SPEED, per_column=-0.21)
    frames[3:] += more
    found = ocisac.sense_region(frames, camera(), motion=KnownMotion(axis="across", spatial_frequency=200.0))
    assert bool(found.flags & Flag.MODEL_MISFIT) == (more > 0)


@pytest.mark.parametrize("change", ["none", "dim", "steady", "steady at the end", "less deep", "more light beside it"])
def test_a_film_whose_lamp_changes_is_flagged(change):
    of_camera = camera(exposure=1e-3)
    light = 180 * ocisac.integrate_exposure(ocisac.SquareWave(700.0), of_camera, 480, frames=8)
    after = slice(7 if change == "steady at the end" else 4, None)
    if change.startswith("steady"):
        light[after] = 90
    light[after] *= {"dim": 0.4, "less deep": 0.5}.get(change, 1)
    light[after] += {"less deep": 45, "more light beside it": 30}.get(change, 0)
    frames = light[:, :, None] + np.random.default_rng(1).normal(0, 1, (8, 480, 40))
    found = ocisac.sense_region(frames, of_camera, waveform="square")
    assert bool(found.flags & Flag.MODEL_MISFIT) == (change not in ("none", "dim"))


def test_light_that_has_no_fourth_power_is_refused_by_its_tone_curve():
    frames = 1e50 * (2.0 + np.sin(0.1 * np.arange(480)))[:, np.newaxis] * np.ones(3)
    ocisac.sense_region(frames, Camera(ROW_TIME))
    with pytest.raises(ValueError, match="as the largest light, allowed: 1e-60 to 1e60"):
        ocisac.sense_region(frames, Camera(ROW_TIME, tone_curve="gamma"))


@pytest.mark.parametrize("rows", [200, 480])
def test_shading_that_explains_more_than_a_tone_is_none(rows):
    """The refined frequency falls to 0."""
    n = np.arange(rows)
    for seed in range(4):
        random = np.random.default_rng(seed)
        light = (1 - 0.3 * (2 * n / rows - 1) ** 2) * (
            1 + 0.05 * np.cos(2 * np.pi * 3.7 * n / rows + random.uniform(0, 6))
        )
        picture = np.clip(np.rint(115 * light[:, None] + random.normal(size=(rows, 60))), 0, 255).astype(np.uint8)
        found = ocisac.sense_region(picture, Camera(2e-5, exposure=1.2e-3))
        assert found.flags & (Flag.NO_TONE | Flag.AT_BOUND) or abs(found.frequency * 2e-5 * rows - 3.7) < 0.1


def square_errors(
    rows, row_time, frame_time, *, exposure, frequency=1000.0, level=90.0, noise=0.6, dark=20.0, seeds=12
):
    """|gain - theory|/gain_std of unflagged films of a square lamp: six frames of 64 columns of bytes."""
    errors = []
    for seed in range(seeds):
        random = np.random.default_rng([seed, 5])
        of_camera = Camera(row_time, exposure, frame_time, dark_level=dark)
        wave = ocisac.SquareWave(frequency, amplitude=2 * level, phase=random.uniform(0, 6))
        light = ocisac.integrate_exposure(wave, of_camera, rows, start=0.0, frames=6)[:, :, None]
        stored = dark + light * random.uniform(0.3, 1, 64) + noise * random.standard_normal((6, rows, 64))
        pixels = np.rint(stored).clip(0, 255).astype(np.uint8)
        found = ocisac.sense_region(pixels, of_camera, waveform="square")
        if not found.flags:
            errors.append((found.gain - np.sinc(frequency * exposure)) / found.gain_std)
    return np.abs(errors)


def test_noise_that_black_cuts_is_a_part_of_the_error():
    """40 rows show no pile in a column; in 64 columns of six frames the gain is 20 standard errors of noise off."""
    errors = square_errors(40, 193e-6, 10.3e-3, exposure=260e-6, level=25.0, noise=1.4, dark=0.0)
    assert len(errors) >= 4
    assert errors.max() < 4


@pytest.mark.parametrize(
    ("rows", "row_time", "frame_time", "exposure", "frequency"),
    [
        (200, 0.1992 / 1005, 0.04, 260e-6, 1005.0),  # the ninth harmonic 1.6 cycles from the fundamental
        (480, 60e-6, 0.0371, 100e-6, 1000.0),
    ],
)
def test_harmonics_above_half_the_row_rate_are_fitted_or_a_part_of_the_error(
    rows, row_time, frame_time, exposure, frequency
):
    errors = square_errors(rows, row_time, frame_time, exposure=exposure, frequency=frequency)
    assert len(errors) >= 10
    assert errors.max() < 4


def test_the_model_of_a_slow_square_wave_fits_into_memory():
    """A wave of 1 Hz in 30 000 rows, where 1 kHz was meant, took some GB."""
    assert len(harmonics_of(0.5, 2.2e-5, 30_000, 1e-4)[0]) <= 513


@pytest.mark.parametrize("wave", [ocisac.Tone, ocisac.SquareWave])
def test_a_light_without_the_harmonics_of_its_waveform_is_flagged(wave):
    random = np.random.default_rng(8)
    camera = Camera(22.2e-6, exposure=400e-6)
    light = ocisac.integrate_exposure(wave(500.0, phase=1.0), camera, 720)[:, None]
    pixels = np.rint(20 + 100 * light + random.standard_normal((720, 32))).astype(np.uint8)
    found = ocisac.sense_region(pixels, camera, frequency=500.0, waveform="square")
    assert bool(found.flags & Flag.MODEL_MISFIT) == (wave is ocisac.Tone)


@pytest.mark.parametrize(("across", "swing"), [(0.0, 6.8), (0.0, 3.3), (0.037, 3.3)])
@pytest.mark.parametrize(("noise", "rounded"), [(0.3, True), (0.8, False)])
def test_rounding_beside_the_error_of_many_pixels_is_flagged(across, swing, noise, rounded):
    """In a single column it hides in the noise; common to all, of a lamp or of a texture that moves across the rows, it
    is many standard errors of the region."""
    random, rows, columns = np.random.default_rng(4), np.arange(720)[:, None], np.arange(160)
    start = random.uniform(0, 6) + 2 * np.pi * 411.0 / 30 * np.arange(8)
    phase = 2 * np.pi * (411.0 * 20e-6 * rows + across * columns)
    light = 90 + swing * np.cos(phase + start[:, None, None])
    pixels = np.rint(light + noise * random.standard_normal((8, 720, 160))).astype(np.uint8)
    found = ocisac.sense_region(pixels, Camera(20e-6, 1e-3, 1 / 30))
    assert bool(found.flags & Flag.QUANTISED) is rounded


@pytest.mark.parametrize("row_noise", [0.0, 0.3, 1.0])
def test_noise_that_the_columns_of_a_row_share_is_in_the_standard_errors(row_noise):
    camera, scores = Camera(22.2e-6, 200e-6, 1 / 30, dark_level=16), []
    for seed in range(8):
        random = np.random.default_rng(seed)
        wave = ocisac.Tone(random.uniform(1000, 4000), phase=random.uniform(0, 6))
        light = ocisac.integrate_exposure(wave, camera, 480, frames=3)[..., None]
        shared = row_noise * random.standard_normal(light.shape)
        pixels = np.rint(16 + 100 * light + shared + random.standard_normal((3, 480, 200))).astype(np.uint8)
        found = ocisac.sense_region(pixels, camera)
        restored = ocisac.restore_contrast(pixels[0], camera, wave.frequency)
        steady = np.rint(56 + shared + random.standard_normal(pixels.shape)).astype(np.uint8)
        background = ocisac.sensing.background_light(steady, camera, pooled=True)
        theory = abs(np.sinc(wave.frequency * camera.exposure))
        scores += [
            (found.gain - theory) / found.gain_std,
            (restored.before - theory) / restored.before_std,
            (background.mean - 40) / background.std,
        ]
    assert np.sqrt(np.mean(np.square(scores))) < 1.4
    assert np.abs(scores).max() < 4


def test_restored_contrast_has_the_flags_of_its_columns():
    random, camera = np.random.default_rng(1), Camera(22.2e-6, 1e-3)
    light = ocisac.integrate_exposure(ocisac.Tone(300.0), camera, 480)[:, None]
    pixels = np.rint(20 + 2 * light + 0.15 * random.standard_normal((480, 60))).astype(np.uint8)
    assert ocisac.restore_contrast(pixels, camera, 300.0).flags & Flag.QUANTISED
