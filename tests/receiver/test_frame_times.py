"""Frames whose times and exposures are uncertain, stated or wrong: all are read, and joined."""

import itertools

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera
from ocisac_fast.packets import PacketFormat
from ocisac_fast.packets.transmission import PacketAssembler
from ocisac_fast.receiver import Receiver

ROW_TIME, FRAME_TIME, CHIP_RATE, EXPOSURE = 22.2e-6, 1 / 30, 8e3, 622e-6
PAYLOAD = np.random.default_rng(77).bytes(100)


class Film:
    """Frames of a light with a packet; each begins at its own time and may have its own exposure."""

    def __init__(self, seed, **packet):
        self.random = np.random.default_rng(seed)
        self.format = PacketFormat(**packet)
        self.waveform = ocisac.transmit(PAYLOAD, format=self.format).waveform(CHIP_RATE)
        self.start = self.random.uniform(0, 5)

    def frame(self, time, exposure=EXPOSURE, gain=1.0):
        camera = Camera(ROW_TIME, exposure)
        light = ocisac.integrate_exposure(self.waveform, camera, 1080, start=self.start + time)
        return gain * (20 + 100 * exposure / EXPOSURE * (light + 0.02 * self.random.standard_normal(1080)))

    def receiver(self, frame_time=FRAME_TIME, exposure=EXPOSURE):
        return Receiver(Camera(ROW_TIME, exposure, frame_time=frame_time), chip_rate=CHIP_RATE, format=self.format)


def frames_until_payload(results, most=40):
    for count, result in enumerate(itertools.islice(results, most), 1):
        if result.payload is not None:
            assert result.payload.data == PAYLOAD
            return count
    return most + 1


@pytest.mark.parametrize(
    ("jitter", "line_code", "most"),
    [
        (0.0, "manchester", 12),
        (20e-6, "manchester", 13),
        (50e-6, "manchester", 14),
        (300e-6, "manchester", 18),
        (100e-6, "4b6b", 14),
        (100e-6, "none", 12),
        (300e-6, "8b10b", 16),
    ],
)
def test_frames_whose_starts_jitter_are_joined(jitter, line_code, most):
    """By up to 2.4 chips: 11 to 12 frames in Manchester code without jitter."""
    for seed in range(3):
        film = Film(seed, line_code=line_code)
        receiver = film.receiver()
        times = (index * FRAME_TIME + jitter * film.random.uniform(-1, 1) for index in itertools.count())
        assert frames_until_payload(receiver.push(film.frame(time)) for time in times) <= most


def test_time_stamps_join_frames_of_any_times():
    """A frame rate that wanders by 20 %, unknown to the camera; stamps of 1 µs."""
    film = Film(5)
    receiver = film.receiver(frame_time=None)
    times = np.cumsum(FRAME_TIME * film.random.uniform(0.9, 1.3, 40))
    results = (receiver.push(film.frame(time), time=round(time, 6) - 1234.0) for time in times)
    assert frames_until_payload(results) <= 14


def test_frames_given_twice_and_left_out_are_no_loss_without_numbers():
    film = Film(6)
    receiver = film.receiver()
    kept = [index for index in range(60) for _ in range(1 + (index % 3 == 0)) if index % 7]
    frames = {index: film.frame(index * FRAME_TIME) for index in set(kept)}
    results = [receiver.push(frames[index]) for index in kept]
    assert frames_until_payload(results) <= 22
    repeated = [now == before for before, now in itertools.pairwise(kept)]
    assert [result.stretch.outcome == "repeated" for result in results[1:]] == repeated


@pytest.mark.parametrize("seed", range(6))
def test_frames_given_twice_are_found_when_they_are_read_again(seed):
    """A round spot is learned after some frames, of which two were given twice: later frames have their times."""
    film = Film(seed)
    receiver = film.receiver()
    spot = np.exp(-(((np.arange(1080) - 540) / 250) ** 2) / 2)
    given = sorted([*range(40), 2, 5])
    frames = {index: 20 + spot * (film.frame(index * FRAME_TIME) - 20) for index in given}
    assert frames_until_payload(receiver.push(frames[index]) for index in given) <= 18


def test_places_in_doubt_are_settled_by_header_and_line_code_or_left_open():
    """Chips of the right places, told to be up to five chips off; no stretch is placed wrong."""
    random = np.random.default_rng(8)
    for line_code in ("none", "manchester", "4b6b", "8b10b"):
        packets = PacketFormat(line_code=line_code)
        chips = ocisac.transmit(PAYLOAD, format=packets).chips
        assembler = PacketAssembler(format=packets)
        place, count = int(random.integers(chips.size)), 0
        while True:
            first, count = place + 267 * count, count + 1
            seen = np.where(chips[(first + np.arange(191)) % chips.size], 9.0, -9.0)
            report = assembler.push(first + int(random.integers(-5, 6)), seen, scatter=3.0)
            assert report.violations == 0
            if report.payload is not None:
                break
        assert report.payload.data == PAYLOAD
        assert report.payload.corrected == 0
        assert count <= 22


@pytest.mark.parametrize(
    ("told", "line_code"), [(0.8, "manchester"), (1.2, "manchester"), (0.85, "4b6b"), (1.3, "none")]
)
def test_a_wrong_exposure_is_found_from_the_frames(told, line_code):
    """And the frames before it was found are read again: as many frames as with the right one."""
    for seed in range(3):
        film = Film(seed, line_code=line_code)
        receiver = film.receiver(exposure=told * EXPOSURE)
        results = [receiver.push(film.frame(index * FRAME_TIME)) for index in range(14)]
        assert frames_until_payload(results) <= 13
        assert results[-1].exposure == pytest.approx(EXPOSURE, rel=0.01)
        assert results[-1].flags == 0


@pytest.mark.parametrize("step", [-0.3, -0.1, 0.2])
@pytest.mark.parametrize("stated", [False, True])
def test_an_automatic_exposure_is_followed(step, stated):
    """Two steps, that of the gain with the second; stated by the camera or not."""
    film = Film(10)
    receiver = film.receiver()
    results = []
    for index in range(14):
        exposure = EXPOSURE * (1 + step) ** ((index >= 4) + (index >= 7))
        gain = 1.0 if index < 7 else 1 / (1 + step)
        told = {"exposure": exposure, "gain": gain} if stated else {}
        results.append(receiver.push(film.frame(index * FRAME_TIME, exposure, gain), **told))
        assert results[-1].outcome == "received"
        assert results[-1].exposure == pytest.approx(exposure, rel=0.01)
        assert results[-1].flags == 0
    assert frames_until_payload(results) <= 13


def test_chips_of_a_line_code_are_not_read_as_others_of_a_shorter_exposure():
    """Manchester chips exposed for five chips look like others that are exposed for one, without a preamble."""
    for seed in range(4):
        film = Film(seed)
        receiver = film.receiver(exposure=None)
        results = [receiver.push(film.frame(index * FRAME_TIME)) for index in range(14)]
        assert frames_until_payload(results) <= 13
        for result in results:
            assert result.exposure == pytest.approx(EXPOSURE, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_means_of_neighbours_between_frames_raise_nothing(seed):
    """A film of 30 frames/s made one of 60: frames that seem to be given twice set the clock back."""
    film = Film(seed)
    frames = [film.frame(index * FRAME_TIME) for index in range(21)]
    between = [(a + b) / 2 for a, b in itertools.pairwise(frames)]
    receiver = film.receiver(frame_time=FRAME_TIME / 2)
    for pixels in itertools.chain.from_iterable(zip(frames, between, strict=False)):
        payload = receiver.push(pixels).payload
        assert payload is None or payload.data == PAYLOAD
