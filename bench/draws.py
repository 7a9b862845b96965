"""Random draws of what goes wrong outside a laboratory: to a lamp and its light, and in cameras and cheap senders."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import Camera, Chips, SquareWave, Tone
from ocisac_fast.scene.effects import Effects
from ocisac_fast.scene.simulation import lamp_bar, simulate_frames, texture

ROWS, COLUMNS, ROW_TIME, FRAME_TIME = 1080, 64, 22.2e-6, 1 / 30
DARK = 25.0  # DN
BLOCK = 14 + 16 * (2 + 8)  # chips of a block of 8 bytes in Manchester code, after which a sender pauses
WRONG_ROW_TIME = "row-time"  # told, relative
Floats = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]
# Levels from the least to the most, in the units of ocisac_fast.scene.effects.EFFECTS
EFFECTS = {
    "edge-jitter": (0.03, 0.2),
    "long-runs": (0.05, 0.45),
    "chopping": (15e3, 25e3),
    "ripple": (0.1, 0.6),
    "inverted": (1, 1),
    "sender-pause": (1, 20),
    "row-groups": (2, 4),
    "row-pause": (2, 20),
    "lens": (0.003, 0.08),
    "exposure-pairs": (1.5, 4),
    "hot-rows": (0.005, 0.03),
    "auto-gain": (0.05, 0.3),
    WRONG_ROW_TIME: (-0.02, 0.02),
    "late-frames": (0.05, 0.5),
    "sharpen": (0.3, 1.5),
    "denoise": (0.1, 0.5),
    "denoise-still": (0.2, 0.5),
    "local-tone": (1.5, 4),
    "curve": (1.2, 2.2),
    "mains": (0.2, 1.0),
    "daylight": (0.03, 0.14),
    "rain": (5, 40),
}


@dataclasses.dataclass(frozen=True)
class Draw:
    """A lamp, a camera and what they do; SI units, DN, and those of EFFECTS; the rest as in `simulate_frames`."""

    chip_rate: float
    told_chip_rate: float
    exposure: float
    swing: float
    noise: float
    lamp_width: float
    start: float
    effects: dict[str, float]
    seed: int
    told_exposure: float | None = 1.0  # over the exposure; None: not told
    rise: float = 0.0  # chips
    fall: float = 0.0
    hum: float = 0.0  # peak to peak over the swing
    mains: float = 50.0
    pwm: float = 0.0  # height of a second lamp over the swing
    pwm_frequency: float = 1000.0
    texture: float = 0.0
    tilt: float = 0.0
    spot: float = math.inf  # standard deviation along the rows; infinite: a bar
    jitter: float = 0.0

    @staticmethod
    def of(seed: int) -> Draw:
        """The draw of a seed, of light; each impairment is absent in some."""
        random = np.random.default_rng([seed, 5])

        def sometimes(share: float, low: float, high: float) -> float:
            value = random.uniform(low, high)
            return float(value) if random.uniform() < share else 0.0

        chip_rate = 8e3 * (1 + random.uniform(-1e-4, 1e-4))
        exposure = float(np.exp(random.uniform(np.log(0.5), np.log(6.0)))) / 8e3
        error = (1.0, 1.0, 1 + random.uniform(-0.1, 0.1), None)[random.integers(4)]
        return Draw(
            chip_rate=float(chip_rate),
            told_chip_rate=8e3,
            exposure=exposure,
            told_exposure=None if error is None else float(error),
            swing=float(random.uniform(50, 110)),
            noise=float(random.uniform(1, 4)),
            rise=sometimes(0.6, 0.05, 0.8),
            fall=sometimes(0.6, 0.05, 0.8),
            hum=sometimes(0.5, 0.05, 0.6),
            mains=float(random.choice([50.0, 60.0])),
            pwm=sometimes(0.2, 0.05, 0.3),
            pwm_frequency=float(random.uniform(800, 3000)),
            texture=sometimes(0.5, 0.02, 0.2),
            lamp_width=float(random.uniform(16, 60)),
            tilt=math.radians(sometimes(0.4, -6, 6)),
            spot=sometimes(0.3, 180, 400) or math.inf,
            jitter=sometimes(0.5, 2e-6, 50e-6),
            start=float(random.uniform(0, 5)),
            effects={},
            seed=seed,
        )

    @staticmethod
    def of_devices(seed: int) -> Draw:
        """The draw of a seed, of two or three of EFFECTS."""
        random = np.random.default_rng([seed, 6])
        names = random.choice(list(EFFECTS), random.integers(2, 4), replace=False)
        told = float(random.uniform(6e3, 10e3))
        return Draw(
            chip_rate=told * (1 + float(random.uniform(-1e-4, 1e-4))),
            told_chip_rate=told,
            exposure=float(random.uniform(2.0, 7.0)) / told,
            swing=float(random.uniform(60, 120)),
            noise=float(random.uniform(1, 3)),
            lamp_width=float(random.uniform(16, 60)),
            start=float(random.uniform(0, 5)),
            effects={str(name): float(random.uniform(*EFFECTS[name])) for name in names},
            seed=seed,
        )

    def level(self, effect: str) -> float:
        """0 where it is absent."""
        return self.effects.get(effect, 0.0)

    @property
    def camera(self) -> Camera:
        """As it is."""
        return Camera(ROW_TIME, self.exposure, frame_time=FRAME_TIME)

    @property
    def told(self) -> Camera:
        """As it is stated to the receiver."""
        exposure = None if self.told_exposure is None else self.exposure * self.told_exposure
        return Camera(ROW_TIME * (1 + self.level(WRONG_ROW_TIME)), exposure, frame_time=FRAME_TIME)

    def sent(self, chips: npt.NDArray[Any]) -> Bytes:
        """One cycle of the lamp's brightness, 0 or 1."""
        pause = round(self.level("sender-pause"))
        blocks = np.pad(np.asarray(chips, np.uint8).reshape(-1, BLOCK), ((0, 0), (0, pause)))
        return np.asarray(blocks.ravel() ^ (self.level("inverted") > 0), np.uint8)

    def device(self) -> Effects:
        """The effects but those of `sent` and of `told`, from the first frame on."""
        return Effects(self._of_device, self.camera, ROWS, self.seed)

    @property
    def _of_device(self) -> dict[str, float]:
        others = ("sender-pause", "inverted", WRONG_ROW_TIME)
        return {name: level for name, level in self.effects.items() if name not in others}

    def starts(self, frames: int) -> Floats:
        """Times of the frames, s."""
        device = self.device()
        return self.start + np.arange(frames) * FRAME_TIME + [device.delay() for _ in range(frames)]

    def frames(self, chips: npt.NDArray[Any], count: int) -> Iterator[tuple[Bytes, Bytes]]:
        """The film of a lamp that repeats these chips: each frame, and what went into its local tone mapping."""
        seen = self._simulated(chips, count, self._of_device)
        if not self.level("local-tone"):
            return ((frame, frame) for frame in seen)
        untoned = {name: level for name, level in self._of_device.items() if name != "local-tone"}
        return zip(seen, self._simulated(chips, count, untoned), strict=True)

    def _simulated(self, chips: npt.NDArray[Any], count: int, effects: dict[str, float]) -> Iterator[Bytes]:
        along = (np.arange(ROWS)[:, None] - (ROWS - 1) / 2) / self.spot
        hum = Tone(2 * self.mains, amplitude=self.hum, phase=self.start)
        contrast = 0.1 if self.level("daylight") else self.texture
        return simulate_frames(
            Chips(self.sent(chips), self.chip_rate, repeat=True, rise=self.rise, fall=self.fall),
            self.camera,
            *(ROWS, COLUMNS, count),
            start=self.start,
            swing=self.swing,
            dark_level=DARK,
            noise=self.noise,
            lamp=lamp_bar(ROWS, COLUMNS, self.lamp_width, tilt=self.tilt) * np.exp(-(along**2) / 2),
            ambient=hum + SquareWave(self.pwm_frequency, amplitude=self.pwm),
            reflectance=texture(ROWS, COLUMNS, contrast, seed=self.seed) if contrast else 1.0,
            jitter=self.jitter,
            effects=effects,
            seed=self.seed,
        )
