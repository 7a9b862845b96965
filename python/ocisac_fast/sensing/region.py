"""Sensing of a region of a picture: gain, frequency, kind and motion of a texture or a modulated light."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.core.arrays import Float64s, as_grey_frames, stored_box
from ocisac_fast.core.checks import InnerShare, NotNegative, Positive, Within, checked, checked_class, shown
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.regions import Region
from ocisac_fast.core.results import Result
from ocisac_fast.core.statistics import do_differ
from ocisac_fast.sensing.fit import (
    Columns,
    Fitted,
    PhaseAdvance,
    fit,
    frequency_std,
    harmonics_of,
    make_model,
    phase_advance,
    phase_spread,
    refine,
    search_columns,
    with_harmonics_above_noise,
    with_tones_shaped_by_light,
)
from ocisac_fast.sensing.gain import (
    Ambient,
    contrast_range,
    error_by_black,
    is_rounded,
    over_frames,
    pooled_gain,
    pull_of_black,
)
from ocisac_fast.sensing.kind import Kind, kind_of, motion_facts, seen_by
from ocisac_fast.sensing.motion import KnownMotion
from ocisac_fast.tones.frequency import find_frequency
from ocisac_fast.tones.gain import tone_gain
from ocisac_fast.tones.varying_tone import varying_tone_gain

_MOST = 1e60  # light whose fourth powers are numbers
_COMMON_PHASE = 0.1  # rad; max. RMS spread of a light's phase over the columns


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class BackgroundLight(Result):
    """Light of other origin than the source, measured without the source.

    Attributes:
        mean: DN above dark; one value, or (columns,).
        std: its standard error, of the same shape; it includes the noise that black cuts off.
        flags: SATURATED if light is clipped at black, at white or at another level in a tenth of the columns or more;
            then the mean is wrong by what was cut off. :func:`sense_region` passes them on.
    """

    mean: Float64s
    std: Float64s
    flags: Flag = Flag(0)  # noqa: RUF009, a constant


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class SensedRegion(Result):
    """Measurements of a region of a picture, pooled over its columns and frames. NaN: unknown or not of this kind.

    Attributes:
        kind: ``"light"``: modulated in time, one phase in all columns; ``"moving"``: a texture whose phase follows its
            motion; ``"still"``: a texture that is equal in all frames (or moves by whole cycles per frame:
            AMBIGUOUS_MOTION); ``"unknown"``: nothing periodic.
        x, y, width, height: of the region, pixels as stored.
        frames: number of frames used.
        frequency, frequency_std: in a column, Hz: cycles per row over the row time. For a given frequency the standard
            error is the given one.
        motion_frequency, motion_frequency_std: f_x v, Hz, of a moving texture: the frequency of the light in a pixel.
            Across the rows it equals ``frequency``; along them the row pitch contributes. 0 for a still texture.
            With the flag AMBIGUOUS_MOTION its standard error includes the RMS distance of all values that fit.
        motion_candidates: all values that fit, Hz, ascending; more than one with the flag AMBIGUOUS_MOTION (at most 16
            are listed).
        direction: of the motion: +1 with the read-out (across the rows: to higher columns), -1 against it, 0 unknown.
        cycles_per_column, cycles_per_column_std: of the texture in a row, signed; 0 within its error for a light.
        cycles_per_frame, cycles_per_frame_std: advance from frame to frame, in (-1/2, 1/2].
        gain, gain_std: contrast gain, eq. 16: amplitude of the fundamental along the columns over the mean light, over
            the waveform's ratio and ``depth``. The error includes noise that the columns of a row share or that black
            cuts off, and harmonics that fold.
        frames_gain, frames_gain_std: the same from each pixel's course over the frames; NaN below 6 frames, below one
            cycle of the advance over all of them, or less than half a cycle from half the frame rate.
        theory: |sinc(f T_e)| at the frequency f of the light in a pixel.
        contrast: amplitude of the fundamental over the mean: gain times ratio times depth.
        contrast_range: (max - min)/(max + min) of the fitted rows, for display.
        mean: mean light, DN above dark and background.
        snr: G^2 mean^2 / (noise variance of a row), a plain ratio (eqs. 13-14).
        speed, speed_std: m/s, of the motion perpendicular to the stripes.
        spatial_frequency, spatial_frequency_std: of the texture along the motion, 1/m; std 0 for a given value.
        background_given: True if a background was given; otherwise a light's gain is its share of the light times
            |sinc|.
        flags: of :class:`ocisac_fast.Flag`; MODEL_MISFIT also where a frame shows the tone by a tenth more or less deep
            than most (a cut), where the columns contradict a stated spatial frequency
            or speed by more than a tenth (with the pitch), and where the frame time is shorter than the rows or the
            exposure take.
    """

    kind: Kind
    x: int
    y: int
    width: int
    height: int
    frames: int
    frequency: float = math.nan
    frequency_std: float = math.nan
    motion_frequency: float = math.nan
    motion_frequency_std: float = math.nan
    motion_candidates: tuple[float, ...] = ()
    direction: int = 0
    cycles_per_column: float = math.nan
    cycles_per_column_std: float = math.nan
    cycles_per_frame: float = math.nan
    cycles_per_frame_std: float = math.nan
    gain: float = math.nan
    gain_std: float = math.nan
    frames_gain: float = math.nan
    frames_gain_std: float = math.nan
    theory: float = math.nan
    contrast: float = math.nan
    contrast_range: float = math.nan
    mean: float = math.nan
    snr: float = math.nan
    speed: float = math.nan
    speed_std: float = math.nan
    spatial_frequency: float = math.nan
    spatial_frequency_std: float = math.nan
    background_given: bool = False
    flags: Flag = Flag(0)  # noqa: RUF009, a constant

    @property
    def region(self) -> Region:
        """Position in the picture."""
        return Region(self.x, self.y, self.width, self.height)


@runtime_checkable
class MeasuredFrequency(Protocol):
    """A result with a frequency and its standard error, Hz, such as ``FoundFrequency`` or ``LightSource``."""

    @property
    def frequency(self) -> float: ...
    @property
    def frequency_std(self) -> float: ...


@checked_class
@dataclass(frozen=True, slots=True)
class Request:
    """The checked arguments of :func:`sense_region` apart from frames and background."""

    waveform: Literal["tone", "square"] = "tone"
    duty: InnerShare = 0.5
    depth: Annotated[float, Within(1e-9, 1e9)] = 1.0
    motion: KnownMotion | None = None
    frequency: Positive | None = None
    frequency_std: NotNegative = 0.0
    others: tuple[float, ...] = ()
    bounds: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        _frequencies("others", self.others)


@checked
def sense_region(
    frames: npt.ArrayLike,
    camera: Camera,
    frequency: float | MeasuredFrequency | None = None,
    *,
    waveform: Literal["tone", "square"] = "tone",
    duty: float = 0.5,
    depth: float = 1.0,
    background: npt.ArrayLike | BackgroundLight | None = None,
    others: npt.ArrayLike = (),
    motion: KnownMotion | None = None,
    bounds: tuple[float, float] | None = None,
) -> SensedRegion:
    """Measure contrast gain, motion and kind of the one periodic component in a region of a picture.

    All columns and frames share one frequency, estimated by least squares of slow light (a polynomial of degree 0 to
    4), tone and harmonics. Amplitudes and phases are free in each column; the tones are modulated along the rows by the
    region's slow light. In white noise the standard error is at the Cramer-Rao bound of that model. The phases give
    kind and motion:

        2 pi (c n + s k + d j),   row n, column k, frame j

    A light has s = 0 and d = c T_f/T_r; a texture with the spatial frequencies f_x along the columns' axis, f_y along
    the rows and the motion-induced frequency f_x v has s = f_x pitch, d = f_x v T_f and c = f_x v T_r + f_y pitch. d is
    known modulo 1. So a moving texture differs from a light in s, or in d if its stripes are parallel to the rows.
    Motion along the rows needs the pitch and either the texture or the speed, or frames and bounds that leave one
    solution; otherwise it is flagged AMBIGUOUS_MOTION. See docs/explanation/sensing.md.

    Args:
        frames: (rows,), (rows, columns) or (frames, rows, columns), rows in time order, successive frames.
        camera: row time; frame time to compare frames; exposure for ``theory``.
        frequency: in a column, Hz, where known, such as that of a light; it is then fixed. Above half the row rate it
            is measured at its alias. A measured frequency, such as the result of ``find_frequency`` or a
            ``LightSource``, is given with its standard error.
        waveform: ``"tone"``, or ``"square"`` with its harmonics.
        duty: bright share of the square wave, inside (0, 1).
        depth: contrast of the texture or the light itself, above 0: amplitude over that of full depth.
        background: light of other origin: DN above dark, one value or (columns,) or (frames, columns), or the result of
            :func:`background_light`.
        others: frequencies of other tones in the same pixels, Hz, included in the fit.
        motion: what is known of the texture's motion.
        bounds: lowest and highest frequency of the search in the columns, Hz, as for ``find_frequency``.

    Returns:
        :class:`SensedRegion`.
    """
    value: float | None
    if isinstance(frequency, MeasuredFrequency):
        value, std = frequency.frequency, frequency.frequency_std
    else:
        value, std = frequency, 0.0
    tones = _frequencies("others", others)
    request = Request(waveform, duty, depth, motion, value, std, tones, bounds)
    return measure(frames, camera, request, background)


def measure(
    frames: npt.ArrayLike,
    camera: Camera,
    request: Request,
    background: npt.ArrayLike | BackgroundLight | None = None,
) -> SensedRegion:
    """:func:`sense_region` of a request."""
    region = as_grey_frames(frames, "frames", camera.scan_axis)
    check_size(region, camera)
    width, height = stored_box(Region(0, 0, region.shape[2], region.shape[1]), region.shape[1:], camera.scan_axis)[2:]
    camera = camera.in_time_order
    tones = [f * camera.row_period for f in request.others]
    known = request.motion or KnownMotion()
    ambient = _ambient(background, region)
    blank = SensedRegion("unknown", 0, 0, width, height, len(region))
    blank = dataclasses.replace(blank, background_given=background is not None)

    fitted, flags, folding = _fitted(region, camera, request, tones, float(ambient.mean.mean()))
    if fitted is None:
        return dataclasses.replace(blank, flags=flags)
    if request.frequency is not None:
        fitted = dataclasses.replace(fitted, cycles_std=request.frequency_std * camera.row_period)
    camera, late = _timed(camera, known.frame_times, len(region))
    columns_advance, frames_advance = _phase_advances(fitted, camera, late)
    common, doubt = _common_phase(fitted, columns_advance)
    seen = seen_by(fitted, frames_advance, camera)
    kind, axis, kind_flags = kind_of(seen, common, doubt, known.axis, known.timing_tolerance)
    facts: dict[str, Any] = motion_facts(kind, axis, seen, known, columns_advance)
    kind = facts["kind"]
    if kind != "light":
        flags &= ~Flag.MODEL_MISFIT  # the columns of a texture have phases of their own
    if _changes(fitted):
        flags |= Flag.MODEL_MISFIT
    flags |= kind_flags | facts.pop("flags")
    ratio = (1.0 if request.waveform == "tone" else 2.0 * float(np.sinc(request.duty))) * request.depth
    gains = _gains(region, camera, fitted, frames_advance, ambient, ratio, folding)
    light_frequency = {"light": fitted.model.cycles / camera.row_period, "still": 0.0}.get(
        kind, abs(facts.get("motion_frequency", math.nan))
    )
    theory, theory_flags = _theory(light_frequency, camera)
    # The rows show the frequency of a light; that of a texture in a pixel is another one.
    timing = camera if kind == "light" else dataclasses.replace(camera, exposure=None)
    flags |= gains.pop("flags") | theory_flags | _column_flags(region, timing, fitted, tones, request)
    if isinstance(background, BackgroundLight):
        flags |= background.flags
    reading = max(region.shape[1] * camera.row_period, camera.exposure or 0.0)
    if len(region) > 1 and camera.frame_time is not None and camera.frame_time < reading:
        flags |= Flag.MODEL_MISFIT  # frames that are given twice, or a frame time that is wrong
    return dataclasses.replace(
        blank,
        frequency=fitted.model.cycles / camera.row_period,
        frequency_std=fitted.cycles_std / camera.row_period,
        cycles_per_column=columns_advance.cycles,
        cycles_per_column_std=columns_advance.std,
        cycles_per_frame=frames_advance.cycles,
        cycles_per_frame_std=frames_advance.std,
        theory=theory,
        flags=flags,
        **facts,
        **gains,
    )


@checked
def background_light(
    frames: npt.ArrayLike, camera: Camera, *, tones: npt.ArrayLike = (), pooled: bool = False
) -> BackgroundLight:
    """Mean light of pixels without the source: the same pixels in an unlit frame, or pixels beside the source.

    Args:
        frames: (rows,), (rows, columns) or (frames, rows, columns), rows in time order.
        camera: row time and response.
        tones: frequencies in the columns, Hz, such as that of a moving texture, included in the fit so that incomplete
            cycles do not bias the mean.
        pooled: one value for all columns, for light beside the source; its standard error is from the scatter of the
            columns.
    """
    region = as_grey_frames(frames, "frames", camera.scan_axis)
    check_size(region, camera)
    camera = camera.in_time_order
    frequencies = _frequencies("tones", tones)
    model = make_model(region.shape[1], 0.0, (), [f * camera.row_period for f in frequencies])
    fitted = fit(Columns(region, camera), model)
    columns = fitted.mean.mean(axis=0)
    std = np.sqrt(fitted.noise.mean(axis=0) * model.covariance[0, 0] / len(region))
    few = slice(None, None, 1 + len(region) // _FEW)
    some = Fitted(model, fitted.parameters[few], fitted.noise[few], 0.0)
    pull = pull_of_black(region[few], camera, some, np.zeros_like(some.noise))[:, 0].mean(axis=0)
    # A tone's clipping is sought only where the tone shows, a square wave's everywhere.
    masks = tone_gain(region, camera, _ANY / camera.row_period, waveform="square").flags
    flags = _shared_flags(masks, Flag.SATURATED)
    if not pooled:
        return BackgroundLight(columns, np.hypot(std, pull), flags)
    spread = columns.std(ddof=1) / np.sqrt(columns.size) if columns.size > 1 else std[0]
    even = np.full((len(region), 1, columns.size), 1.0 / columns.size)
    rows = np.stack(list(Columns(region, camera).across(even)))  # whose noise the columns may share
    shared = fit(Columns(rows, Camera(1.0)), model).noise.mean() * model.covariance[0, 0] / len(region)
    spread = np.hypot(max(spread, np.sqrt(shared)), pull.mean())
    return BackgroundLight(np.asarray(columns.mean()), np.asarray(spread), flags)


def check_size(frames: npt.NDArray[Any], camera: Camera) -> None:
    """Refuse frames whose largest light has no fourth power; what is not finite is refused later."""
    largest = np.abs(frames).max(keepdims=True)
    for kind, size in (("value", float(largest.max())), ("light", float(np.abs(linear_light(largest, camera)).max()))):
        if size > 0.0 and not 1.0 / _MOST <= size <= _MOST:
            raise ValueError(f"frames: got {size:g} as the largest {kind}, allowed: 1e-60 to 1e60")


def _frequencies(name: str, given: npt.ArrayLike) -> tuple[float, ...]:
    values = np.atleast_1d(np.asarray(given, dtype=np.float64))
    if values.ndim != 1 or not np.all(np.isfinite(values) & (values > 0.0)):
        raise ValueError(f"{name}: got {shown(given)}, allowed: finite frequencies above 0")
    return tuple(float(value) for value in values)


def _ambient(background: npt.ArrayLike | BackgroundLight | None, region: npt.NDArray[Any]) -> Ambient:
    std = np.zeros(())
    if isinstance(background, BackgroundLight):
        background, std = background.mean, np.asarray(background.std, dtype=np.float64)
    mean = np.asarray(0.0 if background is None else background, dtype=np.float64)
    shape = (len(region), region.shape[2])
    try:
        np.broadcast_to(mean, shape)
    except ValueError:
        raise ValueError(f"background: got shape {mean.shape}, allowed: one value, {shape[1:]} or {shape}") from None
    if not (np.abs(mean) <= _MOST).all():
        raise ValueError(f"background: got {mean}, allowed: finite values of at most 1e60")
    return Ambient(mean, std, mean.ndim == 0)


def _fitted(
    region: npt.NDArray[Any], camera: Camera, request: Request, tones: list[float], background: float
) -> tuple[Fitted | None, Flag, float]:
    """The fit at the given or estimated frequency, None if there is none; flags; the relative error of the gain by
    harmonics that fall onto the mean or the fundamental."""
    rows = region.shape[1]
    flags = Flag(0)
    if request.frequency is None:
        columns = search_columns(region, camera, tones)
        search: Literal["square", "auto"] = "square" if request.waveform == "square" else "auto"
        found = find_frequency(columns, camera, bounds=request.bounds, waveform=search, select=False)
        flags = found.flags & ~Flag.SATURATED
        if found.may_be_texture:
            flags &= ~Flag.MODEL_MISFIT
        if found.flags & Flag.NO_TONE:
            return None, flags, 0.0
        cycles = found.cycles_per_row
    else:
        cycles = request.frequency * camera.row_period
        flags = Flag.FEW_CYCLES if cycles * rows < 1.0 else Flag(0)
    folded = abs((cycles + 0.5) % 1.0 - 0.5)
    harmonics: tuple[int, ...] = (1,)
    folding = 0.0
    if request.waveform == "square":
        exposure = camera.row_period if camera.exposure is None else camera.exposure
        harmonics, folding = harmonics_of(request.duty, cycles, rows, cycles * exposure / camera.row_period)
    model = make_model(rows, cycles, harmonics, tones)
    if rows < model.design.shape[1] + 1 or min(folded, 0.5 - folded) < _RESOLVED:
        return None, flags | Flag.UNRESOLVABLE, 0.0
    lit = Columns(region, camera, repeated=True)
    model = with_tones_shaped_by_light(lit, model, background, tones)
    if request.frequency is not None:
        return fit(lit, model), flags, folding
    model = refine(lit, with_harmonics_above_noise(fit(lit, model), tones), tones)
    if model.cycles < _RESOLVED:  # slow light explains the columns better than any tone
        return None, flags | Flag.NO_TONE, 0.0
    fitted = fit(lit, model)
    return dataclasses.replace(fitted, cycles_std=frequency_std(lit, fitted)), flags, folding


def _component_variance(fitted: Fitted) -> float:
    """Variance of the real and imaginary part of a column's tone, mean over the columns."""
    first = fitted.model.first
    c = fitted.model.covariance
    return float(np.nan_to_num(fitted.noise).mean() * 0.5 * (c[first, first] + c[first + 1, first + 1]))


def _timed(camera: Camera, times: tuple[float, ...] | None, frames: int) -> tuple[Camera, Float64s]:
    """The camera with the mean frame time of its time stamps, and (frames,) times after those of even frames, s."""
    if times is None:
        return camera, np.zeros(frames)
    if len(times) != frames:
        raise ValueError(f"frame_times: got {len(times)} values, allowed: {frames}, one for each frame")
    if frames < 2:
        return camera, np.zeros(frames)
    number, stamps = np.arange(frames), np.asarray(times, dtype=np.float64)
    slope, start = np.polynomial.Polynomial.fit(number, stamps - stamps[0], 1).convert().coef[::-1]
    return dataclasses.replace(camera, frame_time=float(slope)), stamps - stamps[0] - start - slope * number


def _phase_advances(fitted: Fitted, camera: Camera, late: Float64s) -> tuple[PhaseAdvance, PhaseAdvance]:
    """Phase advances from column to column and from frame to frame, with ``late`` frames set right.

    Late frames turn a light, or a texture that moves across the rows, by its frequency; they hardly turn a slow motion
    along the rows. The hypothesis with less scatter is kept.
    """
    variance = _component_variance(fitted)
    turned = fitted.tone * np.exp(-2j * np.pi * fitted.model.cycles / camera.row_period * late)[:, None]
    advances = [phase_advance(tone, variance) for tone in ((turned, fitted.tone) if late.any() else (fitted.tone,))]
    return phase_advance(fitted.tone.T, variance), min(advances, key=lambda one: one.std)


def _common_phase(fitted: Fitted, advance: PhaseAdvance) -> tuple[bool, bool]:
    """True if all columns have one phase; True if that is uncertain."""
    spread, significant = phase_spread(fitted.tone, _component_variance(fitted))
    common = not (significant and spread > _COMMON_PHASE)
    unsure = not (4.0 * advance.std * fitted.tone.shape[1] < 0.25)
    creeping = common and abs(advance.cycles) > 5.0 * advance.std and spread > 0.2 * _COMMON_PHASE
    return common, common and (unsure or creeping)


def _changes(fitted: Fitted) -> bool:
    """True if a frame shows the tone by a tenth more or less deep than most: a cut, another lamp, another speed."""
    light = fitted.mean.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):  # frames without light
        depth, std = np.linalg.norm(fitted.tone, axis=1) / light, math.sqrt(_component_variance(fitted)) / light
    return do_differ(depth, std)


def _theory(frequency: float, camera: Camera) -> tuple[float, Flag]:
    if camera.exposure is None or not math.isfinite(frequency):
        return math.nan, Flag(0)
    theory = abs(float(np.sinc(frequency * camera.exposure)))
    return theory, Flag.NEAR_NULL if theory < 0.05 else Flag(0)


def _gains(
    region: npt.NDArray[Any],
    camera: Camera,
    fitted: Fitted,
    advance: PhaseAdvance,
    ambient: Ambient,
    ratio: float,
    folding: float,
) -> dict[str, Any]:
    """Gains along the columns and over the frames, contrasts, mean and flags."""
    pooled = pooled_gain(fitted, ambient, Columns(region, camera))
    cut = error_by_black(region, camera, fitted, ambient)
    std = math.hypot(pooled.std, folding * pooled.gain, cut)
    facts: dict[str, Any] = {
        "gain": pooled.gain / ratio,
        "gain_std": std / ratio,
        "contrast": pooled.gain,
        "contrast_range": contrast_range(fitted),
        "mean": pooled.mean,
        "snr": pooled.snr / ratio**2,
        "flags": Flag(0),
    }
    if not pooled.mean > 0.0 or math.isnan(pooled.gain):
        facts["flags"] |= Flag.NO_LIGHT
    elif pooled.gain < 3.0 * std:
        facts["flags"] |= Flag.WEAK
    if is_rounded(region, camera, fitted, ambient, pooled):
        facts["flags"] |= Flag.QUANTISED
    series = None if math.isnan(advance.cycles) else over_frames(region, camera, advance.cycles, fitted)
    if series is not None:
        every = Ambient(_per_pixel(ambient.mean, region), _per_pixel(ambient.std, region), ambient.shared)
        course = pooled_gain(series, every)
        facts |= {
            "frames_gain": course.gain / ratio,
            "frames_gain_std": math.hypot(pooled.shared * course.std, cut) / ratio,
        }
    return facts


def _per_pixel(values: Float64s, region: npt.NDArray[Any]) -> Float64s:
    """Expand values of columns to the pixels of a frame, averaged over the frames."""
    if values.ndim == 0:
        return values
    per_column = np.broadcast_to(values, (len(region), region.shape[2])).mean(axis=0)
    return np.tile(per_column, region.shape[1])


def _column_flags(
    region: npt.NDArray[Any], timing: Camera, fitted: Fitted, tones: list[float], request: Request
) -> Flag:
    """Flags of ``tone_gain`` and ``varying_tone_gain`` in at least half of the columns of the first frame; saturation
    in a tenth; rounding also in half of the frames, pooled."""
    step = max(1, region.shape[2] // _JUDGED)
    columns = region[0][:, ::step]
    frequency = fitted.model.cycles / timing.row_period
    every = [frequency, *(f / timing.row_period for f in tones)]
    waveform: Any = "tone" if tones else request.waveform
    masks = tone_gain(columns, timing, every, waveform=waveform, duty=request.duty).flags[0]
    if not tones:
        masks = masks | varying_tone_gain(columns, timing, frequency, waveform=waveform, duty=request.duty).flags
    flags = _shared_flags(masks, ~_POOLED_FLAGS)
    pooled = tone_gain(region, timing, every, waveform=waveform, duty=request.duty, pooled=True).flags[0]
    if 2 * np.count_nonzero(pooled & Flag.QUANTISED) >= pooled.size:
        flags |= Flag.QUANTISED
    return flags


def _shared_flags(masks: npt.NDArray[np.uint32], which: Flag) -> Flag:
    """Those of some flags that half of the columns have; SATURATED a tenth."""
    flags = Flag(0)
    for bit in Flag:
        share = np.count_nonzero(masks & bit & which) / masks.size
        if share >= (0.1 if bit == Flag.SATURATED else 0.5):
            flags |= bit
    return flags


_JUDGED = 64
_FEW = 4  # frames that tell how much black cuts off
_ANY = 0.3  # cycles per row of a wave of which all harmonics are above half the row rate
_RESOLVED = 1e-12  # cycles per row
_POOLED_FLAGS = Flag.WEAK | Flag.NO_LIGHT | Flag.NEAR_NULL | Flag.FEW_CYCLES | Flag.HARMONICS_DROPPED
