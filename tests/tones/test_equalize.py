"""Equaliser: what it restores, what it leaves alone at the ends, agreement with NumPy, and refusals."""

from __future__ import annotations

from typing import Any

import equalisation
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings, strategies as st

import ocisac_fast.tones as of
from ocisac_fast import Camera, reference
from ocisac_fast.tones import EqualizerReport, lost_frequencies

ROW_TIME = 10e-6
Floats = npt.NDArray[np.float64]


def camera(exposure_rows: float, **more: Any) -> Camera:
    return Camera(ROW_TIME, exposure_rows * ROW_TIME, **more)


def chips(rows: int, exposure_rows: float, chip_rows: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Random on-off light, averaged over one row about each row's end, and its mean over the exposure."""
    return equalisation.draw("chips", chip_rows, rows, exposure_rows, rng)


def plain_inverse(column: Floats, exposure_rows: float, max_boost: float = 10.0) -> Floats:
    """The same gain in a circular DFT of the column as it is."""
    f = np.fft.rfftfreq(len(column))
    h = np.sinc(f * exposure_rows)
    gain = h / np.maximum(h**2, max_boost**-2) * np.exp(1j * np.pi * f * exposure_rows)
    return np.asarray(np.fft.irfft(np.fft.rfft(column) * gain, len(column)))


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


class TestRestores:
    @settings(deadline=None, max_examples=settings.default.max_examples // 2)
    @given(
        st.sampled_from([1, 2, 3, 5, 97, 720, 1080]),
        st.floats(0, 0.999),
        st.floats(-1e3, 1e3),
        st.floats(-5, 5),
        st.sampled_from(["inverse", "wiener"]),
    )
    def test_constants_and_ramps_are_exact(
        self, rows: int, share: float, level: float, slope: float, method: Any
    ) -> None:
        exposure_rows = share * rows
        seen = level + slope * (np.arange(rows) - exposure_rows / 2) * (rows > 1)
        result = of.equalize(seen, camera(exposure_rows), method=method)
        scale = np.abs(seen).max() + abs(slope) * rows + 1e-300
        assert np.abs(result - level - slope * np.arange(rows) * (rows > 1)).max() < 1e-12 * scale

    @pytest.mark.parametrize("method", ["inverse", "wiener"])
    @pytest.mark.parametrize("rows", [2, 31, 720])
    def test_an_exposure_of_the_frame_leaves_the_mean(self, rows: int, method: Any) -> None:
        """All rows share the exposure's light: a ramp is known below this length, and is its mean from it on."""
        seen = 100 + 0.25 * np.arange(rows)
        for share in (1.0 if rows == 2 else 1 + 1e-9, 1.5, 40.0):  # two rows are exact
            exposure_rows = share * rows
            result, report = of.equalize(seen, camera(exposure_rows), method=method, report=True)
            np.testing.assert_allclose(result, seen.mean(), rtol=1e-13)
            assert report.frequencies_lost.tolist() == [[0, np.inf]]
            assert report.rows_extrapolated == min(rows, np.ceil(exposure_rows / 2))
        exposure_rows = rows * (1 - 1e-9)
        ramp = of.equalize(seen, camera(exposure_rows), method=method)
        np.testing.assert_allclose(ramp, seen + 0.125 * exposure_rows, rtol=1e-12)

    @pytest.mark.parametrize("method", ["inverse", "wiener"])
    def test_light_close_to_the_smallest_number(self, method: Any) -> None:
        seen = 2.808444181528628e-148 * (np.arange(720) - 180)
        assert np.all(np.isfinite(of.equalize(seen, camera(360.0), method=method)))

    @pytest.mark.parametrize("unit", [5e-324, 1e-310, 2.0**-1000, 2.0**-480, 2.0**480, 2.0**1000])
    @pytest.mark.parametrize("noise", [None, 0.01])
    def test_the_unit_of_light_does_not_matter(self, unit: float, noise: float | None) -> None:
        rng = np.random.default_rng(2)
        seen = chips(720, 5.0, 30, rng)[1] + 0.01 * rng.normal(size=720)
        tiny = of.equalize(seen * unit, camera(5.0), method="wiener", noise=noise and noise * unit)
        assert np.all(np.isfinite(tiny))
        if unit > 1e-308:
            assert np.array_equal(tiny, unit * of.equalize(seen, camera(5.0), method="wiener", noise=noise))
        assert np.array_equal(of.equalize(np.full(99, unit), camera(5.0), method="wiener"), np.full(99, unit))

    @pytest.mark.parametrize(("noise", "unit"), [(1e-160, 1.0), (1.0, 1e155), (1.0, 1e-160), (1e-10, 1e150)])
    def test_noise_far_from_the_light(self, noise: float, unit: float) -> None:
        seen = chips(720, 5.0, 30, np.random.default_rng(2))[1] * unit
        stronger = max(noise, 1e-20 * unit) if noise < unit else 1e20 * unit
        found = of.equalize(seen, camera(5.0), method="wiener", noise=noise)
        np.testing.assert_allclose(
            found, of.equalize(seen, camera(5.0), method="wiener", noise=stronger), rtol=1e-6, atol=1e-6 * unit
        )

    def test_vignetting_does_not_ring(self) -> None:
        """A brightness that falls off smoothly: the plain circular DFT rings where its ends do not meet."""
        rows, exposure_rows = 720, 28.3
        n = np.arange(rows)

        def integral(t: Floats) -> Floats:
            return t - ((t - 300) / 360) ** 3 * 60

        light = 1 - 0.5 * ((n - 300) / 360) ** 2
        seen = (integral(n) - integral(n - exposure_rows)) / exposure_rows
        inside = slice(28, -28)
        ours = np.abs(of.equalize(seen, camera(exposure_rows)) - light)
        plain = np.abs(plain_inverse(seen, exposure_rows) - light)
        assert ours[inside].max() < 0.01
        assert ours.max() < 0.03
        assert plain[inside].max() > 0.05
        assert plain.max() > 0.3

    @pytest.mark.parametrize(
        ("kind", "value", "exposure_rows", "sigma", "most"),
        [
            ("tone", 0.18, 5.0, 0.01, 0.01),
            ("tone", 0.2, 3.0, 0.01, 0.01),
            ("tone", 0.005, 3.0, 0.001, 0.001),
            ("swell", 20.0, 12.0, 0.01, 0.005),
            ("swell", 60.0, 3.0, 0.001, 0.0005),
            ("swell", 8.0, 30.0, 0.05, 0.06),
            ("chips", 9.0, 12.0, 0.01, 0.11),
            ("chips", 30.0, 5.0, 0.05, 0.08),
        ],
    )
    def test_wiener_is_behind_no_plain_method(
        self, kind: str, value: float, exposure_rows: float, sigma: float, most: float
    ) -> None:
        error = equalisation.errors(kind, value, exposure_rows, sigma, 720, 6)
        assert error["wiener"] < 1.06 * min(error["inverse"], error["shift"])  # 0.5 dB
        assert error["wiener"] < most

    @pytest.mark.parametrize(
        ("kind", "value"),
        [
            *(("tone", frequency) for frequency in (0.02, 0.18)),
            *(("swell", width) for width in (8.0, 20.0, 60.0)),
            *(("chips", length) for length in (3.0, 9.0, 30.0)),
        ],
    )
    def test_wiener_is_within_3_db_of_what_all_covariances_allow(self, kind: str, value: float) -> None:
        error = equalisation.errors(kind, value, 5.0, 0.01, 300, 10, draws=2000)
        assert error["wiener"] < 10 ** (3 / 20) * error["oracle"]

    @pytest.mark.nightly
    def test_wiener_over_the_grid_of_the_bench(self) -> None:
        for case in equalisation.cases():
            if case[:2] == ("swell at an end", 8.0):
                continue  # up to 1.4 dB: docs/explanation/tones.md
            error = equalisation.errors(*case, 720, 20)
            assert error["wiener"] < 1.06 * min(error["inverse"], error["shift"]), case

    def test_last_half_exposure(self) -> None:
        """Chips without noise: the error grows where no later row saw the light, and stays bounded."""
        rng = np.random.default_rng(4)
        errors = np.array(
            [of.equalize(seen, camera(24.0)) - light for light, seen in (chips(1080, 24.0, 30, rng) for _ in range(40))]
        )
        assert rms(errors[:, 24:-24]) < 0.13
        assert rms(errors[:, :24]) < 0.15
        assert rms(errors[:, -24:-12]) < 0.25
        assert rms(errors[:, -12:]) < 0.35


class TestEdges:
    @pytest.mark.parametrize("method", ["inverse", "wiener"])
    def test_no_exposure_is_the_identity(self, method: Any) -> None:
        columns = np.random.default_rng(0).random((50, 3))
        result, report = of.equalize(columns, camera(0), method=method, report=True)
        assert np.array_equal(result, columns)
        assert report.frequencies_lost.tolist() == [[0.5 / ROW_TIME, np.inf]]
        assert report.rows_extrapolated == 0

    def test_wiener_without_noise_is_the_inverse(self) -> None:
        columns = np.random.default_rng(0).random((200, 3))
        assert np.array_equal(
            of.equalize(columns, camera(9.3), method="wiener", noise=0), of.equalize(columns, camera(9.3))
        )

    def test_wiener_of_noise_alone_leaves_the_line(self) -> None:
        columns = np.random.default_rng(0).normal(size=(200, 3))
        result = of.equalize(columns, camera(9.3), method="wiener", noise=2.0)
        assert np.abs(np.diff(result, 2, axis=0)).max() < 1e-12


class TestReport:
    @pytest.mark.parametrize("exposure_rows", [0.0, 0.45, 18.0, 108.3, 224.4])
    @pytest.mark.parametrize("max_boost", [1.5, 8.0, 100.0])
    def test_lost_bands_are_where_the_sinc_is_small(self, exposure_rows: float, max_boost: float) -> None:
        bands = lost_frequencies(camera(exposure_rows), max_boost=max_boost)
        level, highest = 1 / (max_boost * np.sqrt(2)), 0.5 / ROW_TIME

        def response(frequency: Floats) -> Floats:
            return np.abs(np.sinc(frequency * exposure_rows * ROW_TIME))

        f = np.linspace(0, 1.2 * highest, 100_001)
        inside = ((f[:, None] > bands[:, 0]) & (f[:, None] < bands[:, 1])).any(axis=1)
        assert np.count_nonzero(inside != ((response(f) < level) | (f > highest))) <= 2
        edges = bands.ravel()
        assert np.all(np.diff(edges) > 0)
        assert edges[-1] == np.inf
        assert np.all(np.isclose(response(edges[:-1]), level, rtol=1e-8) | (edges[:-1] == highest))

    def test_noise_gain_is_what_noise_shows(self) -> None:
        noise = np.random.default_rng(1).normal(size=(2000, 20))
        result, report = of.equalize(noise, camera(11.0), report=True)
        assert rms(result[200:-200]) == pytest.approx(report.noise_gain[0], rel=0.02)
        assert report.noise_gain.shape == report.noise.shape == (20,)

    def test_wiener_loses_more_when_noise_is_strong(self) -> None:
        _, seen = chips(1080, 7.3, 9, np.random.default_rng(2))
        weak = of.equalize(seen, camera(7.3), method="wiener", noise=1e-3, report=True)[1]
        strong = of.equalize(seen, camera(7.3), method="wiener", noise=0.1, report=True)[1]

        def lost(report: EqualizerReport) -> float:
            return float(np.diff(np.minimum(report.frequencies_lost, 0.5 / ROW_TIME)).sum())

        assert lost(of.equalize(seen, camera(7.3), report=True)[1]) <= lost(weak) * 1.01 < lost(strong)
        assert strong.noise == 0.1

    def test_noise_is_estimated(self) -> None:
        rng = np.random.default_rng(5)
        _, seen = chips(1080, 24.0, 8, rng)
        _, report = of.equalize(seen + 0.03 * rng.normal(size=1080), camera(24.0), method="wiener", report=True)
        assert report.noise == pytest.approx(0.03, rel=0.1)


class TestAgreesWithNumPy:
    @settings(deadline=None, max_examples=2 * settings.default.max_examples // 5)
    @given(
        st.sampled_from([1, 2, 3, 7, 31, 97, 210, 720]),
        st.integers(1, 5),
        st.integers(1, 3),
        st.floats(0, 1.1),
        st.sampled_from([np.uint8, np.uint16, np.float32, np.float64]),
        st.sampled_from([{"method": "inverse"}, {"method": "wiener"}, {"method": "wiener", "noise": 5.0}]),
        st.integers(0, 2**32 - 1),
    )
    def test_shapes_and_types(
        self, rows: int, columns: int, frames: int, share: float, dtype: Any, how: Any, seed: int
    ) -> None:
        exposure_rows = share**3 * rows
        rng = np.random.default_rng(seed)
        array = (200 * rng.random((frames, rows, columns)) + 20 * np.sin(np.arange(rows) / 9)[:, None]).clip(0)
        array = array.astype(dtype)
        result = of.equalize(array, camera(exposure_rows), **how, max_boost=6.0)
        exact = of.equalize(array.astype(np.float64), camera(exposure_rows), **how, max_boost=6.0)
        assert np.array_equal(result, exact)
        if how["method"] == "inverse":
            expected = reference.equalize(array, camera(exposure_rows), max_boost=6.0)
            assert np.abs(result - expected).max() <= 1e-10 * np.abs(expected).max()

    @pytest.mark.parametrize(("rows", "exposure_rows"), [(1080, 60.4), (1080, 500.0), (4352, 28.1), (4352, 300.5)])
    def test_large(self, rows: int, exposure_rows: float) -> None:
        seen = np.random.default_rng(1).random((rows, 2))
        expected = reference.equalize(seen, camera(exposure_rows))
        assert np.abs(of.equalize(seen, camera(exposure_rows)) - expected).max() <= 1e-10 * np.abs(expected).max()

    @settings(deadline=None, max_examples=30)
    @given(
        st.sampled_from([1, 2, 31, 97, 720]),
        st.integers(1, 70),
        st.floats(0, 1.1),
        st.sampled_from([np.uint8, np.uint16, np.float32, np.float64]),
        st.sampled_from([{"method": "inverse"}, {"method": "wiener"}]),
        st.integers(0, 2**32 - 1),
    )
    def test_float32(self, rows: int, columns: int, share: float, dtype: Any, how: Any, seed: int) -> None:
        array = (200 * np.random.default_rng(seed).random((rows, columns))).astype(dtype)
        out = np.empty(array.shape, np.float32)
        assert of.equalize(array, camera(share**3 * rows), **how, out=out) is out
        exact = of.equalize(array, camera(share**3 * rows), **how)
        assert np.all(np.abs(out - exact).max(axis=0) <= 1e-5 * (np.abs(exact).max(axis=0) + np.abs(array).max(axis=0)))

    def test_a_faint_column_beside_a_bright_one(self) -> None:
        """Two columns share a transform, and no rounding errors."""
        faint = 1e-12 * np.random.default_rng(1).random(300)
        bright = 1e12 * np.random.default_rng(2).random(300)
        together = of.equalize(np.stack([faint, bright, np.full(300, 1e-30)], axis=1), camera(8.5))
        assert np.allclose(together[:, 0], of.equalize(faint, camera(8.5)), rtol=0, atol=1e-13 * 1e-12)
        assert np.array_equal(together[:, 2], np.full(300, 1e-30))

    def test_one_dimension_and_out(self) -> None:
        columns = np.random.default_rng(1).random((97, 4))
        expected = of.equalize(columns, camera(8.5))
        assert np.allclose(of.equalize(columns[:, 2], camera(8.5)), expected[:, 2], rtol=0, atol=1e-13)
        out = np.full((4, 97), np.nan).T[::-1]
        assert of.equalize(columns, camera(8.5), out=out) is out
        assert np.array_equal(out, expected)
        assert of.equalize(columns, camera(8.5), out=columns) is columns
        assert np.array_equal(columns, expected)

    def test_noise_of_each_column(self) -> None:
        columns = np.random.default_rng(1).random((2, 97, 3))
        levels = np.array([[0.01, 0.1, 0.2], [0.05, 0.0, 0.3]])
        together = of.equalize(columns, camera(8.5), method="wiener", noise=levels)
        for frame in range(2):
            for c in range(3):
                alone = of.equalize(columns[frame, :, c], camera(8.5), method="wiener", noise=levels[frame, c])
                assert np.allclose(together[frame, :, c], alone, rtol=0, atol=1e-12)
