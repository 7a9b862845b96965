"""The same functions in plain NumPy, for checking the C++ core: slow, short and close to the equations."""

from ocisac_fast.reference.gain import tone_gain
from ocisac_fast.reference.waveforms import integrate_exposure, sample_waveform

__all__ = ["integrate_exposure", "sample_waveform", "tone_gain"]
