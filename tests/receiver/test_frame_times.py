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

    def receiver(self, frame_time=FRAME_TIME, exposure=EXPOSURE, row_time=ROW_TIME):
        return Receiver(Camera(row_time, exposure, frame_time=frame_time), chip_rate=CHIP_RATE, format=self.format)


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


@pytest.mark.parametrize(
    ("chip_rate", "digits", "drop"), [(8011, 3, 0.0), (6011, 4, 0.0), (9000, 3, 0.0), (14987, 3, 0.0), (8011, 3, 0.1)]
)
def test_rounded_time_stamps_lose_no_payloads(chip_rate, digits, drop):
    """To milliseconds, in which 9000 and 14987 chips/s have whole numbers of chips; some frames may be dropped."""
    random = np.random.default_rng(1)
    waveform = ocisac.transmit(random.bytes(12)).waveform(chip_rate)
    receivers = [Receiver(Camera(ROW_TIME, 1e-4, frame_time=FRAME_TIME), chip_rate=chip_rate) for _ in range(2)]
    payloads = [0, 0]
    for number in range(150):
        light = ocisac.integrate_exposure(waveform, Camera(ROW_TIME, 1e-4), 600, start=0.03 + number * FRAME_TIME)
        signal = 20 + 60 * light + 0.2 * random.standard_normal(600)
        if random.random() < drop:
            continue
        stamped = receivers[0].push(signal, time=round(number * FRAME_TIME, digits))
        payloads[0] += stamped.payload is not None
        payloads[1] += receivers[1].push(signal, number=number).payload is not None
    assert payloads[1] > 15
    assert payloads[0] > 0.8 * payloads[1]


@pytest.mark.parametrize("wrong", [1e-3, -3e-3, 1e-2])
def test_exact_time_stamps_hold_where_the_frame_time_given_is_wrong(wrong):
    film = Film(7)
    receiver = film.receiver(frame_time=(1 + wrong) * FRAME_TIME)
    times = FRAME_TIME * np.arange(160)
    payloads = sum(receiver.push(film.frame(time), time=time).payload is not None for time in times)
    assert payloads >= 8


def test_frames_given_twice_and_left_out_are_no_loss_without_numbers():
    film = Film(6)
    receiver = film.receiver()
    kept = [index for index in range(60) for _ in range(1 + (index % 3 == 0)) if index % 7]
    frames = {index: film.frame(index * FRAME_TIME) for index in set(kept)}
    results = [receiver.push(frames[index]) for index in kept]
    assert frames_until_payload(results) <= 22
    repeated = [now == before for before, now in itertools.pairwise(kept)]
    assert [result.stretch.outcome == "repeated" for result in results[1:]] == repeated


@pytest.mark.parametrize("lost", [200, 300, 400])
def test_rows_of_the_frame_before_in_place_of_a_lost_slice_are_not_read(lost):
    """A decoder puts them there: chips of another time. Half of the frames; all bits fit without them."""
    for seed in range(3):
        film, shown = Film(seed), None
        receiver = film.receiver()

        def push(frame, film=film, receiver=receiver):
            nonlocal shown
            rows = film.frame(frame * FRAME_TIME)
            if shown is not None and film.random.random() < 0.5:
                first = film.random.integers(0, 1080 - lost)
                rows[first : first + lost] = shown[first : first + lost]
            shown = rows
            result = receiver.push(rows)
            assert result.flags == 0
            assert result.error_rate < 1e-6
            return result

        assert frames_until_payload(push(frame) for frame in range(24)) <= 24


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


@pytest.mark.parametrize("seed", [*range(3), 9, 40])
def test_means_of_neighbours_between_frames_raise_nothing(seed):
    """A film of 30 frames/s made one of 60: frames that seem to be given twice set the clock back, and a share of the
    frame before is seen beside what looks like a pause of the read-out."""
    film = Film(seed)
    frames = [film.frame(index * FRAME_TIME) for index in range(21)]
    between = [(a + b) / 2 for a, b in itertools.pairwise(frames)]
    receiver = film.receiver(frame_time=FRAME_TIME / 2)
    for pixels in itertools.chain.from_iterable(zip(frames, between, strict=False)):
        payload = receiver.push(pixels).payload
        assert payload is None or payload.data == PAYLOAD


@pytest.mark.parametrize(
    ("packet", "told", "most"),
    [({"block_bytes": n}, {"frame_time": k * FRAME_TIME}, 18) for n in (8, 16) for k in (0.75, 0.8, 0.95, 1.05, 1.25)]
    + [({}, {"row_time": k * ROW_TIME}, 20) for k in (0.95, 0.98, 1.02, 1.05)],
)
def test_a_wrong_frame_or_row_time_is_learned_from_headers_and_preambles(packet, told, most):
    for seed in range(3):
        film = Film(seed, **packet)
        receiver = film.receiver(**told)
        results = (receiver.push(film.frame(index * FRAME_TIME)) for index in itertools.count())
        assert frames_until_payload(results) <= most


@pytest.mark.parametrize(("late", "block_bytes", "most"), [(0.1, 8, 18), (0.5, 4, 18)])
def test_frames_of_varying_times_are_placed_by_headers(late, block_bytes, most):
    for seed in range(3):
        film = Film(seed, block_bytes=block_bytes)
        receiver = film.receiver()
        times = np.cumsum(FRAME_TIME * film.random.uniform(1, 1 + late, 40))
        assert frames_until_payload(receiver.push(film.frame(time)) for time in times) <= most


@pytest.mark.parametrize("numbered", [False, True])
def test_frames_that_are_all_given_twice_take_half_the_frame_time(numbered):
    film = Film(4)
    receiver = film.receiver(frame_time=FRAME_TIME / 2)
    frames = (pixels for index in itertools.count() for pixels in [film.frame(index * FRAME_TIME)] * 2)
    results = (receiver.push(pixels, number=k if numbered else None) for k, pixels in enumerate(frames))
    assert frames_until_payload(results) <= 30


@pytest.mark.parametrize(
    ("pause", "shown", "most"),
    [*((pause, shown, 14) for pause in (1, 10) for shown in ("dark", "bright", "toggling")), (100, "toggling", 22)],
)
def test_pauses_of_the_sender_between_blocks_are_learned(pause, shown, most):
    film = Film(7)
    blocks = ocisac.transmit(PAYLOAD, format=film.format).chips.reshape(-1, 302)
    between = {"dark": np.zeros(pause), "bright": np.ones(pause), "toggling": np.arange(pause) % 2}[shown]
    film.waveform = ocisac.Chips(
        np.concatenate([np.append(block, between) for block in blocks]), CHIP_RATE, repeat=True
    )
    receiver = film.receiver()
    results = (receiver.push(film.frame(index * FRAME_TIME)) for index in itertools.count())
    assert frames_until_payload(results) <= most


@pytest.mark.parametrize("line_code", ["manchester", "4b6b", "8b10b"])
def test_an_inverted_light_is_read_and_said_to_be(line_code):
    film = Film(9, line_code=line_code)
    receiver = film.receiver()
    results = [receiver.push(140 - film.frame(index * FRAME_TIME)) for index in range(15)]
    assert frames_until_payload(results) <= 14
    assert results[-1].stretch.inverted
    assert results[-1].stretch.lack == "none"
    assert all(result.outcome == "received" for result in results)


@pytest.mark.parametrize("first", [2**53, 2**60, -(2**62)])
def test_frames_are_counted_by_any_numbers(first):
    film, receiver = Film(3), Film(3).receiver()
    frames = (receiver.push(film.frame(k * FRAME_TIME), number=first + k) for k in range(20))
    assert frames_until_payload(frames) <= 12


@pytest.mark.parametrize("jump", [10**k for k in (6, 12, 14, 16)])
@pytest.mark.parametrize("stamped", [False, True])
def test_a_pause_of_more_chips_than_are_counted_is_a_new_start(jump, stamped):
    """A damaged counter, or time stamps in ns taken for numbers: the call once never returned from 2^53 chips on."""
    film = Film(10)
    receiver = film.receiver()

    def received(index):
        late = index + (jump if index > 4 else 0)
        return receiver.push(film.frame(index * FRAME_TIME), **({"time": float(late)} if stamped else {"number": late}))

    assert frames_until_payload(map(received, itertools.count())) <= 30
