"""Raw bits from frames: recordings, simulated frames, agreement with the reference, refusals."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ocisac_fast as ocisac
from ocisac_fast import Camera

CAMERA = Camera(row_time=1.0)


def exposed_chips(chips, rows, rows_per_chip, exposure, start):
    """Rows of chips through a box exposure (rows): the middles of the ramps lie at start + k rows_per_chip."""
    end = np.arange(rows) + exposure / 2
    if exposure == 0:
        return chips[np.floor((end - start) / rows_per_chip).astype(int)].astype(float)
    prefix = np.concatenate([[0.0], np.cumsum(chips)]) * rows_per_chip

    def integral(time):
        return np.interp(time, start + rows_per_chip * np.arange(len(prefix)), prefix)

    return (integral(end) - integral(end - exposure)) / exposure


def chip_sequence(random, count, kind):
    if kind == "alternating":
        return np.arange(count) % 2
    if kind == "manchester":
        data = random.integers(0, 2, count // 2 + 1)
        return np.stack([data, 1 - data], axis=1).ravel()[:count]
    if kind == "runs":  # up to 8 chips without a change
        lengths = random.integers(1, 9, count)
        return np.repeat(np.arange(count) % 2, lengths)[:count]
    chips = random.integers(0, 2, count)
    for k in range(8, count):
        if np.ptp(chips[k - 8 : k + 1]) == 0:
            chips[k] ^= 1
    return chips


class Frame:
    """A simulated frame (rows, columns): chips, gradient along the rows and the columns, ambient light, noise."""

    def __init__(self, seed, rows_per_chip, exposure, kind="random", noise=0.02, gradient=4.0, rows=1080, columns=48):
        random = np.random.default_rng(seed)
        self.chips = chip_sequence(random, int(rows / rows_per_chip) + 8, kind)
        self.rows_per_chip = rows_per_chip
        start = -random.uniform(1, 3) * rows_per_chip
        light = exposed_chips(self.chips, rows, rows_per_chip, exposure * rows_per_chip, start)
        along = np.linspace(0, 1, rows) if random.random() < 0.5 else np.linspace(1, 0, rows)
        gain = gradient ** (along - 1)
        across = 0.3 + 0.7 * np.exp(-(((np.arange(columns) / columns - random.random()) / 0.4) ** 2))
        self.light = gain[:, None] * across * (light[:, None] + 0.2)
        self.pixels = self.light + noise * gain[:, None] * random.standard_normal((rows, columns))
        first = int(np.ceil((-0.5 - start) / rows_per_chip))
        self.phase = start + first * rows_per_chip
        self.bits = "".join(map(str, self.chips[first : int(np.floor((rows - 0.5 - start) / rows_per_chip))]))

    def as_bytes(self, scale=180.0):
        return np.clip(np.rint(scale * self.pixels + 10), 0, 255).astype(np.uint8)


def assert_received(got, frame):
    """The bits sent; a chip that ends on the frame's edge may be on either side of it."""
    sent = "".join(map(str, frame.chips))
    assert got.bits
    assert got.bits in sent, f"{frame.bits}\n{got.bits} {got.flags!r} {got.rows_per_chip}"
    assert abs(len(got.bits) - len(frame.bits)) <= 1
    assert abs(got.rows_per_chip / frame.rows_per_chip - 1) < 2e-3


@pytest.mark.parametrize("kind", ["laser", "underwater"])
def test_recordings_of_real_cameras(recordings, kind):
    for entry in json.loads((recordings / "recordings.json").read_text()):
        if "receive" not in entry or not entry["file"].startswith(kind):
            continue
        image = pytest.importorskip("cv2").imread(str(recordings / entry["file"]), 1 | 128)
        got = ocisac.receive(image[None], Camera(entry.get("row_time_s", 1.0), entry.get("exposure_s")))[0]
        want = entry["receive"]
        chips = want["rows"] / want["rows_per_chip"]
        assert chips - 3 <= len(got.bits) <= chips + 1, entry["file"]
        assert abs(got.rows_per_chip / want["rows_per_chip"] - 1) < 2e-3, entry["file"]
        if "contains_bits" in want:
            assert want["contains_bits"] in got.bits, entry["file"]
        else:
            assert got.bits in want["cyclic_bits"] * (len(got.bits) // len(want["cyclic_bits"]) + 2), entry["file"]


@settings(deadline=None, max_examples=50)
@given(
    seed=st.integers(0, 2**32),
    rows_per_chip=st.floats(2.2, 24.0),
    exposure=st.one_of(st.just(0.0), st.floats(0.01, 1)),
    kind=st.sampled_from(["random", "manchester", "runs"]),
    noise=st.floats(0.005, 0.05),
    gradient=st.floats(1, 4),
    exposure_known=st.booleans(),
)
def test_simulated_frames_without_an_error(seed, rows_per_chip, exposure, kind, noise, gradient, exposure_known):
    if kind == "runs":
        rows_per_chip /= 2  # fewer edges a chip
    rows_per_chip = max(rows_per_chip, 2.2)
    frame = Frame(seed, rows_per_chip, exposure, kind, noise, gradient)
    camera = Camera(1.0, exposure * rows_per_chip if exposure_known else None)
    got = ocisac.receive(frame.as_bytes(), camera)[0]
    assert_received(got, frame)
    assert got.snr > 9
    assert not got.flags
