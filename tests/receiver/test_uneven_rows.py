"""`receive` flags bits of rows that are not read one after another at even times, and no others."""

import numpy as np
import pytest

from ocisac_fast import Camera, Chips, Flag, Receiver, SquareWave, integrate_exposure, receive, transmit

ROWS, ROW_TIME = 900, 20e-6


def frame(seed, pause):
    """(rows, 16) of random chips of 2.5 to 7 rows; rows from a random one on are read `pause` rows later."""
    random = np.random.default_rng(seed)
    rows_per_chip = random.uniform(2.5, 7)
    camera = Camera(ROW_TIME, 0.4 * rows_per_chip * ROW_TIME)
    chips = Chips(random.integers(0, 2, 600), 1 / (rows_per_chip * ROW_TIME))
    lost = round(pause * rows_per_chip)
    light = integrate_exposure(chips, camera, ROWS + lost, start=20 * ROW_TIME)
    at = random.integers(ROWS // 3, 2 * ROWS // 3)
    column = np.r_[light[:at], light[at + lost :]]
    picture = 30 + 150 * column[:, None] + random.normal(0, 2, (ROWS, 16))
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8), camera, lost % rows_per_chip / rows_per_chip


@pytest.mark.parametrize("seed", range(12))
def test_a_pause_that_moves_the_chips_is_flagged(seed):
    pixels, camera, moved = frame(seed, pause=np.random.default_rng(seed + 100).uniform(0.3, 4))
    (found,) = receive(pixels[None], camera)
    if 0.25 < moved < 0.75:  # less is seen where edges are sharp, a whole chip never
        assert found.flags & Flag.MODEL_MISFIT or not found.bits


@pytest.mark.parametrize("seed", range(12))
def test_rows_read_evenly_are_not_flagged(seed):
    pixels, camera, _ = frame(seed, pause=0)
    (found,) = receive(pixels[None], camera)
    assert found.bits
    assert not found.flags & Flag.MODEL_MISFIT


@pytest.mark.parametrize("seed", range(12))
def test_rows_read_two_at_a_time_are_flagged_where_they_do_not_resolve_the_chips(seed):
    random = np.random.default_rng(seed)
    rows_per_chip = random.uniform(2.3, 3.7)
    camera = Camera(ROW_TIME, random.uniform(1.3, 2) * ROW_TIME)
    chips = Chips(random.integers(0, 2, 600), 1 / (rows_per_chip * ROW_TIME))
    light = np.repeat(integrate_exposure(chips, camera, ROWS, start=20 * ROW_TIME)[::2], 2)
    picture = 30 + 150 * light[:, None] + random.normal(0, 2, (ROWS, 16))
    for one in receive(np.clip(np.rint(picture), 0, 255).astype(np.uint8)[None], camera):
        assert one.flags & Flag.MODEL_MISFIT or not one.bits


@pytest.mark.parametrize("seed", range(20, 70))
def test_defective_rows_make_no_faster_chips(seed):
    random = np.random.default_rng(seed)
    rows_per_chip = random.integers(5, 9)
    camera = Camera(ROW_TIME, 0.3 * rows_per_chip * ROW_TIME)
    data = random.integers(0, 2, 300)
    chips = Chips(np.column_stack([data, 1 - data]).ravel(), 1 / (rows_per_chip * ROW_TIME))
    light = 30 + 120 * integrate_exposure(chips, camera, ROWS, start=20 * ROW_TIME)
    light[random.integers(0, ROWS, 20)] += 80
    picture = light[:, None] + random.normal(0, 2, (ROWS, 16))
    (found,) = receive(np.clip(np.rint(picture), 0, 255).astype(np.uint8)[None], camera)
    assert found.flags or abs(found.rows_per_chip / rows_per_chip - 1) < 0.01


@pytest.mark.parametrize(("ratio", "later", "first"), [(2, 0, 0), (4, 37, 1), (8, -15, 2), (3, 60, 3)])
def test_rows_of_two_exposures_in_turns_are_read(ratio, later, first):
    """Two rows of the whole exposure, two of a shorter one that ends `later` rows later, as of HDR."""
    random = np.random.default_rng(ratio)
    camera = Camera(ROW_TIME, 0.6e-3, frame_time=0.03)
    payload = bytes(random.integers(0, 256, 30, dtype=np.uint8))
    sent = np.asarray(transmit(payload).chips)
    chips = Chips(np.tile(sent, 40), 8e3)
    is_long = (np.arange(ROWS) - first) % 4 < 2
    receiver = Receiver(camera, chip_rate=8e3)
    for number in range(16):
        start = 0.02 + number * camera.frame_time
        long = integrate_exposure(chips, camera, ROWS, start=start)
        short = Camera(ROW_TIME, camera.exposure / ratio)
        short = integrate_exposure(chips, short, ROWS, start=start + later * ROW_TIME)
        light = 30 + 120 * np.where(is_long, long, short)[:, None]
        picture = light + random.normal(0, 1, (ROWS, 16)) * np.where(is_long, 1, ratio)[:, None]
        found = receiver.push(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
        assert not found.flags & Flag.MODEL_MISFIT
        assert found.exposure == pytest.approx(camera.exposure, rel=0.02)
        if found.stretch and found.stretch.payload is not None:
            break
    assert found.stretch.payload.data == payload


@pytest.mark.parametrize(("rows_per_chip", "exposure"), [(4, 1.3), (4, 3), (4, 7), (2, 1.3)])
def test_chips_of_whole_rows_are_not_taken_for_exposures_in_turns(rows_per_chip, exposure):
    """Their edges lie at the same two of four rows."""
    random = np.random.default_rng(rows_per_chip)
    chip_time = rows_per_chip * ROW_TIME
    camera = Camera(ROW_TIME, exposure * chip_time, frame_time=0.03)
    data = random.integers(0, 2, 9000)
    chips = Chips(np.column_stack([data, 1 - data]).ravel(), 1 / chip_time)
    receiver = Receiver(camera, chip_rate=1 / chip_time)
    for number in range(8):
        light = integrate_exposure(chips, camera, ROWS, start=0.02 + number * camera.frame_time)
        assert not receiver.push(30 + 100 * light + random.normal(0, 1.5, ROWS)).flags & Flag.MODEL_MISFIT


def displaced_frame(seed, chip=(3.6, 7)):
    """Rows that a lens or a stabiliser displaces, by up to 1.2 chips at the ends or to and fro; camera, bits, chips."""
    random = np.random.default_rng(seed)
    rows_per_chip = random.uniform(*chip)
    camera = Camera(ROW_TIME, 0.6 * rows_per_chip * ROW_TIME)
    data = random.integers(0, 2, 600)
    along = np.linspace(-1, 1, ROWS)
    moved = random.uniform(0.7, 1.2) * along**3 if seed % 2 else 0.4 * np.sin(random.uniform(3, 6) * along)
    chips = Chips(data, 1 / (rows_per_chip * ROW_TIME))
    light = integrate_exposure(chips, camera, ROWS + 80, start=20 * ROW_TIME)
    column = np.interp(np.arange(ROWS) + 40 + rows_per_chip * moved, np.arange(ROWS + 80), light)
    picture = 30 + 150 * column[:, None] + random.normal(0, 2, (ROWS, 16))
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8), camera, "".join(map(str, data)), ROWS / rows_per_chip


@pytest.mark.parametrize(("chip", "least"), [((3.6, 7), 54), ((9, 16), 44)])
def test_rows_that_a_lens_or_a_stabiliser_displaces_are_read_and_flagged(chip, least):
    """Where the phase changes by nearly half a chip in a part of the rows, some are wrong."""
    right = 0
    for seed in range(60):
        pixels, camera, data, chips = displaced_frame(seed, chip)
        (found,) = receive(pixels[None], camera)
        assert found.flags & Flag.MODEL_MISFIT or not found.bits
        right += found.bits in data and len(found.bits) > 0.97 * chips
    assert right >= least


def test_texture_is_no_displaced_light():
    """Phases of their own make few edges of any places regular."""
    found = 0
    for seed in range(120):
        random = np.random.default_rng(seed)
        frequency = np.maximum(np.fft.rfftfreq(ROWS), 1 / ROWS)
        rough = np.fft.irfft(np.fft.rfft(random.standard_normal(ROWS)) * frequency ** -random.uniform(0.5, 1.5))
        column = rough / rough.std() if seed % 2 else np.cumsum(random.random(ROWS) < random.uniform(0.02, 0.1)) % 2
        picture = 90 + 30 * column[:, None] + random.normal(0, 2, (ROWS, 16))
        answers = receive(np.clip(np.rint(picture), 0, 255).astype(np.uint8)[None], Camera(ROW_TIME))
        found += sum(bool(answer.bits) for answer in answers)
    assert found <= 22


def test_a_square_wave_of_another_lamp_displaces_no_rows():
    """Short parts of the rows of their own phase take up its steps."""
    for seed in range(12):
        random = np.random.default_rng(seed)
        data = np.stack([bits := random.integers(0, 2, 300), 1 - bits], axis=1).ravel()
        rows_per_chip = random.uniform(2.8, 3.2)
        camera = Camera(ROW_TIME, 0.5 * rows_per_chip * ROW_TIME)
        chips = integrate_exposure(Chips(data, 1 / (rows_per_chip * ROW_TIME)), camera, ROWS, start=20 * ROW_TIME)
        lamp = integrate_exposure(SquareWave(random.uniform(900, 1100)), camera, ROWS)
        spot = np.exp(-0.5 * (np.arange(-8, 8) / 3) ** 2)
        picture = 20 + 100 * chips[:, None] * spot + 50 * lamp[:, None] + random.normal(0, 2, (ROWS, 16))
        (found,) = receive(np.clip(np.rint(picture), 0, 255).astype(np.uint8)[None], camera)
        assert not found.flags
        assert found.bits in "".join(map(str, data))
