"""Plots of flickering lights under an exposure."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from ocisac_fast.exposure.flicker import (
    LONGEST_EXPOSURE,
    FlickerFreeExposure,
    FlickeringLight,
    exposure_modulation,
    flicker_front,
)
from ocisac_fast.exposure.flicker_indices import flicker_indices
from ocisac_fast.plots.picture import BLUE, GREEN, ORANGE, RED, SKY, picture

_COLOURS = (BLUE, ORANGE, GREEN, SKY)


def plot_modulation(
    lights: Sequence[FlickeringLight],
    below: float,
    *,
    path: str | os.PathLike[str],
    found: FlickerFreeExposure,
    bounds: tuple[float, float] | None = None,
) -> None:
    """Plot the modulation of each light over the exposure, the bound, and the selected exposure.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        lights, below, bounds: as for ``flicker_free_exposure``.
        found: result of ``flicker_free_exposure``.
    """
    low, high = bounds or (0.0, LONGEST_EXPOSURE)
    exposure = np.linspace(low, high, 4001)
    with picture(path, 8.0, 4.2) as figure:
        axes = figure.subplots()
        for k, light in enumerate(lights):
            kind = "tone" if light.duty is None else f"PWM, duty {light.duty:g}"
            label = f"{light.frequency:g} ± {light.uncertainty:g} Hz, {kind}"
            axes.plot(exposure * 1e3, exposure_modulation(light, exposure), lw=1.1, color=_COLOURS[k % 4], label=label)
        axes.axhline(below, color=RED, lw=1.0, ls="--", label=f"bound {below:.3g}")
        axes.plot(found.exposure * 1e3, found.modulation, "o", color=RED, label=f"{found.exposure * 1e3:.4f} ms")
        axes.set(xlabel="exposure time / ms", ylabel="modulation left", yscale="log", ylim=(below / 20.0, 1.1))
        axes.legend(loc="lower left", fontsize=8)


def plot_flicker_front(
    f_comm: float,
    lights: Sequence[FlickeringLight],
    below: float,
    *,
    path: str | os.PathLike[str],
    found: FlickerFreeExposure,
    bounds: tuple[float, float] | None = None,
) -> None:
    """Plot the gain of the data light over the modulation of the other lights, for all exposures.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        f_comm, lights, below, bounds: as for ``flicker_free_exposure``.
        found: result of ``flicker_free_exposure``.
    """
    front = flicker_front(f_comm, lights, bounds=bounds)
    best = front.efficient
    order = np.argsort(front.modulation[best])
    with picture(path, 6.0, 5.0) as figure:
        axes = figure.subplots()
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


def plot_flicker_indices(
    lights: Sequence[FlickeringLight],
    exposures: Sequence[float],
    *,
    path: str | os.PathLike[str],
    background: float,
    contrast: float,
    tolerance: float,
) -> None:
    """Plot the three indices over the exposure for each lamp, with the given exposures as dots.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        lights, background, contrast, tolerance: as for ``flicker_indices``.
        exposures: s.
    """
    times = np.geomspace(0.3 * min(exposures), 3.0 * max(exposures), 3001)
    settings = {"background": background, "contrast": contrast, "tolerance": tolerance}
    titles = ("FMI: modulation", f"FDI: contrast above {contrast:.3g}", f"MMP: within {tolerance:.3g} of the mean")
    with picture(path, 11.0, 4.0) as figure:
        panels = figure.subplots(1, 3, sharey=True)
        for k, light in enumerate(lights):
            for when, style in ((times, {"lw": 1.1}), (np.asarray(exposures), {"marker": "o", "ls": ""})):
                found = flicker_indices(light, when, **settings)
                values = (found.modulation_index, found.detection_index, found.mitigation_probability)
                label = f"{light.frequency:g} Hz, " + ("tone" if light.duty is None else f"duty {light.duty:g}")
                for axes, value in zip(panels, values, strict=True):
                    text = label if when is times else None
                    axes.plot(when * 1e3, value, color=_COLOURS[k % 4], label=text, **style)
        for axes, title in zip(panels, titles, strict=True):
            axes.set(xlabel="exposure time / ms", xscale="log", ylim=(-0.03, 1.03), title=title)
        panels[0].legend(fontsize=8)


def plot_lamp(
    exposures: Sequence[float], below: float, bounds: tuple[float, float], *, path: str | os.PathLike[str]
) -> None:
    """Plot the largest modulation of PWM at any exposure over frequency and duty, the bound, and missed pulses.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        exposures: of the cameras, s.
        below, bounds: as for ``flicker_free_frequencies``.
    """
    frequency, duty = np.geomspace(*bounds, 1200), np.linspace(0.01, 0.99, 99)
    left = [
        np.max([exposure_modulation(FlickeringLight(time, duty=float(d)), frequency) for time in exposures], axis=0)
        for d in duty
    ]
    shown = np.log10(np.maximum(left, 1e-4))
    with picture(path, 9.0, 5.0) as figure:
        axes = figure.subplots()
        image = axes.pcolormesh(frequency, duty, shown, cmap="viridis_r", vmin=-3, vmax=0, shading="nearest")
        figure.colorbar(image, ax=axes, label="log10 of the largest modulation")
        axes.contour(frequency, duty, shown, levels=[np.log10(below)], colors=RED, linewidths=1.0, linestyles="solid")
        axes.plot((1.0 - duty) / min(exposures), duty, color=ORANGE, lw=1.6, label="pulses are missed to the left")
        axes.plot([], [], color=RED, lw=1.0, label=f"modulation {below:.3g}")
        shutters = ", ".join(f"{time * 1e3:.4g}" for time in exposures)
        axes.set(xlabel="frequency of the lamp / Hz", ylabel="duty", xscale="log", xlim=bounds)
        axes.set_title(f"Shutters of {shutters} ms")
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.13), ncols=2, fontsize=8)
