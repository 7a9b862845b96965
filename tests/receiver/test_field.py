"""Raw bits of lamps as they are filmed: in a part of the rows, beside hum and other lamps."""

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, SquareWave, Tone, integrate_exposure

ROW_TIME, ROWS, SWING = 22.2e-6, 1080, 80.0


class Filmed:
    """A frame of Manchester chips of a lamp in ``share`` of the rows, beside light on all columns."""

    def __init__(self, seed, rows_per_chip, *, exposure=0.5, share=1.0, beside=None, noise=2.0):
        random = np.random.default_rng(seed)
        data = random.integers(0, 2, 400)
        self.chips = np.stack([data, 1 - data], axis=1).ravel()
        self.rows_per_chip, self.start = rows_per_chip, random.uniform(1, 100)
        rate = 1 / (rows_per_chip * ROW_TIME)
        self.camera = Camera(ROW_TIME, exposure / rate)
        light = integrate_exposure(Chips(self.chips, rate, repeat=True), self.camera, ROWS, start=self.start / rate)
        row, column = np.arange(ROWS) - (ROWS - 1) / 2, np.arange(64) - 31.5
        shape = np.exp(-0.5 * (column / 16) ** 2) * (np.abs(row) < share * ROWS / 2)[:, None]
        self.first, self.last = np.flatnonzero(shape.any(axis=1))[[0, -1]]
        picture = 20 + SWING * light[:, None] * shape
        if beside is not None:
            picture += integrate_exposure(beside, self.camera, ROWS, start=random.uniform(0, 1))[:, None]
        picture += random.normal(0, noise, picture.shape)
        self.pixels = np.clip(np.rint(picture), 0, 255).astype(np.uint8)

    def check(self, got, *, wrong=0):
        """Bits as sent where the lamp stands, and no sure ones a chip beyond."""
        assert got.rows_per_chip == pytest.approx(self.rows_per_chip, rel=0.005)
        begin = got.phase + np.arange(len(got.bits)) * got.rows_per_chip
        margin = 0.5 * self.camera.exposure / ROW_TIME
        inside = (begin - margin >= self.first) & (begin + self.rows_per_chip + margin <= self.last)
        middle = begin + 0.5 * got.rows_per_chip - margin
        index = np.floor(self.start + middle / self.rows_per_chip).astype(int)
        bits = np.frombuffer(got.bits.encode(), np.uint8) - ord("0")
        assert np.count_nonzero((bits != self.chips[index % self.chips.size])[inside]) <= wrong
        outside = (begin + 2 * self.rows_per_chip + margin < self.first) | (begin > self.last + self.rows_per_chip)
        assert np.count_nonzero(outside & (np.abs(got.relative_levels) > 0.2)) == 0


@pytest.mark.parametrize("share", [0.3, 0.5])
@pytest.mark.parametrize(
    "beside",
    [
        Tone(100.0, amplitude=0.5 * SWING),
        Tone(120.0, amplitude=0.8 * SWING),
        SquareWave(1000.0, amplitude=0.35 * SWING),
        SquareWave(2600.0, amplitude=0.5 * SWING),
    ],
    ids=["hum of 100 Hz", "hum of 120 Hz", "lamp of 1 kHz", "lamp of 2.6 kHz"],
)
def test_other_light_gives_no_bits_beyond_the_lamp(share, beside):
    for seed in range(4):
        filmed = Filmed(seed, 6.0, share=share, beside=beside)
        got = ocisac.receive(filmed.pixels, filmed.camera)
        assert len(got) == 1
        filmed.check(got[0])


@pytest.mark.parametrize(("share", "rows_per_chip"), [(0.75, 9.3), (0.6, 12.0), (0.2, 6.0)])
def test_the_ends_of_a_lamp_within_chips_do_not_divide_them(share, rows_per_chip):
    for seed in range(12):
        filmed = Filmed(seed, rows_per_chip, share=share)
        filmed.check(ocisac.receive(filmed.pixels, filmed.camera)[0])


def test_levels_are_those_of_the_pixels_where_light_beside_the_lamp_was_removed():
    filmed = Filmed(3, 6.0, share=0.5, beside=Tone(100.0, amplitude=0.5 * SWING), noise=0.5)
    got = ocisac.receive(filmed.pixels, filmed.camera)[0]
    signal = filmed.pixels @ got.weights
    centre = got.phase + (np.arange(len(got.bits)) + 0.5) * got.rows_per_chip
    lit = got.relative_levels != 0
    level = np.where(np.array(list(got.bits)) == "1", got.levels[1], got.levels[0])
    values = np.interp(centre, np.arange(ROWS), signal)
    assert np.median(np.abs(values - level)[lit]) < 0.05 * SWING
