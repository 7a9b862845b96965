"""Estimation of a row light slower than 128 rows per cycle: mains at a few cycles a picture.

All pixels of a row have the light in common, and so they have part of the picture: horizons, shades, vignettes. The
cosine modes of the course that the columns have in common tell them apart. Those of a picture decrease with their
order k as k^-1.5, by a factor S that is the picture's own; a tone stands out of them. Where frames follow each other,
the picture stays, and the phase of the tone advances by the same step from frame to frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cleaning.stored import merged

FloatArray = npt.NDArray[np.float64]

SLOWEST_PERIOD = 128  # rows per cycle, above which a light is slow
_LEAST_CYCLES, _MOST_CYCLES = 0.4, 16.0  # in the picture
_GROUPS = 12  # of columns, whose agreement gives the variance of their common course
_COLUMNS = 64  # bundles
_LEAST_VARIANCE = 1e-8  # of a mode
_TEXTURE = 0.03  # relative difference of neighbouring blocks that texture causes
_LAGS = (1, 2, 4, 8)  # blocks
_STEPS, _WIDE_STEPS = 12, 6  # of the robust fit; those with a larger texture, so that bands are not taken for edges
_FALL = 1.5  # of a picture's modes with their order; fitted to photographs
_SPREADS = np.exp(np.linspace(np.log(0.004), 0.0, 10))  # S of a picture
_FLOORS = (0.0, 0.005, 0.01, 0.02)  # standard deviation that texture adds to every mode
_USUAL_SPREAD, _LOG_SPREAD = 0.1, 1.0  # median of S; standard deviation of its logarithm
_CHANGES = np.exp(np.linspace(np.log(0.001), np.log(0.2), 4))  # the same of what changes from frame to frame
_TRENDS = (0.5, 0.5, 0.1, 0.05)  # standard deviations of a linear to quartic course: vignettes, skies
_DEPTH = 0.15  # expected size of a tone's cosine and sine
_HARMONIC = 0.35  # of the second harmonic, relative to it
_COLOURS_DIFFER = 0.35  # relative deviation of a colour's tone from that of all
_PHASE_STEPS = 16
_MAINS = (100.0, 120.0)  # Hz
_REAL_ROW_TIME = 1e-3  # s; a larger one is no camera's, but a unit
_SURE, _LIKELY = float(np.log(400.0)), float(np.log(10.0))  # odds of a light against none: it is removed, it is said
_CLEAR = 3.0  # standard errors of its amplitude
_OF_GROUPS = 0.5  # expected size of the terms of a group of columns: hardly a bound
_NOT_SURE = "slow bands that the picture's own shades may be"
MOST_FRAMES = 8  # that are compared
_MIN_LEVEL, _MAX_WORSE = 0.25, 0.25


@dataclass(frozen=True, slots=True, eq=False)
class CommonCourse:
    """Cosine modes 1 to K of the log light that the columns of a picture have in common.

    Attributes:
        modes: (modes,).
        variance: (modes,) of what the groups of columns have not in common.
        groups: (groups, modes) those of each group of columns.
    """

    modes: FloatArray
    variance: FloatArray
    groups: FloatArray

    def less(self, other: CommonCourse) -> CommonCourse:
        """The difference of the logarithms."""
        return CommonCourse(self.modes - other.modes, self.variance + other.variance, self.groups - other.groups)

    def of_group(self, group: int) -> CommonCourse:
        """The course of one group of columns."""
        return CommonCourse(self.groups[group], self.variance * len(self.groups), self.groups)


@dataclass(frozen=True, slots=True, eq=False)
class SlowTone:
    """A tone in the log light of the rows.

    Attributes:
        cycles: in the picture.
        step: advance of its phase from frame to frame, rad.
        terms: (4,) cosine and sine about the middle row, and those of the second harmonic, in the first frame.
        covariance: (2, 2) of the fundamental's terms, with the doubt about the phase step.
        log_odds: natural logarithm of the odds of the tone against none.
    """

    cycles: float
    step: float
    terms: FloatArray
    covariance: FloatArray
    log_odds: float

    @property
    def amplitude(self) -> float:
        """Amplitude of the fundamental, relative to the light."""
        return float(np.hypot(*self.terms[:2]))

    @property
    def is_sure(self) -> bool:
        """The evidence is enough to remove it: the rest is smaller than the tone, and there is a tone."""
        error = float(np.sqrt(np.trace(self.covariance[:2, :2]) / 2))
        return self.log_odds > _SURE and self.amplitude > _CLEAR * error and self.cycles > 1.1 * _LEAST_CYCLES

    def in_frame(self, frame: int) -> SlowTone:
        """The tone with its phase in another frame."""
        return replace(self, terms=_rotations(np.array([self.step]), np.array([frame]))[0, 0] @ self.terms)

    def light(self, rows: int) -> FloatArray:
        """(rows,) its light, mean 1."""
        course = np.exp(_tone(self.cycles, (np.arange(rows) + 0.5) / rows) @ self.terms)
        return np.asarray(course / course.mean())

    def depth(self, rows: int) -> float:
        """How far the darkest row is below the mean light."""
        return float(1 - self.light(rows).min())


@dataclass(frozen=True, slots=True, eq=False)
class SlowLight:
    """Slow light of one frame.

    Attributes:
        tones: of each colour.
        course: of all colours, which following frames are compared with.
        amplitude: of the tone, relative to the light; 0 where none is likely.
        verdict: agreement of the columns.
        objection: why it is not removed, or "".
    """

    tones: list[SlowTone]
    course: CommonCourse
    amplitude: float
    verdict: SlowVerdict
    objection: str


def find_slow_lights(
    light: FloatArray,
    variance: FloatArray,
    camera: Camera,
    earlier: Sequence[CommonCourse] = (),
    near: SlowTone | None = None,
) -> list[SlowLight]:
    """Estimate the slow light of (frames, rows, columns, colours) linear light of one scene.

    ``earlier``: courses of the frames before the first one; ``near``: the tone of those, if it is known.
    """
    of_frames = [_courses(*one) for one in zip(light, variance, strict=True)]
    courses = [*earlier, *[one[0] for one in of_frames]]
    compared: dict[int, tuple[SlowTone, SlowVerdict]] = {}  # by the first of the frames
    found = []
    for frame, (course, of_colours) in enumerate(of_frames, len(earlier)):
        start = max(0, min(frame - MOST_FRAMES // 2, len(courses) - MOST_FRAMES))
        if start not in compared:
            these = courses[start : start + MOST_FRAMES]
            first = find_slow_tone(these, light.shape[1], camera.row_period, camera.frame_time, near)
            compared[start] = first, agreement_of_groups(these, first)
            near = first if first.is_sure else None
        first, verdict = compared[start]
        tone = first.in_frame(frame - start)
        found.append(
            SlowLight(
                tones=tones_of_colours(course, of_colours, tone),
                course=course,
                amplitude=tone.amplitude if tone.log_odds > _LIKELY else 0.0,
                verdict=verdict,
                objection=verdict.objection if tone.is_sure else _NOT_SURE,
            )
        )
    return found


def _courses(light: FloatArray, variance: FloatArray) -> tuple[CommonCourse, list[CommonCourse]]:
    """The course of all colours of a frame (rows, columns, colours), and that of each."""
    each = [common_course(light[..., c], variance[..., c]) for c in range(light.shape[2])]
    return (each[0] if len(each) == 1 else common_course(light.sum(axis=2), variance.sum(axis=2))), each


def common_course(light: FloatArray, variance: FloatArray) -> CommonCourse:
    """The course of the log of (rows, columns) linear light that the columns have in common.

    Differences of blocks of pixels along the rows are fitted with a redescending weight, since edges are few.
    """
    most = mode_count(len(light))
    height, width = max(1, len(light) // (4 * most)), max(1, -(-light.shape[1] // _COLUMNS))
    light, variance = merged(*merged(light, variance, height, axis=0), width, axis=1)
    usable = np.maximum(light, 1e-3 * max(float(light.mean()), 1e-100))
    level, noise = np.log(usable), variance / usable**2
    modes = _modes((np.arange(len(level)) + 0.5) / len(level), most)
    lags = [lag for lag in _LAGS if lag < len(level)]
    design = np.concatenate([modes[lag:] - modes[:-lag] for lag in lags])
    change = np.concatenate([level[lag:] - level[:-lag] for lag in lags])
    spread = np.concatenate([noise[lag:] + noise[:-lag] for lag in lags])
    fitted = np.zeros(most)
    for step in range(_STEPS):
        texture = _TEXTURE * max(1, _WIDE_STEPS - step)
        weight = 1 / (texture**2 + spread + (change - (design @ fitted)[:, None]) ** 2)
        fitted = _solved(design, weight, change)
    parts = np.array_split(np.arange(change.shape[1]), min(_GROUPS, change.shape[1]))
    groups = np.stack([_solved(design, weight[:, part], change[:, part]) for part in parts])
    without = [np.setdiff1d(np.arange(change.shape[1]), part) for part in parts]
    others = np.stack([_solved(design, weight[:, rest], change[:, rest]) if len(rest) else fitted for rest in without])
    jackknife = (len(parts) - 1) / len(parts) * ((others - others.mean(axis=0)) ** 2).sum(axis=0)
    return CommonCourse(fitted, jackknife + _LEAST_VARIANCE, groups)


def mode_count(rows: int) -> int:
    """Number of modes: those of the second harmonic of the fastest slow tone."""
    return max(min(24, rows // 4), int(np.ceil(4 * min(1.1 * rows / SLOWEST_PERIOD, _MOST_CYCLES))))


def _solved(design: FloatArray, weight: FloatArray, change: FloatArray) -> FloatArray:
    normal = design.T @ (weight.sum(axis=1)[:, None] * design)
    ridge = 1e-6 * max(float(np.trace(normal)) / len(normal), 1e-300)
    return np.linalg.solve(normal + ridge * np.eye(len(normal)), design.T @ (weight * change).sum(axis=1))


def _modes(place: FloatArray, count: int) -> FloatArray:
    """(places, modes) cosines, ``place`` from 0 to 1."""
    return np.cos(np.pi * np.outer(place, np.arange(1, count + 1)))


def _tone(cycles: float, place: FloatArray) -> FloatArray:
    """(places, 4) cosine and sine of the fundamental and of the second harmonic."""
    angle = 2 * np.pi * cycles * (place - 0.5)
    return np.stack([np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)], axis=1)


@cache
def _trends(count: int) -> FloatArray:
    """(modes, trends) modes of the slow courses of pictures, scaled by their standard deviations."""
    place = (np.arange(8 * count) + 0.5) / (8 * count)
    courses = np.stack([size * (2 * place - 1) ** (k + 1) for k, size in enumerate(_TRENDS)], axis=1)
    return np.asarray(_modes(place, count).T @ courses / (4 * count))


@dataclass(frozen=True, slots=True, eq=False)
class _Hypotheses:
    """Tones that are tried: (tones,) cycles, phase steps, probabilities before; (tones, modes, 4) their modes."""

    cycles: FloatArray
    steps: FloatArray
    prior: FloatArray
    modes: FloatArray


def _hypotheses(cycles: FloatArray, steps: FloatArray, prior: FloatArray, count: int) -> _Hypotheses:
    place = (np.arange(8 * count) + 0.5) / (8 * count)
    basis = _modes(place, count).T / (4 * count)
    each, of_tone = np.unique(cycles, return_inverse=True)
    modes = np.stack([basis @ _tone(one, place) for one in each])
    return _Hypotheses(cycles, steps, prior, modes[of_tone])


def _of_all(rows: int, row_time: float, frame_time: float | None, frames: int, count: int) -> _Hypotheses:
    """Tones of every frequency and phase step; mains have half of the probability where the row time is known."""
    most = min(max(1.1 * rows / SLOWEST_PERIOD, 2.5), _MOST_CYCLES)
    ladder = [_LEAST_CYCLES]
    while ladder[-1] < most:
        ladder.append(ladder[-1] + min(0.06 * ladder[-1], 0.25))
    turn = 2 * np.pi * np.arange(_PHASE_STEPS) / _PHASE_STEPS if frames > 1 else np.zeros(1)
    cycles, steps = (part.ravel() for part in np.meshgrid(ladder, turn, indexing="ij"))
    prior = np.full(cycles.size, 1 / cycles.size)
    mains = [f for f in _MAINS if row_time < _REAL_ROW_TIME and _LEAST_CYCLES < f * row_time * rows < most]
    for hertz in mains:
        known = turn if frames == 1 or frame_time is None else np.array([2 * np.pi * hertz * frame_time % (2 * np.pi)])
        cycles = np.append(cycles, np.full(known.size, hertz * row_time * rows))
        steps = np.append(steps, known)
        prior = np.append(prior, np.full(known.size, 1 / (known.size * len(mains))))
    return _hypotheses(cycles, steps, prior / prior.sum(), count)


def find_slow_tone(
    courses: list[CommonCourse],
    rows: int,
    row_time: float,
    frame_time: float | None = None,
    near: SlowTone | None = None,
) -> SlowTone:
    """The likeliest slow tone in consecutive frames of one scene, as in the first of them, and its odds against none.

    ``near``: a tone whose cycles and phase step are nearly those.
    """
    count, frames = len(courses[0].modes), len(courses)
    tried = _around(near, frames, count) if near else _of_all(rows, row_time, frame_time, frames, count)
    first = best = _likeliest(courses, tried)
    if not near and not np.isclose(first.cycles, [f * row_time * rows for f in _MAINS], rtol=1e-9).any():
        best = _likeliest(courses, _around(first, frames, count))
    best = with_cycles(courses, best, _DEPTH, _HARMONIC * best.amplitude)
    return replace(best, covariance=first.covariance, log_odds=first.log_odds)


def _around(tone: SlowTone, frames: int, count: int) -> _Hypotheses:
    cycles = tone.cycles * (1 + 0.06 * np.linspace(-0.5, 0.5, 9))
    steps = tone.step + (np.linspace(-0.5, 0.5, 9) * 2 * np.pi / _PHASE_STEPS if frames > 1 else np.zeros(1))
    cycles, steps = (part.ravel() for part in np.meshgrid(cycles, steps, indexing="ij"))
    return _hypotheses(cycles, steps, np.full(cycles.size, 1 / cycles.size), count)


def with_cycles(courses: list[CommonCourse], tone: SlowTone, *expected: float) -> SlowTone:
    """A tone of known cycles and phase step, its terms fitted again; ``expected``: their size, for each harmonic."""
    only = _hypotheses(np.array([tone.cycles]), np.array([tone.step]), np.ones(1), len(courses[0].modes))
    return replace(_likeliest(courses, only, expected), log_odds=tone.log_odds)


def tones_of_colours(all_colours: CommonCourse, colours: list[CommonCourse], tone: SlowTone) -> list[SlowTone]:
    """The tone of each colour: that of all, and what the colour's course differs by."""
    if len(colours) == 1:
        return [tone]
    found = []
    for own in colours:
        differ = _COLOURS_DIFFER * tone.amplitude
        apart = with_cycles([own.less(all_colours)], tone, differ, _HARMONIC * differ)
        found.append(replace(tone, terms=tone.terms + apart.terms))
    return found


@dataclass(frozen=True, slots=True)
class SlowVerdict:
    """Agreement of the groups of columns about a slow tone.

    Attributes:
        left: swing of the tone in the groups after its removal, over that before.
        worse: share of the groups whose tone grows.
        level: coherence of the groups' tones, 1 for level bands of one depth, 0 for tilted ones.
        energy: of the groups' tones before.
    """

    left: float
    worse: float
    level: float
    energy: float

    @property
    def objection(self) -> str:
        """Why the picture is better left alone; "" where it is not."""
        if self.level < _MIN_LEVEL:
            return "slow bands that tilt or curve"
        return "slow bands of a light on some of the columns" if self.worse > _MAX_WORSE else ""


def agreement_of_groups(courses: list[CommonCourse], tone: SlowTone) -> SlowVerdict:
    """Compare the tone, as in the first of the frames, with that of each group of columns."""
    count = len(courses[0].groups)
    own = np.stack([
        with_cycles([one.of_group(group) for one in courses], tone, _OF_GROUPS).terms[:2] for group in range(count)
    ])  # fmt: skip
    before, after = (own**2).sum(axis=1), ((own - tone.terms[:2]) ** 2).sum(axis=1)
    energy = max(float(before.sum()), 1e-300)
    return SlowVerdict(
        left=float(np.sqrt(after.sum() / energy)),
        worse=float(np.mean(after > before)),
        level=float((own.mean(axis=0) ** 2).sum()) * len(own) / energy,
        energy=energy,
    )


def _rotations(steps: FloatArray, frames: npt.NDArray[np.int64]) -> FloatArray:
    """(steps, frames, 4, 4) advance of the phases of both harmonics."""
    result = np.zeros((len(steps), len(frames), 4, 4))
    for harmonic in (1, 2):
        angle = harmonic * steps[:, None] * frames
        at = 2 * (harmonic - 1)
        result[..., at, at] = result[..., at + 1, at + 1] = np.cos(angle)
        result[..., at, at + 1], result[..., at + 1, at] = np.sin(angle), -np.sin(angle)
    return result


def _likeliest(
    courses: list[CommonCourse],
    tried: _Hypotheses,
    expected: tuple[float, ...] = (_DEPTH,),
) -> SlowTone:
    """Bayesian comparison of the tones with none; returns the likeliest tone, with the log odds of all together.

    The modes of the picture, of what changes from frame to frame, and the terms, whose standard deviations are
    ``expected``, are Gaussian. The factors S, floors and changes are summed over.
    """
    modes, variance = np.stack([one.modes for one in courses]), np.mean([one.variance for one in courses], axis=0)
    of_rest = _variance_of_changes(courses)
    frames, count = modes.shape
    fall = np.arange(1, count + 1) ** (-2 * _FALL)
    size = 2 * len(expected)
    turns = _rotations(tried.steps, np.arange(frames))[..., :size, :size]
    still = turns.mean(axis=1)  # (tones, terms, terms)
    of_tones = tried.modes[:, :, :size]
    mean, rest = modes.mean(axis=0), modes - modes.mean(axis=0)
    trend = _trends(count)
    none, normal, right = [], [], []  # by S: log evidence; (tones, terms, terms), (tones, terms)
    for spread, floor in product(_SPREADS, _FLOORS):
        covariance = np.diag(spread**2 * fall + floor**2 + variance / frames) + trend @ trend.T
        inverse = np.linalg.inv(covariance)
        before = -0.5 * (np.log(spread / _USUAL_SPREAD) / _LOG_SPREAD) ** 2
        none.append(before - 0.5 * (np.linalg.slogdet(covariance)[1] + mean @ inverse @ mean))
        seen = of_tones @ still
        normal.append(np.swapaxes(seen, 1, 2) @ inverse @ seen)
        right.append(np.swapaxes(seen, 1, 2) @ (inverse @ mean))
    moving = turns - still[:, None]
    of_changes: list[tuple[float, FloatArray, FloatArray]] = []
    for change in _CHANGES if frames > 1 else ():
        weight = 1 / (change**2 * fall + of_rest)
        weighted = np.swapaxes(of_tones, 1, 2) * weight
        gram, seen = weighted @ of_tones, weighted @ rest.T  # (tones, terms, terms), (tones, terms, frames)
        of_changes.append((
            0.5 * float((frames - 1) * np.log(weight).sum() - (weight * rest**2).sum()),
            (np.swapaxes(moving, 2, 3) @ gram[:, None] @ moving).sum(axis=1),
            np.einsum("tfji,tjf->ti", moving, seen),
        ))  # fmt: skip
    if not of_changes:
        of_changes.append((0.0, np.zeros((1, size, size)), np.zeros((1, size))))
    sizes = np.maximum(np.repeat(expected, 2), 1e-9)
    nothing = np.array([[one + change[0] for change in of_changes] for one in none])  # (S, changes)
    gram = np.stack([[one + change[1] for change in of_changes] for one in normal]) + np.diag(sizes**-2.0)
    pull = np.stack([[one + change[2] for change in of_changes] for one in right])
    spread_of_terms, log_size = _inverse(gram)  # (S, changes, tones, terms, terms)
    terms = (spread_of_terms @ pull[..., None])[..., 0]
    gain = 0.5 * ((pull * terms).sum(axis=-1) - log_size) - np.log(sizes).sum()
    evidence = nothing[..., None] + gain
    likelihood = _log_sum(evidence.reshape(-1, len(tried.prior)))
    best = int(np.argmax(likelihood))
    found, covariance = _posterior(evidence, terms, spread_of_terms, best)
    same = np.flatnonzero(tried.cycles == tried.cycles[best])
    covariance += np.eye(size) * _ambiguity(likelihood[same], evidence[..., same], terms[:, :, same], turns[same])
    log_odds = float(_log_sum((likelihood + np.log(tried.prior))[:, None])[0] - _log_sum(nothing.reshape(-1, 1))[0])
    all_terms = np.concatenate([found, np.zeros(4 - size)])
    return SlowTone(float(tried.cycles[best]), float(tried.steps[best]), all_terms, covariance, log_odds)


def _posterior(evidence: FloatArray, terms: FloatArray, spread: FloatArray, tone: int) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of the terms of one of the tones over all S and changes."""
    share = np.exp(evidence[..., tone] - evidence[..., tone].max())
    share /= share.sum()
    mean = np.einsum("sc,sci->i", share, terms[:, :, tone])
    away = terms[:, :, tone] - mean
    every = spread[:, :, tone] + away[..., :, None] * away[..., None, :]
    return np.asarray(mean, np.float64), np.asarray(np.einsum("sc,scij->ij", share, every), np.float64)


def _ambiguity(likelihood: FloatArray, evidence: FloatArray, terms: FloatArray, turns: FloatArray) -> float:
    """Mean square by which the terms of tones that differ by their phase steps differ from those of the likeliest one,
    in the first or the last frame.

    Two frames show the difference of two phasors, which has several solutions.
    """
    weight, best = np.exp(likelihood - likelihood.max()), int(np.argmax(likelihood))
    no_spread = np.zeros((*terms.shape, terms.shape[-1]))
    each = np.stack([_posterior(evidence, terms, no_spread, k)[0] for k in range(len(weight))])
    differences = []
    for frame in (0, -1):
        turned = (turns[:, frame] @ each[..., None])[..., 0]
        differences.append(np.average(((turned - turned[best]) ** 2).sum(axis=1), weights=weight))
    return 0.5 * float(max(differences))


def _variance_of_changes(courses: list[CommonCourse]) -> FloatArray:
    """(modes,) variance of the modes' changes from frame to frame that groups of columns have not in common."""
    groups = np.stack([one.groups for one in courses])
    changes = groups - groups.mean(axis=0)
    return np.asarray(changes.var(axis=1).sum(axis=0) / max(len(courses) - 1, 1) / groups.shape[1] + _LEAST_VARIANCE)


def _inverse(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverses of (..., n, n) symmetric matrices, and logarithms of the determinants; fast for n = 2."""
    if matrices.shape[-1] != 2:
        return np.asarray(np.linalg.inv(matrices), np.float64), np.asarray(np.linalg.slogdet(matrices)[1])
    a, b, d = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    size = a * d - b * b
    return np.stack([d, -b, -b, a], axis=-1).reshape(matrices.shape) / size[..., None, None], np.log(size)


def _log_sum(values: FloatArray) -> FloatArray:
    """Logarithm of the sum of exponentials along the first axis."""
    most = values.max(axis=0)
    return np.asarray(most + np.log(np.exp(values - most).sum(axis=0)))
