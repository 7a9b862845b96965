"""The flicker indices of IEEE P2020, in closed form, for a lamp of any phase under an exposure.

FMI, FDI and MMP as defined by Deegan (Electronic Imaging 2018, AVM-146, and 2020, AVM-001). The working group's
calculator (github.com/CARpublic/P2020-flicker) averages over frames; here the average is over all phases, since frame
rate and lamp are not synchronised.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import NotNegative, Positive, checked, shown
from ocisac_fast.core.results import Result
from ocisac_fast.exposure.flicker import FlickeringLight


@dataclass(frozen=True, slots=True, repr=False)
class FlickerIndices(Result):
    """Flicker indices, each of the broadcast shape of the exposures.

    Attributes:
        modulation_index: FMI = (max y - min y) / (max y + min y + 2B) over all phases, 0 to 1.
        detection_index: FDI, the probability that the lamp exceeds the background by the contrast.
        mitigation_probability: MMP, the probability of a level near the mean.
        missed: probability that an exposure receives no light of the lamp.
    """

    modulation_index: Float64s
    detection_index: Float64s
    mitigation_probability: Float64s
    missed: Float64s


@checked
def flicker_indices(
    light: FlickeringLight,
    exposure: npt.ArrayLike,
    *,
    background: NotNegative = 0.0,
    contrast: NotNegative = 0.1,
    tolerance: Positive = 0.1,
) -> FlickerIndices:
    """FMI, FDI, MMP and missed pulses of a lamp under an exposure that begins at any phase with equal probability.

    With y the mean light over the exposure, the lamp's peak being 1, and B the background:
    FMI = (max y - min y) / (max y + min y + 2B), FDI = P(y > contrast B),
    MMP = P(|y - mean y| < tolerance (B + mean y)).

    Args:
        light: of known frequency; its ``uncertainty`` is ignored.
        exposure: s, above 0, any shape.
        background: steady light on the same pixels in units of the lamp's peak, 0 or above.
        contrast: (y + B - B) / B above which the lamp is detected, 0 or above.
        tolerance: share of the mean within which modulation is mitigated, above 0.
    """
    times = np.asarray(exposure, dtype=np.float64)
    if not np.all(np.isfinite(times) & (times > 0.0)):
        raise ValueError(f"exposure: got {shown(exposure)}, allowed: finite, above 0 (s)")
    cycles = light.frequency * times
    levels = _ToneLevels(light, cycles) if light.duty is None else _PulseLevels(light, light.duty, cycles)
    near = tolerance * (background + levels.mean)
    return FlickerIndices(
        modulation_index=np.asarray((levels.high - levels.low) / (levels.high + levels.low + 2.0 * background)),
        detection_index=levels.above(contrast * background),
        mitigation_probability=levels.between(levels.mean - near, levels.mean + near),
        missed=1.0 - levels.above(0.0),
    )


class _ToneLevels:
    """Distribution of the mean of a raised cosine over the exposure: arcsine about its mean."""

    def __init__(self, light: FlickeringLight, cycles: Float64s) -> None:
        self._swing = light.depth / (1.0 + light.depth) * np.abs(np.sinc(cycles))
        self.mean = np.full(cycles.shape, 1.0 / (1.0 + light.depth))
        self.low, self.high = self.mean - self._swing, self.mean + self._swing

    def above(self, level: npt.ArrayLike) -> Float64s:
        offset = np.subtract(level, self.mean)
        ratio = np.where(self._swing > 0.0, offset / np.maximum(self._swing, 1e-300), 2.0 * np.sign(offset))
        return np.asarray(np.arccos(np.clip(ratio, -1.0, 1.0)) / math.pi)

    def between(self, low: Float64s, high: Float64s) -> Float64s:
        return self.above(low) - self.above(high)


class _PulseLevels:
    """PWM over n + r cycles: n duty + o cycles of light, where o is the overlap of parts r and duty of a period.

    o has an atom |1 - r - duty| at its minimum, an atom |r - duty| at its maximum, and is uniform in between.
    """

    def __init__(self, light: FlickeringLight, duty: float, cycles: Float64s) -> None:
        whole = np.floor(cycles)
        rest = cycles - whole
        floor = (1.0 - light.depth) / (1.0 + light.depth)  # dark level for a peak of 1
        scale = (1.0 - floor) / cycles
        self._atoms = np.abs(1.0 - rest - duty), np.abs(rest - duty)
        self.low = floor + scale * (whole * duty + np.maximum(rest + duty - 1.0, 0.0))
        self.high = floor + scale * (whole * duty + np.minimum(rest, duty))
        self.mean = np.full(cycles.shape, floor + (1.0 - floor) * duty)

    def above(self, level: npt.ArrayLike) -> Float64s:
        return self._share(np.asarray(level), np.greater)

    def between(self, low: Float64s, high: Float64s) -> Float64s:
        return self._share(low, np.greater) - self._share(high, np.greater_equal)

    def _share(self, level: Float64s, passes: np.ufunc) -> Float64s:
        """Probability of a value above the level, or at or above it, by ``passes``."""
        at_low, at_high = self._atoms
        span = self.high - self.low
        ramp = np.clip(np.divide(self.high - level, span, out=np.zeros_like(span), where=span > 0.0), 0.0, 1.0)
        return np.asarray(
            at_low * passes(self.low, level) + at_high * passes(self.high, level) + (1.0 - at_low - at_high) * ramp
        )
