"""Recognition of lights in later frames by how they looked when they were found, in plain NumPy."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.regions import Region

Float64s = npt.NDArray[np.float64]
Pixels = npt.NDArray[Any]

_CELLS, _HALVES = 8, 2  # of a box: beside and above each other
_INNER = slice(1, -1)  # without what is around the box
_SAMPLED = 64  # columns of a box
_ROWS_A_CYCLE = 16  # of a tone
_MOVED = 0.15  # change of a cell's mean that movement makes, relative to the light's amplitude
_DEVIATIONS = 4.0  # standard errors
_LEAST, _MOST = 0.7, 1.4  # ratio of amplitudes, and of means, of a light that stays the same
_GROWN = 0.4  # of its amplitude, beside the box: it shows more of itself than before
_TURNED = 0.5  # rad between the halves of a box: another frequency
_UNLIKE = 0.8  # ratio of the shares of a waveform that all cells have in common
_ENDS_UNLIKE = 4.0  # ratio of a waveform's energies in the first or last quarter of a box
_TREND = 3  # degree of the slow light beside a waveform
_PADDED = 8  # times the rows: spectrum of a waveform
_STEPS = 6  # to the place of a light
_PLACES = 32  # in a box: a smaller distance is no movement
_FLAT = 1e-3  # determinant over squared trace: means that change along one direction only


class KnownLight:
    """A light as it looked in a box (x, y, width, height) of a frame (rows, columns).

    Args:
        frequency: cycles per row; None: it sends data.
    """

    def __init__(self, pixels: Pixels, box: Region, dark: float, frequency: float | None) -> None:
        self._shape, self._box = pixels.shape, box
        self._view: _View = _Waveform(box, dark) if frequency is None else _Tone(box, dark, frequency)
        self._look = self._view.look(pixels, box)
        self._gradient = self._view.gradient(pixels, box)

    def find(self, pixels: Pixels, places: Sequence[tuple[int, int]]) -> tuple[Region, float, float | None] | None:
        """Box, swing and, of data, frequency in another frame, near the first of the places that shows the light."""
        if pixels.shape != self._shape:
            return None
        found = (self._found(pixels, self._box._replace(x=x, y=y)) for x, y in places)
        return next((one for one in found if one is not None), None)

    def _found(self, pixels: Pixels, box: Region) -> tuple[Region, float, float | None] | None:
        rows, columns = self._shape
        for _ in range(_STEPS):
            if not box.is_inside(columns, rows):
                return None
            look = self._view.look(pixels, box)
            right, down = _shift(look, self._look, self._gradient, box)
            if right == down == 0:
                swing = self._view.swing_where_alike(look, self._look)
                return None if swing is None else (box, swing, look.frequency)
            box = box._replace(x=box.x + right, y=box.y + down)
        return None


@dataclass(frozen=True, slots=True)
class _Look:
    """A box in a frame.

    Attributes:
        mean: light of the cells, DN.
        noise: standard error of a cell's mean, DN.
        swing: complex amplitudes of the cells' tone, or the waveform of all cells (rows,).
        beside: amplitude left, right, above and below the box, DN; of a waveform left and right, relative.
        common: share of the cells' swing that is this waveform; 1 for a tone.
        follow: (cells,) how much of the waveform each cell has, 1 on average.
        frequency: cycles per row of the waveform's strongest tone; None for a known tone.
    """

    mean: Float64s
    noise: float
    swing: npt.NDArray[Any]
    beside: Float64s
    common: float = 1.0
    follow: Float64s | None = None
    frequency: float | None = None


class _View(Protocol):
    def look(self, pixels: Pixels, box: Region) -> _Look: ...

    def gradient(self, pixels: Pixels, box: Region) -> Float64s | None:
        """(2, halves, cells) change of the means by a step of the box to the right and down; None: not known."""
        ...

    def swing_where_alike(self, now: _Look, then: _Look) -> float | None:
        """Amplitude relative to the reference; None if it is not the same light."""
        ...


class _Cells:
    """Every ``row_step``-th row and some columns of a box and around it, in cells of columns, the first and the last
    beside the box.

    Attributes:
        rows: those taken, 0 the first of the box.
    """

    def __init__(self, box: Region, dark: float, row_step: int = 1, above: int = 0) -> None:
        step = -(-box.width // _SAMPLED)
        inner = -(-box.width // step)
        rim = max(inner // _CELLS, 1)
        cells = max(min(_CELLS, inner // 2), 1)
        cell = np.concatenate([np.zeros(rim, int), 1 + np.arange(inner) * cells // inner, np.full(rim, cells + 1)])
        self._mean = (cell[:, None] == np.arange(cells + 2)) / np.bincount(cell)
        more = -(-above // row_step)
        self.rows = row_step * np.arange(-more, -(-box.height // row_step) + more)
        self._columns, self._dark = step * np.arange(-rim, inner + rim), dark

    def look(self, pixels: Pixels, box: Region) -> Float64s:
        """(rows, cells) mean light above dark; outside of the frame that of its edge."""
        part = _taken(_taken(pixels, box.y + self.rows).T, box.x + self._columns).T
        return np.asarray(part @ self._mean) - self._dark


def _taken(pixels: Pixels, rows: npt.NDArray[np.int64]) -> Pixels:
    """Evenly spaced rows, those outside of the frame at its edge; a view if there are none."""
    if rows[0] >= 0 and rows[-1] < len(pixels):
        return pixels[rows[0] : rows[-1] + 1 : rows[1] - rows[0] if len(rows) > 1 else 1]
    return pixels[np.clip(rows, 0, len(pixels) - 1)]


class _Tone:
    """Mean and tone of each cell in both halves of the box and in a cycle above and below it."""

    def __init__(self, box: Region, dark: float, frequency: float) -> None:
        cycle = max(round(1.0 / frequency), 1)
        self._cells = _Cells(box, dark, max(int(1.0 / (_ROWS_A_CYCLE * frequency)), 1), cycle)
        rows = self._cells.rows
        angle = 2.0 * np.pi * frequency * rows
        waves = np.stack([np.ones(len(rows)), np.cos(angle), np.sin(angle)], axis=1)
        part = np.searchsorted([0, box.height // _HALVES, box.height], rows, side="right")
        self._design = np.hstack([waves * (part == k)[:, None] for k in range(_HALVES + 2)])
        self._weights = np.linalg.pinv(self._design)
        self._spread = float(np.linalg.norm(self._weights[0::3][_INNER], axis=1).max())

    def look(self, pixels: Pixels, box: Region) -> _Look:
        rows = self._cells.look(pixels, box)
        found = self._weights @ rows
        mean, cosine, sine = found[0::3], found[1::3], found[2::3]
        swing = cosine - 1j * sine
        sides = swing[_INNER, 0], swing[_INNER, -1], swing[0, _INNER], swing[-1, _INNER]
        beside = np.array([abs(side.sum() / len(side)) for side in sides])
        noise = self._spread * _row_noise((rows - self._design @ found)[:, _INNER])
        return _Look(mean[_INNER, _INNER], noise, swing[_INNER, _INNER], beside)

    def gradient(self, pixels: Pixels, box: Region) -> Float64s:
        steps = max(box.width // (4 * _CELLS), 1), max(box.height // (8 * _HALVES), 1)
        rows, columns = pixels.shape
        slopes = []
        for step, (right, down) in zip(steps, ((1, 0), (0, 1)), strict=True):
            ends = [box._replace(x=box.x + k * right, y=box.y + k * down) for k in (-step, step)]
            inside = [end if end.is_inside(columns, rows) else box for end in ends]
            way = max(sum(step for end in inside if end != box), 1)
            before, after = (self.look(pixels, one).mean for one in inside)
            slopes.append((after - before) / way)
        return np.stack(slopes)

    def swing_where_alike(self, now: _Look, then: _Look) -> float | None:
        (upper, lower), (above, below) = now.swing.sum(axis=1).tolist(), then.swing.sum(axis=1).tolist()
        turned = cmath.phase(lower * upper.conjugate() * below.conjugate() * above)
        swing = _ratio(abs(upper + lower), abs(above + below))
        amplitude = math.sqrt(np.vdot(then.swing, then.swing).real / then.swing.size)
        if swing is None or abs(turned) > _TURNED or (now.beside - then.beside).max() > _GROWN * amplitude:
            return None
        return swing if _stays(now, then, amplitude) else None


class _Waveform:
    def __init__(self, box: Region, dark: float) -> None:
        self._cells = _Cells(box, dark)
        self._slow = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, box.height), _TREND))[0]
        self._lowest = 2 * _PADDED  # two cycles in the box

    def look(self, pixels: Pixels, box: Region) -> _Look:
        every = self._cells.look(pixels, box)
        fast = every - self._slow @ (self._slow.T @ every)
        mean, inner = every[:, _INNER].mean(axis=0), fast[:, _INNER]
        waveform = inner.mean(axis=1)
        energy = float(waveform @ waveform)
        if not energy > 0.0:
            return _Look(mean, 0.0, waveform, np.zeros(2), 0.0, np.ones(inner.shape[1]))
        follow = fast.T @ waveform / energy
        noise = _row_noise(inner - waveform[:, None] * follow[_INNER]) / math.sqrt(len(inner))
        common = inner.shape[1] * energy / float((inner**2).sum())
        return _Look(mean, noise, waveform, follow[[0, -1]], common, follow[_INNER], self._strongest(waveform))

    def gradient(self, pixels: Pixels, box: Region) -> Float64s | None:
        return None

    def _strongest(self, waveform: Float64s) -> float:
        length = _PADDED * len(waveform)
        power = np.abs(np.fft.rfft(waveform, length)) ** 2
        return float(self._lowest + power[self._lowest : -_PADDED].argmax()) / length

    def swing_where_alike(self, now: _Look, then: _Look) -> float | None:
        swing = _ratio(float(np.linalg.norm(now.swing)), float(np.linalg.norm(then.swing)))
        if swing is None or now.common < _UNLIKE * then.common or (now.beside - then.beside).max() > _GROWN:
            return None
        if not _ends_alike(now.swing, then.swing):
            return None
        amplitude = math.sqrt(2.0 / len(then.swing)) * float(np.linalg.norm(then.swing))
        return swing if _stays(now, then, amplitude) else None


def _row_noise(rest: Float64s) -> float:
    """Standard deviation of a row from its differences, which texture larger than a row hardly enters."""
    steps = (rest[1:] - rest[:-1]).ravel()
    return math.sqrt(0.5 * float(steps @ steps) / max(len(steps), 1))


def _shift(now: _Look, then: _Look, gradient: Float64s | None, box: Region) -> tuple[int, int]:
    """Columns and rows by which the light lies right of and below the box, by least squares of the cells' means."""
    if gradient is None or not (now.mean.sum() > 0.0 and then.mean.sum() > 0.0):
        return 0, 0
    slope = gradient.reshape(2, -1)
    change = (then.mean - now.mean * (then.mean.sum() / now.mean.sum())).ravel()
    (across, mixed), (_, along) = (slope @ slope.T).tolist()
    determinant = across * along - mixed * mixed
    if not determinant > _FLAT * (across + along) ** 2:
        return 0, 0
    x, y = (slope @ change / determinant).tolist()
    ways = zip((along * x - mixed * y, across * y - mixed * x), (box.width, box.height), strict=True)
    right, down = (0 if abs(way) < max(size / _PLACES, 1.0) else round(way) for way, size in ways)
    return right, down


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
