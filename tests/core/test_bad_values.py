"""Every public name with every kind of bad value: a ValueError or TypeError that names the argument, within a second.

A child process with bounded memory makes the calls of a room and writes a line before and after each, so that a crash
names its call. Values that a parameter allows may succeed. New names are in it by themselves (they need a valid call).
"""

from __future__ import annotations

import inspect
import itertools
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import types
import typing
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_grammar import CALLABLES, parameters
from valid_calls import FRAME, VALID

import ocisac_fast

MAX_SECONDS = 1.0  # processor time of one call
MAX_MEMORY = 2 << 30  # bytes beyond those of the imports
SKIPPED = ("plots", "demo", "batch")  # draw, print and start processes for the programs
FUNCTIONS = {one.id: one.values[1] for one in CALLABLES if one.id.split(".")[0] not in SKIPPED}
ROOMS = sorted({name.split(".")[0] for name in FUNCTIONS})


class Nothing:
    """An object of no use; its text is short and constant."""

    def __repr__(self) -> str:
        return "Nothing()"


STEP = np.dtype([("a", "u1"), ("b", "<f8")])
BAD: dict[str, Any] = {
    "None": None,
    "text": "22us",
    "no text": "",
    "bytes": b"22us",
    "object": Nothing(),
    "class": Nothing,
    "function": len,
    "dict": {"a": 1},
    "set": {1.0},
    "iterator": iter([]),
    "True": True,
    "0": 0,
    "-1": -1,
    "-0.5": -0.5,
    "nan": float("nan"),
    "inf": float("inf"),
    "-inf": float("-inf"),
    "tiny": 5e-324,
    "large": 1e308,
    "10^9": 10**9,
    "2^63": 2**63,
    "10^400": 10**400,
    "complex": 1j,
    "array of 0 dimensions": np.array(1.0),
    "empty tuple": (),
    "empty array": np.empty((0, 8)),
    "no columns": np.empty((64, 0)),
    "one value": [1.0],
    "pair down": (2.0, 1.0),
    "pair of nan": (float("nan"), 1.0),
    "triple": (1.0, 2.0, 3.0),
    "ragged": [[1.0], [1.0, 2.0]],
    "nested": [[[[[1.0]]]]],
    "list of None": [None],
    "list of text": ["a"],
    "list of objects": [Nothing()],
    "objects": np.full((64, 8), None),
    "texts": np.full((64, 8), "a"),
    "complex array": np.full((64, 8), 1j),
    "dates": np.zeros((64, 8), "M8[s]"),
    "records": np.zeros((64, 8), STEP),
    "fields": np.zeros((64, 8), STEP)["b"],
    "booleans": np.zeros((64, 8), bool),
    "integers": np.arange(512).reshape(64, 8),
    "half": FRAME.astype(np.float16),
    "foreign bytes": FRAME.astype(">f8"),
    "five dimensions": np.ones((2, 2, 2, 64, 8)),
    "nan in it": np.where(FRAME > 140, np.nan, FRAME),
    "inf in it": np.where(FRAME > 140, np.inf, FRAME),
    "largest": np.full((64, 8), 1e308),
    "negative": -FRAME,
    "masked": np.ma.masked_greater(FRAME, 140),
    "backwards": FRAME[::-1, ::-1],
    "one column": FRAME[:, :1],
    "one row": FRAME[:1],
    "broadcast": np.broadcast_to(np.float64(7.0), (64, 8)),
    "camera": ocisac_fast.Camera(1e-5, 1e-4),
    "waveform": ocisac_fast.Tone(500.0),
}


def calls(room: str) -> typing.Iterator[tuple[str, str, str]]:
    for name, function in FUNCTIONS.items():
        if name.split(".")[0] == room:
            for parameter in parameters(function):
                for kind in BAD:
                    yield name, parameter.name, kind


def call(name: str, changed: dict[str, Any]) -> Any:
    entry = VALID[name]
    if not isinstance(entry, tuple):
        result = FUNCTIONS[name](**entry | changed)
    else:
        owner, given = entry
        method = name.split(".")[-1]
        made = owner() if inspect.isfunction(owner) or (inspect.isclass(owner) and method != "of_array") else owner
        result = getattr(made, method)(**given | changed)
    if isinstance(result, types.GeneratorType) or hasattr(result, "__next__"):
        for _, _ in zip(range(2), result, strict=False):
            pass
    return result


def run(room: str, first: int) -> None:
    """Make the calls of a room and print a line of JSON before and after each; in the child."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MAX_MEMORY, used + MAX_MEMORY))
    warnings.simplefilter("ignore")
    for name, parameter, kind in itertools.islice(calls(room), first, None):
        print(json.dumps([name, parameter, kind]), end="", flush=True)
        signal.setitimer(signal.ITIMER_PROF, 3 * MAX_SECONDS)  # ends the process
        began = time.process_time()
        try:
            with np.errstate(all="ignore"):
                call(name, {parameter: BAD[kind]})
            outcome = "", ""
        except BaseException as error:
            kinds = [one.__name__ for one in (ValueError, TypeError, OSError) if isinstance(error, one)]
            outcome = (kinds or [type(error).__name__])[0], str(error)
        signal.setitimer(signal.ITIMER_PROF, 0)
        print("\t" + json.dumps([*outcome, time.process_time() - began]), flush=True)


def problem(name: str, parameter: str, kind: str, outcome: tuple[str, str, float]) -> str | None:
    """What is wrong with an outcome; None: nothing."""
    error, message, seconds = outcome
    if seconds > MAX_SECONDS:
        return f"took {seconds:.1f} s"
    named = re.search(
        rf"\b{parameter}\b|\w: got .*, allowed: ", message, re.DOTALL
    )  # or the item of a list, by its name
    if not error or (error in ("ValueError", "TypeError") and named):
        return None
    if error == "OSError" and "path" in [one.name for one in parameters(FUNCTIONS[name])]:
        return None
    if error == "MemoryError" and kind in ("10^9", "2^63"):
        return None  # what is asked for does not fit
    if parameter in ("detect", "function") and kind in ("class", "function"):
        return None  # an error of the caller's own function
    return f"{error}: {message:.200}"


def outcomes(room: str, folder: str) -> typing.Iterator[tuple[list[str], tuple[str, str, float]]]:
    """The calls of a room and their outcomes; a call that ends its child is one, and a new child goes on after it."""
    folders = os.pathsep.join([os.path.dirname(__file__), *sys.path])
    environment = {**os.environ, "PYTHONPATH": folders, "OPENBLAS_NUM_THREADS": "1"}
    every, first = list(calls(room)), 0
    while first < len(every):
        program = [sys.executable, __file__, room, str(first)]
        with tempfile.TemporaryFile("w+") as problems:
            done = subprocess.run(
                program, stdout=subprocess.PIPE, stderr=problems, text=True, cwd=folder, env=environment, check=False
            )
            problems.seek(0)
            lines = done.stdout.splitlines()
            assert lines, problems.read()
        for line in lines:
            asked, _, outcome = line.partition("\t")
            yield json.loads(asked), json.loads(outcome) if outcome else (f"exit code {done.returncode}", "", 0.0)
        first += len(lines)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of processes as Linux has them")
@pytest.mark.parametrize("room", ROOMS)
def test_bad_values_are_refused_by_name_in_time(room: str, tmp_path: Any) -> None:
    found = []
    for asked, outcome in outcomes(room, str(tmp_path)):
        wrong = problem(*asked, outcome)
        if wrong:
            found.append(f"{'.'.join(asked)}: {wrong}")
    assert not found, "\n".join([f"{len(found)} findings", *found])


if __name__ == "__main__":
    run(sys.argv[1], int(sys.argv[2]))
