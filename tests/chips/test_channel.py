"""The channel from known chips: agreement with the reference, errors at their bounds, preambles found, refusals."""

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings, strategies as st

import ocisac_fast.chips as ocisac
from ocisac_fast import Camera, Chips, integrate_exposure, reference
from ocisac_fast.chips import (
    ChannelEstimate,
    ChipClock,
    ClockErrors,
    clock_bounds,
    expose_chips,
    find_channel,
    find_preamble,
    fit_channel,
    refine_channel,
)
from ocisac_fast.reference import detect_sequence
from ocisac_fast.reference.chips import derivatives, legendre


class Column:
    """Random chips through an exposure (in chips), with a gradient and noise (of the swing)."""

    def __init__(self, seed, rows_per_chip, exposure, noise=0.02, rows=1080, preamble=None, gradient=0.0):
        self.random = np.random.default_rng(seed)
        self.rows_per_chip = rows_per_chip * (1 + self.random.uniform(-0.01, 0.01))
        self.exposure_rows = exposure * self.rows_per_chip
        self.phase = self.random.uniform(0, self.rows_per_chip)
        self.first = -int(np.ceil(exposure / 2)) - 2
        self.chips = self.random.integers(0, 2, int(rows / self.rows_per_chip) + 2 * abs(self.first)).astype(float)
        self.start = None
        if preamble is not None:
            margin = int(np.ceil(exposure / 2)) + 2 - self.first
            at = self.random.integers(margin, len(self.chips) - margin - len(preamble))
            self.chips[at : at + len(preamble)] = preamble
            self.start = self.phase + (self.first + at) * self.rows_per_chip
        self.swing = 40 * (1 + gradient * np.linspace(-1, 1, rows))
        light = expose_chips(self.chips, rows, self.clock, first=self.first)
        self.noise = 40 * noise
        self.rows = 10 + 3 * np.linspace(-1, 1, rows) + self.swing * light
        self.rows += self.noise * self.random.standard_normal(rows)

    @property
    def clock(self):
        return ChipClock(rows_per_chip=self.rows_per_chip, phase=self.phase, exposure_rows=self.exposure_rows)

    def wrong_clock(self):
        """Off by up to a fifth of a chip at either end of the frame, the exposure by a fifth."""
        middle = len(self.rows) / 2
        period = self.rows_per_chip * (1 + self.random.uniform(-0.2, 0.2) * self.rows_per_chip / middle)
        phase = self.phase + middle / self.rows_per_chip * (self.rows_per_chip - period)
        exposure = self.exposure_rows * self.random.uniform(0.8, 1.2)
        return ChipClock(rows_per_chip=period, phase=phase, exposure_rows=exposure)

    def bounds(self, **options):
        return clock_bounds(self.chips, self.swing, self.clock, noise=self.noise, first=self.first, **options)


clocks = {
    "rows_per_chip": st.floats(0.8, 9),
    "phase": st.floats(-50, 50),
    "exposure_rows": st.one_of(st.just(0.0), st.floats(0.01, 60)),
}


@settings(max_examples=settings.default.max_examples // 2)
@given(
    seed=st.integers(0, 2**32),
    chips=st.sampled_from([1, 2, 31, 300]),
    rows=st.sampled_from([1, 2, 97, 720, 1080, 4352]),
    dtype=st.sampled_from(["uint8", "bool", "float32", "float64"]),
    step=st.sampled_from([-2, -1, 1, 3]),
    clock=st.builds(ChipClock, **clocks),
    first=st.integers(-30, 30),
)
def test_exposed_chips_agree_with_the_reference(seed, chips, rows, dtype, step, clock, first):
    levels = np.random.default_rng(seed).integers(0, 2, abs(step) * chips).astype(dtype)[::step]
    got, want = (of.expose_chips(levels, rows, clock, first=first) for of in (ocisac, reference))
    assert got.shape == (rows,)
    rounding = 1e-12 * max(1, 4 / max(clock.exposure_rows, 1e-3))  # of a row's place, in exposures
    np.testing.assert_allclose(got, want, rtol=0, atol=rounding)


def test_an_exposed_chip_is_a_waveform_seen_by_a_camera():
    chips = np.array([1, 0, 0, 1, 1, 0, 1, 0, 0, 0], float)
    camera = Camera(1.0, 7.3)
    light = integrate_exposure(Chips(chips, 1 / 4.7), camera, np.arange(8, 40))
    got = expose_chips(chips, 40, ChipClock(rows_per_chip=4.7, phase=7.3 / 2, exposure_rows=7.3))
    np.testing.assert_allclose(got[8:], light, atol=1e-12)


def level_errors(column, channel, exposure_known):
    """(2, rows) standard errors of the levels of steady 0 and 1, those of the clock included."""
    rows = len(column.rows)
    clock = np.array([channel.rows_per_chip, channel.phase, channel.exposure_rows])
    light = expose_chips(column.chips, rows, channel.clock, first=column.first)[:, None]
    dark, swing = (legendre(rows, len(of) - 1) for of in (channel.dark, channel.swing))
    by_clock = derivatives(column.chips, rows, clock, column.first)[:, : 2 if exposure_known else 3]
    jacobian = np.hstack([dark, swing * light, (swing @ channel.swing)[:, None] * by_clock])
    inverse = np.linalg.pinv(jacobian[slice(*channel.rows)])
    levels = dark.shape[1] + swing.shape[1]
    covariance = (inverse @ inverse.T)[:levels, :levels]
    steady = [np.hstack([dark, share * swing]) for share in (0, 1)]
    return channel.noise * np.sqrt([np.einsum("nk,kl,nl->n", one, covariance, one) for one in steady])


@settings(max_examples=settings.default.max_examples // 5)
@given(
    seed=st.integers(0, 2**32),
    rows_per_chip=st.floats(2.1, 7),
    exposure=st.floats(0.6, 7),
    rows=st.sampled_from([360, 540]),
    degrees=st.tuples(st.integers(0, 3), st.integers(0, 2)),
    exposure_known=st.booleans(),
)
@example(3509, 2.559590221499623, 5.19140625, 360, (3, 0), False)
@example(13861, 3.8387955685106068, 7.0, 540, (0, 0), False)  # the fit stops at a kink
@example(0, 4.38048865451645, 2.3804886545164496, 360, (0, 0), False)  # the bound lies on a kink
def test_fit_and_bounds_agree_with_the_reference(seed, rows_per_chip, exposure, rows, degrees, exposure_known):
    column = Column(seed, rows_per_chip, exposure, rows=rows)
    options = dict(zip(("dark_degree", "swing_degree"), degrees, strict=True), exposure_known=exposure_known)
    start = column.wrong_clock()
    if exposure_known:
        start = dataclasses.replace(start, exposure_rows=column.exposure_rows)
    options["first"] = column.first
    got, want = (of.fit_channel(column.rows, column.chips, start, **options) for of in (ocisac, reference))
    spread = np.sqrt(np.diag(want.errors.covariance)) + 1e-6
    middle = got.errors.chip
    for channel in (got, want):
        assert channel.errors.chip == middle
    difference = [
        got.phase - want.phase + middle * (got.rows_per_chip - want.rows_per_chip),
        got.rows_per_chip - want.rows_per_chip,
        got.exposure_rows - want.exposure_rows,
    ]
    # The model has kinks, at which a fit may stop within half a standard error of the bottom, chi^2 higher by 1/4: two
    # fits then differ by up to one.
    assert 2 * rows * abs(got.noise / want.noise - 1) < 0.25
    assert np.all(np.abs(difference) < spread)
    assert got.rows == want.rows
    assert np.all(np.abs(got.levels(rows) - want.levels(rows)) < level_errors(column, want, exposure_known) + 1e-6)
    bounds = [
        of.clock_bounds(column.chips, column.swing, column.clock, noise=column.noise, **options)
        for of in (ocisac, reference)
    ]
    spread = np.sqrt(np.diag(bounds[1].covariance))
    scale = np.outer(*[np.where(spread > 0, spread, 1)] * 2)
    # At a kink, where a row ends on a chip's edge, the slope on either side is right: a row or two of all.
    np.testing.assert_allclose(bounds[0].covariance / scale, bounds[1].covariance / scale, atol=2 / rows)


@pytest.mark.parametrize("exposure", [0.5, 2.0, 7.0, 14.0])
@pytest.mark.parametrize("rows_per_chip", [2.3, 4.3, 7.0])
def test_errors_are_at_their_bounds(rows_per_chip, exposure):
    misses = []
    for seed in range(40):
        column = Column(seed, rows_per_chip, exposure, noise=0.04)
        got = fit_channel(column.rows, column.chips, column.wrong_clock(), first=column.first)
        bounds = column.bounds()
        phase_of_middle = got.phase - column.phase + bounds.chip * (got.rows_per_chip - column.rows_per_chip)
        assert got.converged
        assert got.noise == pytest.approx(column.noise, rel=0.15)
        assert got.errors.rows_per_chip_std == pytest.approx(bounds.rows_per_chip_std, rel=0.3)
        period = (got.rows_per_chip - column.rows_per_chip) / bounds.rows_per_chip_std
        length = (got.exposure_rows - column.exposure_rows) / bounds.exposure_rows_std
        misses.append([phase_of_middle / bounds.phase_std, period, length])
    assert np.all(np.sqrt(np.mean(np.square(misses), axis=0)) < 1.35)  # 40 frames: 11 % spread about 1
    assert np.all(np.abs(misses) < 5)


def test_what_chips_do_not_tell_is_not_guessed():
    rows = np.linspace(0, 1, 50)
    clock = ChipClock(rows_per_chip=5.0, phase=0.0, exposure_rows=2.0)
    assert fit_channel(rows, np.ones(10), clock) is None
    assert fit_channel(rows, [0, 1], dataclasses.replace(clock, rows_per_chip=3.0)) is None  # five rows, six unknowns
    assert clock_bounds(np.ones(10), np.ones(50), clock, noise=0.1) is None
    aligned = ChipClock(rows_per_chip=2.0, phase=0.3, exposure_rows=1.0)  # every edge on the same part of a row
    chips = np.random.default_rng(0).integers(0, 2, 100)
    bounds = clock_bounds(chips, np.ones(200), aligned, noise=0.1)
    assert np.isinf(bounds.exposure_rows_std)
    assert 0 < bounds.rows_per_chip_std < 0.01
    want = reference.clock_bounds(chips, np.ones(200), aligned, noise=0.1)
    assert np.isinf(want.exposure_rows_std)
    assert bounds.rows_per_chip_std == pytest.approx(want.rows_per_chip_std)
    got = fit_channel(expose_chips(chips, 200, aligned), chips, aligned)
    assert np.isinf(got.errors.exposure_rows_std)


@pytest.mark.parametrize("exposure_known", [False, True])
@pytest.mark.parametrize(("exposure", "noise"), [(0.5, 0.04), (1.0, 0.04), (3.0, 0.04), (7.0, 0.02), (14.0, 0.01)])
@pytest.mark.parametrize("rows_per_chip", [2.0, 3.3, 7.0])
def test_preambles_are_found(rows_per_chip, exposure, noise, exposure_known):
    for seed in range(6):
        preamble = np.random.default_rng(1000 + seed).integers(0, 2, 40)
        column = Column(seed, rows_per_chip, exposure, noise, preamble=preamble)
        length = column.exposure_rows if exposure_known else None
        match = find_preamble(column.rows, preamble, rows_per_chip=rows_per_chip, exposure_rows=length)[0]
        assert abs(match.channel.phase - column.start) < 0.3 * column.rows_per_chip
        assert match.channel.rows_per_chip == pytest.approx(column.rows_per_chip, rel=0.02)
        assert match.explained > 0.8
        if exposure_known:
            assert match.channel.exposure_rows == column.exposure_rows
        else:
            allowed = 6 * match.channel.errors.exposure_rows_std + 0.01
            assert abs(match.channel.exposure_rows - column.exposure_rows) < allowed


@pytest.mark.parametrize(("seed", "exposure"), [(0, 0.7), (1, 3.0)])
def test_a_preamble_is_the_best_fit_of_all_places(seed, exposure):
    """Certainty and share explained by their definitions; no other place of the frame explains as much."""
    preamble = np.random.default_rng(6).integers(0, 2, 24)
    column = Column(seed, 4.1, exposure, 0.02, rows=150, preamble=preamble)
    match = find_preamble(column.rows, preamble, rows_per_chip=4.1, exposure_rows=column.exposure_rows)[0]

    def fitted(phase):
        clock = ChipClock(rows_per_chip=4.1, phase=phase, exposure_rows=column.exposure_rows)
        return reference.fit_channel(column.rows, preamble, clock, exposure_known=True)

    def explained(channel):
        rows = np.arange(*channel.rows)
        line = np.polynomial.polynomial.Polynomial.fit(rows, column.rows[rows], 1)
        return 1 - channel.noise**2 * rows.size / np.sum((column.rows[rows] - line(rows)) ** 2)

    best = fitted(match.channel.phase)
    assert match.channel.phase == pytest.approx(best.phase, abs=0.05 * best.errors.phase_std)
    assert match.explained == pytest.approx(explained(best), rel=1e-4)
    count, period = np.ptp(best.rows), best.rows_per_chip
    certainty = -0.5 * count / period * np.log(1 - explained(best)) - np.log(150 / period)
    assert match.certainty == pytest.approx(certainty, rel=1e-3)
    places = np.arange(-column.exposure_rows / 2, 150 - 24 * 4.1 + column.exposure_rows / 2, 0.5 * 4.1)
    others = [channel for channel in map(fitted, places) if channel is not None and channel.swing[0] > 0]
    near = [channel for channel in others if abs(channel.rows_per_chip / 4.1 - 1) < 0.1]
    assert max(map(explained, near)) <= match.explained + 1e-4


def test_all_preambles_of_a_frame_are_found():
    preamble = np.random.default_rng(7).integers(0, 2, 32).astype(float)
    column = Column(0, 3.0, 4.0, 0.01)
    for at in (30, 150, 280):
        column.chips[at : at + 32] = preamble
    rows = 10 + 40 * expose_chips(column.chips, 1080, column.clock, first=column.first)
    rows += 0.4 * column.random.standard_normal(1080)
    found = find_preamble(rows, preamble, rows_per_chip=3.0, max_matches=5)
    starts = [column.phase + (column.first + at) * column.rows_per_chip for at in (30, 150, 280)]
    assert sorted(match.channel.phase for match in found[:3]) == pytest.approx(starts, abs=0.3)


def test_no_preamble_is_found_in_noise():
    preamble = np.random.default_rng(8).integers(0, 2, 48)
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal(1080)
        assert find_preamble(noise, preamble, rows_per_chip=4.0) == []
    assert find_preamble(np.full(1080, 7.0), preamble, rows_per_chip=4.0) == []
    assert find_preamble(np.arange(50.0), preamble, rows_per_chip=4.0) == []  # longer than the frame


def errors_of(column, found, shift):
    """Wrong chips among those the frame shows whole; `shift` added to the numbers of the chips found."""
    edge = int(np.ceil(column.exposure_rows / column.rows_per_chip)) + 1
    whole = np.arange(edge, int(len(column.rows) / column.rows_per_chip) - edge)
    return np.sum(found.chips[whole - shift - found.first] != column.chips[whole - column.first])


@pytest.mark.parametrize(
    ("rows_per_chip", "exposure", "noise", "seed"),
    [(7.0, 10, 0.04, 11), (7.0, 10, 0.04, 26), (4.0, 10, 0.04, 13), (4.0, 10, 0.04, 16), (2.0, 10, 0.02, 10)],
)
def test_a_clock_followed_alone_slips_here_and_those_compared_do_not(rows_per_chip, exposure, noise, seed):
    standard = np.array([0] + [1] * 6 + [0] * 6 + [1])
    preamble = np.concatenate([standard, 1 - standard, standard])
    column = Column(seed, rows_per_chip, exposure, noise, preamble=preamble)
    start = find_preamble(column.rows, preamble, rows_per_chip=rows_per_chip)[0].channel
    found = refine_channel(column.rows, start, known=preamble)
    shift = round((column.start - column.phase) / column.rows_per_chip)
    assert errors_of(column, found, shift) == 0
    assert found.channel.rows_per_chip == pytest.approx(column.rows_per_chip, rel=2e-3)


def test_the_channel_of_the_whole_frame_is_the_fit_of_its_chips():
    preamble = np.random.default_rng(9).integers(0, 2, 32)
    column = Column(1, 4.1, 3.0, 0.02, rows=400, preamble=preamble)
    start = find_preamble(column.rows, preamble, rows_per_chip=4.1)[0].channel
    got = refine_channel(column.rows, start, detect=detect_sequence, known=preamble)
    assert got.settled
    assert errors_of(column, got, round((column.start - column.phase) / column.rows_per_chip)) == 0
    channel = got.channel
    degrees = {"dark_degree": len(channel.dark) - 1, "swing_degree": len(channel.swing) - 1}
    want = reference.fit_channel(column.rows, got.chips[1:-1], channel.clock, first=got.first + 1, **degrees)
    spread = want.errors
    assert channel.rows_per_chip == pytest.approx(want.rows_per_chip, abs=0.02 * spread.rows_per_chip_std)
    assert channel.exposure_rows == pytest.approx(want.exposure_rows, abs=0.02 * spread.exposure_rows_std)
    assert channel.noise == pytest.approx(want.noise, rel=1e-3)
    assert channel.exposure_rows == pytest.approx(column.exposure_rows, abs=4 * spread.exposure_rows_std)


@pytest.mark.parametrize(("rows_per_chip", "seed"), [(4.0, 14), (4.0, 17), (7.0, 13)])
def test_starts_are_compared_by_the_whole_frame(rows_per_chip, seed):
    column = Column(seed, rows_per_chip, 7, 0.04)
    found = find_channel(column.rows, rows_per_chip=rows_per_chip, exposure_rows=column.exposure_rows)
    middle = [(540 - clock.phase) / clock.rows_per_chip for clock in (column, found.channel)]
    assert errors_of(column, found, round(middle[0] - middle[1])) == 0
    assert found.channel.rows_per_chip == pytest.approx(column.rows_per_chip, rel=2e-3)


@pytest.mark.parametrize("rows_per_chip", [4.0, 7.0])
def test_few_clocks_are_missed_where_chips_are_easily_confused(rows_per_chip):
    missed = 0
    for seed in range(100, 112):
        column = Column(seed, rows_per_chip, 7, 0.04)
        found = find_channel(column.rows, rows_per_chip=rows_per_chip, exposure_rows=column.exposure_rows)
        middle = [(540 - clock.phase) / clock.rows_per_chip for clock in (column, found.channel)]
        missed += errors_of(column, found, round(middle[0] - middle[1])) > 10
    assert missed <= 1


def test_the_clock_is_predicted_within_its_standard_errors():
    """A steady clock of 3.7 rows a chip and 1501.3 rows a frame, seen in twelve frames, three frames on."""
    misses, rest = [], (np.zeros(1), np.ones(1), 0.01, (0, 1080), True)
    for seed in range(300):
        noise = iter(np.random.default_rng(seed).standard_normal(50) * (seed > 0))
        tracker = ocisac.ClockTracker(1501.3 + 0.4 * next(noise), frame_rows_std=0.4, drift=0, exposure_wander=0)
        assert tracker.predict(0) is None
        exposures = []
        for frame in range(12):
            period, exposures = 3.7 + 3e-4 * next(noise), [*exposures, 20 + 0.2 * next(noise)]
            first = np.ceil((1501.3 * frame - 1.1) / 3.7)
            middle = 1.1 + (first + 140) * 3.7 - 1501.3 * frame + 0.05 * next(noise)
            errors = ClockErrors(140, np.diag([0.05**2, 3e-4**2, 0.04]))
            clock = (period, middle - 140 * period, exposures[-1])
            assert tracker.update(frame, ChannelEstimate(*clock, errors, *rest))
        got = tracker.predict(14)
        assert (got.exposure_rows, got.covariance[2, 2]) == pytest.approx((np.mean(exposures), 0.04 / 12))
        assert got.chips_lost == pytest.approx(np.sqrt(got.covariance[0, 0]) / got.rows_per_chip)
        off = [got.phase - (1.1 + 3.7 * got.chip - 1501.3 * 14), got.rows_per_chip - 3.7]
        misses.append(off / np.sqrt(np.diag(got.covariance)[:2]))
        tracker.reset()
        assert tracker.predict(0) is None
    assert misses[0] == pytest.approx([0, 0], abs=1e-6)  # without noise
    assert np.sqrt(np.mean(np.square(misses), axis=0)) == pytest.approx([1, 1], abs=0.15)


@given(
    values=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=12),
    errors=st.lists(st.one_of(st.floats(1e-3, 1e3), st.sampled_from([0.0, np.inf, np.nan])), min_size=12, max_size=12),
)
def test_pooled_estimates_agree_with_the_reference(values, errors):
    got, want = (of.pool_estimates(values, errors[: len(values)]) for of in (ocisac, reference))
    np.testing.assert_allclose(
        [got.value, got.std, got.count], [want.value, want.std, want.count], rtol=1e-9, atol=1e-9
    )


@settings(
    deadline=None,
    max_examples=3 * settings.default.max_examples // 10,
    suppress_health_check=[HealthCheck.filter_too_much],
)
@given(
    rows_per_chip=st.floats(1.0, 7.0),
    chips=st.floats(0.0, 9.0),
    place=st.floats(-0.9, -0.01),
    count=st.integers(1, 12),
    first=st.integers(-5, 5),
    seed=st.integers(0, 1000),
)
def test_llr_are_those_of_all_sequences(rows_per_chip, chips, place, count, first, seed):
    random = np.random.default_rng(seed)
    exposure = chips * rows_per_chip
    # Rows that see no chips but those `count`.
    phase = place - exposure / 2 - first * rows_per_chip
    rows = int(count * rows_per_chip - exposure + place)
    assume(rows > 0)
    light = random.random(rows)
    clock = ChipClock(rows_per_chip=rows_per_chip, phase=phase, exposure_rows=exposure)
    got, want = (of.chip_llr(light, clock, noise=0.2, first=first, count=count) for of in (ocisac, reference))
    assert got.shape == (count,)
    np.testing.assert_allclose(got, want, atol=1e-3)  # single precision inside


@pytest.mark.parametrize("rows", [1, 2, 3, 5, 7, 8, 12])
@pytest.mark.parametrize("exposure", [None, 3.0, 30.0])
def test_frames_of_a_few_rows_tell_no_channel(rows, exposure):
    for seed in range(5):
        column = np.random.default_rng(seed).random(rows)
        found = find_channel(column, rows_per_chip=4.0, exposure_rows=exposure)
        assert found is None or abs(found.channel.rows_per_chip / 4 - 1) < 0.03
        assert find_preamble(column, standard_preamble(), rows_per_chip=4.0, exposure_rows=exposure) == []


def standard_preamble():
    return np.array([0] + [1] * 6 + [0] * 6 + [1], float)
