"""The gain of tones: agreement with the reference, properties, flags and refusals."""

import time

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

import ocisac_fast as ocisac
from ocisac_fast import Camera, Flag, _core, reference
from ocisac_fast.camera.linear_light import stored_values

ROW_TIME = 22.2e-6
FIELDS = ("gain", "gain_std", "phase", "mean", "snr")


def tone_columns(rows, cycles_per_row, columns=3, noise=1.0, seed=0, mean=100.0, phases=None):
    """Tones of random phases, one for each column without a number of them, about `mean` with contrast 0.6."""
    random = np.random.default_rng(seed)
    phase = 2 * np.pi * np.outer(np.arange(rows), np.full(columns, cycles_per_row))
    phase += random.uniform(-np.pi, np.pi, phases or columns)
    return mean * (1 + 0.6 * np.cos(phase)) + noise * random.standard_normal((rows, columns))


def assert_agree(got, want, tolerance, tolerance_of_noise=None, standard_errors=0.0, light=0.0, may_differ=0):
    """light: relative error of the samples' light, which is that of amplitude over mean, however small."""
    with np.errstate(divide="ignore", invalid="ignore"):  # a gain of 0 has any phase
        error = {"gain": want.gain_std, "phase": want.gain_std / want.gain, "mean": want.gain_std * want.mean}
        of_light = {"gain": light, "phase": light / want.gain}
    for name in FIELDS:
        a, b = getattr(got, name), getattr(want, name)
        assert a.shape == b.shape, name
        if name == "phase":
            a = b + np.angle(np.exp(1j * (a - b)))
        scale = np.abs(b[np.isfinite(b)]).max(initial=1e-300)
        allowed = (tolerance_of_noise if tolerance_of_noise and name in ("gain_std", "snr") else tolerance) * scale
        if name in error:
            allowed = allowed + standard_errors * np.nan_to_num(error[name]) + np.nan_to_num(of_light.get(name, 0.0))
        if name == "snr":  # the noise is a difference from the light, which is rounded
            allowed = allowed + np.finfo(float).eps * scale**2
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b), err_msg=name)
        assert not np.any(np.abs(a - b) > allowed), (name, a, b, allowed)
    np.testing.assert_array_equal(got.flags & ~np.uint32(may_differ), want.flags)


@settings(deadline=None, max_examples=3 * settings.default.max_examples // 5)
@given(
    rows=st.sampled_from([1, 2, 3, 4, 5, 13, 97, 720, 1080, 4352]),
    position=st.floats(0.05, 0.95),
    columns=st.integers(1, 5),
    frames=st.integers(0, 2),
    dtype=st.sampled_from(["uint8", "uint16", "float32", "float64"]),
    steps=st.tuples(st.sampled_from([-2, -1, 1, 3]), st.sampled_from([-1, 1, 2])),
    method=st.sampled_from(["fit", "dft"]),
    waveform=st.sampled_from(["tone", "square"]),
    duty=st.sampled_from([0.5, 0.3]),
    pooled=st.booleans(),
    curve=st.sampled_from(["linear", "gamma", "srgb"]),
    exposure=st.sampled_from([None, 0.0, 3.3e-4, 5e-3]),
    seed=st.integers(0, 1000),
)
@example(4, 0.375, 4, 0, "uint8", (-1, 2), "fit", "tone", 0.5, True, "gamma", None, 146)  # 0.03 from float32
def test_agrees_with_the_reference(
    rows, position, columns, frames, dtype, steps, method, waveform, duty, pooled, curve, exposure, seed
):
    # From just above two cycles in the frame to almost half the row rate.
    least = min(2.1 / rows, 0.3)
    cycles = least * (0.48 / least) ** position
    random = np.random.default_rng(seed)
    row_step, column_step = steps
    phases = 1 if pooled else None  # of columns that are not those of one lamp the reference says nothing
    big = tone_columns(
        rows * abs(row_step), cycles / abs(row_step), columns * abs(column_step), seed=seed, phases=phases
    )
    big = np.stack([big * random.uniform(0.5, 1.2) for _ in range(max(frames, 1))]).clip(0, 255)
    floating = dtype.startswith("float")
    pixels = (big / 255 if floating else big).astype(dtype)
    view = pixels[:, ::row_step, ::column_step] if frames else pixels[0, ::row_step, ::column_step]
    camera = Camera(ROW_TIME, exposure=exposure, tone_curve=curve, dark_level=1 / 255 if floating else 1)
    # Harmonics above half the row rate, which a lone square wave is fitted with, are tested by their truth.
    both = waveform == "square" and method == "fit"
    arguments = (camera, np.array([cycles, cycles / 2]) / ROW_TIME if both else cycles / ROW_TIME)
    options = {"method": method, "waveform": waveform, "duty": duty, "pooled": pooled}
    before = pixels.copy()
    got = ocisac.tone_gain(view, *arguments, **options)
    want = reference.tone_gain(view, *arguments, **options)
    # Streamed samples: a residual that is a difference of squares, and, from 256 rows of bytes on, weights of 13 bits
    # or more, which see the noise a little differently. Integers by a curve: light in float32.
    by_table = not floating and curve != "linear"
    streamed = dtype != "float64" and curve == "linear" and not pooled
    rounded = 0 if floating else Flag.QUANTISED  # tested by the bias that it tells of
    if streamed and dtype == "uint8" and rows >= 256:
        assert_agree(got, want, 1e-9, tolerance_of_noise=2e-3, standard_errors=1e-3, may_differ=rounded)
    elif streamed:
        assert_agree(got, want, 1e-8, tolerance_of_noise=1e-5, may_differ=rounded)
    elif by_table:
        assert_agree(got, want, 2e-7, tolerance_of_noise=1e-4, light=2.0**-24)  # rounding of float32
    elif method == "dft":  # its noise is a difference of energies up to a thousand times as large
        assert_agree(got, want, 1e-10, tolerance_of_noise=1e-8)
    else:
        assert_agree(got, want, 1e-11)
    np.testing.assert_array_equal(pixels, before)


def test_agrees_with_the_reference_to_twelve_digits_on_a_frame():
    pixels, frequency = tone_columns(1080, 0.0123, 40), 0.0123 / ROW_TIME
    camera = Camera(ROW_TIME, exposure=3e-4)
    got, want = (of.tone_gain(pixels, camera, frequency) for of in (ocisac, reference))
    assert_agree(got, want, 1e-12)


@pytest.mark.parametrize("rows", [256, 720, 1080, 2048, 2049, 4352])
@pytest.mark.parametrize("noise", [0.1, 1.0, 5.0])
def test_rounded_weights_cost_bytes_a_thousandth_of_a_standard_error(rows, noise):
    pixels = np.rint(tone_columns(rows, 0.0343, 200, noise)).astype(np.uint8)
    rounded, exact = (ocisac.tone_gain(as_type, Camera(1.0), 0.0343) for as_type in (pixels, pixels.astype(float)))
    apart = np.abs(rounded.gain - exact.gain) / exact.gain_std
    assert 1e-7 < apart.max() < 2e-3
    np.testing.assert_allclose(rounded.gain_std, exact.gain_std, rtol=6e-3)


@pytest.mark.parametrize("curve", ["srgb", "gamma"])
@pytest.mark.parametrize(("dtype", "white"), [("uint8", 255), ("uint16", 1023), ("uint16", 65535)])
@pytest.mark.parametrize("level", [0.5, 0.02])
@pytest.mark.parametrize("waveform", ["tone", "square"])
def test_light_in_float32_costs_a_thousandth_of_a_standard_error(curve, dtype, white, level, waveform):
    """Against the fit in float64, which floating-point samples with a curve select; also in the dark."""
    stored = tone_columns(1080, 0.0343, 200, noise=0.5, mean=level * white).clip(0, white)
    pixels = np.rint(stored).astype(dtype)
    camera = Camera(1.0, tone_curve=curve, white_level=white)
    streamed, exact = (
        ocisac.tone_gain(as_type, camera, 0.0343, waveform=waveform) for as_type in (pixels, pixels.astype(float))
    )
    apart = np.abs(streamed.gain - exact.gain) / exact.gain_std
    assert 1e-9 < apart.max() < 1e-3
    np.testing.assert_allclose(streamed.gain_std, exact.gain_std, rtol=1e-3)
    np.testing.assert_array_equal(streamed.flags, exact.flags)


@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-3])
def test_float32_loses_nothing_that_its_rounding_left(noise):
    """Beside the exact fit in float64, noise down to that of rounding."""
    pixels = (tone_columns(1080, 0.0343, 200, 100 * noise) / 100).astype(np.float32)
    streamed, exact = (ocisac.tone_gain(as_type, Camera(1.0), 0.0343) for as_type in (pixels, pixels.astype(float)))
    np.testing.assert_allclose(streamed.gain, exact.gain, rtol=1e-12, atol=1e-12)
    of_rounding = 1e-7 * np.sqrt(2 / 1080)  # in the gain, of noise of a ten-millionth of the light
    np.testing.assert_allclose(streamed.gain_std, exact.gain_std, rtol=1e-3, atol=of_rounding)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("efficiency", [1.0, 0.9])
@pytest.mark.parametrize("row", [0, 500, 1082])
def test_a_sample_that_is_not_finite_is_refused_in_every_row(dtype, value, efficiency, row):
    """Also in the last rows, which sums of eight leave out; large ones whose squares are numbers are not refused."""
    pixels = tone_columns(1083, 0.01, 70).astype(dtype)
    pixels[row, 37] = min(float(np.finfo(dtype).max), 1e99)
    ocisac.tone_gain(pixels, Camera(1.0), 0.01, efficiency=efficiency)
    pixels[row, 37] = value
    with pytest.raises(ValueError, match=f"columns: got {str(value).lower()}"):
        ocisac.tone_gain(pixels, Camera(1.0), 0.01, efficiency=efficiency)


def test_several_tones_are_fitted_together():
    rows, first, second = 720, 0.0111, 0.0163
    n = np.arange(rows)
    column = 100 + 30 * np.cos(2 * np.pi * first * n + 0.4) + 20 * np.cos(2 * np.pi * second * n - 1.1)
    both = ocisac.tone_gain(column, Camera(1.0), [first, second])
    assert both.gain.shape == (2,)
    np.testing.assert_allclose(both.gain, [0.3, 0.2], atol=1e-12)
    np.testing.assert_allclose(both.phase, [0.4, -1.1], atol=1e-11)
    leaked = ocisac.tone_gain(column[:, None], Camera(1.0), first, method="dft")
    assert abs(leaked.gain - 0.3) > 1e-3
    alone = ocisac.tone_gain(column, Camera(1.0), first, method="robust")
    assert alone.gain == pytest.approx(0.3, abs=1e-9)  # the other tone is found in the residual
    want = reference.tone_gain(column, Camera(1.0), [first, second])
    np.testing.assert_allclose(both.gain, want.gain, rtol=1e-12)


@pytest.mark.parametrize("exposure", [0.0, 4e-4, 1.3e-3, 2.6e-3])
@pytest.mark.parametrize("frequency", [700.0, 46000.0])
def test_phase_and_gain_are_those_of_the_light(frequency, exposure):
    """Also above half the row rate, and where sinc is negative."""
    phase, theory = 0.7, np.sinc(frequency * exposure)
    middle = ROW_TIME * np.arange(720) - exposure / 2
    column = 50 * (1 + theory * np.cos(2 * np.pi * frequency * middle + phase))
    result = ocisac.tone_gain(column, Camera(ROW_TIME, exposure=exposure), frequency)
    assert result.gain == pytest.approx(abs(theory), abs=1e-9)
    assert result.phase == pytest.approx(phase, abs=1e-6)
    assert bool(result.flags & Flag.ALIASED) == (frequency > 0.5 / ROW_TIME)


def test_background_is_taken_off():
    column = tone_columns(720, 0.0137, 4, noise=0)
    ambient = np.array([0.0, 10.0, 50.0, 400.0])
    result = ocisac.tone_gain(column + ambient, Camera(1.0), 0.0137, background=ambient)
    np.testing.assert_allclose(result.gain, 0.6, atol=1e-10)
    told_nothing = ocisac.tone_gain(column + ambient, Camera(1.0), 0.0137)
    np.testing.assert_allclose(told_nothing.gain, 0.6 * 100 / (100 + ambient), atol=1e-3)


@given(
    frames=st.integers(1, 5),
    columns=st.sampled_from([1, 63, 257, 640, 1000, 2090, 4200]),
    start=st.integers(0, 70),
    threads=st.sampled_from([2, 3, 8]),
    dtype=st.sampled_from(["uint8", "uint16"]),
)
@settings(deadline=None, max_examples=3 * settings.default.max_examples // 10)
def test_threads_share_frames_of_any_width_wherever_they_begin(frames, columns, start, threads, dtype):
    """They take whole frames and, at the end, parts that begin with a line of the cache: every column once."""
    size = frames * 96 * columns
    random = np.random.default_rng(size)
    pixels = random.integers(0, 256, start + size).astype(dtype)[start:].reshape(frames, 96, columns)
    one, many = (ocisac.tone_gain(pixels, Camera(1.0), 0.11, efficiency=0.9, threads=n) for n in (1, threads))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))
    alone = ocisac.tone_gain(pixels[-1, :, -1], Camera(1.0), 0.11, efficiency=0.9)
    assert one.gain[-1, -1] == alone.gain


@pytest.mark.parametrize("frequency", [500.0, 0.034 / ROW_TIME])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
@pytest.mark.parametrize("efficiency", [0.999999, 0.99, 0.9, 0.5])
def test_efficiency_is_kept_without_bias(frequency, dtype, efficiency):
    """Rows are added first: variance grows by no more than was allowed, and is told."""
    rows, trials = 1083, 3000
    pixels = np.rint(tone_columns(rows, frequency * ROW_TIME, trials, noise=2.0)).astype(dtype)
    camera = Camera(ROW_TIME, 1e-4, dark_level=3)
    full = ocisac.tone_gain(pixels, camera, frequency)
    fast = ocisac.tone_gain(pixels, camera, frequency, efficiency=efficiency)
    spread = fast.gain.std()
    assert (full.gain.std() / spread) ** 2 > efficiency - 0.03
    difference = fast.gain - full.gain
    assert abs(difference.mean()) < 5 * difference.std() / np.sqrt(trials) + 1e-8
    assert fast.gain_std.mean() == pytest.approx(spread, rel=0.06)
    np.testing.assert_allclose(fast.mean, full.mean, atol=2e-2)
    np.testing.assert_allclose(fast.phase, full.phase, atol=2e-2)
    np.testing.assert_array_equal(fast.flags, full.flags)


@pytest.mark.parametrize("target", _core.simd_targets())
def test_rows_are_added_only_where_that_is_faster(target):
    """Not for one tone in bytes with vectors as wide as a line of a cache; for two, and in wider samples, they are."""
    pixels = np.rint(tone_columns(1080, 0.01, 40, noise=2.0)).astype(np.uint8)
    wide = target.startswith("AVX3")

    def rows_are_added(frequency, columns):
        full, fast = (ocisac.tone_gain(columns, Camera(1.0), frequency, efficiency=e).gain for e in (1.0, 0.99))
        return not np.allclose(full, fast, rtol=1e-9, atol=0)

    try:
        _core.force_simd_target(target)
        assert rows_are_added(0.01, pixels) == (not wide)
        assert rows_are_added([0.01, 0.017], pixels)
        assert rows_are_added(0.01, pixels.astype(np.uint16))
    finally:
        _core.force_simd_target("")


def test_where_no_rows_may_be_added_the_streaming_fit_is_the_full_one():
    pixels = tone_columns(720, 0.1, 50)
    full, fast = (ocisac.tone_gain(pixels, Camera(1.0), [0.1, 0.237], efficiency=e) for e in (1.0, 0.999999))
    for name in FIELDS:
        np.testing.assert_allclose(getattr(fast, name), getattr(full, name), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(fast.flags, full.flags)


def test_pooled_columns_without_light_are_those_of_the_least_background():
    frame = np.full((200, 6), 10, np.uint8)
    background = np.array([20.0, 12.0, 1e300, 12.0, 30.0, np.finfo(float).max])
    found = ocisac.tone_gain(frame, Camera(1e-5), 2e3, background=background, pooled=True)
    assert Flag(int(found.flags)) & Flag.NO_LIGHT
    assert found.mean == pytest.approx(-2.0)
    assert reference.tone_gain(frame, Camera(1e-5), 2e3, background=background, pooled=True).mean == pytest.approx(-2.0)


@pytest.mark.parametrize(("rows", "columns"), [(120, 40), (480, 640)])
@pytest.mark.parametrize("method", ["fit", "robust", "dft"])
def test_pooled_columns_whose_phases_cancel_are_flagged_and_a_lamp_over_texture_is_not(rows, columns, method):
    random = np.random.default_rng(rows)
    places, noise = np.arange(rows)[:, None], random.normal(0, 2, (rows, columns))
    texture = np.exp(0.2 * random.standard_normal((rows, columns)) + 0.3 * np.sin(0.1 * np.arange(columns)))
    for advance, square in ((0.7, False), (0.7, True), (0.0, False), (0.0, True)):
        wave = np.sin(2 * np.pi * 4e3 * ROW_TIME * (places + advance * np.arange(columns)))
        light = texture * (70 + 40 * (np.sign(wave) if square else wave))
        frame = np.clip(np.round(light + noise), 0, 255).astype(np.uint8)
        waveform = "square" if square else "tone"
        found = ocisac.tone_gain(frame, Camera(ROW_TIME), 4e3, method=method, waveform=waveform, pooled=True)
        assert bool(Flag(int(found.flags)) & Flag.MODEL_MISFIT) is (advance > 0), (advance, square)


GIVEN = {
    "frequency": 700.0, "method": "fit", "waveform": "tone", "duty": 0.5, "background": 0.0, "efficiency": 1.0,
    "threads": 1, "pooled": False,
}  # fmt: skip


def as_given(columns, **change):
    return _core.tone_gain_as_given(columns, Camera(ROW_TIME)._handle, *(GIVEN | change).values())


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
@pytest.mark.parametrize(
    "change",
    [
        {}, {"frequency": np.float64(700)}, {"frequency": np.array([700.0, 900.0])},
        {"frequency": np.arange(500.0, 900.0, 50.0)[::4]}, {"background": -0.0}, {"pooled": True}, {"threads": 3},
        {"method": "robust"}, {"waveform": "square", "duty": 0.3}, {"efficiency": 0.9},
    ],
)  # fmt: skip
def test_arguments_that_need_no_conversion_give_the_same_bits(change, dtype):
    columns = np.tile(np.round(tone_columns(301, 700 * ROW_TIME, 6)), (2, 1, 1)).astype(dtype)[:, ::2, ::-1]
    converted = change | {"efficiency": np.float32(change.get("efficiency", 1.0))}
    assert as_given(columns, **converted) is None
    want = ocisac.tone_gain(columns, Camera(ROW_TIME), **{"frequency": 700.0} | converted)
    given = as_given(columns, **change | {"efficiency": float(converted["efficiency"])})
    for name, values in zip((*FIELDS, "flags"), given, strict=True):
        np.testing.assert_array_equal(values, getattr(want, name), err_msg=name)


class OfAnotherClass(np.ndarray):
    pass


@pytest.mark.parametrize(
    "columns",
    [
        [[1.0, 2.0]] * 9, np.ma.masked_equal(np.eye(9), 1), np.eye(9).view(OfAnotherClass), np.eye(9, dtype=">f8"),
        np.eye(9, dtype=np.int32), np.eye(9, dtype=bool), np.eye(9, dtype=np.float16), np.eye(9, dtype=complex),
        np.frombuffer(bytes(8 * 81 + 1), np.uint8)[1:].view(np.float64).reshape(9, 9), np.zeros((0, 9)), np.float64(3),
        np.zeros((2, 2, 9, 9)), np.zeros((9, 3), dtype="u1,f4")["f1"], None,
    ],
)  # fmt: skip
def test_arrays_that_the_core_cannot_view_are_not_taken_as_given(columns):
    assert as_given(columns) is None


@pytest.mark.parametrize(
    "change",
    [
        {"frequency": 700}, {"frequency": [700.0]}, {"frequency": np.array(700.0)}, {"frequency": np.float32([700])},
        {"frequency": np.full((1, 1), 700.0)}, {"frequency": np.ma.masked_equal([700.0, 1.0], 1)}, {"method": None},
        {"waveform": b"tone"}, {"duty": 1}, {"background": 3.0}, {"background": 0}, {"background": np.zeros(1)},
        {"efficiency": True}, {"threads": True}, {"threads": 1.0}, {"threads": np.int64(1)}, {"threads": 2**31},
        {"threads": -(2**80)}, {"pooled": 0}, {"pooled": np.True_},
    ],
)  # fmt: skip
def test_arguments_of_other_types_are_not_taken_as_given(change):
    assert as_given(np.eye(9), **change) is None


@pytest.mark.parametrize("pooled", [True, False])
@pytest.mark.parametrize("frequency", [0.7, 5.0, 20.0])
def test_a_mean_beyond_all_samples_is_not_known(pooled, frequency):
    """A part of a cycle, as of a frequency in kHz, tells no mean: 10⁹ DN of bytes."""
    camera = Camera(ROW_TIME, exposure=1e-4)
    light = 20 + 150 * ocisac.integrate_exposure(ocisac.SquareWave(1000.0), camera, 480)[:, np.newaxis] * np.ones(64)
    found = ocisac.tone_gain(np.rint(light).astype(np.uint8), camera, frequency, waveform="square", pooled=pooled)
    assert np.isnan([found.mean, found.gain]).all()
    assert np.all(found.flags & Flag.UNRESOLVABLE)


def test_flags():
    camera = Camera(ROW_TIME, exposure=1e-3)

    def flags(column, frequency, **options):
        return Flag(int(ocisac.tone_gain(column, camera, frequency, **options).flags))

    column = tone_columns(720, 480 * ROW_TIME, 1)[:, 0]
    assert flags(column, 480.0) == Flag(0)
    assert Flag.NEAR_NULL in flags(column, 1000.0)
    assert Flag.WEAK in flags(column, 2222.0)
    assert Flag.FEW_CYCLES in flags(column, 30.0)
    assert Flag.ALIASED in flags(column, 1 / ROW_TIME + 480)
    assert Flag.NO_LIGHT in flags(column, 480.0, background=500)
    assert Flag.OFF_BIN in flags(column, 480.0, method="dft")
    assert Flag.OFF_BIN not in flags(column, 8 / (720 * ROW_TIME), method="dft")
    assert Flag.SATURATED in flags(np.full(720, 255, np.uint8), 480.0)
    assert Flag.HARMONICS_DROPPED in flags(column, 30.0, waveform="square")
    assert Flag.ILL_CONDITIONED in flags(column, 0.01)


@pytest.mark.parametrize("how", [{"method": "fit"}, {"method": "dft"}, {"efficiency": 0.9}])
def test_what_cannot_be_told_is_nan_and_flagged(how):
    column = tone_columns(720, 0.1, 1)[:, 0]
    for cycles in (0.5, 1.0, 2.0):
        result = ocisac.tone_gain(column, Camera(1.0), cycles, **how)
        assert np.isnan(result.gain)
        assert Flag.UNRESOLVABLE in Flag(int(result.flags))
    for rows in (1, 2, 3):
        assert np.isnan(ocisac.tone_gain(column[:rows], Camera(1.0), 0.3, **how).gain)
    steady = ocisac.tone_gain(np.full(100, 77.7), Camera(1.0), 0.1, **how)
    assert steady.gain < 1e-9
    assert Flag.WEAK in Flag(int(steady.flags))
    constant = ocisac.tone_gain(np.zeros(100), Camera(1.0), 0.1, **how)
    assert Flag.NO_LIGHT in Flag(int(constant.flags))


def test_tones_that_coincide_are_nan():
    column = tone_columns(720, 0.1, 1)[:, 0]
    assert np.isnan(ocisac.tone_gain(column, Camera(1.0), [0.1, 0.1]).gain).all()


def test_near_a_null_the_noise_does_not_pose_as_gain():
    """A tone of four standard errors: the plain magnitude reads sqrt(4^2 + 1) of them."""
    rows, trials, noise = 720, 4000, 2.0
    error = noise * np.sqrt(2 / rows)
    random = np.random.default_rng(5)
    column = 100 + 4 * error * np.cos(2 * np.pi * 0.0137 * np.arange(rows))[:, None]
    result = ocisac.tone_gain(column + noise * random.standard_normal((rows, trials)), Camera(1.0), 0.0137)
    bias = result.gain.mean() * 100 / error - 4
    assert abs(bias) < 4 / np.sqrt(trials) < np.sqrt(4**2 + 1) - 4


def test_a_square_wave_without_a_cycle_takes_no_time():
    """Its harmonics up to half the row rate are more than memory holds."""
    columns = np.random.default_rng(0).uniform(50, 100, (60, 2))
    began = time.process_time()
    found = ocisac.tone_gain(columns, Camera(1.0), 1e-12, waveform="square")
    assert time.process_time() - began < 1
    assert np.all(found.flags & Flag.FEW_CYCLES)


@pytest.mark.parametrize(
    ("rows_per_cycle", "amplitude", "noise"),
    [*((rows, 67.5, 0.1) for rows in (4, 5, 6, 8, 10, 12, 8.0001)), (8, 1.5, 0.2), (8, 3.0, 0.2)],
)
def test_rounding_of_phases_that_come_again_is_flagged(rows_per_cycle, amplitude, noise):
    """Coherent sampling: the same few levels are rounded again and again."""
    random = np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(1080)[:, None] / rows_per_cycle + random.uniform(0, 2 * np.pi, 200)
    stored = 100 + amplitude * np.cos(angle) + noise * random.standard_normal(angle.shape)
    found = ocisac.tone_gain(np.rint(stored).astype(np.uint8), Camera(1.0), 1 / rows_per_cycle)
    quantised = (found.flags & Flag.QUANTISED) != 0
    wrong = np.abs(found.gain - amplitude / 100) > 3 * found.gain_std
    assert wrong.sum() > 50
    assert quantised[wrong].mean() > 0.98


@pytest.mark.parametrize("waveform", ["square", "tone"])
@pytest.mark.parametrize("pooled", [True, False])
@pytest.mark.parametrize("noise", [0.0, 0.2, 0.3, 0.6])
def test_rounding_of_dim_and_quiet_lamps_is_flagged(waveform, pooled, noise):
    """Swings are 10 to 30 steps: plateaus and crests stay on one code in all columns."""
    errors, flagged = [], []
    for seed in range(60):
        random = np.random.default_rng(seed)
        frequency, cycles = np.exp(random.uniform(np.log(4 / 1080), np.log(0.1))), random.choice([0.3, 0.5, 0.7])
        phase, camera = random.uniform(0, 6), Camera(1.0, exposure=cycles / frequency, dark_level=10)
        light = (ocisac.SquareWave if waveform == "square" else ocisac.Tone)(frequency, phase=phase)
        rows = 10 + random.choice([10, 20, 30]) * ocisac.integrate_exposure(light, camera, 1080)
        columns = rows[:, None] + noise * random.standard_normal((1080, 48))
        pixels = np.rint(columns if pooled else columns[:, :1]).astype(np.uint8)
        found = ocisac.tone_gain(pixels, camera, frequency, waveform=waveform, pooled=pooled)
        errors.append((found.gain.item() - np.abs(np.sinc(cycles))) / found.gain_std.item())
        flagged.append((found.flags.item() & Flag.QUANTISED) != 0)
    beyond, flagged = np.abs(errors) > 6, np.array(flagged)
    assert flagged[beyond].all()
    assert beyond.any() or not pooled or noise == 0.6
    assert not flagged.any() or noise < 0.6


def errors_of_rounded_light(curve, noise, exposures=(0.3, 1.9), dark=0.0, pooled=False):
    """Errors in standard errors, and flags, of square waves of 25 to 89 DN in 16 columns of noise in DN of light."""
    errors, flags = [], []
    for seed in range(30):
        random = np.random.default_rng(seed)
        frequency, cycles = np.exp(random.uniform(np.log(3 / 720), np.log(0.2))), random.uniform(*exposures)
        camera = Camera(1.0, cycles / frequency, tone_curve=curve, dark_level=dark, white_level=255.0)
        wave = ocisac.integrate_exposure(ocisac.SquareWave(frequency, phase=random.uniform(0, 6)), camera, 720)
        light = wave[:, None] * random.uniform(25, 89, 16) + noise * random.standard_normal((720, 16))
        pixels = stored_values(np.maximum(light, 0), camera, np.uint8)
        found = ocisac.tone_gain(pixels, camera, frequency, waveform="square", pooled=pooled)
        errors.append((found.gain - abs(np.sinc(cycles))) / found.gain_std)
        flags.append(found.flags)
    return np.array(errors).ravel(), np.array(flags).ravel()


@pytest.mark.parametrize("pooled", [True, False])
@pytest.mark.parametrize("curve", ["linear", "gamma", "srgb"])
def test_rounding_of_any_tone_curve_is_flagged(curve, pooled):
    """Steps are those of the light that rows see: of sRGB 0.08 DN in black, 2.3 in white."""
    errors, flags = errors_of_rounded_light(curve, 0.15, pooled=pooled)
    assert np.sqrt(np.mean(errors[flags == Flag.QUANTISED] ** 2)) > 2
    assert not (np.abs(errors[flags == 0]) > 5).any()
    assert not (errors_of_rounded_light(curve, 1.5, pooled=pooled)[1] & Flag.QUANTISED).any()


@pytest.mark.parametrize(("dark", "rounded"), [(15.0, False), (15.3, True)])
def test_rows_without_the_lamp_are_rounded_as_the_dark_level_is(dark, rounded):
    """Their error is in amplitude and mean. That of the lamp's level is in both alike, and leaves the gain."""
    errors, flags = errors_of_rounded_light("linear", 0.12, exposures=(0.05, 0.1), dark=dark)
    quantised = (flags & Flag.QUANTISED) != 0
    assert (quantised.mean() > 0.9) if rounded else (quantised.mean() < 0.5)
    assert not (np.abs(errors[flags == 0]) > 5).any()


@pytest.mark.parametrize("rows_per_cycle", [8, 8.05, 7.3, 64])
def test_noise_of_half_a_step_is_not_flagged_as_rounding(rows_per_cycle):
    random = np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(1080)[:, None] / rows_per_cycle + random.uniform(0, 2 * np.pi, 200)
    stored = 100 + 67.5 * np.cos(angle) + 0.6 * random.standard_normal(angle.shape)
    assert not ocisac.tone_gain(np.rint(stored).astype(np.uint8), Camera(1.0), 1 / rows_per_cycle).flags.any()


@pytest.mark.parametrize(("waveform", "most"), [("tone", 2.0), ("square", np.pi / 2)])
@pytest.mark.parametrize("over", [0.9, 1.1])
def test_more_than_any_light_shows_is_flagged_without_an_exposure(waveform, most, over):
    """The fundamental of light, which is not negative, is at most twice its mean; more is a wrong background."""
    rows = (
        20
        + 60 * np.cos(2 * np.pi * 0.021 * np.arange(1000))[:, None]
        + np.random.default_rng(1).normal(0, 1, (1000, 8))
    )
    mean = 60 / (most * over) * (1 if waveform == "tone" else np.pi / 4)
    found = ocisac.tone_gain(rows + 100, Camera(1.0), 0.021, waveform=waveform, background=120 - mean)
    assert np.all((found.flags & Flag.MODEL_MISFIT > 0) == (over > 1))
