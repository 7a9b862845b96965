"""Gains of a tone that varies along the column: agreement with the reference, exactness, the flag, refusals."""

import json

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

import ocisac_fast as ocisac
from ocisac_fast import Camera, Flag, _core, reference

ROUNDINGS = 16 * np.finfo(float).eps  # of the frequency
OTHERS = 30  # times as much by the roundings of the solver and of each phase
FIELDS = ("gain", "gain_std", "mean", "bias", "bias_std")


def columns_of(rows, cycles, columns=200, slope=0.0, bend=0.0, drift=0.0, gain=0.5, noise=2.0, seed=0):
    """Light of mean 100 that varies along the rows, and a tone of random phase and `gain` in it."""
    random = np.random.default_rng(seed)
    u = (np.arange(rows) - (rows - 1) / 2)[:, None] / rows
    turns = cycles * u + drift / 2 * u**2 + random.random(columns)
    light = 100 * (1 + slope * u + bend * (u**2 - 1 / 12)) * (1 + gain * np.cos(2 * np.pi * turns))
    return light + noise * random.standard_normal(light.shape)


def assert_agree(got, want, tolerance=1e-10, standard_errors=0.0, nearby=None):
    """standard_errors: by which the steady gain, and with it the bias, may differ.

    nearby: answers for a frequency that is some roundings off. A model close to dependent amplifies the rounding of its
    phases; so much may differ.
    """
    for name in FIELDS:
        a, b = getattr(got, name), getattr(want, name)
        assert a.shape == b.shape
        scale = 1.0 if name.startswith("bias") else np.abs(b[np.isfinite(b)]).max(initial=1e-300)
        allowed = tolerance * scale + (standard_errors * np.nan_to_num(want.gain_std) if name == "bias" else 0.0)
        if nearby is not None:
            allowed = allowed + OTHERS * np.nan_to_num(np.abs(getattr(nearby, name) - b)).max(initial=0.0)
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b), err_msg=name)
        assert np.all(np.isnan(a) | (np.abs(a - b) <= allowed)), (name, a, b)
    np.testing.assert_array_equal(got.flags & ~np.uint32(Flag.QUANTISED), want.flags)


@settings(deadline=None, max_examples=2 * settings.default.max_examples // 5)
@given(
    rows=st.sampled_from([1, 2, 3, 10, 41, 97, 720, 1080]),
    position=st.floats(0.0, 1.0),
    shape=st.sampled_from([(), (3,), (2, 2)]),
    degree=st.integers(0, 4),
    dtype=st.sampled_from(["uint8", "uint16", "float32", "float64"]),
    step=st.sampled_from([-2, -1, 1, 3]),
    waveform=st.sampled_from(["tone", "square"]),
    duty=st.sampled_from([0.5, 0.3]),
    curve=st.sampled_from(["linear", "gamma"]),
    seed=st.integers(0, 1000),
)
@example(97, 0.0, (), 4, "float32", -2, "square", 0.3, "linear", 1)
def test_agrees_with_the_reference(rows, position, shape, degree, dtype, step, waveform, duty, curve, seed):
    least = min(4.1 / rows, 0.3)
    cycles = least * (0.45 / least) ** position
    count = int(np.prod(shape, dtype=int))
    big = columns_of(rows * abs(step), cycles * rows, count, 0.3, seed=seed).clip(1, 255)
    big = np.moveaxis(big.reshape(len(big), *shape), 0, -2) if len(shape) == 2 else big.reshape(len(big), *shape)
    pixels = (big / 255 if dtype.startswith("float") else big).astype(dtype)
    view = pixels[:, ::step] if len(shape) == 2 else pixels[::step]
    camera = Camera(1.0, tone_curve=curve)
    frequency = min(cycles * rows / len(range(rows)), 0.47)
    wave = {"waveform": waveform, "duty": duty}
    folded = _core.folded_harmonics(len(range(rows)), frequency, duty, frequency) if waveform == "square" else ((), 0.0)
    got = ocisac.varying_tone_gain(view, camera, frequency, degree=degree, **wave)
    want, nearby = (
        reference.varying_tone_gain(
            view, camera, f, degree=degree, steady=ocisac.tone_gain(view, camera, f, **wave), folded=folded, **wave
        )
        for f in (frequency, frequency * (1 + ROUNDINGS))
    )
    assert got.gain.shape == shape
    # As the steady fit of integers does, whose table of a tone curve is in float32.
    of_integers = 1e-7 if curve == "gamma" else 1e-8
    tolerance = 1e-10 if dtype.startswith("float") else of_integers
    assert_agree(got, want, tolerance, 1e-3 if dtype == "uint8" else 0.0, nearby)


@pytest.mark.parametrize("slope", [0.0, 0.7, 1.9])
@pytest.mark.parametrize("bend", [0.0, 1.5])
def test_polynomial_light_and_tone_are_exact(slope, bend):
    column = columns_of(720, 5.3, 20, slope, bend, noise=0)
    found = ocisac.varying_tone_gain(column, Camera(1.0), 5.3 / 720)
    np.testing.assert_allclose(found.gain, 0.5, atol=1e-10)
    np.testing.assert_allclose(found.gain_std, 0, atol=1e-10)


def test_a_gradient_of_the_background_alone_is_exact_too():
    u = np.linspace(-1, 1, 720)[:, None]
    column = columns_of(720, 5.3, 20, noise=0) + 80 + 60 * u
    found = ocisac.varying_tone_gain(column, Camera(1.0), 5.3 / 720, background=80)
    np.testing.assert_allclose(found.gain, 0.5, atol=1e-10)


@pytest.mark.parametrize(("cycles", "cost"), [(2.3, 2.0), (3.3, 1.15), (40.3, 1.02)])
@pytest.mark.parametrize("degree", [0, 2])
def test_standard_errors_are_those_of_many_columns(cycles, cost, degree):
    column = columns_of(720, cycles, 4000)
    found = ocisac.varying_tone_gain(column, Camera(1.0), cycles / 720, degree=degree)
    spread = np.sqrt(np.mean((found.gain - 0.5) ** 2))
    assert np.sqrt(np.mean(found.gain_std**2)) == pytest.approx(spread, rel=0.05)
    assert np.abs(found.gain.mean() - 0.5) < 4 * spread / np.sqrt(4000)
    steady = ocisac.tone_gain(column, Camera(1.0), cycles / 720)
    assert spread < 1.05 * (cost if degree else 1.0) * steady.gain_std.mean()


@pytest.mark.parametrize("cycles", [3.3, 12.3, 60.3])
def test_where_nothing_varies_nothing_is_flagged(cycles):
    column = columns_of(720, cycles, 5000)
    found = ocisac.varying_tone_gain(column, Camera(1.0), cycles / 720)
    assert np.count_nonzero(found.flags) <= 2
    np.testing.assert_allclose(np.sqrt(np.mean((found.bias / found.bias_std) ** 2)), 1.0, atol=0.1)


@pytest.mark.parametrize(
    ("name", "about"),
    [
        ("gradient", {"cycles": 3.3, "slope": 0.6}),
        ("bend", {"cycles": 3.3, "bend": 1.5}),
        ("drift", {"cycles": 12.3, "drift": 1.5}),
    ],
)
def test_what_varies_is_flagged_where_the_steady_fit_errs(name, about):
    column, frequency = columns_of(720, **about), about["cycles"] / 720
    steady = ocisac.tone_gain(column, Camera(1.0), frequency)
    error = np.abs(steady.gain - 0.5)
    wrong = error > 2 * steady.gain_std
    assert wrong.any()
    assert not (steady.flags & Flag.MODEL_MISFIT).any()  # it cannot see it
    found = ocisac.varying_tone_gain(column, Camera(1.0), frequency)
    assert (found.flags[wrong] & Flag.MODEL_MISFIT).all()
    np.testing.assert_allclose(found.bias, steady.gain - found.gain, atol=1e-12)
    assert np.sqrt(np.mean((found.gain - 0.5) ** 2)) < 0.2 * np.sqrt(np.mean(error**2))


def test_a_wrong_frequency_is_flagged():
    column = columns_of(720, 12.3)
    found = ocisac.varying_tone_gain(column, Camera(1.0), 12.6 / 720)
    assert (found.flags & Flag.MODEL_MISFIT).all()
    np.testing.assert_allclose(found.gain, 0.5, atol=0.01)


@pytest.mark.parametrize("noise", [0.5, 2.0])
@pytest.mark.parametrize("about", [{"drift": 12.0}, {"drift": 24.0}, {"off": 1.5}, {"off": 2.5}, {"off": 5.5}])
def test_a_tone_out_of_step_with_all_polynomials_is_flagged(about, noise):
    """There this gain and that of tone_gain are wrong alike."""
    off = about.get("off", 0.0)
    for seed in range(10):
        column = columns_of(720, 80 + 5.37 * seed, 16, drift=about.get("drift", 0.0), noise=noise, seed=seed)
        found = ocisac.varying_tone_gain(column, Camera(1.0), (80 + 5.37 * seed + off) / 720)
        wrong = np.abs(found.gain - 0.5) > 5 * found.gain_std
        assert wrong.mean() > 0.5
        assert (found.flags[wrong] & Flag.MODEL_MISFIT).mean() > 0.9


def test_light_that_no_polynomial_fits_is_no_tone_out_of_step():
    camera, flagged = Camera(1.0), []
    along = np.linspace(-1, 1, 720)[:, None]
    for seed in range(20):
        lamp = np.exp(-(((along - np.random.default_rng(seed).uniform(-0.3, 0.3)) / 0.6) ** 2))
        column = lamp * columns_of(720, 40.3 + seed, 16, noise=0.0, seed=seed)
        column += np.random.default_rng(seed).standard_normal(column.shape)
        found = ocisac.varying_tone_gain(column, camera, (40.3 + seed) / 720)
        assert (np.abs(found.gain - 0.5) < 5 * found.gain_std).all()
        flagged.append((found.flags & Flag.MODEL_MISFIT != 0).mean())
    assert np.mean(flagged) < 0.01


def test_what_cannot_be_told_is_nan_and_flagged():
    camera = Camera(1.0)
    few_rows = ocisac.varying_tone_gain(columns_of(9, 3.0, 3), camera, 1 / 3)
    assert np.isnan(few_rows.gain).all()
    assert (few_rows.flags & Flag.UNRESOLVABLE).all()
    for frequency in (0.5, 1.0):
        at_half = ocisac.varying_tone_gain(columns_of(720, 12.3, 2), camera, frequency)
        assert np.isnan(at_half.gain).all()
        assert (at_half.flags & Flag.UNRESOLVABLE).all()
    dark = ocisac.varying_tone_gain(np.zeros((100, 2), np.uint8), camera, 0.1)
    assert np.isnan(dark.gain).all()
    assert (dark.flags & Flag.NO_LIGHT).all()
    steady = ocisac.varying_tone_gain(np.full((100, 2), 50.0), camera, 0.1)
    assert (steady.flags == Flag.WEAK).all()
    assert (ocisac.varying_tone_gain(columns_of(720, 1.5), camera, 1.5 / 720).flags & Flag.FEW_CYCLES).all()


@pytest.mark.parametrize(
    ("phases", "slope", "flagged", "doubt"),
    [(1, 0.0, False, ""), (8, 0.0, True, "columns show the tone at different phases"), (8, 0.8, True, "0 dB below")],
)
def test_the_command_looks_for_it(tmp_path, run, phases, slope, flagged, doubt):
    file = tmp_path / "columns.npy"
    columns = columns_of(720, 3.3, phases, slope, noise=1.0)
    columns = np.repeat(columns, 8 // phases, axis=1) + np.random.default_rng(1).standard_normal((720, 8))
    np.save(file, columns.astype(np.float32))
    where = ("--row-time", 1, "--region", "0,0,8,720")
    code, out, err = run("gain", file, "--frequency", 3.3 / 720, *where, "--json")
    assert (code, "model_misfit" in json.loads(*out)["flags"]) == (0, flagged)
    assert doubt in " ".join(err)


@pytest.mark.parametrize("cycles", [0.123, 0.2, 0.26, 0.3405])
def test_harmonics_above_half_the_row_rate_are_no_misfit(cycles):
    """They are fitted, or a part of the standard error where they fall onto the mean or the fundamental."""
    flagged = []
    for seed in range(12):
        random = np.random.default_rng([seed, 6])
        camera = Camera(2e-4, exposure=0.1 * 2e-4 / cycles)
        frequency = cycles / camera.row_time
        wave = ocisac.SquareWave(frequency, phase=random.uniform(0, 6))
        light = 100 * ocisac.integrate_exposure(wave, camera, 200)[:, None] + random.normal(0, 0.5, (200, 8))
        found = ocisac.varying_tone_gain(light.astype(np.float32), camera, frequency, waveform="square")
        error = np.abs(found.gain - np.sinc(frequency * camera.exposure)) / found.gain_std
        assert (error < 5).all()
        flagged.append((found.flags & Flag.MODEL_MISFIT != 0).mean())
    assert np.mean(flagged) < 0.05
