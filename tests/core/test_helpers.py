"""Helper threads of the core: where they run."""

import ast
import os
import subprocess
import sys

import pytest

# Prints the processors of the process, then those of its helpers: after a call, and after one with a single processor.
SCRIPT = """
import os
import numpy as np
from ocisac_fast import Camera, tone_gain
frames = np.random.default_rng(1).integers(40, 200, (4, 400, 64)).astype(np.uint8)
own = set(os.listdir("/proc/self/task"))
def helpers_after_a_call():
    found = tone_gain(frames, Camera(2e-5), 500.0, threads=2).gain
    assert np.array_equal(found, tone_gain(frames, Camera(2e-5), 500.0).gain)
    return [sorted(os.sched_getaffinity(int(task))) for task in set(os.listdir("/proc/self/task")) - own]
everywhere = sorted(os.sched_getaffinity(0))
print(everywhere)
print(helpers_after_a_call())
os.sched_setaffinity(0, everywhere[:1])
print(helpers_after_a_call())
os.sched_setaffinity(0, everywhere)
print(helpers_after_a_call())
"""


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system does not tell a thread's processors")
def test_helpers_keep_off_the_caller_and_use_its_processors():
    everywhere = os.sched_getaffinity(0)
    if not 2 <= len(everywhere) <= 16 or len(everywhere) != os.cpu_count():
        pytest.skip("needs 2 to 16 processors, all of the machine")
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=60)
    own, *calls = map(ast.literal_eval, done.stdout.splitlines())
    for helpers, processors in zip(calls, (own, own[:1], own), strict=True):
        assert len(helpers) == len(own) - 1
        for allowed in helpers:
            assert set(allowed) <= set(processors)
            assert len(allowed) == max(len(processors) - 1, 1)
