"""The controller against the rules written down, what its hysteresis costs, brightness and saturation, refusals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import ocisac_fast as of
from ocisac_fast import reference
from ocisac_fast.exposure import (
    ExposureMeasurement,
    ExposureReason,
    ExposureSuggestion,
    LevelTargets,
    MeasuredTone,
    best_noisy_exposure,
)

frequencies = st.floats(50.0, 4000.0)
CAMERA = (20e-6, 10e-3)


class TestBestNoisyExposure:
    @settings(max_examples=2 * settings.default.max_examples // 5)
    @given(
        st.lists(st.tuples(frequencies, st.floats(0.01, 10.0)), min_size=1, max_size=5),
        st.one_of(st.just(math.inf), st.floats(1e-6, 1.0)),
        st.sampled_from([0.0, 22.2e-6]),
    )
    def test_agrees_with_the_reference(self, tones: list[tuple[float, float]], noise: float, step: float) -> None:
        f, w = zip(*tones, strict=True)
        best = best_noisy_exposure(f, w, CAMERA, noise_exposure=noise, step=step)
        found = reference.best_noisy_exposure(f, w, CAMERA, noise_exposure=noise, step=step)
        assert found.objective * (1 - 1e-12) <= best.objective <= found.objective * (1 + 1e-9)


def measurements(seed: int, frames: int) -> list[ExposureMeasurement]:
    """A random drive: tones that drift, jump and vanish, a scene that brightens and darkens and at times saturates."""
    random = np.random.default_rng(seed)
    result, f_s, level = [], 300.0, 0.3
    for _ in range(frames):
        f_s = float(np.clip(f_s * np.exp(random.normal(0, 0.01)), 50, 3000)) if random.random() > 0.05 else 900.0
        level *= float(np.exp(random.normal(0, 0.05)))
        light = MeasuredTone(500.0 + random.normal(), share=2.0, snr=100.0)
        weak = MeasuredTone(700.0, snr=0.5)
        peak = math.nan if random.random() < 0.3 else 2 * level
        motions = [f_s, math.nan] if random.random() > 0.1 else []
        clipped = 0.2 if random.random() < 0.05 else 0.0
        result.append(ExposureMeasurement([light, weak, 1300.0], motions, level=level, peak=peak, saturated=clipped))
    return result


OPTIONS = [
    {},
    {"hysteresis": 0.0, "noise_level": 0.02},
    {"step": 22.2e-6, "gains": (1.0, 16.0), "weights": (0.2, 0.8)},
    {"gains": (0.5, 4.0), "levels": LevelTargets(floor=0.2), "noise_level": 0.2, "hysteresis": 0.05},
]


def weighted_tones(measured: ExposureMeasurement, weights: tuple[float, float]) -> tuple[list[float], list[float]]:
    """All lights together have one weight and all motions the other; what was not measured or is too weak has none."""
    frequencies: list[float] = []
    shares: list[float] = []
    for kind, weight in ((measured.lights, weights[0]), (measured.motions, weights[1])):
        tones = [tone if isinstance(tone, MeasuredTone) else MeasuredTone(tone) for tone in kind]
        seen = [tone for tone in tones if not math.isnan(tone.frequency) and not tone.snr < 1.0]
        frequencies += [tone.frequency for tone in seen]
        shares += [weight * tone.share / sum(other.share for other in seen) for tone in seen]
    return frequencies, shares


def check_choice(
    said: ExposureSuggestion,
    last: ExposureSuggestion | None,
    measured: ExposureMeasurement,
    radiance: float,
    options: dict[str, Any],
) -> None:
    noise = options.get("noise_level", math.inf) / radiance if radiance > 0 else math.inf
    f, w = weighted_tones(measured, options.get("weights", (1.0, 1.0)))
    best = reference.best_noisy_exposure(f, w, said.bounds, noise_exposure=noise, step=options.get("step", 0.0))

    def objective(exposure: float) -> float:
        tones = np.abs(np.sin(np.pi * np.multiply(f, exposure))) @ (np.array(w) / np.pi / f)
        return float(tones / math.sqrt(1.0 + exposure / noise))

    assert said.best_objective == pytest.approx(best.objective, rel=1e-9)
    assert said.objective == pytest.approx(objective(said.exposure), rel=1e-9)
    hysteresis = options.get("hysteresis", 0.01)
    low, high = said.bounds
    stays = last is not None and 0.98 * low <= last.exposure <= 1.02 * high
    if last is not None and stays and objective(last.exposure) * (1 + hysteresis) >= best.objective * (1 + 1e-9):
        assert said.exposure == last.exposure
    elif not (last is not None and said.exposure == last.exposure):
        assert low * (1 - 1e-12) <= said.exposure <= high * (1 + 1e-12)
        assert said.objective == pytest.approx(best.objective, rel=1e-9)
        if options.get("step"):
            assert said.exposure / options["step"] == pytest.approx(round(said.exposure / options["step"]), abs=1e-6)


def check_brightness(
    said: ExposureSuggestion,
    last: ExposureSuggestion | None,
    measured: ExposureMeasurement,
    radiance: float,
    options: dict[str, Any],
    clipped: bool,
) -> None:
    """The bounds hold the brightness that some gain of the camera can keep; the gain aims at a mean of 0.4."""
    gains = options.get("gains", (1.0, 1.0))
    assert CAMERA[0] <= said.bounds[0] <= said.bounds[1] <= CAMERA[1]
    assert gains[0] <= said.gain <= gains[1]
    if last is None:
        assert said.bounds == CAMERA
        return
    product = last.exposure * last.gain
    room = max(1.0, 1.02 * said.exposure / said.bounds[1])  # an exposure that stays may lie 2 % beyond
    darkest = (CAMERA[0] if not options.get("step") else max(CAMERA[0], options["step"])) * gains[0]
    if said.exposure * said.gain > room * darkest * (1 + 1e-9):
        if measured.saturated > 0.01:
            assert said.exposure * said.gain <= room * 0.7 * product * (1 + 1e-9)
        elif measured.peak > 0:
            assert measured.peak / product * said.exposure * said.gain <= room * 0.9 * (1 + 1e-9)
    assert said.level == pytest.approx(radiance * said.exposure * said.gain, rel=1e-9)
    floor = options.get("levels", LevelTargets()).floor
    dark = said.level < floor * 0.98
    limited = said.bounds[1] < CAMERA[1] * (1 - 1e-9) or said.exposure * gains[1] * radiance < floor
    assert not dark or limited
    aim = 0.4 / (radiance * said.exposure)
    held = aim / 1.1 < said.gain == last.gain < aim * 1.1
    if gains[0] < aim < gains[1] and not held and said.gain != pytest.approx(aim, rel=1e-6):
        assert said.gain < aim  # the ceiling counts, or the limit that saturation left
        assert clipped or measured.peak / product * said.exposure * said.gain == pytest.approx(0.9, rel=0.03)


class TestController:
    @pytest.mark.parametrize("options", OPTIONS)
    def test_every_suggestion_obeys_the_rules(self, options: dict[str, float]) -> None:
        """docs/explanation/exposure.md: what is maximised, its bounds, when the last exposure stays, the brightness."""
        controller = of.ExposureController(CAMERA, **options)
        last: ExposureSuggestion | None = None
        clipped = False
        for measured in measurements(1, 60):
            said = controller.update(measured)
            clipped = clipped or measured.saturated > 0.01
            radiance = measured.level / (last.exposure * last.gain) if last else math.nan
            check_choice(said, last, measured, radiance, options)
            check_brightness(said, last, measured, radiance, options, clipped)
            last = said

    def test_does_not_hunt(self) -> None:
        random = np.random.default_rng(3)
        moves = {}
        for hysteresis in (0.0, 0.01):
            controller = of.ExposureController(CAMERA, hysteresis=hysteresis)
            chosen = [
                controller.update(ExposureMeasurement([500.0], [310.0 * (1 + 0.005 * random.normal())], level=0.3))
                for _ in range(100)
            ]
            moves[hysteresis] = len({suggestion.exposure for suggestion in chosen})
        assert moves[0.01] == 1 < 90 < moves[0.0]

    def test_says_why(self) -> None:
        controller = of.ExposureController(CAMERA, noise_level=0.02)
        light = MeasuredTone(500.0, snr=400.0, gain=0.2, gain_std=0.001)
        said = controller.update(ExposureMeasurement([light], [175.0], exposure=2e-4, level=0.05, peak=0.06))
        assert ExposureReason.FIRST in said.reasons
        assert ExposureReason.GAIN_MISMATCH in said.reasons
        parts = ("exposure ", "objective 100.00% of the best", "light 500 Hz: gain", "dB", "a measured gain is not")
        assert [part for part in parts if part not in said.explain] == []
        held = controller.update(ExposureMeasurement([500.0], [175.0], level=said.level))
        assert held.reasons & ExposureReason.HELD
        assert held.exposure == said.exposure

    def test_expected_snr_is_that_of_the_model(self) -> None:
        controller = of.ExposureController((1e-3, 1e-3))
        said = controller.update(ExposureMeasurement([MeasuredTone(300.0, snr=10.0)], exposure=5e-4))
        collected = [t * np.sinc(300.0 * t) for t in (5e-4, 1e-3)]
        assert said.tones[0][3] == pytest.approx(10.0 * (collected[1] / collected[0]) ** 2)

    def test_brightness_alone(self) -> None:
        controller = of.ExposureController((1e-5, 1e-2), gains=(1.0, 4.0))
        dark = controller.update(ExposureMeasurement(exposure=1e-3, gain=1.0, level=1e-4))
        assert dark.reasons & ExposureReason.TOO_DARK
        assert dark.reasons & ExposureReason.NO_TONES
        assert (dark.exposure, dark.gain) == (1e-2, 4.0)
        bright = controller.update(ExposureMeasurement(exposure=1e-2, gain=4.0, level=1.0, peak=1e9))
        assert bright.reasons & ExposureReason.TOO_BRIGHT
        assert (bright.exposure, bright.gain) == (1e-5, 1.0)
