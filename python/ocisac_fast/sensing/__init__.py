"""Moving textures and lights: gain, frequency, motion."""

from ocisac_fast.sensing.contrast import RestoredContrast as RestoredContrast, restore_contrast as restore_contrast
from ocisac_fast.sensing.motion import KnownMotion as KnownMotion
from ocisac_fast.sensing.picture import sense as sense
from ocisac_fast.sensing.region import (
    BackgroundLight as BackgroundLight,
    MeasuredFrequency as MeasuredFrequency,
    SensedRegion as SensedRegion,
    background_light as background_light,
    sense_region as sense_region,
)
