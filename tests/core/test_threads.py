"""Every public function from eight threads at once: the results are those of one thread."""

import dataclasses
import importlib
import os
import subprocess
import sys
import sysconfig
import threading
import types
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, Samples, SquareWave, Tone
from ocisac_fast.chips import (
    ChipClock,
    ClockTracker,
    chip_llr,
    clock_bounds,
    closest_pair_distance,
    detector_error_rates,
    expose_chips,
    find_channel,
    find_preamble,
    fit_channel,
    pool_estimates,
    refine_channel,
)
from ocisac_fast.exposure import ExposureMeasurement, MeasuredTone, best_noisy_exposure
from ocisac_fast.packets import (
    PacketFormat,
    decode_line_code,
    encode_line_code,
    fsk_demodulate,
    fsk_symbol_error_rate,
    fsk_transmit,
    possible_goodput,
)
from ocisac_fast.scene import Disc, Pinhole, Pose, Sensor, Source, render
from ocisac_fast.tones import lost_frequencies

THREADS = 8
CAMERA = Camera(22.2e-6, 100e-6, frame_time=1 / 30)
RANDOM = np.random.default_rng(7)
SENT = ocisac.transmit(bytes(range(24)))
LIGHT = ocisac.integrate_exposure(Chips(SENT.chips, 11700.0, repeat=True), CAMERA, 720, frames=6)
FRAMES = np.rint(20 + 150 * LIGHT[:, :, None] + RANDOM.standard_normal((6, 720, 16))).astype(np.uint8)
TONE = 100 + 80 * ocisac.integrate_exposure(Tone(500.0), CAMERA, 720)[:, None] + RANDOM.standard_normal((720, 24))
CLOCK = ChipClock(rows_per_chip=6.0, phase=0.7, exposure_rows=4.5)
CHIPS = RANDOM.integers(0, 2, 130).astype(float)
SIGNAL = 10 + 40 * expose_chips(CHIPS, 720, CLOCK, first=-3) + 0.5 * RANDOM.standard_normal(720)
CHANNEL = fit_channel(SIGNAL, CHIPS, CLOCK, first=-3)
GRATING = ocisac.integrate_exposure(Tone(175.0), CAMERA, 720, frames=2)[:, :, None]
MOVING = (40 + 100 * GRATING + RANDOM.standard_normal((2, 720, 64))).astype(np.float32)
WAVES = Tone(500.0) * SquareWave(90.0, phase=0.2) + Chips("0110", 3000.0) + Samples(RANDOM.random(50), 1e4)
SQUARE = ocisac.integrate_exposure(SquareWave(600.0), CAMERA, 360)[:, None] * np.hanning(80)
SQUARE = 20 + 150 * SQUARE + RANDOM.standard_normal((360, 80))
SLOW = ocisac.integrate_exposure(Chips("01101000101110100110" * 3, 2000.0), CAMERA, 720)[:, None]
SLOW = 20 + 150 * SLOW + RANDOM.standard_normal((720, 16))
LINES = [{"light": "lamp", "time_s": 1 + k / 100, "receiver": k, "payload": "hello", "snr_db": k} for k in range(9)]


def received_in_order():
    receiver = ocisac.Receiver(CAMERA, chip_rate=11700.0)
    return [receiver.push(frame) for frame in FRAMES]


def received_of_all_lights():
    receiver = ocisac.MultiReceiver(CAMERA, chip_rate=11700.0)
    return [receiver.push(frame) for frame in FRAMES[:3]]


def tracked_clock():
    tracker = ClockTracker(1500.0)
    errors = clock_bounds(CHIPS, np.full(720, 40.0), CLOCK, noise=0.5, first=-3)
    for frame in range(4):
        tracker.update(frame, dataclasses.replace(CHANNEL, errors=errors))
    return tracker.predict(5)


def controlled_exposure():
    controller = ocisac.ExposureController((20e-6, 2e-3), gains=(1.0, 8.0))
    lights = [MeasuredTone(500.0, snr=100.0, gain=0.9, gain_std=0.01)]
    measured = ExposureMeasurement(lights, [175.0], exposure=1e-4, gain=1.0, level=0.5, peak=0.7)
    return [controller.update(measured) for _ in range(4)]


def followed_sources():
    tracker = ocisac.SourceTracker(CAMERA)
    return [tracker.update(SQUARE) for _ in range(2)]


def located_camera():
    places = np.array([[-0.5, 0, 3], [0.5, 0, 3], [0, 0.6, 3.4], [0.2, -0.6, 2.6], [-0.4, 0.5, 2.5]], float)
    pixels = 900 * places[:, :2] / places[:, 2:] + [640, 360]
    return ocisac.locate_camera(places, pixels, focal=900.0, centre=(640.0, 360.0))


def rendered_scene():
    lamp = Source(Disc(0.02), Pose((0, 0, 0.5)), SquareWave(500.0))
    scene = ocisac.Scene(
        Pinhole(columns=24, rows=16, focal_length=4e-3, pixel_pitch=1e-4), CAMERA, Sensor(2e6), sources=[lamp]
    )
    return list(render(scene.plan(tolerance=0.5, frames=2), threads=2))


# Every public function, and what objects with a memory give; classes that only hold values are made by these.
CALLS = {
    "background_light": lambda: ocisac.background_light(TONE, CAMERA, tones=[500.0], pooled=True),
    "best_exposure": lambda: ocisac.best_exposure([500.0, 700.0], [175.0, 350.0], method="search", points=500),
    "best_noisy_exposure": lambda: best_noisy_exposure([500.0, 175.0], [1.0, 1.0], (1e-5, 2e-3)),
    "calibrate": lambda: ocisac.calibrate(TONE, 500.0),
    "chip_llr": lambda: chip_llr(SIGNAL / 40 - 0.25, CLOCK, noise=0.02, first=0, count=100),
    "clock_bounds": lambda: clock_bounds(CHIPS, np.full(720, 40.0), CLOCK, noise=0.5, first=-3),
    "closest_pair_distance": lambda: closest_pair_distance(6.0, 4.5),
    "decode_line_code": lambda: decode_line_code(np.linspace(-3, 3, 80), "8b10b"),
    "detect_chips": lambda: ocisac.detect_chips(SIGNAL, CAMERA, CHANNEL, method="mlse"),
    "detect_sources": lambda: ocisac.detect_sources(SQUARE, CAMERA),
    "detector_error_rates": lambda: detector_error_rates(6.0, 4.5, 0.1),
    "encode_line_code": lambda: encode_line_code(CHIPS[:128].astype(int), "4b6b"),
    "equalize": lambda: ocisac.equalize(TONE, CAMERA, method="wiener"),
    "expose_chips": lambda: expose_chips(CHIPS, 720, CLOCK, first=-3),
    "exposure_front": lambda: ocisac.exposure_front(500.0, 175.0, points=200),
    "exposure_objective": lambda: ocisac.exposure_objective(np.linspace(1e-5, 2e-3, 99), 500.0, 175.0),
    "exposure_response": lambda: ocisac.exposure_response(np.linspace(0, 2e4, 99), 1e-4),
    "find_channel": lambda: find_channel(SIGNAL, rows_per_chip=6.0, exposure_rows=4.5),
    "find_frequency": lambda: ocisac.find_frequency(TONE, CAMERA),
    "find_preamble": lambda: find_preamble(SIGNAL, CHIPS[40:54], rows_per_chip=6.0, exposure_rows=4.5),
    "fit_channel": lambda: fit_channel(SIGNAL, CHIPS, CLOCK, first=-3),
    "fsk_demodulate": lambda: fsk_demodulate(TONE[:, 0], CAMERA, [500.0, 900.0, 1300.0, 1700.0]),
    "fsk_symbol_error_rate": lambda: fsk_symbol_error_rate(16, 12.0),
    "fsk_transmit": lambda: fsk_transmit(b"threads", [500.0, 900.0, 1300.0, 1700.0]),
    "integrate_exposure": lambda: ocisac.integrate_exposure(WAVES, CAMERA, 720, frames=2),
    "locate_camera": located_camera,
    "longest_payload": lambda: ocisac.longest_payload(),
    "lost_frequencies": lambda: lost_frequencies(Camera(22.2e-6, 2e-3)),
    "merge_receptions": lambda: ocisac.merge_receptions(LINES),
    "pick_colour": lambda: ocisac.pick_colour([TONE, TONE[::-1] / 2], CAMERA),
    "pool_estimates": lambda: pool_estimates([1.0, 1.1, 0.9], [0.1, 0.2, 0.1]),
    "possible_goodput": lambda: possible_goodput(24, CAMERA, chip_rate=11700.0, rows=720),
    "receive": lambda: ocisac.receive(SLOW, CAMERA, chip_rate=2000.0),
    "refine_channel": lambda: refine_channel(SIGNAL, CHANNEL),
    "remove_bands": lambda: ocisac.remove_bands(SQUARE, CAMERA, model="tone"),
    "restore_contrast": lambda: ocisac.restore_contrast(TONE, CAMERA, 500.0),
    "sample_waveform": lambda: ocisac.sample_waveform(WAVES, np.linspace(0, 0.01, 500)),
    "sense": lambda: ocisac.sense(MOVING, CAMERA),
    "sense_region": lambda: ocisac.sense_region(MOVING, CAMERA, 175.0),
    "subtract_still": lambda: ocisac.subtract_still(FRAMES, CAMERA),
    "tone_columns": lambda: ocisac.tone_columns(TONE, CAMERA, 500.0),
    "tone_gain": lambda: ocisac.tone_gain(TONE, CAMERA, [500.0, 900.0], waveform="square", threads=2),
    "transmit": lambda: ocisac.transmit(bytes(24), format=PacketFormat(line_code="8b10b")),
    "varying_tone_gain": lambda: ocisac.varying_tone_gain(TONE, CAMERA, 500.0),
    "ClockTracker": tracked_clock,
    "ExposureController": controlled_exposure,
    "MultiReceiver": received_of_all_lights,
    "Receiver": received_in_order,
    "Scene": rendered_scene,
    "SourceTracker": followed_sources,
}


def plain(value):
    """A result as lists, numbers and strings; NaN equals itself."""
    if dataclasses.is_dataclass(value):
        return [plain(getattr(value, field.name)) for field in dataclasses.fields(value)]
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    return repr(value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value)


def test_every_public_function_is_called():
    rooms = [importlib.import_module(room) for room in dict.fromkeys(ocisac._ROOM_OF.values())]
    names = {name: value for room in rooms for name, value in vars(room).items()}
    functions = {name for name in ocisac.__all__ if isinstance(names[name], types.FunctionType)}
    assert functions <= set(CALLS) <= set(names)


def test_eight_threads_give_the_results_of_one():
    alone = {name: plain(call()) for name, call in CALLS.items()}
    together = threading.Barrier(THREADS)

    def hammer(thread):
        """All functions, each thread from another one on, so that different ones run beside each other as well."""
        names = list(CALLS)
        first = thread * len(names) // THREADS if thread % 2 else 0
        together.wait()
        for name in names[first:] + names[:first]:
            assert plain(CALLS[name]()) == alone[name], name
        return thread

    with ThreadPoolExecutor(THREADS) as pool:
        assert sorted(pool.map(hammer, range(THREADS))) == list(range(THREADS))


def test_an_object_that_threads_share_takes_one_call_at_a_time():
    receiver = ocisac.Receiver(CAMERA, chip_rate=11700.0)
    together = threading.Barrier(THREADS)

    def push(thread):
        together.wait()
        return [receiver.push(frame).frame for frame in FRAMES[:3]]

    with ThreadPoolExecutor(THREADS) as pool:
        numbers = [number for numbers in pool.map(push, range(THREADS)) for number in numbers]
    assert sorted(numbers) == list(range(3 * THREADS))


FORKED = """
import multiprocessing

import numpy as np

import ocisac_fast as ocisac

frames = np.random.default_rng(1).integers(0, 256, (8, 720, 64), dtype=np.uint8)


def gains(_):
    return ocisac.tone_gain(frames, ocisac.Camera(22.2e-6, 1e-4), 500.0, threads=2).gain


before = gains(0)
with multiprocessing.get_context("fork").Pool(2) as pool:
    for after in pool.map(gains, range(6), chunksize=1):
        assert np.array_equal(after, before)
"""


@pytest.mark.usefixtures("process_semaphores")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_child_computes_in_threads_too():
    subprocess.run([sys.executable, "-c", FORKED], check=True, timeout=120)


@pytest.mark.skipif(not sysconfig.get_config_var("Py_GIL_DISABLED"), reason="this Python has a lock of its own")
def test_import_leaves_the_lock_off():
    assert not sys._is_gil_enabled()
