"""Exact exposure integrals of moving patterns with sharp edges."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.waveforms import Constant, Waveform, integrate_exposure
from ocisac_fast.scene.geometry import Array
from ocisac_fast.scene.objects import Grating, Picture

_FEW_CELLS = 8.0


@dataclass(frozen=True)
class Profile:
    """One period of a pattern in cells of constant level."""

    edges: Array  # (cells + 1,) from 0 to 1
    levels: Array  # (lines, cells)
    offset: float  # phase of the pattern at edge 0 is -offset

    @classmethod
    def of(cls, pattern: Grating | Picture) -> Profile:
        if isinstance(pattern, Grating):
            edges = np.array([0.0, pattern.duty, 1.0])
            return cls(edges, np.array([[pattern.high, pattern.low]]), pattern.duty / 2)
        return cls(np.linspace(0, 1, pattern.levels.shape[1] + 1), np.asarray(pattern.levels), 0.0)

    @property
    def means(self) -> Array:
        """(lines,) mean levels."""
        return np.asarray(self.levels @ np.diff(self.edges))

    @property
    def rise(self) -> float:
        """Sum of the upward steps in a period, equal to that of the downward steps; maximum over the lines."""
        return float(np.abs(self.levels - np.roll(self.levels, 1, axis=1)).sum(axis=1).max()) / 2

    @property
    def spread(self) -> float:
        """Range of the antiderivative of level - mean, in periods; maximum over the lines."""
        sums = np.cumsum((self.levels - self.means[:, np.newaxis]) * np.diff(self.edges), axis=1)
        return float(np.ptp(np.concatenate([np.zeros((len(sums), 1)), sums], axis=1), axis=1).max())

    def cell_of(self, place: Array) -> npt.NDArray[np.int64]:
        """Cell indices from the pattern's edge 0, counted across whole periods."""
        whole = np.floor(place)
        inside = np.searchsorted(self.edges, place - whole, side="right") - 1
        cells = self.levels.shape[1]
        return np.asarray(whole.astype(np.int64) * cells + inside.clip(0, cells - 1))


class Light:
    """Antiderivative of a waveform from the beginning of a frame's first exposure, linear between grid points."""

    def __init__(self, waveform: Waveform, camera: Camera, rows: int, steps: int, start: float, frame: int) -> None:
        assert camera.exposure is not None
        self._exposure = camera.exposure
        self._level = waveform.level if isinstance(waveform, Constant) else None
        if self._level is None:
            step = camera.exposure / steps
            count = steps + math.ceil(rows * camera.row_period / step) + 1
            grid = Camera(step, step, camera.frame_time)
            frames = [frame] if frame else None
            numbers = np.arange(1, count + 1) - steps
            light = np.ravel(integrate_exposure(waveform, grid, numbers, start=start, frames=frames))
            self._step, self._sums = step, np.concatenate([[0.0], np.cumsum(light * step)])

    def until(self, time: Array) -> Array:
        """Integral of the light up to a time (s) after the end of row 0's exposure."""
        if self._level is not None:
            return np.asarray(self._level * time)
        place = (time + self._exposure) / self._step
        index = place.astype(np.int64).clip(0, len(self._sums) - 2)
        low = self._sums[index]
        return np.asarray(low + (place - index) * (self._sums[index + 1] - low))

    @property
    def level(self) -> float | None:
        return self._level


def expose_profile(
    profile: Profile,
    line: npt.NDArray[np.int64],
    phase: Array,
    shift: float,
    rate: float,
    end: Array,
    exposure: float,
    light: Light,
) -> Array:
    """Mean of light * pattern over exposures, eq. 4 for a product.

    Args:
        profile: the pattern.
        line: its line for each value.
        phase, shift: of the pattern in periods; at time t it is phase - shift - rate * t.
        rate: Hz, not 0.
        end: of each exposure, s after time 0.
        exposure: s.
        light: of the source, from the same time 0.
    """
    line, phase, end = np.broadcast_arrays(line, phase + (profile.offset - shift), end)
    speed = abs(rate)
    place = -phase if rate > 0 else phase
    turned = Profile(1 - profile.edges[::-1], profile.levels[:, ::-1], 0.0) if rate > 0 else profile
    if light.level is not None and speed * exposure * len(turned.edges) > _FEW_CELLS:
        first, last = place + speed * (end - exposure), place + speed * end
        return np.asarray(light.level * (_area(turned, line, last) - _area(turned, line, first)) / (speed * exposure))
    cells = turned.levels.shape[1]
    cell = turned.cell_of(place + speed * (end - exposure))
    time = end - exposure
    before = light.until(time)
    total = np.zeros(np.shape(end))
    while (time < end).any():
        edge = cell // cells + turned.edges[cell % cells + 1]
        time = np.minimum(np.maximum((edge - place) / speed, time), end)
        after = light.until(time)
        total += turned.levels[line, cell % cells] * (after - before)
        cell, before = cell + 1, after
    return np.asarray(total / exposure)


def _area(profile: Profile, line: npt.NDArray[np.int64], place: Array) -> Array:
    """Integral of a line from edge 0 to a position in periods."""
    cells = profile.levels.shape[1]
    cell = profile.cell_of(place)
    inside = cell % cells
    sums = np.zeros(profile.levels.shape)
    sums[:, 1:] = np.cumsum(profile.levels * np.diff(profile.edges), axis=1)[:, :-1]
    part = profile.levels[line, inside] * (place - np.floor(place) - profile.edges[inside])
    return np.asarray(np.floor(place) * profile.means[line] + sums[line, inside] + part)
