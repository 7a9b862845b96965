"""Light over time and its integration over an exposure."""

from ocisac_fast.light.response import exposure_response as exposure_response
from ocisac_fast.light.waveforms import (
    Chips as Chips,
    Constant as Constant,
    Product as Product,
    Samples as Samples,
    SquareWave as SquareWave,
    Sum as Sum,
    Tone as Tone,
    TriangleWave as TriangleWave,
    Waveform as Waveform,
    integrate_exposure as integrate_exposure,
    sample_waveform as sample_waveform,
)
