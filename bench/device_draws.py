"""Random draws of what phones, dash cameras, webcams and cheap senders do to a lamp's light, two or three at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import Camera, Chips
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
class DeviceDraw:
    """A lamp, a camera and what they do; SI units, DN, and those of EFFECTS."""

    chip_rate: float
    told_chip_rate: float
    exposure: float
    swing: float
    noise: float
    lamp_width: float
    start: float
    effects: dict[str, float]
    seed: int

    @staticmethod
    def of(seed: int) -> DeviceDraw:
        """The draw of a seed."""
        random = np.random.default_rng([seed, 6])
        names = random.choice(list(EFFECTS), random.integers(2, 4), replace=False)
        told = float(random.uniform(6e3, 10e3))
        return DeviceDraw(
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
        return dataclasses.replace(self.camera, row_time=ROW_TIME * (1 + self.level(WRONG_ROW_TIME)))

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
        return simulate_frames(
            Chips(self.sent(chips), self.chip_rate, repeat=True),
            self.camera,
            *(ROWS, COLUMNS, count),
            start=self.start,
            swing=self.swing,
            dark_level=DARK,
            noise=self.noise,
            lamp=lamp_bar(ROWS, COLUMNS, self.lamp_width),
            reflectance=texture(ROWS, COLUMNS, 0.1, seed=self.seed) if self.level("daylight") else 1.0,
            effects=effects,
            seed=self.seed,
        )
