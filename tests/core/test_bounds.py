"""Calls that had no end have a bound or an asymptotic answer; long ones end within a second of Ctrl-C."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ocisac_fast import Camera, Receiver, receive, reference
from ocisac_fast.chips import closest_pair_distance, detector_error_rates, find_channel


def test_the_closest_pair_at_any_length():
    for rows_per_chip, exposure in [(3.85, 7.7), (3.85, 40.0), (0.7, 4.5), (20.0, 3.0), (5.0, 9.9), (5.0, 10.5)]:
        wanted = reference.closest_pair_distance(rows_per_chip, exposure)
        assert closest_pair_distance(rows_per_chip, exposure) == pytest.approx(wanted, rel=1e-12)
    for length in (0.3, 1.0, 1.7, 2.0, 2.5, 100.0):
        wanted = reference.closest_pair_distance(1e6, length * 1e6)
        assert closest_pair_distance(1e6, length * 1e6) == pytest.approx(wanted, rel=1e-12)
    assert closest_pair_distance(1e9, 4.5) == pytest.approx(np.sqrt(2e9), rel=1e-6)
    assert closest_pair_distance(3.85, 1e9) == pytest.approx(np.sqrt(4 * 3.85 / 3) * 3.85 / 1e9, rel=0.05)
    assert closest_pair_distance(1e-308, 4.5) == 0
    assert closest_pair_distance(5.0, 1e308) == pytest.approx(0, abs=1e-300)


def test_error_rates_of_any_noise():
    for noise in (1e4, 1e7, 1e9, 1e300):
        rates = detector_error_rates(5.0, 30.0, noise)
        for name in ("slicer", "inverse", "wiener", "dfe", "mlse"):
            assert getattr(rates, name) == pytest.approx(0.5, abs=1e-2), (noise, name)
    assert detector_error_rates(5.0, 30.0, 1e-12).mlse < 1e-12


def test_an_exposure_as_long_as_the_frame_has_no_channel():
    signal_of_rows = np.random.default_rng(0).random(720)
    for exposure in (720.0, 1e9, 1e300):
        assert find_channel(signal_of_rows, rows_per_chip=5.0, exposure_rows=exposure) is None


def test_chips_of_next_to_no_rows_are_refused():
    for rows_per_chip in (1e-300, 1e-9):
        with pytest.raises(ValueError, match=r"rows_per_chip: got 1e-.*, allowed: 0.01 to 100000"):
            find_channel(np.linspace(0, 1, 400), rows_per_chip=rows_per_chip, exposure_rows=28.0)
        with pytest.raises(ValueError, match=r"rows_per_chip: got 1e-.*, allowed: 0.01 to 1000"):
            detector_error_rates(rows_per_chip, 0.0, 0.1)


@pytest.mark.parametrize("chips", [14, 18, 22])
def test_a_picture_under_a_long_exposure_is_not_searched_for_long(chips):
    """A soft edge that no chips explain: every sequence of them is as likely as any."""
    rows = np.arange(480)[:, None]
    edge = 40 + 150 / (1 + np.exp((rows - 240) / 5)) + np.random.default_rng(1).normal(0, 2, (480, 16))
    receiver = Receiver(Camera(22.2e-6, exposure=chips / 15e3, frame_time=1 / 30), chip_rate=15e3)
    began = time.process_time()
    assert receiver.push(np.clip(edge, 0, 255).astype(np.uint8)).outcome == "no_signal"
    assert time.process_time() - began < 3  # 0.3 to 0.9 s; 6 to 60 s without a bound on the sequences


@pytest.mark.parametrize("chip_rate", [None, 1e4])
@pytest.mark.parametrize("shape", [(20_000, 4), (99_999, 1), (99_999, 10)])
@pytest.mark.parametrize("program", ["Receiver", "receive"])
def test_frames_of_noise_are_not_searched(program, shape, chip_rate):
    frame = np.random.default_rng(shape[0]).integers(0, 255, shape, dtype=np.uint8)
    began = time.process_time()
    if program == "receive":
        receive(frame, Camera(1e-5), chip_rate=chip_rate)
    else:
        Receiver(Camera(1e-5), chip_rate=chip_rate).push(frame)
    assert time.process_time() - began < 0.5  # 0.02 to 0.1 s; where they are searched 3 to 24 s


LONG_CALLS = {
    "find_channel": "chips.find_channel(random.random(60_000), rows_per_chip=5.0)",
    "detect_sources": "detect_sources(noise, Camera(1e-5))",
    "remove_bands": "remove_bands(wave + random.random((16, 700, 700)), Camera(1e-5), still=True, light=wave[:, 0])",
    "remove_bands, many rows": "remove_bands(random.integers(0, 255, (400_000, 2), np.uint8), Camera(1e-6))",
    "receive": "receive(np.convolve(random.random(400_000), np.ones(7))[:, None], Camera(1e-5))",
    "equalize": "tones.equalize(chips_seen, Camera(1e-5, 5e-5), method='wiener')",
    "integrate_exposure": "integrate_exposure(product, Camera(1e-5, 1e-3), 40_000_000)",
    "decode_line_code": "packets.decode_line_code(random.random(20_000_000), '8b10b')",
    "detect_chips": "detect_chips(random.random(400_000), Camera(1e-5), channel, method='reduced')",
}


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("call", LONG_CALLS)
def test_an_interrupt_is_heard_within_a_second(call):
    code = f"""
import numpy as np
from ocisac_fast import Camera, Chips, Tone, chips, detect_chips, detect_sources, integrate_exposure, packets
from ocisac_fast import receive, remove_bands, tones
random = np.random.default_rng(0)
sent = random.integers(0, 2, 200)
clock = chips.ChipClock(rows_per_chip=3.0, phase=0.0, exposure_rows=69.0)
signal = chips.expose_chips(sent, 600, clock=clock) + random.random(600)
channel = chips.fit_channel(signal, sent, clock, exposure_known=True)
noise = random.integers(0, 255, (60_000, 64, 32), np.uint8)
chips_seen = np.repeat(random.integers(0, 2, (300, 8000)), 10, axis=0) + 0.1 * random.random((3000, 8000))
product = Tone(500.0) * Chips(random.integers(0, 2, 500), 8e3, repeat=True)
wave = 100 + 30 * np.sin(np.arange(700))[:, None]
print("begun", flush=True)
while True:  # a call that ends before the interrupt on a fast machine
    {LONG_CALLS[call]}
"""
    # A call hears it within 0.02 to 0.45 s at any instant; other programs may hold up one of three tries.
    assert any(_seconds_until_interrupted(code) < 1.5 for _ in range(3))  # and the interpreter's own end


def _seconds_until_interrupted(code):
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as child:
        assert child.stdout.readline() == "begun\n", child.stderr.read()
        time.sleep(1)
        assert child.poll() is None, child.stderr.read()
        sent = time.perf_counter()
        child.send_signal(signal.SIGINT)
        _, problems = child.communicate(timeout=60)
    assert problems.endswith("KeyboardInterrupt\n")
    return time.perf_counter() - sent
