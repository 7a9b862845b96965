"""Selection of the terms of a scene that are computed: `Scene.plan`.

Every light on a patch of pixels (a term) is computed, or replaced by a cheaper one with a bounded error. A waveform of
cosines a_i at f_i contributes |a_i| * |sinc(f_i T_e)| of each after the exposure; a waveform of range [low, high] is
within (high - low)/2 of its middle; a pattern displaced by s periods is wrong over the edges that it passes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.checks import Count, Finite, Positive, checked, checked_class
from ocisac_fast.core.results import Result
from ocisac_fast.light.waveforms import Constant, Waveform
from ocisac_fast.scene.blur import left_out, spread, widened
from ocisac_fast.scene.course import Course, course
from ocisac_fast.scene.description import SceneDescription
from ocisac_fast.scene.geometry import Array
from ocisac_fast.scene.objects import Cosine
from ocisac_fast.scene.patches import Patch, lens_at, patches
from ocisac_fast.scene.profile import Profile
from ocisac_fast.scene.signals import PixelProfile, ProfileTable, RowSignal
from ocisac_fast.scene.terms import Moving, Term, levels_at, terms

_DROPPING_SHARE = 0.7  # of the tolerance, for replaced terms; the rest is for tables
_ROUNDING = 1e-6  # of the light: float32 gains, tables and sums
_MAX_PHASES = 65535
_MAX_STEPS = 1 << 17


@dataclass(frozen=True, repr=False)
class Part(Result):
    """Treatment of one term by a plan.

    Attributes:
        name: of the term.
        kept: text: the part computed in each frame; empty: nothing.
        dropped: text: the neglected part; empty: nothing.
        bound: bound on the error of this part in a pixel, DN.
        pixels: number of pixels of the term.
    """

    name: str
    kept: str
    dropped: str
    bound: float
    pixels: int

    def __str__(self) -> str:
        words = [f"keeps {self.kept}" if self.kept else "constant"]
        if self.dropped:
            words.append(f"drops {self.dropped}")
        return f"{self.name} ({self.pixels} pixels): {', '.join(words)}; error up to {self.bound:.3g} DN"


@dataclass(frozen=True, repr=False, eq=False)
class Plan(Result):
    """Computation of `render`.

    Attributes:
        scene: its scene.
        tolerance: requested tolerance, DN.
        bound: bound on the error of linear light v in every pixel of every frame, DN. It exceeds the tolerance only if
            that cannot be reached: rounding to float32, or light with edges on patterns with edges. For a moving
            camera, which is planned again at each frame, it is the bound of frame 0.
        parts: computed and neglected parts, term by term.
        changing_pixels: number of pixels computed in each frame.
        frames, start: range of validity.
    """

    scene: SceneDescription
    tolerance: float
    bound: float
    parts: tuple[Part, ...]
    changing_pixels: int
    frames: int
    start: float
    _base: npt.NDArray[np.float32] | None = field(repr=False)  # steady light (DN above dark); None: none
    _kept: tuple[tuple[_core.ScenePart, RowSignal | ProfileTable], ...] = field(repr=False)
    _by_pixel: tuple[PixelProfile, ...] = field(repr=False)

    def __str__(self) -> str:
        head = f"within {self.tolerance:.3g} DN over {self.frames} frames: error up to {self.bound:.3g} DN"
        pixels = self.scene.lens.rows * self.scene.lens.columns
        head += f"; {self.changing_pixels} of {pixels} pixels change"
        return "\n".join([head, *(f"  {part}" for part in self.parts)])


@dataclass(frozen=True)
class _Option:
    """A cheaper replacement of a term."""

    bound: float  # DN
    dropped: str
    waveform: Waveform | float  # a number: steady
    moving: Moving | None
    factor: Array | float = 1.0  # on the gains


@dataclass
class _Drawing:
    """A plan under construction."""

    scene: SceneDescription
    start: float
    middle: float  # s, of the time span of the plan
    half: float  # s, from its middle to its ends
    base: npt.NDArray[np.float32] | None = None
    kept: list[tuple[_core.ScenePart, RowSignal | ProfileTable]] = field(default_factory=list)
    by_pixel: list[PixelProfile] = field(default_factory=list)


@checked_class
@dataclass(frozen=True)
class Scene(SceneDescription):
    __doc__ = SceneDescription.__doc__

    @checked
    def plan(
        self, *, tolerance: Positive = 0.5, unit: Literal["DN", "noise"] = "DN", frames: Count = 1, start: Finite = 0.0
    ) -> Plan:
        """Select the terms to compute so that every pixel is within ``tolerance`` of the full model.

        Args:
            tolerance: largest error of linear light v, before saturation, tone curve and rounding; above 0.
            unit: of the tolerance: ``"DN"``, or ``"noise"``: standard deviations of the noise in the dark.
            frames: number of frames that the plan covers.
            start: end of the exposure of row 0 of frame 0, s.
        """
        if frames > 1 and self.camera.frame_time is None:
            message = "frame_time: got None, allowed: the frame time of the camera in seconds, needed for frames"
            raise ValueError(message)
        span = tolerance * _noise(self) if unit == "noise" else float(tolerance)
        return plan_at(self, span, frames, start, 0)


def plan_at(scene: SceneDescription, tolerance: float, frames: int, start: float, frame: int) -> Plan:
    """A plan with the lens at its position in a frame."""
    frame_time = scene.camera.frame_time or 0.0
    moving_lens = any(scene.lens.velocity)
    lens = lens_at(scene, start + frame * frame_time)
    first, last = (frame, frame) if moving_lens else (0, frames - 1)
    begin = start + first * frame_time - scene.exposure - scene.sensor.frame_jitter
    end = start + last * frame_time + (scene.lens.rows - 1) * scene.camera.row_period + scene.sensor.frame_jitter
    drawing = _Drawing(scene, start, (begin + end) / 2, (end - begin) / 2)
    parts: list[Part] = []
    bound, changing = 0.0, 0
    for patch in patches(scene, widened(lens)):
        of_patch, error = _plan_patch(drawing, patch, tolerance)
        parts += of_patch
        bound = max(bound, error)
        changing += of_patch[0].pixels if any(part.kept for part in of_patch) else 0
    changing = min(changing, lens.rows * lens.columns)  # patches of a blurred picture overlap
    work = (drawing.base, tuple(drawing.kept), tuple(drawing.by_pixel))
    return Plan(scene, tolerance, bound, tuple(parts), changing, frames, start, *work)


def _noise(scene: SceneDescription) -> float:
    """Noise in the dark, DN."""
    sensor = scene.sensor
    if not sensor.read_noise or sensor.full_well is None:
        raise ValueError("unit: got 'noise', allowed: 'DN' for a sensor without read noise")
    return sensor.read_noise * (scene.white_level - scene.camera.dark_level) / sensor.full_well


def _plan_patch(drawing: _Drawing, patch: Patch, tolerance: float) -> tuple[list[Part], float]:
    every = [term for term in terms(drawing.scene, patch) if term.gains.any()]
    light = sum(term.gains.max() * course(term.waveform, drawing.scene.exposure).most for term in every)
    rounding = (_ROUNDING + left_out(drawing.scene.lens)) * float(light)
    left = max(_DROPPING_SHARE * tolerance - rounding, 0.0)
    chosen: list[tuple[Term, _Option]] = []
    for term in sorted(every, key=lambda term: float(term.gains.max())):
        option = next(option for option in _options(drawing, term) if option.bound <= left)
        left -= option.bound
        chosen.append((term, option))
    tables = sum(option.moving is not None and not isinstance(option.moving.pattern, Cosine) for _, option in chosen)
    share = (left + (1 - _DROPPING_SHARE) * tolerance) / max(tables, 1)
    parts = [_keep(drawing, patch, term, option, share) for term, option in chosen]
    return parts, sum(part.bound for part in parts) + rounding


def _options(drawing: _Drawing, term: Term) -> Iterator[_Option]:
    """Replacements in ascending order of cost, the last one being the term itself with bound 0."""
    light = course(term.waveform, drawing.scene.exposure)
    most = float(term.gains.max())
    if term.moving is None:
        if light.steady:
            yield _Option(0.0, "", light.mean, None)
        yield _Option(most * light.stray, "modulation that the exposure averages", light.mean, None)
        half = (light.high - light.low) / 2
        yield _Option(most * half, "modulation that is too dim", light.low + half, None)
        yield _Option(0.0, "", term.waveform, None)
        return
    yield from _moving_options(drawing, term, term.moving, light, most)
    yield _Option(0.0, "", Constant(light.mean) if light.steady else term.waveform, term.moving)


def _moving_options(drawing: _Drawing, term: Term, moving: Moving, light: Course, most: float) -> Iterator[_Option]:
    still = _still(drawing, moving)
    if still is not None:
        bound, factor = still
        if light.steady:
            yield _Option(most * light.most * bound, "motion too slow to matter", light.mean, None, factor)
    mean, low, high = _reflectance(moving)
    middle = (light.low * low + light.high * high) / 2
    half = (light.high * high - light.low * low) / 2
    yield _Option(most * half, "light that is too dim", middle, None)
    blur, beats = _blurred(moving, light, drawing.scene.exposure)
    yield _Option(most * (blur + beats), "texture and modulation that the exposure averages", light.mean, None, mean)
    if still is not None:
        yield _Option(most * light.most * still[0], "motion too slow to matter", term.waveform, None, still[1])
    if not light.steady:
        yield _Option(most * blur, "texture that the exposure averages", term.waveform, None, mean)
    steps = _steps_seen(moving, drawing.scene.exposure)
    flicker = min(light.swing * steps, max(light.high - light.mean, light.mean - light.low) * high)
    if not light.steady:
        yield _Option(most * flicker, "modulation that the exposure averages", Constant(light.mean), moving)


def _steps_seen(moving: Moving, exposure: float) -> float:
    """Largest level plus the sum of upward steps of the pattern in an exposure."""
    if isinstance(moving.pattern, Cosine):
        high, spread = max(moving.pattern.low, moving.pattern.high), abs(moving.pattern.high - moving.pattern.low)
        return high + spread * math.ceil(abs(moving.rate) * exposure + 1)
    profile = Profile.of(moving.pattern)
    return float(profile.levels.max()) + profile.rise * math.ceil(abs(moving.rate) * exposure + 1)


def _reflectance(moving: Moving) -> tuple[Array | float, float, float]:
    """Mean reflectance of each pixel, lowest and highest."""
    pattern = moving.pattern
    if isinstance(pattern, Cosine):
        return (pattern.low + pattern.high) / 2, min(pattern.low, pattern.high), max(pattern.low, pattern.high)
    profile = Profile.of(pattern)
    return profile.means[moving.line], float(profile.levels.min()), float(profile.levels.max())


def _blurred(moving: Moving, light: Course, exposure: float) -> tuple[float, float]:
    """Bounds on a pattern's texture under the light, and on the light's modulation at the pattern's mean."""
    pattern, rate = moving.pattern, abs(moving.rate)
    if isinstance(pattern, Cosine):
        half, mean = abs(pattern.high - pattern.low) / 2, (pattern.low + pattern.high) / 2
        if light.lines is None:
            return half * light.most, mean * light.stray
        sinc: Callable[[float], float] = lambda f: abs(float(np.sinc(f * exposure)))  # noqa: E731
        blur = abs(light.mean) * sinc(rate)
        blur += sum(abs(a) / 2 * (sinc(f + rate) + sinc(f - rate)) for f, a in light.lines if f > 0)
        return half * blur, mean * light.stray
    profile = Profile.of(pattern)
    means = profile.means
    worst = float(np.max([profile.levels.max(axis=1) - means, means - profile.levels.min(axis=1)]))
    left = min(worst, profile.spread / (rate * exposure)) if light.steady else worst
    return light.most * left, float(means.max()) * light.stray


def _still(drawing: _Drawing, moving: Moving) -> tuple[float, Array] | None:
    """Error of a pattern held at its mid-time position, and its levels there; None if edges pass."""
    pattern, rate = moving.pattern, moving.rate
    phase = moving.periods - rate * drawing.middle
    sweep = abs(rate) * drawing.half
    if isinstance(pattern, Cosine):
        return math.pi * sweep * abs(pattern.high - pattern.low), levels_at(pattern, phase, moving.line)
    if sweep > 1:
        return None
    profile = Profile.of(pattern)
    place = phase + profile.offset
    if (profile.cell_of(place - sweep - 1e-9) != profile.cell_of(place + sweep + 1e-9)).any():
        return None
    return 0.0, levels_at(pattern, phase, moving.line)


def _keep(drawing: _Drawing, patch: Patch, term: Term, option: _Option, share: float) -> Part:
    """Add the computed part of an option to the plan."""
    gains = term.gains * option.factor
    pixels = int(patch.inside.sum())
    kept, bound = "", option.bound
    if not isinstance(option.waveform, Waveform):
        _add_base(drawing, patch, gains * option.waveform)
    elif option.moving is None:
        _add_rows(drawing, patch, gains, option.waveform)
        kept = "one row integral times a gain map" if np.ptp(gains[patch.inside]) else "one row integral"
    elif isinstance(option.moving.pattern, Cosine):
        _add_cosine(drawing, patch, gains, option.waveform, option.moving, option.moving.pattern)
        kept = "three row integrals times gain maps"
    else:
        words, error = _add_profile(drawing, patch, gains, option.waveform, option.moving, share)
        kept, bound = words, bound + error
    return Part(term.name, kept, option.dropped, bound, pixels)


def _add_base(drawing: _Drawing, patch: Patch, light: Array) -> None:
    if not light.any():
        return
    if drawing.base is None:
        drawing.base = np.zeros((drawing.scene.lens.rows, drawing.scene.lens.columns), np.float32)
    light, _, top, left = _on_sensor(drawing, patch, light)
    height, width = light.shape
    drawing.base[top : top + height, left : left + width] += light.astype(np.float32)


def _on_sensor(drawing: _Drawing, patch: Patch, light: Array) -> tuple[Array, npt.NDArray[np.bool_], int, int]:
    """Light of a patch after the lens's blur, its pixels, and top and left of its rectangle."""
    lens = drawing.scene.lens
    if not lens.blur:
        return light, patch.inside, patch.top, patch.left
    seen, top, left = spread(lens, light, patch.top, patch.left)
    return seen, np.ones(seen.shape, np.bool_), top, left


def _add_rows(
    drawing: _Drawing, patch: Patch, gains: Array, waveform: Waveform, rate: float = 0.0, sine: bool = False
) -> None:
    """Add a gain map times a row integral."""
    seen, inside, top, left = _on_sensor(drawing, patch, gains)
    if seen.size:
        _add_part(drawing, seen, inside, top, left, RowSignal(waveform, top, seen.shape[0], rate, sine))


def _add_part(
    drawing: _Drawing,
    gains: Array,
    inside: npt.NDArray[np.bool_],
    top: int,
    left: int,
    signal: RowSignal | ProfileTable,
    phases: int = 1,
    phase: npt.NDArray[np.uint16] | None = None,
) -> None:
    height, width = gains.shape
    spans = _spans(inside)
    values = gains[inside]
    uniform = spans is not None and float(np.ptp(values)) <= 1e-7 * float(np.abs(values).max())
    part = _core.ScenePart(
        rows=drawing.scene.lens.rows,
        columns=drawing.scene.lens.columns,
        top=top,
        left=left,
        height=height,
        width=width,
        phases=phases,
        gain=float(values.mean()) if uniform else 0.0,
        gains=None if uniform else np.ascontiguousarray(gains, np.float32),
        phase=phase,
        spans=spans,
    )
    drawing.kept.append((part, signal))


def _spans(inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint32] | None:
    """First pixel of each row and the one after the last; None if a row has gaps."""
    count = inside.sum(axis=1)
    first = np.where(count > 0, inside.argmax(axis=1), 0)
    last = np.where(count > 0, inside.shape[1] - inside[:, ::-1].argmax(axis=1), 0)
    if (last - first != count).any():
        return None
    return np.stack([first, last], axis=1).astype(np.uint32)


def _add_cosine(
    drawing: _Drawing, patch: Patch, gains: Array, waveform: Waveform, moving: Moving, pattern: Cosine
) -> None:
    """Add low + (high - low) * (1/2 + 1/2 * cos(a - b)) with cos(a - b) = cos a * cos b + sin a * sin b."""
    mean, half = (pattern.low + pattern.high) / 2, (pattern.high - pattern.low) / 2
    if isinstance(waveform, Constant):
        _add_base(drawing, patch, gains * mean * waveform.level)
    else:
        _add_rows(drawing, patch, gains * mean, waveform)
    angle = 2 * np.pi * (moving.periods - np.floor(moving.periods))
    for sine, wave in ((False, np.cos(angle)), (True, np.sin(angle))):
        _add_rows(drawing, patch, gains * half * wave, waveform, moving.rate, sine)


def _steps(light: Course, exposure: float, weight: float, error: float) -> tuple[int, float]:
    """Steps of `Light` in an exposure, and the resulting error.

    For light in [low, high] the antiderivative deviates from the chord by at most (high - low) * step / 4, for light of
    slope s by at most s * step^2 / 8.
    """
    rough, smooth = weight * (light.high - light.low) / 4, weight * light.slope * exposure / 8
    steps = max(1, min(math.ceil(rough / error), math.ceil(math.sqrt(min(smooth, 1e200) / error)), _MAX_STEPS))
    return steps, min(rough / steps, smooth / steps**2)


def _add_profile(
    drawing: _Drawing, patch: Patch, gains: Array, waveform: Waveform, moving: Moving, share: float
) -> tuple[str, float]:
    """Use a table if one within its share of the error is small enough, else compute pixel by pixel."""
    assert not isinstance(moving.pattern, Cosine)
    if drawing.scene.lens.blur:
        got = f"got {drawing.scene.lens.blur} before {patch.name}"
        raise ValueError(f"blur: {got}, allowed: 0 before a moving grating or picture")
    profile = Profile.of(moving.pattern)
    exposure, height = drawing.scene.exposure, gains.shape[0]
    light = course(waveform, exposure)
    most = float(gains.max())
    passed = abs(moving.rate) * exposure
    steps, error = _steps(light, exposure, 2 * most * _steps_seen(moving, exposure), share / 4)
    shifted = most * light.most * profile.rise * math.ceil(passed + 0.5) / passed  # per period of phase
    phases = math.ceil(shifted / 2 / max(share - error, 1e-300)) + 1 if shifted < 1e9 * share else _MAX_PHASES + 1
    columns = phases * len(profile.levels)
    if columns <= _MAX_PHASES and columns * height <= patch.inside.sum():
        table = ProfileTable(waveform, profile, moving.rate, phases, steps, patch.top, height)
        _add_part(drawing, gains, patch.inside, patch.top, patch.left, table, columns, table.index(moving))
        return f"a table of {columns} phases a row", error + shifted / (2 * phases)
    inside = patch.inside
    rows, across = np.nonzero(inside)
    each = gains[inside], moving.periods[inside], moving.line[inside]
    pixels = PixelProfile(waveform, profile, moving.rate, steps, rows + patch.top, across + patch.left, *each)
    drawing.by_pixel.append(pixels)
    return "every pixel's integral", error
