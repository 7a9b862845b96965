"""Tones in columns: gain, frequency, equalisation."""

from ocisac_fast.tones.equalization import (
    EqualizerReport as EqualizerReport,
    equalize as equalize,
    lost_frequencies as lost_frequencies,
)
from ocisac_fast.tones.frequency import (
    FoundFrequency as FoundFrequency,
    ToneColumns as ToneColumns,
    find_frequency as find_frequency,
    tone_columns as tone_columns,
)
from ocisac_fast.tones.gain import ToneGain as ToneGain, tone_gain as tone_gain
from ocisac_fast.tones.varying_tone import VaryingToneGain as VaryingToneGain, varying_tone_gain as varying_tone_gain
