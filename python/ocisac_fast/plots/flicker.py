"""Plots of flickering lights under an exposure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ocisac_fast.exposure.flicker import (
    LONGEST_EXPOSURE,
    FlickerFreeExposure,
    FlickeringLight,
    exposure_modulation,
    flicker_front,
)
from ocisac_fast.exposure.flicker_indices import flicker_indices
from ocisac_fast.plots.picture import GREEN, ORANGE, RED, SKY, FilePath, figure_of, panels, series

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_LINES = 7  # lamps drawn as lines; more are rows of a map
_MOST_DOTS = 24  # exposures drawn as dots


def plot_modulation(
    lights: Sequence[FlickeringLight],
    below: float,
    *,
    path: FilePath | None = None,
    ax: Axes | None = None,
    found: FlickerFreeExposure,
    bounds: tuple[float, float] | None = None,
) -> Axes:
    """Plot the modulation of each light over the exposure, the bound, and the selected exposure.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), axes to draw in; None: none, those of a new figure.
        lights, below, bounds: as for ``flicker_free_exposure``.
        found: result of ``flicker_free_exposure``.
    """
    low, high = bounds or (0.0, LONGEST_EXPOSURE)
    exposure = np.linspace(low, high, 4001)
    with panels(path, ax, (8.0, 4.2)) as (axes,):
        for light, style in zip(lights, series(len(lights)), strict=True):
            kind = "tone" if light.duty is None else f"PWM, duty {light.duty:g}"
            label = f"{light.frequency:g} ± {light.uncertainty:g} Hz, {kind}"
            axes.plot(exposure * 1e3, exposure_modulation(light, exposure), lw=1.1, label=label, **style)
        axes.axhline(below, color=RED, lw=1.0, ls="--", label=f"bound {below:.3g}")
        axes.plot(found.exposure * 1e3, found.modulation, "o", color=RED, label=f"{found.exposure * 1e3:.4f} ms")
        axes.set(xlabel="exposure time / ms", ylabel="modulation left", yscale="log", ylim=(below / 20.0, 1.1))
        axes.legend(loc="lower left", fontsize=8)
    return axes


def plot_flicker_front(
    f_comm: float,
    lights: Sequence[FlickeringLight],
    below: float,
    *,
    path: FilePath | None = None,
    ax: Axes | None = None,
    found: FlickerFreeExposure,
    bounds: tuple[float, float] | None = None,
) -> Axes:
    """Plot the gain of the data light over the modulation of the other lights, for all exposures.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), axes to draw in; None: none, those of a new figure.
        f_comm, lights, below, bounds: as for ``flicker_free_exposure``.
        found: result of ``flicker_free_exposure``.
    """
    front = flicker_front(f_comm, lights, bounds=bounds)
    best = front.efficient
    order = np.argsort(front.modulation[best])
    with panels(path, ax, (6.0, 5.0)) as (axes,):
        axes.plot(front.modulation, front.gain, ".", ms=1.0, color=SKY, label="all exposures")
        axes.plot(front.modulation[best][order], front.gain[best][order], ".-", ms=4, color=GREEN, label="efficient")
        axes.axvline(below, color=RED, lw=1.0, ls="--", label=f"bound {below:.3g}")
        axes.plot(found.modulation, found.gain, "o", color=RED, label=f"{found.exposure * 1e3:.4f} ms")
        axes.set(
            xlabel="largest modulation of the lights to avoid",
            ylabel=f"gain at {f_comm:g} Hz",
            xscale="log",
            xlim=(below / 50.0, 1.1),
        )
        axes.legend(loc="upper left", fontsize=8)
    return axes


def plot_flicker_indices(
    lights: Sequence[FlickeringLight],
    exposures: Sequence[float],
    *,
    background: float,
    contrast: float,
    tolerance: float,
    path: FilePath | None = None,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Plot the three indices over the exposure: a line for each of up to seven lamps, else a map of all.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), three axes to draw in; None: none, a new figure's.
        lights, background, contrast, tolerance: as for ``flicker_indices``.
        exposures: s.
    """
    settings = {"background": background, "contrast": contrast, "tolerance": tolerance}
    titles = ("FMI: modulation", f"FDI: contrast above {contrast:.3g}", f"MMP: within {tolerance:.3g} of the mean")
    are_lines = len(lights) <= _MOST_LINES
    height = 4.0 if are_lines else 1.6 + 0.22 * len(lights)
    with panels(path, ax, (11.0, height), (1, 3), sharey=True) as axes:
        (_draw_lines if are_lines else _draw_maps)(axes, lights, np.asarray(exposures), settings)
        for one, title in zip(axes, titles, strict=True):
            one.set(xlabel="exposure time / ms", title=title)
    return figure_of(axes[0])


def _name(light: FlickeringLight) -> str:
    return f"{light.frequency:.4g} Hz, " + ("tone" if light.duty is None else f"duty {light.duty:.3g}")


def _indices(light: FlickeringLight, times: np.ndarray[Any, Any], settings: dict[str, float]) -> list[Any]:
    found = flicker_indices(light, times, **settings)
    return [found.modulation_index, found.detection_index, found.mitigation_probability]


def _draw_lines(axes: list[Any], lights: Sequence[FlickeringLight], given: Any, settings: dict[str, float]) -> None:
    times = np.geomspace(0.3 * given.min(), 3.0 * given.max(), 3001)
    for light, style in zip(lights, series(len(lights)), strict=True):
        for one, lines, dots in zip(
            axes, _indices(light, times, settings), _indices(light, given, settings), strict=True
        ):
            one.plot(times * 1e3, lines, lw=1.1, label=_name(light), **style)
            if given.size <= _MOST_DOTS:
                one.plot(given * 1e3, dots, "o", color=style["color"], ms=4)
    for one in axes:
        one.set(xscale="log", ylim=(-0.03, 1.03))
    axes[0].legend(fontsize=8)


def _draw_maps(axes: list[Any], lights: Sequence[FlickeringLight], given: Any, settings: dict[str, float]) -> None:
    order = np.unique(given)
    values = np.array([_indices(light, order, settings) for light in lights])  # (lights, indices, exposures)
    for k, one in enumerate(axes):
        cells = np.arange(order.size + 1), np.arange(len(lights) + 1)
        image = one.pcolormesh(*cells, values[:, k], cmap="viridis", vmin=0.0, vmax=1.0)
        ticks = np.unique(np.linspace(0, order.size - 1, min(6, order.size)).round().astype(int))
        one.set_xticks(ticks + 0.5, [f"{order[tick] * 1e3:.3g}" for tick in ticks])
        one.grid(False)
    axes[0].set_yticks(np.arange(len(lights)) + 0.5, [_name(light) for light in lights], fontsize=8)
    figure_of(axes[0]).colorbar(image, ax=axes)


def plot_lamp(
    exposures: Sequence[float],
    below: float,
    bounds: tuple[float, float],
    *,
    path: FilePath | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Plot the largest modulation of PWM at any exposure over frequency and duty, the bound, and missed pulses.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), axes to draw in; None: none, those of a new figure.
        exposures: of the cameras, s.
        below, bounds: as for ``flicker_free_frequencies``.
    """
    frequency, duty = np.geomspace(*bounds, 1200), np.linspace(0.01, 0.99, 99)
    left = [
        np.max([exposure_modulation(FlickeringLight(time, duty=float(d)), frequency) for time in exposures], axis=0)
        for d in duty
    ]
    shown = np.log10(np.maximum(left, 1e-4))
    with panels(path, ax, (9.0, 5.0)) as (axes,):
        image = axes.pcolormesh(frequency, duty, shown, cmap="viridis_r", vmin=-3, vmax=0, shading="nearest")
        figure_of(axes).colorbar(image, ax=axes, label="log10 of the largest modulation")
        axes.contour(frequency, duty, shown, levels=[np.log10(below)], colors=RED, linewidths=1.0, linestyles="solid")
        axes.plot((1.0 - duty) / min(exposures), duty, color=ORANGE, lw=1.6, label="pulses are missed to the left")
        axes.plot([], [], color=RED, lw=1.0, label=f"modulation {below:.3g}")
        shutters = ", ".join(f"{time * 1e3:.4g}" for time in exposures)
        axes.set(xlabel="frequency of the lamp / Hz", ylabel="duty", xscale="log", xlim=bounds)
        axes.set_title(f"Shutters of {shutters} ms")
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.13), ncols=2, fontsize=8)
    return axes
