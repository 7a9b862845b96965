"""Bits only from rows in which a lamp shines: round lamps, lamps above each other, lamps without data, idle light."""

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, Flag, SquareWave, integrate_exposure
from ocisac_fast.files import read_frames

ROWS, COLUMNS = 900, 500


def rows_of(chips, pitch, exposure=0.0, start=0.0):
    """Light of each row, from row ``start`` of the chips on; the ramp of chip k's edge has its middle at
    k * pitch - start + exposure / 2."""
    return integrate_exposure(Chips(chips, 1 / pitch), Camera(1.0, exposure), ROWS, start=start)[:, None]


def disc(row, column, radius, *, ring=0.0):
    """Brightness of a round lamp, which fades towards its edge and may have a dark ring."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    away = np.hypot(y - row, x - column) / radius
    return (away < 1) * (1 - 0.7 * away**2) * (1 - ring * np.exp(-0.5 * ((away - 0.55) / 0.1) ** 2))


def photographed(light, seed, noise=1.0):
    random = np.random.default_rng(seed)
    return np.clip(np.rint(light + noise * random.standard_normal(light.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(12))
def test_a_round_lamp_gives_its_chips_and_no_others(seed):
    random = np.random.default_rng(seed)
    pitch, radius = random.uniform(4, 8), random.uniform(190, 230)
    row = random.uniform(0.35, 0.65) * ROWS
    chips = random.integers(0, 2, 400)
    exposure, start = 0.3 * pitch, random.uniform(1, 2) * pitch
    light = rows_of(chips, pitch, exposure, start) * disc(row, 250, radius)
    got = ocisac.receive(photographed(2 + 120 * light, seed), Camera(1.0))[0]
    first = round((got.phase + start - exposure / 2) / pitch)
    assert not got.flags
    assert got.bits == "".join(map(str, chips[first : first + len(got.bits)]))
    assert got.phase > row - radius - 1.2 * pitch
    assert got.phase + len(got.bits) * got.rows_per_chip < row + radius + 1.2 * pitch
    assert len(got.bits) >= 2 * radius / pitch - 7


@pytest.mark.parametrize("seed", range(6))
def test_lamps_above_each_other_are_strings_of_their_own(seed):
    random = np.random.default_rng(seed)
    pitches = random.permutation([5.1, 6.3]) * random.uniform(0.9, 1.2)
    light, places = np.zeros((ROWS, COLUMNS)), []
    for middle, pitch in zip((160, 740), pitches, strict=True):
        chips = random.integers(0, 2, 400)
        shape = np.abs(np.arange(ROWS) - middle) < 110
        columns = np.exp(-0.5 * ((np.arange(COLUMNS) - random.uniform(230, 270)) / 30) ** 2)
        light += rows_of(chips, pitch) * np.outer(shape, columns)
        places.append((middle, pitch, chips))
    found = ocisac.receive(photographed(2 + 120 * light, seed), Camera(1.0))
    assert len(found) == 2
    for got, (middle, pitch, chips) in zip(sorted(found, key=lambda one: one.phase), places, strict=True):
        assert got.flags in (0, Flag.TOO_FEW_EDGES)
        assert got.rows_per_chip == pytest.approx(pitch, rel=0.01)
        first = round(got.phase / pitch)
        bits = "".join(map(str, chips[first : first + len(got.bits)]))
        assert got.bits[1:-1] == bits[1:-1]  # chips that the lamp's ends cut
        assert got.phase > middle - 110 - pitch
        assert got.phase + len(got.bits) * pitch < middle + 110 + pitch


@pytest.mark.parametrize("noise", [2.0, 8.0])
def test_an_even_round_lamp_gives_no_chips_beyond_its_outline(noise):
    y, x = np.mgrid[:ROWS, :200]
    lamp = ((x - 100) / 80) ** 2 + ((y - 450) / 220) ** 2 < 1
    unflagged = 0
    for seed in range(10):
        chips = np.random.default_rng(seed).integers(0, 2, 200)
        frame = photographed(10 + 100 * lamp * rows_of(chips, 6.0, 2.0), seed, noise)
        got = ocisac.receive(frame, Camera(1.0, 2.0))[0]
        if got.flags:
            continue
        unflagged += 1
        assert got.phase > 230 - 4 * got.rows_per_chip
        assert got.phase + len(got.bits) * got.rows_per_chip < 670 + 4 * got.rows_per_chip
    assert unflagged >= 8


@pytest.mark.parametrize("seed", range(6))
def test_a_lamp_with_a_dark_ring_is_one_periodic_light_of_its_frequency(seed):
    random = np.random.default_rng(seed)
    period, radius = random.uniform(12, 24), random.uniform(190, 230)
    bright = (np.arange(ROWS) - random.uniform(0, period)) % period < period / 2
    light = bright[:, None] * disc(random.uniform(0.35, 0.65) * ROWS, 250, radius, ring=random.uniform(0.7, 1))
    (got,) = ocisac.receive(photographed(2 + 100 * light, seed), Camera(1.0))
    assert got.flags & (Flag.PERIODIC | Flag.WEAK)  # weak: dark where the ring is
    assert 2 * got.rows_per_chip == pytest.approx(period, rel=0.005)


@pytest.mark.parametrize("duty", [0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.87, 0.9])
def test_a_lamp_dimmed_at_any_frequency_is_periodic(duty):
    random = np.random.default_rng(int(100 * duty))
    for period in random.uniform(15, 120, 12):
        if duty * period < 2 or (1 - duty) * period < 2:  # shorter than a chip may be
            continue
        wave = SquareWave(1 / period, duty=duty, phase=random.uniform(0, 2 * np.pi))
        light = integrate_exposure(wave, Camera(1.0, 3.0), ROWS)[:, None] * np.ones(100)
        (got,) = ocisac.receive(photographed(20 + 180 * light, int(period), noise=1.5), Camera(1.0, 3.0))
        assert got.flags & Flag.PERIODIC


@pytest.mark.parametrize("words", [["0", "1"], ["01", "10"], ["1000", "0100", "0010", "0001"]])
def test_data_are_not_periodic(words):
    random = np.random.default_rng(len(words))
    for frame in range(60):
        pitch = random.uniform(3, 8)
        light = rows_of("".join(random.choice(words, 400)), pitch, 3.0) * np.ones(24)
        for got in ocisac.receive(photographed(20 + 180 * light, frame, noise=1.5), Camera(1.0, 3.0)):
            assert not got.flags & Flag.PERIODIC


@pytest.mark.parametrize("word_seed", range(8))
def test_a_line_coded_word_that_repeats_is_data(word_seed):
    random = np.random.default_rng(word_seed)
    word = "".join(random.choice(["01", "10"], 12))
    light = rows_of(word * 10, 5.3, 3.0) * np.ones(24)
    got = ocisac.receive(photographed(20 + 180 * light, word_seed), Camera(1.0, 3.0))[0]
    assert got.bits in word * 10
    assert not got.flags


@pytest.mark.parametrize("seed", range(4))
def test_a_given_rate_of_twice_or_half_the_chips_gives_no_wrong_bits(seed):
    random = np.random.default_rng(seed)
    chips, pitch = random.integers(0, 2, 400), random.uniform(7, 9)
    light = rows_of(chips, pitch, 0.3 * pitch) * np.exp(-0.5 * ((np.arange(COLUMNS) - 250) / 60) ** 2)
    frame = photographed(2 + 100 * light, seed)
    for share in (0.5, 1, 2):
        got = ocisac.receive(frame, Camera(1.0), chip_rate=share / pitch)[0]
        sent = "".join(map(str, chips))
        assert (got.bits in sent and len(got.bits) > 0.9 * ROWS / pitch) or got.flags


@pytest.mark.parametrize(
    ("columns", "seed"), [*((200, seed) for seed in (*range(12), 85)), *((64, seed) for seed in range(8))]
)
def test_an_even_round_lamp_gives_right_chips_up_to_its_narrow_ends(columns, seed):
    random = np.random.default_rng(seed)
    rows, pitch = np.arange(ROWS), random.uniform(5, 12)
    half, middle, exposure = random.uniform(200, 300), random.uniform(430, 470), random.uniform(0.1, 0.5) * pitch
    chips = random.integers(0, 2, 300)
    lamp = ((np.arange(columns) / columns - 0.5) * 3) ** 2 + ((rows[:, None] - middle) / half) ** 2 < 1
    frame = photographed(10 + 120 * lamp * rows_of(chips, pitch, exposure), seed, noise=2.0)
    got = ocisac.receive(frame, Camera(1.0, exposure))[0]
    assert not got.flags
    first = round((got.phase - exposure / 2) / pitch)
    assert got.bits == "".join(map(str, chips[first : first + len(got.bits)]))
    assert got.phase > middle - half - 3
    assert got.phase + len(got.bits) * pitch < middle + half + 3 + exposure
    assert len(got.bits) > 2 * half / pitch - 7


@pytest.mark.parametrize("seed", range(8))
def test_two_lamps_above_each_other_without_a_gap_are_no_string(seed):
    random = np.random.default_rng(seed)
    upper, lower = random.permutation([random.uniform(5, 7), random.uniform(8, 12)])
    light = rows_of(random.integers(0, 2, 300), upper, 1.5)
    light[ROWS // 2 :] = rows_of(random.integers(0, 2, 300), lower, 1.5)[ROWS // 2 :]
    for got in ocisac.receive(photographed(10 + 120 * light * np.ones(64), seed, noise=2.0), Camera(1.0, 1.5)):
        assert got.flags or not got.bits


@pytest.mark.parametrize("share", [4 / 3, 1.5, 2])
def test_a_given_rate_of_more_than_the_chips_gives_no_wrong_bits(share):
    for seed in range(20):
        random = np.random.default_rng(seed)
        pitch, chips = random.uniform(5, 12), random.integers(0, 2, 120)
        light = rows_of(chips, pitch, 0.4 * pitch) * np.ones(24)
        frame = photographed(10 + 120 * light, seed, noise=1.5)
        got = ocisac.receive(frame[:600], Camera(1.0, 0.4 * pitch), chip_rate=share / pitch)[0]
        assert got.flags or got.bits in "".join(map(str, chips))


@pytest.mark.parametrize("words", [["10", "00"], ["01", "11"], ["1000", "0000"]])
@pytest.mark.parametrize("share", [1, 1.5, 2.5])
def test_pulses_whose_falls_lie_half_a_given_chip_off_their_rises_are_longer_chips(words, share):
    for seed in range(12):
        random = np.random.default_rng(seed)
        pitch, chips = random.uniform(6, 10), "".join(random.choice(words, 120))
        frame = photographed(20 + 150 * rows_of(chips, pitch, 0.3 * pitch) * np.ones(24), seed, noise=1.5)
        for got in ocisac.receive(frame, Camera(1.0, 0.3 * pitch), chip_rate=share / pitch):
            assert got.flags & ~(Flag.TOO_FEW_EDGES | (Flag.MODEL_MISFIT if share > 2 else 0)) == 0
            assert got.rows_per_chip == pytest.approx(pitch, rel=0.01)
            assert got.bits in chips


@pytest.mark.parametrize("seed", range(12))
def test_a_given_rate_of_twice_the_chips_is_halved_where_edges_are_few(seed):
    random = np.random.default_rng(seed)
    pitch, runs = random.uniform(14, 18), random.choice([1, 2, 3], 60)
    chips = np.repeat(np.arange(60) % 2, runs)
    frame = photographed(10 + 120 * rows_of(chips, pitch, 0.4 * pitch) * np.ones(24), seed, noise=1.5)[:480]
    got = ocisac.receive(frame, Camera(1.0, 0.4 * pitch), chip_rate=2 / pitch)[0]
    assert got.flags & ~Flag.TOO_FEW_EDGES == 0
    assert got.bits
    assert got.bits in "".join(map(str, chips))


@pytest.mark.parametrize("seed", range(8))
def test_dark_rows_between_a_lamp_and_its_reflection_and_beyond_are_not_known_to_be_lit(seed):
    """25 rows: as long as dark runs of chips, so that bits are guesses there."""
    random = np.random.default_rng(seed)
    pitch = random.uniform(4, 6)
    chips = random.integers(0, 2, 400)
    exposure, start = random.uniform(0.3, 0.9) * pitch, 2 * pitch
    along = np.zeros(ROWS)
    along[210:535], along[560:875] = 1, random.uniform(0.2, 0.5)
    light = rows_of(chips, pitch, exposure, start) * along[:, None] * np.exp(-0.5 * (np.arange(-32, 32) / 15) ** 2)
    (got,) = ocisac.receive(photographed(20 + 120 * light, seed), Camera(1.0, exposure))
    first = round((got.phase + start - exposure / 2) / pitch)
    right = np.frombuffer(got.bits.encode(), np.uint8) - ord("0") == chips[first : first + len(got.bits)]
    assert not got.flags
    assert np.all(right | (got.relative_levels == 0))
    assert np.count_nonzero(got.relative_levels) > 0.9 * 640 / pitch


@pytest.mark.parametrize("exposure", [1.3, 1.6])
def test_an_exposure_of_more_than_a_chip_puts_no_chips_of_a_lamp_in_doubt(exposure):
    """Bright chips between dark ones swing less than others there, though all are of one lamp."""
    random = np.random.default_rng(3)
    light = rows_of(random.integers(0, 2, 200), 7.0, exposure * 7.0) * np.ones(24)
    (got,) = ocisac.receive(photographed(20 + 120 * light, 3)[:700], Camera(1.0, exposure * 7.0))
    assert not got.flags & ~(Flag.LONG_EXPOSURE | Flag.WEAK)
    assert len(got.bits) >= 95
    assert np.count_nonzero(got.relative_levels == 0) == 0


def test_light_that_fills_the_width_may_be_idle():
    """A laser's spot without sides: dark rows before and after its packet are chips."""
    chips = np.r_[np.zeros(40, int), np.random.default_rng(5).integers(0, 2, 60), np.zeros(50, int)]
    light = rows_of(chips, 6.4, 3.0, 6.4) * np.ones(COLUMNS)
    got = ocisac.receive(photographed(2 + 80 * light, 0), Camera(1.0))[0]
    assert got.bits in "".join(map(str, chips))
    assert len(got.bits) >= 140


def test_edges_that_parts_of_the_columns_have_of_their_own_are_flagged(recordings):
    """Pins and labels of a circuit board fit a chip clock by chance: 661 bits at 9.7 dB, which halves do not share."""
    for got in ocisac.receive(read_frames(recordings / "no_light_board.jpg").frames, Camera(1.0, scan_axis="x")):
        assert not got.bits or got.flags & ~Flag.SATURATED


def test_chips_of_a_lamp_that_fades_at_its_end_keep_their_rate():
    """The level there is below that of the chips before, which moves the edges."""
    fine = np.arange(0, 600, 0.05)
    for seed in range(60):
        random = np.random.default_rng(seed)
        pitch, first, exposure = random.uniform(7, 14), random.uniform(60, 100), random.uniform(1, 2.5)
        wave = (np.floor((fine - first) / pitch) % 2 == 0).astype(float)
        wave = np.convolve(wave, np.ones(int(exposure / 0.05)) * 0.05 / exposure, "same")
        end = first + pitch * random.uniform(8, 11)
        fades = np.exp(-np.clip(fine - end, 0, None) / (pitch * random.uniform(1.2, 3))) * (fine >= first - exposure)
        lamp = np.exp(-(((np.arange(300) - 150) / 60.0) ** 4))
        got = ocisac.receive(photographed(1 + 30 * (wave * fades)[::20, None] * lamp, seed, noise=0.6), Camera(1.0))[0]
        assert abs(got.rows_per_chip / pitch - 1) < 0.01


def stream(payload, rows_per_chip, exposure, start, brightness, *, noise, count, seed, row_time=20e-6, error=1.001):
    """Frames of a lamp of some brightness in each row, as they are received one by one; stops with the payload."""
    random = np.random.default_rng(seed)
    rate, frame_time = 1 / (rows_per_chip * row_time), 1.3 * brightness.size * row_time
    camera = Camera(row_time, exposure * rows_per_chip * row_time, frame_time=frame_time)
    waveform = ocisac.transmit(payload).waveform(rate)
    receiver = ocisac.Receiver(camera, chip_rate=error * rate)
    for number in range(count):
        light = integrate_exposure(waveform, camera, brightness.size, start=start + number * frame_time)
        rows = 30 + (light * brightness)[:, None] + random.normal(0, noise, (brightness.size, 64))
        found = receiver.push(np.clip(np.rint(rows), 0, 255).astype(np.uint8))
        yield found
        if found.payload:
            return


@pytest.mark.parametrize(("top", "bottom"), [(80, 80), (0, 80), (80, 0), (150, 100)])
@pytest.mark.parametrize("rows_per_chip", [5.7, 8])
def test_a_lamp_ends_where_rows_of_a_few_chips_are_dark(top, bottom, rows_per_chip):
    brightness = np.full(1080, 90.0)
    brightness[:top] = brightness[1080 - bottom :] = 0
    frames = list(stream(b"dark ends", rows_per_chip, 0.5, 0.1, brightness, noise=2, count=16, seed=top))
    assert frames[-1].payload.data == b"dark ends"
    later = frames[3:]
    assert not any(frame.flags & Flag.MODEL_MISFIT for frame in later)
    assert all(frame.phase > top - rows_per_chip for frame in later)
    last = [frame.phase + len(frame.bits) * frame.rows_per_chip for frame in later]
    assert max(last) < 1080 - bottom + 1.5 * rows_per_chip


@pytest.mark.parametrize("seed", [66, 95])
def test_a_profile_that_is_given_up_beside_chips_that_are_mostly_right(seed):
    """The kept frames are gone then: the process ended."""
    random, rows = np.random.default_rng(seed), np.arange(720)
    brightness = 78 * np.sqrt(np.clip(1 - ((rows - 395) / 246) ** 2, 0, 1)) * ((rows >= 150) & (rows < 640))
    payload = bytes(random.integers(0, 256, 20, dtype=np.uint8))
    of_lamp = {"noise": 3, "count": 24, "seed": seed, "row_time": 14.8e-6, "error": 1.00256}
    frames = list(stream(payload, 7.667, 0.4036, random.uniform(0.1, 3), brightness, **of_lamp))
    assert len(frames) == 24 or frames[-1].payload.data == payload
