"""One valid call of every public name: what tests vary. Keys are the ids of test_grammar.callables()."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ocisac_fast import Camera, Tone, chips, cleaning, core, exposure, files, lights, packets, receiver, scene, sensing

CAMERA = Camera(1e-5, 1e-4, frame_time=1 / 30)
FRAME = 100 + 50 * np.sin(np.arange(64) * 0.3)[:, None] * np.ones(8)
SENT = np.random.default_rng(0).integers(0, 2, 40)
CLOCK = chips.ChipClock(rows_per_chip=4.0, phase=0.0, exposure_rows=1.0)
SIGNAL = 20 + 100 * chips.expose_chips(SENT, 160, CLOCK)
LLR = 8.0 * SENT - 4
LIGHT = exposure.FlickeringLight(100.0)
POSE = scene.Pose((0.0, 0.0, 1.0))
PLATE = scene.Rectangle(0.1, 0.1)
LENS = scene.Pinhole(columns=4, rows=8, focal_length=4e-3, pixel_pitch=2e-5)
# A pulse that starts at another row in every frame of 600 rows.
PULSES = {
    duty: np.clip((duty * 1500 + 20 - np.abs(np.arange(600) - np.arange(0, 600, 20)[:, None])) / 20, 0.0, 1.0)
    for duty in (0.1, 0.2)
}
PIXELS = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0], [4.0, 5.0]])
PLACES = np.column_stack([0.1 * PIXELS, [0.0, 0.0, 0.0, 0.0, 0.3]])


def channel() -> chips.ChannelEstimate:
    found = chips.fit_channel(SIGNAL, SENT, CLOCK)
    assert found
    return found


def small_scene() -> scene.Scene:
    lamp = scene.Source(PLATE, POSE, Tone(500.0))
    return scene.Scene(LENS, CAMERA, scene.Sensor(1e5), sources=[lamp])


def tracked() -> chips.TrackedClock:
    tracker = chips.ClockTracker(3000.0)
    tracker.update(0, channel())
    found = tracker.predict(1)
    assert found
    return found


def pushed_cleaner() -> cleaning.VideoCleaner:
    cleaner = cleaning.VideoCleaner(CAMERA)
    cleaner.push(FRAME)
    return cleaner


FRAMES = {"frames": FRAME, "camera": CAMERA}
COLUMNS = {"columns": FRAME, "camera": CAMERA}
TONES = [2e3, 4e3, 6e3, 8e3]
FRONT = {"f_comm": 500.0, "f_sense": 175.0}
EXAMPLE = sorted((Path(__file__).parents[2] / "examples").glob("*.toml"))[0]
SHUTTERS = [1e-3, 2e-3]
STREAM = {"frames": FRAME[None], "kind": "array", "response": files.LightResponse()}

# Arguments; for methods, before them, how the object is made.
VALID: dict[str, Any] = {
    "core.as_columns": {"columns": FRAME},
    "core.Region.shared_pixels": (core.Region(0, 0, 4, 4), {"other": core.Region(0, 0, 4, 4)}),
    "core.Region.touches": (core.Region(0, 0, 4, 4), {"other": core.Region(0, 0, 4, 4)}),
    "core.Region.hull": (core.Region(0, 0, 4, 4), {"other": core.Region(0, 0, 4, 4)}),
    "core.Region.is_inside": (core.Region(0, 0, 4, 4), {"columns": 9, "rows": 9}),
    "core.Region.moved_into": (core.Region(0, 0, 4, 4), {"columns": 9, "rows": 9}),
    "core.Region.cut": (core.Region(0, 0, 4, 4), {"frames": FRAME}),
    "camera.Camera": {"row_time": 1e-5},
    "camera.linear_light": {"stored": FRAME, "camera": CAMERA},
    "light.exposure_response": {"frequency": 500.0, "exposure": 1e-3},
    "light.Chips": {"levels": [0, 1], "chip_rate": 1e3},
    "light.Constant": {"level": 1.0},
    "light.Product": {"parts": [Tone(500.0), 2.0]},
    "light.Samples": {"values": [0.0, 1.0], "sample_rate": 1e3},
    "light.SquareWave": {"frequency": 500.0},
    "light.Sum": {"parts": [Tone(500.0), 2.0]},
    "light.Tone": {"frequency": 500.0},
    "light.TriangleWave": {"frequency": 500.0},
    "light.integrate_exposure": {"waveform": Tone(500.0), "camera": CAMERA, "rows": 9},
    "light.sample_waveform": {"waveform": Tone(500.0), "times": [0.0]},
    "tones.equalize": COLUMNS,
    "tones.lost_frequencies": {"camera": CAMERA},
    "tones.find_frequency": COLUMNS,
    "tones.tone_columns": COLUMNS,
    "tones.tone_gain": COLUMNS | {"frequency": 4.8e3},
    "tones.varying_tone_gain": COLUMNS | {"frequency": 4.8e3},
    "exposure.best_exposure": FRONT,
    "exposure.exposure_objective": FRONT | {"exposure": 1e-3},
    "exposure.ExposureController.update": (
        lambda: exposure.ExposureController((1e-5, 1e-2)),
        {"measurement": exposure.ExposureMeasurement([500.0], [175.0], exposure=1e-3)},
    ),
    "exposure.ExposureController": {"exposures": (1e-5, 1e-2)},
    "exposure.ExposureMeasurement": {"lights": [500.0]},
    "exposure.LevelTargets": {},
    "exposure.MeasuredTone": {"frequency": 500.0},
    "exposure.best_noisy_exposure": {"frequencies": [500.0], "weights": [1.0], "bounds": (1e-5, 1e-2)},
    "exposure.FlickeringLight": {"frequency": 100.0},
    "exposure.exposure_modulation": {"light": LIGHT, "exposure": 1e-3},
    "exposure.flicker_free_exposure": {"lights": [LIGHT], "below": 0.1, "near": 1e-2},
    "exposure.flicker_front": {"f_comm": 500.0, "lights": [LIGHT]},
    "exposure.mains_lights": {},
    "exposure.flicker_indices": {"light": LIGHT, "exposure": 1e-3},
    "exposure.exposure_front": FRONT,
    "exposure.flicker_free_chip_rate": {"exposures": SHUTTERS, "below": 0.1},
    "exposure.flicker_free_frequencies": {"exposures": SHUTTERS, "below": 0.1, "bounds": (100.0, 2000.0)},
    "exposure.smallest_flicker_free_duty": {"frequency": 500.0, "exposures": SHUTTERS, "below": 0.1},
    "exposure.unmissed_frequency": {"exposures": SHUTTERS, "duty": 0.5},
    "exposure.calibrate_pulses": {
        "recordings": [PULSES[0.1], exposure.pulse_bands(PULSES[0.2])],
        "frequency": 30.0,
        "duties": [0.1, 0.2],
    },
    "exposure.pulse_bands": {"light": PULSES[0.1]},
    "chips.ChannelEstimate.levels": (channel, {"rows": 9}),
    "chips.ChipClock": {"rows_per_chip": 4.0, "phase": 0.0, "exposure_rows": 1.0},
    "chips.ClockTracker.update": (lambda: chips.ClockTracker(3000.0), {"frame": 0, "channel": channel()}),
    "chips.ClockTracker.predict": (lambda: chips.ClockTracker(3000.0), {"frame": 0}),
    "chips.ClockTracker": {"frame_rows": 3000.0},
    "chips.TrackedClock.channel": (tracked, {"earlier": channel(), "rows": 160}),
    "chips.chip_llr": {"rows": SIGNAL / 200, "clock": CLOCK, "noise": 0.1, "first": 0, "count": 40},
    "chips.clock_bounds": {"chips": SENT, "swing": [100.0], "clock": CLOCK, "noise": 1.0},
    "chips.closest_pair_distance": {"rows_per_chip": 4.0, "exposure_rows": 8.0},
    "chips.expose_chips": {"chips": SENT, "rows": 160, "clock": CLOCK},
    "chips.find_channel": {"signal": SIGNAL, "rows_per_chip": 4.0},
    "chips.find_preamble": {"signal": SIGNAL, "preamble": SENT[:16], "rows_per_chip": 4.0},
    "chips.fit_channel": {"signal": SIGNAL, "chips": SENT, "clock": CLOCK},
    "chips.pool_estimates": {"values": [1.0, 2.0], "errors": [0.1, 0.2]},
    "chips.refine_channel": {"signal": SIGNAL, "start": channel()},
    "chips.detect_chips": {"columns": SIGNAL, "camera": CAMERA, "channel": channel()},
    "chips.detector_error_rates": {"rows_per_chip": 4.0, "exposure_rows": 8.0, "noise": 0.1},
    "packets.FskTransmission.waveform": (lambda: packets.fsk_transmit(b"a", TONES), {"symbol_time": 1 / 30}),
    "packets.fsk_demodulate": {"column": SIGNAL, "camera": CAMERA, "tones": TONES},
    "packets.fsk_symbol_error_rate": {"tones": 2, "snr": 10.0},
    "packets.fsk_transmit": {"payload": b"a", "tones": TONES},
    "packets.possible_goodput": {"payload_bytes": 9, "camera": CAMERA, "chip_rate": 1e4, "rows": 99},
    "packets.merge_receptions": {"lines": [{"light": 1, "time_s": 0.0}]},
    "packets.PacketAssembler.push": (packets.PacketAssembler, {"first": 0, "llr": LLR}),
    "packets.PacketAssembler.lose_clock": (packets.PacketAssembler, {}),
    "packets.PacketAssembler": {},
    "packets.PacketFormat": {},
    "packets.Transmission.waveform": (lambda: packets.transmit(b"a"), {"chip_rate": 1e4}),
    "packets.decode_line_code": {"llr": LLR, "line_code": "manchester"},
    "packets.encode_line_code": {"bits": SENT, "line_code": "manchester"},
    "packets.longest_payload": {},
    "packets.transmit": {"payload": b"a"},
    "lights.locate_camera": {"places": PLACES, "pixels": PIXELS, "focal": 20.0, "centre": (4.0, 4.0)},
    "lights.calibrate": {"columns": FRAME, "frequency": 4.8e3},
    "lights.pick_colour": {"colours": [FRAME], "camera": CAMERA},
    "lights.detect_sources": FRAMES,
    "lights.find_scan_axis": {"frame": FRAME, "camera": CAMERA},
    "lights.SourceTracker.update": (lambda: lights.SourceTracker(CAMERA), {"frame": FRAME}),
    "lights.SourceTracker.follow": (lambda: lights.SourceTracker(CAMERA), {"sources": [], "shape": (64, 8)}),
    "lights.SourceTracker": {"camera": CAMERA},
    "receiver.receive": FRAMES,
    "receiver.compare_bits": {"received": "0110", "sent": "01101"},
    "receiver.FskReceiver.push": (lambda: receiver.FskReceiver(CAMERA, TONES), {"frame": SIGNAL[:, None]}),
    "receiver.FskReceiver": {"camera": CAMERA, "tones": TONES},
    "receiver.GainOptions": {},
    "receiver.MultiReceiver.push": (lambda: receiver.MultiReceiver(CAMERA), {"frame": FRAME}),
    "receiver.MultiReceiver": {"camera": CAMERA},
    "receiver.Receiver.push": (lambda: receiver.Receiver(CAMERA), {"frame": FRAME}),
    "receiver.Receiver": {"camera": CAMERA},
    "cleaning.CleaningOptions": {},
    "cleaning.VideoCleaner.push": (lambda: cleaning.VideoCleaner(CAMERA), {"frame": FRAME}),
    "cleaning.VideoCleaner.again": (pushed_cleaner, {"frame": FRAME, "ago": 1}),
    "cleaning.VideoCleaner.forget": (lambda: cleaning.VideoCleaner(CAMERA), {}),
    "cleaning.VideoCleaner": {"camera": CAMERA},
    "cleaning.remove_bands": FRAMES,
    "cleaning.subtract_still": {"frames": np.stack([FRAME, FRAME]), "camera": CAMERA},
    "scene.Ambient": {},
    "scene.Cosine": {"frequency": 100.0},
    "scene.Disc.contains": (scene.Disc(1.0), {"x": np.zeros(2), "y": np.zeros(2)}),
    "scene.Disc": {"diameter": 1.0},
    "scene.Grating": {"frequency": 100.0},
    "scene.Mask": {"shape": PLATE, "pose": POSE},
    "scene.PathLoss.at": (scene.PathLoss(2.0), {"distance": np.ones(2)}),
    "scene.PathLoss": {},
    "scene.Picture": {"levels": np.full((4, 4), 0.5), "width": 0.1, "height": 0.1},
    "scene.Pinhole.pixels_of": (LENS, {"points": [[0.0, 0.0, 1.0]]}),
    "scene.Pinhole.rays_of": (LENS, {"pixels": [[0.0, 0.0]]}),
    "scene.Pinhole": {"columns": 4, "rows": 8, "focal_length": 4e-3, "pixel_pitch": 2e-5},
    "scene.Plain": {},
    "scene.Pose.to_world": (POSE, {"points": [[0.0, 0.0, 1.0]]}),
    "scene.Pose.to_object": (POSE, {"points": [[0.0, 0.0, 1.0]]}),
    "scene.Pose": {},
    "scene.Rectangle.contains": (PLATE, {"x": np.zeros(2), "y": np.zeros(2)}),
    "scene.Rectangle": {"width": 0.1, "height": 0.1},
    "scene.Ring.contains": (scene.Ring(1.0, 0.1), {"x": np.zeros(2), "y": np.zeros(2)}),
    "scene.Ring": {"diameter": 1.0, "width": 0.1},
    "scene.Scene.plan": (small_scene, {}),
    "scene.Scene": {"lens": LENS, "camera": CAMERA, "sensor": scene.Sensor(1e5)},
    "scene.Sensor": {"gain": 1e5},
    "scene.Source": {"shape": PLATE, "pose": POSE, "waveform": Tone(500.0)},
    "scene.Surface": {"shape": PLATE, "pose": POSE},
    "scene.load_scene": {"path": EXAMPLE},
    "scene.render": {"plan": small_scene().plan()},
    "scene.save_scene": {"path": "/dev/null", "scene": small_scene()},
    "sensing.restore_contrast": COLUMNS | {"frequency": 4.8e3},
    "sensing.KnownMotion.bounds_for": (sensing.KnownMotion, {"row_time": 1e-5}),
    "sensing.KnownMotion": {},
    "sensing.sense": {"frames": np.stack([FRAME, FRAME]), "camera": CAMERA},
    "sensing.background_light": FRAMES,
    "sensing.sense_region": FRAMES | {"frequency": 4.8e3},
    "files.RecordingStream.of_array": (files.RecordingStream, STREAM),
    "files.RecordingStream.map_frames": (lambda: files.RecordingStream.of_array(**STREAM), {"function": iter}),
    "files.RecordingStream.time_of": (lambda: files.RecordingStream.of_array(**STREAM), {"frame": 0}),
    "files.RecordingStream.read": (lambda: files.RecordingStream.of_array(**STREAM), {"max_bytes": 1 << 20}),
    "files.atomic_path": {"path": "out.npy"},
    "files.cut_recording": {"path": "absent.npy", "max_frames": 4},
    "files.open_recording": {"path": "absent.npy"},
    "files.read_frames": {"path": "absent.npy"},
    "files.write_frames": {"path": "out.npy", "frames": [FRAME]},
}
