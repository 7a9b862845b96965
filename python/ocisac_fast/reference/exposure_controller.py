"""The exposure controller in plain Python: the rules as written down in docs/control.md, the maximum on fine grids."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.exposure.choice import BestExposure
from ocisac_fast.exposure.controller import ExposureMeasurement, MeasuredTone

Float64s = npt.NDArray[np.float64]


def best_noisy_exposure(
    frequencies: npt.ArrayLike,
    weights: npt.ArrayLike,
    bounds: tuple[float, float],
    *,
    noise_exposure: float = math.inf,
    step: float = 0.0,
) -> BestExposure:
    """The largest J on a grid, looked at twice again, 200 times finer, about its best points; or of all multiples."""
    f, w = np.asarray(frequencies, np.float64), np.asarray(weights, np.float64)

    def objective(exposures: npt.NDArray[Any]) -> Float64s:
        tones = np.abs(np.sin(np.pi * np.multiply.outer(exposures, f))) @ (w / (np.pi * f))
        return np.asarray(tones / np.sqrt(1.0 + exposures / noise_exposure))

    low, high = bounds
    if step > 0.0:
        grid = step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
        grid = grid[grid > 0.0]
    else:
        width = (high - low) / max(20_000, int(400 * f.max() * (high - low)))
        grid = np.append(np.arange(low, high, width) if width > 0.0 else [], high)
        for _ in range(3):
            best = grid[np.argsort(objective(grid))[-8:]]
            fine = (best[:, None] + width * np.linspace(-1, 1, 401)).ravel()
            grid, width = np.append(best, fine[(fine >= low) & (fine <= high)]), width / 200
    values = objective(grid)
    return BestExposure(float(grid[values.argmax()]), float(values.max()))


class ExposureController:
    """Same name and options; ``update`` gives (exposure, gain, J there, largest J, (shortest, longest))."""

    def __init__(
        self,
        exposures: tuple[float, float],
        *,
        step: float = 0.0,
        gains: tuple[float, float] = (1.0, 1.0),
        weights: tuple[float, float] = (1.0, 1.0),
        hysteresis: float = 0.01,
        level_floor: float = 0.05,
        level_aim: float = 0.4,
        level_ceiling: float = 0.9,
        max_saturated: float = 0.01,
        min_snr: float = 1.0,
        noise_level: float | None = None,
    ) -> None:
        self.range, self.step, self.gains, self.weights, self.hysteresis = exposures, step, gains, weights, hysteresis
        self.floor, self.aim, self.ceiling = level_floor, level_aim, level_ceiling
        self.max_saturated, self.min_snr = max_saturated, min_snr
        self.noise_level = math.inf if noise_level is None else noise_level
        self.last: tuple[float, float] | None = None
        self.limit, self.limit_radiance = math.inf, math.nan

    def update(self, m: ExposureMeasurement) -> tuple[float, float, float, float, tuple[float, float]]:
        """One frame."""
        last_exposure, last_gain = self.last if self.last is not None else (math.nan, math.nan)
        exposure = last_exposure if math.isnan(m.exposure) else m.exposure
        gain = (self.gains[0] if math.isnan(last_gain) else last_gain) if math.isnan(m.gain) else m.gain
        radiance = m.level / (exposure * gain)
        largest = self._largest(m, exposure * gain, radiance)
        smallest = min(self.floor / radiance if radiance > 0 else 0.0, largest)
        low, high = np.clip([smallest / self.gains[1], largest / self.gains[0]], *self.range)
        if self.step > 0 and math.floor(high / self.step + 1e-9) < math.ceil(low / self.step - 1e-9):
            low = max(math.floor(high / self.step + 1e-9) * self.step, self.range[0])
            high = max(high, math.ceil(low / self.step - 1e-9) * self.step)
        noise = self.noise_level / radiance if radiance > 0 else math.inf
        f, w = self._tones(m)
        best = best_noisy_exposure(f, w, (low, high), noise_exposure=noise, step=self.step)
        chosen, value = float(best.exposure), float(best.objective)
        if self.last is not None and low * 0.98 <= last_exposure <= high * 1.02:
            now = float(
                np.abs(np.sin(np.pi * f * last_exposure)) @ (w / np.pi / f) / np.sqrt(1 + last_exposure / noise)
            )
            if best.objective <= now * (1 + self.hysteresis):
                chosen, value = last_exposure, now
        self.last = (chosen, self._gain(chosen, radiance, smallest, largest, last_gain))
        return chosen, self.last[1], value, float(best.objective), (float(low), float(high))

    def _largest(self, m: ExposureMeasurement, product: float, radiance: float) -> float:
        """Of exposure times gain, that saturation and peak allow."""
        if math.isnan(product):
            return math.inf
        if self.limit_radiance > 0 and radiance > 0:
            self.limit *= self.limit_radiance / radiance
        self.limit_radiance = radiance
        if m.saturated > self.max_saturated:
            self.limit = min(self.limit, 0.7 * product)
            return self.limit
        self.limit *= 1.002
        return min(self.limit, self.ceiling / m.peak * product) if m.peak > 0 else self.limit

    def _tones(self, m: ExposureMeasurement) -> tuple[Float64s, Float64s]:
        frequencies, weights = [], []
        for kind, weight in zip((m.lights, m.motions), self.weights, strict=True):
            tones = [tone if isinstance(tone, MeasuredTone) else MeasuredTone(tone) for tone in kind]
            kept = [t for t in tones if not math.isnan(t.frequency) and not t.snr < self.min_snr]
            total = sum(t.share for t in kept)
            if total > 0 and weight > 0:
                frequencies += [t.frequency for t in kept]
                weights += [weight * t.share / total for t in kept]
        return np.array(frequencies), np.array(weights)

    def _gain(self, exposure: float, radiance: float, smallest: float, largest: float, last: float) -> float:
        low, high = np.clip([smallest / exposure, largest / exposure], *self.gains)
        aim = self.aim / (radiance * exposure) if radiance > 0 else math.nan
        if math.isnan(aim):
            aim = self.gains[0] if math.isnan(last) else last
        elif aim / 1.1 < last < aim * 1.1:
            aim = last
        return float(np.clip(aim, low, max(low, high)))
