"""Frequency of the lamp in a picture, the row time from it, and the choice of the colour that shows it."""

import json

import numpy as np
import pytest

import ocisac_fast as oc
from ocisac_fast import Camera, Flag

PER_ROW = Camera(row_time=1.0)


def tone(frequency, rows, phase=0.0):
    return np.cos(2 * np.pi * frequency * np.arange(rows) + phase)


def test_row_times_of_real_pictures(recordings):
    image = pytest.importorskip("PIL.Image")
    for entry in json.loads((recordings / "recordings.json").read_text()):
        if "calibrate" not in entry:
            continue
        picture = np.asarray(image.open(recordings / entry["file"]).convert("RGB"))
        colours = list(np.moveaxis(picture, -1, 0))
        best = colours[oc.pick_colour(colours, PER_ROW)]
        want = entry["calibrate"]
        got = oc.calibrate(best, want["frequency_hz"])
        assert got.row_time == pytest.approx(want["row_time_s"], rel=want["tolerance"]), entry["file"]
        assert not got.flags, entry["file"]
        assert 0 < got.row_time_std < want["tolerance"] * want["row_time_s"]


def test_channel_with_the_light_is_picked():
    random = np.random.default_rng(6)
    dark, dim, bright = (10 + a * (1 + tone(0.03, 300))[:, np.newaxis] * np.ones(20) for a in (0, 2, 30))
    colours = [c + random.normal(0, 3, c.shape) for c in (dark, bright, dim)]
    assert oc.pick_colour(colours, PER_ROW) == 1
    found = [oc.find_frequency(colour, PER_ROW) for colour in colours]
    spreads = [each.frequency_std / each.frequency for each in found]
    assert spreads[1] < spreads[2]
    assert oc.pick_colour(colours[:1], PER_ROW) == 0


def test_the_outline_of_a_lamp_is_not_taken_for_one_cycle():
    rows = np.arange(1000)
    lamp = np.exp(-0.5 * ((rows - 500) / 350) ** 2)  # near one cycle of the frame
    light = 20 + 100 * lamp * (1 + 0.5 * np.cos(2 * np.pi * 3.4 / 1000 * rows))
    picture = light[:, np.newaxis] + np.random.default_rng(3).normal(0, 1, (1000, 40))
    got = oc.calibrate(picture, 100.0)
    assert got.found.cycles_per_row >= 2 / 1000
    assert got.row_time == pytest.approx(got.found.cycles_per_row / 100.0, rel=1e-15)
    assert got.row_time == pytest.approx(3.4e-5, rel=0.02)


def test_calibration_is_cycles_per_row_over_frequency():
    random = np.random.default_rng(3)
    columns = 5 + tone(1000 * 1.46e-5, 1080)[:, np.newaxis] * np.ones(5) + random.normal(0, 0.1, (1080, 5))
    got = oc.calibrate(columns, 1000.0)
    assert abs(got.row_time - 1.46e-5) < 4 * got.row_time_std
    assert got.row_time_std == pytest.approx(got.found.cycles_per_row_std / 1000, rel=1e-15)
    assert got.row_time == pytest.approx(got.found.cycles_per_row / 1000, rel=1e-15)
    assert oc.calibrate(columns, 1000.0, bounds=(1e-5, 2e-5)).row_time == pytest.approx(got.row_time, rel=1e-9)


def lamp_with_text(seed, cycles_per_row, radius):
    """A disk lamp, (rows, columns), as in a photograph: bright core, text and ruled lines drawn over it."""
    random = np.random.default_rng(seed)
    rows, columns = 700, 600
    y, x = np.mgrid[:rows, :columns]
    away = np.hypot(y - 340, x - 300) / radius
    light = 0.5 + 0.5 * tone(cycles_per_row, rows, random.uniform(0, 6.28))[:, np.newaxis]
    picture = 12.0 + 190.0 * light * np.exp(-((away / 0.9) ** 2)) * (away < 1)
    for top, left in zip(random.integers(20, 660, 6), random.integers(10, 350, 6), strict=True):
        for at in range(left, left + 200, 14):
            picture[top : top + 12, at : at + int(random.integers(3, 9))] = 255.0
    for top in (200, 480):
        picture[top : top + 3] = 255.0
    noisy = picture + random.normal(0, 2, picture.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("cycles", "error"), [(4, 0.025), (7, 0.01), (15, 0.005)])
def test_text_lines_and_outline_are_no_tone(seed, cycles, error):
    radius = 230
    frequency = cycles / (2 * radius) * (1 + 0.01 * seed)
    got = oc.calibrate(lamp_with_text(seed, frequency, radius), 1000.0)
    assert got.row_time == pytest.approx(frequency / 1000.0, rel=error)
    assert abs(got.row_time - frequency / 1000.0) < 4 * got.row_time_std
    assert not got.flags & ~Flag.SATURATED


def test_an_outline_without_bars_is_flagged():
    """A steady lamp with text and lines: its outline resembles a tone; a line of text may pass for a light."""
    flags = [oc.calibrate(lamp_with_text(seed, 1e-9, 150.0), 1000.0).flags & ~Flag.SATURATED for seed in range(20)]
    assert sum(map(bool, flags)) >= 16


@pytest.mark.parametrize(("spread", "correlation"), [(0.5, 0), (8, 0), (3, 0.5)])
def test_rows_that_are_noise_are_refused(spread, correlation):
    random = np.random.default_rng(15)
    rows = random.normal(0, spread, (100, 401, 1))
    pictures = random.normal(128, 1.5, (100, 400, 60)) + rows[:, 1:] + correlation * rows[:, :-1]
    assert sum(not oc.calibrate(np.rint(picture), 1000.0).flags for picture in pictures) <= 1


def textured_wall(random, rows, columns, slope, contrast):
    """A wall, (rows, columns), whose amplitudes fall with this power of the frequency, as those of pictures do by 1."""
    away = np.hypot(np.fft.fftfreq(rows)[:, np.newaxis], np.fft.fftfreq(columns)) + 1e-3
    texture = np.fft.ifft2(np.fft.fft2(random.normal(size=(rows, columns))) / away**slope).real
    return np.exp(contrast * texture / texture.std())


@pytest.mark.parametrize("frames", [1, 4])
@pytest.mark.parametrize("slope", [1.0, 1.5])
def test_texture_of_a_wall_is_a_part_of_the_error(slope, frames):
    """Few cycles of a lamp on a wall: what stands still is neither its fundamental nor forgotten in its error."""
    random = np.random.default_rng(21)
    deviations, flagged = [], 0
    for cycles in np.tile([3.3, 4.0, 5.2, 6.0, 8.3, 12.0], 6):
        swing = [1 + 0.5 * tone(cycles / 1080, 1080, random.uniform(0, 6)) for _ in range(frames)]
        light = 70 * np.array(swing)[..., np.newaxis] * textured_wall(random, 1080, 96, slope, 0.2)
        picture = np.clip(np.rint(light + random.normal(0, 1, light.shape)), 0, 255).astype(np.uint8)
        got = oc.calibrate(picture, cycles / (1080 * 2e-5))
        flagged += bool(got.flags)
        if not got.flags:
            deviations.append((got.row_time - 2e-5) / got.row_time_std)
    assert flagged <= 12
    assert np.max(np.abs(deviations)) < 6
    assert np.sqrt(np.mean(np.square(deviations))) < 2


def test_row_times_that_no_camera_has_are_flagged():
    columns = 100.0 + 50.0 * tone(0.02, 800, 1.0)[:, np.newaxis] * np.ones(40)
    columns += np.random.default_rng(1).normal(0, 1, columns.shape)
    assert not oc.calibrate(columns, 1000.0).flags
    assert oc.calibrate(columns, 1.0).flags == Flag.MODEL_MISFIT  # 16 s a frame
    assert oc.calibrate(columns, 1e6).flags == Flag.MODEL_MISFIT  # 20 ns a row


def test_thin_pulses_near_a_whole_number_of_rows_a_cycle():
    """Rows hit such pulses in bursts; each burst alone has another frequency."""
    random = np.random.default_rng(7)
    row_time = 2e-5
    wrong = 0
    for _ in range(40):
        rows_per_cycle = random.integers(3, 8) + random.choice([-1, 1]) * random.uniform(0.005, 0.08)
        frequency = 1 / rows_per_cycle / row_time
        lamp = oc.SquareWave(frequency, duty=float(random.choice([0.03, 0.1, 0.2])))
        camera = oc.Camera(row_time, exposure=random.uniform(0.02, 0.3) / frequency, frame_time=0.0331)
        rows = oc.integrate_exposure(lamp, camera, 720, frames=4)
        light = rows[..., np.newaxis] * random.uniform(0.5, 1, 64)
        picture = np.rint(10 + 150 * light / light.max() + random.normal(0, 1.5, light.shape)).astype(np.uint8)
        got = oc.calibrate(picture, frequency)
        wrong += not got.flags and abs(got.row_time - row_time) > 6 * got.row_time_std
    assert wrong <= 1  # a pulse that the third harmonic's alias resembles most


def moved_rows(kind, random):
    """Times of 720 rows that a pause parts, or that a lens correction pulls inwards."""
    rows = np.arange(720.0)
    if kind.startswith("pause"):
        return rows + float(kind[5:]) * (rows >= 720 * random.uniform(0.25, 0.75))
    from_middle = rows / 360 - 1
    return 360 + 360 * from_middle * (1 - float(kind[4:]) * from_middle**2)


@pytest.mark.parametrize("kind", ["pause3", "pause10", "pause30", "lens0.03", "lens0.1"])
def test_rows_that_are_moved_are_a_part_of_the_error(kind):
    """A frequency takes up most of a bend of the phase; the rest of the bend is seen."""
    random, row_time, wrong = np.random.default_rng(11), 2.22e-5, {"find": 0, "calibrate": 0, "detect": 0}
    for _ in range(30):
        frequency = np.exp(random.uniform(np.log(3), np.log(60))) / (720 * row_time)
        wave = np.sin(2 * np.pi * frequency * moved_rows(kind, random) * row_time + random.uniform(0, 6))
        picture = 128 + 100 * wave[:, np.newaxis] + random.normal(0, 2, (720, 40))
        picture = np.clip(picture, 0, 255).astype(np.uint8)
        camera = oc.Camera(row_time, exposure=1e-5)
        found, got = oc.find_frequency(picture, camera), oc.calibrate(picture, frequency)
        answers = [("find", found, found.frequency / frequency - 1, found.frequency_std / frequency)]
        answers += [("calibrate", got, got.row_time / row_time - 1, got.row_time_std / row_time)]
        for light in oc.detect_sources(picture, camera)[:1]:
            answers += [("detect", light, light.frequency / frequency - 1, light.frequency_std / frequency)]
        for call, answer, error, std in answers:
            wrong[call] += not answer.flags and abs(error) > max(5 * std, 0.002)
    assert max(wrong.values()) <= 8  # pauses within a few cycles; 16 to 29 where bends are noise


def test_harmonics_that_fold_onto_a_lower_fundamental_are_in_doubt():
    """The second harmonic of 0.4 cycles a row is 0.2 there: PWM of either frequency explains the rows."""
    random, row_time, frequency = np.random.default_rng(3), 20e-6, 20_000.2
    for start in random.uniform(0, 1, 12):
        lamp = oc.SquareWave(frequency, duty=0.2, phase=float(2 * np.pi * start))
        light = oc.integrate_exposure(lamp, oc.Camera(row_time, exposure=10e-6), 1080)
        picture = 20 + 200 * light[:, np.newaxis] + random.normal(0, 1, (1080, 64))
        got = oc.calibrate(np.clip(np.rint(picture), 0, 255).astype(np.uint8), frequency)
        assert got.flags & Flag.MODEL_MISFIT or got.row_time == pytest.approx(row_time, rel=1e-4)


def test_bounds_whose_frequency_overflows_are_refused():
    picture = np.random.default_rng(0).random((64, 8))
    with np.errstate(all="raise"), pytest.raises(ValueError, match="bounds"):
        oc.calibrate(picture, np.float64(1e308), bounds=(np.float64(1e-5), np.float64(1e5)))


@pytest.mark.parametrize(("duty", "second"), [(0.1, 0.3), (0.1, 0.4), (0.2, 0.5)])
@pytest.mark.parametrize("seed", range(4))
def test_a_weaker_pulse_between_the_pulses_is_in_doubt_as_in_the_search(duty, second, seed):
    """Its second harmonic is the strongest: the row time would be twice as large."""
    random = np.random.default_rng(seed)
    row_time = 22.2e-6
    frequency = random.uniform(6, 100) / (1080 * row_time)
    start = random.uniform(0, 1)
    pulses = [
        oc.integrate_exposure(
            oc.SquareWave(frequency, duty=duty, phase=phase), Camera(row_time, 1e-5), 1080, start=start
        )
        for phase in (0, np.pi)
    ]
    light = 10 + 150 * (pulses[0] + second * pulses[1])
    rows = np.clip(np.rint(light[:, None] + random.normal(0, 1, (1080, 32))), 0, 255).astype(np.uint8)
    found = oc.calibrate(rows, frequency)
    assert found.flags & Flag.MODEL_MISFIT or found.row_time == pytest.approx(row_time, rel=1e-2)
