"""The choice of an exposure time."""

from ocisac_fast.exposure.choice import (
    BestExposure as BestExposure,
    best_exposure as best_exposure,
    exposure_objective as exposure_objective,
)
from ocisac_fast.exposure.controller import (
    ExposureController as ExposureController,
    ExposureMeasurement as ExposureMeasurement,
    ExposureReason as ExposureReason,
    ExposureSuggestion as ExposureSuggestion,
    LevelTargets as LevelTargets,
    MeasuredTone as MeasuredTone,
    best_noisy_exposure as best_noisy_exposure,
)
from ocisac_fast.exposure.flicker import (
    FlickerFreeExposure as FlickerFreeExposure,
    FlickerFront as FlickerFront,
    FlickeringLight as FlickeringLight,
    exposure_modulation as exposure_modulation,
    flicker_free_exposure as flicker_free_exposure,
    flicker_front as flicker_front,
    mains_lights as mains_lights,
)
from ocisac_fast.exposure.flicker_indices import FlickerIndices as FlickerIndices, flicker_indices as flicker_indices
from ocisac_fast.exposure.fronts import ExposureFront as ExposureFront, exposure_front as exposure_front
from ocisac_fast.exposure.lamp import (
    DIGITAL_SUM_SPANS as DIGITAL_SUM_SPANS,
    LampFrequencies as LampFrequencies,
    flicker_free_chip_rate as flicker_free_chip_rate,
    flicker_free_frequencies as flicker_free_frequencies,
    smallest_flicker_free_duty as smallest_flicker_free_duty,
    unmissed_frequency as unmissed_frequency,
)
from ocisac_fast.exposure.pulses import (
    PulseBands as PulseBands,
    PulseCalibration as PulseCalibration,
    calibrate_pulses as calibrate_pulses,
    pulse_bands as pulse_bands,
)
