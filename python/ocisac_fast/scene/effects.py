"""Effects of phones, dash cameras, webcams and cheap senders on the light of a lamp and on pictures of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import one_of, shown
from ocisac_fast.core.opencv import opencv
from ocisac_fast.light.waveforms import Chips, Samples, Waveform, integrate_exposure

_SAMPLES_PER_CHIP, _TIMES_PER_ROW = 32, 4
_MAINS = 100.0  # Hz, of rectified mains and of ripple
STILL = 20 / 255  # of white: pixels that differ by less are mixed with the frame before by `denoise-still`
_BLUR = 1.5  # px, of the unsharp mask
TONE_ROWS = 128  # of a tile of local tone mapping
RECTIFIED_MAINS = Samples(np.abs(np.sin(np.pi * np.arange(256) / 256)), 256 * _MAINS, repeat=True)


@dataclasses.dataclass(frozen=True)
class Effect:
    """One effect: the unit of its level, the largest level, and a sentence."""

    unit: str
    most: float
    sentence: str


EFFECTS: Mapping[str, Effect] = {
    "edge-jitter": Effect("chips", 0.45, "Each edge of the light comes up to so much early or late."),
    "long-runs": Effect("chips", 0.45, "Each bright run lasts so much longer."),
    "chopping": Effect("Hz", 1e6, "The lamp is dimmed by a square wave of duty 1/2 over its chips."),
    "ripple": Effect("of the light", 1.0, "The lamp's brightness ripples at 100 Hz, peak to peak."),
    "inverted": Effect("1", 1.0, "The lamp is dark for 1."),
    "sender-pause": Effect("chips", 1e4, "The lamp is dark for so long after its chips."),
    "row-groups": Effect("rows", 64, "So many rows are read at the same time."),
    "row-pause": Effect("rows", 1e4, "The read-out pauses in the middle of the picture."),
    "lens": Effect("of half a picture", 0.2, "Rows at the edges are pulled inwards, as the cube of their distance."),
    "exposure-pairs": Effect("ratio", 16, "Every other pair of rows is exposed shorter, and stored as bright."),
    "hot-rows": Effect("of the rows", 1.0, "Rows that are brighter by 60 / 255 of white."),
    "auto-gain": Effect("of the gain", 0.9, "The gain rises and falls over ten frames."),
    "late-frames": Effect("frame times", 1.0, "Each frame comes up to so much late, and all after it, too."),
    "denoise": Effect("of the frame before", 0.95, "Noise reduction that mixes frames."),
    "denoise-still": Effect(
        "of the frame before", 0.95, "The same where frames differ by less than 20 / 255 of white."
    ),
    "sharpen": Effect("amount", 10, "An unsharp mask of 1.5 px."),
    "curve": Effect("exponent", 5, "Stored values are the light to the power of 1 / exponent."),
    "local-tone": Effect("limit", 40, "Adaptive histogram equalisation of contrast, in tiles of 128 rows."),
    "mains": Effect("of the swing", 10, "Rectified mains light of 100 Hz on the whole picture."),
    "daylight": Effect("of the swing", 10, "Steady light that rises and falls by so much over twelve frames."),
    "rain": Effect("streaks", 1e4, "Bright streaks, others in each frame."),
}


def check_effects(levels: Mapping[str, float]) -> dict[str, float]:
    """Levels of named effects, checked; ValueError for others."""
    for name, level in levels.items():
        if name not in EFFECTS:
            raise ValueError(f"effects: got {shown(name)}, allowed: {one_of(EFFECTS)}")
        if not 0 <= level <= EFFECTS[name].most:
            raise ValueError(f"effects: {name}: got {shown(level)}, allowed: 0 to {EFFECTS[name].most:g}")
    return {name: float(level) for name, level in levels.items()}


class Effects:
    """Effects on a film.

    Args:
        levels: of `EFFECTS`, above 0; absent ones are 0.
        camera: with a frame time for ``late-frames``.
        rows: of a frame.
        seed: of all that is random.
    """

    def __init__(self, levels: Mapping[str, float], camera: Camera, rows: int, seed: int = 0) -> None:
        self._levels, self._camera, self._rows, self._seed = check_effects(levels), camera, rows, seed
        self._late = np.random.default_rng([seed, 8])
        self._random = np.random.default_rng([seed, 9])
        self._delay = 0.0  # s, of the frames so far
        self._hot = (self._random.random((rows, 1)) < self._level("hot-rows")) * 60 / 255
        self._before: Float64s | None = None

    def _level(self, name: str) -> float:
        return self._levels.get(name, 0.0)

    def light(self, lamp: Waveform) -> Waveform:
        """The light of a lamp that sends ``lamp``; ValueError where an effect of a sender needs repeated `Chips`."""
        names = ("edge-jitter", "long-runs", "chopping", "ripple", "inverted", "sender-pause")
        asked = [name for name in names if self._level(name)]
        if not asked:
            return lamp
        if not isinstance(lamp, Chips) or not lamp.repeat or lamp.rise or lamp.fall:
            raise ValueError(
                f"effects: {asked[0]}: got another light, allowed: chips that repeat, without rise and fall"
            )
        sent = np.append(lamp.levels > 0, np.zeros(round(self._level("sender-pause")), bool))
        sent ^= self._level("inverted") > 0
        rate = _SAMPLES_PER_CHIP * lamp.chip_rate
        level = lamp.amplitude * lamp.levels.max() * self._samples(sent, lamp.chip_rate)
        return Samples(level, rate, start=lamp.start + 0.5 / rate, repeat=True)

    def _samples(self, sent: npt.NDArray[np.bool_], chip_rate: float) -> Float64s:
        """Sample one cycle of the lamp with its moved edges."""
        edges = np.flatnonzero(sent != np.roll(sent, 1))
        late = self._level("edge-jitter") * np.random.default_rng([self._seed, 7]).uniform(-1, 1, edges.size)
        late += self._level("long-runs") * ~sent[edges]
        at = np.rint((edges + late) * _SAMPLES_PER_CHIP).astype(int) % (sent.size * _SAMPLES_PER_CHIP)
        steps = np.zeros(sent.size * _SAMPLES_PER_CHIP)
        np.add.at(steps, at, np.where(sent[edges], 1.0, -1.0))
        level = np.cumsum(steps)
        level -= level.min()
        time = np.arange(level.size) / (_SAMPLES_PER_CHIP * chip_rate)
        if chopping := self._level("chopping"):
            level *= 2 * (np.mod(chopping * time, 1) < 0.5)
        return np.asarray(level * (1 + self._level("ripple") / 2 * np.sin(2 * np.pi * _MAINS * time)))

    def read_rows(self) -> Float64s:
        """(rows,) times at which rows end their exposure, in row times after the first of an even read-out."""
        row = np.arange(self._rows, dtype=float)
        if group := round(self._level("row-groups")):
            row = np.floor(row / group) * group
        row += round(self._level("row-pause")) * (row >= self._rows / 2)
        across = (row - row.mean()) / (self._rows / 2)
        return np.asarray(row + self._level("lens") * across**3 * self._rows / 2)

    def delay(self) -> float:
        """Seconds by which the next frame is late; one call for each frame."""
        if late := self._level("late-frames"):
            self._delay += late * self._late.random() * (self._camera.frame_time or 0.0)
        return self._delay

    def exposed(self, light: Waveform, start: float) -> Float64s:
        """(rows, 1) means of ``light`` over the exposures of the rows; ``start``: of the frame, s."""
        seen = self._at_rows(light, start, self._camera.exposure)
        if ratio := self._level("exposure-pairs"):
            short = self._at_rows(light, start, (self._camera.exposure or 0.0) / ratio)
            seen = np.where(np.arange(self._rows) // 2 % 2, short, seen)
        return seen[:, None]

    def _at_rows(self, light: Waveform, start: float, exposure: float | None) -> Float64s:
        read = self.read_rows()
        first = int(np.floor(read.min())) - 1
        fine = dataclasses.replace(self._camera, row_time=self._camera.row_period / _TIMES_PER_ROW, exposure=exposure)
        count = _TIMES_PER_ROW * (int(np.ceil(read.max())) + 2 - first)
        seen = integrate_exposure(light, fine, count, start=start + first * self._camera.row_period)
        return np.asarray(np.interp((read - first) * _TIMES_PER_ROW, np.arange(count), seen))

    def daylight(self, frame: int) -> float:
        """Light of a frame on the whole picture, in units of the light."""
        return self._level("daylight") * float(np.sin(2 * np.pi * frame / 12))

    @property
    def mains(self) -> float:
        """Share of `RECTIFIED_MAINS` on the whole picture, in units of the light."""
        return self._level("mains")

    def seen(self, light: Float64s, frame: int, white: float) -> Float64s:
        """(rows, columns) light of a frame, in stored values, after rain, gain and hot rows."""
        light = light + white * 80 / 255 * self._streaks(*light.shape)
        gain = 1 + self._level("auto-gain") * np.sin(2 * np.pi * frame / 10)
        return np.asarray(light * gain + white * self._hot)

    def _streaks(self, rows: int, columns: int) -> Float64s:
        streaks = np.zeros((rows, columns))
        for _ in range(round(self._level("rain"))):
            row, column = self._random.integers(-100, rows), self._random.integers(0, columns)
            end = max(row + self._random.integers(30, 150), 0)
            streaks[max(row, 0) : end, column : column + 2] = self._random.uniform(0.2, 1)
        return streaks

    def stored(self, pixels: Float64s, kind: np.dtype[Any]) -> npt.NDArray[Any]:
        """A frame as it is stored: tone curve, noise reduction, sharpening, local tone mapping.

        Args:
            pixels: (rows, columns) light with noise, in stored values.
            kind: uint8 or uint16.
        """
        white = float(np.iinfo(kind).max)
        pixels = white * (np.clip(pixels, 0, white) / white) ** (1 / (self._level("curve") or 1))
        if self._before is not None:
            change = self._before - pixels
            pixels = pixels + self._level("denoise") * change
            if share := self._level("denoise-still"):
                pixels = pixels + share * change * (
                    np.abs(opencv("denoise-still").blur(change, (5, 5))) < STILL * white
                )
        self._before = pixels
        if amount := self._level("sharpen"):
            pixels = pixels + amount * (pixels - opencv("sharpen").GaussianBlur(pixels, (0, 0), _BLUR))
        result: npt.NDArray[Any] = np.clip(np.rint(pixels), 0, white).astype(kind)
        if limit := self._level("local-tone"):
            tiles = (1, max(1, self._rows // TONE_ROWS))
            result = np.asarray(opencv("local-tone").createCLAHE(limit, tiles).apply(result))
        return result
