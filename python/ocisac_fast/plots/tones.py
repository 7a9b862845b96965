"""Plots of a column's spectrum with the fitted tone, before and after equalisation; of one value over recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.camera.linear_light import linear_light
from ocisac_fast.light.response import exposure_response
from ocisac_fast.plots.picture import BLACK, BLUE, ORANGE, RED, FilePath, figure_of, panels
from ocisac_fast.tones.equalization import equalize

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_gain(
    columns: npt.NDArray[Any],
    camera: Camera,
    *,
    frequency: float,
    gain: float,
    waveform: str = "tone",
    path: FilePath | None = None,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Plot the spectrum with the fitted tone and the exposure's response, and the column before and after equalisation.

    Args:
        path, ax: file to write (``.png``, ``.pdf``, ``.svg``), two axes to draw in; None: none, a new figure's.
        columns: (rows, columns) of one frame, stored values; their mean is plotted.
        camera: as for ``tone_gain``; a row time of 1 shows cycles per row.
        frequency, gain: of the fitted tone.
        waveform: ``"tone"`` or ``"square"``, whose fundamental is 4/pi of its mean.
    """
    light = linear_light(columns, camera).mean(axis=1)
    with panels(path, ax, (9.0, 6.5), (2, 1)) as (top, bottom):
        _draw_spectrum(top, light, camera, frequency, gain, waveform)
        _draw_equalized(bottom, light, camera, frequency)
    return figure_of(top)


def _draw_equalized(axes: Axes, light: npt.NDArray[np.float64], camera: Camera, frequency: float) -> None:
    """Draw about 12 cycles of a column, and of the equalised column where the exposure is known."""
    in_rows = camera.row_time is None
    time = np.arange(light.size) * (1.0 if in_rows else camera.row_period * 1e3)
    axes.plot(time, light, ".-", color=BLUE, lw=0.8, ms=3, label="column")
    if camera.exposure:
        restored = equalize(light, Camera(camera.row_time, camera.exposure), method="wiener")
        axes.plot(time, restored, color=RED, lw=1.1, label="equalised (Wiener)")
    axes.set(
        xlabel="row" if in_rows else "time of the row / ms",
        ylabel="light / DN",
        title="Column before and after equalisation" if camera.exposure else "Column (its exposure is not known)",
        xlim=(0.0, _several_cycles(time, frequency * camera.row_period)),
    )
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, ncols=2)


def _several_cycles(time: npt.NDArray[Any], cycles_per_row: float) -> float:
    """End of the axis: all rows, or about 12 cycles."""
    rows = int(min(time.size - 1, 12.0 / max(cycles_per_row, 1e-9)))  # a NaN shows all rows
    return float(time[max(rows, 1)]) if time.size > 1 else 1.0


def _draw_spectrum(
    axes: Axes, light: npt.NDArray[np.float64], camera: Camera, frequency: float, gain: float, waveform: str
) -> None:
    """Draw amplitude over mean on a logarithmic scale."""
    rows = light.size
    spectrum = _core.amplitude_spectrum(light)
    frequencies = np.fft.rfftfreq(4 * rows, camera.row_period)
    in_rows = camera.row_time is None
    scale = 1.0 if in_rows else 1e-3
    factor = 4.0 / np.pi if waveform == "square" else 1.0
    axes.semilogy(frequencies * scale, np.maximum(spectrum / factor, 1e-7), color=BLUE, lw=0.9, label="column")
    if camera.exposure is not None:
        response = np.abs(exposure_response(frequencies, camera.exposure))
        axes.semilogy(
            frequencies * scale, np.maximum(response, 1e-7), color=BLACK, lw=1.0, ls="--", label="|sinc(f T_e)|"
        )
    if np.isfinite(gain):
        _mark_tone(axes, camera, frequency, gain)
    axes.set(
        xlabel="cycles per row" if in_rows else "frequency / kHz",
        ylabel="gain",
        title="Spectrum and fitted tone",
        xlim=(0.0, 0.5 * scale / camera.row_period),
        ylim=(max(float(np.median(spectrum)) * 0.1, 1e-6), 2.0),
    )
    axes.legend(loc="upper right")


def _mark_tone(axes: Axes, camera: Camera, frequency: float, gain: float) -> None:
    """Mark the fitted tone at its alias."""
    in_rows = camera.row_time is None
    folded = abs((frequency * camera.row_period + 0.5) % 1.0 - 0.5) / camera.row_period
    label = f"fit: gain {gain:.4f} at " + (f"{frequency:.6g} cycles a row" if in_rows else f"{frequency:.2f} Hz")
    axes.semilogy([folded * (1.0 if in_rows else 1e-3)], [max(gain, 1e-7)], "o", color=RED, ms=7, label=label)


def plot_recordings(
    values: npt.NDArray[np.float64],
    spreads: npt.NDArray[np.float64],
    *,
    label: str,
    flags: Mapping[str, int],
    path: FilePath | None = None,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Plot a value of each recording with its standard error, and the number of recordings with each flag.

    Args:
        values, spreads: (recordings,) in the order of their paths; NaN: unknown.
        path: ``.png``, ``.pdf`` or ``.svg``; None: not written.
        ax: one, or with flags two, axes to draw in; None: of a new figure.
        label: name of the value.
        flags: number of recordings by name of the flag.
    """
    from matplotlib.ticker import MaxNLocator

    names = sorted(flags, key=lambda name: flags[name])
    ratios = {"height_ratios": (2, 1)} if names else {}
    with panels(path, ax, (9.0, 6.0 if names else 4.0), (1 + bool(names), 1), **ratios) as axes:
        place = np.arange(1, len(values) + 1)
        errors = np.where(np.isfinite(spreads), spreads, 0.0)
        axes[0].errorbar(place, values, yerr=errors, fmt=".", color=BLUE, ms=4, lw=0.8)
        axes[0].set(xlabel="recording, in the order of paths", ylabel=label, title="Recordings, with standard errors")
        axes[0].xaxis.set_major_locator(MaxNLocator(integer=True))
        if names:
            axes[1].barh(names, [flags[name] for name in names], color=ORANGE)
            axes[1].set(xlabel="recordings", title="Flags")
            axes[1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure_of(axes[0])
