"""The same functions in plain NumPy, for checking the C++ core: slow, short and close to the equations."""

from ocisac_fast.reference.equalization import equalize
from ocisac_fast.reference.exposure_choice import best_exposure, exposure_objective
from ocisac_fast.reference.frequency import calibrate, find_frequency, pick_channel, tone_columns
from ocisac_fast.reference.gain import tone_gain
from ocisac_fast.reference.receiver import receive
from ocisac_fast.reference.waveforms import integrate_exposure, sample_waveform

__all__ = [
    "best_exposure",
    "calibrate",
    "equalize",
    "exposure_objective",
    "find_frequency",
    "integrate_exposure",
    "pick_channel",
    "receive",
    "sample_waveform",
    "tone_columns",
    "tone_gain",
]
