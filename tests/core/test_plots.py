"""All plots: into given axes, into a new figure, into a file; series that differ; maps of many lamps."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

pytest.importorskip("matplotlib")
import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ocisac_fast import Camera, detect_sources, plots, receive
from ocisac_fast.exposure import FlickeringLight, flicker_free_exposure

CAMERA = Camera(1e-5, exposure=2e-5)
FRAME = np.repeat((np.kron(np.random.default_rng(1).integers(0, 2, 60), np.ones(6)) * 100.0 + 20.0)[:, None], 8, axis=1)
LIGHTS = [FlickeringLight(90.0 + 20.0 * k, duty=0.1 + 0.1 * (k % 3)) for k in range(4)]
FREE = flicker_free_exposure(LIGHTS, 0.1)
INDICES = {"background": 0.1, "contrast": 0.1, "tolerance": 0.1}
CALLS = {
    "plot_exposure": (1, lambda **to: plots.plot_exposure(500.0, 350.0, **to)),
    "plot_front": (2, lambda **to: plots.plot_front(500.0, 350.0, **to)),
    "plot_modulation": (1, lambda **to: plots.plot_modulation(LIGHTS, 0.1, found=FREE, **to)),
    "plot_flicker_front": (1, lambda **to: plots.plot_flicker_front(500.0, LIGHTS, 0.1, found=FREE, **to)),
    "plot_flicker_indices": (3, lambda **to: plots.plot_flicker_indices(LIGHTS, [1e-3, 2e-3], **INDICES, **to)),
    "plot_lamp": (1, lambda **to: plots.plot_lamp([0.01], 0.02, (50.0, 500.0), **to)),
    "plot_received": (1, lambda **to: plots.plot_received(FRAME, CAMERA, received=receive(FRAME, CAMERA)[0], **to)),
    "plot_recordings": (1, lambda **to: plots.plot_recordings(np.ones(3), np.ones(3), label="gain", flags={}, **to)),
    "plot_regions": (1, lambda **to: plots.plot_regions(FRAME, CAMERA, regions=[], **to)),
    "plot_sources": (1, lambda **to: plots.plot_sources(FRAME, CAMERA, sources=detect_sources(FRAME, CAMERA), **to)),
    "plot_gain": (2, lambda **to: plots.plot_gain(FRAME, CAMERA, frequency=5e3, gain=0.5, **to)),
}


def test_all_plots_are_here():
    listed = {name for name, value in vars(plots).items() if name.startswith("plot_") and inspect.isfunction(value)}
    assert listed - {"plot_pulses"} == set(CALLS)  # that one is drawn in tests/exposure
    for name in listed:
        assert {"path", "ax"} <= set(inspect.signature(getattr(plots, name)).parameters)


@pytest.mark.parametrize("name", CALLS)
def test_a_plot_draws_in_given_axes_and_returns_them(name):
    count, plot = CALLS[name]
    figure = Figure()
    axes = figure.subplots(1, count, squeeze=False)[0]
    result = plot(ax=axes[0] if count == 1 else axes)
    assert result is (axes[0] if isinstance(result, Axes) else figure)
    assert all(one.has_data() for one in axes)
    if count > 1:
        with pytest.raises(ValueError, match=rf"ax: got {count + 1} axes, allowed: {count}"):
            plot(ax=figure.subplots(1, count + 1))


def test_without_a_file_the_figure_is_one_of_pyplot(tmp_path):
    from matplotlib import pyplot

    matplotlib.use("agg")
    pyplot.close("all")  # other tests of this process may have left figures
    axes = plots.plot_exposure(500.0, 350.0)
    assert pyplot.get_fignums() == [axes.figure.number]
    pyplot.close(axes.figure)
    plots.plot_exposure(500.0, 350.0, path=tmp_path / "a.svg")
    assert not pyplot.get_fignums()
    assert "<svg" in (tmp_path / "a.svg").read_text()


@pytest.mark.parametrize("count", [1, 7, 8, 16, 40])
def test_series_differ(count):
    looks = plots.series(count)
    assert len({(matplotlib.colors.to_hex(one["color"]), one["ls"]) for one in looks}) == count
    grey = [matplotlib.colors.to_rgb(one["color"]) @ np.array([0.3, 0.59, 0.11]) for one in looks[7:]]
    assert count < 8 or np.all(np.diff(grey) > 0.0)  # shades, in print too


def test_many_lamps_are_a_map():
    lights = [FlickeringLight(90.0 + k, duty=0.1) for k in range(16)]
    figure = plots.plot_flicker_indices(lights, np.geomspace(1e-5, 1e-2, 51), **INDICES, ax=Figure().subplots(1, 3))
    maps = [axes.collections[0].get_array() for axes in figure.axes[:3]]
    assert [one.shape for one in maps] == [(16, 51)] * 3
