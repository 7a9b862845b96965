"""Values without meaning of public names, for test_refusals: each changes a valid call (valid_calls).

The key is the argument that the message names, as a regular expression. A value stands for that argument; a `Call`
changes others, or is another call.
"""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from valid_calls import CAMERA, FRAME, LENS, PLACES, PULSES, channel

from ocisac_fast import Camera, chips, exposure, light, receiver, scene, sensing
from ocisac_fast.cli.units import Quantity

NAN, INF = math.nan, math.inf
READ_ONLY = np.zeros(9)
READ_ONLY.flags.writeable = False
UNALIGNED = np.zeros(73, np.uint8)[1:].view(np.float64)
TONE, SAMPLES = light.Tone(1.0), light.Samples([1, 2], 1.0)
TRIANGLE, CHIPS = light.TriangleWave(1.0), functools.partial(light.Chips, chip_rate=1e3)
SOURCE = scene.Source(scene.Disc(1.0), scene.Pose((0, 0, 1)), TONE)


@dataclass(frozen=True)
class Call:
    """Arguments that are changed, or a call of its own."""

    changes: dict[str, Any]
    own: Callable[[], Any] | None = None


def of(**changes: Any) -> Call:
    return Call(changes)


def call(own: Callable[[], Any]) -> Call:
    return Call({}, own)


def scene_of(*surfaces: scene.Surface, camera: Camera = CAMERA) -> scene.Scene:
    return scene.Scene(LENS, camera, scene.Sensor(1e5), sources=[SOURCE], surfaces=surfaces)


def no_data(value: float, **changes: Any) -> Call:
    """One pixel of columns has the value."""
    return Call({"columns": np.where(np.arange(512).reshape(64, 8) == 203, value, FRAME), **changes})


NO_FRAMES = [np.zeros((0, 8)), np.zeros((64, 0)), np.zeros((64, 8), complex)]
PERHAPS_COLOURS = [np.zeros((64, 48, colours), np.uint8) for colours in (3, 4)]
NO_COLUMNS = [*NO_FRAMES, np.zeros((2, 2, 2, 2)), np.array([["a"]]), np.full((64, 8), NAN), np.full((64, 8), INF)]

REFUSED: dict[str, dict[str, list[Any]]] = {
    "camera.Camera": {
        "row_time": [0.0, NAN, "22us", 20.0, 1e-320], "exposure": [-1e-6, INF], "frame_time": [0.0, 1e300],
        "tone_curve": ["log"],
        "gamma": [0.0], "dark_level": [NAN, -1e308], "white_level": [of(dark_level=16.0, white_level=16.0)],
    },
    "light.Constant": {"level": [NAN, call(lambda: TONE * INF)]},
    "light.Tone": {
        "frequency": [-1.0, NAN, INF], "amplitude": [NAN, 1e101], "phase": [INF], "depth": [1.5, -0.1],
    },
    "light.SquareWave": {"frequency": [-2.0], "duty": [0.0, 1.0, NAN]},
    "light.TriangleWave": {"frequency": [NAN], "depth": [1.1]},
    "light.Chips": {
        "levels": [[], "", "012", [[0, 1]], [0, 1j], [0, NAN]], "chip_rate": [0.0], "start": [INF], "rise": [-1.0],
        "fall": [NAN],
    },
    "light.Samples": {"values": [[], [INF]], "sample_rate": [-1e3]},
    "light.Sum": {"parts": [[]], "waveform": [of(parts=[TONE] * 5000)]},
    "light.Product": {
        "product": [
            call(lambda: CHIPS([0, 1], rise=1.0) * TONE), call(lambda: SAMPLES * TONE * SAMPLES),
            call(lambda: TRIANGLE * light.TriangleWave(2.0)), of(parts=[TONE] * 9),
            call(lambda: light.Tone(1.0, amplitude=1e100) * 1e100 * 1e100 * 1e100),
        ],
        "waveform": [of(parts=[TONE + 1] * 13)],
    },
    "light.integrate_exposure": {
        "exposure": [of(camera=Camera(1e-5)), of(waveform=light.SquareWave(1e14) * CHIPS("01"))],
        "frame_time": [of(camera=Camera(1e-5, 1e-4), frames=2)],
        "rows": [0, -3, 10**12, 2.0, True, [0.5], [], [[1, 2]], [2**60], np.array([2**63], np.uint64)],
        "start": [NAN], "frequency": [of(start=1e200), of(waveform=light.Tone(5e3), camera=Camera(1.0, 1e12))],
        "chip_rate": [of(waveform=light.Chips([1], 1e300))],
        "out": [np.zeros(4), np.zeros(9, np.float32), np.zeros(9, ">f8"), [0.0] * 9, READ_ONLY, UNALIGNED],
        "frames": [0, of(rows=1000, frames=10**6)],
    },
    "light.exposure_response": {
        "frequency": [NAN, INF], "exposure": [-1.0, NAN],
        "frequency, exposure": [of(frequency=[[1.0, 2.0]], exposure=[])],
    },
    "light.sample_waveform": {"times": [[0.0, NAN], ["a"]]},
    "tones.tone_gain": {
        "columns": [*NO_COLUMNS, of(columns=np.full((64, 8), 1e308), pooled=True), np.full((64, 8), 1e150),
                    np.full((64, 8), 1e-150)],
        "frequency": [0.0, -5.0, NAN, [], [[1.0]], 1e300, "500Hz"], "camera": [22e-6], "method": ["fft"],
        "waveform": ["saw"], "duty": [0.0, 1.0], "background": [NAN, np.zeros(5)], "efficiency": [0.0, 1.5],
        "threads": [0], "dark_level": [of(camera=Camera(1.0, tone_curve="gamma", dark_level=16), frequency=0.2)],
        "gamma": [
            of(camera=Camera(1.0, tone_curve="gamma", white_level=1e-300), columns=np.ones((8, 2), "u1"), frequency=0.2)
        ],
    },
    "tones.varying_tone_gain": {
        "degree": [-1, 5, -(2**63)], "frequency": [0.0, NAN], "waveform": ["saw"], "duty": [1.0], "threads": [0, 2**40],
        "background": [np.zeros(5)], "columns": [np.full((64, 8), NAN)],
    },
    "tones.tone_columns": {"frequency": [0.0, -5.0, NAN, INF]},
    "tones.find_frequency": {
        "columns": [*NO_COLUMNS, np.full((64, 8), 1e61)], "waveform": ["saw"],
        "bounds": [(-1e5, 2e4), (2e4, 1e4), (5e4, 9e4), (NAN, 1e4), (1e4, NAN), ("a", 1)],
    },
    "tones.equalize": {
        "max_boost": [0.5, NAN, INF], "method": ["zero"],
        "noise": [of(method=one, noise=bad) for one in ("wiener", "inverse") for bad in (-1.0, NAN, [1.0, 2.0])],
        "out": [np.empty((50, 2)), np.empty((64, 8), np.float16), np.broadcast_to(0.0, (64, 8))], "threads": [0],
        "columns": [
            np.full((64, 8), NAN), *(np.ones(shape) for shape in ((), (0,), (0, 3), (3, 0), (1, 2, 3, 4))),
            *(no_data(value, method=one, **more)
              for one in ("wiener", "inverse")
              for value, more in ((1e308, {}), (-1e308, {}), (3e38, {"out": np.empty((64, 8), np.float32)}),
                                  (1e304, {"camera": Camera(1e-5, 1e-4, tone_curve="srgb")}),
                                  (1e308, {"camera": Camera(1e-5, 1.0)}))),
        ],
        "exposure": [of(camera=Camera(1e-5))],
    },
    "tones.lost_frequencies": {"exposure": [of(camera=Camera(1e-5))]},
    "exposure.best_exposure": {
        "weights": [(1, 1, 1), of(weights=(1, 1), more=[50.0]), (0, 0), (1, -1), (1, NAN), 1.0],
        "bounds": [(2e-9, 1e-9), (-0.1, 0.01), (0.0, 0.0), (0.0, INF), (0.0, 1e6), (1, 2, 3)],
        "step|bounds": [of(bounds=(1e20, 1.0000000001e20), step=1e15)],
        "step": [0.0, -1.0, NAN, 0.02, of(bounds=(0.0101, 0.0109), step=0.001), of(method="search", step=1e-12),
                 of(method="search", step=5e-324)],
        "points": [of(method="search", points=1), of(method="search", points=-1)],
        "method": [
            "best", of(method="closed-form", bounds=(0.001, 0.01)), of(method="rounded", step=1e-5),
            of(method="closed-form", more=[50.0], weights=(1, 1, 1)),
        ],
    },
    "exposure.best_noisy_exposure": {
        "frequency": [of(frequencies=(0.0,))], "weights": [(0.0,), (1.0, 2.0)],
        "bounds": [(0.0, 1.0), (2.0, 1.0), (1.0,), (1e-3, 1e9)], "noise_exposure": [0.0, NAN],
        "step": [1.0, -1.0, 5e-324, 1e-30],
    },
    "exposure.ExposureController": {
        "shortest": [of(exposures=(0.0, 1.0))], "longest": [of(exposures=(2.0, 1.0))], "exposures": [(2.0,)],
        "step": [1.0, 5e-324, 1e-30], "highest_gain": [of(gains=(2.0, 1.0))], "lowest_gain": [of(gains=(0.0, 1.0))],
        "weights": [(0.0, 0.0), (-1.0, 1.0)], "hysteresis": [NAN], "levels": [0.4], "min_snr": [-1.0],
        "noise_level": [0.0],
    },
    "exposure.LevelTargets": {"floor": [1.0, NAN], "aim": [0.0], "ceiling": [1.5], "max_saturated": [1.0]},
    "exposure.ExposureController.update": {
        name: [of(measurement=exposure.ExposureMeasurement(**given)) for given in each]
        for name, each in {
            "frequency": [{"lights": [0.0]}, {"lights": [INF]}], "tones": [{"lights": [100.0] * 33}],
            **{one: [{"motions": [exposure.MeasuredTone(100.0, **{one: -1.0})]}] for one in ("share", "snr", "gain")},
            "exposure": [{"exposure": 0.0}], "camera_gain": [{"gain": -1.0}], "level": [{"level": -0.1}],
            "peak": [{"peak": INF}], "saturated": [{"saturated": 1.1}, {"saturated": NAN}],
        }.items()
    },
    "exposure.FlickeringLight": {
        "frequency": [0.0, NAN], "uncertainty": [100.0], "duty": [1.0], "depth": [0.0],
    },
    "exposure.flicker_free_exposure": {
        "lights": [[]], "below": [0.0, NAN, "2%"],
        "bounds": [
            0.1, (2e-3, 1e-3), (0.0, INF), (0.0, 1e5),
            of(lights=[exposure.FlickeringLight(100.0, depth=0.01)], near=None),
        ],
        "near": [-1.0], "step": [0.0, 1e-9, of(step=0.03, bounds=(0.031, 0.04))],
        "f_comm": [
            of(min_gain=0.5), 100.0,
            of(lights=[exposure.FlickeringLight(90.0, uncertainty=10.0)], f_comm=99.0, min_gain=0.5),
        ],
        "min_gain": [of(f_comm=100.0, min_gain=1.0)],
    },
    "exposure.flicker_indices": {
        "exposure": [0.0, INF], "background": [-1.0], "contrast": [NAN], "tolerance": [0.0],
    },
    "exposure.exposure_front": {
        "f_comm": [0.0], "f_sense": [INF], "bounds": [(1.0, 1.0), (-1.0, 1.0)], "noise_exposure": [0.0], "points": [1],
    },
    "exposure.flicker_free_frequencies": {
        "exposures": [[], [0.0]], "bounds": [(60.0, 50.0)], "below": [1.0], "duty": [1.0], "exposure_spread": [1.0],
    },
    "exposure.smallest_flicker_free_duty": {"below": [0.0], "frequency": [NAN]},
    "exposure.unmissed_frequency": {"duty": [0.0]},
    "exposure.flicker_free_chip_rate": {"digital_sum_span": [0]},
    "exposure.calibrate_pulses": {
        "frequency": [0.0],
        "duties": [[0.1], [0.1, 1.0], of(recordings=[], duties=[]), of(recordings=[PULSES[0.1]] * 2)],
        "recordings": [of(recordings=[PULSES[0.1][:3]], duties=[0.1])],
    },
    "exposure.pulse_bands": {
        "light": [
            PULSES[0.1][0], PULSES[0.1] * NAN, np.ones((9, 9)), np.random.default_rng(1).normal(0, 1, (200, 40)),
        ],
    },
    "chips.ChipClock": {"rows_per_chip": [0.0], "phase": [NAN], "exposure_rows": [-1.0]},
    "chips.fit_channel": {
        "clock": [{"phase": 0.0}], "chips": [[0, INF], [], [1j]], "signal": [np.zeros((3, 3)), [0.0, NAN]],
        "dark_degree": [7], "swing_degree": [-1],
    },
    "chips.find_preamble": {
        "rows_per_chip": [INF], "tolerance": [0.5], "exposure_rows": [-1.0], "max_exposure_chips": [0.0],
        "preamble": [[1]], "signal": [[NAN]], "max_matches": [0],
    },
    "chips.expose_chips": {"rows": [0]},
    "chips.pool_estimates": {"errors": [of(values=[1.0], errors=[1.0, 2.0])]},
    "chips.refine_channel": {"detect": [lambda *question: [0.0]], "highest_degree": [9]},
    "chips.ClockTracker": {"frame_rows": [0.0]},
    "chips.chip_llr": {
        "noise": [0.0], "count": [-1],
        "exposure_rows": [of(clock=chips.ChipClock(rows_per_chip=4.0, phase=0.0, exposure_rows=65.0))],
    },
    "chips.detect_chips": {
        **{
            name: [of(channel=replace(channel(), **{name: value})) for value in values]
            for name, values in {
                "rows_per_chip": [0.0], "phase": [NAN], "exposure_rows": [-1.0, 100.0], "dark": [np.zeros(0)],
                "noise": [NAN],
            }.items()
        },
        "channel": [of(channel=replace(channel(), swing=np.array([-1.0])))], "method": ["best"],
        "columns": [np.ones((2, 2, 2, 2))],
    },
    "chips.detector_error_rates": {"noise": [0.0], "exposure_rows": [200.0], "rows_per_chip": [1e9]},
    "packets.fsk_transmit": {"tones": [[100.0, 200.0, 300.0], [100.0, 100.0]]},
    "packets.fsk_demodulate": {
        "tones": [[1e5, 2e3]], "rows": [of(column=np.zeros(100), tones=[100.0, 2e3])],
        "column": [np.full(160, INF), 1e300 * np.arange(160), np.zeros((9, 9))], "amplitude": [1e300, -1.0],
    },
    "receiver.FskReceiver": {
        "tones": [of(camera=Camera(1e-5, 1e-3), tones=[500.0, 1010.0]), [500.0, 6e4]], "block_bytes": [256],
        "preamble": ["long"],
    },
    "packets.possible_goodput": {
        "rows": [0, 4000], "chip_rate": [0.0], "frame_time": [of(camera=Camera(1e-5))],
    },
    "packets.fsk_symbol_error_rate": {"tones": [1], "snr": [-1.0]},
    "packets.transmit": {"payload": [b"", bytes(2716), "text", np.zeros(3)], "number": [256]},
    "packets.PacketFormat": {
        "line_code": ["rz", ["0", "1", "1"], ["01", "01"], ["01", "2"], [0, 1]], "block_bytes": [0, 2.5, 300],
        "preamble": ["long"],
    },
    "packets.merge_receptions": {"window": [-1]},
    "packets.encode_line_code": {"bits": [[0, 2], [[0]], of(bits=[0] * 7, line_code="8b10b")]},
    "packets.decode_line_code": {"llr": [of(llr=[1.0] * 7, line_code="4b6b"), [NAN]]},
    "packets.PacketAssembler.push": {"llr": [[NAN], [1j]]},
    "lights.locate_camera": {
        "places": [of(places=PLACES[:2], pixels=PLACES[:2, :2]), PLACES * NAN],
        "pixels": [PLACES[:3, :2], PLACES], "focal": [0.0], "centre": [(1.0, INF)], "distortion": [(1.0,)],
        "noise": [0.0], "inside": [((0.0,), (1.0,))],
    },
    "lights.calibrate": {"frequency": [0.0, -1.0, INF, NAN]},
    "lights.pick_colour": {"colours": [[]]},
    "lights.SourceTracker.update": {"frame": [np.zeros((2, 64, 8))]},
    "lights.SourceTracker": {"patience": [-1], "reach": [0.0, NAN, 1.7e308], "full_every": [0]},
    "lights.detect_sources": {
        "false_alarms": [0.0, NAN, 1.5], "min_cycles": [1.0, INF], "max_sources": [0, -1], "frame": [-1],
        "frames": [*NO_FRAMES, np.zeros((2, 2, 2, 2)), np.zeros((1, 64, 48, 3), np.uint8), *PERHAPS_COLOURS],
        "columns": [of(frames=np.full((64, 64), value)) for value in (NAN, 1e61)],
    },
    "receiver.compare_bits": {"received": ["012", ["01", "2"]], "sent": ["", "0a", [0.5], [[0, 1]]]},
    "receiver.receive": {
        "frames": [*NO_FRAMES, np.zeros((2, 2, 2, 2, 2)), np.zeros((1, 4, 4, 0)), *PERHAPS_COLOURS],
        "columns": [of(frames=np.full((9, 4), NAN))], "chip_rate": [0.0, INF, 7.5e4], "colour": [1, -1],
    },
    "receiver.Receiver": {
        "chip_rate": [-1.0, 1e6], "search_passes": [0], "format": ["manchester"],
    },
    "receiver.Receiver.push": {
        "frame": [np.zeros((2, 2, 2, 2)), np.zeros((2, 64, 48)), np.zeros((0, 4)), np.zeros(9, complex)],
        "number": [1.5],
        "colour": [call(lambda: receiver.Receiver(CAMERA, colour=3).push(np.zeros((9, 9, 3))))],
        "time": [NAN], "exposure": [0.0], "gain": [-1.0],
    },
    "receiver.MultiReceiver": {"regions": [[(1, 2, 3)]], "max_sources": [0], "gain": [True]},
    "receiver.GainOptions": {
        "frequency": [0.0], "waveform": ["saw"], "duty": [1.0], "background": [NAN, "dark"],
    },
    "cleaning.remove_bands": {
        "frames": [*NO_FRAMES, np.zeros(9), np.zeros((7, 3)), np.full((64, 8), NAN), *PERHAPS_COLOURS],
        "light": [np.ones(5), np.zeros(64), np.full(64, -1.0)], "exposure": [of(light=TONE, camera=Camera(1e-5))],
        "model": ["sawtooth"], "keep": ["all"], "level": ["high"], "options": [{"toe": 0.1}],
    },
    "cleaning.VideoCleaner.push": {"frame": [np.zeros((2, 64, 48))]},
    "cleaning.CleaningOptions": {"noise": [0.0, 1e-300, "2"], "max_gain": [1.0], "toe": [1.5, NAN]},
    "cleaning.subtract_still": {
        "frames": [FRAME[None], *PERHAPS_COLOURS], "still": [np.zeros((3, 3))], "neighbours": [0],
    },
    "scene.Plain": {"level": [1.5]},
    "scene.Grating": {"duty": [1]},
    "scene.Picture": {"levels": [[[0, 2]], [[0, NAN]]]},
    "scene.Ring": {"width": [1.0]},
    "scene.Disc": {"diameter": [INF]},
    "scene.Pose": {"position": [(0, 0)]},
    "scene.Pinhole": {"rows": [0], "blur": [-1.0, 101.0, NAN]},
    "scene.Source": {"waveform": [light.Tone(1.0, amplitude=-1)], "shape": [3]},
    "scene.Sensor": {"full_well": [of(read_noise=2.0)]},
    "scene.Scene": {
        r"surfaces\[0\].position": [call(lambda: scene_of(scene.Surface(scene.Disc(1), scene.Pose((0, 0, -1)))))],
        "exposure": [of(camera=Camera(1e-5))],
    },
    "scene.Scene.plan": {
        "tolerance": [0.0], "frames": [0], "unit": [of(tolerance=0.1, unit="noise")],
        "frame_time": [call(lambda: scene_of(camera=Camera(1e-5, 1e-3)).plan(frames=2))],
    },
    "scene.render": {"frames": [2], "noise": [True], "threads": [0]},
    "sensing.sense": {
        "frames": [np.zeros(100), *PERHAPS_COLOURS, np.full((2, 64, 8), 1e302)], "depth": [0.0],
        "unlit": [np.zeros((5, 5))], "waveform": ["saw"],
    },
    "sensing.restore_contrast": {
        "camera.exposure": [of(camera=Camera(1e-5))],
        "columns": [of(columns=np.ones(100), camera=Camera(22.2e-6, 600e-6))],
    },
    "sensing.background_light": {"frames": [*NO_FRAMES, np.zeros((2, 2, 2, 2)), np.full((2, 64, 8), 1e302)]},
    "sensing.sense_region": {
        "frames": [*NO_FRAMES, np.zeros((2, 2, 2, 2)), np.full((2, 64, 8), 1e100), np.full((2, 64, 8), 1e-100)],
        "frame_times": [of(motion=sensing.KnownMotion(frame_times=(0.0, 1.0)))],
        "frequency": [0.0, NAN], "waveform": ["saw"], "duty": [1.0], "depth": [0.0], "motion": ["across"],
        "frequency_std": [of(frequency=types.SimpleNamespace(frequency=517.0, frequency_std=-1.0))],
        "bounds": [of(frequency=None, bounds=(500.0, 400.0))], "others": [[0.0]],
        "background": [np.zeros(3), NAN, 1e300],
    },
    "sensing.KnownMotion": {
        "axis": ["up"], "direction": [2], "pitch": [-1.0, "1mm", Quantity(0.0)], "spatial_frequency": [0.0],
        "speed": [INF], "bounds": [(5.0, 5.0)], "timing_tolerance": [0.0], "frame_times": [(0.0, 0.0)],
    },
}  # fmt: skip
