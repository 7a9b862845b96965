"""Units and axes confused as users do, one and two at a time: the right answer, a flag, or one line.

Accepted silences, each with its reason, are few and listed.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from test_laws import CAMERA, DATA, MOVING, SQUARE, Array, lamp

import ocisac_fast as ocisac
from ocisac_fast import Camera, Tone

Asked = tuple[Array, Camera, float]  # frames, camera, frequency or chip rate


def camera(**changes: Any) -> Callable[[Asked], Asked]:
    return lambda asked: (asked[0], dataclasses.replace(asked[1], **changes), asked[2])


CONFUSIONS: dict[str, Callable[[Asked], Asked]] = {
    "row time in us": camera(row_time=20.0, frame_time=None),
    "frame time in ms": camera(frame_time=1e3 / 30),
    "exposure in us": camera(exposure=100.0),
    "exposure in ms": camera(exposure=0.1),
    "exposure above the frame time": camera(exposure=0.04),
    "no exposure": camera(exposure=0.0),
    "rate in kHz": lambda asked: (asked[0], asked[1], 1e-3 * asked[2]),
    "rows across": lambda asked: (asked[0].swapaxes(-1, -2), *asked[1:]),
    "rows upwards": lambda asked: (asked[0][..., ::-1, :], *asked[1:]),
    "frames last": lambda asked: (np.stack([asked[0]] * 3, axis=-1), *asked[1:]),
    "one colour last": lambda asked: (asked[0][..., None], *asked[1:]),
    "blue, green, red": lambda asked: (np.stack([asked[0] // 3, asked[0] // 2, asked[0]], -1)[None], *asked[1:]),
}

# Frames, the rate of the light in them, and a function of frames, camera and rate.
CALLS: dict[str, tuple[Array, float, Callable[..., Any]]] = {
    "tone_gain": (SQUARE, 700.0, lambda f, c, rate: ocisac.tone_gain(f, c, rate, pooled=True)),
    "tone of a lamp": (lamp(Tone(2400.0)), 2400.0, lambda f, c, _: ocisac.find_frequency(f, c)),
    "find_frequency": (SQUARE, 700.0, lambda f, c, _: ocisac.find_frequency(f, c)),
    "receive": (DATA, 4000.0, lambda f, c, rate: ocisac.receive(f, c, chip_rate=rate)[0]),
    "receive, blind": (DATA, 4000.0, lambda f, c, _: ocisac.receive(f, c)[0]),
    "Receiver": (DATA, 4000.0, lambda f, c, rate: ocisac.Receiver(c, chip_rate=rate).push(f)),
    "sense_region": (MOVING, 170.0, ocisac.sense_region),
}

# Rows of a picture turned by 90° show light that varies slowly, as a tone of less than two cycles does, which
# `varying_tone_gain` flags; many frames of few columns are legal.
SILENT = {("tone_gain", "rows across"), ("tone_gain", "frames last"), ("tone_gain", "one colour last")}


def said(answer: Any, row_time: float) -> Any:
    """What must be right, in rows: bits, or frequency and gain."""
    if hasattr(answer, "bits"):
        return answer.bits
    rate = getattr(answer, "frequency", None)
    return [value for value in (rate and rate * row_time, getattr(answer, "gain", None)) if value is not None]


def is_near(one: Any, other: Any) -> bool:
    return one == other if isinstance(one, str) else bool(np.allclose(one, other, rtol=3e-3))


@pytest.mark.parametrize("name", CALLS)
def test_a_confusion_is_answered_rightly_flagged_or_refused(name: str) -> None:
    frames, rate, function = CALLS[name]
    truth = said(function(frames, CAMERA, rate), CAMERA.row_time)
    backwards = truth[::-1] if isinstance(truth, str) else truth
    for pair in (*itertools.combinations(CONFUSIONS, 1), *itertools.combinations(CONFUSIONS, 2)):
        if any((name, one) in SILENT for one in pair):
            continue
        asked, refusals = (frames, CAMERA, rate), []
        try:
            for one in pair:
                asked = CONFUSIONS[one](asked)
            answer = function(*asked)
        except (ValueError, TypeError) as error:
            refusals = str(error).splitlines()
        if refusals:
            assert len(refusals) == 1, pair
            continue
        found = said(answer, asked[1].row_time or 1.0)
        nothing = found == "" or (not isinstance(found, str) and np.isnan(found).any())
        right = is_near(found, truth) or (isinstance(found, str) and is_near(found, backwards))
        assert right or nothing or np.all(answer.flags != 0), (pair, found, answer.flags)
