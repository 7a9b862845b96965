"""Pictures of the exposure's choice: the fronts between communication and sensing, and the closed loop."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np

from ocisac_fast.control.drive import LIGHT_FREQUENCY, Drive
from ocisac_fast.exposure.choice import best_exposure
from ocisac_fast.exposure.controller import best_noisy_exposure
from ocisac_fast.exposure.fronts import exposure_front
from ocisac_fast.plots import BLACK, BLUE, GREEN, ORANGE, RED, SKY, exposure_choices, picture

_NOISE_CYCLES = 0.1  # T_n of the second front, in cycles of the slower tone
_COLOURS = (RED, ORANGE, SKY)
_DECIBEL_FLOOR = -30.0


def plot_front(
    path: str | os.PathLike[str],
    f_comm: float,
    f_sense: float,
    weights: tuple[float, float] = (1.0, 1.0),
    bounds: tuple[float, float] | None = None,
    noise_exposure: float | None = None,
) -> None:
    """T |sinc| of communication against that of sensing, and the signal-to-noise ratios where noise and light count.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        f_comm, f_sense, weights, bounds: as for ``best_exposure``.
        noise_exposure: T_n of the second front, s; None: a tenth of a cycle of the slower tone.
    """
    slower = min(f_comm, f_sense)
    noise = _NOISE_CYCLES / slower if noise_exposure is None else noise_exposure
    with picture(path, 11.0, 5.6) as figure:
        left, right = figure.subplots(1, 2)
        _draw_front(left, f_comm, f_sense, weights, bounds)
        _draw_noisy_front(right, f_comm, f_sense, weights, bounds, noise)


def _draw_front(axes: Any, f_comm: float, f_sense: float, weights: Any, bounds: Any) -> None:
    front = exposure_front(f_comm, f_sense, bounds=bounds)
    axes.plot(front.comm * 1e3, front.sense * 1e3, color=BLUE, lw=0.9, label="all exposures")
    axes.plot(
        np.where(front.efficient, front.comm, np.nan) * 1e3,
        np.where(front.efficient, front.sense, np.nan) * 1e3,
        color=GREEN,
        lw=3.5,
        label="efficient",
    )
    for method, best, style in exposure_choices(f_comm, f_sense, weights, bounds):
        point = [best.exposure * abs(np.sinc(f * best.exposure)) * 1e3 for f in (f_comm, f_sense)]
        label = {"exact": "ours", "closed-form": "the paper's"}.get(method, method)
        axes.plot(*point, label=f"{label}: {best.exposure * 1e3:.3f} ms", **style)
    axes.set(
        xlabel=f"T·G of communication at {f_comm:g} Hz / ms",
        ylabel=f"T·G of sensing at {f_sense:g} Hz / ms",
        title="Amplitudes (the terms of eq. 18)",
    )
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)


def _draw_noisy_front(axes: Any, f_comm: float, f_sense: float, weights: Any, bounds: Any, noise: float) -> None:
    """Signal-to-noise ratios over those of an exposure T_n without loss; darker points are brighter pictures."""
    longest = (0.0, 1.0 / min(f_comm, f_sense)) if bounds is None else bounds
    front = exposure_front(f_comm, f_sense, bounds=longest, noise_exposure=noise)

    def decibel(amplitude: Any) -> Any:
        level = 20.0 * np.log10(np.maximum(amplitude, 1e-300) / noise)
        return np.where(level < _DECIBEL_FLOOR, np.nan, level)

    points = axes.scatter(
        decibel(front.comm), decibel(front.sense), c=front.exposure * 1e3, s=5, cmap="viridis_r", zorder=2
    )
    axes.get_figure().colorbar(points, ax=axes, label="exposure / ms, in proportion to the mean level")
    low = max(longest[0], 1e-6 * longest[1])
    best: Any = best_noisy_exposure((f_comm, f_sense), weights, (low, longest[1]), noise_exposure=noise)
    closed: Any = best_exposure(f_comm, f_sense, method="closed-form")
    for chosen, marker, colour, label in ((closed, "D", ORANGE, "the paper's"), (best, "o", RED, "ours")):
        factor = chosen.exposure / math.sqrt(1.0 + chosen.exposure / noise)
        point = [float(decibel(factor * abs(np.sinc(f * chosen.exposure)))) for f in (f_comm, f_sense)]
        axes.plot(*point, marker, color=colour, ms=8, label=f"{label}: {chosen.exposure * 1e3:.3f} ms")
    axes.set(
        xlabel="SNR of communication / dB",
        ylabel="SNR of sensing / dB",
        title=f"With noise: shot = read at {noise * 1e3:.3g} ms",
    )
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)


def plot_drive(path: str | os.PathLike[str], drive: Drive) -> None:
    """The closed loop over time: the scene, the exposures, both gains, and what of the objective each keeps.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        drive: of ``drive_past_light``.
    """
    labels = ("controller", "closed form (paper)", "best fixed exposure")
    with picture(path, 10.0, 11.0) as figure:
        scene, exposure, comm, sense, objective = figure.subplots(5, sharex=True)
        scene.plot(drive.time, drive.sense_frequency, color=BLACK, lw=1.0, label="texture times speed")
        scene.plot(drive.time, drive.seen[1], ".", color=GREEN, ms=3, label="as measured")
        scene.axhline(LIGHT_FREQUENCY, color=BLUE, lw=1.0, ls="--", label="traffic light")
        scene.set(ylabel="frequency / Hz", title="A car brakes for a modulated traffic light and drives on")
        for k in (2, 1, 0):
            look = {"color": _COLOURS[k], "lw": 1.6 if k == 0 else 1.1, "label": labels[k]}
            exposure.plot(drive.time, drive.exposure[k] * 1e3, **look)
            comm.plot(drive.time, drive.gains[k, 0], **look)
            sense.plot(drive.time, drive.gains[k, 1], **look)
            objective.plot(drive.time, drive.true[k], **look)
        exposure.set(ylabel="exposure / ms", yscale="log")
        low, high = exposure.get_ylim()
        ticks = [tick for tick in (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0) if low <= tick <= high]
        exposure.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        comm.set(ylabel="gain of the light", ylim=(0, 1.02))
        sense.set(ylabel="gain of the texture", ylim=(0, 1.02))
        objective.set(ylabel="objective / largest", xlabel="time / s", ylim=(None, 1.02))
        for axes in (scene, exposure):
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
