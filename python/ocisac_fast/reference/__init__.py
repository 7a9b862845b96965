"""The same functions in plain NumPy, for checking the C++ core: slow, short and close to the equations."""

from ocisac_fast.camera.camera import Camera
from ocisac_fast.chips.channel import (
    ChannelEstimate,
    ClockErrors,
    Pooled,
    PreambleMatch,
    RefinedChannel,
    TrackedClock,
)
from ocisac_fast.chips.detection import DetectedChips, DetectorErrorRates
from ocisac_fast.cleaning.bands import CleanedFrames, Mark
from ocisac_fast.core.flags import Flag
from ocisac_fast.exposure.choice import BestExposure
from ocisac_fast.exposure.controller import ExposureMeasurement, ExposureReason, ExposureSuggestion, MeasuredTone
from ocisac_fast.exposure.flicker import FlickerFreeExposure, FlickeringLight
from ocisac_fast.exposure.flicker_indices import FlickerIndices
from ocisac_fast.exposure.fronts import ExposureFront, exposure_front
from ocisac_fast.light.waveforms import Chips, Constant, Product, Samples, SquareWave, Sum, Tone, Waveform
from ocisac_fast.lights.location import Location, locate_camera
from ocisac_fast.lights.sources import LightSource
from ocisac_fast.lights.tracker import SourceTracker, Track
from ocisac_fast.packets.fsk import FskSymbol, FskTransmission, fsk_transmit
from ocisac_fast.packets.goodput import Goodput, possible_goodput
from ocisac_fast.packets.merging import merge_receptions
from ocisac_fast.packets.transmission import Transmission
from ocisac_fast.receiver.blind import Received
from ocisac_fast.receiver.fsk import FskFrame, FskReceiver
from ocisac_fast.receiver.stream import MultiReceiver, ReceivedFrame, Receiver, SourceFrame
from ocisac_fast.reference.channel import (
    ClockTracker,
    clock_bounds,
    expose_chips,
    find_channel,
    find_preamble,
    fit_channel,
    pool_estimates,
    refine_channel,
)
from ocisac_fast.reference.cleaning import remove_bands, subtract_still
from ocisac_fast.reference.detection import detect_chips, detector_error_rates
from ocisac_fast.reference.equalization import equalize, lost_frequencies
from ocisac_fast.reference.exposure_choice import best_exposure, exposure_objective
from ocisac_fast.reference.exposure_controller import ExposureController, best_noisy_exposure
from ocisac_fast.reference.exposure_flicker import exposure_modulation, flicker_free_exposure
from ocisac_fast.reference.exposure_response import exposure_response
from ocisac_fast.reference.flicker_indices import flicker_indices
from ocisac_fast.reference.frequency import calibrate, find_frequency, pick_colour, tone_columns
from ocisac_fast.reference.fsk import fsk_demodulate, fsk_symbol_error_rate
from ocisac_fast.reference.gain import tone_gain
from ocisac_fast.reference.receiver import receive
from ocisac_fast.reference.scene import exact_scene, render_scene
from ocisac_fast.reference.sensing import background_light, restore_contrast, sense_region
from ocisac_fast.reference.sequence_detection import chip_llr, closest_pair_distance
from ocisac_fast.reference.sources import detect_sources
from ocisac_fast.reference.transmission import decode_line_code, encode_line_code, longest_payload, transmit
from ocisac_fast.reference.varying_tone import varying_tone_gain
from ocisac_fast.reference.waveforms import integrate_exposure, sample_waveform
from ocisac_fast.scene import Scene
from ocisac_fast.sensing.contrast import RestoredContrast
from ocisac_fast.sensing.picture import sense
from ocisac_fast.sensing.region import BackgroundLight, SensedRegion
from ocisac_fast.tones.equalization import EqualizerReport
from ocisac_fast.tones.frequency import Calibration, FoundFrequency, ToneColumns
from ocisac_fast.tones.gain import ToneGain
from ocisac_fast.tones.varying_tone import VaryingToneGain

__all__ = [
    "BackgroundLight",
    "BestExposure",
    "Calibration",
    "Camera",
    "ChannelEstimate",
    "Chips",
    "CleanedFrames",
    "ClockErrors",
    "ClockTracker",
    "Constant",
    "DetectedChips",
    "DetectorErrorRates",
    "EqualizerReport",
    "ExposureController",
    "ExposureFront",
    "ExposureMeasurement",
    "ExposureReason",
    "ExposureSuggestion",
    "Flag",
    "FlickerFreeExposure",
    "FlickerIndices",
    "FlickeringLight",
    "FoundFrequency",
    "FskFrame",
    "FskReceiver",
    "FskSymbol",
    "FskTransmission",
    "Goodput",
    "LightSource",
    "Location",
    "Mark",
    "MeasuredTone",
    "MultiReceiver",
    "Pooled",
    "PreambleMatch",
    "Product",
    "Received",
    "ReceivedFrame",
    "Receiver",
    "RefinedChannel",
    "RestoredContrast",
    "Samples",
    "Scene",
    "SensedRegion",
    "SourceFrame",
    "SourceTracker",
    "SquareWave",
    "Sum",
    "Tone",
    "ToneColumns",
    "ToneGain",
    "Track",
    "TrackedClock",
    "Transmission",
    "VaryingToneGain",
    "Waveform",
    "background_light",
    "best_exposure",
    "best_noisy_exposure",
    "calibrate",
    "chip_llr",
    "clock_bounds",
    "closest_pair_distance",
    "decode_line_code",
    "detect_chips",
    "detect_sources",
    "detector_error_rates",
    "encode_line_code",
    "equalize",
    "exact_scene",
    "expose_chips",
    "exposure_front",
    "exposure_modulation",
    "exposure_objective",
    "exposure_response",
    "find_channel",
    "find_frequency",
    "find_preamble",
    "fit_channel",
    "flicker_free_exposure",
    "flicker_indices",
    "fsk_demodulate",
    "fsk_symbol_error_rate",
    "fsk_transmit",
    "integrate_exposure",
    "locate_camera",
    "longest_payload",
    "lost_frequencies",
    "merge_receptions",
    "pick_colour",
    "pool_estimates",
    "possible_goodput",
    "receive",
    "refine_channel",
    "remove_bands",
    "render_scene",
    "restore_contrast",
    "sample_waveform",
    "sense",
    "sense_region",
    "subtract_still",
    "tone_columns",
    "tone_gain",
    "transmit",
    "varying_tone_gain",
]
