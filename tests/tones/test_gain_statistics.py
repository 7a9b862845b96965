"""The 24 settings of table 2 at random phase: bias and spread against the Cramer-Rao bound."""

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera

ROW_TIME, ROWS, TRIALS, NOISE, SWING = 22.2e-6, 720, 10_000, 2.0, 200.0
SPEED = np.pi * 0.15 * 223 / 60
EXPOSURES = (622e-6, 1202e-6, 2404e-6, 4981e-6)
FREQUENCIES = (200.0, 500.0, 700.0, 100 * SPEED, 200 * SPEED, 500 * SPEED)


def exposed_square_waves(frequency, exposure, phases):
    """Mean over the exposure of 50 % square waves: difference of the antiderivative, in cycles."""

    def bright_cycles(x):
        whole = np.floor(x + 0.5)
        return 0.5 * whole + np.clip(x - whole, -0.25, 0.25)

    end = frequency * ROW_TIME * np.arange(ROWS)[:, None] + phases / (2 * np.pi)
    return SWING * (bright_cycles(end) - bright_cycles(end - frequency * exposure)) / (frequency * exposure)


def cramer_rao_std(frequency, exposure):
    """Bound on the gain of the model mean + all odd harmonics below half the row rate, rms over the phase."""
    orders = np.arange(1, 0.5 / (frequency * ROW_TIME), 2)
    angle = 2 * np.pi * frequency * ROW_TIME * np.outer(np.arange(ROWS), orders)
    design = np.hstack([np.ones((ROWS, 1)), np.cos(angle), np.sin(angle)])
    inverse = np.linalg.inv(design.T @ design)
    pick = [0, 1, 1 + len(orders)]
    covariance = inverse[np.ix_(pick, pick)]
    mean, amplitude = SWING / 2, SWING / 2 * abs(np.sinc(frequency * exposure)) * 4 / np.pi
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    gradient = np.stack([np.full_like(turn, -amplitude / mean), np.cos(turn), np.sin(turn)]) / mean
    variance = np.einsum("ip,ij,jp->p", gradient, covariance, gradient).mean()
    return NOISE * np.sqrt(variance) * np.pi / 4


@pytest.mark.parametrize("exposure", EXPOSURES)
@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_fit_is_unbiased_and_efficient_and_knows_its_error(frequency, exposure):
    random = np.random.default_rng([int(frequency), int(exposure * 1e6)])
    columns = exposed_square_waves(frequency, exposure, random.uniform(-np.pi, np.pi, TRIALS))
    columns += NOISE * random.standard_normal(columns.shape)
    camera = Camera(ROW_TIME, exposure=exposure)
    result = ocisac.tone_gain(columns, camera, frequency, waveform="square", threads=2)
    theory = abs(np.sinc(frequency * exposure))
    spread = result.gain.std()
    assert abs(result.gain.mean() - theory) < 3e-4
    assert spread == pytest.approx(cramer_rao_std(frequency, exposure), rel=0.05)
    assert result.gain_std.mean() == pytest.approx(spread, rel=0.05)


@pytest.mark.parametrize(
    ("frequency", "bias"), [(200 * SPEED, -0.226), (200.0, -0.059), (500.0, 0.0), (500 * SPEED, 0.0)]
)
def test_the_rounded_bin_is_biased_off_the_bin(frequency, bias):
    """Bias of the paper's estimator at T_e = 622 us; m* is nearly whole at 500 and 876 Hz."""
    random = np.random.default_rng(3)
    columns = exposed_square_waves(frequency, 622e-6, np.linspace(-np.pi, np.pi, 2000, endpoint=False))
    columns += NOISE * random.standard_normal(columns.shape)
    result = ocisac.tone_gain(columns, Camera(ROW_TIME, 622e-6), frequency, method="dft", waveform="square")
    assert result.gain.mean() - abs(np.sinc(frequency * 622e-6)) == pytest.approx(bias, abs=2e-3)


@pytest.mark.parametrize("waveform", ["tone", "square"])
@pytest.mark.parametrize(
    ("dtype", "white", "curve"),
    [
        ("uint8", 255, "linear"),
        ("uint8", 255, "srgb"),
        ("uint8", 255, "gamma"),
        ("uint16", 1023, "linear"),
        ("uint16", 4095, "srgb"),
        ("uint16", 65535, "linear"),
        ("float32", 1.0, "linear"),
    ],
)
@pytest.mark.parametrize("efficiency", [1.0, 0.99])
def test_what_cameras_store_is_read_without_bias_and_with_its_error(dtype, white, curve, waveform, efficiency):
    """Noisy light behind a tone curve and rounding to a sample's steps."""
    random = np.random.default_rng(11)
    trials, contrast, noise = 3000, 0.4, 0.01
    angle = 2 * np.pi * 500.0 * ROW_TIME * np.arange(ROWS)[:, None] + random.uniform(-np.pi, np.pi, trials)
    light = 0.4 * (1 + contrast * np.cos(angle)) + noise * random.standard_normal(angle.shape)
    if curve == "srgb":
        light = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    if curve == "gamma":
        light = light ** (1 / 2.2)
    stored = light * white
    pixels = (stored if dtype.startswith("float") else np.rint(stored)).astype(dtype)
    camera = Camera(ROW_TIME, tone_curve=curve, white_level=white)
    result = ocisac.tone_gain(pixels, camera, 500.0, waveform=waveform, efficiency=efficiency)
    theory = contrast if waveform == "tone" else contrast * np.pi / 4
    spread = result.gain.std()
    assert abs(result.gain.mean() - theory) < 4 * spread / np.sqrt(trials) + 2e-6
    assert result.gain_std.mean() == pytest.approx(spread, rel=0.05)
    assert not result.flags.any()
