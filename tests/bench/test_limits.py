"""The catalogue of limits: each plain method fails as stated, and the library is right, honest or says so."""

from __future__ import annotations

import functools
import math
import pathlib
import re

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera, Flag
from studies.limits import LIMITS, __main__ as command

DOCUMENT = pathlib.Path(__file__).resolve().parents[2] / "docs" / "measured" / "limits.md"
NAMES = [limit.name for limit in LIMITS]
ENTRY = {limit.name: limit for limit in LIMITS}


@functools.cache
def points(name):
    return ENTRY[name].measure()


@pytest.mark.parametrize("name", NAMES)
def test_the_plain_method_fails_by_what_is_stated(name):
    entry = ENTRY[name]
    spot = entry.point_at_spot(points(name))
    assert spot.plain >= entry.fails_by
    assert entry.fails_by > 2 * entry.good or spot.answered(entry) == "flagged"  # a failure, not a matter of taste


@pytest.mark.parametrize("name", NAMES)
def test_the_library_is_right_or_honest_or_says_so(name):
    entry = ENTRY[name]
    silent = tuple(point.x for point in points(name) if point.answered(entry) == "silent")
    assert silent == entry.silent
    for point in points(name):
        assert not math.isnan(point.library) or point.flags & entry.flags


@pytest.mark.parametrize("name", NAMES)
def test_standard_errors_are_not_blown_up_to_look_honest(name):
    """Where nothing is flagged, what is stated is at most three times what happens, or as good as nothing."""
    for point in points(name):
        if not point.flags and point.stated > 1e-4:
            assert point.stated < 3 * point.library


def test_names_are_unique_and_spots_are_measured():
    assert len(set(NAMES)) == len(NAMES)
    for entry in LIMITS:
        assert entry.point_at_spot(points(entry.name)).x == entry.spot


def test_the_document_has_every_entry_in_order():
    text = DOCUMENT.read_text(encoding="utf-8")
    titles = [entry.title for entry in LIMITS]
    assert re.findall(r"^### (.*)$", text, re.MULTILINE) == titles
    assert text.count("**Library:**") == len(titles)
    table = re.search(r"<!-- limits: figures -->\n(.*?)\n<!-- limits: end -->", text, re.DOTALL)
    assert table
    assert [line.split(" | ")[0].strip("| ") for line in table[1].splitlines()[2:]] == titles


def test_command_writes_picture_and_text(tmp_path, monkeypatch):
    few = [ENTRY["short"], ENTRY["long-exposure"], ENTRY["null-gain"]]
    monkeypatch.setattr(command, "LIMITS", few)
    text = tmp_path / "text.md"
    text.write_text("a\n<!-- limits: figures -->\nold\n<!-- limits: end -->\nz\n")
    command.main(["--directory", str(tmp_path), "--text", str(text)])
    assert points("short")[0].answered(ENTRY["short"]) == "flagged"
    assert (tmp_path / "limits.png").stat().st_size > 5000
    written = text.read_text()
    assert "old" not in written
    assert [line.split(" | ")[0] for line in written.splitlines()[4:7]] == [f"| {entry.title}" for entry in few]
    assert "| NaN | FEW_CYCLES, UNRESOLVABLE |" in written
    assert "frequency reported lost" in written


# A limit that no sweep shows.


@pytest.mark.parametrize("amplitude", [0.4, 2.0, 15.0])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_half_a_step_of_noise_makes_rounding_noise(amplitude, dtype):
    random = np.random.default_rng(5)
    u, offset = np.arange(720)[:, None], random.random(500)
    light = 100 + offset + amplitude * np.cos(2 * np.pi * (12.37 * u / 720 + random.random(500)))
    for noise, quantised in ((0.0, True), (0.2, True), (0.55, False), (1.0, False)):
        stored = np.rint(light + noise * random.standard_normal(light.shape))
        found = ocisac.tone_gain(stored.astype(dtype), Camera(1.0), 12.37 / 720)
        error = np.sqrt(np.mean((found.gain - amplitude / (100 + offset)) ** 2))
        flagged = np.mean((found.flags & (Flag.QUANTISED | Flag.WEAK)) != 0)
        if quantised:
            assert flagged > 0.9 or error < 1.5 * found.gain_std.mean()
        else:
            assert flagged < 0.02
            assert error == pytest.approx(np.sqrt(np.mean(found.gain_std**2)), rel=0.15)
        for floats in (stored, stored / np.float32(255)):
            as_floats = ocisac.tone_gain(floats, Camera(1.0), 12.37 / 720)
            shares = [np.mean((one.flags & Flag.QUANTISED) != 0) for one in (found, as_floats)]
            assert shares[0] == pytest.approx(shares[1], abs=0.01)
