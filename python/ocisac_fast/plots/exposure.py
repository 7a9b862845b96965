"""Plots of the objective over the exposure, of the trade-off it makes, and of a calibration by pulses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ocisac_fast.exposure.choice import best_exposure, exposure_objective
from ocisac_fast.exposure.controller import best_noisy_exposure
from ocisac_fast.exposure.fronts import exposure_front
from ocisac_fast.exposure.pulses import PulseCalibration, box_ramp
from ocisac_fast.plots.picture import BLACK, BLUE, GREEN, ORANGE, RED, SKY, FilePath, figure_of, panels, series

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NOISE_CYCLES = 0.1  # T_n of the second front, in cycles of the slower tone
_DECIBEL_FLOOR = -30.0


def plot_exposure(
    f_comm: float,
    f_sense: float,
    *,
    path: FilePath | None = None,
    ax: Axes | None = None,
    weights: tuple[float, float] = (1.0, 1.0),
    bounds: tuple[float, float] | None = None,
) -> Axes:
    """Plot the objective over the exposure time with the choices of the methods.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), axes to draw in; None: none, those of a new figure.
        f_comm, f_sense, weights, bounds: as for ``best_exposure``.
    """
    shortest, longest = bounds or (0.0, 1.0 / min(f_comm, f_sense))
    exposures = np.linspace(shortest, longest, 4001)
    objective = np.asarray(exposure_objective(exposures, f_comm, f_sense, weights=weights))
    with panels(path, ax, (8.0, 4.2)) as (axes,):
        axes.plot(exposures * 1e3, objective * 1e3, color=BLUE, lw=1.4)
        for method, best, style in _choices(f_comm, f_sense, weights, bounds):
            label = f"{method}: {best.exposure * 1e3:.4f} ms"
            axes.plot(best.exposure * 1e3, best.objective * 1e3, label=label, **style)
        axes.set(
            xlabel="exposure time / ms",
            ylabel="objective Y / ms",
            title=f"Communication {f_comm:g} Hz and sensing {f_sense:g} Hz",
        )
        axes.legend(loc="best")
    return axes


def _choices(f_comm: float, f_sense: float, weights: Any, bounds: Any) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Method, ``BestExposure`` and marker of search, the paper's closed form and the exact optimum."""
    for method, marker, colour, size in (
        ("search", "s", SKY, 12),
        ("closed-form", "D", ORANGE, 8),
        ("exact", "o", RED, 6),
    ):
        limits = None if method == "closed-form" else bounds
        best = best_exposure(f_comm, f_sense, method=method, weights=weights, bounds=limits)  # type: ignore[arg-type]
        yield method, best, {"marker": marker, "color": colour, "ms": size, "ls": ""}


def plot_front(
    f_comm: float,
    f_sense: float,
    *,
    path: FilePath | None = None,
    ax: Sequence[Axes] | None = None,
    weights: tuple[float, float] = (1.0, 1.0),
    bounds: tuple[float, float] | None = None,
    noise_exposure: float | None = None,
) -> Figure:
    """Plot T |sinc| of communication over that of sensing, and the signal-to-noise ratios with noise.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), two axes to draw in; None: none, a new figure's.
        f_comm, f_sense, weights, bounds: as for ``best_exposure``.
        noise_exposure: T_n of the second front, s; None: a tenth of a cycle of the slower tone.
    """
    slower = min(f_comm, f_sense)
    noise = _NOISE_CYCLES / slower if noise_exposure is None else noise_exposure
    with panels(path, ax, (11.0, 5.6), (1, 2)) as (left, right):
        _draw_front(left, f_comm, f_sense, weights, bounds)
        _draw_noisy_front(right, f_comm, f_sense, weights, bounds, noise)
    return figure_of(left)


def _draw_front(axes: Axes, f_comm: float, f_sense: float, weights: Any, bounds: Any) -> None:
    front = exposure_front(f_comm, f_sense, bounds=bounds)
    axes.plot(front.comm * 1e3, front.sense * 1e3, color=BLUE, lw=0.9, label="all exposures")
    axes.plot(
        np.where(front.efficient, front.comm, np.nan) * 1e3,
        np.where(front.efficient, front.sense, np.nan) * 1e3,
        color=GREEN,
        lw=3.5,
        label="efficient",
    )
    for method, best, style in _choices(f_comm, f_sense, weights, bounds):
        point = [best.exposure * abs(np.sinc(f * best.exposure)) * 1e3 for f in (f_comm, f_sense)]
        label = {"exact": "ours", "closed-form": "the paper's"}.get(method, method)
        axes.plot(*point, label=f"{label}: {best.exposure * 1e3:.3f} ms", **style)
    axes.set(
        xlabel=f"T·G of communication at {f_comm:g} Hz / ms",
        ylabel=f"T·G of sensing at {f_sense:g} Hz / ms",
        title="Amplitudes (the terms of eq. 18)",
    )
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)


def _draw_noisy_front(axes: Axes, f_comm: float, f_sense: float, weights: Any, bounds: Any, noise: float) -> None:
    """Draw signal-to-noise ratios relative to an exposure T_n without loss; darker points are brighter pictures."""
    longest = (0.0, 1.0 / min(f_comm, f_sense)) if bounds is None else bounds
    front = exposure_front(f_comm, f_sense, bounds=longest, noise_exposure=noise)

    def decibel(amplitude: Any) -> Any:
        level = 20.0 * np.log10(np.maximum(amplitude, 1e-300) / noise)
        return np.where(level < _DECIBEL_FLOOR, np.nan, level)

    points = axes.scatter(
        decibel(front.comm), decibel(front.sense), c=front.exposure * 1e3, s=5, cmap="viridis_r", zorder=2
    )
    figure_of(axes).colorbar(points, ax=axes, label="exposure / ms, in proportion to the mean level")
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


def plot_pulses(
    result: PulseCalibration,
    frequency: float,
    duties: Sequence[float],
    *,
    path: FilePath | None = None,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Plot the residuals of lit rows over the lamp's pulse width, and the measured ramps with the fitted box.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), two axes to draw in; None: none, a new figure's.
        result: from ``calibrate_pulses``.
        frequency, duties: as given to it.
    """
    widths = np.asarray(duties) / frequency
    colours = [one["color"] for one in series(len(duties))]
    with panels(path, ax, (11.0, 4.2), (1, 2)) as (left, right):
        fitted = (widths + result.offset) / result.row_time
        for k, (rows, one) in enumerate(zip(result.rows, result.bands, strict=True)):
            colour = colours[k]
            left.errorbar(widths[k] * 1e3, rows - fitted[k], one.whole.std(), fmt="o", color=colour, capsize=3)
            offsets = np.linspace(-12, 12, one.ramps.shape[1])
            for side, style in ((0, "-"), (1, "--")):
                label = f"duty {duties[k]:.0%}, {('rise', 'fall')[side]}"
                right.plot(offsets, np.median(one.ramps[side::2], axis=0), style, color=colour, lw=1.0, label=label)
        box = result.exposure / result.row_time
        offsets = np.linspace(-12, 12, 481)
        right.plot(offsets, box_ramp(offsets, box, result.blur), color=BLACK, lw=1.6, label="box and blur")
        right.plot(offsets, np.clip(offsets / box + 0.5, 0, 1), color=RED, lw=1.0, ls=":", label="box alone")
        left.axhline(0.0, color=BLACK, lw=0.8)
        left.set(
            xlabel="pulse width / ms",
            ylabel="lit rows less fit",
            title=f"T_r = {result.row_time * 1e6:.2f} ± {result.row_time_std * 1e6:.2f} µs",
        )
        title = f"Ramps: a box of {box:.1f} rows, blurred by {result.blur:.1f}"
        right.set(xlabel="rows from half height", ylabel="light", xlim=(-9, 9), title=title)
        right.legend(fontsize=7)
    return figure_of(left)
