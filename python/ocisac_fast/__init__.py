"""Receiver for optical camera communication and sensing (OC-ISAC)."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ocisac_fast._core import version as _version

if TYPE_CHECKING:
    from ocisac_fast.camera import Camera, exposure_response
    from ocisac_fast.channel import (
        ChannelEstimate,
        ClockErrors,
        ClockTracker,
        Pooled,
        PreambleMatch,
        RefinedChannel,
        TrackedClock,
        chip_likelihoods,
        clock_bounds,
        closest_pair_distance,
        expose_chips,
        find_channel,
        find_preamble,
        fit_channel,
        pool_estimates,
        refine_channel,
    )
    from ocisac_fast.cleaning.bands import CleanedFrames, Mark, remove_bands, subtract_still
    from ocisac_fast.control.choice import BestExposure, best_exposure, exposure_objective
    from ocisac_fast.control.controller import (
        ExposureController,
        ExposureMeasurement,
        ExposureReason,
        ExposureSuggestion,
        MeasuredTone,
        best_noisy_exposure,
    )
    from ocisac_fast.control.fronts import ExposureFront, exposure_front
    from ocisac_fast.detection import DetectedChips, DetectorErrorRates, detect_chips, detector_error_rates
    from ocisac_fast.equalization import EqualizerReport, equalize, lost_frequencies
    from ocisac_fast.flags import Flag
    from ocisac_fast.frequency import (
        Calibration,
        FoundFrequency,
        ToneColumns,
        calibrate,
        find_frequency,
        pick_channel,
        tone_columns,
    )
    from ocisac_fast.fsk import (
        FskFrame,
        FskReceiver,
        FskSymbol,
        FskTransmission,
        fsk_demodulate,
        fsk_symbol_error_rate,
        fsk_transmit,
    )
    from ocisac_fast.gain import ToneGain, tone_gain
    from ocisac_fast.goodput import Goodput, possible_goodput
    from ocisac_fast.location import Location, locate_camera
    from ocisac_fast.merging import merge_receptions
    from ocisac_fast.receiver import Received, receive
    from ocisac_fast.scene import Scene
    from ocisac_fast.sensing.contrast import RestoredContrast, restore_contrast
    from ocisac_fast.sensing.picture import sense
    from ocisac_fast.sensing.region import BackgroundLight, SensedRegion, background_light, sense_region
    from ocisac_fast.source_tracker import SourceTracker, Track
    from ocisac_fast.sources import LightSource, detect_sources
    from ocisac_fast.stream_receiver import MultiReceiver, ReceivedFrame, Receiver, SourceFrame
    from ocisac_fast.transmission import Transmission, decode_line_code, encode_line_code, longest_payload, transmit
    from ocisac_fast.varying_tone import VaryingToneGain, varying_tone_gain
    from ocisac_fast.waveforms import (
        Chips,
        Constant,
        Product,
        Samples,
        SquareWave,
        Sum,
        Tone,
        Waveform,
        integrate_exposure,
        sample_waveform,
    )

__version__ = _version()

# Where the public names are; each module is imported when one of its names is asked for, so that a start costs little.
_PLACES = {
    "camera": (
        "Camera",
        "exposure_response",
    ),
    "channel": (
        "ChannelEstimate",
        "ClockErrors",
        "ClockTracker",
        "Pooled",
        "PreambleMatch",
        "RefinedChannel",
        "TrackedClock",
        "chip_likelihoods",
        "clock_bounds",
        "closest_pair_distance",
        "expose_chips",
        "find_channel",
        "find_preamble",
        "fit_channel",
        "pool_estimates",
        "refine_channel",
    ),
    "cleaning.bands": (
        "CleanedFrames",
        "Mark",
        "remove_bands",
        "subtract_still",
    ),
    "sensing.contrast": (
        "RestoredContrast",
        "restore_contrast",
    ),
    "detection": (
        "DetectedChips",
        "DetectorErrorRates",
        "detect_chips",
        "detector_error_rates",
    ),
    "equalization": (
        "EqualizerReport",
        "equalize",
        "lost_frequencies",
    ),
    "control.choice": (
        "BestExposure",
        "best_exposure",
        "exposure_objective",
    ),
    "control.controller": (
        "ExposureController",
        "ExposureMeasurement",
        "ExposureReason",
        "ExposureSuggestion",
        "MeasuredTone",
        "best_noisy_exposure",
    ),
    "control.fronts": (
        "ExposureFront",
        "exposure_front",
    ),
    "flags": ("Flag",),
    "frequency": (
        "Calibration",
        "FoundFrequency",
        "ToneColumns",
        "calibrate",
        "find_frequency",
        "pick_channel",
        "tone_columns",
    ),
    "fsk": (
        "FskFrame",
        "FskReceiver",
        "FskSymbol",
        "FskTransmission",
        "fsk_demodulate",
        "fsk_symbol_error_rate",
        "fsk_transmit",
    ),
    "gain": (
        "ToneGain",
        "tone_gain",
    ),
    "goodput": (
        "Goodput",
        "possible_goodput",
    ),
    "location": (
        "Location",
        "locate_camera",
    ),
    "merging": ("merge_receptions",),
    "sensing.picture": ("sense",),
    "receiver": (
        "Received",
        "receive",
    ),
    "scene": ("Scene",),
    "sensing.region": (
        "BackgroundLight",
        "SensedRegion",
        "background_light",
        "sense_region",
    ),
    "source_tracker": (
        "SourceTracker",
        "Track",
    ),
    "sources": (
        "LightSource",
        "detect_sources",
    ),
    "stream_receiver": (
        "MultiReceiver",
        "ReceivedFrame",
        "Receiver",
        "SourceFrame",
    ),
    "transmission": (
        "Transmission",
        "decode_line_code",
        "encode_line_code",
        "longest_payload",
        "transmit",
    ),
    "varying_tone": (
        "VaryingToneGain",
        "varying_tone_gain",
    ),
    "waveforms": (
        "Chips",
        "Constant",
        "Product",
        "Samples",
        "SquareWave",
        "Sum",
        "Tone",
        "Waveform",
        "integrate_exposure",
        "sample_waveform",
    ),
}
_MODULE_OF = {name: module for module, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    """A public name, from its module."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])


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
    "chip_likelihoods",
    "clock_bounds",
    "closest_pair_distance",
    "decode_line_code",
    "detect_chips",
    "detect_sources",
    "detector_error_rates",
    "encode_line_code",
    "equalize",
    "expose_chips",
    "exposure_front",
    "exposure_objective",
    "exposure_response",
    "find_channel",
    "find_frequency",
    "find_preamble",
    "fit_channel",
    "fsk_demodulate",
    "fsk_symbol_error_rate",
    "fsk_transmit",
    "integrate_exposure",
    "locate_camera",
    "longest_payload",
    "lost_frequencies",
    "merge_receptions",
    "pick_channel",
    "pool_estimates",
    "possible_goodput",
    "receive",
    "refine_channel",
    "remove_bands",
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
