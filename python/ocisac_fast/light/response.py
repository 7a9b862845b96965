"""Frequency response of an exposure."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.checks import broadcast, checked


@checked
def exposure_response(frequency: npt.ArrayLike, exposure: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Frequency response of an exposure, H(f) = sinc(f T_e) exp(-j pi f T_e) with sinc(x) = sin(pi x)/(pi x).

    Eq. 10 of the paper, divided by T_e so that steady light has gain 1.

    Args:
        frequency: Hz, any shape, finite (negative ones are allowed).
        exposure: T_e in seconds, any shape that broadcasts with ``frequency``, finite, 0 or above.

    Returns:
        complex128 array of the broadcast shape.
    """
    both = broadcast("frequency, exposure", frequency, exposure)
    return np.asarray(_core.exposure_response(*both), dtype=np.complex128)
