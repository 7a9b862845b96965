"""Raw bits from frames: recordings, simulated frames, what the numbers are by definition, refusals."""

import json

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, Flag, integrate_exposure
from ocisac_fast.reference import linear_light

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
    assert abs(got.rows_per_chip - frame.rows_per_chip) < 2e-3 * frame.rows_per_chip + 3 * got.rows_per_chip_std


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


@settings(deadline=None, max_examples=settings.default.max_examples // 2)
@given(
    seed=st.integers(0, 2**32),
    rows_per_chip=st.floats(2.2, 24.0),
    exposure=st.one_of(st.just(0.0), st.floats(0.01, 1)),
    kind=st.sampled_from(["random", "manchester", "runs"]),
    noise=st.floats(0.005, 0.05),
    gradient=st.floats(1, 4),
    exposure_known=st.booleans(),
)
@example(  # edges at a fifth of their height fit half the chip better than the chip at half the height
    seed=0, rows_per_chip=20.5, exposure=0.75, kind="random", noise=0.015625, gradient=2.0, exposure_known=False
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


def assert_consistent(got, light, camera):
    """Levels, soft values and their ratios are what the combined rows show, chip by chip."""
    assert got.weights.shape == (light.shape[-1],)
    np.testing.assert_array_equal(got.columns, np.flatnonzero(got.weights))
    assert got.weights.min() >= 0
    assert got.weights.sum() == pytest.approx(1)
    if not got.bits:
        assert np.isnan([got.rows_per_chip, got.chip_rate, got.phase, got.snr]).all()
        assert got.flags
        return
    assert got.chip_rate == pytest.approx(1 / (got.rows_per_chip * camera.row_time))
    assert got.chip_rate_std == pytest.approx(got.rows_per_chip_std / got.rows_per_chip * got.chip_rate)
    lit = got.relative_levels != 0  # the rest lies in rows that the lamp does not light
    np.testing.assert_array_equal(got.relative_levels[lit] > 0, np.array([bit == "1" for bit in got.bits])[lit])
    assert got.snr == pytest.approx(min(1 / np.mean((np.abs(got.relative_levels[lit]) - 1) ** 2), 1e12))
    assert bool(got.flags & Flag.WEAK) == (got.snr < 9)
    assert -0.5 - 1e-6 <= got.phase < got.rows_per_chip - 0.5 + 1e-6
    assert got.phase + len(got.bits) * got.rows_per_chip <= len(light) - 0.5 + 1e-6
    # A chip's value: the mean of the rows, straight between them, over its middle away from the ramps of the exposure.
    signal = light @ got.weights
    reach = max(0.4 * (got.rows_per_chip - camera.exposure / camera.row_time), 0.5)
    middles = got.phase + (np.arange(len(got.bits)) + 0.5) * got.rows_per_chip
    fine = np.clip(middles[:, None] + reach * (2 * np.arange(0.5, 2000) / 2000 - 1), 0, len(signal) - 1)
    values = np.interp(fine, np.arange(len(signal)), signal).mean(axis=1)
    dark, bright = got.levels
    swing = np.maximum(bright - dark, 1e-3 * (bright - dark).max())
    # Rows beyond the lamp are no part of the first and the last lit chip.
    whole = lit & np.append(True, lit[:-1]) & np.append(lit[1:], True)
    inside = whole & (middles > reach) & (middles < len(signal) - 1 - reach)
    soft = (values - (dark + bright) / 2) / (swing / 2)
    np.testing.assert_allclose(
        soft[inside], got.relative_levels[inside], rtol=1e-3, atol=1e-3 * (1 + np.abs(got.relative_levels).max())
    )


@settings(max_examples=3 * settings.default.max_examples // 10)
@given(
    seed=st.integers(0, 2**32),
    rows_per_chip=st.floats(2.2, 40.0),
    exposure=st.one_of(st.just(0.0), st.floats(0.01, 1)),
    rows=st.sampled_from([97, 540, 720, 1080]),
    columns=st.sampled_from([1, 2, 7, 64, 131]),
    dtype=st.sampled_from(["uint8", "uint16", "float32", "float64"]),
    curve=st.sampled_from(["linear", "gamma", "srgb"]),
    colours=st.integers(0, 3),
)
@example(170, 9.0, 0.0, 720, 1, "uint8", "gamma", 2)  # colours that agree are added
@example(1794357311, 38.10956870866574, 0.0, 540, 2, "float64", "linear", 3)  # noise has more edges than 13 chips
def test_bits_and_numbers_are_those_of_their_definitions(
    seed, rows_per_chip, exposure, rows, columns, dtype, curve, colours
):
    planes = []
    for colour in range(max(colours, 1)):
        frame = Frame(seed, rows_per_chip, exposure, noise=0.01 * (1 + colour), rows=rows, columns=columns)
        planes.append(frame.as_bytes(scale=230.0).astype(dtype))
    frames = np.stack(planes, axis=-1)[None] if colours else planes[0]
    camera = Camera(2e-5, exposure * rows_per_chip * 2e-5, tone_curve=curve, dark_level=10.0, white_level=255.0)
    got = ocisac.receive(frames, camera)[0]
    if colours:
        alone = ocisac.receive(frames, camera, colour=got.colour)[0]
        assert (alone.bits, alone.flags) == (got.bits, got.flags)
    light = sum(
        weight * linear_light(frames[0, ..., colour] if colours else frames, camera)
        for colour, weight in enumerate(got.colour_weights)
    )
    assert_consistent(got, light, camera)
    if got.bits and not got.flags and curve == "linear":
        assert_received(got, Frame(seed, rows_per_chip, exposure, noise=0.01, rows=rows, columns=columns))


@pytest.mark.parametrize("exposure", [0.6, 0.05])  # edges of several rows, and between two
def test_standard_error_is_that_of_many_frames(exposure):
    frames = [Frame(seed, rows_per_chip=7.37, exposure=exposure, gradient=1.0) for seed in range(60)]
    got = [ocisac.receive(frame.pixels, CAMERA)[0] for frame in frames]
    off = np.array([(g.rows_per_chip - 7.37) / g.rows_per_chip_std for g in got])
    assert 0.5 < np.sqrt(np.mean(off**2)) < 2


@pytest.mark.parametrize("exposure", [0.15, 0.6, 0.9, 1.3])
def test_the_error_of_a_rate_near_a_whole_number_of_rows_includes_rounding(exposure):
    """Edges that lie between the exposures of two rows show the same row, chip after chip."""
    for seed in range(40):
        random = np.random.default_rng(seed)
        rows_per_chip = random.integers(3, 8) + random.choice([-1, 1]) * 10 ** random.uniform(-3, -1.7)
        frame = Frame(seed, rows_per_chip, exposure / rows_per_chip, gradient=1.0, rows=int(random.choice([240, 720])))
        got = ocisac.receive(frame.as_bytes(), CAMERA)[0]
        assert got.flags or abs(got.rows_per_chip - rows_per_chip) < 5 * got.rows_per_chip_std


def test_a_square_wave_is_chips_in_turn():
    frame = Frame(3, rows_per_chip=9.3, exposure=0.5, kind="alternating")
    got = ocisac.receive(frame.as_bytes(), CAMERA)[0]
    assert_received(got, frame)
    assert got.bits in "01" * 200


def test_saturated_columns_are_left_out():
    frame = Frame(11, rows_per_chip=8.6, exposure=0.7, columns=120, noise=0.01)
    pixels = frame.as_bytes(scale=100.0)
    core = pixels.astype(float)
    core[300:600, 40:60] *= 12
    pixels = np.clip(core, 0, 255).astype(np.uint8)
    got = ocisac.receive(pixels, CAMERA)[0]
    assert_received(got, frame)
    assert not set(got.columns) & set(range(40, 60))
    assert not got.flags


def test_columns_that_all_saturate_are_used_and_flagged():
    frame = Frame(12, rows_per_chip=8.6, exposure=0.3, gradient=1.0, columns=16)
    got = ocisac.receive(frame.as_bytes(scale=900.0), CAMERA)[0]
    assert_received(got, frame)
    assert got.flags == Flag.SATURATED


@pytest.mark.parametrize("highest", [255, 240, 180])
def test_light_that_is_clipped_at_any_level_is_flagged(highest):
    random = np.random.default_rng(0)
    chips = np.eye(4)[random.integers(0, 4, 120)].ravel()  # pulses of 4-PPM, so much too bright that they are longer
    camera = Camera(22.2e-6, 0.9 * 2.6 * 22.2e-6)
    light = integrate_exposure(Chips(chips, 1 / (2.6 * 22.2e-6), repeat=True), camera, 1080)[:, None]
    for brightness, flags in ((2.9, Flag.SATURATED), (0.8, Flag(0))):
        pixels = np.minimum(highest * (0.05 + brightness * light) + random.normal(0, 2, (1080, 80)), highest)
        got = ocisac.receive(np.rint(np.clip(pixels, 0, None)).astype(np.uint8), camera)[0]
        assert got.bits
        assert got.flags & Flag.SATURATED == flags


def test_the_channel_with_the_light_is_chosen():
    frame = Frame(13, rows_per_chip=5.4, exposure=0.5)
    random = np.random.default_rng(0)
    dark = 20 + 3 * random.standard_normal((*frame.pixels.shape, 3))
    for colour in range(3):
        picture = dark.copy()
        picture[..., colour] += 150 * frame.pixels
        got = ocisac.receive(picture[None], CAMERA)[0]
        assert got.colour == colour
        assert_received(got, frame)
        assert ocisac.receive(picture[None], CAMERA, colour=colour)[0].bits == got.bits
        assert ocisac.receive(picture[None], CAMERA, colour=(colour + 1) % 3)[0].bits == ""


@pytest.mark.parametrize("strength", [1.0, 0.4])
def test_lights_side_by_side_are_sources_of_their_own(strength):
    for seed in range(6):
        left = Frame(seed, 6.6, 0.5, gradient=1.5, columns=60)
        middle = Frame(seed + 50, 4.3, 0.7, "manchester", gradient=1.5, columns=60)
        right = Frame(seed + 90, 9.1, 0.4, "runs", gradient=1.5, columns=60)
        dark = 0.1 + 0.02 * np.random.default_rng(seed).standard_normal((1080, 40))
        pixels = np.hstack([dark, left.pixels, dark, strength * middle.pixels, right.pixels, dark])
        frame = np.clip(np.rint(150 * pixels + 10), 0, 255).astype(np.uint8)
        got = ocisac.receive(frame, CAMERA)
        assert [g.source for g in got] == [0, 1, 2]
        by_column = sorted(got, key=lambda g: g.weights @ np.arange(len(g.weights)))
        for g, sent, first in zip(by_column, (left, middle, right), (40, 140, 200), strict=True):
            assert_received(g, sent)
            assert not g.flags
            assert first - 8 <= g.columns.min()
            assert g.columns.max() < first + 68


def test_one_light_and_texture_are_one_source():
    for seed in range(10):
        frame = Frame(seed, 6.6, 0.5, columns=80)
        texture = np.repeat(np.random.default_rng(seed).uniform(0, 1, (90, 1)), 12, axis=0) * np.ones(40)
        pixels = np.hstack([frame.as_bytes(100.0), (60 + 80 * texture).astype(np.uint8)])
        got = ocisac.receive(pixels, CAMERA)
        assert len(got) == 1
        assert_received(got[0], frame)
        assert got[0].columns.max() < 80


def test_one_result_for_each_frame():
    frames = [Frame(seed, rows_per_chip=6.6, exposure=0.5) for seed in range(3)]
    got = ocisac.receive(np.stack([frame.as_bytes() for frame in frames]), CAMERA)
    assert [g.frame for g in got] == [0, 1, 2]
    for g, frame in zip(got, frames, strict=True):
        assert_received(g, frame)


def test_a_rough_chip_rate_is_enough_where_edges_are_few():
    frame = Frame(21, rows_per_chip=40.0, exposure=0.5, rows=540, noise=0.01)
    for off in (0.98, 1.0, 1.02):
        got = ocisac.receive(frame.as_bytes(), CAMERA, chip_rate=off / 40)[0]
        assert_received(got, frame)
        assert not got.flags
        assert got.rows_per_chip == pytest.approx(40, abs=4 * got.rows_per_chip_std)
    assert Flag.TOO_FEW_EDGES in ocisac.receive(frame.as_bytes()[:400], CAMERA)[0].flags


@pytest.mark.parametrize("positions", [16, 32])
@pytest.mark.parametrize(("exposure", "noise"), [(0.3, 1), (0.7, 3)])
def test_a_rate_is_sure_by_its_lead_over_others(positions, exposure, noise):
    """Pulses of one chip, 8 to 40 edges: the rate is right or flagged, though most rows are dark, with noise alone, and
    all pulses may lie at even places.
    """
    outcomes = []
    for seed in range(5000, 5150):
        random = np.random.default_rng(seed)
        rows_per_chip = random.uniform(3, 10)
        words = (int(1080 / rows_per_chip) + 100) // positions + 1
        chips = np.concatenate([np.eye(positions, dtype=int)[random.integers(positions)] for _ in range(words)])
        light = exposed_chips(chips, 1080, rows_per_chip, exposure * rows_per_chip, -40 * rows_per_chip)
        pixels = 10 + 200 * light[:, None] + random.normal(0, noise, (1080, 40))
        got = ocisac.receive(np.clip(np.rint(pixels), 0, 255).astype(np.uint8), Camera(1.0, dark_level=10))[0]
        is_right = abs(got.rows_per_chip / rows_per_chip - 1) < 0.001
        outcomes.append("flag" if got.flags else "right" if is_right else "wrong")
    assert "wrong" not in outcomes
    assert outcomes.count("right") > (0.95 if positions == 16 else 0.75) * len(outcomes)


@pytest.mark.parametrize(
    ("frame", "flag"),
    [
        (np.full((1080, 64), 30, np.uint8), Flag.NO_SIGNAL),
        (np.zeros((1080, 64)), Flag.NO_SIGNAL),
        (np.full((1080, 64), 255, np.uint8), Flag.SATURATED | Flag.NO_SIGNAL),
        (np.ones((1, 1)), Flag.NO_SIGNAL),
        (np.arange(5.0), Flag.NO_SIGNAL),
        (np.linspace(0, 200, 1080)[:, None] * np.ones(40), Flag.TOO_FEW_EDGES),
        (np.repeat([10.0, 200.0, 10.0], 300)[:, None] * np.ones(40), Flag.TOO_FEW_EDGES),
    ],
    ids=["constant", "black", "saturated", "pixel", "short", "gradient", "two edges"],
)
def test_nothing_is_invented_where_there_is_no_light(frame, flag):
    got = ocisac.receive(frame, CAMERA)[0]
    assert got.bits == ""
    assert np.isnan([got.rows_per_chip, got.chip_rate, got.phase, got.snr]).all()
    assert got.flags == flag
    assert got.levels.shape == (2, 0)
    assert got.relative_levels.shape == (0,)


@pytest.mark.parametrize("columns", [1, 40])
def test_noise_is_not_bits(columns):
    for seed in range(60):
        noise = np.random.default_rng(seed).normal(100, 5, (720, columns))
        got = ocisac.receive(noise, CAMERA)[0]
        assert got.bits == "", seed
        assert got.flags == Flag.NO_SIGNAL


def test_a_long_exposure_is_flagged():
    frame = Frame(14, rows_per_chip=5.0, exposure=1.0)
    assert Flag.LONG_EXPOSURE in ocisac.receive(frame.as_bytes(), Camera(1.0, 6.0))[0].flags
    blurred = Frame(14, rows_per_chip=4.5, exposure=2.4)  # no chips are found
    (nothing,) = ocisac.receive(blurred.as_bytes(), Camera(1.0, 2.4 * 4.5), chip_rate=1 / 4.5)
    assert (nothing.bits, nothing.flags) == ("", Flag.NO_SIGNAL | Flag.LONG_EXPOSURE)


@pytest.mark.parametrize("rows_per_chip", [3.0, 4.5, 8.0])
def test_single_chips_that_do_not_reach_the_level_of_longer_runs(rows_per_chip):
    """Exposed for 1.4 to 1.6 chips they cross the middle of the longer runs' levels at the right rows."""
    random, right = np.random.default_rng(7), 0
    for exposure in (1.4, 1.5, 1.6):
        for _ in range(5):
            chips = random.integers(0, 2, round(1080 / rows_per_chip) + 20)
            light = exposed_chips(chips, 1080, rows_per_chip, exposure * rows_per_chip, -2.3 * rows_per_chip)
            pixels = np.round(80 + 90 * light[:, None] + random.normal(0, 1, (1080, 6))).astype(np.uint8)
            (received,) = ocisac.receive(pixels, Camera(1.0))
            found = ocisac.compare_bits(received.bits, chips)
            is_right = found.errors + found.inserted <= 1 and found.compared > 0.98 * 1080 / rows_per_chip
            assert is_right or Flag.WEAK in received.flags
            right += is_right
    assert right >= 14


def test_chips_are_as_long_as_the_runs_say():
    """Dim single columns, at half whose period the edges' lattice may lock: every run is then of an even number."""
    for seed in np.random.default_rng(1).integers(0, 1 << 31, 40):
        frame = Frame(int(seed), 11.06, 0.2, "manchester", 0.04, 1.4, columns=1)
        pixels = frame.as_bytes(scale=40.0)
        got = ocisac.receive(pixels, CAMERA)[0]
        assert_received(got, frame)


def test_what_stands_still_is_flagged():
    """The same rows in the next frame are a picture, or a light in step with the frames; data change."""
    for seed in range(8):
        moving = [Frame(2 * seed + k, 6.3, 0.5).as_bytes() for k in range(2)]
        noise = np.random.default_rng(seed).normal(0, 2, (2, *moving[0].shape))
        still = np.clip(moving[0] + noise, 0, 255).astype(np.uint8)
        camera = Camera(1.0, 0.5 * 6.3)
        assert all(one.flags == Flag.AMBIGUOUS_KIND for one in ocisac.receive(still, camera))
        assert all(one.bits and not one.flags for one in ocisac.receive(np.stack(moving), camera))


@pytest.mark.parametrize("turned", [0, 1])
@pytest.mark.parametrize("module", [6.3, 10.0, 16.0])
def test_a_printed_code_is_flagged(module, turned):
    """Columns of one module agree as a lamp's do, but their neighbours have other bits on one clock."""
    for seed, modules in enumerate((25, 41)):
        random = np.random.default_rng(seed)
        row, column = np.indices((int(modules * module), int(modules * module)))
        row, column = row + np.tan(np.radians(turned)) * column, column - np.tan(np.radians(turned)) * row
        cells = random.integers(0, 2, (2 * modules, 2 * modules))
        code = cells[(row / module).astype(int), (column / module + modules / 2).astype(int)]
        picture = np.rint(40 + 180 * code + random.normal(0, 1.5, code.shape)).astype(np.uint8)
        assert all(one.flags for one in ocisac.receive(picture, CAMERA) if one.bits)


@pytest.mark.parametrize("lamps", [3, 4])
@pytest.mark.parametrize("exposure", [0.02, 0.3])
def test_lamps_on_one_clock_are_no_code(lamps, exposure):
    for seed in range(6):
        random = np.random.default_rng(seed)
        chips = random.integers(0, 2, (lamps, 200))
        light = [exposed_chips(each, 1080, 9.7, exposure * 9.7, -20.0) for each in chips]
        pixels = 10 + 150 * np.repeat(np.transpose(light), 40, axis=1) * (np.arange(40 * lamps) % 40 < 30)
        picture = np.clip(np.rint(pixels + random.normal(0, 2, pixels.shape)), 0, 255).astype(np.uint8)
        got = ocisac.receive(picture, Camera(1.0, exposure * 9.7))
        assert len(got) == lamps
        assert not any(one.flags for one in got)


def test_an_arc_of_light_is_no_code():
    """Its columns show one lamp's bits, each in rows of its own."""
    for seed in range(6):
        frame = Frame(seed, 9.7, 0.1, gradient=1.5, noise=0, columns=1)
        row, column = np.indices((1080, 240))
        lit = np.abs(column - 40 - 160 * np.sin(np.pi * row / 1080)) < 10
        pixels = 10 + 150 * frame.pixels * lit + np.random.default_rng(seed).normal(0, 1, lit.shape)
        got = ocisac.receive(np.clip(np.rint(pixels), 0, 255).astype(np.uint8), CAMERA)
        assert all(Flag.AMBIGUOUS_KIND not in one.flags for one in got)


@pytest.mark.parametrize("at_black", [False, True])
def test_clipped_light_is_not_read_at_twice_its_rate(at_black):
    """Light that is clipped at a level of which the receiver knows nothing: all bright runs are longer by a part of a
    chip, or all dark ones."""
    random = np.random.default_rng(11)
    for seed in range(12):
        frame = Frame(seed, random.uniform(6, 16), random.uniform(0.6, 1), noise=0, gradient=1)
        light = (frame.light / frame.light.max(axis=0) - 1 / 6) * 6 / 5  # 0 to 1 in each column
        clipped = np.clip(
            (1 - light if at_black else light) * random.uniform(2.2, 4) + random.normal(0, 0.01, light.shape), 0, 1
        )
        pixels = np.rint(235 * (1 - clipped if at_black else clipped)).astype(np.uint8)
        got = ocisac.receive(pixels, CAMERA)[0]
        assert got.rows_per_chip == pytest.approx(frame.rows_per_chip, rel=0.01)
        assert ocisac.compare_bits(got.bits, frame.chips).errors <= 1


@pytest.mark.parametrize("exposure", [1.7, 1.9])
def test_pulses_of_two_chips_are_flagged_where_the_exposure_is_unknown(exposure):
    """They are of one chip here, which is exposed for nearly two: 8-PPM."""
    silent = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        chips = np.eye(8)[random.integers(0, 8, 60)].ravel()
        light = integrate_exposure(Chips(chips, 5e3), Camera(22.2e-6, exposure / 5e3), 1080, start=exposure / 5e3)
        got = ocisac.receive(np.rint(20 + 120 * light[:, None] + random.normal(0, 1, (1080, 64))), Camera(22.2e-6))[0]
        silent += not got.flags and got.bits not in "".join(map(str, chips.astype(int)))
    assert silent <= 1


@pytest.mark.parametrize("seed", [61, 311, 394])
def test_light_beside_a_lamp_that_is_its_own_is_not_subtracted(seed):
    """Columns of a wall whose shades each walk along the rows: those of little weight show the lamp, too."""
    random = np.random.default_rng(seed)
    row_time, rows_per_chip, columns = 22.2e-6, 8 * random.uniform(0.97, 1.03), (8, 32)[seed % 2]
    camera = Camera(row_time, 0.5 * rows_per_chip * row_time)
    sent = random.integers(0, 2, 500)
    light = integrate_exposure(Chips(sent, 1 / (rows_per_chip * row_time)), camera, 720, start=1e-3)[:, None]
    wall = np.exp(np.cumsum(random.normal(0, 0.04, (720, columns)), 0))
    picture = 200 * light * wall / wall.max() + random.normal(0, 0.5, wall.shape)
    found = ocisac.receive(np.clip(np.rint(picture), 0, 255).astype(np.uint8)[None], camera)[0]
    bits = np.array(list(found.bits), int)
    assert max(np.mean(bits == sent[k : k + bits.size]) for k in range(60)) > 0.9
