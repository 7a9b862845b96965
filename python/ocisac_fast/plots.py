"""Pictures of results, drawn without a display (matplotlib, ``ocisac-fast[cli]``).

Colours are those of Okabe and Ito, which the colour-blind can tell apart.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.files import FileError, atomic_path
from ocisac_fast.light.response import exposure_response
from ocisac_fast.reference.light import linear_light

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ocisac_fast.lights.sources import LightSource
    from ocisac_fast.receiver.blind import Received
    from ocisac_fast.sensing.region import SensedRegion

BLACK, ORANGE, SKY, GREEN, BLUE, RED, PURPLE = (
    "#222222",
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#0072B2",
    "#D55E00",
    "#CC79A7",
)
_SUFFIXES = (".png", ".pdf", ".svg")
_LOOK: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": "medium",
    "axes.titleweight": "bold",
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.12,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": "small",
    "svg.hashsalt": "ocisac",
}


@contextlib.contextmanager
def picture(path: str | os.PathLike[str], width: float, height: float) -> Iterator[Figure]:
    """A figure of so many inches in the package's look, written whole at the end: ``.png``, ``.pdf`` or ``.svg``.

    Raises:
        FileError: another suffix, or matplotlib is missing.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        raise FileError(f"{os.fspath(path)}: suffix: got {suffix!r}, allowed: {', '.join(_SUFFIXES)}")
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise FileError("plots need matplotlib: pip install 'ocisac-fast[cli]'") from error
    with matplotlib.rc_context(_LOOK):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=120)


def plot_gain(
    path: str | os.PathLike[str],
    columns: npt.NDArray[Any],
    camera: Camera,
    frequency: float,
    gain: float,
    waveform: str = "tone",
) -> None:
    """Spectrum with the fitted tone and the exposure's response; the column before and after equalisation.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        columns: (rows, columns) of one frame, stored values; their mean is shown.
        camera: as for ``tone_gain``; a row time of 1 shows cycles per row.
        frequency, gain: of the fitted tone.
        waveform: ``"tone"`` or ``"square"``, whose fundamental is 4/pi of its mean.
    """
    light = linear_light(columns, camera).mean(axis=1)
    with picture(path, 9.0, 6.5) as figure:
        top, bottom = figure.subplots(2)
        _draw_spectrum(top, light, camera, frequency, gain, waveform)
        _draw_equalized(bottom, light, camera, frequency)


def _draw_equalized(axes: Axes, light: npt.NDArray[np.float64], camera: Camera, frequency: float) -> None:
    """About 12 cycles of a column, and of it equalised where the exposure is known."""
    in_rows = camera.row_time == 1.0
    time = np.arange(light.size) * (1.0 if in_rows else camera.row_time * 1e3)
    axes.plot(time, light, ".-", color=BLUE, lw=0.8, ms=3, label="column")
    if camera.exposure:
        from ocisac_fast.tones import equalize

        restored = equalize(light, Camera(camera.row_time, camera.exposure), "wiener")
        axes.plot(time, restored, color=RED, lw=1.1, label="equalised (Wiener)")
    axes.set(
        xlabel="row" if in_rows else "time of the row / ms",
        ylabel="light / DN",
        title="Column before and after equalisation" if camera.exposure else "Column (its exposure is not known)",
        xlim=(0.0, _several_cycles(time, frequency * camera.row_time)),
    )
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, ncols=2)


def _several_cycles(time: npt.NDArray[Any], cycles_per_row: float) -> float:
    """The end of the axis: all rows, or as many as hold about 12 cycles."""
    rows = int(min(time.size - 1, 12.0 / max(cycles_per_row, 1e-9)))  # a NaN shows all rows
    return float(time[max(rows, 1)]) if time.size > 1 else 1.0


def _draw_spectrum(
    axes: Axes, light: npt.NDArray[np.float64], camera: Camera, frequency: float, gain: float, waveform: str
) -> None:
    """Amplitude over mean on a logarithmic scale, through a Hann window that keeps the mean from leaking."""
    rows = light.size
    window = np.hanning(rows + 2)[1:-1]
    length = 4 * rows  # shows the peak between two bins
    mean = light.mean() if light.mean() > 0.0 else 1.0
    spectrum = 2.0 * np.abs(np.fft.rfft((light - light.mean()) * window, length)) / (window.sum() * mean)
    frequencies = np.fft.rfftfreq(length, camera.row_time)
    in_rows = camera.row_time == 1.0
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
        xlim=(0.0, 0.5 * scale / camera.row_time),
        ylim=(max(float(np.median(spectrum)) * 0.1, 1e-6), 2.0),
    )
    axes.legend(loc="upper right")


def _mark_tone(axes: Axes, camera: Camera, frequency: float, gain: float) -> None:
    """The fitted tone, where the rows show it."""
    in_rows = camera.row_time == 1.0
    folded = abs((frequency * camera.row_time + 0.5) % 1.0 - 0.5) / camera.row_time
    label = f"fit: gain {gain:.4f} at " + (f"{frequency:.6g} cycles a row" if in_rows else f"{frequency:.2f} Hz")
    axes.semilogy([folded * (1.0 if in_rows else 1e-3)], [max(gain, 1e-7)], "o", color=RED, ms=7, label=label)


def exposure_choices(
    f_comm: float, f_sense: float, weights: Any, bounds: Any
) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Method, its ``BestExposure`` and its mark, of search, the paper's closed form and ours."""
    from ocisac_fast.exposure import best_exposure

    for method, marker, colour, size in (
        ("search", "s", SKY, 12),
        ("closed-form", "D", ORANGE, 8),
        ("exact", "o", RED, 6),
    ):
        limits = None if method == "closed-form" else bounds
        best = best_exposure(f_comm, f_sense, method=method, weights=weights, bounds=limits)  # type: ignore[arg-type]
        yield method, best, {"marker": marker, "color": colour, "ms": size, "ls": ""}


def plot_exposure(
    path: str | os.PathLike[str],
    f_comm: float,
    f_sense: float,
    weights: tuple[float, float] = (1.0, 1.0),
    bounds: tuple[float, float] | None = None,
) -> None:
    """The objective over the exposure time with the points that the methods choose.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        f_comm, f_sense, weights, bounds: as for ``best_exposure``.
    """
    from ocisac_fast.exposure import exposure_objective

    shortest, longest = bounds or (0.0, 1.0 / min(f_comm, f_sense))
    exposures = np.linspace(shortest, longest, 4001)
    objective = np.asarray(exposure_objective(exposures, f_comm, f_sense, weights))
    with picture(path, 8.0, 4.2) as figure:
        axes = figure.subplots()
        axes.plot(exposures * 1e3, objective * 1e3, color=BLUE, lw=1.4)
        for method, best, style in exposure_choices(f_comm, f_sense, weights, bounds):
            label = f"{method}: {best.exposure * 1e3:.4f} ms"
            axes.plot(best.exposure * 1e3, best.objective * 1e3, label=label, **style)
        axes.set(
            xlabel="exposure time / ms",
            ylabel="objective Y / ms",
            title=f"Communication {f_comm:g} Hz and sensing {f_sense:g} Hz",
        )
        axes.legend(loc="best")


def plot_received(path: str | os.PathLike[str], frame: npt.NDArray[Any], camera: Camera, received: Received) -> None:
    """The combined column of a frame with the chips and levels that were detected in it.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        frame: (rows, columns) or (rows, columns, channels), stored values.
        camera: as for ``receive``.
        received: what ``receive`` made of the frame.
    """
    rows = frame.shape[0]
    lines = min(4, max(1, rows // 200))
    edges = np.linspace(0, rows, lines + 1)
    found = f"{len(received.bits)} chips of {received.rows_per_chip:.4g} rows" if received.bits else "no chips found"
    with picture(path, 11.0, 1.2 + 1.5 * lines) as figure:
        every = figure.subplots(lines, squeeze=False)[:, 0]
        for axes, first, last in zip(every, edges[:-1], edges[1:], strict=True):
            draw_chips(axes, frame, camera, received, first, last)
        every[0].set_title(f"Combined column: {found}")
        every[-1].set_xlabel("row")


def draw_chips(
    axes: Axes, frame: npt.NDArray[Any], camera: Camera, received: Received, first: float, last: float
) -> None:
    """Rows first to last of the combined column, the threshold, and a 0 or 1 over every chip."""
    picture = frame[..., received.channel] if frame.ndim == 3 else frame
    light = linear_light(picture, camera)
    used = received.weights if received.weights.sum() > 0.0 else np.full(light.shape[1], 1.0 / light.shape[1])
    signal = light @ used
    axes.plot(np.arange(signal.size), signal, color=BLUE, lw=1.1)
    span = float(np.ptp(signal)) or 1.0
    starts = received.phase + np.arange(len(received.bits) + 1) * received.rows_per_chip
    if received.bits:
        middle = received.levels.mean(axis=0)
        axes.step(starts, np.append(middle, middle[-1]), where="post", color=RED, lw=1.0, ls="--")
    for bit, begin, end in zip(received.bits, starts[:-1], starts[1:], strict=True):
        centre = 0.5 * (begin + end)
        if bit == "1":
            axes.axvspan(begin, end, color=ORANGE, alpha=0.18, lw=0.0)
        if first <= centre < last:
            axes.text(centre, signal.max() + 0.06 * span, bit, ha="center", va="bottom", fontsize="x-small")
    axes.grid(False)
    axes.set(xlim=(first, last), ylim=(signal.min() - 0.08 * span, signal.max() + 0.3 * span), ylabel="light / DN")


def plot_sources(path: str | os.PathLike[str], frame: npt.NDArray[Any], sources: list[LightSource]) -> None:
    """A frame with the box, number and frequency of every light found in it; reflections dashed.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        frame: (rows, columns), stored values.
        sources: what ``detect_sources`` found in it.
    """
    rows, columns = frame.shape
    step = max(1, max(rows, columns) // 2000)
    height = float(np.clip(9.0 * rows / columns, 3.0, 12.0))
    with picture(path, 9.0, height) as figure:
        from matplotlib.patches import Rectangle

        axes = figure.subplots()
        extent = (0, columns, rows, 0)
        axes.imshow(frame[::step, ::step], cmap="gray", extent=extent, aspect="equal", interpolation="nearest")
        for index, source in enumerate(sources):
            colour = ORANGE if source.reflection_of is None else BLUE
            style = "-" if source.reflection_of is None else "--"
            corner = (source.x, source.y)
            axes.add_patch(Rectangle(corner, source.width, source.height, fill=False, ec=colour, ls=style, lw=1.2))
            text = f"{index}: {source.frequency:.4g} Hz"
            axes.annotate(text, corner, (0, 3), textcoords="offset points", color=colour, fontsize=8)
        axes.set_xlabel("column")
        axes.set_ylabel("row, in time order")


def plot_regions(path: str | os.PathLike[str], frame: npt.NDArray[Any], regions: Sequence[SensedRegion]) -> None:
    """A frame with the box of every region, what it is, and an arrow where its motion is known.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        frame: (rows, columns), stored values.
        regions: what ``sense`` found in it.
    """
    rows, columns = frame.shape
    step = max(1, max(rows, columns) // 2000)
    with picture(path, 9.0, float(np.clip(9.0 * rows / columns, 3.0, 12.0))) as figure:
        axes = figure.subplots()
        extent = (0, columns, rows, 0)
        axes.imshow(frame[::step, ::step], cmap="gray", extent=extent, aspect="equal", interpolation="nearest")
        for index, region in enumerate(regions):
            _draw_region(axes, index, region)
        axes.grid(False)
        axes.set_xlabel("column")
        axes.set_ylabel("row, in time order")


def _draw_region(axes: Axes, index: int, region: SensedRegion) -> None:
    from matplotlib.patches import Rectangle

    colour = {"light": ORANGE, "moving": SKY, "still": GREEN}.get(region.kind, PURPLE)
    style = "--" if region.flags & (Flag.AMBIGUOUS_KIND | Flag.AMBIGUOUS_MOTION) else "-"
    corner = (region.x, region.y)
    axes.add_patch(Rectangle(corner, region.width, region.height, fill=False, ec=colour, ls=style, lw=1.6))
    frequency = region.frequency if region.kind == "light" else region.motion_frequency
    lines = [f"{index}: {region.kind}, {frequency:.5g} Hz", f"gain {region.gain:.4f} ± {region.gain_std:.1g}"]
    if np.isfinite(region.speed) and region.kind == "moving":
        lines.append(f"{region.speed:.4g} m/s")
    box = {"boxstyle": "square,pad=0.2", "fc": "black", "ec": "none", "alpha": 0.6}
    at = (region.x + 0.02 * region.width, region.y + 0.02 * region.height)
    axes.annotate(
        "\n".join(lines), at, (3, -3), textcoords="offset points", color=colour, fontsize=8, va="top", bbox=box
    )
    if region.kind == "moving" and region.direction:
        x, y = region.x + 0.5 * region.width, region.y + 0.6 * region.height
        along = abs(region.cycles_per_column) <= 4.0 * region.cycles_per_column_std
        across, down = (0.0, 0.25 * region.height) if along else (0.25 * region.width, 0.0)
        across, down = across * region.direction, down * region.direction
        axes.annotate(
            "",
            (x + across, y + down),
            (x - across, y - down),
            arrowprops={"arrowstyle": "->", "color": colour, "lw": 2.0},
        )
