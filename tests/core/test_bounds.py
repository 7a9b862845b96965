"""Calls that had no end: each has a bound or an asymptotic answer; those that rightly take long hear of Ctrl-C."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ocisac_fast import reference
from ocisac_fast.chips import closest_pair_distance, detector_error_rates, find_channel
from ocisac_fast.exposure import ExposureController, best_noisy_exposure


def test_the_closest_pair_at_any_length():
    for rows_per_chip, exposure in [(3.85, 7.7), (3.85, 40.0), (0.7, 4.5), (20.0, 3.0), (5.0, 9.9), (5.0, 10.5)]:
        wanted = reference.closest_pair_distance(rows_per_chip, exposure)
        assert closest_pair_distance(rows_per_chip, exposure) == pytest.approx(wanted, rel=1e-12)
    for length in (1e-5, 0.3, 1.0, 1.7, 2.0, 2.5, 100.0):  # sums over rows and integrals meet
        below, above = 2.0**17 - 0.5, 2.0**17 + 0.5
        summed, integral = closest_pair_distance(below, length * below), closest_pair_distance(above, length * above)
        assert integral == pytest.approx(summed * np.sqrt(above / below), rel=1e-5 if length < 1e-3 else 1e-9)
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


@pytest.mark.parametrize("step", [5e-324, 1e-300, 1e-30])
def test_steps_below_what_numbers_hold_are_refused(step):
    with pytest.raises(ValueError, match=r"step: got .*, allowed: 0 \(any exposure"):
        best_noisy_exposure([500.0], [1.0], bounds=(1e-5, 1e-2), step=step)
    with pytest.raises(ValueError, match="step: got"):
        ExposureController((1e-5, 1e-2), step=step)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_an_interrupt_is_heard_within_a_second():
    code = """
import numpy
from ocisac_fast.chips import find_channel
print("begun", flush=True)
find_channel(numpy.random.default_rng(0).random(60_000), rows_per_chip=5.0)
"""
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as child:
        assert child.stdout.readline() == "begun\n"
        time.sleep(1)
        assert child.poll() is None, child.stderr.read()
        sent = time.perf_counter()
        child.send_signal(signal.SIGINT)
        _, problems = child.communicate(timeout=60)
    assert time.perf_counter() - sent < 1.5  # and the interpreter's own end
    assert problems.endswith("KeyboardInterrupt\n")
