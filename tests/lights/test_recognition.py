"""Recognition of known lights in later frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings, strategies as st

from ocisac_fast import Camera, _core, tone_gain
from ocisac_fast.core.regions import Region

Pixels = npt.NDArray[Any]

ROW_TIME, DARK = 1e-5, 3.0


def lamp(random: np.random.Generator, carries_data: bool) -> tuple[Region, float, Pixels]:
    """Box, frequency in cycles per row, and waveform of a lamp of any size within 150 x 120 pixels."""
    rows, columns = (int(random.integers(low, high)) for low, high in ((12, 60), (2, 90)))
    box = Region(int(random.integers(0, 121 - columns)), int(random.integers(0, 151 - rows)), columns, rows)
    frequency = random.uniform(2.0 / rows, 0.45)
    angle = 2 * np.pi * frequency * np.arange(150) + random.uniform(0, 6)
    chips = np.repeat(random.integers(0, 2, 150), random.integers(2, 9))[:150]
    return box, frequency, 2.0 * chips - 1.0 if carries_data else np.cos(angle)


def frame_of(random: np.random.Generator, box: Region, waveform: Pixels, swing: float, dtype: Any) -> Pixels:
    picture = np.full((150, 120), 40.0) + 5.0 * np.sin(np.arange(120) / 7)
    place = np.clip(box.x, 0, 119), np.clip(box.y, 0, 149)
    part = picture[place[1] : place[1] + box.height, place[0] : place[0] + box.width]
    part += 80.0 + swing * waveform[: part.shape[0], None] + 30.0 * np.sin(np.arange(part.shape[1]) / 9)
    noisy = picture + random.normal(0.0, random.uniform(0.0, 3.0), picture.shape)
    pixels: Pixels = np.clip(np.rint(noisy), 0, 255).astype(dtype)
    return pixels if random.integers(0, 2) else np.asfortranarray(pixels)


@settings(max_examples=200, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    carries_data=st.booleans(),
    dtype=st.sampled_from([np.uint8, np.uint16, np.float32, np.float64]),
)
def test_what_is_found_is_the_light_where_it_is(seed: int, carries_data: bool, dtype: Any) -> None:
    """Its gain is that of its box."""
    random = np.random.default_rng(seed)
    box, frequency, waveform = lamp(random, carries_data)
    camera = Camera(ROW_TIME, dark_level=DARK, white_level=255.0)
    first = frame_of(random, box, waveform, 30.0, dtype)
    light = _core.KnownLight(first, camera._handle, box, frequency / ROW_TIME, carries_data)
    moved = box._replace(x=box.x + int(random.integers(-4, 5)), y=box.y + int(random.integers(-4, 5)))
    places = [(box.x + int(random.integers(-6, 7)), box.y), (box.x, box.y)]
    for at, swing in ((box, 30.0), (moved, 30.0), (moved, 36.0)):
        frame = first if at is box else frame_of(random, at, waveform, swing, dtype)
        found = light.find(frame, places)
        if found is None:
            continue
        place = Region(*found[0])
        assert place == at._replace(x=place.x, y=place.y)
        assert max(abs(place.x - at.x), abs(place.y - at.y)) <= 6  # the frames before were up to ten away
        assert 0.7 <= found[2] <= 1.4
        if not carries_data:
            assert found[1] * ROW_TIME == pytest.approx(frequency, rel=1e-12)
        gain = tone_gain(place.cut(frame), camera, found[1], pooled=True)
        assert (found[3], found[4], found[6], found[7]) == (gain.gain, gain.gain_std, gain.mean, gain.flags)
        turned = float(gain.phase) - 2 * np.pi * found[1] * ROW_TIME * place.y
        assert np.exp(1j * found[5]) == pytest.approx(np.exp(1j * turned), abs=1e-9)


def test_most_lights_that_stay_are_found_and_none_that_go_out() -> None:
    found, left = [], []
    for seed in range(60):
        random = np.random.default_rng(seed)
        box, frequency, waveform = lamp(random, seed % 2 == 1)
        camera = Camera(ROW_TIME, dark_level=DARK, white_level=255.0)
        first, later, dark = (frame_of(random, box, waveform, swing, np.uint8) for swing in (30.0, 30.0, 0.0))
        light = _core.KnownLight(first, camera._handle, box, frequency / ROW_TIME, seed % 2 == 1)
        found.append(light.find(later, [(box.x, box.y)]) is not None)
        left.append(light.find(dark, [(box.x, box.y)]) is not None)
    assert sum(found) > 40
    assert not any(left)


def test_a_box_outside_of_the_frame_is_refused() -> None:
    with pytest.raises(ValueError, match="box: got 10,0,40,30, allowed: inside the picture of 40x40"):
        _core.KnownLight(np.zeros((40, 40)), Camera(ROW_TIME)._handle, (10, 0, 40, 30), 1e4, False)
