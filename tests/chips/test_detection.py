"""Detectors: agreement with whole matrices, with the truth, and what they refuse."""

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

import ocisac_fast.chips as ocisac
from ocisac_fast import Camera, reference
from ocisac_fast.chips import ChannelEstimate, ClockErrors, expose_chips

CAMERA = Camera(row_time=20e-6)


def make_channel(rows_per_chip, exposure_rows, phase=0.7, noise=1.0, dark=(20.0, 3.0), swing=(100.0, -10.0)):
    errors = ClockErrors(0, np.zeros((3, 3)))
    return ChannelEstimate(
        rows_per_chip, phase, exposure_rows, errors, np.array(dark), np.array(swing), noise, (0, 1), True
    )


def make_columns(channel, shape, seed, noise=None):
    """Columns (frames, rows, columns) of random chips through the channel, and the chips (frames, chips, columns)."""
    random = np.random.default_rng(seed)
    frames, rows, columns = shape
    half = channel.exposure_rows / 2
    first, last = (int(np.floor((row - channel.phase) / channel.rows_per_chip)) for row in (-half, rows - 1 + half))
    chips = random.integers(0, 2, (frames, last - first + 1, columns))
    dark, bright = channel.levels(rows)
    out = np.empty(shape)
    for frame in range(frames):
        for column in range(columns):
            light = expose_chips(chips[frame, :, column], rows, channel.clock, first=first)
            out[frame, :, column] = dark + (bright - dark) * light
    out += (channel.noise if noise is None else noise) * random.standard_normal(shape)
    return out, chips, first


@settings(max_examples=settings.default.max_examples // 2)
@given(
    seed=st.integers(0, 2**32),
    rows=st.sampled_from([1, 2, 37, 61]),
    shape=st.sampled_from([(1,), (1, 3), (2, 2)]),
    dtype=st.sampled_from(["uint8", "uint16", "float32", "float64", "int32"]),
    step=st.sampled_from([-2, -1, 1, 3]),
    method=st.sampled_from(["slicer", "inverse", "wiener", "dfe"]),
    rows_per_chip=st.floats(0.9, 7),
    length=st.floats(0, 9),
    phase=st.floats(-20, 20),
)
@example(0, 1, (1,), "uint8", -2, "inverse", 1.0, 1.0, 0.0)
def test_detectors_agree_with_whole_matrices(seed, rows, shape, dtype, step, method, rows_per_chip, length, phase):
    channel = make_channel(rows_per_chip, length * rows_per_chip, phase, noise=2.0)
    columns = make_columns(channel, (2, abs(step) * rows, 3), seed)[0].clip(0, 255).astype(dtype)[:, ::step]
    if len(shape) == 1:
        columns = columns[0, :, 0] if shape == (1,) else columns
    elif shape == (1, 3):
        columns = columns[0]
    got, want = (of.detect_chips(columns, CAMERA, channel, method=method) for of in (ocisac, reference))
    assert got.llr.shape == want.llr.shape
    assert (got.first, got.method) == (want.first, method)
    # Rounding: the normal equations' condition times that of a row's place. Of one or two rows, and more chips, it is
    # that of their ridge.
    scale = max(np.abs(want.llr).max(), 1e-6)
    np.testing.assert_allclose(got.llr, want.llr, rtol=0, atol=(1e-8 if rows > 2 else 1e-6) * scale)


@settings(max_examples=settings.default.max_examples // 5)
@given(
    seed=st.integers(0, 2**32),
    rows_per_chip=st.floats(2, 7),
    length=st.floats(0.3, 6),
    phase=st.floats(-20, 20),
    method=st.sampled_from(["reduced", "mlse", "auto"]),
)
def test_sequences_are_those_of_the_plain_search(seed, rows_per_chip, length, phase, method):
    channel = make_channel(rows_per_chip, length * rows_per_chip, phase, noise=2.0)
    columns = make_columns(channel, (1, 130, 1), seed)[0][0, :, 0]
    got = ocisac.detect_chips(columns, CAMERA, channel, method=method)
    want = reference.detect_chips(columns, CAMERA, channel, "mlse")
    edge = int(np.ceil(length)) + 1
    sure = np.abs(got.llr) > (3 if method == "auto" else 1e-3)  # `auto`: the slicer may differ where it is in doubt
    np.testing.assert_array_equal((got.bits == want.bits)[edge:-edge][sure[edge:-edge]], True)


def test_the_expected_share_of_wrong_chips_is_what_is_counted():
    channel = make_channel(2.1, 2.1 * 6.3, noise=5.0, dark=(20.0,), swing=(100.0,))
    columns, chips, _ = make_columns(channel, (1, 1080, 30), 4)
    found = ocisac.detect_chips(columns[0], CAMERA, channel)
    wrong = np.mean(found.bits != chips[0])
    assert 0.005 < wrong < 0.1
    assert found.error_rate == pytest.approx(wrong, rel=0.3)


@pytest.mark.parametrize(
    ("rows_per_chip", "length", "noise"), [(4.0, 0.5, 0.3), (1.0, 1.0, 0.2), (3.0, 2.0, 0.1), (2.0, 5.5, 0.04)]
)
def test_error_rates_agree_with_the_characteristic_function(rows_per_chip, length, noise):
    got, want = (of.detector_error_rates(rows_per_chip, length * rows_per_chip, noise) for of in (ocisac, reference))
    for name in ("slicer", "inverse"):
        assert getattr(got, name) == pytest.approx(getattr(want, name), rel=1e-6, abs=1e-12)
    for name in ("wiener", "dfe", "mlse"):  # several chips, one in the middle
        assert getattr(got, name) == pytest.approx(getattr(want, name), rel=0.05, abs=1e-12)


def test_an_exposure_of_the_most_chips_is_not_refused_by_rounding():
    row_time, chip_rate = 22.2e-6, 3007.0
    channel = make_channel(1 / (chip_rate * row_time), 24 / chip_rate / row_time)
    assert channel.exposure_rows > 24 * channel.rows_per_chip
    chips = ocisac.detect_chips(np.ones(1080), CAMERA, channel, method="reduced")
    assert chips.llr.shape[0] > 0
