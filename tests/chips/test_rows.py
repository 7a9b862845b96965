"""Kernels of row signals in the field against their twins: profile, lit rows, other light."""

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from ocisac_fast import Camera, Chips, SquareWave, _core, integrate_exposure, reference

SEEDS = st.integers(0, 2**32 - 1)


def chip_light(random, rows, rows_per_chip=5.6, exposure=28.0):
    """s of each row for random chips."""
    chips = Chips(random.integers(0, 2, 500), 1.0, repeat=True)
    return integrate_exposure(chips, Camera(1 / rows_per_chip, exposure / rows_per_chip), rows)


def recording(random, frames, rows):
    """Signals of a lamp with a profile, (frames, rows), its exposed chips, dark and swing."""
    row = np.arange(rows)
    swing = 100 * np.exp(-0.5 * ((row - rows * random.uniform(0.3, 0.7)) / (0.4 * rows)) ** 2)
    dark = 20 + 5 * np.sin(row / random.uniform(5, 50))
    exposed = np.array([chip_light(random, rows) for _ in range(frames)])
    return dark + swing * exposed + random.normal(0, 1, exposed.shape), exposed, dark, swing


@settings(deadline=None, max_examples=2 * settings.default.max_examples // 5)
@given(seed=SEEDS, frames=st.integers(2, 8), rows=st.integers(1, 200), smooth=st.integers(0, 40))
def test_the_first_profile_is_that_of_the_reference(seed, frames, rows, smooth):
    signals = recording(np.random.default_rng(seed), frames, rows)[0]
    got, want = (module.first_profile(signals, smooth) for module in (_core, reference))
    np.testing.assert_allclose(got[0], want[0], rtol=1e-12)
    np.testing.assert_allclose(got[1] ** 2, want[1] ** 2, rtol=1e-9, atol=1e-12 * want[1].max() ** 2)


def test_a_first_profile_needs_light_and_variation():
    for module in (_core, reference):
        assert module.first_profile(np.ones((1, 5)), 2) is None
        assert module.first_profile(np.ones((3, 5)), 2) is None
        assert module.first_profile(np.array([[1.0, -2.0], [2.0, 0.5]]), 2) is None


@settings(deadline=None, max_examples=2 * settings.default.max_examples // 5)
@given(
    seed=SEEDS,
    frames=st.integers(3, 8),
    rows=st.integers(1, 200),
    smooth=st.integers(0, 40),
    weight=st.floats(0, 10),
    unknown=st.integers(0, 3),
)
def test_the_fitted_profile_is_that_of_the_reference(seed, frames, rows, smooth, weight, unknown):
    random = np.random.default_rng(seed)
    _, _, dark, swing = recording(random, 1, rows)
    exposed = random.uniform(size=(frames, rows))  # chips may be alike in all frames, which determines nothing
    signals = dark + swing * exposed + random.normal(0, 1, exposed.shape)
    shape = swing * random.uniform(0.8, 1.2, rows) * (random.uniform(size=rows) < 0.95)
    want = reference.fit_profile(signals, exposed, shape, smooth, weight)
    others = recording(random, unknown, rows)[0] if unknown else np.zeros((0, rows))
    known = [*exposed, *[[]] * unknown]  # frames of unknown chips are not used
    got = _core.fit_profile([*signals, *others], known, shape, smooth, weight)
    for ours, theirs in zip(got, want, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-7)


def test_a_fitted_profile_is_the_truth_without_noise_and_draws_to_its_shape():
    random = np.random.default_rng(8)
    _, exposed, dark, swing = recording(random, 6, 300)
    got = _core.fit_profile(list(dark + swing * exposed), list(exposed), swing, 10, 0.5)
    np.testing.assert_allclose(got[0], dark, atol=1e-9)
    np.testing.assert_allclose(got[1], swing, rtol=1e-9)
    assert _core.fit_profile(list(exposed[:2]), list(exposed[:2]), swing, 10, 0.5) is None
    noisy = dark + swing * exposed + random.normal(0, 20, exposed.shape)
    errors = [np.std(_core.fit_profile(list(noisy), list(exposed), swing, 30, w)[1] - swing) for w in (0, 1, 10)]
    assert errors[0] > errors[1] > errors[2]


@given(
    values=st.lists(st.floats(0, 1), min_size=1, max_size=40),
    share=st.floats(0, 1),
)
def test_profile_rows_are_those_of_the_reference(values, share):
    assert _core.profile_rows(values, share) == reference.profile_rows(values, share)


@settings(deadline=None, max_examples=2 * settings.default.max_examples // 5)
@given(
    seed=SEEDS,
    rows=st.integers(200, 700),
    slow=st.just(0.0) | st.floats(1e-4, 0.01),
    tones=st.lists(st.floats(0.02, 0.4), max_size=2),
    known=st.booleans(),
    scaled=st.booleans(),
)
def test_other_light_is_removed_as_by_the_reference(seed, rows, slow, tones, known, scaled):
    random = np.random.default_rng(seed)
    if len(tones) == 2 and any(abs(tones[0] * a - tones[1] * b) < 3 / rows for a in (1, 2, 3) for b in (1, 2, 3)):
        tones = tones[:1]
    s = chip_light(random, rows)
    row = np.arange(rows)
    signal = 30 + 80 * s + 10 * np.sin(2 * np.pi * 0.003 * row) + random.normal(0, 1, rows)
    for tone in tones:
        signal = signal + 9 * np.cos(2 * np.pi * tone * row + 1)
    exposed = s if known else []
    scale = random.uniform(0.5, 2) + np.abs(np.linspace(-3, 3, rows)) if scaled else []
    got, want = (module.remove_nuisance(signal, slow, tones, exposed, scale) for module in (_core, reference))
    np.testing.assert_allclose(got[0], want[0], atol=1e-6)
    assert got[1] == pytest.approx(want[1], rel=1e-6)


def test_hum_and_tones_are_removed_and_the_chips_stay():
    random = np.random.default_rng(2)
    rows = 1080
    s, row = chip_light(random, rows), np.arange(rows)
    along = np.linspace(-1, 1, rows)
    light = (90 - 20 * along) * s
    hum = 25 * np.sin(2 * np.pi * 100 * 22.2e-6 * row + 0.4) + 6 * np.cos(2 * np.pi * 0.021 * row)
    rest, squares = _core.remove_nuisance(40 + light + hum, 0.012, [0.021], s)
    away = rest - light
    assert away.std() < 0.05 * hum.std()  # half cosines leave something at the frame's ends
    assert squares < 1e-3 * np.sum(hum**2)
    assert _core.remove_nuisance(light[:20], 0.4, [0.1, 0.2], s[:20]) is None


def test_hum_beside_a_lamp_is_removed_where_rows_are_divided_by_its_profile():
    random = np.random.default_rng(3)
    rows = 1080
    s, row = chip_light(random, rows), np.arange(rows)
    swing = np.exp(-0.5 * ((row - 500) / 250) ** 2)
    hum = 0.3 * np.sin(2 * np.pi * 100 * 22.2e-6 * row + 0.4)
    signal = s + hum / swing
    rest, _ = _core.remove_nuisance(signal, 0, [100 * 22.2e-6], s, 1 / swing)
    np.testing.assert_allclose(rest, s, atol=1e-9)
    with pytest.raises(ValueError, match="scale"):
        _core.remove_nuisance(signal, 0, [100 * 22.2e-6], s, [1.0, 2.0])


@settings(deadline=None, max_examples=3 * settings.default.max_examples // 20)
@given(
    seed=SEEDS,
    rows=st.integers(100, 600),
    frequency=st.floats(0.015, 0.08),
    height=st.floats(0, 50),
    exposure=st.sampled_from([0.0, 1.5, 6.0]),
)
@example(seed=1, rows=347, frequency=0.03125, height=20.0, exposure=0.0)
@example(seed=100, rows=100, frequency=0.019487873812852288, height=0.0, exposure=0.0)  # no wave: chips explain one
def test_a_square_wave_is_removed_as_by_the_reference(seed, rows, frequency, height, exposure):
    random = np.random.default_rng(seed)
    wave = np.mod(frequency * (1 + 0.2 / rows) * np.arange(rows) + random.uniform(), 1) < 0.5
    signal = height * wave + 40 * chip_light(random, rows) + random.normal(0, 1, rows)
    got, want = (module.without_square_wave(signal, frequency, exposure) for module in (_core, reference))
    # Without exposure the wave jumps: rounding decides about rows on an edge, and the search may end at another wave.
    seen, rest, rest_of_reference = (np.sum((one - one.mean()) ** 2) for one in (signal, got, want))
    if exposure:
        assert rest == pytest.approx(rest_of_reference, rel=1e-9)
    else:
        assert abs(rest - rest_of_reference) < 0.1 * seen
    if exposure:
        np.testing.assert_allclose(got, want, atol=1e-9 * max(height, 40))


def test_an_exposed_square_wave_is_removed_to_a_fraction_of_its_ramps():
    wave = integrate_exposure(SquareWave(0.02221, amplitude=1.0), Camera(1.0, 3.0), 1080, start=17.3)
    rest = _core.without_square_wave(45 * wave, 0.0223, 3.0)
    assert np.std(rest) < 0.03 * np.std(45 * wave)
    assert np.std(rest) < 0.3 * np.std(_core.without_square_wave(45 * wave, 0.0223, 0.0))


@settings(deadline=None, max_examples=settings.default.max_examples // 4)
@given(seed=SEEDS, frames=st.integers(1, 4), rows=st.integers(200, 1080), tone=st.floats(0.03, 0.4))
def test_the_strongest_tone_has_the_largest_power(seed, frames, rows, tone):
    """Against the Fourier sums of all frames on a grid of eight steps a line, with a Hann window."""
    random = np.random.default_rng(seed)
    row = np.arange(rows)
    phases = random.uniform(0, 7, (frames, 1))
    signals = 5 * np.cos(2 * np.pi * tone * row + phases) + random.normal(0, 2, (frames, rows))
    frequency, prominence = _core.strongest_tone(signals.ravel(), rows, 0.02, 0.45)
    window = np.sin(np.pi * (row + 0.5) / rows) ** 2
    windowed = window * (signals - signals.mean(axis=1, keepdims=True))

    def power(at):
        return np.sum(np.abs(windowed @ np.exp(-2j * np.pi * np.outer(row, np.atleast_1d(at)))) ** 2, axis=0)

    grid = np.arange(0.02, 0.45, 1 / (8 * rows))
    assert power(frequency)[0] > 0.93 * power(grid).max()  # a step of a quarter line loses up to 7 %
    assert abs(frequency - tone) < 0.5 / rows
    assert prominence > 20
    again = _core.strongest_tone(3 * signals.ravel() - 7, rows, 0.02, 0.45)
    assert again == pytest.approx((frequency, prominence), rel=1e-9)


@settings(deadline=None, max_examples=3 * settings.default.max_examples // 5)
@given(
    seed=SEEDS,
    lit=st.tuples(st.floats(0, 0.6), st.floats(0.3, 1)),
    noise=st.floats(0.01, 4),
    told=st.booleans(),
    margin=st.none() | st.integers(0, 60),
    dark=st.just(()) | st.tuples(st.floats(0, 0.2), st.floats(0, 0.2), st.floats(0.02, 0.1), st.booleans()),
)
def test_lit_rows_are_those_of_the_reference(seed, lit, noise, told, margin, dark):
    random = np.random.default_rng(seed)
    rows = 1080
    first, last = int(lit[0] * rows), int(min(lit[0] + lit[1], 1) * rows)
    within = (np.arange(rows) >= first) & (np.arange(rows) < last)
    signal = 20 + 100 * within * chip_light(random, rows, 5.6, random.uniform(1, 20)) + random.normal(0, noise, rows)
    seen = (0, rows) if margin is None else (max(first - margin, 0), min(last + margin, rows))
    spread = noise if told else np.nan
    assert _core.lit_rows(signal, spread, seen, *dark) == reference.lit_rows(signal, spread, seen, *dark)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_lit_rows_end_where_the_lamp_does(share):
    """Within a run of chips, where the lamp may be dark; a run of dark rows of more than four runs needs no hint."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        first, last = int(540 - 540 * share), int(540 + 540 * share)
        within = (np.arange(1080) >= first) & (np.arange(1080) < last)
        signal = 20 + 100 * within * chip_light(random, 1080, 5.6, 5.0) + random.normal(0, 1, 1080)
        (begin, end), shortest = _core.lit_rows(signal, 1.0, (0, 1080) if share < 0.6 else (first - 20, last + 20))
        assert -1 <= begin - first < 60
        assert -1 <= last - end < 60
        assert 3 <= shortest <= 12
