"""Camera position from lights at known places (OpenCV's solvePnP, ``ocisac-fast[locate]``)."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import checked, shown
from ocisac_fast.core.opencv import opencv
from ocisac_fast.core.results import Result

_COLLINEAR = 1e-3  # second over first singular value of the lights' places
_LIKELIHOOD = 9.2  # max. difference of the sums of squares of alternatives: 1 % for two degrees of freedom
_MAX_TRIPLES = 20
# Noise moves three lights in the picture so, in standard errors: a solver finds no pose where two are nearly one.
_MOVES = np.array([[[0, 0]] * 3, *np.random.default_rng(0).normal(0, 1, (8, 3, 2))])
_MAX_STARTS = 12  # number of best initial poses that are refined
_WORST_STD = 0.3  # of the distance to the lights; above it no location is returned


@dataclass(frozen=True, slots=True, repr=False)
class Location(Result):
    """Estimated position and orientation of the camera.

    Attributes:
        position: (3,) of its centre, in the coordinates of the lights; NaN where status is "degenerate".
        position_std: (3,) standard errors; infinite where the lights do not determine it.
        covariance: (3, 3) of ``position``, to first order.
        rotation: (3, 3), from the coordinates of the lights to those of the camera (x right, y down, z forward).
        residual: root mean square distance between lights seen and expected, pixels.
        status: "ok"; "ambiguous": other places fit as well; "degenerate": the lights do not determine a place;
            "inconsistent": no place fits within the noise, so an ID, a place or the lens is wrong.
        reason: text that explains a status other than "ok"; "" otherwise.
        alternatives: (places, 3) other positions that fit within the noise.
    """

    position: Float64s
    position_std: Float64s
    covariance: Float64s
    rotation: Float64s
    residual: float
    status: Literal["ok", "ambiguous", "degenerate", "inconsistent"]
    reason: str
    alternatives: Float64s


@checked
def locate_camera(
    places: npt.ArrayLike,
    pixels: npt.ArrayLike,
    *,
    focal: float | tuple[float, float],
    centre: tuple[float, float],
    distortion: Sequence[float] = (),
    noise: float = 1.0,
    inside: tuple[Sequence[float], Sequence[float]] | None = None,
) -> Location:
    """Estimate position and orientation of a camera that sees three or more lights at known places.

    Every set of three lights gives up to four poses (P3P), all lights together further ones (SQPnP, IPPE for lights in
    a plane); each is refined over all lights by least squares. The best is the result; the others that fit within the
    noise are its alternatives. The covariance is noise^2 (J^T J)^-1 with the Jacobian J of the projection,
    transformed to the camera's centre -R^T t.

    Args:
        places: (lights, 3) in metres, finite; three or more.
        pixels: (lights, 2) x to the right and y down, finite.
        focal: in pixels, above 0; one value or (x, y).
        centre: principal point in pixels.
        distortion: OpenCV's coefficients k1, k2, p1, p2[, k3]; none: no distortion.
        noise: standard error of each coordinate of ``pixels``, above 0.
        inside: (lowest x, y, z) and (highest x, y, z) of the possible camera positions; resolves ambiguity.

    Raises:
        ValueError: an argument of wrong shape or outside its range, or OpenCV is missing.
    """
    world, image = _checked("places", places, 3), _checked("pixels", pixels, 2)
    if len(world) != len(image):
        raise ValueError(f"pixels: got {len(image)} lights, allowed: as many as places, here {len(world)}")
    if len(world) < 3:
        raise ValueError(f"places: got {len(world)} lights, allowed: three or more")
    lens = _Lens.of(focal, centre, distortion)
    if not 1e-9 <= noise <= 1e9:
        raise ValueError(f"noise: got {noise}, allowed: 1e-9 to 1e9 (pixels)")
    middle = world.mean(axis=0)  # the origin below: places far from theirs would lose their digits
    world = world - middle
    box = None if inside is None else np.stack([_checked("inside", [corner], 3)[0] for corner in inside]) - middle
    spread = np.linalg.svd(world, compute_uv=False)
    if spread[1] <= _COLLINEAR * spread[0]:
        return _nowhere("the lights stand in one line: the camera may be anywhere on a circle about it")
    poses = _poses(world, image, lens, noise)
    if box is not None:
        poses = [p for p in poses if np.all((p.position >= box[0]) & (p.position <= box[1]))]
    if not poses:
        return _nowhere("no place from which all lights are in front of the camera" + (" inside" if inside else ""))
    found = _judged(poses, world, lens, noise)
    return dataclasses.replace(found, position=found.position + middle, alternatives=found.alternatives + middle)


@dataclass(frozen=True)
class _Lens:
    matrix: Float64s
    distortion: Float64s

    @staticmethod
    def of(focal: float | tuple[float, float], centre: tuple[float, float], distortion: Sequence[float]) -> _Lens:
        both = np.broadcast_to(np.asarray(focal, np.float64), 2)
        if not np.all((both >= 1) & (both <= 1e7)):
            raise ValueError(f"focal: got {shown(focal)}, allowed: 1 to 1e7 (pixels)")
        middle = np.asarray(centre, np.float64)
        if middle.shape != (2,) or not np.all(np.isfinite(middle)):
            raise ValueError(f"centre: got {shown(centre)}, allowed: two finite numbers (pixels)")
        bent = np.asarray(distortion, np.float64)
        if bent.shape not in ((0,), (4,), (5,), (8,)) or not np.all(np.isfinite(bent)):
            raise ValueError(f"distortion: got {shown(distortion)}, allowed: none, 4, 5 or 8 finite coefficients")
        matrix = np.array([[both[0], 0.0, middle[0]], [0.0, both[1], middle[1]], [0.0, 0.0, 1.0]])
        return _Lens(matrix, bent if bent.size else np.zeros(4))


@dataclass(frozen=True)
class _Pose:
    turn: Float64s
    shift: Float64s
    position: Float64s
    squares: float  # sum of squared residuals over the noise's variance


def _checked(name: str, values: npt.ArrayLike, width: int) -> Float64s:
    array = np.asarray(values, np.float64)
    if array.ndim != 2 or array.shape[1] != width:
        raise ValueError(f"{name}: got shape {array.shape}, allowed: (lights, {width})")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: got a value that is not finite, allowed: finite numbers")
    return np.ascontiguousarray(array)


def _poses(world: Float64s, image: Float64s, lens: _Lens, noise: float) -> list[_Pose]:
    """All distinct poses to which least squares converges, the best first."""
    cv2 = opencv("locating")
    starts: list[tuple[Any, Any]] = []
    triples = list(itertools.combinations(range(len(world)), 3))
    for triple in triples[:: max(1, len(triples) // _MAX_TRIPLES)]:
        chosen = list(triple)
        for moves in _MOVES if len(world) == 3 else _MOVES[:1]:
            moved = image[chosen] + noise * moves
            found = cv2.solveP3P(world[chosen], moved, lens.matrix, lens.distortion, cv2.SOLVEPNP_AP3P)
            starts += list(zip(found[1], found[2], strict=True))
    if len(world) > 3:
        spread = np.linalg.svd(world, compute_uv=False)
        flat = spread[2] <= _COLLINEAR * spread[0]
        for method in (cv2.SOLVEPNP_SQPNP, *((cv2.SOLVEPNP_IPPE,) if flat else ())):
            with contextlib.suppress(cv2.error):  # SQPnP refuses lights that are close together in the picture
                found = cv2.solvePnPGeneric(world, image, lens.matrix, lens.distortion, flags=method)
                starts += list(zip(found[1], found[2], strict=True))
    usable = [start for start in starts if np.all(np.isfinite(np.concatenate(start)))]
    usable.sort(key=lambda start: _squares(world, image, lens, *start))
    poses: list[_Pose] = []
    for start in usable[:_MAX_STARTS]:
        pose = _refined(world, image, lens, noise, *start)
        if pose is not None and not any(_same(pose, other) for other in poses):
            poses.append(pose)
    return sorted(poses, key=lambda pose: pose.squares)


def _refined(world: Float64s, image: Float64s, lens: _Lens, noise: float, turn: Any, shift: Any) -> _Pose | None:
    """Least squares over all lights; None if a light is behind the camera."""
    cv2 = opencv("locating")
    turn, shift = cv2.solvePnPRefineLM(world, image, lens.matrix, lens.distortion, turn.copy(), shift.copy())
    if not (np.all(np.isfinite(turn)) and np.all(np.isfinite(shift))):
        return None
    rotation = cv2.Rodrigues(turn)[0]
    if np.any((world @ rotation.T + shift.T)[:, 2] <= 0.0):
        return None
    squares = _squares(world, image, lens, turn, shift) / noise**2
    return _Pose(turn, shift, np.asarray(-rotation.T @ shift).ravel(), squares)


def _squares(world: Float64s, image: Float64s, lens: _Lens, turn: Any, shift: Any) -> float:
    expected = opencv("locating").projectPoints(world, turn, shift, lens.matrix, lens.distortion)[0].reshape(-1, 2)
    return float(np.sum((expected - image) ** 2))


def _same(one: _Pose, other: _Pose) -> bool:
    return float(np.linalg.norm(one.position - other.position)) < 1e-3 * float(np.linalg.norm(one.position))


def _judged(poses: list[_Pose], world: Float64s, lens: _Lens, noise: float) -> Location:
    best = poses[0]
    rotation = np.asarray(opencv("locating").Rodrigues(best.turn)[0])
    residual = noise * math.sqrt(best.squares / len(world))
    covariance = _covariance(best, world, lens, noise)
    std = np.sqrt(np.diag(covariance))
    others = [pose.position for pose in poses[1:] if pose.squares <= best.squares + _LIKELIHOOD]
    alternatives = np.array(others).reshape(-1, 3)
    distance = float(np.linalg.norm(best.position))
    status: Literal["ok", "ambiguous", "degenerate", "inconsistent"] = "ok"
    reason = ""
    if best.squares > _largest_squares(2 * len(world) - 6):
        status, reason = (
            "inconsistent",
            f"the best place leaves {residual:.1f} pixels: an ID, a place or the lens is wrong",
        )
    elif not np.linalg.norm(std) <= _WORST_STD * distance:
        status, reason = (
            "degenerate",
            "the lights hardly determine the place: too close together, or on a critical curve",
        )
    elif others:
        status, reason = "ambiguous", f"{len(others) + 1} places fit within the noise"
    return Location(best.position, std, covariance, rotation, residual, status, reason, alternatives)


def _largest_squares(freedoms: int) -> float:
    """99.9 % quantile of chi-square (Wilson and Hilferty); with 0 degrees of freedom, a bound of rounding errors."""
    if freedoms < 1:
        return 1e-3
    return float(freedoms * (1.0 - 2.0 / (9.0 * freedoms) + 3.09 * math.sqrt(2.0 / (9.0 * freedoms))) ** 3)


def _covariance(pose: _Pose, world: Float64s, lens: _Lens, noise: float) -> Float64s:
    """Covariance of the camera's centre -R^T t, from the Jacobian of the projection over rotation vector and shift."""
    cv2 = opencv("locating")
    jacobian = cv2.projectPoints(world, pose.turn, pose.shift, lens.matrix, lens.distortion)[1][:, :6]
    scale = np.linalg.norm(jacobian, axis=0)
    _, singular, right = np.linalg.svd(jacobian / scale, full_matrices=False)
    if singular[-1] <= 1e-9 * singular[0]:
        return np.full((3, 3), math.inf)
    root = noise * (right / singular[:, None]) / scale  # root^T root = noise^2 (J^T J)^-1
    rotation, of_turn = cv2.Rodrigues(pose.turn)
    centre_by_turn = -np.einsum("kij,i->jk", of_turn.reshape(3, 3, 3), pose.shift.ravel())
    carried = root @ np.hstack([centre_by_turn, -rotation.T]).T
    return np.asarray(carried.T @ carried)


def _nowhere(reason: str) -> Location:
    none, every = np.full(3, math.nan), np.full((3, 3), math.nan)
    return Location(
        none, np.full(3, math.inf), every * math.inf, every, math.nan, "degenerate", reason, np.empty((0, 3))
    )
