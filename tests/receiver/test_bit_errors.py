"""Bits compared with the sent ones: alignment, slips, intervals, and the chance of unrelated bits."""

from __future__ import annotations

import numpy as np
import pytest

from ocisac_fast import Camera, Chips, Flag, compare_bits, integrate_exposure, receive
from ocisac_fast.receiver.bit_errors import _clopper_pearson


def text(bits) -> str:
    return "".join(map(str, np.asarray(bits).astype(int)))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("repeat", [False, True])
@pytest.mark.parametrize("inverted", [False, True])
def test_errors_are_counted_wherever_the_bits_begin(seed, repeat, inverted):
    random = np.random.default_rng(seed)
    sent = random.integers(0, 2, 500)
    shift = int(random.integers(0, 200))
    wrong = random.random(300) < 0.1
    found = compare_bits(text(sent[shift : shift + 300] ^ wrong ^ inverted), sent, repeat=repeat)
    assert (found.errors, found.compared, found.inserted) == (wrong.sum(), 300, 0)
    assert (found.shift, found.inverted, found.flags) == (shift, inverted, Flag(0))
    assert found.missing == (0 if repeat else 200)
    assert found.low < found.rate < found.high
    assert found.chance < 1e-20


def test_a_repeated_message_is_found_over_its_end():
    sent = np.random.default_rng(5).integers(0, 2, 100)
    found = compare_bits(text(np.tile(sent, 4)[70:330]), text(sent), repeat=True)
    assert (found.errors, found.compared, found.missing, found.shift) == (0, 260, 0, 70)


@pytest.mark.parametrize("repeat", [False, True])
@pytest.mark.parametrize(("missing", "inserted"), [(2, 0), (0, 3), (1, 1), (0, 0)])
def test_bits_that_slip_are_found(missing, inserted, repeat):
    random = np.random.default_rng(3)
    sent = random.integers(0, 2, 900)
    bits = sent[:800] ^ (random.random(800) < 0.03)
    bits = np.insert(np.delete(bits, np.arange(250, 250 + missing)), 500, random.integers(0, 2, inserted))
    found = compare_bits(text(bits), sent, repeat=repeat)
    assert found.missing == missing + (0 if repeat else 100)
    assert found.inserted == inserted
    assert found.errors == pytest.approx(24, abs=12)
    assert found.shift == 0


def test_many_errors_are_no_slips():
    """At a rate of 40 % the second search explains nothing away."""
    random = np.random.default_rng(8)
    rates = []
    for _ in range(5):
        sent = random.integers(0, 2, 4000)
        found = compare_bits(text(sent ^ (random.random(4000) < 0.4)), sent)
        assert found.compared >= 3990
        rates.append(found.rate)
    assert np.mean(rates) == pytest.approx(0.4, abs=0.01)


def test_unrelated_bits_are_flagged_and_half_wrong_less_what_the_search_explains():
    random = np.random.default_rng(9)
    pairs = [(text(random.integers(0, 2, 300)), random.integers(0, 2, 200)) for _ in range(400)]
    found = [compare_bits(*pair, repeat=True) for pair in pairs]
    flagged = np.mean([bool(one.flags & Flag.NO_SIGNAL) for one in found])
    assert flagged > 0.97  # 1 % is the share that may escape
    largest = np.mean(np.abs(random.standard_normal((4000, 200))).max(axis=1))  # of as many shifts, over the deviation
    assert np.mean([one.rate for one in found]) == pytest.approx(0.5 - 0.5 * largest / np.sqrt(300), abs=0.004)
    assert all(one.missing == one.inserted == 0 for one in found if one.flags)


def test_the_chance_is_a_probability():
    random = np.random.default_rng(10)
    pairs = [(text(random.integers(0, 2, 60)), random.integers(0, 2, 40)) for _ in range(2000)]
    chances = [compare_bits(*pair, repeat=True).chance for pair in pairs]
    for share in (0.02, 0.1):
        assert np.mean(np.array(chances) <= share) <= 1.3 * share


@pytest.mark.parametrize(("errors", "count"), [(0, 1), (0, 100), (3, 100), (50, 100), (100, 100), (405, 20000)])
def test_intervals_are_those_of_clopper_and_pearson(errors, count):
    interval = pytest.importorskip("scipy.stats").binomtest(errors, count).proportion_ci(0.95, "exact")
    assert _clopper_pearson(errors, count) == pytest.approx((interval.low, interval.high), abs=1e-12)


def test_frames_of_a_light_are_added_up():
    sent = np.random.default_rng(2).integers(0, 2, 200)
    camera = Camera(1e-5, exposure=3e-5, frame_time=0.01)
    rows = integrate_exposure(Chips(sent, 2e4, repeat=True), camera, 700)
    frames = np.stack([100.0 * rows[:, None] * np.ones(8) + 10.0] * 2)
    received = receive(frames, camera, chip_rate=2e4)
    one, both = (compare_bits(what, sent, repeat=True) for what in (received[0], received))
    assert (both.errors, both.compared) == (0, 2 * one.compared)
    assert one.compared > 100
    nothing = compare_bits("", sent)
    assert (nothing.compared, nothing.missing, nothing.flags) == (0, 200, Flag.NO_SIGNAL)
    assert np.isnan(nothing.rate)


def test_the_command_prints_errors(tmp_path, run, facts):
    sent = np.random.default_rng(2).integers(0, 2, 200)
    rows = integrate_exposure(Chips(sent, 2e4, repeat=True), Camera(1e-5, exposure=3e-5), 700)
    np.save(tmp_path / "frame.npy", 100.0 * rows[:, None] * np.ones(4) + 10.0)
    (tmp_path / "sent.txt").write_text(text(sent) + "\n")
    np.save(tmp_path / "other.npy", 1 - sent)
    command = ("receive", tmp_path / "frame.npy", "--row-time", "10us", "--chip-rate", "20kHz", "--scan-axis", "y")
    code, out, _ = run(*command, "--sent", tmp_path / "sent.txt")
    assert code == 0
    assert "0 of " in " ".join(out)
    (found,) = facts(*command, "--sent", tmp_path / "other.npy")
    assert (found["errors"], found["inverted"]) == (0, True)
    code, _, err = run(*command, "--sent", tmp_path / "frame.npy")
    assert code == 2
    assert "--sent: got" in err[-1]
