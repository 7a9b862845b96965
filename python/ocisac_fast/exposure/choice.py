"""The exposure time that maximises the gains of communication and sensing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import Within, broadcast, checked
from ocisac_fast.core.results import Result


@dataclass(frozen=True, slots=True, repr=False)
class BestExposure(Result):
    """Result of :func:`best_exposure`.

    Attributes:
        exposure: T_e in seconds; a float for scalar frequencies, else an array of their broadcast shape.
        objective: Y(exposure) in seconds, of the same shape; divided by ``exposure`` it is the weighted sum of gains.
    """

    exposure: float | Float64s
    objective: float | Float64s


@checked
def best_exposure(
    f_comm: npt.ArrayLike,
    f_sense: npt.ArrayLike,
    *,
    method: Literal["exact", "closed-form", "rounded", "search"] = "exact",
    weights: Sequence[float] = (1, 1),
    bounds: tuple[float, float] | None = None,
    step: float | None = None,
    more: Sequence[npt.ArrayLike] = (),
    points: Annotated[int, Within(2, 10_000_000)] = 10001,
) -> BestExposure:
    """Exposure time that maximises Y(T) = sum_i w_i |sin(pi f_i T)| / (pi f_i) (eq. 18, with magnitudes).

    ``"exact"`` is the true maximum: in constant time for two tones without bounds and step, otherwise lobe by lobe
    between the zeros of the sines. ``"search"`` is the paper's grid. ``"closed-form"`` is the paper's algorithm
    (eqs. 19-23), T = (gamma + 1/2) / f_max with gamma = max(floor(eps/2 - 1/2), 0) and eps = f_max / f_min; its weights
    affect the returned objective alone. ``"rounded"`` is the same with eps/2 - 1/2 rounded: the middle of the lobe that
    contains the maximum.

    Args:
        f_comm: frequency of the communication light in Hz, finite, above 0; any shape.
        f_sense: frequency of the sensing signal, f_x v, in Hz, finite, above 0; broadcasts with ``f_comm``.
        method: ``"exact"``, ``"closed-form"``, ``"rounded"`` or ``"search"``.
        weights: one for each frequency (2 + len(more)), finite, 0 or above, not all 0.
        bounds: (shortest, longest) exposure in seconds, 0 <= shortest <= longest, for all problems; None: (0, 1/f] with
            f the smallest of a problem's frequencies. An exposure of 0 is never chosen. Not for the closed forms.
        step: restrict T to whole multiples of it (s, above 0), for example the row time. Not for the closed forms.
        more: further frequencies in Hz, each broadcasting with ``f_comm``. Not for the closed forms.
        points: grid points of ``"search"`` between the bounds, 2 to 10 million; with ``step`` the grid consists of its
            multiples.

    Returns:
        :class:`BestExposure`; of equally good exposures, the shortest.

    Raises:
        ValueError: an argument outside its range; no multiple of ``step`` within ``bounds``; more than 10 million lobes
            or multiples to evaluate.
    """
    frequencies, shape = _problems(f_comm, f_sense, *more)
    pair = None if bounds is None else (float(bounds[0]), float(bounds[1]))
    exposures, objectives = _core.best_exposure(frequencies, _weights(weights), method, pair, step, points)
    return BestExposure(exposures.reshape(shape)[()], objectives.reshape(shape)[()])


@checked
def exposure_objective(
    exposure: npt.ArrayLike,
    f_comm: npt.ArrayLike,
    f_sense: npt.ArrayLike,
    *,
    weights: Sequence[float] = (1, 1),
    more: Sequence[npt.ArrayLike] = (),
) -> float | Float64s:
    """Y(T) = sum_i w_i |sin(pi f_i T)| / (pi f_i) in seconds (eq. 18, with magnitudes).

    Y(T)/T is the weighted sum of the gains |sinc(f_i T)|. The relative precision holds next to the zeros of the sines.

    Args:
        exposure: T in seconds, finite, 0 or above; any shape that broadcasts with the frequencies.
        f_comm: Hz, finite, above 0.
        f_sense: Hz, finite, above 0.
        weights: one for each frequency, finite, 0 or above, not all 0.
        more: further frequencies in Hz.

    Returns:
        A float for scalar arguments, else an array of the broadcast shape.
    """
    numbers, shape = _problems(exposure, f_comm, f_sense, *more)
    objectives = _core.exposure_objective(numbers[:, 0].copy(), numbers[:, 1:].copy(), _weights(weights))
    value: float | Float64s = objectives.reshape(shape)[()]
    return value


def _problems(*arrays: npt.ArrayLike) -> tuple[Float64s, tuple[int, ...]]:
    """Return (problems, tones) and the broadcast shape of the arrays."""
    values = broadcast("frequencies", *arrays)
    return np.stack(values, axis=-1).reshape(-1, len(values)), values[0].shape


def _weights(weights: Sequence[float]) -> Float64s:
    values = np.asarray(weights, dtype=np.float64)
    if values.ndim != 1:
        raise ValueError(f"weights: got shape {values.shape}, allowed: one number for each frequency")
    return values
