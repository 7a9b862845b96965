"""Panels of exposure choice, exposure integration and equalisers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import reference
from ocisac_fast.camera.camera import Camera
from ocisac_fast.exposure.choice import best_exposure, exposure_objective
from ocisac_fast.light.response import exposure_response
from ocisac_fast.light.waveforms import Chips, SquareWave, Tone, Waveform, integrate_exposure, sample_waveform
from ocisac_fast.tones.equalization import equalize
from studies.chart.measuring import Point, in_turn, pool_of_frames, read_in_turn, root_mean_square
from studies.chart.panels import Effort, Progress, panel

Float64s = npt.NDArray[np.float64]

_ROW_TIME = 22.2e-6
_ROWS = 1080
_SEARCH_POINTS = (11, 101, 1001, 10001)
_OVERSAMPLING = (4, 16, 64, 256)


def _nothing(_: Any) -> None:
    pass


def _seconds(call: Callable[[], object], seconds: float) -> float:
    return in_turn(lambda _: call(), _nothing, [None], seconds, (3, 2000)).seconds


# Exposure choice


def _numpy_search(fast: Float64s, slow: Float64s, points: int) -> Float64s:
    """The paper's search: Y at equally spaced exposures up to 1/f_min, for each pair of frequencies."""
    best = np.empty(fast.size)
    for k, (high, low) in enumerate(zip(fast, slow, strict=True)):
        exposures = np.linspace(0.0, 1.0 / low, points)
        objective = np.abs(np.sin(np.pi * high * exposures)) / high + np.abs(np.sin(np.pi * low * exposures)) / low
        best[k] = exposures[np.argmax(objective)]
    return best


@panel(
    "exposure-choice",
    "Choice of the exposure time",
    "time per choice / µs",
    "mean shortfall of the objective",
    steps=2 * len(_SEARCH_POINTS) + 3,
)
def measure_exposure_choice(effort: Effort, progress: Progress) -> list[Point]:
    """The paper's 100 ratios of frequencies; loss 1 - Y/max Y, the maximum over all methods."""
    slow = np.full(effort.problems, 100.0)
    fast = slow / np.linspace(0.01, 1.0, effort.problems)
    calls: list[tuple[str, str, str, Callable[[], Any]]] = []
    for points in _SEARCH_POINTS:
        label = f"{points}"
        calls.append((f"search, NumPy, {points} points", "search, NumPy", label, _search_of(fast, slow, points)))
        library = _choice_of(fast, slow, "search", points)
        calls.append((f"search, C++, {points} points", "search, C++", label, library))
    for method in ("closed-form", "rounded", "exact"):
        calls.append((method, method, method, _choice_of(fast, slow, method)))
    objectives, seconds = [], []
    for name, _, _, call in calls:
        objectives.append(np.asarray(exposure_objective(call(), fast, slow)))
        seconds.append(_seconds(call, effort.seconds) / effort.problems)
        progress(name)
    best = np.max(objectives, axis=0)
    return [
        Point("exposure-choice", name, family, family, label, "float64", took * 1e6, shortfall, took)
        for (name, family, label, _), objective, took in zip(calls, objectives, seconds, strict=True)
        for shortfall in [float(np.mean(1.0 - objective / best))]
    ]


def _search_of(fast: Float64s, slow: Float64s, points: int) -> Callable[[], Float64s]:
    return lambda: _numpy_search(fast, slow, points)


def _choice_of(fast: Float64s, slow: Float64s, method: Any, points: int = 10001) -> Callable[[], Any]:
    return lambda: best_exposure(fast, slow, method=method, points=points).exposure


# Exposure integration

_LIGHTS: dict[str, Waveform] = {
    "tone": Tone(500.0, phase=0.3),
    "square wave": SquareWave(500.0, phase=0.3),
    "chips": Chips(np.random.default_rng(2).integers(0, 2, 255), chip_rate=8e3, repeat=True),
}


def oversampled(waveform: Waveform, camera: Camera, rows: int, times: int) -> Float64s:
    """Mean of the light at the middles of ``times`` equal parts of each exposure."""
    exposure = camera.exposure or 0.0
    ends = np.arange(rows) * camera.row_period
    parts = (np.arange(times) + 0.5) / times * exposure
    return np.asarray(sample_waveform(waveform, ends[:, None] - parts).mean(axis=1))


@panel(
    "integration",
    "Exposure integration (1080 rows)",
    "time / µs",
    "RMS error / amplitude",
    steps=len(_LIGHTS) * (len(_OVERSAMPLING) + 1),
)
def measure_integration(effort: Effort, progress: Progress) -> list[Point]:
    """Measure oversampling and the antiderivative; both read the light from C++."""
    camera = Camera(_ROW_TIME, 1202e-6)
    points = []
    for name, waveform in _LIGHTS.items():
        truth = reference.integrate_exposure(waveform, camera, _ROWS)
        calls = [(f"{k}", f"{name}, oversampled {k}", _oversampled_of(waveform, camera, k)) for k in _OVERSAMPLING]
        calls.append(("exact", f"{name}, exact", _integral_of(waveform, camera)))
        for label, method, call in calls:
            error = root_mean_square(call() - truth)
            took = _seconds(call, effort.seconds)
            points.append(Point("integration", method, name, name, label, "float64", took * 1e6, error, took, name))
            progress(method)
    return points


def _oversampled_of(waveform: Waveform, camera: Camera, times: int) -> Callable[[], Float64s]:
    return lambda: oversampled(waveform, camera, _ROWS, times)


def _integral_of(waveform: Waveform, camera: Camera) -> Callable[[], Float64s]:
    return lambda: integrate_exposure(waveform, camera, _ROWS)


# Equalisers


def circular_inverse(columns: npt.NDArray[Any], camera: Camera, max_boost: float = 10.0) -> Float64s:
    """Division of the periodic DFT by H, with limited boost."""
    rows = columns.shape[0]
    response = exposure_response(np.fft.rfftfreq(rows, camera.row_period), camera.exposure or 0.0)
    restoring = response.conj() / np.maximum(np.abs(response) ** 2, max_boost**-2)
    return np.fft.irfft(np.fft.rfft(columns, axis=0) * restoring[:, None], rows, axis=0)


_CHIP_LIGHT = Chips(np.random.default_rng(3).integers(0, 2, 400), chip_rate=1.0 / (12 * _ROW_TIME), repeat=True)
_TONE_LIGHT = sum(
    (Tone(f, amplitude=0.25, phase=phase) for f, phase in ((310.0, 1.0), (730.0, 2.0), (1490.0, 3.0))),
    Tone(95.0, amplitude=0.25),
)
_EQUALIZED = {"three tones and a swell": _TONE_LIGHT, "chips of 12 rows": _CHIP_LIGHT}
_EQUALIZERS = ("none", "circular inverse", "inverse", "wiener")


@panel(
    "equalisers",
    "Equalisers (exposure 7.3 rows)",
    "time per frame / time of reading it",
    "RMS error / swing",
    steps=len(_EQUALIZED) * len(_EQUALIZERS),
)
def measure_equalizers(effort: Effort, progress: Progress) -> list[Point]:
    """Light at the end of each row's exposure, swing 200 DN, noise 2 DN, bytes; over all rows including the ends."""
    camera = Camera(_ROW_TIME, 7.3 * _ROW_TIME)
    frames = pool_of_frames((_ROWS, 1920))
    points = []
    timings = {}
    for light, waveform in _EQUALIZED.items():
        blurred, truth = 20.0 + 200.0 * _light_of(waveform, camera, 64)
        noise = 2.0 * np.random.default_rng(4).standard_normal(blurred.shape)
        columns = np.clip(np.rint(blurred + noise), 0, 255).astype(np.uint8)
        for method in _EQUALIZERS:
            restored = _equalizer(method, camera)(columns)
            if method not in timings:
                timings[method] = read_in_turn(_equalizer(method, camera), frames, effort.seconds, (3, 40))
            timing = timings[method]
            error = root_mean_square(restored - truth) / 200.0
            name = f"{light}, {method}"
            points.append(
                Point("equalisers", name, light, light, method, "float64", timing.ratio, error, timing.seconds, light)
            )
            progress(name)
    return points


def _light_of(waveform: Waveform, camera: Camera, columns: int) -> Float64s:
    """(2, rows, columns): mean over the exposures, and the light at their ends; each column has its own start."""
    starts = np.linspace(0.0, 0.05, columns)
    blurred = np.stack([integrate_exposure(waveform, camera, _ROWS, start=start) for start in starts], axis=1)
    instants = np.arange(_ROWS)[:, None] * camera.row_period + starts
    return np.stack([blurred, sample_waveform(waveform, instants)])


def _equalizer(method: str, camera: Camera) -> Callable[[npt.NDArray[np.uint8]], Float64s]:
    if method == "none":
        return lambda columns: columns.astype(np.float64)
    if method == "circular inverse":
        return lambda columns: circular_inverse(columns, camera)
    kind: Literal["inverse", "wiener"] = "wiener" if method == "wiener" else "inverse"
    return lambda columns: equalize(columns, camera, method=kind)
