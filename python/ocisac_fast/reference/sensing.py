"""What a region shows, as the equations say it."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.reference.equalization import equalize
from ocisac_fast.reference.frequency import find_frequency
from ocisac_fast.reference.gain import tone_gain
from ocisac_fast.reference.light import linear_light
from ocisac_fast.reference.varying_tone import varying_tone_gain
from ocisac_fast.sensing.contrast import RestoredContrast
from ocisac_fast.sensing.region import BackgroundLight, SensedRegion

Float64s = npt.NDArray[np.float64]
legendre = np.polynomial.legendre


def sense_region(
    frames: npt.ArrayLike,
    camera: Camera,
    frequency: float | None = None,
    *,
    frequency_std: float = 0.0,
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    depth: float = 1.0,
    background: npt.ArrayLike | BackgroundLight | None = None,
    others: npt.ArrayLike = (),
    motion: Literal["across", "along"] | None = None,
    direction: Literal[-1, 0, 1] = 0,
    pitch: float | None = None,
    spatial_frequency: float | None = None,
    speed: float | None = None,
    bounds: tuple[float, float] | None = None,
    motion_bounds: tuple[float, float] | None = None,
    timing_tolerance: float = 1e-4,
) -> SensedRegion:
    """As :func:`ocisac_fast.sense_region`: ``numpy.linalg.lstsq`` frame by frame, frequency and turns by the roots
    of the derivative of what they maximise, motion by the roots of |still| = |c - f T_r| on its straight pieces."""
    stored = np.asarray(frames)
    stored = stored.reshape((1, -1, 1) if stored.ndim == 1 else (-1, *stored.shape[-2:]))
    light = linear_light(stored, camera)
    count, rows, columns = light.shape
    tones = list(np.atleast_1d(np.asarray(others, dtype=np.float64)) * camera.row_time)
    known = {"background_given": background is not None}
    blank = SensedRegion("unknown", 0, 0, columns, rows, count, **known)  # type: ignore[arg-type]

    if frequency is None:
        search: Any = "square" if waveform == "square" else "auto"
        found = find_frequency(
            _without(light, tones) if tones else stored, camera, bounds=bounds, waveform=search, select=False
        )
        flags, c = found.flags & ~Flag.SATURATED, found.cycles_per_row
        if flags & Flag.NO_TONE:
            return dataclasses.replace(blank, flags=flags)
    else:
        c = frequency * camera.row_time
        flags = Flag.FEW_CYCLES if c * rows < 1 else Flag(0)
    fit = _Fit(light, c, waveform, duty, tones)
    if rows < fit.unknowns + 1 or abs(2 * c - round(2 * c)) < 2e-12:
        return dataclasses.replace(blank, flags=flags | Flag.UNRESOLVABLE)
    fit.ride(background)
    if frequency is None:
        fit.search()
    fit.solve(fit.c)
    c_std = frequency_std * camera.row_time if frequency is not None else fit.c_std()

    across, onward = _turn(fit.z.T, fit.variance()), _turn(fit.z, fit.variance())
    kind, axis, kind_flags = _kind(fit, c_std, across, onward, camera, motion, timing_tolerance)
    told = (pitch, spatial_frequency, speed, direction, motion_bounds or (0.0, 0.5 / camera.row_time), timing_tolerance)
    facts = _motion(kind, axis, fit.c, c_std, across, onward, camera, told)
    ratio = (1.0 if waveform == "tone" else 2 * np.sinc(duty)) * depth
    gain, gain_std, mean, snr = _gain(fit, background, c_std)
    series = _over_frames(fit, onward[0])
    course = _gain(series, _repeated(background, rows, count, columns), 0.0) if series else (math.nan, math.nan)
    kind = facts["kind"]
    at = {"light": fit.c / camera.row_time, "still": 0.0}.get(kind, facts.get("motion_frequency", math.nan))
    theory = math.nan if camera.exposure is None else abs(float(np.sinc(at * camera.exposure)))
    flags |= kind_flags | facts.pop("flags") | _flags(stored[0], camera, fit, tones)
    flags |= Flag.NEAR_NULL if theory < 0.05 else Flag(0)
    flags |= Flag.NO_LIGHT if math.isnan(gain) else Flag.WEAK if gain < 3 * gain_std else Flag(0)
    return dataclasses.replace(
        blank,
        frequency=fit.c / camera.row_time,
        frequency_std=c_std / camera.row_time,
        cycles_per_column=across[0],
        cycles_per_column_std=across[1],
        cycles_per_frame=onward[0],
        cycles_per_frame_std=onward[1],
        gain=gain / ratio,
        gain_std=gain_std / ratio,
        frames_gain=course[0] / ratio,
        frames_gain_std=course[1] / ratio,
        theory=theory,
        contrast=gain,
        contrast_range=fit.contrast_range(),
        mean=mean,
        snr=snr / ratio**2,
        flags=flags,
        **facts,
    )


def background_light(
    frames: npt.ArrayLike, camera: Camera, tones: npt.ArrayLike = (), *, pooled: bool = False
) -> BackgroundLight:
    """As :func:`ocisac_fast.background_light`."""
    stored = np.asarray(frames)
    light = linear_light(stored.reshape((1, -1, 1) if stored.ndim == 1 else (-1, *stored.shape[-2:])), camera)
    fit = _Fit(light, 0.0, "tone", 0.5, list(np.atleast_1d(np.asarray(tones, float)) * camera.row_time))
    fit.harmonics, fit.degree = [], 0
    fit.solve(0.0)
    columns = fit.theta[:, 0].mean(axis=0)
    std = np.sqrt(fit.noise.mean(axis=0) * fit.covariance[0, 0] / len(light))
    if not pooled:
        return BackgroundLight(columns, std)
    spread = columns.std(ddof=1) / np.sqrt(columns.size) if columns.size > 1 else std[0]
    return BackgroundLight(np.asarray(columns.mean()), np.asarray(spread))


def _cosines(c: float, u: Float64s) -> Float64s:
    turns = np.longdouble(c) * u
    angle = 2 * np.pi * (turns - np.rint(turns)).astype(float)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _without(light: Float64s, tones: list[float]) -> Float64s:
    """Light less the tones that are fitted beside a parabola."""
    u = np.arange(light.shape[1]) - (light.shape[1] - 1) / 2
    waves = np.hstack([_cosines(t, u) for t in tones])
    design = np.hstack([legendre.legvander(2 * u / len(u), 2), waves])
    return np.stack([frame - waves @ np.linalg.lstsq(design, frame, rcond=None)[0][3:] for frame in light])


class _Fit:
    """Slow light, harmonics of c and other tones in every column of every frame."""

    def __init__(self, light: Float64s, c: float, waveform: str, duty: float, tones: list[float]) -> None:
        rows = light.shape[1]
        self.light, self.c, self.tones = light, c, tones
        self.u = np.arange(rows) - (rows - 1) / 2
        self.degree = 0 if c * rows < 2 else 1 if c * rows < 4 else 2 if c * rows < 8 else 4
        self.harmonics = [1]
        if waveform == "square":
            above = [h for h in range(2, 4 * rows) if h * c < 0.5 - 1 / rows and abs(np.sinc(h * duty)) > 1e-9]
            self.harmonics += above[: max(0, rows // 4 - 4)]
        self.unknowns = self.degree + 1 + 2 * (len(self.harmonics) + len(tones))
        self.steering = list(self.harmonics)
        self.shape = np.ones(rows)

    def design(self, c: float, also: float = 0.0) -> Float64s:
        """Columns of the model; the steering harmonics at c + also."""
        trend = legendre.legvander(2 * self.u / len(self.u), self.degree)
        waves = [_cosines(h * (c + also * (h in self.steering)), self.u) for h in self.harmonics]
        waves += [_cosines(t, self.u) for t in self.tones]
        return np.hstack([trend, *(self.shape[:, None] * wave for wave in waves)])

    def ride(self, background: npt.ArrayLike | BackgroundLight | None) -> None:
        """From here on the waves are as bright along the rows as the slow light of the whole region."""
        dark = background.mean if isinstance(background, BackgroundLight) else 0.0 if background is None else background
        for _ in range(3 if self.degree else 0):
            self.solve(self.c)
            slow = legendre.legval(2 * self.u / len(self.u), self.theta[:, : self.degree + 1].mean(axis=(0, 2)))
            slow = slow - np.mean(np.asarray(dark, dtype=np.float64))
            if not slow.min() > 0.1 * slow.mean():
                return
            change = np.abs(slow / slow.mean() - self.shape).max()
            self.shape = slow / slow.mean()
            if change < 1e-3:
                return

    def solve(self, c: float) -> None:
        """Everything at c."""
        design = self.design(c)
        self.c = c
        self.theta = np.stack([np.linalg.lstsq(design, frame, rcond=None)[0] for frame in self.light])
        self.residual = self.light - design @ self.theta
        self.noise = (self.residual**2).sum(axis=1) / (len(self.u) - design.shape[1])
        self.covariance = np.linalg.pinv(design.T @ design)
        first = self.degree + 1
        if self.harmonics:
            self.z = self.theta[:, first] - 1j * self.theta[:, first + 1]

    def slope(self) -> Float64s:
        """Derivative of the design by c, by central differences, less what the design itself can make."""
        step = 1e-5 / len(self.u) / max(self.steering)
        slope = (self.design(self.c, step) - self.design(self.c, -step)) / (2 * step)
        design = self.design(self.c)
        return np.asarray(slope - design @ np.linalg.lstsq(design, slope, rcond=None)[0])

    def pull(self, c: float) -> float:
        """Half the derivative of the residual by the frequency of the steering harmonics."""
        self.solve(c)
        return float(((self.slope() @ self.theta) * self.residual).sum())

    def search(self) -> None:
        """The harmonics that stand out of the noise, then the frequency that they point to."""
        self.solve(self.c)
        energy = (self.theta**2).sum(axis=(0, 2))
        chance = self.noise.sum() * np.diagonal(self.covariance) * (1 + max(1, 4 / math.sqrt(self.noise.size)))
        places = {h: self.degree + 1 + 2 * k for k, h in enumerate(self.harmonics)}
        self.steering = [h for h, p in places.items() if h == 1 or energy[p : p + 2].sum() > chance[p : p + 2].sum()]
        reach = 0.05 / len(self.u) / max(self.steering)
        before, c = self.c - reach, self.c
        pull_before = self.pull(before)
        for _ in range(12):  # the secant method: the pull is all but a straight line
            pull = self.pull(c)
            if pull == pull_before or abs(c - before) * len(self.u) < 1e-11:
                break
            before, pull_before, c = c, pull, c - pull * (c - before) / (pull - pull_before)
        self.c = c

    def c_std(self) -> float:
        """Of white noise, or of noise that the columns of a row share."""
        slope = self.slope()
        force = slope @ self.theta
        feigned = self.noise.sum() * np.trace(slope.T @ slope @ self.covariance)
        stiffness = (force**2).sum() - feigned
        rows, unknowns = self.design(self.c).shape
        if not stiffness > 0:
            return math.nan
        shared = ((force * self.residual).sum(axis=2) ** 2).sum() * rows / (rows - unknowns)
        return float(np.sqrt(max(shared, self.noise.mean() * stiffness)) / stiffness)

    def variance(self) -> float:
        """Of a part of z."""
        first = self.degree + 1
        return float(self.noise.mean() * np.diagonal(self.covariance)[first : first + 2].mean())

    def contrast_range(self) -> float:
        """Median over up to 64 columns of the first frame."""
        columns = np.linspace(0, self.light.shape[2] - 1, min(self.light.shape[2], 64)).round().astype(int)
        first, last = self.degree + 1, self.degree + 1 + 2 * len(self.harmonics)
        theta = self.theta[0][:, columns]
        shown = theta[0] + self.design(self.c)[:, first:last] @ theta[first:last]
        top, bottom = shown.max(axis=0), shown.min(axis=0)
        return float(np.median((top - bottom) / (top + bottom)))


def _turn(z: npt.NDArray[np.complex128], variance: float) -> tuple[float, float]:
    """Advance per step that maximises the power of the sums of z turned back, and its standard error."""
    steps = len(z)
    if steps < 2:
        return math.nan, math.nan
    place = np.arange(steps) - (steps - 1) / 2

    def back(turn: float) -> npt.NDArray[np.complex128]:
        return np.asarray(z * np.exp(-2j * np.pi * turn * place)[:, None])

    def rise(turn: float) -> float:
        still = back(turn)
        return float((np.conj(still.sum(axis=0)) * (place @ still)).imag.sum())

    grid = np.arange(8 * steps) / (8 * steps) - 0.5
    best = float(grid[np.argmax([(np.abs(back(t).sum(axis=0)) ** 2).sum() for t in grid])])
    low, high = best - 0.2 / steps, best + 0.2 / steps
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rise(middle) > 0 else (low, middle)
    still = back(low)
    mean = still.mean(axis=0)
    freedom = z.size - z.shape[1] - 1
    across = (still * np.conj(mean) / np.abs(mean)).imag
    noise = max(variance, (across**2).sum() / freedom if freedom > 0 else 0.0)
    std = np.sqrt(noise / ((place**2).sum() * (np.abs(mean) ** 2).sum())) / (2 * np.pi)
    return low - math.ceil(low - 0.5), float(std)


def _kind(
    fit: _Fit,
    c_std: float,
    across: tuple[float, float],
    onward: tuple[float, float],
    camera: Camera,
    motion: str | None,
    tolerance: float,
) -> tuple[Any, str | None, Flag]:
    """By the spread of the phases over the columns, and by the advance from frame to frame."""
    frames, columns = fit.z.shape
    spread, significant = 0.0, False
    freedom = frames * (columns - 1)
    if freedom and fit.z.any():
        aligned = fit.z * np.exp(-1j * np.angle(fit.z.sum(axis=1)))[:, None]
        beyond = (aligned.imag**2).sum() / freedom - fit.variance()
        significant = beyond > 4 * fit.variance() * math.sqrt(2 / freedom)
        power = np.abs(fit.z) ** 2
        spread = math.sqrt(max(beyond, 0) / power.mean()) + (power * (aligned.real < 0)).sum() / power.sum()
    common = not (significant and spread > 0.1)
    unsure = not across[1] * columns < 1 / 16
    doubt = common and (unsure or (abs(across[0]) > 5 * across[1] and spread > 0.02))
    if camera.frame_time is not None and not math.isnan(onward[0]):
        rate = camera.frame_time / camera.row_time
        error = 4 * math.sqrt(onward[1] ** 2 + (c_std * rate) ** 2) + tolerance * fit.c * rate + 1e-6
        miss = abs((onward[0] - fit.c * rate + 0.5) % 1 - 0.5)
        still = abs(onward[0]) <= 4 * onward[1] + 1e-6
        if error < 0.25 and onward[1] < 0.06 and not (still and miss <= error):
            if still:
                return "still", "along", Flag(0)
            if miss > max(error, 10 * tolerance * fit.c * rate):
                return "moving", "along", Flag.MODEL_MISFIT if motion == "across" else Flag(0)
            if common:
                return "light", None, Flag.AMBIGUOUS_KIND if doubt or miss > error else Flag(0)
            vague = miss > error and motion != "across"
            return "moving", "across", Flag.AMBIGUOUS_MOTION if vague else Flag(0)
    if not common:
        return "moving", motion, Flag(0) if motion else Flag.AMBIGUOUS_KIND
    if motion == "along" or (motion == "across" and doubt):
        return "moving", motion, Flag.AMBIGUOUS_KIND if doubt else Flag(0)
    return "light", None, Flag.AMBIGUOUS_KIND


def _motion(
    kind: str,
    axis: str | None,
    c: float,
    c_std: float,
    across: tuple[float, float],
    onward: tuple[float, float],
    camera: Camera,
    told: tuple[Any, ...],
) -> dict[str, Any]:
    """Fields that tell of the motion."""
    pitch, texture, speed, *_ = told
    time = camera.row_time
    if kind == "still":
        assert camera.frame_time is not None
        f, std, every, flags = _along(c, c_std, onward, camera, told)
        if math.isnan(f) or abs(f) <= 4 * std + 1e-6 / camera.frame_time:
            facts = {"kind": kind, "motion_frequency": 0.0, "motion_frequency_std": onward[1] / camera.frame_time}
            return facts | {"motion_candidates": every, "speed": 0.0, "flags": flags}
        kind = "moving"
    if kind != "moving":
        return {"kind": kind, "flags": Flag(0)}
    if axis == "along":
        f, std, every, flags = _along(c, c_std, onward, camera, told)
        still = c - f * time
        cycles, cycles_std = abs(still), math.hypot(c_std, std * time)
        heading = 0 if not f * still else -1 if f * still > 0 else 1
    else:
        f, std, every = c / time, c_std / time, (c / time,)
        flags = Flag.AMBIGUOUS_MOTION if axis is None else Flag(0)
        (cycles, cycles_std), heading = (abs(across[0]), across[1]), 0
        if cycles > 4 * cycles_std:
            heading = -1 if across[0] > 0 else 1
    f = abs(f)
    facts = {"kind": kind, "motion_frequency": f, "motion_frequency_std": std, "motion_candidates": every}
    facts |= {"direction": heading, "flags": flags}
    if texture is None and speed is not None:
        names = ("speed", "speed_std", "spatial_frequency", "spatial_frequency_std")
        return facts | dict(zip(names, (speed, 0.0, f / speed, std / speed), strict=True))
    if texture is None and pitch is None:
        return facts
    texture, texture_std = (texture, 0.0) if texture is not None else (cycles / pitch, cycles_std / pitch)
    facts |= {"spatial_frequency": texture, "spatial_frequency_std": texture_std}
    found = f / texture
    return facts | {"speed": found, "speed_std": math.hypot(std / texture, found * texture_std / texture)}


def _along(
    c: float, c_std: float, onward: tuple[float, float], camera: Camera, told: tuple[Any, ...]
) -> tuple[float, float, tuple[float, ...], Flag]:
    """Signed f_x v of motion along the rows, standard error, all that fit, and flags."""
    pitch, texture, speed, direction, (low, high), tolerance = told
    time, frame_time = camera.row_time, camera.frame_time
    framed = frame_time is not None and not math.isnan(onward[0])
    flags = Flag(0)
    constrained = pitch is not None and (texture is not None or speed is not None)
    if constrained:
        found = list(zip(_roots(c, time, told), (abs(r) for r in _root_slopes(c, time, told)), strict=True))
        found = [(f, c_std * slope) for f, slope in found]
    elif framed:
        assert frame_time is not None
        found = [((onward[0] + k) / frame_time, onward[1] / frame_time) for k in range(-2000, 2001)]
        found = [one for one in found if low <= abs(one[0]) <= high]
    else:
        found = []
    if constrained and framed:
        assert frame_time is not None
        fine = onward[1] / frame_time
        kept, nearest = [], []
        for f, std in found:
            reach = 4 * math.hypot(std, fine) + tolerance * abs(f)
            ladder = [(onward[0] + k) / frame_time for k in range(-3000, 3001)]
            kept += [(step, fine) for step in ladder if abs(step - f) <= reach]
            nearest.append(min((abs(step - f) / reach, step) for step in ladder))
        if not kept:
            flags, kept = Flag.MODEL_MISFIT, [(min(nearest)[1], fine)]
        found = list(set(kept))

    def heads(f: float) -> int:
        return -1 if f * (c - f * time) > 0 else 1

    inside = [one for one in found if low <= abs(one[0]) <= high]
    allowed = [one for one in inside if direction in (0, heads(one[0])) or abs(one[0]) <= 4 * one[1]]
    allowed.sort(key=lambda one: (abs(one[0]), one[0]))
    if not allowed:
        return math.nan, math.nan, (), Flag.MODEL_MISFIT if found else Flag.AMBIGUOUS_MOTION
    if len(allowed) > 1:
        flags |= Flag.AMBIGUOUS_MOTION
    return (*allowed[0], tuple(abs(f) for f, _ in allowed[:16]), flags)


def _roots(c: float, time: float, told: tuple[Any, ...]) -> list[float]:
    """Where the cycles per row of the texture at rest, |c - f T_r|, are f_x times the pitch, or |f| times it over v."""
    pitch, texture, speed, *_ = told

    def excess(f: float) -> float:
        return float(abs(c - f * time) - (texture * pitch if texture is not None else abs(f) * pitch / speed))

    roots = []
    far = 1e4 * c / time
    bends = sorted({-far, 0.0, c / time, far})
    for start, end in itertools.pairwise(bends):
        a, b = excess(start), excess(end)
        if a * b < 0:
            roots.append(start + (end - start) * a / (a - b))
    return roots


def _root_slopes(c: float, time: float, told: tuple[Any, ...]) -> list[float]:
    """Derivatives of the roots by c."""
    step = 1e-4 * c
    up, down = (_roots(c + side * step, time, told) for side in (1, -1))
    return [(a - b) / (2 * step) for a, b in zip(up, down, strict=True)]


def _repeated(background: Any, rows: int, count: int, columns: int) -> Any:
    """Background of columns as that of every pixel of a frame, the mean over the frames."""

    def pixels(values: Any) -> Any:
        values = np.asarray(values, dtype=float)
        return np.tile(np.broadcast_to(values, (count, columns)).mean(axis=0), rows) if values.ndim else values

    if isinstance(background, BackgroundLight):
        return BackgroundLight(pixels(background.mean), pixels(background.std))
    return None if background is None else pixels(background)


def _gain(fit: _Fit, background: Any, c_std: float) -> tuple[float, float, float, float]:
    """Amplitude over mean, pooled; its standard error by the delta method, the gradient by central differences."""
    measured = isinstance(background, BackgroundLight)
    ambient = np.asarray(background.mean if measured else 0.0 if background is None else background, dtype=float)
    doubt = np.asarray(background.std if measured else 0.0, dtype=float)
    first = fit.degree + 1
    pick = [0, first, first + 1]
    c = fit.covariance[np.ix_(pick, pick)]
    theta = fit.theta[:, pick]  # (frames, 3, columns)
    taken_light = (fit.noise * c[0, 0] + doubt**2).sum()
    taken_power = (fit.noise * (c[1, 1] + c[2, 2])).sum()

    def square(values: Float64s, level: Float64s) -> float:
        power = (values[:, 1] ** 2 + values[:, 2] ** 2).sum() - taken_power
        return float(power / (((values[:, 0] - level) ** 2).sum() - taken_light))

    mean = float((theta[:, 0] - ambient).mean())
    if not (mean > 0 and ((theta[:, 0] - ambient) ** 2).sum() > taken_light):
        return math.nan, math.nan, mean, math.nan
    gain2 = max(square(theta, ambient), 0.0)
    light = ((theta[:, 0] - ambient) ** 2).sum() - taken_light
    by = 2 * np.stack([-gain2 * (theta[:, 0] - ambient), theta[:, 1], theta[:, 2]], axis=1) / light
    variance = float(np.einsum("jk,jak,ab,jbk->", fit.noise, by, c, by))
    by_ambient = by[:, 0] * doubt
    variance += float(by_ambient.sum() ** 2 if ambient.ndim == 0 else (by_ambient.sum(axis=0) ** 2).sum())
    if c_std:
        step = 1e-6 / len(fit.u)
        moved = []
        for side in (1, -1):
            design = fit.design(fit.c, side * step)
            clean = fit.design(fit.c) @ fit.theta
            moved.append(np.stack([np.linalg.lstsq(design, frame, rcond=None)[0] for frame in clean])[:, pick])
        variance += ((square(moved[0], ambient) - square(moved[1], ambient)) / (2 * step) * c_std) ** 2
    chance = (fit.noise**2).sum() * 2 * (c[1:, 1:] ** 2).sum() / light**2
    total = variance + chance
    gain = math.sqrt(gain2)
    std = math.sqrt(total) / (2 * gain) if gain2**2 > total else total**0.25
    power = max((theta[:, 1:] ** 2).sum() - taken_power, 0.0)
    return gain, std, mean, float(power / fit.noise.size / fit.noise.mean())


def _over_frames(fit: _Fit, advance: float) -> _Fit | None:
    """Every pixel's course over the frames, harmonics and other tones taken off."""
    count, rows, columns = fit.light.shape
    if not (count >= 6 and abs(advance) * count >= 1 and (0.5 - abs(advance)) * count >= 0.5):
        return None
    beside = fit.degree + 3
    clean = fit.light - fit.design(fit.c)[:, beside:] @ fit.theta[:, beside:]
    course = _Fit(clean.reshape(1, count, rows * columns), abs(advance), "tone", 0.5, [])
    course.degree = 0
    course.solve(abs(advance))
    return course


def _flags(frame: npt.NDArray[Any], camera: Camera, fit: _Fit, tones: list[float]) -> Flag:
    """What at least half of up to 64 columns carry; saturation in a tenth."""
    timing = dataclasses.replace(camera, exposure=None)
    columns = frame[:, :: max(1, frame.shape[1] // 64)]
    every = np.array([fit.c, *tones]) / camera.row_time
    waveform: Any = "square" if len(fit.harmonics) > 1 and not tones else "tone"
    masks = tone_gain(columns, timing, every, waveform=waveform).flags[0]
    if not tones:
        masks = masks | varying_tone_gain(columns, timing, every[0], waveform=waveform).flags
    flags = Flag(0)
    for bit in Flag:
        least = 0.1 if bit == Flag.SATURATED else 0.5
        if np.mean((masks & bit) != 0) >= least:
            flags |= bit
    return flags & ~(Flag.WEAK | Flag.NO_LIGHT | Flag.NEAR_NULL | Flag.FEW_CYCLES)


def restore_contrast(
    columns: npt.ArrayLike,
    camera: Camera,
    frequency: float,
    method: Literal["inverse", "wiener"] = "inverse",
    noise: npt.ArrayLike | None = None,
    *,
    max_boost: float = 10.0,
    depth: float = 1.0,
) -> RestoredContrast:
    """As :func:`ocisac_fast.restore_contrast`, of the reference's equaliser and gains; ``snr_after`` of ``"wiener"`` is
    NaN here."""
    stored = np.asarray(columns)
    exposure = camera.exposure or math.nan
    plain = Camera(camera.row_time, camera.exposure)
    rows = stored.shape[0] if stored.ndim == 1 else stored.shape[-2]
    ends = min(math.ceil(2 * exposure / camera.row_time), rows // 4)

    def middle(light: Float64s) -> Float64s:
        return light[ends : rows - ends] if light.ndim == 1 else light[..., ends : rows - ends, :]

    before = sense_region(stored, camera, frequency, depth=depth)
    restored = equalize(stored, camera, method, noise, max_boost=max_boost)
    after = sense_region(middle(restored), plain, frequency, depth=depth)
    h2 = float(np.sinc(frequency * exposure)) ** 2
    theory = expected = noise_gain = math.nan
    if method == "inverse":
        h = np.sinc(np.linspace(0, 0.5 / camera.row_time, 1 << 16) * exposure)
        noise_gain = math.sqrt(np.mean((h / np.maximum(h**2, max_boost**-2)) ** 2))
        theory = h2 / max(h2, max_boost**-2)
        n = np.arange(rows)[:, None] * camera.row_time - exposure / 2
        texture = 1 + np.sinc(frequency * exposure) * np.cos(2 * np.pi * (frequency * n + np.arange(16) / 16))
        expected = sense_region(middle(equalize(texture, plain, max_boost=max_boost)), plain, frequency).gain
    power = before.snr * depth**2  # amplitude^2 / noise^2
    row_noise = before.contrast * before.mean / math.sqrt(power) if power > 0 else linear_light(stored, camera).std()
    loudness = noise_gain * (0.0 if math.isinf(power) else row_noise)
    relative = min(before.gain_std / before.gain, 1.0) if before.gain > 0 else 1.0
    std = max(after.gain_std, after.gain * relative * math.sqrt(rows / (rows - 2 * ends)))
    flags = before.flags & (Flag.NEAR_NULL | Flag.SATURATED | Flag.NO_LIGHT | Flag.FEW_CYCLES | Flag.UNRESOLVABLE)
    flags |= Flag(0) if after.gain > 3 * std else Flag.WEAK
    snr = math.inf if loudness == 0 else 0.5 * (after.contrast * after.mean / loudness) ** 2
    return RestoredContrast(
        before.gain, before.gain_std, after.gain, std, theory, expected, 0.5 * power, snr, restored, flags
    )
