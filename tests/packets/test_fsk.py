"""CM-FSK: one tone a frame, against the reference, against theory, and payloads through it."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import ocisac_fast as ocisac
from ocisac_fast import Camera, Flag, reference
from ocisac_fast.packets import PacketFormat
from ocisac_fast.packets.fsk import fsk_demodulate, fsk_symbol_error_rate, fsk_transmit
from ocisac_fast.receiver.fsk import FskReceiver

ROW_TIME, ROWS, FRAME_TIME = 22.2e-6, 1080, 1 / 30
SPACING = 1 / (ROWS * ROW_TIME)


def tones_of(count, first=20, step=4):
    return [SPACING * (first + step * k) for k in range(count)]


@given(
    st.integers(0, 2**32 - 1), st.sampled_from([2, 4, 16]), st.sampled_from([64, 97, 720, 1080]), st.floats(0.02, 2.0)
)
@settings(max_examples=2 * settings.default.max_examples // 5)
def test_agrees_with_the_reference(seed, count, rows, noise):
    random = np.random.default_rng(seed)
    camera = Camera(ROW_TIME, random.choice([None, 300e-6]))
    tones = np.sort(random.uniform(1.2, rows / 2.5, count)) / (rows * ROW_TIME)
    sent = int(random.integers(count))
    column = 50 + np.linspace(0, 9, rows) + noise * random.standard_normal(rows)
    column += np.cos(2 * np.pi * tones[sent] * ROW_TIME * np.arange(rows) + random.uniform(0, 6))
    amplitude = None if seed % 2 else 1.0
    got = fsk_demodulate(column, camera, tones, amplitude=amplitude)
    symbol, log_likelihoods = reference.fsk_demodulate(column, camera, tones, amplitude=amplitude)
    assert got.symbol == symbol
    np.testing.assert_allclose(got.log_likelihoods, log_likelihoods, rtol=1e-6, atol=1e-5)
    for bit, llr in enumerate(got.llr):
        ones = [(index >> (len(got.llr) - 1 - bit)) & 1 == 1 for index in range(count)]
        expected = log_likelihoods[ones].max() - log_likelihoods[np.logical_not(ones)].max()
        assert llr == pytest.approx(expected, rel=1e-6, abs=1e-5)


@pytest.mark.parametrize("count", [4, 8])
def test_every_frame_of_a_transmission_gives_its_symbol(count):
    tones = tones_of(count)
    sent = fsk_transmit(b"tone", tones, number=3)
    chips = len(ocisac.transmit(b"tone", format=PacketFormat(line_code="none", block_bytes=4)).chips)
    assert len(sent.symbols) * math.log2(count) % chips == 0
    camera = Camera(ROW_TIME, 622e-6, frame_time=FRAME_TIME)
    light = sent.waveform(FRAME_TIME, start=-0.2 * FRAME_TIME)
    random = np.random.default_rng(1)
    for index in range(60):
        rows = ocisac.integrate_exposure(light, camera, ROWS, start=index * FRAME_TIME)
        got = fsk_demodulate(20 + 80 * rows + 4 * random.standard_normal(ROWS), camera, tones)
        assert got.symbol == sent.symbols[index % len(sent.symbols)]


def tone_rows(random, tone, noise):
    turns = tone * ROW_TIME * np.arange(ROWS) + random.uniform()
    return 60 + np.linspace(0, 20, ROWS) + 20 * np.cos(2 * np.pi * turns) + noise * random.standard_normal(ROWS)


@pytest.mark.parametrize(("count", "noise", "most"), [(2, 60.0, 560), (4, 30.0, 260), (16, 30.0, 160)])
def test_payloads_come_through_noise_missing_repeated_and_dark_frames(count, noise, most):
    """Symbols alone tell nothing of a packet: preamble and header lie across 8 to 30 frames."""
    random, tones = np.random.default_rng(count), tones_of(count)
    sent = fsk_transmit(b"tone", tones, number=3)
    receiver, payloads = FskReceiver(Camera(ROW_TIME), tones), []
    for index in range(most):
        symbol = sent.symbols[(index + 300) % len(sent.symbols)]
        if index % 61 == 5:
            continue
        dark = index % 83 == 40
        rows = 60 + noise * random.standard_normal(ROWS) if dark else tone_rows(random, tones[symbol], noise)
        result = receiver.push(rows, number=index)
        assert result.missing == (index % 61 == 6)
        assert result.outcome == "received" or dark or Flag.NO_SIGNAL in result.flags
        if index % 50 == 9:
            assert receiver.push(rows, number=index).outcome == "repeated"
        if result.payload is not None:
            payloads.append((result.payload.data, result.payload.number))
    assert payloads
    assert set(payloads) == {(b"tone", 3)}
    assert receiver.push(np.full(ROWS, np.nan)).outcome == "not_finite"
    assert receiver.push(rows[:-1]).outcome == "other_shape"


def beside_other_light(other, depth, seed):
    random, tones, camera = np.random.default_rng(seed), [1000.0, 1200.0, 1400.0, 1600.0], Camera(20e-6, 100e-6)
    symbol = int(random.integers(4))
    light = 1 + depth * np.cos(2 * np.pi * (tones[symbol] * camera.row_time * np.arange(700) + random.uniform()))
    if other == "lamp":
        wave = ocisac.SquareWave(random.uniform(250, 900), phase=random.uniform(0, 6))
        light += 0.5 * ocisac.integrate_exposure(wave, camera, 700)
    elif other == "texture":
        light *= 1 + 0.3 * np.convolve(random.standard_normal(700), np.full(25, 0.2), "same")
    column = 80 * light + 0.5 * random.standard_normal(700)
    return symbol, FskReceiver(camera, tones).push(column[:, np.newaxis].astype(np.float32))


@pytest.mark.parametrize("other", ["nothing", "lamp", "texture"])
def test_errors_beside_other_light_are_predicted(other):
    """A harmonic of a PWM lamp or a texture may look like another tone: the residual is no white noise."""
    for depth in (0.5, 0.1, 0.03):
        wrong, predicted, received = 0, 0.0, 0
        for seed in range(60):
            symbol, found = beside_other_light(other, depth, seed)
            if found.symbol is None:
                continue
            is_wrong = found.symbol.symbol != symbol
            assert not is_wrong or np.abs(found.symbol.llr).min() < 8
            wrong, predicted, received = wrong + is_wrong, predicted + found.symbol.error_rate, received + 1
        assert wrong <= predicted + 3 * math.sqrt(predicted)
        assert received == 60 or (other != "nothing" and depth < 0.5)


def test_another_packet_of_tones_follows_the_first():
    random, tones, got = np.random.default_rng(1), tones_of(4), []
    receiver = FskReceiver(Camera(ROW_TIME), tones)
    for number, payload in enumerate((b"first", b"second!")):
        sent = fsk_transmit(payload, tones, number=number)
        for index in range(300):
            result = receiver.push(tone_rows(random, tones[sent.symbols[index]], 10.0))
            got += [] if result.payload is None else [result.payload.data]
    assert list(dict.fromkeys(got)) == [b"first", b"second!"]


def test_tones_by_files_and_commands(tmp_path, run, facts):
    tones = "1kHz,1.2kHz,1.4kHz,1.7kHz"
    (sent,) = facts("transmit", "--text", "by tones", "--fsk", tones)
    assert sent["tones_hz"] == [1000.0, 1200.0, 1400.0, 1700.0]
    assert sent["symbols"] == len(sent["sequence"])
    for name in ("s.txt", "s.npy", "s.csv", "s.h"):
        words = ("transmit", "--text", "by tones", "--fsk", tones, "--frame-rate", 30, "-o", tmp_path / name)
        assert run(*words)[0] == 0
    assert (tmp_path / "s.txt").read_text().split() == list(map(str, sent["sequence"]))
    assert np.load(tmp_path / "s.npy").tolist() == sent["sequence"]
    lines = (tmp_path / "s.csv").read_text().splitlines()
    assert lines[:2] == ["time_s,tone_hz", f"0.0,{sent['tones_hz'][sent['sequence'][0]]}"]
    assert "ocisac_tones_hz[4] = {1000.0, 1200.0, 1400.0, 1700.0}" in (tmp_path / "s.h").read_text()

    random = np.random.default_rng(2)
    columns = [tone_rows(random, sent["tones_hz"][symbol], 10.0) for symbol in sent["sequence"][:200]]
    np.save(tmp_path / "frames.npy", np.rint(columns).astype(np.uint8)[:, :, np.newaxis])
    command = ("receive", tmp_path / "frames.npy", "--fsk", tones, "--row-time", "22.2us", "--frame-rate", 30)
    found = [json.loads(line) for line in run(*command, "--json")[1]]
    assert [fact["symbol"] for fact in found] == sent["sequence"][:200]
    assert found[7]["tone_hz"] == sent["tones_hz"][sent["sequence"][7]]
    assert {fact["payload"] for fact in found if "payload" in fact} == {"by tones"}
    code, out, _ = run(*command)
    assert code == 0
    assert "by tones" in " ".join(out)
    assert "--fsk: Hz needs --row-time" in run("receive", "x.npy", "--fsk", tones)[2][-1]
    for words, message in [
        (("--fsk", tones, "--chip-rate", "8kHz"), "--fsk: has no line code and no chip rate"),
        (("--frame-rate", "30"), "--frame-rate: only with --fsk"),
        (("--fsk", "1kHz"), "tones: got 1 tones"),
        (("--fsk", "1kHz,x"), "got 'x', allowed: a number"),
    ]:
        code, _, (line,) = run("transmit", "--text", "a", *words)
        assert code == 2
        assert message in line


@pytest.mark.parametrize("count", [2, 4, 16])
def test_the_error_rate_is_the_binomial_sum(count):
    for snr in (0.0, 0.5, 3.0, 10.0, 20.0):
        assert fsk_symbol_error_rate(count, snr) == pytest.approx(
            reference.fsk_symbol_error_rate(count, snr), rel=1e-4, abs=1e-12
        )
    assert fsk_symbol_error_rate(256, 0.0) == pytest.approx(255 / 256, rel=1e-4)
    assert 0 < fsk_symbol_error_rate(256, 60.0) < 1e-10


def test_a_column_without_light_tells_nothing():
    got = fsk_demodulate(np.full(ROWS, 7.0), Camera(ROW_TIME), tones_of(4))
    assert got.snr == 0.0
    assert np.isfinite(got.log_likelihoods).all()
