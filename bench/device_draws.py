"""Random draws of what phones, dash cameras, webcams and cheap senders do to the light of a lamp, two or three at once.

Chips are finely sampled light here, exposed by `integrate_exposure`; rows are read at any times; pictures are processed
after they were stored.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import Camera, Samples, integrate_exposure
from ocisac_fast.scene.simulation import lamp_bar, texture

ROWS, COLUMNS, ROW_TIME, FRAME_TIME = 1080, 64, 22.2e-6, 1 / 30
DARK = 25.0  # DN
SAMPLES_PER_CHIP, TIMES_PER_ROW = 32, 4
BLOCK = 14 + 16 * (2 + 8)  # chips of a block of 8 bytes in Manchester code
Floats = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]
# Levels from the least to the most, in the units of the functions below
EFFECTS = {
    "edges that jitter": (0.03, 0.2),  # chips
    "long bright runs": (0.05, 0.45),  # chips
    "chopping": (15e3, 25e3),  # Hz
    "ripple": (0.1, 0.6),  # of the light
    "inverted": (1, 1),
    "pauses of the sender": (1, 20),  # chips
    "row groups": (2, 4),  # rows
    "read-out pause": (2, 20),  # rows
    "lens correction": (0.003, 0.08),  # at half a picture
    "two exposures by row": (1.5, 4),
    "hot rows": (0.005, 0.03),  # of the rows
    "automatic gain": (0.05, 0.3),
    "row time told wrong": (-0.02, 0.02),
    "frame times": (0.05, 0.5),  # of a frame
    "sharpening": (0.3, 1.5),
    "noise reduction": (0.1, 0.5),  # share of the frame before
    "noise reduction by difference": (0.2, 0.5),  # the same, below 20 DN
    "local tone mapping": (1.5, 4),  # limit
    "tone curve": (1.2, 2.2),  # exponent
    "rectified mains": (0.2, 1.0),  # of the swing
    "daylight": (0.1, 0.5),
    "rain": (5, 40),  # streaks
}
LEAST_DIFFERENCE = 20.0  # DN, of noise reduction by difference


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
    def told(self) -> Camera:
        """The camera as it is stated to the receiver."""
        return Camera(ROW_TIME * (1 + self.level("row time told wrong")), self.exposure, frame_time=FRAME_TIME)

    def sent(self, chips: npt.NDArray[Any]) -> Bytes:
        """One cycle of the lamp's brightness, 0 or 1."""
        pause = round(self.level("pauses of the sender"))
        blocks = np.pad(np.asarray(chips, np.uint8).reshape(-1, BLOCK), ((0, 0), (0, pause)))
        return np.asarray(blocks.ravel() ^ (self.level("inverted") > 0), np.uint8)

    def light(self, sent: Bytes) -> Samples:
        """The lamp's light, 0 to 1."""
        random = np.random.default_rng([self.seed, 7])
        edges = np.flatnonzero(sent != np.roll(sent, 1))
        late = self.level("edges that jitter") * random.uniform(-1, 1, edges.size)
        late += self.level("long bright runs") * (sent[edges] == 0)
        at = np.rint((edges + late) * SAMPLES_PER_CHIP).astype(int) % (sent.size * SAMPLES_PER_CHIP)
        steps = np.zeros(sent.size * SAMPLES_PER_CHIP)
        np.add.at(steps, at, np.where(sent[edges], 1.0, -1.0))
        level = np.cumsum(steps)
        level -= level.min()
        cycles = np.arange(level.size) / level.size * (sent.size / self.chip_rate)  # s
        if chopping := self.level("chopping"):
            level *= 2 * (np.mod(chopping * cycles, 1) < 0.5)
        level *= 1 + self.level("ripple") / 2 * np.sin(2 * np.pi * 100 * cycles)
        rate = SAMPLES_PER_CHIP * self.chip_rate
        return Samples(level, rate, start=0.5 / rate, repeat=True)

    def read_rows(self) -> Floats:
        """Rows of time after the frame's start at which each row ends its exposure."""
        row = np.arange(ROWS, dtype=float)
        if group := round(self.level("row groups")):
            row = np.floor(row / group) * group
        row += round(self.level("read-out pause")) * (row >= ROWS / 2)
        across = (row - row.mean()) / (ROWS / 2)
        return row + self.level("lens correction") * across**3 * ROWS / 2

    def starts(self, frames: int) -> Floats:
        """Times of the frames, s."""
        random = np.random.default_rng([self.seed, 8])
        late = np.cumsum(self.level("frame times") * random.random(frames))
        return self.start + (np.arange(frames) + late) * FRAME_TIME

    def frames(self, chips: npt.NDArray[Any], count: int) -> Iterator[tuple[Bytes, Bytes]]:
        """The film of a lamp that repeats these chips: each frame, and what went into its local tone mapping."""
        scene, pixels = _Scene(self, self.light(self.sent(chips))), _Processing(self)
        for number, start in enumerate(self.starts(count)):
            source = pixels.stored(scene.stored(number, float(start)))
            yield pixels.toned(source), source


class _Scene:
    """Frames of a draw as the sensor stores them."""

    def __init__(self, draw: DeviceDraw, light: Samples) -> None:
        self.draw, self.light = draw, light
        self.random = np.random.default_rng([draw.seed, 9])
        self.shape = lamp_bar(ROWS, COLUMNS, draw.lamp_width)
        self.reflectance = texture(ROWS, COLUMNS, 0.1, seed=draw.seed) if draw.level("daylight") else np.ones((1, 1))
        self.hot = 60.0 * (self.random.random((ROWS, 1)) < draw.level("hot rows"))
        self.mains = Samples(np.abs(np.sin(np.pi * np.arange(256) / 256)), 25600, repeat=True)

    def _exposed(self, light: Samples, start: float, exposure: float) -> Floats:
        read = self.draw.read_rows()
        first = int(np.floor(read.min())) - 1
        camera = Camera(ROW_TIME / TIMES_PER_ROW, exposure)
        rows = TIMES_PER_ROW * (int(np.ceil(read.max())) + 2 - first)
        seen = integrate_exposure(light, camera, rows, start=start + first * ROW_TIME)
        return np.interp((read - first) * TIMES_PER_ROW, np.arange(rows), seen)

    def _of_all(self, light: Samples, start: float) -> Floats:
        draw = self.draw
        seen = self._exposed(light, start, draw.exposure)
        if ratio := draw.level("two exposures by row"):
            short = self._exposed(light, start, draw.exposure / ratio)
            seen = np.where(np.arange(ROWS) // 2 % 2, short, seen)
        return seen[:, None]

    def stored(self, number: int, start: float) -> Floats:
        draw, random = self.draw, self.random
        other = DARK * (1 + draw.level("daylight") * np.sin(2 * np.pi * number / 12))
        if share := draw.level("rectified mains"):
            other = other + share * draw.swing * self._of_all(self.mains, start)
        light = (other + draw.swing * self.shape * self._of_all(self.light, start)) * self.reflectance
        light = light + 80 * self._rain(round(draw.level("rain")))
        light = light * (1 + draw.level("automatic gain") * np.sin(2 * np.pi * number / 10))
        light = np.clip(light + self.hot + draw.noise * random.standard_normal(light.shape), 0, 255)
        return np.asarray(255 * (light / 255) ** (1 / (draw.level("tone curve") or 1)))

    def _rain(self, count: int) -> Floats:
        streaks = np.zeros((ROWS, COLUMNS))
        for _ in range(count):
            row, column = self.random.integers(-100, ROWS), self.random.integers(0, COLUMNS - 1)
            end = max(row + self.random.integers(30, 150), 0)
            streaks[max(row, 0) : end, column : column + 2] = self.random.uniform(0.2, 1)
        return streaks


class _Processing:
    """Processing of pictures after they were stored."""

    def __init__(self, draw: DeviceDraw) -> None:
        self.draw = draw
        self.before: Floats | None = None

    def stored(self, pixels: Floats) -> Bytes:
        """After noise reduction and sharpening."""
        import cv2

        pixels = self._mixed(pixels, self.draw.level("noise reduction"), np.inf)
        pixels = self._mixed(pixels, self.draw.level("noise reduction by difference"), LEAST_DIFFERENCE)
        self.before = pixels
        if amount := self.draw.level("sharpening"):
            pixels = pixels + amount * (pixels - cv2.GaussianBlur(pixels, (0, 0), 1.5))
        return np.clip(np.rint(pixels), 0, 255).astype(np.uint8)

    def toned(self, stored: Bytes) -> Bytes:
        """After local tone mapping."""
        import cv2

        if limit := self.draw.level("local tone mapping"):
            return np.asarray(cv2.createCLAHE(limit, tiles_of_tones()).apply(stored), np.uint8)
        return stored

    def _mixed(self, pixels: Floats, share: float, below: float) -> Floats:
        import cv2

        if not share or self.before is None:
            return pixels
        change = self.before - pixels
        return np.asarray(pixels + share * change * (np.abs(cv2.blur(change, (5, 5))) < below))


def tiles_of_tones() -> tuple[int, int]:
    """Local means of tone mapping: across and down."""
    return 1, ROWS // 128
