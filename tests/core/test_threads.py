"""Every public function from eight threads at once: the results are those of one thread."""

import dataclasses
import functools
import inspect
import os
import subprocess
import sys
import sysconfig
import threading
import types
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from test_bad_values import FUNCTIONS, call
from test_laws import CAMERA as LAMP_CAMERA, OPERATORS
from valid_calls import VALID

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips
from ocisac_fast.receiver import FskReceiver

THREADS = 8
CAMERA = Camera(22.2e-6, 100e-6, frame_time=1 / 30)
SENT = ocisac.transmit(bytes(range(24)))
LIGHT = ocisac.integrate_exposure(Chips(SENT.chips, 11700.0, repeat=True), CAMERA, 720, frames=6)
FRAMES = np.rint(20 + 150 * LIGHT[:, :, None] + np.random.default_rng(7).standard_normal((6, 720, 16))).astype(np.uint8)


def received(kind):
    receiver = kind(CAMERA, chip_rate=11700.0)
    return [receiver.push(frame) for frame in FRAMES]


# The valid call of every function and method, a frame as of a camera for each operator, and receivers.
CALLS = {
    name: functools.partial(call, name, {})
    for name in VALID
    if inspect.isfunction(FUNCTIONS[name]) and name.split(".")[0] != "files"
}
CALLS |= {name: functools.partial(one.call, one.frames, LAMP_CAMERA) for name, one in OPERATORS.items()}
CALLS |= {kind.__name__: functools.partial(received, kind) for kind in (ocisac.Receiver, ocisac.MultiReceiver)}


def plain(value):
    """A result as lists, numbers and strings; NaN equals itself."""
    if dataclasses.is_dataclass(value):
        return [plain(getattr(value, field.name)) for field in dataclasses.fields(value) if field.repr]
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, types.GeneratorType):
        return plain(list(value))
    if type(value).__repr__ is object.__repr__:  # with a state
        return type(value).__name__
    return repr(value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value)


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


@pytest.mark.parametrize(
    "make",
    [
        lambda: ocisac.Receiver(CAMERA, chip_rate=11700.0),
        lambda: FskReceiver(CAMERA, [1000.0, 1500.0, 2000.0, 2500.0]),
    ],
)
def test_an_object_that_threads_share_takes_one_call_at_a_time(make):
    receiver = make()
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
