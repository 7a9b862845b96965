"""Control of a camera's exposure by measurements of the receiver and the sensing side in the last frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, asdict, dataclass, field

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.checks import InnerShare, ShareAboveZero, ShareBelowOne, checked, checked_class
from ocisac_fast.core.flags import Named
from ocisac_fast.core.results import Result
from ocisac_fast.exposure.choice import BestExposure

_NAN = math.nan


class ExposureReason(Named):
    """Reasons for the choice of an exposure; several may apply."""

    FIRST = 1 << 0
    HELD = 1 << 1
    MOVED = 1 << 2
    BRIGHTNESS_FLOOR = 1 << 3
    CEILING = 1 << 4
    SATURATION = 1 << 5
    TOO_DARK = 1 << 6
    TOO_BRIGHT = 1 << 7
    FLOOR_GIVEN_UP = 1 << 8
    NO_TONES = 1 << 9
    WEAK_LEFT_OUT = 1 << 10
    GAIN_MISMATCH = 1 << 11
    NO_BRIGHTNESS = 1 << 12


_TEXTS = {
    ExposureReason.FIRST: "the first choice",
    ExposureReason.HELD: "kept: the best would gain no more than the hysteresis",
    ExposureReason.MOVED: "moved: the last exposure fell behind the best by more than the hysteresis, or out of bounds",
    ExposureReason.BRIGHTNESS_FLOOR: "not shorter, or the picture is too dark",
    ExposureReason.CEILING: "not longer, or the brightest parts saturate",
    ExposureReason.SATURATION: "not longer, since pixels were saturated",
    ExposureReason.TOO_DARK: "the camera cannot reach the requested brightness",
    ExposureReason.TOO_BRIGHT: "the camera cannot avoid saturation",
    ExposureReason.FLOOR_GIVEN_UP: "bright and dark parts cannot both be kept: the bright ones are",
    ExposureReason.NO_TONES: "no tone to choose by, brightness alone",
    ExposureReason.WEAK_LEFT_OUT: "tones of no known frequency or of too little signal are left out",
    ExposureReason.GAIN_MISMATCH: "a measured gain is not |sinc(f T)|: frequency, exposure or background is off",
    ExposureReason.NO_BRIGHTNESS: "brightness is not known and not looked at",
}


@checked_class
@dataclass(frozen=True, slots=True)
class MeasuredTone:
    """A measured tone of a light or a motion; NaN: unknown.

    Args:
        frequency: f_c or f_x v in Hz, above 0; NaN: the tone is ignored.
        share: weight relative to the other tones of its kind; 0 or above.
        snr: power ratio at the frame's exposure, 0 or above.
        gain, gain_std: at the frame's exposure, as in :func:`ocisac_fast.tone_gain`.
    """

    frequency: float
    _: KW_ONLY
    share: float = 1.0
    snr: float = _NAN
    gain: float = _NAN
    gain_std: float = _NAN


@checked_class
@dataclass(frozen=True, slots=True)
class ExposureMeasurement:
    """Measurements of one frame; levels are shares of the full scale above dark, NaN: unknown.

    Args:
        lights: tones of communication, plain frequencies (Hz) or :class:`MeasuredTone`; at most 32 with the motions.
        motions: tones of sensing.
        exposure: of the frame, s; NaN: the one suggested last.
        gain: of the camera's amplifier in the frame, linear; NaN: the one suggested last.
        level: mean, 0 or above.
        peak: level of the brightest parts that must not saturate, such as a percentile; 0 or above.
        saturated: share of saturated pixels, 0 to 1.
    """

    lights: Sequence[float | MeasuredTone] = ()
    motions: Sequence[float | MeasuredTone] = ()
    _: KW_ONLY
    exposure: float = _NAN
    gain: float = _NAN
    level: float = _NAN
    peak: float = _NAN
    saturated: float = 0.0


@dataclass(frozen=True, slots=True, repr=False)
class ExposureSuggestion(Result):
    """Suggestion of :class:`ExposureController` for the next frame.

    Attributes:
        exposure: s.
        gain: of the camera's amplifier, linear.
        objective: J(exposure) in s; NaN without tones.
        best_exposure, best_objective: the maximum, without hysteresis; NaN without tones.
        bounds: (shortest, longest) exposure that brightness and camera allow, s.
        noise_exposure: T_n, s; infinite where noise is ignored.
        level: expected mean; NaN: unknown.
        reasons: reasons of the choice, :class:`ExposureReason`.
        tones: (kind, frequency, gain, snr) of the measured tones at the suggested exposure; kind is "light" or
            "motion", the gain is theoretical, the signal-to-noise ratio is scaled from the measured one (else NaN).
    """

    exposure: float
    gain: float
    objective: float
    best_exposure: float
    best_objective: float
    bounds: tuple[float, float]
    noise_exposure: float
    level: float
    reasons: ExposureReason
    tones: tuple[tuple[str, float, float, float], ...] = field(default=())

    @property
    def explain(self) -> str:
        """Describe the choice and its reasons in a few lines of text."""
        low, high = self.bounds
        lines = [f"exposure {self.exposure * 1e6:.1f} us, gain {self.gain:.3g}"]
        if not math.isnan(self.best_objective):
            share = self.objective / self.best_objective if self.best_objective > 0 else 1.0
            lines.append(f"objective {share:.2%} of the best, which is at {self.best_exposure * 1e6:.1f} us")
        lines.append(f"allowed: {low * 1e6:.1f} to {high * 1e6:.1f} us")
        if math.isfinite(self.level):
            lines.append(f"expected mean level: {self.level:.1%} of full scale")
        if math.isfinite(self.noise_exposure):
            lines.append(f"shot noise passes read noise at {self.noise_exposure * 1e6:.1f} us")
        for kind, frequency, gain, snr in self.tones:
            snr_text = (
                "" if math.isnan(snr) else f", SNR {10.0 * math.log10(snr):.1f} dB" if snr > 0.0 else ", no signal"
            )
            lines.append(f"{kind} {frequency:.6g} Hz: gain {gain:.3f}{snr_text}")
        return "\n".join([*lines, *(text for reason, text in _TEXTS.items() if reason in self.reasons)])


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class LevelTargets:
    """Brightness that :class:`ExposureController` keeps, in shares of the full scale above dark.

    Args:
        floor: lower bound of the mean, 0 (none) to below 1.
        aim: target of the mean, above 0 and below 1.
        ceiling: upper bound of the peak, above 0 up to 1.
        max_saturated: share of pixels above which the frame counts as saturated; 0 to below 1. Exposure times gain is
            then reduced to 0.7 of its value, and the limit, relative to the scene's brightness, recovers by 0.2 % per
            frame.
    """

    floor: ShareBelowOne = 0.05
    aim: InnerShare = 0.4
    ceiling: ShareAboveZero = 0.9
    max_saturated: ShareBelowOne = 0.01


@checked_class
class ExposureController:
    """Suggest exposure and gain of the next frame.

    Maximises, within the limits of camera and brightness,

        J(T) = sum_i w_i |sin(pi f_i T)| / (pi f_i) / sqrt(1 + T / T_n),

    the paper's objective (eq. 18, with magnitudes) over the noise: read noise, and shot noise that grows with the
    light and equals it at T_n = ``noise_level`` / (level per second at gain 1). Without ``noise_level`` or a measured
    level it is the paper's objective. The maximum is global, to 1e-12 of J. The last exposure is kept while its loss is
    within the hysteresis: J(suggested) (1 + hysteresis) >= J(T) for every allowed T and the measured tones.

    Exposure and gain together keep the mean above the floor and the peak below the ceiling of ``levels``; in a conflict
    the ceiling has priority. Within these limits the gain brings the mean to the aim.

    Args:
        exposures: (shortest, longest) exposure of the camera, s, 0 < shortest <= longest.
        step: restrict exposures to whole multiples of it, s, such as the row time; 0: any.
        gains: (lowest, highest) gain of its amplifier, linear, above 0.
        weights: of all lights together and of all motions together; 0 or above, not both 0.
        hysteresis: 0 or above; 0 selects the maximum at every update.
        levels: brightness to keep; None: the defaults of :class:`LevelTargets`.
        min_snr: tones with a lower signal-to-noise ratio (power) are ignored; 0 or above.
        noise_level: mean level at gain 1 where shot noise equals read noise, above 0; None: noise is independent of
            the exposure.

    Raises:
        ValueError: a value out of its range, or no multiple of ``step`` within ``exposures``.
    """

    def __init__(
        self,
        exposures: tuple[float, float],
        *,
        step: float = 0.0,
        gains: tuple[float, float] = (1.0, 1.0),
        weights: tuple[float, float] = (1.0, 1.0),
        hysteresis: float = 0.01,
        levels: LevelTargets | None = None,
        min_snr: float = 1.0,
        noise_level: float | None = None,
    ) -> None:
        self._controller = _core.ExposureController(
            shortest=exposures[0],
            longest=exposures[1],
            step=step,
            lowest_gain=gains[0],
            highest_gain=gains[1],
            comm_weight=weights[0],
            sense_weight=weights[1],
            hysteresis=hysteresis,
            **asdict(levels or LevelTargets()),
            min_snr=min_snr,
            noise_level=math.inf if noise_level is None else noise_level,
        )
        self._last = _NAN

    @checked
    def update(self, measurement: ExposureMeasurement) -> ExposureSuggestion:
        """Suggest the next exposure after a frame."""
        measured = [("light", _tone(tone)) for tone in measurement.lights]
        measured += [("motion", _tone(tone)) for tone in measurement.motions]
        table = np.array(
            [(t.frequency, kind == "motion", t.share, t.snr, t.gain, t.gain_std) for kind, t in measured], np.float64
        ).reshape(-1, 6)
        values = [measurement.exposure, measurement.gain, measurement.level, measurement.peak, measurement.saturated]
        exposure, gain, objective, best, best_objective, low, high, noise, level, reasons = self._controller.update(
            table, *values
        )
        before = self._last if math.isnan(measurement.exposure) else measurement.exposure
        self._last = exposure
        tones = tuple((kind, t.frequency, *_expected(t, before, exposure, noise)) for kind, t in measured)
        why = ExposureReason(reasons)
        return ExposureSuggestion(
            exposure, gain, objective, best, best_objective, (low, high), noise, level, why, tones
        )

    def reset(self) -> None:
        """Discard the last suggestion and the saturation limit."""
        self._controller.reset()
        self._last = _NAN


@checked
def best_noisy_exposure(
    frequencies: npt.ArrayLike,
    weights: npt.ArrayLike,
    bounds: tuple[float, float],
    *,
    noise_exposure: float = math.inf,
    step: float = 0.0,
) -> BestExposure:
    """The exposure in ``bounds`` that maximises J(T) = sum_i w_i |sin(pi f_i T)| / (pi f_i) / sqrt(1 + T / T_n).

    Args:
        frequencies: Hz, finite, above 0; 1 to 32.
        weights: one for each, finite, 0 or above, not all 0.
        bounds: (shortest, longest) in s, 0 < shortest <= longest, with at most 10 million lobes between.
        noise_exposure: T_n in s, above 0, where shot noise equals read noise; infinite: eq. 18.
        step: restrict exposures to whole multiples of it, s; 0: any.

    Returns:
        The maximum, to 1e-12 of J.

    Raises:
        ValueError: an argument out of its range, or no multiple of ``step`` within ``bounds``.
    """
    each = [np.asarray(values, np.float64) for values in (frequencies, weights)]
    exposure, objective = _core.best_noisy_exposure(each[0], each[1], noise_exposure, *bounds, step)
    return BestExposure(exposure, objective)


def _tone(tone: float | MeasuredTone) -> MeasuredTone:
    return tone if isinstance(tone, MeasuredTone) else MeasuredTone(float(tone))


def _expected(tone: MeasuredTone, before: float, after: float, noise: float) -> tuple[float, float]:
    """Gain and signal-to-noise ratio at the exposure ``after``; the latter is scaled from that at ``before``."""
    was, gain = (abs(float(np.sinc(tone.frequency * exposure))) for exposure in (before, after))
    if not was > 0.0:
        return gain, _NAN
    collected = (after * gain) ** 2 / (1.0 + after / noise) / ((before * was) ** 2 / (1.0 + before / noise))
    return gain, tone.snr * collected
