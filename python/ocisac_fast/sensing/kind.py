"""Classification of a region by its phases: a light, a moving or a still texture, and its motion."""

from __future__ import annotations

import math
from typing import Any, Literal

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.sensing.fit import Fitted, PhaseAdvance
from ocisac_fast.sensing.motion import KnownMotion, Motion, Seen, across_rows, along_rows

Kind = Literal["light", "moving", "still", "unknown"]

_NEAR_MISS = 10.0  # timing tolerances within which a light is not excluded
_SAME_TEXTURE = 0.1  # by which a stated spatial frequency or speed may differ from that of the columns


def seen_by(fitted: Fitted, advance: PhaseAdvance, camera: Camera) -> Seen:
    """Phases from which the motion is computed."""
    frame_time = math.nan if camera.frame_time is None else camera.frame_time
    return Seen(fitted.model.cycles, fitted.cycles_std, advance.cycles, advance.std, camera.row_period, frame_time)


def step_allowance(per_frame_std: float, drift: float, expected: float, tolerance: float) -> float:
    """Cycles by which an advance per frame may miss the ``expected`` one, its standard error being ``drift``.

    Twice that is the probability that the phase of something else advances so.
    """
    return 4.0 * math.hypot(per_frame_std, drift) + tolerance * expected + 1e-6


def kind_of(
    seen: Seen, common: bool, doubt: bool, motion: str | None, tolerance: float
) -> tuple[Kind, str | None, Flag]:
    """Kind of the region, axis of the motion where known, and flags of uncertainty."""
    flags = Flag.AMBIGUOUS_KIND if doubt else Flag(0)
    if seen.frames_known:
        expected = seen.per_row * seen.frame_time / seen.row_time
        drift = seen.per_row_std * seen.frame_time / seen.row_time
        allowance = step_allowance(seen.per_frame_std, drift, expected, tolerance)
        miss = abs((seen.per_frame - expected + 0.5) % 1.0 - 0.5)
        near = miss <= max(allowance, _NEAR_MISS * tolerance * expected)
        still = abs(seen.per_frame) <= 4.0 * seen.per_frame_std + 1e-6
        if allowance < 0.25 and seen.per_frame_std < 0.06 and not (miss <= allowance and still):
            if still:
                return "still", "along", Flag(0)
            if not near:
                return "moving", "along", Flag.MODEL_MISFIT if motion == "across" else Flag(0)
            if common:
                return "light", None, flags if miss <= allowance else Flag.AMBIGUOUS_KIND
            sure = miss <= allowance or motion == "across"
            return "moving", "across", Flag(0) if sure else Flag.AMBIGUOUS_MOTION
    if not common:
        return "moving", motion, Flag(0) if motion else Flag.AMBIGUOUS_KIND
    if motion == "along" or (motion == "across" and doubt):
        return "moving", motion, flags
    return "light", None, Flag.AMBIGUOUS_KIND


def motion_facts(kind: Kind, axis: str | None, seen: Seen, known: KnownMotion, advance: PhaseAdvance) -> dict[str, Any]:
    """Fields of ``SensedRegion`` that describe the motion, and flags."""
    if kind == "still":
        motion = along_rows(seen, known)
        if not abs(motion.frequency) > 4.0 * motion.std + 1e-6 / seen.frame_time:
            std = math.hypot(seen.per_frame_std / seen.frame_time, motion.spread)
            rest = {"motion_frequency": 0.0, "motion_frequency_std": std, "motion_candidates": motion.candidates}
            return {"kind": kind, "speed": 0.0, "flags": motion.flags, **rest}
        kind = "moving"  # by whole cycles per frame
    if kind != "moving":
        return {"kind": kind, "flags": Flag(0)}
    if axis == "along":
        motion = along_rows(seen, known)
        per_pixel, pixel_std = motion.still, math.hypot(seen.per_row_std, motion.total_std * seen.row_time)
        direction = motion.direction
    else:
        motion = across_rows(seen)
        per_pixel, pixel_std = advance.cycles, advance.std
        direction = -int(math.copysign(1, advance.cycles)) if abs(advance.cycles) > 4.0 * advance.std else 0
    flags = motion.flags | (Flag.AMBIGUOUS_MOTION if axis is None else Flag(0))
    speed = _speed(motion, known, abs(per_pixel), pixel_std)
    if not _is_shown(speed, known, per_pixel, pixel_std):
        flags |= Flag.MODEL_MISFIT
    if axis == "along" and known.axis is None and known.pitch is not None and (known.spatial_frequency or known.speed):
        # All of the stated texture is across the rows: times are wrong.
        turned = abs(advance.cycles) > 4.0 * advance.std
        if turned and _is_shown(_speed(across_rows(seen), known, 0.0, 0.0), known, advance.cycles, advance.std):
            flags |= Flag.AMBIGUOUS_MOTION
    return {
        "kind": kind,
        "motion_frequency": abs(motion.frequency),
        "motion_frequency_std": motion.total_std,
        "motion_candidates": motion.candidates,
        "direction": direction,
        "flags": flags,
        **speed,
    }


def _is_shown(speed: dict[str, float], known: KnownMotion, per_pixel: float, std: float) -> bool:
    """True if the texture of a ``_speed`` has these cycles per pixel, or no pitch tells them."""
    if known.pitch is None:
        return True
    stated = speed["spatial_frequency"] * known.pitch
    allowed = 4.0 * std if math.isfinite(std) else math.inf
    return math.isclose(stated, abs(per_pixel), rel_tol=_SAME_TEXTURE, abs_tol=allowed)


def _speed(motion: Motion, known: KnownMotion, per_pixel: float, pixel_std: float) -> dict[str, float]:
    """Speed and spatial frequency: one is given and the other follows from f_x v; or from cycles over pitch."""
    frequency = abs(motion.frequency)
    if known.spatial_frequency is not None:
        texture, texture_std = known.spatial_frequency, 0.0
    elif known.speed is not None:
        return {
            "speed": known.speed,
            "speed_std": 0.0,
            "spatial_frequency": frequency / known.speed,
            "spatial_frequency_std": motion.total_std / known.speed,
        }
    elif known.pitch is not None:
        texture, texture_std = per_pixel / known.pitch, pixel_std / known.pitch
    else:
        return {}
    speed = frequency / texture if texture > 0.0 else math.nan
    relative = (
        math.hypot(motion.total_std / frequency, texture_std / texture) if frequency * texture > 0.0 else math.nan
    )
    return {
        "speed": speed,
        "speed_std": speed * relative,
        "spatial_frequency": texture,
        "spatial_frequency_std": texture_std,
    }
