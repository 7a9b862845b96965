"""Answers for recordings of real cameras as they were when stored, where these were right: a change of them is seen.

OCISAC_STORE_ANSWERS=1 stores the answers of this version instead.
"""

from __future__ import annotations

import json
import math
import os
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera
from ocisac_fast.files import read_frames
from ocisac_fast.lights import pick_colour

STORED = pathlib.Path(__file__).parent / "stored_answers.json"
Picture = npt.NDArray[Any]

TONES = ["nikon_z7_500hz.jpg", "gyroflow_nikon1j1_1khz.png", *(f"laser_square_0{k}.png" for k in range(6))]
CHIPS = [*(f"laser_pattern_0{k}.png" for k in range(2, 7)), "laser_check.png", "underwater_0.jpeg", "underwater_2.jpeg"]
LIGHTS = ["luxapose_rig_a.jpg", "luxapose_chandelier_a.jpg"]
BANDS = ["mains_flicker.png", "poster_nlos.jpg"]


def picture(folder: pathlib.Path, name: str) -> Picture:
    """(rows, columns, colours)."""
    if not (folder / name).exists():
        pytest.skip(f"no {name} at {folder}")
    frame: Picture = read_frames(folder / name).frames[0]
    return frame if frame.ndim == 3 else frame[..., np.newaxis]


def rounded(value: float) -> float | None:
    """Seven digits; None for NaN."""
    return None if math.isnan(value) else float(f"{value:.7g}")


def tone(frame: Picture) -> dict[str, Any]:
    colours = list(np.moveaxis(frame, -1, 0))
    best = pick_colour(colours, Camera(1.0))
    found = ocisac.find_frequency(colours[best], Camera(1.0))
    gains = ocisac.tone_gain(colours[best], Camera(1.0), found.frequency, pooled=True)
    return {
        "colour": best,
        "frequency": rounded(found.frequency),
        "frequency_std": rounded(found.frequency_std),
        "snr": rounded(found.snr),
        "harmonics": found.harmonics,
        "columns": int(found.columns.used.sum()),
        "flags": int(found.flags),
        "gain": rounded(float(gains.gain)),
    }


def chips(frame: Picture) -> list[dict[str, Any]]:
    return [
        {
            "bits": one.bits,
            "colour": one.colour,
            "rows_per_chip": rounded(one.rows_per_chip),
            "rows_per_chip_std": rounded(one.rows_per_chip_std),
            "phase": rounded(one.phase),
            "snr": rounded(one.snr),
            "columns": [int(one.columns.min()), int(one.columns.max()), one.columns.size] if one.columns.size else [],
            "flags": int(one.flags),
        }
        for one in ocisac.receive(frame[np.newaxis], Camera(1.0))
    ]


def lights(frame: Picture) -> list[dict[str, Any]]:
    """Lights of the green, read out along either axis."""
    names = ("x", "y", "width", "height", "carries_data", "reflection_of", "merged")
    numbers = ("frequency", "frequency_std", "gain", "amplitude", "snr", "periodic")
    return [
        {name: getattr(one, name) for name in names}
        | {name: rounded(getattr(one, name)) for name in numbers}
        | {"axis": axis, "flags": int(one.flags)}
        for axis, view in (("y", frame[..., 1]), ("x", frame[..., 1].T))
        for one in ocisac.detect_sources(np.ascontiguousarray(view), Camera(1.0))
    ]


def region(frame: Picture) -> dict[str, Any]:
    """The light in the first 192 columns."""
    found = ocisac.sense_region(np.ascontiguousarray(frame[:, :192, 0]), Camera(1.0))
    numbers = ("frequency", "frequency_std", "cycles_per_column_std", "gain", "gain_std", "contrast", "mean", "snr")
    return {"kind": found.kind, "flags": int(found.flags)} | {name: rounded(getattr(found, name)) for name in numbers}


def clean(frame: Picture) -> dict[str, Any]:
    """At most 600 by 400 pixels in the middle, without bands."""
    top, left = (max(0, (size - most) // 2) for size, most in zip(frame.shape, (600, 400), strict=False))
    part = np.ascontiguousarray(frame[top : top + 600, left : left + 400])
    done = ocisac.remove_bands(part[np.newaxis], Camera(1.0, tone_curve="srgb"))
    light = done.light.mean(axis=-1) if done.light.ndim == 3 else done.light
    every = max(1, light.shape[-1] // 12)
    return {
        "model": done.model[0],
        "frequency": rounded(float(done.frequency[0])),
        "light": [rounded(float(value)) for value in light.reshape(-1)[::every]],
        "share": [rounded(float(value)) for value in np.quantile(done.share, (0.1, 0.5, 0.9))],
        "marks": [int(count) for count in np.bincount(done.marks.ravel(), minlength=3)],
        "mean": [rounded(float(value)) for value in done.frames.mean(axis=(0, 1, 2))],
    }


QUESTIONS: list[tuple[Callable[[Picture], Any], str]] = [
    *((tone, name) for name in TONES),
    *((chips, name) for name in CHIPS),
    *((lights, name) for name in LIGHTS),
    *((region, name) for name in TONES[:3]),
    *((clean, name) for name in BANDS),
]


def assert_close(got: Any, want: Any, where: str) -> None:
    """Numbers to 0.2 %, which leaves room for other processors and decoders; all else equal."""
    if isinstance(want, dict):
        assert got.keys() == want.keys(), where
        for key, value in want.items():
            assert_close(got[key], value, f"{where}.{key}")
    elif isinstance(want, list):
        assert len(got) == len(want), where
        for k, (one, other) in enumerate(zip(got, want, strict=True)):
            assert_close(one, other, f"{where}[{k}]")
    elif isinstance(want, float):
        assert got == pytest.approx(want, rel=2e-3, abs=1e-6), where
    else:
        assert got == want, where


def write(stored: dict[str, dict[str, Any]]) -> None:
    """JSON, a line a picture."""
    parts = []
    for question, answers in sorted(stored.items()):
        lines = ",\n".join(f"  {json.dumps(name)}: {json.dumps(answer)}" for name, answer in sorted(answers.items()))
        parts.append(f' "{question}": {{\n{lines}\n }}')
    STORED.write_text("{\n" + ",\n".join(parts) + "\n}\n")


@pytest.mark.parametrize(("ask", "name"), QUESTIONS, ids=[f"{ask.__name__}-{name}" for ask, name in QUESTIONS])
def test_answers_are_those_stored(ask: Callable[[Picture], Any], name: str, recordings: pathlib.Path) -> None:
    answer = json.loads(json.dumps(ask(picture(recordings, name))))
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    if os.environ.get("OCISAC_STORE_ANSWERS"):
        stored.setdefault(ask.__name__, {})[name] = answer
        write(stored)
        return
    assert_close(answer, stored[ask.__name__][name], f"{ask.__name__} {name}")
