"""Colours of one lamp as streams: as many sources as differ, blindly unmixed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from ocisac_fast import Camera, Receiver, integrate_exposure, receive, transmit
from ocisac_fast.files import read_frames, write_frames
from ocisac_fast.receiver import MultiReceiver, Received

Array = npt.NDArray[np.float64]
ROWS, COLUMNS, EXPOSURE = 900, 60, 0.6  # chips


def bits_of(kind: str, random: np.random.Generator, chips: int) -> npt.NDArray[np.int64]:
    bits = random.integers(0, 2, (3, chips))
    if kind == "opposite":
        return np.stack([1 - bits[0], bits[0], bits[0]])
    return bits[{"three": [0, 1, 2], "two": [0, 1, 0], "one": [0, 0, 0]}[kind]]


def frame(
    kind: str, mixing: Array, noise: float, seed: int
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.int64], float]:
    """A frame (1, rows, columns, 3), the bits of the lamp's colours, and rows per chip."""
    random = np.random.default_rng(seed)
    rows_per_chip = random.uniform(5, 14)
    bits = bits_of(kind, random, int(ROWS / rows_per_chip) + 4)
    fine = bits[:, (np.arange(8 * ROWS) / 8 / rows_per_chip + random.uniform()).astype(int)].astype(float)
    box = int(8 * EXPOSURE * rows_per_chip)
    sums = np.cumsum(np.pad(fine, ((0, 0), (box, 0)), mode="edge"), axis=1)
    light = mixing @ ((sums[:, box:] - sums[:, :-box]) / box)[:, 7::8] / np.abs(mixing).sum(axis=1).max()
    profile = np.exp(-(((np.arange(COLUMNS) - COLUMNS / 2) / (COLUMNS / 3)) ** 2))
    read = random.uniform(10, 40, 3) + 110 * light.T[:, None] * profile[:, None]
    read = read + noise * random.standard_normal(read.shape)
    return np.clip(np.rint(read), 0, 255).astype(np.uint8)[None], bits, rows_per_chip


def wrong(found: Received, bits: npt.NDArray[np.int64]) -> int:
    """Wrong bits at the best place, the first chips may be cut off."""
    got = np.array([int(bit) for bit in found.bits])
    counts = []
    for start in range(4):
        sent = bits[start : start + len(got)]
        counts.append(int((got[: len(sent)] != sent).sum()))
    return min(counts)


def mixed(how: str, random: np.random.Generator) -> Array:
    off = 1 - np.eye(3)
    if how == "corrected":  # a camera's colour correction subtracts
        return np.asarray(1.5 * np.eye(3) - random.uniform(0.1, 0.35, (3, 3)) * off)
    if how == "white":
        return random.uniform(0.1, 1.0, (3, 3))
    return np.asarray(np.diag(random.uniform(0.7, 1, 3)) + float(how) * random.uniform(0.3, 1.0, (3, 3)) * off)


@pytest.mark.parametrize(
    ("kind", "how"),
    [
        *((kind, how) for kind in ("three", "two", "one") for how in ("0", "0.3", "0.5", "corrected")),
        ("one", "white"),
        ("opposite", "0.1"),
    ],
)
@pytest.mark.parametrize("noise", [2.0, 10.0])
@pytest.mark.parametrize("seed", [40, 41])
def test_every_stream_is_received_once(kind: str, how: str, noise: float, seed: int) -> None:
    mixing = mixed(how, np.random.default_rng(seed))
    frames, bits, rows_per_chip = frame(kind, mixing, noise, seed)
    found = receive(frames, Camera(1.0, exposure=EXPOSURE * rows_per_chip))
    sent = np.unique(bits, axis=0)
    assert [one.source for one in found] == list(range(len(sent)))
    of_stream = [[wrong(one, stream) for stream in sent] for one in found]
    assert sorted(int(np.argmin(each)) for each in of_stream) == list(range(len(sent)))
    assert all(min(each) == 0 for each in of_stream)
    for one in found:
        assert one.colour_weights.shape == (3,)
        assert one.rows_per_chip == pytest.approx(rows_per_chip, rel=1e-3)
        if kind == "three" and how != "white":
            own = one.colour_weights @ mixing  # of the lamp's colours in the signal
            assert np.sort(np.abs(own))[1] < 0.1 * np.abs(own).max()
            assert np.abs(own).argmax() == one.colour or how == "0.5"


def test_colours_that_agree_are_added_where_that_pays() -> None:
    equal, _, rows_per_chip = frame("one", np.eye(3), 25.0, 7)
    camera = Camera(1.0, exposure=EXPOSURE * rows_per_chip)
    (got,) = receive(equal, camera)
    alone = [receive(equal, camera, colour=c)[0].snr for c in range(3)]
    assert (got.colour_weights > 0.1).all()
    assert got.snr > 1.5 * max(alone)
    one = np.stack([equal[..., 0], np.full_like(equal[..., 0], 30), np.full_like(equal[..., 0], 30)], axis=-1)
    np.testing.assert_array_equal(receive(one, camera)[0].colour_weights, [1, 0, 0])


@pytest.mark.parametrize("seed", range(4))
def test_colours_without_a_lamp_send_nothing(seed: int) -> None:
    random = np.random.default_rng(seed)
    smooth = np.cumsum(random.standard_normal((1, 700, 1, 3)), axis=1) + random.standard_normal((1, 700, 40, 3))
    frames = np.clip(128 + 3 * smooth, 0, 255).astype(np.uint8)
    assert len(receive(frames, Camera(1.0))) == 1


@pytest.mark.parametrize(("name", "count"), [("rolling_display_triangle.jpg", 2), ("rolling_display_rgb.jpg", 3)])
def test_a_display_of_three_colours(recordings: Path, name: str, count: int) -> None:
    """An RGB LED that draws with its chips: red the opposite of green and blue, or each a stream of its own."""
    frames = read_frames(recordings / name).frames
    camera = Camera(1.0, scan_axis="x", tone_curve="srgb")
    found = receive(frames, camera)
    assert len(found) == count
    for one in found:
        alone = receive(frames, camera, colour=one.colour)[0]
        assert (one.bits, len(one.bits)) == (alone.bits, 240)
    if count == 2:
        assert all(a != b for a, b in zip(found[0].bits, found[1].bits, strict=True))
        assert {found[1].colour, found[0].colour} in ({0, 1}, {0, 2})


def test_the_command_names_the_colour(tmp_path: Path, facts: Any) -> None:
    frames, _, _ = frame("three", np.eye(3), 2.0, 9)
    write_frames(tmp_path / "three.png", frames)
    lines = facts("receive", tmp_path / "three.png", "--scan-axis", "y")
    assert [line["source"] for line in lines] == [0, 1, 2]
    assert sorted(line["colour"] for line in lines) == [0, 1, 2]
    for line in lines:
        (alone,) = receive(frames[..., line["colour"]], Camera(1.0))
        assert line["bits"] == alone.bits


def stream_frames(
    payloads: list[bytes], mixing: Array, seed: int, exposure: float = 90e-6, noise: float = 1.5
) -> tuple[Camera, Iterator[npt.NDArray[np.uint8]]]:
    """Frames (rows, columns, 3) of a lamp whose colours send a payload each."""
    camera = Camera(22.2e-6, exposure, frame_time=1 / 30)
    waves = [transmit(payload).waveform(8e3) for payload in payloads]
    random = np.random.default_rng(seed)
    profile = np.exp(-(((np.arange(24) - 12) / 8) ** 2))

    def frames() -> Iterator[npt.NDArray[np.uint8]]:
        start = random.uniform(0, 1)
        while True:
            sent = np.stack([integrate_exposure(wave, camera, 1080, start=start) for wave in waves])
            light = (mixing @ sent / np.abs(mixing).sum(axis=1).max()).T
            read = 20 + 110 * light[:, None] * profile[:, None]
            yield np.clip(np.rint(read + noise * random.standard_normal(read.shape)), 0, 255).astype(np.uint8)
            start += 1 / 30

    return camera, frames()


PAYLOADS = [bytes([k]) * 40 for k in (17, 99, 203)]


@pytest.mark.parametrize("crosstalk", [0.0, 0.3])
def test_the_receiver_gets_a_payload_of_each_colour(crosstalk: float) -> None:
    mixing = np.eye(3) + crosstalk * (1 - np.eye(3)) * np.random.default_rng(5).uniform(0.5, 1, (3, 3))
    camera, frames = stream_frames(PAYLOADS, mixing, seed=1)
    receiver, found = Receiver(camera, chip_rate=8e3), set()
    for frame in itertools.islice(frames, 40):
        result = receiver.push(frame)
        found |= {one.payload.data for one in (result, *result.streams) if one.payload}
    assert found == set(PAYLOADS)


def test_several_lights_are_a_source_for_each_stream() -> None:
    camera, frames = stream_frames(PAYLOADS, np.eye(3), seed=2)
    receiver, found = MultiReceiver(camera, chip_rate=8e3, regions=[(0, 0, 24, 1080)]), {}
    for frame in itertools.islice(frames, 40):
        for light in receiver.push(frame):
            if light.received and light.received.payload:
                found.setdefault(light.source, set()).add(light.received.payload.data)
    assert sorted(found.values(), key=sorted) == sorted(({one} for one in PAYLOADS), key=sorted)


@pytest.mark.parametrize("exposure", [90e-6, 622e-6])
def test_colours_that_agree_are_one_stream(exposure: float) -> None:
    camera, frames = stream_frames(PAYLOADS[:1] * 3, np.diag([1.0, 0.8, 0.6]), seed=3, exposure=exposure)
    receiver = Receiver(camera, chip_rate=8e3)
    results = [receiver.push(frame) for frame in itertools.islice(frames, 12)]
    assert not any(result.streams for result in results)
    if exposure < 100e-6:  # the sum of all colours: less noise than in the best one
        assert results[-1].snr > 1.3 * results[1].snr
