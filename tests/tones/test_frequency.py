"""Frequency search and the choice of columns."""

import json
import pathlib

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

import ocisac_fast as oc
from ocisac_fast import Camera, Flag, calibrate

PER_ROW = Camera(row_time=1.0)


def square_through_exposure(frequency, rows, exposure, turns=0.0):
    wave = oc.SquareWave(frequency, phase=2 * np.pi * turns)
    return oc.integrate_exposure(wave, Camera(1.0, exposure), rows)


def tone(frequency, rows, phase=0.0):
    return np.cos(2 * np.pi * frequency * np.arange(rows) + phase)


def rms_bound(frequency, rows, amplitude, sigma, trend_degree):
    """Cramér–Rao bound of the frequency of one tone beside a polynomial, all amplitudes unknown; over all phases."""
    n = np.arange(rows)
    turn = 2 * np.pi * frequency * n
    others = np.stack([*((2 * n / rows - 1) ** d for d in range(trend_degree + 1)), np.cos(turn), np.sin(turn)], axis=1)
    slopes = np.stack([n * np.sin(turn + phase) for phase in np.pi * np.arange(40) / 40], axis=1)
    rest = 2 * np.pi * amplitude * (slopes - others @ np.linalg.lstsq(others, slopes, rcond=None)[0])
    return sigma * np.sqrt(np.mean(1 / (rest**2).sum(axis=0)))


def test_columns_of_opposite_or_turning_phase_are_flagged():
    """A chessboard and slanting stripes are periodic along the rows of each column; a lamp over texture is a light."""
    camera = Camera(22.2e-6, 100e-6)
    row, column = np.mgrid[:480, :640]
    for seed in range(8):
        rng = np.random.default_rng(seed)
        side, slope = rng.integers(5, 60), rng.uniform(0.06, 1)
        chessboard = 30 + 180 * ((row // side + column // side) % 2)
        stripes = 120 + 60 * np.sin((row + slope * column) / rng.uniform(3, 12))
        texture = 120 + np.cumsum(rng.normal(0, 3, 640))
        lamp = texture * (1 + 0.1 * np.sin(row / rng.uniform(1, 12)))
        for pattern, expected in ((chessboard, Flag.MODEL_MISFIT), (stripes, Flag.MODEL_MISFIT), (lamp, 0)):
            frame = (pattern + rng.normal(0, 2, row.shape)).clip(0, 255).astype(np.uint8)
            assert oc.find_frequency(frame, camera).flags & (Flag.MODEL_MISFIT | Flag.NO_TONE) == expected


def test_a_jump_of_the_phase_is_flagged():
    """Lost or repeated rows; a lamp that fades along the rows has none."""
    camera = Camera(22.2e-6, 300e-6)
    light = 200 * oc.integrate_exposure(oc.Tone(1500.0, phase=0.3), camera, 720)[:, np.newaxis]
    pixels = (light + np.random.default_rng(2).normal(0, 1, (720, 60))).clip(0, 255).round()
    fading = pixels * np.linspace(1, 0.2, 720)[:, np.newaxis]
    for whole in (pixels, fading):
        assert oc.calibrate(whole, 1500.0).flags == 0
    for broken in (np.delete(pixels, [300, 301], 0), np.concatenate([pixels[:300], pixels[297:]])):
        assert oc.find_frequency(broken, camera).flags & oc.Flag.MODEL_MISFIT
        assert oc.calibrate(broken, 1500.0).flags & oc.Flag.MODEL_MISFIT


# --- real pictures ---------------------------------------------------------------------------------------------------


def entries(recordings, kind):
    return [entry for entry in json.loads((recordings / "recordings.json").read_text()) if kind in entry]


def colours_of(path: pathlib.Path):
    image = pytest.importorskip("PIL.Image")
    return list(np.moveaxis(np.asarray(image.open(path).convert("RGB")), -1, 0))


def test_tones_of_real_pictures(recordings):
    for entry in entries(recordings, "tone"):
        camera = Camera(entry["row_time_s"], entry.get("exposure_s"))
        colours = colours_of(recordings / entry["file"])
        best = colours[oc.pick_colour(colours, camera)]
        for waveform in ("auto", "tone", "square"):
            found = oc.find_frequency(best, camera, waveform=waveform)
            want = entry["tone"]
            assert found.frequency == pytest.approx(want["frequency_hz"], rel=want["tolerance"]), entry["file"]
            assert found.flags == 0
            assert 0 < found.frequency_std < want["tolerance"] * want["frequency_hz"]


# --- known light -----------------------------------------------------------------------------------------------------


@settings(max_examples=settings.default.max_examples // 2)
@given(
    rows=st.sampled_from([97, 251, 720, 1080]),
    place=st.floats(0, 1),
    phase=st.floats(0, 1),
    exposure=st.floats(0.2, 4),
    square=st.booleans(),
    noise=st.sampled_from([0.02, 0.1, 0.3]),
    seed=st.integers(0, 2**32 - 1),
)
def test_finds_any_frequency(rows, place, phase, exposure, square, noise, seed):
    frequency = 1.2 / rows * (0.49 * rows / 1.2) ** place  # from 1.2 cycles in the frame to 0.49 a row
    if square:
        exposure = min(exposure, 0.4 / frequency)  # a longer one makes the fundamental small
        light = square_through_exposure(frequency, rows, exposure, phase)
    else:
        light = 0.5 + 0.5 * tone(frequency, rows, 2 * np.pi * phase)
    columns = light[:, np.newaxis] * [100.0, 80.0, 60.0, 90.0]
    columns += np.random.default_rng(seed).normal(0, noise * 50, columns.shape)
    found = oc.find_frequency(columns, PER_ROW)
    assert not found.flags & Flag.NO_TONE
    # Beside noise: less than two cycles hardly tell their harmonics apart.
    unresolved = 0.12 / rows if square and found.flags & Flag.FEW_CYCLES else 0
    assert abs(found.cycles_per_row - frequency) < 6 * found.cycles_per_row_std + unresolved


@pytest.mark.parametrize(
    ("rows", "cycles", "duty", "exposure"),
    [(120, 14.9311, 0.5, 0.716), (64, 21.4493, 0.2, 0.723), (120, 39.9358, 0.2, 1.947), (120, 3.0127, 0.5, 0.544)],
)
def test_harmonics_that_fold_beside_own_ones_are_a_part_of_the_error(rows, cycles, duty, exposure):
    random = np.random.default_rng(rows)
    for turns in np.linspace(0, 1, 20, endpoint=False):
        wave = oc.SquareWave(cycles / rows, duty=duty, phase=2 * np.pi * turns)
        light = 20 + 200 * oc.integrate_exposure(wave, Camera(1.0, exposure), rows)
        found = oc.find_frequency(light[:, np.newaxis] + random.normal(0, 0.3, (rows, 32)), PER_ROW)
        error = abs(found.cycles_per_row * rows - cycles)
        assert error < 6 * found.cycles_per_row_std * rows or found.flags, (turns, error)
        assert found.cycles_per_row_std * rows < 0.5
    stated = oc.find_frequency(0.5 + 0.5 * tone(0.4, 720)[:, np.newaxis], PER_ROW, waveform="tone")
    assert stated.cycles_per_row_std * 720 < 1e-6


@pytest.mark.parametrize(("rows", "cycles"), [(200, 8.3), (200, 1.4), (720, 30.7), (300, 0.31 * 300)])
def test_spread_is_that_of_the_bound_and_of_the_standard_error(rows, cycles):
    trials, sigma, frequency = 400, 0.4, cycles / rows
    random = np.random.default_rng(7)
    errors, stds = np.empty(trials), np.empty(trials)
    for i in range(trials):
        columns = 1 + tone(frequency, rows, random.uniform(0, 2 * np.pi))[:, np.newaxis] * [1.0, 0.7]
        columns += random.normal(0, sigma, columns.shape)
        found = oc.find_frequency(columns, PER_ROW, waveform="tone")
        errors[i], stds[i] = found.cycles_per_row - frequency, found.cycles_per_row_std
    bound = rms_bound(frequency, rows, np.hypot(1, 0.7), sigma, 0 if cycles < 2 else 2)
    spread = np.sqrt(np.mean(errors**2))
    assert abs(np.mean(errors)) < 4 * spread / np.sqrt(trials)
    assert spread == pytest.approx(bound, rel=0.1)
    assert np.sqrt(np.mean(stds**2)) == pytest.approx(spread, rel=0.1)


def test_standard_error_is_honest_about_noise_that_columns_share():
    rows, frequency, random = 720, 0.0312, np.random.default_rng(5)
    errors, stds = np.empty(200), np.empty(200)
    for i in range(len(errors)):
        rough = random.normal(0, 0.3, rows + 4)
        speckle = np.convolve(rough, np.ones(5) / np.sqrt(5), "valid")  # over 5 rows, the same in all columns
        columns = ((1 + tone(frequency, rows, random.uniform(0, 6))) * (1 + speckle))[:, np.newaxis] * np.ones(8)
        found = oc.find_frequency(columns + random.normal(0, 0.02, columns.shape), PER_ROW, waveform="tone")
        errors[i], stds[i] = found.frequency - frequency, found.frequency_std
    assert np.sqrt(np.mean(stds**2)) == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.25)


@pytest.mark.parametrize("cycles", [4.6, 17.3, 150.2])
def test_gradients_of_the_light_do_not_move_the_frequency(cycles):
    rows, random = 720, np.random.default_rng(11)
    x = np.linspace(-1, 1, rows)
    envelope = 1.5 - 0.5 * x - 0.8 * x**2  # of the source; and ambient light four times as strong
    light = envelope * (1 + tone(cycles / rows, rows, 0.4)) + 4 * (1 + 0.7 * x)
    columns = light[:, np.newaxis] * np.ones(4) + random.normal(0, 0.1, (rows, 4))
    found = oc.find_frequency(columns, PER_ROW, waveform="tone")
    assert not found.flags
    assert abs(found.frequency * rows - cycles) < 0.005 + 4 * found.frequency_std * rows


def test_harmonics_sharpen_a_square_wave_and_are_not_taken_for_it():
    rows, random = 720, np.random.default_rng(2)
    for frequency in (0.0051, 0.013, 0.041):
        light = square_through_exposure(frequency, rows, 2.0, 0.3)[:, np.newaxis] * [50.0, 40.0]
        columns = light + random.normal(0, 5, light.shape)
        by = {wave: oc.find_frequency(columns, PER_ROW, waveform=wave) for wave in ("auto", "tone", "square")}
        assert by["tone"].harmonics == 1 < by["auto"].harmonics <= by["square"].harmonics <= 31
        assert by["auto"].frequency_std < 0.8 * by["tone"].frequency_std
        for found in by.values():
            assert abs(found.frequency - frequency) < 5 * found.frequency_std


def test_a_weak_light_over_the_whole_frame_is_found_in_the_sum_of_its_columns():
    random = np.random.default_rng(4)
    columns = 100 + 0.08 * tone(0.0837, 720)[:, np.newaxis] + random.normal(0, 1, (720, 64))
    found = oc.find_frequency(columns, PER_ROW)
    assert not found.flags
    assert abs(found.frequency - 0.0837) < 5 * found.frequency_std


# --- columns and colours --------------------------------------------------------------------------------------------


def scene():
    """A lit band of columns 80 to 159 of 240, boxes with text over columns 120 to 159, a saturated strip from 160."""
    random = np.random.default_rng(8)
    picture = np.full((600, 240), 20.0)
    picture[:, 80:160] += 120 * square_through_exposure(0.0123, 600, 3.0)[:, np.newaxis]
    picture[100:400, 120:160] = 255 * (random.random((300, 40)) > 0.8)
    picture += random.normal(0, 4, picture.shape)
    picture[:, 160:200] = np.where(tone(0.0123, 600)[:, np.newaxis] > -0.9, 255, 200)
    return np.clip(picture, 0, 255).astype(np.uint8)


def test_columns_that_show_the_light_are_found():
    picture = scene()
    found = oc.find_frequency(picture, PER_ROW)
    assert abs(found.frequency - 0.0123) < max(5 * found.frequency_std, 1e-6)
    assert not found.flags
    for columns in (found.columns, oc.tone_columns(picture, PER_ROW), oc.tone_columns(picture, PER_ROW, 0.0123)):
        assert columns.used[84:116].all()
        assert not columns.used[:76].any()
        assert not columns.used[124:].any()
        assert columns.strength[100] > 0.8 > 0.5 > columns.strength[140]
    everything = oc.find_frequency(picture, PER_ROW, select=False)
    assert everything.columns.used.all()


def test_saturated_columns_serve_where_there_are_no_others():
    picture = scene()[:, 160:200]
    found = oc.find_frequency(picture, PER_ROW)
    assert found.flags == Flag.SATURATED
    assert abs(found.frequency - 0.0123) < 1e-4


def test_white_level_says_where_pixels_saturate():
    light = np.clip(80 + 120 * tone(0.02, 500), 0, 180)[:, np.newaxis] * np.ones(3)
    noisy = light + np.random.default_rng(1).uniform(-0.4, 0, light.shape)
    assert not oc.find_frequency(noisy, PER_ROW).flags
    assert oc.find_frequency(noisy, Camera(1.0, white_level=179.0)).flags == Flag.SATURATED


# --- what the answers are, by their definitions -----------------------------------------------------------------------


def model_of(frequency, rows, harmonics):
    """Trend of a degree that grows with the cycles in the frame, and the harmonics that the rows can show."""
    degree = 0 if frequency * rows < 2 else 1 if frequency * rows < 4 else 2
    shown = [1] + [h for h in range(2, harmonics + 1) if h * frequency <= 0.5 - 0.5 / rows]
    while len(shown) > 1 and rows < 2 * (degree + 1 + 2 * len(shown)):
        shown.pop()
    trend = np.stack([np.linspace(-1, 1, rows) ** d for d in range(degree + 1)], axis=1)
    turns = 2 * np.pi * frequency * np.arange(rows)
    return trend, np.stack([wave(h * turns) for h in shown for wave in (np.cos, np.sin)], axis=1)


def misfit(light, *parts):
    """Squares that the least-squares fit of all parts leaves, of every signal."""
    basis = np.hstack(parts)
    return ((light - basis @ np.linalg.lstsq(basis, light, rcond=None)[0]) ** 2).sum(axis=0)


def random_view(rows, columns, frames, place, noise, dtype, flip, seed):
    """Strided samples of a tone, and its frequency."""
    random = np.random.default_rng(seed)
    frequency = 1.2 / rows * (0.49 * rows / 1.2) ** place
    light = 128 + 60 * tone(frequency, rows)[:, np.newaxis] * random.uniform(0.2, 1, abs(flip) * columns)
    light = light + random.normal(0, noise, (frames, *light.shape) if frames else light.shape)
    return np.clip(light, 0, 255).astype(dtype)[..., ::flip], frequency


VIEWS = {
    "rows": st.sampled_from([8, 9, 16, 23, 97, 251]),
    "columns": st.sampled_from([1, 2, 3, 60]),
    "frames": st.sampled_from([0, 1, 3]),
    "place": st.floats(0, 1),
    "noise": st.sampled_from([1.0, 10.0, 100.0]),
    "dtype": st.sampled_from(["uint8", "uint16", "float32", "float64"]),
    "flip": st.sampled_from([1, -1, 2]),
    "seed": st.integers(0, 2**32 - 1),
}


@settings(max_examples=settings.default.max_examples // 4)
@given(**VIEWS)
def test_strength_of_a_column_is_the_share_of_its_swing_that_the_tone_explains(**how):
    view, frequency = random_view(**how)
    frequency = min(frequency, 0.45)
    found = oc.tone_columns(view, Camera(2e-5, white_level=300.0), frequency / 2e-5)
    light = view.astype(float).reshape(-1, *view.shape[-2:])
    trend, waves = model_of(frequency, light.shape[1], 3)
    if light.shape[1] <= trend.shape[1] + waves.shape[1]:
        assert found.used.all()
        return
    level, rest = (np.array([misfit(f - f.mean(axis=0), *parts) for f in light]) for parts in ([trend], [trend, waves]))
    periodic, rest = (level - rest).sum(axis=0), rest.sum(axis=0)
    np.testing.assert_allclose(found.strength, periodic / (periodic + rest), atol=1e-9)
    ratio = periodic / (rest + 1e-6 * periodic)
    sure = np.abs(ratio / (ratio.max() / 10) - 1) > 1e-6
    np.testing.assert_array_equal(found.used[sure], (ratio >= ratio.max() / 10)[sure])


@settings(max_examples=2 * settings.default.max_examples // 5)
@given(
    rows=st.sampled_from([23, 97, 251, 720]),
    place=st.floats(0.1, 0.95),
    noise=st.sampled_from([1.0, 10.0, 30.0]),
    seed=st.integers(0, 2**32 - 1),
)
@example(rows=23, place=0.125, noise=10.0, seed=550)
@example(rows=251, place=0.5, noise=10.0, seed=247)
def test_the_frequency_of_one_column_is_that_of_least_squares(rows, place, noise, seed):
    view, _ = random_view(rows, 1, 0, place, noise, "float64", 1, seed)
    found = oc.find_frequency(view, PER_ROW, waveform="tone")
    if found.flags & (Flag.NO_TONE | Flag.AT_BOUND):
        return
    assert found.harmonics == 1
    around = found.frequency + found.frequency_std * np.linspace(-2, 2, 9)
    if model_of(around[0], rows, 1)[0].shape != model_of(around[-1], rows, 1)[0].shape:
        return  # the degree of the trend changes here
    left = np.array([misfit(view, *model_of(f, rows, 1))[0] for f in around])
    _, bend, slope, _ = np.polyfit(np.linspace(-2, 2, 9), left, 3)  # in few rows the two sides differ
    assert left.argmin() == 4
    assert abs(slope / (2 * bend)) < 0.1  # the minimum, in standard errors
    # One standard error off costs the variance of a row, once: the curvature is the information. The standard error
    # also counts how the residuals of neighbouring rows correlate by chance: the logarithm of the ratio scatters by
    # 3/√rows (4000 random examples: −5 to 4 times that).
    parameters = sum(part.shape[1] for part in model_of(found.frequency, rows, 1)) + 1
    if rows > 200:
        assert abs(np.log(bend * (rows - parameters) / left[4])) < 7 * 3 / np.sqrt(rows)


# --- what cannot be answered -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("columns", [np.zeros((50, 3)), np.full((50, 3), 255, np.uint8), np.full(50, 0.1), np.eye(3)])
def test_nothing_to_see_is_nan_and_flagged(columns):
    found = oc.find_frequency(columns, PER_ROW)
    assert np.isnan(found.frequency)
    assert np.isnan(found.frequency_std)
    assert found.flags == Flag.NO_TONE
    assert found.columns.used.all()


@pytest.mark.parametrize("rows", [1, 2, 3, 7])
def test_too_few_rows_are_flagged(rows):
    found = oc.find_frequency(np.arange(2.0 * rows).reshape(rows, 2), PER_ROW)
    assert found.flags == Flag.NO_TONE
    assert np.isnan(found.frequency)
    assert oc.tone_columns(np.ones((rows, 2)), PER_ROW, 0.1).used.all()


@pytest.mark.parametrize("count", [1, 4, 64, 130])
def test_noise_is_no_tone(count):
    random = np.random.default_rng(12)
    for rows in (30, 100, 300):
        for _ in range(8):
            assert oc.find_frequency(random.normal(0, 1, (rows, count)), PER_ROW).flags & Flag.NO_TONE


def noise_of_rows(random, spread, correlation, rows=400):
    """First-order autoregressive noise, (rows, 1)."""
    noise = random.normal(0, spread, rows + 100)
    for n in range(1, noise.size):
        noise[n] = correlation * noise[n - 1] + np.sqrt(1 - correlation**2) * noise[n]
    return noise[100:, np.newaxis]


@pytest.mark.parametrize("spread", [0.5, 2, 8])
@pytest.mark.parametrize(("correlation", "most"), [(0, 1), (0.6, 1), (0.8, 2)])
def test_noise_that_all_columns_share_is_no_tone(spread, correlation, most):
    """Every column shows the same peak of its spectrum; a tone of up to twice the swing stands out of it."""
    random = np.random.default_rng(13)
    found, missed = 0, 0
    for _ in range(100):
        rows = noise_of_rows(random, spread, correlation)
        noise = np.rint(128 + rows + random.normal(0, 2, (400, 40)))
        found += not oc.find_frequency(noise, PER_ROW).flags
        seen = oc.find_frequency(noise + (1 + correlation) * spread * tone(0.07, 400)[:, np.newaxis], PER_ROW)
        missed += bool(seen.flags & Flag.NO_TONE) or abs(seen.frequency - 0.07) > 5 * seen.frequency_std
    assert found <= most
    assert missed <= 1


def test_two_lamps_are_no_noise_about_each_other():
    random = np.random.default_rng(3)
    for _ in range(20):
        shade = np.exp(np.cumsum(random.normal(0, 0.004, 480)))
        swing = 0.23 * tone(1 / 50, 480, random.uniform(0, 6)) + 0.18 * tone(1 / 82, 480, random.uniform(0, 6))
        found = oc.find_frequency((100 * shade * (1 + swing) + random.normal(0, 1, 480))[:, np.newaxis], PER_ROW)
        assert not found.flags & Flag.NO_TONE
        assert found.frequency * 50 == pytest.approx(1, rel=0.02)


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.3])
@pytest.mark.parametrize("columns", [1, 60])
def test_stairs_of_a_rounded_gradient_are_no_light(noise, columns):
    """A graded wall of a denoised picture has a step every few rows."""
    random = np.random.default_rng(4)
    for _ in range(30):
        wall = 5 + random.uniform(0.05, 0.33) * np.arange(720)[:, np.newaxis] + np.zeros(columns)
        stairs = np.clip(np.rint(wall + random.normal(0, noise, wall.shape)), 0, 255).astype(np.uint8)
        assert oc.find_frequency(stairs, PER_ROW).flags
        assert oc.calibrate(stairs, 500.0).flags
        if not noise:
            assert oc.find_frequency(wall, PER_ROW).flags  # rounding of doubles
    faint = 0.3 * tone(0.02, 720)[:, np.newaxis] + 80 + random.normal(0, 1, (720, 60))
    assert not oc.find_frequency(np.rint(faint).astype(np.uint8), PER_ROW).flags


def test_few_cycles_and_bounds_are_flagged():
    columns = 3 + tone(1.5 / 500, 500) + np.random.default_rng(1).normal(0, 0.05, 500)
    assert oc.find_frequency(columns, PER_ROW).flags == Flag.FEW_CYCLES
    columns = 3 + tone(0.05, 500) + np.random.default_rng(1).normal(0, 0.05, 500)
    assert oc.find_frequency(columns, PER_ROW, bounds=(0.04, 0.06)).flags == 0
    cut = oc.find_frequency(columns, PER_ROW, bounds=(0.0505, 0.06))
    assert cut.flags & Flag.AT_BOUND
    assert cut.frequency == pytest.approx(0.0505)
    assert oc.find_frequency(columns, Camera(1e-5), bounds=(0, 1e9)).frequency == pytest.approx(5000, rel=1e-3)
    assert oc.find_frequency(columns, PER_ROW, bounds=(0, 1e-9)).flags & Flag.AT_BOUND


@pytest.mark.parametrize("duty", [0.1, 0.2, 0.3])
def test_faint_pulses_in_wide_frames_have_their_fundamental(duty):
    """A light of half the noise in 64 columns: its third harmonic alone was cheaper for each of them."""
    for seed in range(10):
        random = np.random.default_rng([seed, 5])
        frequency = random.uniform(4000, 7000)
        wave = oc.SquareWave(frequency, phase=random.uniform(0, 6), duty=duty)
        light = oc.integrate_exposure(wave, Camera(22.2e-6, exposure=20e-6), np.arange(1080))[:, None]
        columns = 50 + 0.5 * light + random.standard_normal((1080, 64))
        found = oc.find_frequency(columns, Camera(22.2e-6))
        assert found.frequency == pytest.approx(frequency, abs=5 * found.frequency_std)
        assert not found.flags


@pytest.mark.parametrize(("duty", "most"), [(0.1, 0), (0.05, 2)])
def test_a_folded_harmonic_of_thin_pulses_is_in_doubt(duty, most):
    """Faster than four rows a cycle a harmonic was taken for the fundamental, as of another row time."""
    exposure, wrong = Camera(22.2e-6, 2.4e-6), []
    for seed, rows_per_cycle in enumerate(np.linspace(2.02, 8, 60)):
        random = np.random.default_rng(seed)
        frequency = 1 / (22.2e-6 * rows_per_cycle)
        light = oc.integrate_exposure(oc.SquareWave(frequency, duty=duty, phase=random.uniform(0, 6)), exposure, 1080)
        columns = 20 + 180 * light[:, None] + 0.5 * random.standard_normal((1080, 8))
        found = oc.find_frequency(columns, exposure)
        wrong.append(abs(found.frequency - frequency) > 20)
        assert not found.flags or wrong[-1] or found.may_be_texture or rows_per_cycle > 4
        wrong[-1] &= not found.flags
    assert sum(wrong) <= most
    columns = 20 + 180 * oc.integrate_exposure(oc.SquareWave(21049, duty=0.1), exposure, 1080)[:, None] * np.ones(8)
    assert calibrate(columns + random.normal(0, 0.5, (1080, 8)), 21049).flags & Flag.MODEL_MISFIT


def test_a_fundamental_weaker_than_half_of_its_harmonic_is_in_doubt():
    row = 2 * np.pi * 0.02 * np.arange(1080)
    noise = np.random.default_rng(1).normal(0, 1, 1080)
    for size in (8, 10, 14):
        light = 100 + size * np.cos(row) + 30 * np.cos(2 * row + 1)
        assert oc.find_frequency(light + noise, PER_ROW).flags == Flag.MODEL_MISFIT
    strong = oc.find_frequency(100 + 20 * np.cos(row) + 30 * np.cos(2 * row + 1) + noise, PER_ROW)
    assert (strong.frequency, strong.flags) == (pytest.approx(0.02, rel=1e-3), 0)
    alone = oc.find_frequency(100 + 30 * np.cos(2 * row + 1) + noise, PER_ROW)
    assert (alone.frequency, alone.flags) == (pytest.approx(0.04, rel=1e-3), 0)


def test_changes_from_frame_to_frame_tell_a_light_of_few_cycles_over_a_still_picture():
    errors = []
    for seed in range(12):
        random = np.random.default_rng(seed)
        rows, row_time, frame_time = 480, 58.3e-6, 1 / 30
        frequency = random.uniform(35, 130)
        if abs(frequency * frame_time - round(frequency * frame_time)) < 0.06:
            continue  # in step with the frames: it stands still
        texture = 60 * np.exp(np.cumsum(random.standard_normal((rows, 40)), axis=0) / np.sqrt(rows))
        times = np.arange(8)[:, None] * frame_time + np.arange(rows) * row_time
        light = 1 + 0.1 * np.cos(2 * np.pi * frequency * times + random.uniform(0, 6))
        stored = texture * light[..., None] + 2 * random.standard_normal((8, rows, 40))
        pixels = np.clip(np.rint(stored), 0, 255).astype(np.uint8)
        found = oc.find_frequency(pixels, Camera(row_time, frame_time=frame_time))
        errors.append((found.frequency - frequency) / found.frequency_std)
        assert found.frequency == pytest.approx(frequency, rel=1e-3)
        assert not found.flags & (Flag.FEW_CYCLES | Flag.AT_BOUND | Flag.NO_TONE)
        still = np.clip(np.rint(texture + 2 * random.standard_normal((8, rows, 40))), 0, 255).astype(np.uint8)
        assert oc.find_frequency(still, Camera(row_time, frame_time=frame_time)).flags
    assert np.sqrt(np.mean(np.square(errors))) < 2


@pytest.mark.parametrize("frame_time", [1 / 30, 1e-3, 1e-4])
def test_noise_of_a_few_rows_in_a_few_frames_is_no_tone(frame_time):
    """Cosine and sine may be alike in them, or any tone explains what they hold."""
    found = 0
    for seed in range(100):
        random = np.random.default_rng(seed)
        shape = (*random.integers((4, 1), (9, 5)), 8)
        frames, camera = random.integers(0, 255, shape).astype(np.uint8), Camera(22.2e-6, frame_time=frame_time)
        found += not oc.find_frequency(frames, camera).flags
        if seed < 20:
            assert oc.tone_columns(frames, camera).used.size == 8
            assert oc.sense_region(frames, camera).flags
    assert found <= 1


@pytest.mark.parametrize(("rows", "columns"), [(8, 8), (8, 1), (5, 9)])
def test_blocks_of_compression_are_no_tone(rows, columns):
    """Random blocks have noise that is strong at low frequencies in every part of the picture."""
    found = 0
    for seed in range(20):
        blocks = np.random.default_rng(seed).normal(0, 25, (720 // rows, 960 // columns))
        picture = np.clip(128 + np.kron(blocks, np.ones((rows, columns))), 0, 255).astype(np.uint8)
        found += not oc.find_frequency(picture, PER_ROW).flags
    assert found <= 2


def wall(random, rows, columns, contrast, slope):
    """Texture, (rows, columns), drawn out across the rows, whose amplitudes fall with this power of the frequency."""
    along, across = 3 * np.fft.fftfreq(rows)[:, np.newaxis], 3 * np.fft.fftfreq(columns)
    falling = np.maximum(np.hypot(along, across), 1 / columns) ** slope
    texture = np.fft.ifft2(np.fft.fft2(random.normal(size=(rows, columns))) / falling).real
    return np.exp(contrast * texture / texture.std())


@pytest.mark.parametrize("frames", [1, 4])
def test_a_strip_of_a_wall_is_no_light_and_a_lamp_on_it_is_one(frames):
    random, camera = np.random.default_rng(17), Camera(22.2e-6, 100e-6, 0.0331)
    walls = wrong = right = 0
    for seed in range(100):
        light = 80 * wall(random, 480, int(random.choice([8, 16, 48])), 0.1 + 0.2 * (seed % 2), random.uniform(1, 1.6))
        noise = 10 + random.normal(0, 1.5, (frames, *light.shape))
        walls += not oc.find_frequency(np.clip(np.rint(light + noise), 0, 255).astype(np.uint8), camera).flags
        frequency = np.exp(random.uniform(np.log(5), np.log(60))) / (480 * 22.2e-6)
        times = np.arange(frames)[:, np.newaxis] * camera.frame_time + np.arange(480) * camera.row_time
        lamp = 1 + 0.4 * np.cos(2 * np.pi * frequency * times)[..., np.newaxis]
        found = oc.find_frequency(np.clip(np.rint(0.7 * light * lamp + noise), 0, 255).astype(np.uint8), camera)
        near = abs(found.frequency - frequency) < 6 * found.frequency_std
        wrong += not found.flags and not near
        right += not found.flags and near
    assert max(walls, wrong) <= 2
    assert right >= 80


@pytest.mark.parametrize("swing", [1.0, 3.0])
@pytest.mark.parametrize("rows", [120, 480])
def test_rounding_is_a_part_of_the_error_of_noiseless_light(rows, swing):
    """Near a whole number of rows a cycle the stored rows repeat, and a frequency nearby explains them exactly."""
    random, deviations = np.random.default_rng(9), []
    for _ in range(60):
        per_row = (1 + random.normal(0, 0.1) / rows) / random.integers(3, 25)
        light = np.rint(100.3 + swing * tone(per_row, rows, random.uniform(0, 6)))
        found = oc.find_frequency(np.tile(light.astype(np.uint8)[:, np.newaxis], 16), PER_ROW)
        if not found.flags:
            deviations.append((found.frequency - per_row) / found.frequency_std)
    assert len(deviations) >= 40
    assert np.sqrt(np.mean(np.square(deviations))) < 1.5


@pytest.mark.parametrize("period", [2, 4])
def test_rows_of_two_exposures_in_turns_are_no_light(period):
    rows, random = np.arange(720), np.random.default_rng(1)
    share = np.where(rows // (period // 2) % 2, 1, 0.25)
    for per_row in (0.0067, 0.0155, 0.0333, 0.0643, 0.14):
        light = 100 * share * (1 + 0.6 * np.cos(2 * np.pi * per_row * rows))
        pixels = np.rint(light[:, np.newaxis] + random.normal(0, 2, (720, 100))).astype(np.uint8)
        found, calibrated = oc.find_frequency(pixels, PER_ROW), oc.calibrate(pixels, per_row)
        assert found.flags or found.frequency == pytest.approx(per_row, rel=0.003)
        assert calibrated.flags or calibrated.row_time == pytest.approx(1, rel=0.005)
        assert all(abs(light.frequency - 0.25) > 1e-3 for light in oc.detect_sources(pixels, PER_ROW))


@pytest.mark.parametrize("duty", [0.1, 0.2])
@pytest.mark.parametrize(("first", "last"), [(0.3, 0.75), (0.1, 0.9)])
def test_pulses_in_a_part_of_the_rows_are_no_texture(first, last, duty):
    """Side lobes of each harmonic lie beside it, as texture does."""
    random, rows, camera = np.random.default_rng(4), np.arange(1080), Camera(18e-6, 100e-6)
    right = 0
    for _ in range(20):
        lamp = oc.SquareWave(970 * random.uniform(0.9, 1.1), duty=duty, phase=random.uniform(0, 6))
        light = oc.integrate_exposure(lamp, camera, 1080) * (rows > first * 1080) * (rows < last * 1080)
        pixels = 20 + 180 * light[:, np.newaxis] + random.normal(0, 2, (1080, 60))
        found = oc.find_frequency(np.clip(np.rint(pixels), 0, 255).astype(np.uint8), camera)
        right += not found.flags and found.frequency == pytest.approx(lamp.frequency, rel=0.01)
    assert right >= 18


@pytest.mark.parametrize("rows", [64, 120, 200])
def test_a_lamp_near_half_the_row_rate_is_no_texture(rows):
    """No line of the spectrum beside it tells of texture there."""
    random = np.random.default_rng(2)
    for cycles in np.linspace(1.5, 6, 10):
        light = 100 + 40 * tone(0.5 - cycles / rows, rows, random.uniform(0, 6))[:, np.newaxis]
        pixels = np.rint(light + random.normal(0, 1.5, (rows, 16))).astype(np.uint8)
        assert not oc.find_frequency(pixels, PER_ROW).flags


@pytest.mark.parametrize("scale", [5e-324, 1e-200])
def test_films_whose_squares_are_0_are_searched_without_a_warning(scale):
    film = scale * np.random.default_rng(1).random((4, 64, 9))
    with np.errstate(divide="raise", invalid="raise"):
        assert oc.find_frequency(film, Camera(2e-5, frame_time=1 / 30)).flags


def test_frames_that_share_their_errors_count_as_one():
    """A frozen film has the error of a frame; in one of a lamp that keeps its phase noise of the rows is shared."""
    random = np.random.default_rng(3)
    rows, frames = 480, 60
    light = 100 + 80 * tone(0.02123, rows)[:, None]
    still, moving = random.normal(0, 3, (rows, 20)), random.normal(0, 3, (frames, rows, 20))
    one = oc.find_frequency(light + still, PER_ROW).frequency_std
    assert oc.find_frequency(np.repeat((light + still)[None], frames, 0), PER_ROW).frequency_std > 0.9 * one
    assert oc.find_frequency(light + moving, PER_ROW).frequency_std < 1.3 * one / np.sqrt(frames)
