"""Motion of a texture from its phases in a column and between frames: all possible solutions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

from ocisac_fast.core.checks import Invertible, Positive, Within, checked, checked_class, shown
from ocisac_fast.core.flags import Flag

_MAX_CANDIDATES = 16
_MAX_TURNS = 2000  # between two frames
_CHANCE = 1e-3  # of a solution that frames which say nothing about it seem to confirm


@dataclass(frozen=True, slots=True)
class Seen:
    """Phases of a texture: 2 pi (per_row n + per_frame j), and the camera's times."""

    per_row: float  # cycles, above 0
    per_row_std: float
    per_frame: float  # cycles, in (-1/2, 1/2]; NaN for a single frame
    per_frame_std: float
    row_time: float  # s; NaN if the frame time is unknown
    frame_time: float

    @property
    def frames_known(self) -> bool:
        """True if the advance from frame to frame can be used."""
        return math.isfinite(self.per_frame) and math.isfinite(self.frame_time)


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class KnownMotion:
    """Known motion of a texture, for :func:`sense_region` and :func:`sense`; None where unknown.

    Args:
        axis: ``"across"`` the rows, or ``"along"`` them (or oblique).
        direction: of motion along the rows: 1 with the read-out, -1 against it, 0 unknown.
        pitch: distance of neighbouring pixels in the scene, m, above 0.
        spatial_frequency: of the texture along the motion, 1/m, above 0.
        speed: of the texture, m/s, above 0.
        bounds: lowest and highest f_x v of motion along the rows, Hz, 0 <= low < high; None: 0 to half the row rate.
        frame_times: when the frames begin, s, ascending, one value per frame, such as the time stamps of the camera;
            None: multiples of the camera's frame time.
        timing_tolerance: relative error of the frame time over the row time, above 0 up to 0.01. A component whose
            advance fits c T_f/T_r within it is a light, or moves across the rows; up to ten times the tolerance this is
            flagged; beyond, it moves along the rows.
    """

    axis: Literal["across", "along"] | None = None
    direction: Literal[-1, 0, 1] = 0
    pitch: Positive | None = None
    spatial_frequency: Positive | None = None
    speed: Positive | None = None
    bounds: tuple[float, float] | None = None
    frame_times: tuple[float, ...] | None = None
    timing_tolerance: Annotated[float, Within(0.0, 0.01, above=True)] = 1e-4

    def __post_init__(self) -> None:
        if self.bounds is not None and not (0.0 <= self.bounds[0] < self.bounds[1] < math.inf):
            raise ValueError(f"bounds: got {shown(self.bounds)}, allowed: (low, high), 0 <= low < high, finite")
        times = self.frame_times
        if times is not None and not (all(map(math.isfinite, times)) and all(a < b for a, b in pairwise(times))):
            raise ValueError(f"frame_times: got {shown(times)}, allowed: finite and ascending")

    @checked
    def bounds_for(self, row_time: Invertible) -> tuple[float, float]:
        """``bounds``, or 0 to half the row rate, Hz."""
        return self.bounds or (0.0, 0.5 / row_time)


@dataclass(frozen=True, slots=True)
class Motion:
    """A solution, signed: phases 2 pi (still n + frequency t), t = n T_r + j T_f."""

    frequency: float  # Hz; NaN if not determined
    std: float
    still: float  # cycles per row of the texture at rest, signed
    candidates: tuple[float, ...]  # all frequencies (magnitudes, Hz, ascending) that fit, at most 16
    flags: Flag  # AMBIGUOUS_MOTION, MODEL_MISFIT
    spread: float = 0.0  # RMS distance of all frequencies that fit from the one given, Hz

    @property
    def total_std(self) -> float:
        """Standard error that includes the ambiguity, Hz."""
        return math.hypot(self.std, self.spread)

    @property
    def direction(self) -> int:
        """+1 with the read-out, -1 against it, 0 unknown."""
        product = self.frequency * self.still
        return 0 if not product else -1 if product > 0 else 1


def across_rows(seen: Seen) -> Motion:
    """Motion across the rows: a column shows nothing of the texture at rest."""
    frequency, std = seen.per_row / seen.row_time, seen.per_row_std / seen.row_time
    return Motion(frequency, std, 0.0, (frequency,), Flag(0))


def along_rows(seen: Seen, known: KnownMotion) -> Motion:
    """Motion along the rows: per_row = still + frequency T_r, where still depends on the row pitch."""
    solutions = _from_one_frame(seen, known)
    if solutions is None:
        solutions = _from_frames_alone(seen, known) if seen.frames_known else []
        fits = True
    elif seen.frames_known:
        solutions, fits = _checked_by_frames(seen, known, solutions)
    else:
        fits = True
    kept = [one for one in solutions if _allowed(seen, known, *one)]
    kept.sort(key=lambda one: (abs(one[0]), one[0]))
    if not kept:
        contradicted = Flag.MODEL_MISFIT if solutions else Flag.AMBIGUOUS_MOTION
        return Motion(math.nan, math.nan, math.nan, (), contradicted)
    frequency, std = kept[0]
    flags = Flag(0) if fits else Flag.MODEL_MISFIT
    if len(kept) > 1:
        flags |= Flag.AMBIGUOUS_MOTION
    magnitudes = [abs(one[0]) for one in kept]
    possible = magnitudes if len(kept) == 1 or known.axis == "along" else [*magnitudes, across_rows(seen).frequency]
    spread = math.sqrt(sum((one - abs(frequency)) ** 2 for one in possible) / len(possible))
    still = seen.per_row - frequency * seen.row_time
    return Motion(frequency, std, still, tuple(magnitudes[:_MAX_CANDIDATES]), flags, spread)


def _allowed(seen: Seen, known: KnownMotion, frequency: float, std: float) -> bool:
    still = seen.per_row - frequency * seen.row_time
    moves = -1 if frequency * still > 0 else 1
    low, high = known.bounds_for(seen.row_time)
    return low <= abs(frequency) <= high and (known.direction in (0, moves) or abs(frequency) <= 4.0 * std)


def _from_one_frame(seen: Seen, known: KnownMotion) -> list[tuple[float, float]] | None:
    """Signed frequencies and standard errors that fit one column; None if pitch and texture are unknown."""
    if known.pitch is None or (known.spatial_frequency is None and known.speed is None):
        return None
    if known.spatial_frequency is not None:
        still = known.spatial_frequency * known.pitch
        std = seen.per_row_std / seen.row_time
        return [((seen.per_row - side * still) / seen.row_time, std) for side in (1, -1)]
    assert known.speed is not None
    per_row_time = known.pitch / known.speed  # time in which the texture moves by one row
    spans = [seen.row_time + side * per_row_time for side in (1, -1)]
    return [(seen.per_row / span, seen.per_row_std / abs(span)) for span in spans if span]


def _checked_by_frames(
    seen: Seen, known: KnownMotion, solutions: list[tuple[float, float]]
) -> tuple[list[tuple[float, float]], bool]:
    """Move the solutions to the nearest frequency that also fits the advance from frame to frame.

    False with them if none fits, or only motion that overtakes the read-out, as some does by chance where times are
    wrong.
    """
    fine = seen.per_frame_std / seen.frame_time
    kept, nearest = [], []
    allowed = [one for one in solutions if _allowed(seen, known, *one)] or solutions
    is_likely, must_overtake = False, all(_overtakes(seen, frequency) for frequency, _ in allowed)
    for frequency, std in allowed:
        turns = round(frequency * seen.frame_time - seen.per_frame)
        snapped = (seen.per_frame + turns) / seen.frame_time
        allowance = 4.0 * math.hypot(std, fine) + known.timing_tolerance * abs(frequency)
        nearest.append((abs(snapped - frequency) / allowance if allowance else 0.0, snapped))
        reach = min(int(allowance * seen.frame_time), _MAX_CANDIDATES)
        near = ((seen.per_frame + turns + k) / seen.frame_time for k in range(-reach - 1, reach + 2))
        fitting = [(one, fine) for one in near if abs(one - frequency) <= allowance]
        kept += fitting
        sure = must_overtake or not _overtakes(seen, frequency) or 2.0 * allowance * seen.frame_time < _CHANCE
        is_likely |= sure and bool(fitting)
    if kept:
        return sorted(set(kept)), is_likely
    return [(min(nearest)[1], fine)], False


def _overtakes(seen: Seen, frequency: float) -> bool:
    return abs(frequency) * seen.row_time > abs(seen.per_row - frequency * seen.row_time)


def _from_frames_alone(seen: Seen, known: KnownMotion) -> list[tuple[float, float]]:
    """All frequencies that fit the advance, slow ones first."""
    std = seen.per_frame_std / seen.frame_time
    turns = sorted(range(-_MAX_TURNS, _MAX_TURNS + 1), key=abs)
    frequencies = ((seen.per_frame + k) / seen.frame_time for k in turns)
    low, high = known.bounds_for(seen.row_time)
    return [(f, std) for f in frequencies if low <= abs(f) <= high]
