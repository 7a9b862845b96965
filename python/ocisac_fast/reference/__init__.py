"""Kernels and equations in plain NumPy, as a check of the C++ core: slow, short and close to the equations.

There are no heuristics here; heuristics are tested by truth, bounds and stored results.
"""

from ocisac_fast.reference.camera import linear_light as linear_light, subtract_still as subtract_still
from ocisac_fast.reference.chips import (
    chip_llr as chip_llr,
    clock_bounds as clock_bounds,
    closest_pair_distance as closest_pair_distance,
    detect_chips as detect_chips,
    detect_sequence as detect_sequence,
    detector_error_rates as detector_error_rates,
    expose_chips as expose_chips,
    fit_channel as fit_channel,
    pool_estimates as pool_estimates,
)
from ocisac_fast.reference.exposure import (
    best_exposure as best_exposure,
    best_noisy_exposure as best_noisy_exposure,
    exposure_modulation as exposure_modulation,
    exposure_objective as exposure_objective,
    flicker_indices as flicker_indices,
)
from ocisac_fast.reference.light import (
    exposure_response as exposure_response,
    integrate_exposure as integrate_exposure,
    sample_waveform as sample_waveform,
)
from ocisac_fast.reference.packets import (
    decode_line_code as decode_line_code,
    encode_line_code as encode_line_code,
    fsk_demodulate as fsk_demodulate,
    fsk_symbol_error_rate as fsk_symbol_error_rate,
    longest_payload as longest_payload,
    transmit as transmit,
)
from ocisac_fast.reference.scene import exact_scene as exact_scene, render_scene as render_scene
from ocisac_fast.reference.tones import (
    equalize as equalize,
    tone_gain as tone_gain,
    varying_tone_gain as varying_tone_gain,
)
