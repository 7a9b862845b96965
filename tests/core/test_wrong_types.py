"""Wrong types are refused like wrong values: a ValueError that names the argument, the value and what is allowed."""

import inspect
import typing

import numpy as np
import pytest

import ocisac_fast
from ocisac_fast import Camera, Tone, chips, cleaning, exposure, lights, packets, receiver, sensing, tones

CAMERA = Camera(1e-5, 1e-4, frame_time=1 / 30)
FRAME = 100 + 50 * np.sin(np.arange(64) * 0.3)[:, None] * np.ones(16)
SIGNAL = FRAME[:, 0]
CLOCK = {"clock": chips.ChipClock(rows_per_chip=4.0, phase=0.0, exposure_rows=1.0)}
CALLS = [
    (Camera, {"row_time": 1e-5}),
    (Tone, {"frequency": 500.0}),
    (tones.tone_gain, {"columns": FRAME, "camera": CAMERA, "frequency": 4.8e3}),
    (tones.varying_tone_gain, {"columns": FRAME, "camera": CAMERA, "frequency": 4.8e3}),
    (tones.equalize, {"columns": FRAME, "camera": CAMERA}),
    (tones.lost_frequencies, {"camera": CAMERA}),
    (tones.find_frequency, {"columns": FRAME, "camera": CAMERA}),
    (tones.tone_columns, {"columns": FRAME, "camera": CAMERA}),
    (tones.pick_colour, {"colours": [FRAME], "camera": CAMERA}),
    (tones.calibrate, {"columns": FRAME, "frequency": 4.8e3}),
    (ocisac_fast.integrate_exposure, {"waveform": Tone(500.0), "camera": CAMERA, "rows": 9}),
    (ocisac_fast.sample_waveform, {"waveform": Tone(500.0), "times": [0.0]}),
    (ocisac_fast.receive, {"frames": FRAME, "camera": CAMERA}),
    (receiver.Receiver, {"camera": CAMERA}),
    (receiver.MultiReceiver, {"camera": CAMERA}),
    (receiver.GainOptions, {}),
    (receiver.FskReceiver, {"camera": CAMERA, "tones": [1e3, 2e3]}),
    (lights.detect_sources, {"frames": FRAME, "camera": CAMERA}),
    (lights.SourceTracker, {"camera": CAMERA}),
    (ocisac_fast.remove_bands, {"frames": FRAME, "camera": CAMERA}),
    (cleaning.CleaningOptions, {}),
    (ocisac_fast.subtract_still, {"frames": np.stack([FRAME, FRAME]), "camera": CAMERA}),
    (sensing.sense, {"frames": FRAME, "camera": CAMERA}),
    (sensing.sense_region, {"frames": FRAME, "camera": CAMERA}),
    (sensing.KnownMotion, {}),
    (sensing.background_light, {"frames": FRAME, "camera": CAMERA}),
    (sensing.restore_contrast, {"columns": FRAME, "camera": CAMERA, "frequency": 4.8e3}),
    (exposure.best_exposure, {"f_comm": 500.0, "f_sense": 175.0}),
    (exposure.exposure_front, {"f_comm": 500.0, "f_sense": 175.0}),
    (chips.ChipClock, {"rows_per_chip": 4.0, "phase": 0.0, "exposure_rows": 1.0}),
    (chips.expose_chips, {"chips": [0, 1], "rows": 9, **CLOCK}),
    (chips.fit_channel, {"signal": SIGNAL, "chips": [0, 1], **CLOCK}),
    (chips.find_preamble, {"signal": SIGNAL, "preamble": [0, 1, 0, 1, 1, 0, 0, 1], "rows_per_chip": 4.0}),
    (chips.find_channel, {"signal": SIGNAL, "rows_per_chip": 4.0}),
    (chips.chip_llr, {"rows": SIGNAL, **CLOCK, "noise": 0.1, "first": 0, "count": 9}),
    (chips.closest_pair_distance, {"rows_per_chip": 4.0, "exposure_rows": 8.0}),
    (chips.detector_error_rates, {"rows_per_chip": 4.0, "exposure_rows": 8.0, "noise": 0.1}),
    (exposure.LevelTargets, {}),
    (packets.PacketFormat, {}),
    (packets.transmit, {"payload": b"a"}),
    (packets.possible_goodput, {"payload_bytes": 9, "camera": CAMERA, "chip_rate": 1e4, "rows": 99}),
    (packets.fsk_symbol_error_rate, {"tones": 2, "snr": 10.0}),
]


def wrong_types():
    for call, given in CALLS:
        function = call.__init__ if inspect.isclass(call) else call
        for name, hint in typing.get_type_hints(function).items():
            options = typing.get_args(hint) or (hint,)
            if name != "return" and {Camera, float, int} & set(options) and str not in options:
                yield pytest.param(call, given, name, id=f"{call.__name__}-{name}")


@pytest.mark.parametrize(("call", "given", "name"), list(wrong_types()))
@pytest.mark.parametrize("value", ["22us", object()])
def test_a_wrong_type_is_refused_with_the_name_of_the_argument(call, given, name, value):
    with pytest.raises(ValueError, match=rf"^{name}: got .*, allowed: "):
        call(**given | {name: value})


def test_the_refusal_names_the_value_and_what_is_allowed():
    with pytest.raises(ValueError, match=r"^row_time: got '22us', allowed: a number or None$"):
        Camera(row_time="22us")
    with pytest.raises(ValueError, match=r"^camera: got 2.2e-05, allowed: a Camera$"):
        tones.tone_gain(FRAME, 22e-6, 500)
    with pytest.raises(ValueError, match=r"^frequency: got '500Hz', allowed: real numbers$"):
        tones.tone_gain(FRAME, CAMERA, "500Hz")
    with pytest.raises(ValueError, match=r"^bounds: got \('a', 1\), allowed: 2 numbers or None$"):
        tones.find_frequency(FRAME, CAMERA, bounds=("a", 1))
