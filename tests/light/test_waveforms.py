"""Waveforms and exposure integration: against NumPy, exact fractions and numerical quadrature."""

from __future__ import annotations

import pickle
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ocisac_fast import (
    Camera,
    Chips,
    Constant,
    Product,
    Samples,
    SquareWave,
    Sum,
    Tone,
    TriangleWave,
    Waveform,
    integrate_exposure,
    reference,
    sample_waveform,
)

LEVELS = st.floats(-3, 3)
RATES = st.floats(1, 2e4)
STARTS = st.floats(-0.1, 0.1)
PHASES = st.floats(-20, 20)
TONES = st.builds(Tone, frequency=st.just(0.0) | RATES, amplitude=LEVELS, phase=PHASES, depth=st.floats(0, 1))
SQUARES = st.builds(
    SquareWave, frequency=st.just(0.0) | RATES, duty=st.floats(0.01, 0.99), amplitude=LEVELS, phase=PHASES
)
TRIANGLES = st.builds(
    TriangleWave, frequency=st.just(0.0) | RATES, amplitude=LEVELS, phase=PHASES, depth=st.floats(0, 1)
)
LISTS = st.lists(LEVELS, min_size=1, max_size=30)
CHIPS = st.builds(Chips, levels=LISTS, chip_rate=RATES, start=STARTS, repeat=st.booleans(), amplitude=LEVELS)
TIMES = st.just(0.0) | st.floats(0.01, 20)
SLOW_CHIPS = st.builds(Chips, levels=LISTS, chip_rate=RATES, start=STARTS, repeat=st.booleans(), rise=TIMES, fall=TIMES)
SAMPLES = st.builds(Samples, values=LISTS, sample_rate=RATES, start=STARTS, repeat=st.booleans())
CONSTANTS = st.builds(Constant, LEVELS)
EXPOSURES = st.just(0.0) | st.floats(1e-6, 1e-2) | st.floats(0.01, 0.5)


def near_an_edge(waveform, camera, rows, start, frames):
    """Point samples so near an edge that long double may put them on its other side."""
    before, after = (
        reference.integrate_exposure(waveform, camera, rows, start + shift, frames) for shift in (-1e-12, 1e-12)
    )
    return np.abs(before - after) > 1e-5


@settings(max_examples=settings.default.max_examples // 2, deadline=None)
@given(
    parts=st.lists(TONES | SQUARES | TRIANGLES | CHIPS | SLOW_CHIPS | SAMPLES | CONSTANTS, min_size=1, max_size=3),
    exposure=EXPOSURES,
    start=st.floats(-1, 1),
    length=st.sampled_from([1, 2, 31, 720, 1080, 4352]),
    order=st.sampled_from([1, 3, 1000]) | st.integers(0, 2**32 - 1).map(np.random.default_rng),
    frames=st.none() | st.integers(1, 3),
)
def test_agrees_with_the_reference(parts, exposure, start, length, order, frames):
    """Rows are as far apart as ``order``, or in a random order."""
    camera = Camera(22.2e-6, exposure, 1 / 30)
    rows = np.arange(length) - length // 3
    rows = rows * order if isinstance(order, int) else order.permutation(rows)
    waveform = Sum(parts)
    got = integrate_exposure(waveform, camera, rows, start=start, frames=frames)
    assert got.shape == ((length,) if frames is None else (frames, length))
    want = reference.integrate_exposure(waveform, camera, rows, start, frames)
    wrong = np.abs(got - want) > 1e-12
    if exposure == 0 and wrong.any():
        wrong &= ~near_an_edge(waveform, camera, rows, start, frames)
    assert not wrong.any(), (got[wrong], want[wrong])


SLOW = st.floats(1, 2e3)
FACTORS = (
    st.builds(Tone, frequency=st.just(0.0) | SLOW, amplitude=LEVELS, phase=PHASES, depth=st.floats(0, 1))
    | st.builds(SquareWave, frequency=st.just(0.0) | SLOW, duty=st.floats(0.01, 0.99), phase=PHASES)
    | st.builds(Chips, levels=LISTS, chip_rate=SLOW, start=STARTS, repeat=st.booleans())
    | CONSTANTS
)


@settings(max_examples=settings.default.max_examples // 2, deadline=None)
@given(
    factors=st.lists(FACTORS | st.builds(lambda a, b: a + b, FACTORS, FACTORS), min_size=1, max_size=3),
    sampled=st.none()
    | st.builds(TriangleWave, frequency=st.just(0.0) | SLOW, phase=PHASES)
    | st.builds(Samples, values=LISTS, sample_rate=SLOW, start=STARTS, repeat=st.booleans()),
    exposure=st.just(0.0) | st.floats(1e-6, 1e-2) | st.floats(0.01, 0.05),
    start=st.floats(-1, 1),
    length=st.sampled_from([1, 2, 31]),
    frames=st.none() | st.just(2),
)
def test_products_agree_with_quadrature(factors, sampled, exposure, start, length, frames):
    """The reference integrates products by Gauss-Legendre nodes between the edges."""
    camera = Camera(22.2e-6, exposure, 1 / 30)
    rows = (np.arange(length) * 7919) % 1080 - 100
    waveform = Product([*factors, *([] if sampled is None else [sampled])])
    got = integrate_exposure(waveform, camera, rows, start=start, frames=frames)
    want = reference.integrate_exposure(waveform, camera, rows, start, frames)
    wrong = np.abs(got - want) > 1e-12 * max(1, np.abs(want).max())
    if exposure == 0 and wrong.any():
        wrong &= ~near_an_edge(waveform, camera, rows, start, frames)
    assert not wrong.any(), (got[wrong], want[wrong])


def test_a_triangle_wave_has_a_fundamental_of_8_over_pi_squared():
    times = np.arange(1000) / 1000 / 50.0
    wave, tone = (
        sample_waveform(kind(50.0, amplitude=2.0, phase=0.7, depth=0.6), times) for kind in (TriangleWave, Tone)
    )
    ratio = np.fft.rfft(wave)[1] / np.fft.rfft(tone)[1]
    assert ratio == pytest.approx(8 / np.pi**2, rel=1e-5)
    assert (wave.min(), wave.max()) == (pytest.approx(0.4, abs=1e-3), pytest.approx(1.6, abs=1e-3))
    assert wave.mean() == pytest.approx(1.0)


def test_a_product_of_tones_has_lines_at_sum_and_difference():
    """Light of f_c through a grating of f_x v: (1/2 + cos/2)(1/2 + cos/2)."""
    camera = Camera(1e-5, 622e-6)
    rows = np.arange(1000)
    middles = rows * 1e-5 - 311e-6
    want = np.full(1000, 0.25)
    for share, frequency in [(0.25, 500.0), (0.25, 200.0), (0.125, 700.0), (0.125, 300.0)]:
        want += share * np.sinc(frequency * 622e-6) * np.cos(2 * np.pi * frequency * middles)
    np.testing.assert_allclose(integrate_exposure(Tone(500.0) * Tone(200.0), camera, rows), want, rtol=0, atol=1e-14)
    squared = 0.375 + 0.5 * np.sinc(0.311) * np.cos(1000 * np.pi * middles)
    squared += 0.125 * np.sinc(0.622) * np.cos(2000 * np.pi * middles)
    np.testing.assert_allclose(integrate_exposure(Tone(500.0) * Tone(500.0), camera, rows), squared, rtol=0, atol=1e-14)


@pytest.mark.parametrize("exposure", [0.0, 1e-12, 1e-9, 22.2e-6, 0.0049])
@pytest.mark.parametrize(("start", "frame"), [(0.0, 0), (0.0, 100_000), (1e4, 3), (-1e4, 0)])
def test_products_stay_exact_however_late(exposure, start, frame):
    """On-off keying twice is on-off keying: of the chips of one rate the product is known chip by chip."""
    a, b = Chips("0110100111", 5e3 / 3, repeat=True), Chips("00111", 5e3 / 3, repeat=True, amplitude=2.0)
    both = Chips(np.array([0, 1, 1, 0, 1, 0, 0, 1, 1, 1]) * np.tile([0, 0, 2, 2, 2], 2), 5e3 / 3, repeat=True)
    camera = Camera(22.2e-6, exposure, 1 / 30)
    rows = [*range(0, 1080, 30), -5, 5000]
    got = integrate_exposure(a * b, camera, rows, start=start, frames=[frame])
    np.testing.assert_allclose(
        got, integrate_exposure(both, camera, rows, start=start, frames=[frame]), rtol=0, atol=1e-13
    )
    # sloped light through steady gratings, too
    ramp = Samples([0.2, 1.0, 0.1, 0.5], 7e3 / 9, repeat=True)
    steady = SquareWave(0.0, duty=0.4) * Tone(0.0)
    got = integrate_exposure(ramp * steady, camera, rows, start=start, frames=[frame])
    np.testing.assert_allclose(
        got, integrate_exposure(ramp, camera, rows, start=start, frames=[frame]), rtol=0, atol=1e-13
    )


def test_rows_of_a_product_far_apart():
    """Rows a day apart are integrated one by one."""
    camera = Camera(1e-3, 1e-3)
    rows = np.array([0, 86_400_000, 5])
    waveform = SquareWave(1e4, duty=0.3) * Tone(5.0)
    want = [integrate_exposure(waveform, camera, [row])[0] for row in rows]
    np.testing.assert_allclose(integrate_exposure(waveform, camera, rows), want, rtol=0, atol=1e-15)


def exact_instants(camera, rows, start, frame):
    return [
        Fraction(start) + frame * Fraction(camera.frame_time) + int(row) * Fraction(camera.row_time) for row in rows
    ]


def exact_square(wave, time, exposure):
    half, rate = Fraction(wave.duty) / 2, Fraction(wave.frequency)

    def antiderivative(cycles):
        whole = (cycles + Fraction(1, 2)).__floor__()
        return whole * 2 * half + min(max(cycles - whole, -half), half)

    if exposure == 0:
        cycles = rate * time
        return Fraction(wave.amplitude) * (abs(cycles - (cycles + Fraction(1, 2)).__floor__()) < half)
    light = antiderivative(rate * time) - antiderivative(rate * (time - exposure))
    return Fraction(wave.amplitude) * light / (rate * exposure)


def exact_cells(waveform, time, exposure):
    """Chips and samples, cell by cell."""
    is_chips = isinstance(waveform, Chips)
    rate = Fraction(waveform.chip_rate if is_chips else waveform.sample_rate)
    levels = [Fraction(level) for level in (waveform.levels if is_chips else waveform.values)]
    count = len(levels)

    def corner(k):
        if waveform.repeat:
            return levels[k % count]
        if is_chips:
            return levels[k] if 0 <= k < count else Fraction(0)
        return levels[min(max(k, 0), count - 1)]

    def light(k, first, last):  # of a part of cell k
        begin, end = (corner(k), corner(k)) if is_chips else (corner(k), corner(k + 1))
        return (last - first) * (begin + (end - begin) * (first + last) / 2)

    end = rate * (time - Fraction(waveform.start))
    scale = Fraction(waveform.amplitude if is_chips else 1)
    if exposure == 0:
        k = end.__floor__()
        return scale * (corner(k) if is_chips else corner(k) + (end - k) * (corner(k + 1) - corner(k)))
    begin = end - rate * exposure
    first, last = begin.__floor__(), end.__floor__()
    if first == last:
        return scale * light(last, begin - last, end - last) / (end - begin)
    total = light(first, begin - first, 1) + light(last, 0, end - last)
    rounds, rest = divmod(last - first - 1, count) if waveform.repeat else (0, last - first - 1)
    total += rounds * sum(levels) + sum(light(k, 0, 1) for k in range(first + 1, first + 1 + rest))
    return scale * total / (end - begin)


def exact_tone(tone, time, exposure):
    cycles = Fraction(tone.frequency) * (time - exposure / 2)
    swing = np.sinc(tone.frequency * float(exposure)) * np.cos(2 * np.pi * float(cycles - round(cycles)) + tone.phase)
    return tone.amplitude / 2 * (1 + tone.depth * swing)


def exact_mean(waveform, time, exposure):
    exact = {Tone: exact_tone, SquareWave: exact_square}.get(type(waveform), exact_cells)
    return float(exact(waveform, time, Fraction(exposure)))


EXACT = [
    SquareWave(333.3, duty=0.3),
    SquareWave(4950.0, duty=0.9, amplitude=2.0),
    SquareWave(1e6 / 3, duty=0.5),
    Chips("0110100111", 5e3 / 3),
    Chips([0.0, 0.1, 0.7, 1.0], 31.25e3, start=-0.3, repeat=True, amplitude=0.3),
    Samples([0.2, 1.0, 0.1, 0.5, 0.5], 7e3 / 9, start=0.01),
    Samples([0.2, 1.0, 0.1, 0.5, 0.5], 7e3 / 9, start=0.01, repeat=True),
]


TONES = [Tone(frequency, amplitude=2.0, phase=0.4, depth=0.8) for frequency in (0.0, 0.3, 4950.0, 2e5)]


@pytest.mark.parametrize("waveform", [*EXACT, *TONES], ids=repr)
@pytest.mark.parametrize("exposure", [0.0, 1e-12, 3e-7, 22.2e-6, 0.000622, 0.0049, 0.12])
@pytest.mark.parametrize(("start", "frame"), [(0.0, 0), (0.0, 100_000), (1e4, 3), (-1e4, 0)])
@pytest.mark.parametrize("rows", [[0, 1, 17, 1079, -5, 10**6, 100], range(-2, 40, 7)], ids=["mixed", "even"])
def test_is_exact_however_late(waveform, exposure, start, frame, rows):
    camera = Camera(22.2e-6, exposure, 1 / 30)
    got = integrate_exposure(waveform, camera, list(rows), start=start, frames=[frame])[0]
    want = [exact_mean(waveform, time, exposure) for time in exact_instants(camera, rows, start, frame)]
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-13)


HUGE = [Tone(333.3), Tone(15e3), SquareWave(333.3, duty=0.3), SquareWave(15e3, duty=0.5), EXACT[4], EXACT[6]]


@pytest.mark.parametrize("waveform", HUGE, ids=repr)
def test_row_numbers_may_be_huge(waveform):
    camera = Camera(22.2e-6, 0.0021, 1.0)  # 0.7 cycles and 31.5: with the pulses one cycle
    rows = 2**49 + np.arange(700)
    want = [exact_mean(waveform, time, camera.exposure) for time in exact_instants(camera, rows.tolist(), 0.0, 0)]
    np.testing.assert_allclose(integrate_exposure(waveform, camera, rows), want, rtol=0, atol=1e-12)


@pytest.mark.parametrize("exposure", [8e-12, 1e-9])
@pytest.mark.parametrize("waveform", EXACT, ids=repr)
def test_an_edge_cuts_a_tiny_exposure_late(waveform, exposure):
    """In all proportions, an hour after the start."""
    rate = next(
        getattr(waveform, name) for name in ("frequency", "chip_rate", "sample_rate") if hasattr(waveform, name)
    )
    edge = Fraction(getattr(waveform, "duty", 0)) / 2 + 10 * round(360 * rate)
    if getattr(waveform, "repeat", True) is False:
        edge = Fraction(1)
    camera = Camera(exposure / 8, exposure, 1.0)
    time = edge / Fraction(rate) + Fraction(getattr(waveform, "start", 0))
    first = round((time - Fraction(float(time))) / Fraction(camera.row_time))
    rows = np.arange(first - 4, first + 14)
    got = integrate_exposure(waveform, camera, rows, start=float(time))
    want = [exact_mean(waveform, t, exposure) for t in exact_instants(camera, rows, float(time), 0)]
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-13)


def test_a_square_wave_has_its_fundamental_in_phase_with_the_tone():
    times = np.arange(10_000) / 10_000
    for duty in (0.1, 0.5, 0.8):
        square = sample_waveform(SquareWave(3.0, duty=duty, phase=0.7), times)
        line = 2 * np.mean(square * np.exp(-6j * np.pi * times))
        assert np.angle(line) == pytest.approx(0.7, abs=2e-3)
        assert abs(line) / square.mean() == pytest.approx(2 * np.sin(np.pi * duty) / (np.pi * duty), rel=2e-3)


@pytest.mark.parametrize(("rise", "fall"), [(0.5, 0.5), (1.0, 0.1), (0.0, 3.0)])
def test_an_led_rises_and_falls_as_an_rc_circuit(rise, fall):
    """A single bright chip: 1 - exp(-u / rise) in it, exp(-u / fall) of what it reached after it; its integral is 1
    plus what the fall leaves and the rise takes."""
    chips = Chips("1", 1e3, rise=rise, fall=fall)
    u = np.linspace(0, 1, 8)[1:-1]
    reached = 1 - (np.exp(-1 / rise) if rise else 0)
    times = np.concatenate([u, 1 + u, 4 + u]) * 1e-3
    rising = 1 - np.exp(-u / rise) if rise else np.ones(u.size)
    want = np.concatenate([rising, reached * np.exp(-u / fall), reached * np.exp(-(3 + u) / fall)])
    np.testing.assert_allclose(sample_waveform(chips, times), want, rtol=1e-12)
    whole = integrate_exposure(chips, Camera(1.0, 1.0), [1]).item()
    assert whole == pytest.approx(1e-3 * (1 - rise * reached + fall * reached), rel=1e-12)


def test_chips_of_text_and_where_they_end():
    chips = Chips("011", 1e3, start=1.0, amplitude=2.0)
    times = [0.9999, 1.0, 1.0005, 1.0011, 1.0015, 1.0025, 1.0031, 1.1]
    assert sample_waveform(chips, times).tolist() == [0, 0, 0, 2, 2, 2, 0, 0]
    assert chips == Chips(np.array([0, 1, 1], np.uint8), 1000, start=1, amplitude=2)
    again = Chips("011", 1e3, repeat=True)
    assert sample_waveform(again, [0.0005, 0.0015, 0.0035, -0.0005]).tolist() == [0, 1, 0, 1]


def test_huge_and_tiny_values_that_have_an_answer():
    camera = Camera(22.2e-6, 0.0006)
    huge = integrate_exposure(Chips([1e100, -1e100], 1e3, repeat=True, amplitude=1e100), camera, 720)
    assert np.isfinite(huge).all()
    assert np.abs(huge).max() > 0.9e200
    assert (integrate_exposure(Tone(5e-324), camera, 7) == 1).all()
    assert (integrate_exposure(SquareWave(5e-324), camera, 7) == 1).all()
    assert (integrate_exposure(SquareWave(500.0), Camera(22.2e-6, 5e-324), 7) == 1).all()
    long = integrate_exposure(Chips([1, 3], 1e7, repeat=True), Camera(22.2e-6, 1e6), 7)
    np.testing.assert_allclose(long, 2, rtol=1e-12)


def test_operators_pickles_and_equality():
    tone, wave = Tone(500.0), SquareWave(300.0, duty=0.3)
    assert tone + wave == Sum([tone, wave])
    assert 1 + tone + wave == Sum([Constant(1.0), tone, wave])
    assert 2 * tone == Product([2.0, tone]) == np.float64(2) * tone
    assert tone * 2 == Product([tone, Constant(2.0)])
    assert tone != Tone(501.0)
    assert tone != 3
    assert Samples([1, 2], 10) != Samples([1, 3], 10)
    camera = Camera(1e-5, 1e-4)
    for waveform in [tone, wave, Chips("01", 1e3), Samples([1, 2], 10, repeat=True), 2 * tone + wave + 1]:
        again = pickle.loads(pickle.dumps(waveform))
        assert again == waveform
        assert hash(again) == hash(waveform)
        np.testing.assert_array_equal(integrate_exposure(again, camera, 9), integrate_exposure(waveform, camera, 9))
    with pytest.raises(AttributeError):
        tone.frequency = 3.0
    with pytest.raises(TypeError):
        tone + "1"
    levels = np.array([0.0, 1.0])
    chips = Chips(levels, 1e3)
    levels[:] = 7
    assert chips.levels.tolist() == [0, 1]
    with pytest.raises(ValueError, match="read-only"):
        chips.levels[0] = 7


@pytest.mark.parametrize("step", [1, 3, -2])
def test_out_with_any_strides(step):
    camera = Camera(1e-5, 3e-4, 0.01)
    wave = Tone(777.0) + Chips("0110", 3e3, repeat=True)
    want = integrate_exposure(wave, camera, 20, start=0.5, frames=4)
    memory = np.full((4, 60), np.nan)
    out = memory[::-1, ::step][:, :20]
    assert integrate_exposure(wave, camera, 20, start=0.5, frames=4, out=out) is out
    np.testing.assert_array_equal(out, want)
    assert np.isnan(memory).sum() == memory.size - out.size
    columns = np.full((20, 3), np.nan)
    integrate_exposure(wave, camera, np.arange(20, dtype=np.uint8), start=0.5, out=columns[:, 1])
    np.testing.assert_array_equal(columns[:, 1], want[0])


def test_the_base_class_is_no_waveform():
    with pytest.raises(TypeError, match="Waveform: got the base class"):
        Waveform()
