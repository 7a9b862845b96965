"""Separation of a picture and the bands of a modulated light."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast._core import ModelledLight, SceneLight, StoredScene
from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light, saturation_level, stored_values
from ocisac_fast.cleaning.stored import BlockShares, lowered
from ocisac_fast.core.arrays import Float64s, as_frames, in_stored_order
from ocisac_fast.core.checks import Count, Within, checked, checked_class
from ocisac_fast.core.results import Result
from ocisac_fast.light.waveforms import Waveform, integrate_exposure

_MUCH_LEFT, _MUCH_TEXTURE = 0.5, 1.0  # of the bands' swing; dB: a remark
_MOST = 1e300  # light whose sums are numbers


class Mark(IntEnum):
    """State of a pixel after the removal of bands."""

    RESTORED = 0
    """Restored to steady light."""
    SATURATED = 1
    """At the top of the scale, or within 2 % of it: unchanged."""
    DARK = 2
    """The row was too dark to restore the pixel: amplified by ``max_gain``, or interpolated from other rows (fill)."""


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class CleanedFrames(Result):
    """Pictures without bands, or the bands alone.

    Attributes:
        frames: shape and type of the argument.
        marks: :class:`Mark` of each pixel, uint8, of the shape of ``frames``.
        light: (rows,), (frames, rows) or (frames, rows, colours): the estimated or given light of each row, mean 1.
        share: share of the modulated light in a pixel's mean light, float32, of the shape of ``frames``; one for all
            pixels of a colour where shares by pixel explain no more than they do by chance. May be read-only.
        model: for each frame ``"tone"``, ``"chips"``, ``"rows"``, or ``"given"``.
        frequency: (frames,) of the tone, or the chip rate, Hz; NaN for rows and given light.
        toe: (frames,) toe of the tone curve, as share of white; mostly 0.
        light_left: (frames,) swing of the row light in the columns after cleaning, over that before.
        texture_change: (frames,) energy of texture after cleaning over that before, dB.
        slow_bands: (frames,) amplitude, relative to the light, of bands above 128 rows per cycle that are left; 0 if
            they are not ten times as likely as none.
        unchanged: why a frame is left as it was, since cleaning would make it worse; "" for a frame that is cleaned.
            ``share`` is 0 then, ``light_left`` and ``texture_change`` are those of the result that was rejected.
    """

    frames: npt.NDArray[Any]
    marks: npt.NDArray[np.uint8]
    light: Float64s
    share: npt.NDArray[np.float32]
    model: tuple[str, ...]
    frequency: Float64s
    toe: Float64s
    light_left: Float64s
    texture_change: Float64s
    slow_bands: Float64s
    unchanged: tuple[str, ...]

    @property
    def remarks(self) -> tuple[str, ...]:
        """For each frame what is likely wrong with the result, or ""."""
        return tuple(
            _remark(*of_frame)
            for of_frame in zip(self.unchanged, self.light_left, self.texture_change, self.slow_bands, strict=True)
        )


def _remark(unchanged: str, light_left: float, texture_change: float, slow_bands: float) -> str:
    remarks = [f"unchanged ({unchanged})"] if unchanged else []
    if not unchanged and light_left > _MUCH_LEFT:
        remarks.append(f"bands left: {100 * light_left:.2g} % of their swing")
    if not unchanged and abs(texture_change) > _MUCH_TEXTURE:
        remarks.append(f"texture changed: {texture_change:+.2g} dB")
    if slow_bands > 0:
        remarks.append(f"bands above 128 rows left: {100 * slow_bands:.2g} % of the light")
    return "; ".join(remarks)


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class CleaningOptions:
    """Rarely needed options of :func:`remove_bands`.

    Args:
        noise: standard deviation of a pixel, DN, 1e-100 or above; None: estimated, at least half a step of integers.
        max_gain: rows that need a larger gain are too dark, and marked; above 1.
        fill: replace pixels that were too dark by interpolation between the rows above and below; they stay marked.
            Otherwise they are amplified ``max_gain`` times.
        toe: toe t of the tone curve: light x is stored as x^2/(x + t white), then by the tone curve of ``camera``; 0 to
            1. None: estimated where the light is chips, the tone curve is not linear and the toe reduces the share of
            the rows' swing that chips leave unexplained by 40 %; else 0.
    """

    noise: float | None = None
    max_gain: Annotated[float, Within(1.0, above=True)] = 8.0
    fill: bool = False
    toe: float | None = None

    def __post_init__(self) -> None:
        if self.noise is not None and not (np.isfinite(self.noise) and self.noise >= 1e-100):
            raise ValueError(f"noise: got {self.noise}, allowed: a finite number, 1e-100 or above")
        if self.toe is not None and not 0 <= self.toe <= 1:
            raise ValueError(f"toe: got {self.toe}, allowed: 0 to 1")


@dataclass(frozen=True, slots=True)
class Task:
    """The choices of :func:`remove_bands`."""

    model: str
    keep: str
    level: str
    options: CleaningOptions


@checked
def remove_bands(
    frames: npt.ArrayLike,
    camera: Camera,
    *,
    light: npt.ArrayLike | Waveform | None = None,
    start: float = 0.0,
    model: Literal["auto", "tone", "chips", "rows"] = "auto",
    keep: Literal["picture", "bands"] = "picture",
    level: Literal["auto", "full", "mean"] = "auto",
    still: bool = False,
    options: CleaningOptions | None = None,
) -> CleanedFrames:
    """Restore a picture to steady light.

    In linear light a pixel is v = c (1 + q (L_n - 1)), where L_n is the light of row n with mean 1, q the light's share
    and c the value at mean light. q minimises the difference of neighbouring rows after division by
    1 + q (L_n - 1), with texture and edges modelled, averaged over surroundings that end at the edges of the picture.
    The result is v (1 + q (L_full - 1)) / (1 + q (L_n - 1)): fully lit rows are unchanged.

    A result with an estimated light is measured: a frame stays as it was, with a reason in ``unchanged``, where its
    rows would differ as much as before, or its bands tilt or curve.

    Args:
        frames: (rows, columns) or (frames, rows, columns), or (frames, rows, columns, colours) for colour; rows in
            time order, at least 8.
        camera: row time; tone curve, dark and white level where known, since only linear light is additive.
        light: of each row, 0 or above: (rows,) or (frames, rows), any scale; or a waveform, which is integrated over
            the exposure of ``camera``. None: estimated from the picture.
        start: end of the first row's exposure, s, for a waveform; frames follow at ``camera.frame_time``.
        model: model of a light that is not given. ``"tone"``: a tone with its harmonics; ``"chips"``: the chips that
            :func:`ocisac_fast.receive` detects, with the response that the rows show; ``"rows"``: arbitrary;
            ``"auto"``: a tone that explains 90 % of the swing that rows have in common, else chips that explain 92 %,
            else a tone that explains 50 %, else arbitrary. A tone slower than 128 rows per cycle is searched in a
            picture without another light, and removed where the picture's own shades cannot be the reason.
        keep: ``"picture"``, or ``"bands"``: the modulated light alone, c q L_n.
        level: of the steady light: ``"full"``: the brightest rows'; ``"mean"``: its mean over the rows, so that lit and
            unlit parts keep their balance; ``"auto"``: the mean of a tone, else full.
        still: the frames show one static scene and follow each other: shares, and the phases of a slow tone, are
            estimated from all of them together. A frame without the light may be among them, with ``light`` 0.
        options: noise, largest gain, filling of dark pixels, toe; None: the defaults.

    Returns:
        :class:`CleanedFrames`.
    """
    task = Task(model, keep, level, options or CleaningOptions())
    stack = stacked(frames, "frames", camera.scan_axis)
    given = None if light is None else _given_light(light, camera, start, stack.shape[:2])
    parts = [slice(None)] if still else [slice(k, k + 1) for k in range(len(stack))]
    done = [finished(_estimated(stack, part, camera, given, task), camera, task) for part in parts]
    if given is None and model == "auto" and len(done) == len(stack):
        done = _without_lines(done, stack, camera, task)
    return collected(done, camera, np.ndim(frames))


def _without_lines(done: list[Done], stack: npt.NDArray[Any], camera: Camera, task: Task) -> list[Done]:
    """The frames, each of its own; those taken for chips or a tone as they are if these stand still in all frames, in
    the rows of such as show none."""
    lights = [one.light.lights[0][0] for one in done]
    of_model = {own.model: own for own in lights}
    first = of_model.get("tone", of_model.get("chips"))  # tones may be taken for chips
    if first is None:
        return done
    means = stack.reshape(*stack.shape[:2], -1).mean(axis=2, dtype=np.float64)
    rows = [(mean if own.model == "rows" else own.light).tolist() for own, mean in zip(lights, means, strict=True)]
    lines = _core.objection_to_lines(rows, first.model, first.frequency, camera._handle)
    if not lines:
        return done
    return [
        one if own.model == "rows" else _left_alone(stack[k : k + 1], one.light, one.toe, lines, camera, task)
        for k, (one, own) in enumerate(zip(done, lights, strict=True))
    ]


def _joined(arrays: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def collected(done: list[Done], camera: Camera, dimensions: int) -> CleanedFrames:
    """The results of all scenes, for an argument of ``dimensions`` dimensions."""
    pictures, marks, shares = (
        _joined(list(each)) for each in zip(*((one.pictures, one.marks, one.shares) for one in done), strict=True)
    )
    found = [of_frame for one in done for of_frame in one.light.lights]
    verdicts = [verdict for one in done for verdict in one.light.verdicts]
    rows = np.stack([np.stack([own.light for own in of_frame], axis=-1) for of_frame in found])
    return CleanedFrames(
        frames=_as_given(pictures, camera.scan_axis, dimensions),
        marks=_as_given(marks, camera.scan_axis, dimensions),
        light=rows if dimensions == 4 else rows[..., 0] if dimensions == 3 else rows[0, :, 0],
        share=_as_given(shares, camera.scan_axis, dimensions),
        model=tuple(of_frame[0].model for of_frame in found),
        frequency=np.array([of_frame[0].frequency / camera.row_period for of_frame in found]),
        toe=np.concatenate([np.full(len(one.pictures), one.toe) for one in done]),
        light_left=np.array([verdict.light_left for verdict in verdicts]),
        texture_change=np.array([verdict.texture_change for verdict in verdicts]),
        slow_bands=np.array([verdict.slow_bands for verdict in verdicts]),
        unchanged=tuple(one.unchanged for one in done for _ in one.pictures),
    )


@checked
def subtract_still(
    frames: npt.ArrayLike, camera: Camera, *, still: npt.ArrayLike | None = None, neighbours: Count = 8
) -> Float64s:
    """Subtract the static picture from frames, so that a faint light over a textured background can be received.

    The result is light(frame) - light(still) + mean of light(still), in linear light above dark. Use it with a camera
    of the same timing and no tone curve. The chips of the light should differ from frame to frame: chips at the same
    rows in all frames are subtracted as well.

    Args:
        frames: (frames, rows, columns) or (frames, rows, columns, colours), or (rows, columns) where ``still`` is
            given; of a static scene.
        camera: tone curve, dark and white level.
        still: (rows, columns[, colours]) the picture without the light, or with it steady, of the type of ``frames``.
            None: for each frame the mean of its ``neighbours``, itself excluded.
        neighbours: number of frames averaged, the nearest in time; 1 or more.

    Returns:
        float64 array of the shape of ``frames``.
    """
    stack = stacked(frames, "frames", camera.scan_axis)
    light = _summable("frames", stack, camera)
    if still is not None:
        picture = as_frames(still, "still", camera.scan_axis, single=True)
        if picture.shape[1:] != stack.shape[1:] or picture.dtype != stack.dtype:
            raise ValueError(f"still: got {picture.dtype} {np.shape(still)}, allowed: one frame of {stack.dtype}")
        background = np.broadcast_to(_summable("still", picture[0], camera), stack.shape)
    else:
        if len(stack) < 2:
            raise ValueError("frames: got 1 frame, allowed: at least 2, or still=")
        background = np.stack([_mean_of_others(light, k, neighbours) for k in range(len(light))])
    return _as_given(light - background + background.mean(), camera.scan_axis, np.ndim(frames))


def _summable(name: str, stored: npt.NDArray[Any], camera: Camera) -> Float64s:
    light = linear_light(stored, camera)
    lowest, highest = float(light.min()), float(light.max())
    if not -_MOST <= lowest <= highest <= _MOST:
        raise ValueError(f"{name}: got light from {lowest:g} to {highest:g}, allowed: -{_MOST:g} to {_MOST:g}")
    return light


def _mean_of_others(light: Float64s, index: int, neighbours: int) -> Float64s:
    others = sorted(set(range(len(light))) - {index}, key=lambda k: (abs(k - index), k))
    return np.asarray(light[others[:neighbours]].mean(axis=0))


def stacked(frames: npt.ArrayLike, name: str, scan_axis: str) -> npt.NDArray[Any]:
    """Return (frames, rows, columns, colours) in time order, of a type that the core reads."""
    stack = as_frames(frames, name, scan_axis)
    if np.ndim(frames) == 1 or stack.shape[1] < 8:
        raise ValueError(
            f"{name}: got shape {np.shape(frames)}, allowed: (rows, columns), (frames, rows, columns) or "
            "(frames, rows, columns, colours) of at least 8 rows"
        )
    if stack.dtype.kind == "f" and not np.isfinite(stack).all():
        raise ValueError(f"{name}: got values that are not finite, allowed: finite numbers")
    return stack


def _as_given(stack: npt.NDArray[Any], scan_axis: str, dimensions: int) -> npt.NDArray[Any]:
    """The inverse of :func:`_stacked` for an argument of ``dimensions`` dimensions."""
    if scan_axis != "y":
        stack = np.moveaxis(in_stored_order(np.moveaxis(stack, -1, 1), scan_axis), 1, -1)
    return stack if dimensions == 4 else stack[..., 0] if dimensions == 3 else stack[0, ..., 0]


def _given_light(
    light: npt.ArrayLike | Waveform, camera: Camera, start: float, shape: tuple[int, ...]
) -> tuple[Float64s, float]:
    """Light of each row of each frame, and that of a fully lit row."""
    count, rows = shape
    if isinstance(light, Waveform):
        every = integrate_exposure(light, camera, rows, start=start, frames=count if count > 1 else None)
        values = every.reshape(shape)
    else:
        values = np.asarray(light, np.float64)
        values = np.broadcast_to(values, shape) if values.shape in ((rows,), shape) else values
    if values.shape != shape or not np.isfinite(values).all() or (values < 0).any():
        raise ValueError(f"light: got shape {values.shape}, allowed: finite, 0 or above, one for each of {rows} rows")
    mean = values.mean(axis=1)
    if not (mean > 0).any():
        raise ValueError("light: got no light at all, allowed: rows of which some are lit")
    common = mean[mean > 0].mean()  # one scale for all frames, since a frame may be without the light
    return values / common, float((values / common).max())


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """Frames of one scene: pictures, marks and shares (frames, rows, columns, colours), their light, the toe of the
    tone curve, and why all are left as they were, or "".
    """

    pictures: npt.NDArray[Any]
    marks: npt.NDArray[np.uint8]
    shares: npt.NDArray[np.float32]
    light: SceneLight
    toe: float
    unchanged: str


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Frames (frames, rows, columns, colours) of one scene, the light of their rows, and its shares in each colour."""

    stack: npt.NDArray[Any]
    scene: StoredScene
    light: SceneLight
    shares: list[BlockShares]


def estimate_of(
    stack: npt.NDArray[Any], found: tuple[StoredScene, SceneLight, list[tuple[Float64s, int, int]]]
) -> Estimate:
    """The core's results for these frames."""
    scene, light, shares = found
    return Estimate(stack, scene, light, [BlockShares(*own) for own in shares])


def colours_of(stack: npt.NDArray[Any]) -> list[npt.NDArray[Any]]:
    """(frames, rows, columns) of each colour."""
    return [stack[..., colour] for colour in range(stack.shape[3])]


def _estimated(
    frames: npt.NDArray[Any], part: slice, camera: Camera, given: tuple[Float64s, float] | None, task: Task
) -> Estimate:
    stack, options = frames[part], task.options
    rows, full = (None, 1.0) if given is None else (given[0][part], given[1])
    scene = colours_of(stack), camera._handle, task.model, options.noise, options.toe
    return estimate_of(stack, _core.find_scene_light(*scene, rows, full))


def finished(found: Estimate, camera: Camera, task: Task) -> Done:
    """Restore every frame and colour."""
    stack, light = found.stack, found.light
    if light.unchanged:
        return _left_alone(stack, light, found.scene.toe, light.unchanged, camera, task)
    pictures, marks = np.empty_like(stack), _planes(stack.shape, np.uint8)
    is_one = all(np.ptp(own.share) == 0 for own in found.shares)
    shares = (
        _of_colours([own.share[0, 0] for own in found.shares], stack) if is_one else _planes(stack.shape, np.float32)
    )
    for colour, own in enumerate(found.shares):
        for k, of_frame in enumerate(light.lights):
            each = None if is_one else shares[k, ..., colour]
            out = Restored(pictures[k, ..., colour], marks[k, ..., colour], each)
            _restore(found, k, colour, own, of_frame[colour], camera, task, out)
    return Done(pictures, marks, shares, light, found.scene.toe, light.unchanged)


def _planes(shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """An array (frames, rows, columns, colours), each colour in memory of its own."""
    return np.moveaxis(np.empty((shape[3], *shape[:3]), dtype), 0, -1)


def _of_colours(shares: list[float], stack: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """One share for all pixels of a colour, in no memory of its own."""
    return np.broadcast_to(np.array(shares, np.float32), stack.shape)


def _left_alone(
    stack: npt.NDArray[Any], light: SceneLight, toe: float, reason: str, camera: Camera, task: Task
) -> Done:
    """The frames as they are, without a light."""
    saturated = stack >= saturation_level(camera, stack.dtype)
    if task.keep == "picture":
        pictures = stack.copy()
    else:
        pictures = np.broadcast_to(stored_values(np.zeros(1), camera, stack.dtype), stack.shape).copy()
    return Done(pictures, saturated.view(np.uint8), _of_colours([0.0] * stack.shape[3], stack), light, toe, reason)


class Restored(NamedTuple):
    """Views (rows, columns) of one colour of one frame: stored values, marks, and shares where they differ."""

    picture: npt.NDArray[Any]
    marks: npt.NDArray[np.uint8]
    share: npt.NDArray[np.float32] | None


def _restore(
    found: Estimate,
    frame: int,
    colour: int,
    shares: BlockShares,
    row_light: ModelledLight,
    camera: Camera,
    task: Task,
    out: Restored,
) -> None:
    """Restore one colour of one frame."""
    is_full = task.level == "full" or (task.level == "auto" and row_light.model != "tone")
    level = found.light.full_level(frame, colour) if is_full else 1.0
    rows = np.minimum(row_light.light, row_light.full)  # brighter rows are fully lit rows with noise
    scene, max_gain = found.scene, task.options.max_gain
    if scene.by_table and task.keep == "picture" and not task.options.fill:
        scene.restore(frame, colour, shares.share, shares.rows, shares.columns, rows, level, max_gain, *out)
        return
    stored = found.stack[frame, ..., colour]
    saturated = np.asarray(stored >= saturation_level(camera, stored.dtype))
    light = _core.lifted_light(linear_light(stored, camera), scene.toe, scene.white)
    share = shares.enlarged(light.shape)
    gain = (1 + share * (level - 1)) / np.maximum(1 + share * (rows[:, None] - 1), 1e-9)
    dark = (gain > max_gain) & ~saturated
    out.marks[:] = np.where(saturated, Mark.SATURATED, np.where(dark, Mark.DARK, Mark.RESTORED))
    if out.share is not None:
        out.share[:] = share
    gain = np.minimum(gain, max_gain)

    def stored_of(values: Float64s) -> npt.NDArray[Any]:
        return stored_values(lowered(values, scene.toe, scene.white), camera, stored.dtype)

    if task.keep == "bands":
        out.picture[:] = stored_of(light * gain / (1 + share * (level - 1)) * share * rows[:, None])
        return
    values = stored_of(_filled(light * gain, dark) if task.options.fill else light * gain)
    if stored.dtype.kind == "u":  # rows that were lit more burn from the next value on
        values = np.minimum(values, np.ceil(saturation_level(camera, stored.dtype)) - 1)
    out.picture[:] = np.where(saturated, stored, values)


def _filled(values: Float64s, lost: npt.NDArray[np.bool_]) -> Float64s:
    """Interpolate lost pixels linearly between the nearest valid pixels of their column."""
    rows = len(values)
    place = np.arange(rows)[:, None]
    above = np.maximum.accumulate(np.where(lost, -1, place), axis=0)
    below = np.minimum.accumulate(np.where(lost, rows, place)[::-1], axis=0)[::-1]
    first, last = np.where(above < 0, below, above), np.where(below >= rows, above, below)
    known = (first < rows) & (last >= 0)
    first, last = np.where(known, first, 0), np.where(known, last, 0)
    along = np.where(last > first, (place - first) / np.maximum(last - first, 1), 0.0)
    upper, lower = np.take_along_axis(values, first, axis=0), np.take_along_axis(values, last, axis=0)
    return np.where(lost & known, upper + along * (lower - upper), values)
