"""The whole link: what is delivered is what was sent, what is not is told, and a mild channel delivers."""

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

import ocisac_fast as ocisac
from ocisac_fast import Camera
from ocisac_fast.packets import PacketFormat
from ocisac_fast.receiver.stream import Receiver

ROW_TIME, ROWS, FRAME_ROWS = 20e-6, 700, 1100.3
OUTCOMES = {"received", "no_signal", "not_finite", "repeated", "other_shape", "unsearched"}
KINDS = ("missing", "repeated", "nan", "dark", "noise", "short", "spliced")


class Channel:
    """Rows of a packet's light through a gradient and noise; frames may be damaged in any of KINDS."""

    def __init__(self, sent, rows_per_chip, exposure, noise, seed):
        self.random = np.random.default_rng(seed)
        self.camera = Camera(ROW_TIME, exposure * rows_per_chip * ROW_TIME, frame_time=FRAME_ROWS * ROW_TIME)
        self.chip_rate = 1.0 / (rows_per_chip * ROW_TIME)
        self.waveform = sent.waveform(self.chip_rate)
        self.noise, self.start = noise, self.random.uniform(0.0, 1.0)

    def frame(self, index):
        start = self.start + index * self.camera.frame_time
        light = ocisac.integrate_exposure(self.waveform, self.camera, ROWS, start=start)
        return 20.0 + 80.0 * np.linspace(1.0, 0.7, ROWS) * (light + self.noise * self.random.standard_normal(ROWS))

    def damaged(self, index, kind):
        rows = self.frame(index)
        if kind == "nan":
            rows[index % ROWS] = np.nan
        elif kind in ("dark", "noise"):
            rows = 20.0 + (kind == "noise") * self.random.standard_normal(ROWS)
        elif kind == "short":
            rows = rows[: ROWS // 2]
        elif kind == "spliced":
            rows[ROWS // 2 :] = self.frame(index + 3)[ROWS // 2 :]
        return rows


PREAMBLE_CHIPS, HEADER_BYTES = 14, 2


def shows_every_digit(channel, sent, frames):
    """True if the frames show headers of all four kinds, which hold a digit of the payload's length each.

    Frames that stay in step with the blocks show the same kinds over and over.
    """
    chips_per_byte = (sent.block_chips - PREAMBLE_CHIPS) // (HEADER_BYTES + sent.format.block_bytes)
    head = PREAMBLE_CHIPS + HEADER_BYTES * chips_per_byte
    seen = set()
    for index in range(frames):
        first = (channel.start + index * channel.camera.frame_time) * channel.chip_rate + 5
        last = first + ROWS * ROW_TIME * channel.chip_rate - 10 - head
        blocks = range(int(np.ceil(first / sent.block_chips)), int(last // sent.block_chips) + 1)
        seen |= {block % sent.blocks % 4 for block in blocks}
    return len(seen) == 4


def receive(channel, receiver, frames, faults):
    """Payloads, each frame's result looked at; `faults`: by the frame's number."""
    payloads, missing = [], 0
    for index in range(frames):
        kind = faults.get(index)
        if kind == "missing":
            missing += 1
            continue
        result = receiver.push(channel.damaged(index, kind), number=index)
        assert result.outcome in OUTCOMES
        assert (result.outcome == "not_finite") == (kind == "nan")
        assert kind != "short" or result.outcome == "other_shape" or index == 0
        assert (result.stretch is None) == (result.outcome != "received")
        assert bool(result.bits) == (result.outcome == "received")
        if result.outcome == "other_shape":
            missing += 1
        else:
            assert result.missing == missing
            missing = 0
        payloads += [] if result.payload is None else [result.payload]
        if kind == "repeated":
            again = receiver.push(channel.frame(index), number=index)
            assert (again.outcome, again.payload) == ("repeated", None)
    return payloads


@given(
    payload=st.binary(max_size=200),
    line_code=st.sampled_from(["none", "manchester", "4b6b", "8b10b"]),
    rows_per_chip=st.floats(2.2, 8.0),
    exposure=st.floats(0.2, 4.0),
    noise=st.floats(0.0, 0.3),
    rate_error=st.floats(-0.01, 0.01),
    faults=st.dictionaries(st.integers(1, 9), st.sampled_from(KINDS), max_size=4),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=3 * settings.default.max_examples // 25, deadline=None)
def test_what_is_delivered_is_what_was_sent(
    payload, line_code, rows_per_chip, exposure, noise, rate_error, faults, seed
):
    packets = PacketFormat(line_code=line_code)
    if not payload:
        with pytest.raises(ValueError, match="payload: got 0 bytes, allowed: 1 to"):
            ocisac.transmit(payload, format=packets)
        return
    sent = ocisac.transmit(payload, format=packets, number=seed % 256)
    channel = Channel(sent, rows_per_chip, exposure, noise, seed)
    receiver = Receiver(channel.camera, chip_rate=channel.chip_rate * (1.0 + rate_error), format=packets)
    for got in receive(channel, receiver, 10, faults):
        assert (got.data, got.number) == (payload, seed % 256)


@given(
    payload=st.binary(min_size=1, max_size=20),
    line_code=st.sampled_from(["manchester", "4b6b", "8b10b"]),
    rows_per_chip=st.floats(2.2, 3.5),
    exposure=st.floats(0.4, 2.5),
    noise=st.floats(0.0, 0.02),
    rate_error=st.floats(-0.01, 0.01),
    faults=st.dictionaries(st.integers(2, 20), st.sampled_from(KINDS), max_size=3),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=2 * settings.default.max_examples // 25, deadline=None)
def test_a_mild_channel_delivers(payload, line_code, rows_per_chip, exposure, noise, rate_error, faults, seed):
    packets = PacketFormat(line_code=line_code, block_bytes=6)
    sent = ocisac.transmit(payload, format=packets, number=seed % 256)
    channel = Channel(sent, rows_per_chip, exposure, noise, seed)
    assume(shows_every_digit(channel, sent, 20))
    receiver = Receiver(channel.camera, chip_rate=channel.chip_rate * (1.0 + rate_error), format=packets)
    payloads = receive(channel, receiver, 40, faults)
    assert payloads
    assert {(got.data, got.number) for got in payloads} == {(payload, seed % 256)}
