"""What the exposure does to a tone, as the equation says it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def exposure_response(frequency: npt.ArrayLike, exposure: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """As :func:`ocisac_fast.exposure_response`: sinc(f T_e) exp(-j pi f T_e); the phase reduced to one period."""
    cycles = np.asarray(frequency, dtype=np.float64) * np.asarray(exposure, dtype=np.float64)
    return np.asarray(np.sinc(cycles) * np.exp(-1j * np.pi * np.fmod(cycles, 2.0)))
