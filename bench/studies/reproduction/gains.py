"""Gains of a recording by the paper's processing chain (figure 8) and by the fit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ocisac_fast import demo
from ocisac_fast.tones.gain import tone_gain
from studies.reproduction.testbed import FRAMES, Setting, record


@dataclass(frozen=True)
class GainResult:
    """Mean gain of a setting over its frames, by both methods, with standard errors of the mean."""

    setting: Setting
    paper: float  # eqs. 24 and 25: one column, the DFT's bin nearest to the tone
    paper_std: float  # from the scatter
    fit: float  # least squares with all harmonics at the exact frequency
    fit_std: float  # as reported
    fit_scatter: float  # from the scatter of the frames

    @property
    def bin(self) -> float:
        """m before rounding: cycles in the frame, N T_r f."""
        return demo.ROWS * demo.ROW_TIME * self.setting.frequency

    @property
    def deviation(self) -> float:
        """Deviation of the fit from theory, in its standard errors."""
        return (self.fit - self.setting.theory) / self.fit_std

    @property
    def bias(self) -> float:
        """Bias of the paper's method."""
        return self.paper - self.setting.theory


def measure(setting: Setting, frames: int = FRAMES, seed: int = 0) -> GainResult:
    """Record a setting and measure it."""
    columns = record(setting, frames, seed)
    paper = tone_gain(columns, setting.camera, setting.frequency, method="dft", waveform="square").gain
    fit = tone_gain(columns, setting.camera, setting.frequency, method="fit", waveform="square")
    root = math.sqrt(frames)
    return GainResult(
        setting,
        float(np.mean(paper)),
        float(np.std(paper, ddof=1)) / root,
        float(np.mean(fit.gain)),
        float(np.sqrt(np.mean(fit.gain_std**2))) / root,
        float(np.std(fit.gain, ddof=1)) / root,
    )


def chi_squared(results: Iterable[GainResult]) -> float:
    """Sum of squared deviations of the fit from theory; expected to be about the number of settings."""
    return sum(result.deviation**2 for result in results)


def worst_deviation(results: Sequence[GainResult]) -> float:
    """Largest deviation of the fit from theory, in standard errors."""
    return max(abs(result.deviation) for result in results)
