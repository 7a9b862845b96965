"""Raw bits of a lamp that stands in a part of the rows, where hum, other lamps or texture fill the rest."""

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, SquareWave, Tone, demo, integrate_exposure
from ocisac_fast.scene.simulation import texture

ROW_TIME, ROWS, COLUMNS, SWING = 22.2e-6, 1080, 64, 80.0
BESIDE = {
    "hum of 100 Hz": Tone(100.0, amplitude=0.25 * SWING),
    "hum of 120 Hz": Tone(120.0, amplitude=0.5 * SWING),
    "lamp of 1 kHz": SquareWave(1000.0, amplitude=0.3 * SWING),
}


class Filmed:
    """A frame of Manchester chips of a lamp in ``share`` of the rows, and what else the columns show."""

    def __init__(self, seed, rows_per_chip, share, *, beside=None, reflectance=1.0, ambient=30.0):
        random = np.random.default_rng(seed)
        data = random.integers(0, 2, 400)
        self.chips = np.stack([data, 1 - data], axis=1).ravel()
        self.rows_per_chip, self.start = rows_per_chip, random.uniform(1, 100)
        rate = 1 / (rows_per_chip * ROW_TIME)
        self.exposure_rows = 0.5 * rows_per_chip
        self.camera = Camera(ROW_TIME, 0.5 / rate)
        light = integrate_exposure(Chips(self.chips, rate, repeat=True), self.camera, ROWS, start=self.start / rate)
        row, column = np.arange(ROWS) - (ROWS - 1) / 2, np.arange(COLUMNS) - (COLUMNS - 1) / 2
        lit = np.abs(row) < share * ROWS / 2
        self.first, self.last = np.flatnonzero(lit)[[0, -1]]
        picture = ambient + SWING * light[:, None] * lit[:, None] * np.exp(-0.5 * (column / 12) ** 2)
        if beside is not None:
            picture += integrate_exposure(beside, self.camera, ROWS, start=random.uniform(0, 1))[:, None]
        picture = picture * reflectance + random.normal(0, 2, picture.shape)
        self.pixels = np.clip(np.rint(picture), 0, 255).astype(np.uint8)

    def check(self, got):
        """Bits as sent where the lamp stands, and no sure ones more than a chip beyond."""
        assert got.rows_per_chip == pytest.approx(self.rows_per_chip, rel=0.005)
        begin = got.phase + np.arange(len(got.bits)) * got.rows_per_chip - self.exposure_rows / 2
        end = begin + got.rows_per_chip + self.exposure_rows
        inside = (begin >= self.first) & (end <= self.last)
        middle = 0.5 * (begin + end) - self.exposure_rows / 2
        index = np.floor(self.start + middle / self.rows_per_chip).astype(int)
        bits = np.frombuffer(got.bits.encode(), np.uint8) - ord("0")
        assert np.count_nonzero(bits[inside] != self.chips[index[inside] % self.chips.size]) == 0
        outside = (end < self.first - got.rows_per_chip) | (begin > self.last + got.rows_per_chip)
        assert np.count_nonzero(outside & (np.abs(got.relative_levels) > 0.2)) == 0
        levels = got.levels[1] - got.levels[0]
        assert np.median(levels[inside]) > 0.35 * SWING


@pytest.mark.parametrize("share", [0.35, 0.6])
@pytest.mark.parametrize("beside", BESIDE)
def test_light_on_all_columns_gives_no_bits_beyond_the_lamp(share, beside):
    for seed, rows_per_chip in enumerate((4.3, 7.0, 11.2)):
        filmed = Filmed(seed, rows_per_chip, share, beside=BESIDE[beside])
        filmed.check(ocisac.receive(filmed.pixels, filmed.camera)[0])


@pytest.mark.parametrize("share", [0.35, 0.6])
def test_texture_gives_no_bits_beyond_the_lamp(share):
    for seed, rows_per_chip in enumerate((4.3, 7.0, 11.2)):
        reflectance = texture(ROWS, COLUMNS, 0.08, seed=seed)
        filmed = Filmed(seed, rows_per_chip, share, reflectance=reflectance)
        filmed.check(ocisac.receive(filmed.pixels, filmed.camera)[0])


def test_a_lamp_without_data_beside_stripes_that_move_gives_no_bits():
    # Its own wave, removed as that of another lamp, leaves chips that repeat with it.
    frames = np.stack(list(demo.video_frames()))
    for got in ocisac.receive(frames, Camera(ROW_TIME)):
        assert not got.bits or got.flags


def with_frames_before(frames, share, below):
    """Noise reduction: pixels hold a share of the stored frame before where that differs by less than ``below`` DN."""
    before = None
    for now in frames:
        if before is not None:
            change = before - now
            near = np.lib.stride_tricks.sliding_window_view(np.pad(change, 2, mode="edge"), (5, 5)).mean(axis=(2, 3))
            now = now + share * change * (np.abs(near) < below)
        before = now
        yield np.clip(np.rint(now), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("share", "below"), [(0.4, 15), (0.5, 20), (0.5, 40)])
def test_noise_reduction_by_a_share_of_the_frame_before_where_it_differs_by_little_is_undone(share, below):
    """In rows of partly lit columns, too, which differ by less than the others: two films of three arrive as if it were
    not there (11 to 12 frames)."""
    camera, payload = Camera(22.2e-6, 622e-6, 1 / 30), bytes(range(100))
    sent = ocisac.transmit(payload, format=ocisac.packets.PacketFormat())
    profile = np.exp(-(((np.arange(48) - 24) / 24) ** 2) / 2)
    frames = []
    for seed in range(3):
        random = np.random.default_rng(seed)
        light = (
            ocisac.integrate_exposure(sent.waveform(8e3), camera, 1080, start=start + k / 30)
            for start in [random.uniform(0, 5)]
            for k in range(20)
        )
        film = (20 + 120 * rows[:, None] * profile + random.normal(0, 2, (1080, 48)) for rows in light)
        receiver = ocisac.Receiver(camera, chip_rate=8e3)
        results = map(receiver.push, with_frames_before(film, share, below))
        frames.append(next((n for n, one in enumerate(results, 1) if one.payload), 99))
    assert sorted(frames)[1] <= 14
