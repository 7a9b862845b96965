"""Chips in a row signal: channel, clock, detectors."""

from ocisac_fast.chips.channel import (
    ChannelEstimate as ChannelEstimate,
    ChipClock as ChipClock,
    ClockErrors as ClockErrors,
    ClockTracker as ClockTracker,
    Pooled as Pooled,
    PreambleMatch as PreambleMatch,
    RefinedChannel as RefinedChannel,
    TrackedClock as TrackedClock,
    chip_llr as chip_llr,
    clock_bounds as clock_bounds,
    closest_pair_distance as closest_pair_distance,
    expose_chips as expose_chips,
    find_channel as find_channel,
    find_preamble as find_preamble,
    fit_channel as fit_channel,
    pool_estimates as pool_estimates,
    refine_channel as refine_channel,
)
from ocisac_fast.chips.detection import (
    DETECTORS as DETECTORS,
    DetectedChips as DetectedChips,
    DetectorErrorRates as DetectorErrorRates,
    detect_chips as detect_chips,
    detector_error_rates as detector_error_rates,
)
