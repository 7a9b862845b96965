"""The virtual testbed of table 2: an LED inside a turning annular grating, before a rolling-shutter camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera import Camera, exposure_response
from ocisac_fast.waveforms import SquareWave, integrate_exposure

ROWS, COLUMNS, FRAMES_PER_SECOND = 720, 1080, 30.0
ROW_TIME = 22.2e-6
EXPOSURES = (622e-6, 1202e-6, 2404e-6, 4981e-6)
COMMUNICATION = (200.0, 500.0, 700.0)
RING_DIAMETER, TURNS_PER_SECOND = 0.15, 223.0 / 60.0
GRATINGS = (100.0, 200.0, 500.0)  # nominal periods a metre
FRAMES = 1800  # a setting, as the paper averaged

# What the paper leaves out. The two clocks differ, so that the light's phase runs through all values over a recording;
# dark rows are not clipped at 0.
CLOCK_OFFSET = 70e-6
SWING, NOISE, DARK_LEVEL = 200.0, 2.0, 16.0  # DN

Kind = Literal["communication", "sensing"]


def speed() -> float:
    """Of the grating, m/s: v = pi D N."""
    return math.pi * RING_DIAMETER * TURNS_PER_SECOND


def periods_on_ring(grating: float) -> int:
    """A ring closes on whole periods only: the nearest to the nominal grating (1/m)."""
    return round(grating * math.pi * RING_DIAMETER)


def true_grating(grating: float) -> float:
    """Periods a metre of the ring that closes."""
    return periods_on_ring(grating) / (math.pi * RING_DIAMETER)


def motion_frequency(grating: float) -> float:
    """f_x v of the ring that closes, Hz."""
    return periods_on_ring(grating) * TURNS_PER_SECOND


@dataclass(frozen=True)
class Setting:
    """One light or grating at one exposure.

    Attributes:
        kind: ``"communication"`` (flickering LED, grating at rest) or ``"sensing"`` (steady LED, grating turning).
        nominal: as the paper prints it: Hz, or periods a metre.
        exposure: s.
    """

    kind: Kind
    nominal: float
    exposure: float

    @property
    def frequency(self) -> float:
        """Of the flicker, Hz: f_c, or f_x v of the ring that closes."""
        return self.nominal if self.kind == "communication" else motion_frequency(self.nominal)

    @property
    def camera(self) -> Camera:
        frame_time = (1.0 + CLOCK_OFFSET) / FRAMES_PER_SECOND
        return Camera(ROW_TIME, self.exposure, frame_time, dark_level=DARK_LEVEL)

    @property
    def theory(self) -> float:
        """|sinc(f T_e)|."""
        return float(abs(exposure_response(self.frequency, self.exposure)))


def settings() -> list[Setting]:
    """The 12 settings of communication and the 12 of sensing, by rising frequency, then exposure."""
    lights: list[tuple[Kind, float]] = [("communication", f) for f in COMMUNICATION]
    gratings: list[tuple[Kind, float]] = [("sensing", g) for g in GRATINGS]
    return [Setting(kind, nominal, exposure) for kind, nominal in lights + gratings for exposure in EXPOSURES]


def record(setting: Setting, frames: range, seed: int, columns: int = 1) -> npt.NDArray[np.uint8]:
    """A recording of the testbed: (frames, rows, columns) bytes, every column behind a slot of the grating.

    Neighbouring columns of a turning grating see it pass one after the other, spread over a period; a flickering LED
    shows in all columns alike. Noise is normal, independent in every pixel.
    """
    number = settings().index(setting)
    start = np.random.default_rng([seed, number]).uniform(0.0, 1.0) / setting.frequency
    random = np.random.default_rng([seed, number, 1 + frames.start])
    spread = 1.0 / setting.frequency / columns if setting.kind == "sensing" else 0.0
    light = [_light(setting, frames, start + k * spread) for k in range(columns if spread else 1)]
    values = DARK_LEVEL + SWING * np.stack(np.broadcast_arrays(*light, *light[:1] * (columns - len(light))), axis=-1)
    values += NOISE * random.standard_normal(values.shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def _light(setting: Setting, frames: range, start: float) -> npt.NDArray[Any]:
    """(frames, rows) mean light over each row's exposure."""
    return integrate_exposure(SquareWave(setting.frequency), setting.camera, ROWS, start, np.asarray(frames))
