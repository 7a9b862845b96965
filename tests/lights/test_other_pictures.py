"""Lights of real pictures, mirrored, darker or noisier than they were: other pictures of the same lamps."""

import json

import numpy as np
import pytest

from ocisac_fast import Camera
from ocisac_fast.lights import detect_sources

OTHERS = {
    "mirrored": lambda picture, _: picture[:, ::-1],
    "turned": lambda picture, _: picture[::-1, ::-1],
    "darker": lambda picture, _: np.rint(0.7 * picture),
    "noisier": lambda picture, random: np.rint(picture + 2 * random.standard_normal(picture.shape)),
}


@pytest.mark.parametrize("name", ["five_lamps_lumia.jpg", "luxapose_chandelier_c.jpg", "luxapose_chandelier_e.jpg"])
@pytest.mark.parametrize("other", OTHERS)
def test_lamps_keep_their_frequencies_and_reflections_are_named(recordings, name, other):
    entries = json.loads((recordings / "world" / "recordings.json").read_text())
    (entry,) = (one for one in entries if one["file"] == name)
    image = pytest.importorskip("PIL.Image")
    picture = np.asarray(image.open(recordings / "world" / name).convert("L"), np.float64)
    changed = OTHERS[other](picture, np.random.default_rng(5))
    camera = Camera(entry["row_time_s"], entry["exposure_s"], tone_curve="srgb", scan_axis="x")
    found = detect_sources(np.ascontiguousarray(np.clip(changed, 0, 255).astype(np.uint8)), camera)
    sent = sorted(one["frequency_hz"] for one in entry["detect"]["sources"])
    own = sorted(one.frequency for one in found if one.reflection_of is None)
    assert own == pytest.approx(sent, rel=0.02)
