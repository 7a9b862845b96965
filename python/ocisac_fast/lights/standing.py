"""Lights that stand where they were found: a test of that, and their measures in place."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import box_in_time_order
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.regions import Region
from ocisac_fast.lights.sources import LightSource
from ocisac_fast.tones.gain import tone_gain

Float64s = npt.NDArray[np.float64]
Pixels = npt.NDArray[Any]

_CELLS, _HALVES = 8, 2  # of a box: beside and above each other
_SAMPLED = 64  # columns of a box
_ROWS_A_CYCLE = 16  # of a tone
_MOVED = 0.15  # change of a cell's mean that movement makes, relative to the light's amplitude
_DEVIATIONS = 4.0  # standard errors
_LEAST, _MOST = 0.7, 1.4  # ratio of amplitudes, and of means, of a light that stays the same
_TURNED = 0.5  # rad between the halves of a box: another frequency
_UNLIKE = 0.8  # ratio of the shares of a waveform that all cells have in common
_ENDS_UNLIKE = 4.0  # ratio of a waveform's energies in the first or last quarter of a box
_TREND = 3  # degree of the slow light beside a waveform
_PADDED = 8  # times the rows: spectrum of a waveform


class StandingLight:
    """A light in the frame in which it was found, to be recognised and measured at the same place in later ones.

    A box is divided into 2 x 8 cells. A light stands if the mean of no cell, relative to that of the box, changes by
    more than 0.15 of the light's amplitude (and 4 standard errors), if the box swings 0.7 to 1.4 times as much, and if
    the phases of its halves differ as before; so it neither moves, vanishes nor changes its frequency. Small movements
    add up, since the reference stays. Of a light that sends data, all cells show one waveform, from the first quarter
    of the box to the last.

    Args:
        pixels: (rows, columns) in time order.
        camera: as of stored pictures.
        source: the light as found in them.
    """

    def __init__(self, pixels: Pixels, camera: Camera, source: LightSource) -> None:
        self.source = source
        self._shape, self._camera = pixels.shape, camera.in_time_order
        self._box = box_in_time_order(source.region, pixels.shape, camera.scan_axis)
        frequency = source.frequency * camera.row_period
        dark = camera.dark_level
        self._view: _View = _Waveform(self._box, dark) if source.carries_data else _Tone(self._box, dark, frequency)
        self._look = self._view.look(pixels)
        self._measured = self._measures(pixels, source.frequency)

    def measure(self, pixels: Pixels) -> LightSource | None:
        """The light in another frame; None if it does not stand there as before.

        Gain, phase, mean and flags are measured; amplitude and signal-to-noise ratio follow the swing; frequency (but
        of data), box and the other values stay.
        """
        if pixels.shape != self._shape:
            return None
        look = self._view.look(pixels)
        swing = self._view.swing_where_standing(look, self._look)
        if swing is None:
            return None
        frequency = self.source.frequency if look.frequency is None else look.frequency / self._camera.row_period
        now, then, source = self._measures(pixels, frequency), self._measured, self.source
        if not (now.mean > 0.0 and then.mean > 0.0):
            return None
        part = 1.0 if source.carries_data or not then.gain > 0.0 else source.gain / then.gain  # the source in its box
        brighter = now.mean / then.mean
        return dataclasses.replace(
            source,
            frequency=frequency,
            gain=now.gain * part,
            gain_std=now.gain_std * part,
            phase=now.phase,
            mean=source.mean * brighter,
            snr=source.snr * (swing / brighter) ** 2,
            amplitude=source.amplitude * swing,
            flags=now.flags,
        )

    def _measures(self, pixels: Pixels, frequency: float) -> _Measures:
        found = tone_gain(self._box.cut(pixels), self._camera, frequency, pooled=True)
        turned = 2.0 * math.pi * (frequency * self._camera.row_period * self._box.y % 1.0)
        phase = math.remainder(float(found.phase) - turned, 2.0 * math.pi)
        return _Measures(float(found.gain), float(found.gain_std), phase, float(found.mean), Flag(int(found.flags)))


@dataclass(frozen=True, slots=True)
class _Measures:
    """As in ``LightSource``, of the whole box."""

    gain: float
    gain_std: float
    phase: float
    mean: float
    flags: Flag


@dataclass(frozen=True, slots=True)
class _Look:
    """A box in a frame.

    Attributes:
        mean: light of the cells, DN.
        noise: standard error of a cell's mean, DN.
        swing: complex amplitudes of the cells' tone, or the waveform of all cells (rows,).
        common: share of the cells' swing that is this waveform; 1 for a tone.
        follow: (cells,) how much of the waveform each cell has, 1 on average.
        frequency: cycles per row of the waveform's strongest tone; None for a known tone.
    """

    mean: Float64s
    noise: float
    swing: npt.NDArray[Any]
    common: float = 1.0
    follow: Float64s | None = None
    frequency: float | None = None


class _View(Protocol):
    def look(self, pixels: Pixels) -> _Look: ...

    def swing_where_standing(self, now: _Look, then: _Look) -> float | None:
        """Amplitude relative to the reference; None if the light does not stand."""
        ...


class _Cells:
    """Rows of a box, every ``row_step``-th, in cells of columns."""

    def __init__(self, box: Region, dark: float, row_step: int = 1) -> None:
        step = -(-box.width // _SAMPLED)
        columns = -(-box.width // step)
        cells = max(min(_CELLS, columns // 2), 1)
        cell = np.arange(columns) * cells // columns
        self._rows, self._columns = slice(box.y, box.bottom, row_step), slice(box.x, box.right, step)
        self._dark = dark
        self._mean = ((cell[:, None] == np.arange(cells)) / np.bincount(cell)).astype(np.float32)

    def rows(self, pixels: Pixels) -> Float64s:
        """(rows, cells) mean light above dark."""
        return np.asarray(pixels[self._rows, self._columns].astype(np.float32) @ self._mean, np.float64) - self._dark


class _Tone:
    def __init__(self, box: Region, dark: float, frequency: float) -> None:
        step = max(int(1.0 / (_ROWS_A_CYCLE * frequency)), 1)
        self._cells = _Cells(box, dark, step)
        angle = 2.0 * np.pi * frequency * np.arange(0, box.height, step)
        waves = np.stack([np.ones(len(angle)), np.cos(angle), np.sin(angle)], axis=1)
        middle = len(angle) // _HALVES
        self._design = np.zeros((len(angle), 3 * _HALVES))
        self._design[:middle, :3], self._design[middle:, 3:] = waves[:middle], waves[middle:]
        self._weights = np.linalg.pinv(self._design)

    def look(self, pixels: Pixels) -> _Look:
        rows = self._cells.rows(pixels)
        found = self._weights @ rows
        mean, cosine, sine = found[0::3], found[1::3], found[2::3]
        spread = float(np.linalg.norm(self._weights[0::3], axis=1).max())
        return _Look(mean, spread * _row_noise(rows - self._design @ found), cosine - 1j * sine)

    def swing_where_standing(self, now: _Look, then: _Look) -> float | None:
        halves, before = now.swing.sum(axis=1), then.swing.sum(axis=1)
        turned = np.angle(halves[1:] * np.conj(halves[:1]) * np.conj(before[1:]) * before[:1])
        swing = _ratio(abs(halves.sum()), abs(before.sum()))
        if swing is None or np.abs(turned).max() > _TURNED:
            return None
        return swing if _stays(now, then, float(np.sqrt(np.mean(np.abs(then.swing) ** 2)))) else None


class _Waveform:
    def __init__(self, box: Region, dark: float) -> None:
        self._cells = _Cells(box, dark)
        self._slow = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, box.height), _TREND))[0]
        self._lowest = 2 * _PADDED  # two cycles in the box

    def look(self, pixels: Pixels) -> _Look:
        rows = self._cells.rows(pixels)
        fast = rows - self._slow @ (self._slow.T @ rows)
        waveform = fast.mean(axis=1)
        energy, every = float(waveform @ waveform), float((fast**2).sum())
        if not energy > 0.0:
            return _Look(rows.mean(axis=0), 0.0, waveform, 0.0, np.ones(rows.shape[1]))
        follow = fast.T @ waveform / energy
        noise = _row_noise(fast - waveform[:, None] * follow) / math.sqrt(len(rows))
        common = rows.shape[1] * energy / every
        return _Look(rows.mean(axis=0), noise, waveform, common, follow, self._strongest(waveform))

    def _strongest(self, waveform: Float64s) -> float:
        length = _PADDED * len(waveform)
        power = np.abs(np.fft.rfft(waveform, length)) ** 2
        return float(self._lowest + power[self._lowest : -_PADDED].argmax()) / length

    def swing_where_standing(self, now: _Look, then: _Look) -> float | None:
        swing = _ratio(float(np.linalg.norm(now.swing)), float(np.linalg.norm(then.swing)))
        if swing is None or now.common < _UNLIKE * then.common or not _ends_alike(now.swing, then.swing):
            return None
        amplitude = math.sqrt(2.0 / len(then.swing)) * float(np.linalg.norm(then.swing))
        return swing if _stays(now, then, amplitude) else None


def _row_noise(rest: Float64s) -> float:
    """Standard deviation of a row from its differences, which texture larger than a row hardly enters."""
    return math.sqrt(0.5 * float(np.mean(np.diff(rest, axis=0) ** 2)))


def _ratio(now: float, then: float) -> float | None:
    return now / then if then > 0.0 and _LEAST < now / then < _MOST else None


def _stays(now: _Look, then: _Look, amplitude: float) -> bool:
    """True if the cells' means keep their ratios. Data changes them by different numbers of bright chips, all alike."""
    brighter = _ratio(float(now.mean.sum()), float(then.mean.sum()))
    if brighter is None:
        return False
    change = now.mean / brighter - then.mean
    if then.follow is not None:
        change = change - then.follow * (then.follow @ change) / (then.follow @ then.follow)
    allowed = max(_MOVED * amplitude, _DEVIATIONS * math.hypot(now.noise, then.noise))
    return bool(np.abs(change).max() <= allowed)


def _ends_alike(now: Float64s, then: Float64s) -> bool:
    quarter = max(len(now) // 4, 1)
    for end in (slice(quarter), slice(-quarter, None)):
        share, before = (float(one[end] @ one[end] / (one @ one)) for one in (now, then))
        if not before / _ENDS_UNLIKE < share < before * _ENDS_UNLIKE:
            return False
    return True
