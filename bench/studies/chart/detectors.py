"""The panel of detectors: time per frame and error rate for a known channel."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.chips import DETECTORS, ChipClock, chip_llr, expose_chips
from studies.chart.measuring import Point, in_turn
from studies.chart.panels import Effort, Progress, panel

Float64s = npt.NDArray[np.float64]

_ROWS = 1080
_COLUMNS_A_FRAME = 64  # of the effort for the gains


@dataclass(frozen=True)
class Setting:
    """Exposure in chips, rows per chip, noise of a row over the swing."""

    exposure_chips: float
    rows_per_chip: float
    noise: float

    @property
    def name(self) -> str:
        """Name in the chart."""
        return f"exposure {self.exposure_chips:g} chips, noise {100 * self.noise:g} %"


SETTINGS = (Setting(1.0, 4.0, 0.3), Setting(3.0, 4.0, 0.13), Setting(7.0, 4.0, 0.05), Setting(14.0, 4.0, 0.02))


@dataclass(frozen=True)
class ChipFrame:
    """One frame of random chips with random rate and phase, and all parameters that a detector needs."""

    chips: npt.NDArray[np.float64]
    first: int
    clock: ChipClock
    noise: float
    rows: Float64s

    def detect(self, method: str) -> Float64s:
        """Log-likelihood ratios."""
        return chip_llr(self.rows, self.clock, noise=self.noise, first=self.first, count=self.chips.size, method=method)

    @property
    def whole(self) -> npt.NDArray[np.bool_]:
        """True for chips that the frame shows completely, not cut by its ends."""
        period, reach = self.clock.rows_per_chip, self.clock.exposure_rows / 2
        begin = self.clock.phase + (self.first + np.arange(self.chips.size)) * period
        return np.asarray((begin - reach > 0) & (begin + period + reach < self.rows.size - 1))

    def errors(self, method: str) -> tuple[int, int]:
        """Number of wrong chips, and number of chips."""
        whole = self.whole
        wrong = (self.detect(method) > 0)[whole] != self.chips[whole]
        return int(np.sum(wrong)), wrong.size


def make_frame(setting: Setting, random: np.random.Generator, rows: int = _ROWS) -> ChipFrame:
    """Random chips, a rate within 1 % of the nominal one and a random phase."""
    period = setting.rows_per_chip * (1 + random.uniform(-0.01, 0.01))
    first = -math.ceil(setting.exposure_chips / 2) - 1
    chips = random.integers(0, 2, math.ceil(rows / period) - 2 * first).astype(float)
    phase, exposure_rows = random.uniform(0, period), setting.exposure_chips * period
    clock = ChipClock(rows_per_chip=period, phase=phase, exposure_rows=exposure_rows)
    light = expose_chips(chips, rows, clock, first=first)
    light += setting.noise * random.standard_normal(rows)
    return ChipFrame(chips, first, clock, setting.noise, light)


@panel(
    "detectors",
    "Detectors (exposure 1, 3, 7, 14 chips)",
    "time per frame / µs",
    "wrong chips",
    steps=len(SETTINGS) * len(DETECTORS),
)
def measure_detectors(effort: Effort, progress: Progress) -> list[Point]:
    """Count wrong chips of random frames; zero counts as half a chip."""
    points = []
    for setting in SETTINGS:
        random = np.random.default_rng(5)
        count = max(4, effort.columns // _COLUMNS_A_FRAME)
        frames = [make_frame(setting, random) for _ in range(count)]
        for method in DETECTORS:
            counted = np.sum([frame.errors(method) for frame in frames], axis=0)
            share = max(float(counted[0]), 0.5) / float(counted[1])
            seconds = in_turn(_detect_by(method), _nothing, frames, effort.seconds, (3, 200)).seconds
            name = f"{setting.name}, {method}"
            points.append(
                Point(
                    "detectors",
                    name,
                    method,
                    method,
                    f"{setting.exposure_chips:g}",
                    "float64",
                    seconds * 1e6,
                    share,
                    seconds,
                    setting.name,
                )
            )
            progress(name)
    return points


def _detect_by(method: str) -> Callable[[ChipFrame], Float64s]:
    return lambda frame: frame.detect(method)


def _nothing(_: ChipFrame) -> None:
    pass
