"""The paper's figures, each with the paper's values, theory, and measurements."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ocisac_fast import demo
from ocisac_fast.exposure.choice import best_exposure, exposure_objective
from ocisac_fast.light.response import exposure_response
from ocisac_fast.plots import BLACK, BLUE, GREEN, ORANGE, PURPLE, RED, picture
from ocisac_fast.tones.gain import tone_gain
from studies.reproduction import choices, testbed
from studies.reproduction.gains import GainResult
from studies.reproduction.testbed import Setting

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

_WHITE = {"color": "white", "pad": 1.0, "alpha": 0.8}  # background of text on lines
_EXPOSURE_COLOURS = dict(zip(demo.EXPOSURES, (GREEN, ORANGE, BLUE, PURPLE), strict=True))


@dataclass(frozen=True)
class Figure:
    """One figure of the paper."""

    size: tuple[float, float]  # inches
    draw: Callable[[Canvas, Sequence[GainResult]], None]  # on a canvas, from the results of all 24 settings
    needs_gains: bool = False  # True if it needs them


def _response_and_lines(canvas: Canvas, results: Sequence[GainResult]) -> None:
    """Figure 5: both tones of one pixel under the response of the exposure."""
    exposure, light, grating = 622e-6, 700.0, testbed.true_grating(100.0)
    sensing = Setting("sensing", 100.0, exposure)
    communication = Setting("communication", light, exposure)
    both = [testbed.record(each, 24, 0)[:, :, 0].astype(float) for each in (communication, sensing)]
    pixel = (both[0] + both[1]) / 2.0  # half of the light from each
    tones = np.array([light, sensing.frequency])
    mean_of_one = demo.SWING / 4.0
    columns = pixel[..., np.newaxis]
    found = tone_gain(columns, communication.camera, tones, waveform="square", background=mean_of_one)
    amplitude = found.gain.mean(axis=(1, 2))
    axes = canvas.subplots()
    f = np.linspace(1.0, 4000.0, 2000)
    axes.plot(f, np.abs(exposure_response(f, exposure)), color=BLACK, lw=1.2, label="|H(f)| = |sinc(f Tₑ)|")
    names = (f"communication, f_c = {light:.0f} Hz", f"sensing, f_x v = {sensing.frequency:.1f} Hz")
    for tone, value, name, colour in zip(tones, amplitude, names, (BLUE, ORANGE), strict=True):
        axes.vlines(tone, 0.0, value, color=colour, lw=3.0)
        axes.plot(tone, value, "o", color=colour, label=f"{name}: measured {value:.4f}")
        theory = abs(exposure_response(tone, exposure))
        axes.annotate(f"theory {theory:.4f}", (tone, value), (12, 4), textcoords="offset points", color=colour)
    axes.axvline(1.0 / exposure, color=RED, lw=0.9, ls="--")
    axes.text(1.0 / exposure + 15.0, 0.93, "first null 1/Tₑ", color=RED, fontsize="small")
    axes.set(
        xlabel="frequency / Hz",
        ylabel="amplitude over the mean",
        title=f"Figure 5: a pixel under two lights, exposure {1e6 * exposure:.0f} µs, grating {grating:.2f} /m",
        xlim=(0.0, 4000.0),
        ylim=(0.0, 1.04),
    )
    axes.legend(loc="upper right")


def _objective_over_exposure(canvas: Canvas, results: Sequence[GainResult]) -> None:
    """Figure 6: the response at several exposures, and the resulting sum of both tones."""
    light, motion = 500.0, 174.68
    left, right = canvas.subplots(1, 2)
    f = np.linspace(1.0, 1200.0, 1500)
    for exposure, colour in zip((622e-6, 1202e-6, 2404e-6), (GREEN, ORANGE, BLUE), strict=True):
        left.plot(f, np.abs(exposure_response(f, exposure)), color=colour, label=f"Tₑ = {1e6 * exposure:.0f} µs")
        for tone in (motion, light):
            left.plot(tone, abs(exposure_response(tone, exposure)), "o", color=colour, ms=5.0)
    for tone, name in ((motion, "f_x v"), (light, "f_c")):
        left.axvline(tone, color=BLACK, lw=0.8, ls=":")
        left.text(tone + 8.0, 1.0, name, fontsize="small")
    left.set(xlabel="frequency / Hz", ylabel="gain", title="Figure 6: the response moves with Tₑ", ylim=(0.0, 1.06))
    left.legend(loc="upper right")
    time = np.linspace(1e-6, 1.0 / motion, 2000)
    right.plot(1e3 * time, 1e3 * exposure_objective(time, light, motion), color=BLACK, label="Y(Tₑ), magnitudes")
    signed = choices.signed_objective(time, light, motion)
    right.plot(1e3 * time, 1e3 * signed, color=RED, lw=0.9, ls="--", label="eq. 18 as printed")
    best = best_exposure(light, motion)
    right.plot(1e3 * best.exposure, 1e3 * best.objective, "s", color=BLUE, label="exact optimum")
    right.set(xlabel="exposure time / ms", ylabel="Y / ms", title=f"{light:.0f} Hz and {motion:.1f} Hz")
    right.legend(loc="lower left")


def _pictures(canvas: Canvas, results: Sequence[GainResult]) -> None:
    """Figure 9: stored pictures, and a column of each."""
    communication = [Setting("communication", 200.0, exposure) for exposure in (2404e-6, 1202e-6, 622e-6)]
    sensing = [Setting("sensing", grating, 1202e-6) for grating in demo.GRATINGS]
    rows = canvas.subplots(4, 3, height_ratios=(1.3, 1.0, 1.3, 1.0))
    for k, (kind, chosen) in enumerate((("a", communication), ("b", sensing))):
        for column, setting in enumerate(chosen):
            frame = testbed.record(setting, 1, 0, demo.COLUMNS)[0]
            top, below = rows[2 * k, column], rows[2 * k + 1, column]
            top.imshow(frame, cmap="gray", vmin=0, vmax=255, aspect="auto", interpolation="nearest")
            top.grid(False)
            top.set(xticks=[], ylabel="row" if column == 0 else "")
            name = f"{setting.frequency:.1f} Hz, {1e6 * setting.exposure:.0f} µs"
            top.set_title(f"Figure 9{kind} ({'ABC'[column]}): {name}")
            below.plot(frame[:, demo.COLUMNS // 2], ".", color=_EXPOSURE_COLOURS[setting.exposure], ms=2.0)
            below.set(xlim=(0, demo.ROWS), ylim=(0.0, 255.0), ylabel="DN" if column == 0 else "")
            below.set_xlabel("row" if k else "")


def _gains(canvas: Canvas, results: Sequence[GainResult], kind: str, number: int) -> None:
    """Figures 10 and 11: mean gains over frequency, one panel per exposure."""
    results = [result for result in results if result.setting.kind == kind]
    panels = canvas.subplots(1, 4, sharey=True)
    for axes, exposure in zip(panels, demo.EXPOSURES, strict=True):
        chosen = [result for result in results if result.setting.exposure == exposure]
        _gain_panel(axes, chosen, exposure)
    panels[0].set_ylabel("mean gain")
    panels[0].set_title(f"Figure {number}: {kind}, Tₑ = {1e6 * demo.EXPOSURES[0]:.0f} µs")
    panels[-1].legend(loc="upper right")


def _gain_panel(axes: Axes, chosen: Sequence[GainResult], exposure: float) -> None:
    f = np.linspace(1.0, 1000.0, 1000)
    axes.plot(f, np.abs(exposure_response(f, exposure)), color=BLACK, lw=1.0, label="theory |sinc(f Tₑ)|")
    tones = [result.setting.frequency for result in chosen]
    paper = [result.paper for result in chosen]
    axes.errorbar(
        tones,
        paper,
        [3.0 * result.paper_std for result in chosen],
        fmt="x",
        color=RED,
        ms=8.0,
        mew=1.8,
        label="the paper's rounded bin (± 3 σ)",
    )
    errors = [3.0 * result.fit_std for result in chosen]
    axes.errorbar(
        tones,
        [result.fit for result in chosen],
        errors,
        fmt="o",
        color=BLUE,
        mfc="none",
        mew=1.6,
        ms=8.0,
        label="fit with harmonics (± 3 σ)",
    )
    for result in chosen:
        below = result.bias < 0.0
        axes.annotate(
            f"{result.bias:+.3f}",
            (result.setting.frequency, result.paper),
            (6, -12 if below else 7),
            textcoords="offset points",
            color=RED,
            fontsize="small",
            bbox=_WHITE,
        )
    axes.set(xlabel="frequency / Hz", title=f"Tₑ = {1e6 * exposure:.0f} µs", xlim=(0.0, 1000.0), ylim=(0.0, 1.05))


def _optimum_and_closed_form(canvas: Canvas, results: Sequence[GainResult]) -> None:
    """Figure 12: the objective at 200 Hz and three motions, with the paper's choice and the optimum."""
    axes = canvas.subplots()
    for motion, colour in zip((100.0, 150.0, 200.0), (GREEN, ORANGE, BLUE), strict=True):
        time = np.linspace(1e-6, 1e-2, 4000)
        axes.plot(
            1e3 * time, 1e3 * exposure_objective(time, 200.0, motion), color=colour, label=f"f_x v = {motion:.0f} Hz"
        )
        exact = best_exposure(200.0, motion)
        closed = best_exposure(200.0, motion, method="closed-form")
        axes.plot(1e3 * exact.exposure, 1e3 * exact.objective, "s", color=colour, ms=9.0, mfc="none", mew=1.6)
        axes.plot(1e3 * closed.exposure, 1e3 * closed.objective, "o", color=colour, ms=6.0)
        loss = 100.0 * abs(1.0 - float(closed.objective) / float(exact.objective))
        at = (1e3 * closed.exposure, 1e3 * closed.objective)
        axes.annotate(f"loss {loss:.2f} %", at, (7, -15), textcoords="offset points", color=colour, bbox=_WHITE)
    axes.plot([], [], "s", color=BLACK, mfc="none", mew=1.6, label="exact optimum")
    axes.plot([], [], "o", color=BLACK, label="the paper's closed form")
    axes.set(
        xlabel="exposure time / ms", ylabel="Y / ms", title="Figure 12: objective at f_c = 200 Hz", xlim=(0.0, 10.0)
    )
    axes.legend(loc="upper right")


def _deviations(canvas: Canvas, results: Sequence[GainResult]) -> None:
    """Figure 13: the objective of optimum and closed form, and the loss of the closed form."""
    found = choices.deviations()
    left, right = canvas.subplots(1, 2)
    left.plot(found.inverse_ratio, 1e3 * found.exact, color=BLUE, label="exact optimum")
    left.plot(found.inverse_ratio, 1e3 * found.closed_form, color=RED, ls="--", label="the paper's closed form")
    left.set(xlabel="1/ε = f_min/f_max", ylabel="Y / ms", title="Figure 13: f_min = 100 Hz, Tₑ up to 1/f_min")
    left.legend(loc="upper left")
    right.plot(found.inverse_ratio, 100.0 * found.loss, color=RED)
    mean, largest = 100.0 * found.loss.mean(), 100.0 * found.loss.max()
    words = (
        f"mean {mean:.2f} %, printed {100 * choices.PRINTED_MEAN:.2f} %\n"
        f"largest {largest:.2f} %, printed {100 * choices.PRINTED_LARGEST:.2f} %\n"
        f"at 1/ε = {found.inverse_ratio[np.argmax(found.loss)]:.2f}"
    )
    right.text(0.97, 0.95, words, transform=right.transAxes, ha="right", va="top")
    right.set(xlabel="1/ε", ylabel="deviation / %", title="What the closed form leaves")


def table_rows() -> list[list[str]]:
    """Table 2: printed values and those of the virtual testbed."""
    truth = ", ".join(f"{testbed.true_grating(g):.2f}" for g in demo.GRATINGS)
    periods = ", ".join(f"{g * np.pi * demo.RING_DIAMETER:.1f}" for g in demo.GRATINGS)
    whole = ", ".join(str(demo.periods_on_ring(g)) for g in demo.GRATINGS)
    motion = ", ".join(f"{Setting('sensing', g, 0.0).frequency:.1f}" for g in demo.GRATINGS)
    return [
        ["resolution W × N", "1080 × 720", "1080 × 720; rows are read along N"],
        ["frame rate", "30 /s", "30 /s, clock 70 ppm slow: phases spread over the frames"],
        ["row time", "22.2 µs", "22.2 µs: a frame is read in 16.0 ms of 33.3"],
        ["exposure", "622, 1202, 2404 (text: 2401), 4981 µs", "622, 1202, 2404, 4981 µs"],
        ["ring", "0.15 m", "0.15 m"],
        [
            "turns",
            "223 /min (text: 215)",
            f"223 /min: {testbed.speed():.3f} m/s; 215 would be 1.688 m/s, not the printed 1.75",
        ],
        ["slot width", "10, 5, 2 mm", "half a period: the printed f_x is 1/width, twice 1/(2·width)"],
        ["f_x", "100, 200, 500 /m", f"{truth} /m: {whole} whole periods ({periods} would not close)"],
        ["f_x v", "175, 350, 875 Hz: 1.75 m/s × f_x", f"{motion} Hz"],
        [
            "noise, bits",
            "–",
            f"{demo.NOISE:g} DN of a swing of {demo.SWING:g}, 8 bits, dark level {demo.DARK_LEVEL:g}",
        ],
    ]


FIGURES = {
    "5": Figure((9.0, 4.5), _response_and_lines),
    "6": Figure((11.0, 4.2), _objective_over_exposure),
    "9": Figure((11.0, 9.0), _pictures),
    "10": Figure((14.0, 4.6), functools.partial(_gains, kind="communication", number=10), needs_gains=True),
    "11": Figure((14.0, 4.6), functools.partial(_gains, kind="sensing", number=11), needs_gains=True),
    "12": Figure((9.0, 4.8), _optimum_and_closed_form),
    "13": Figure((11.0, 4.4), _deviations),
}


def draw(name: str, path: Any, results: Sequence[GainResult]) -> None:
    """Write a figure's picture."""
    with picture(path, *FIGURES[name].size) as canvas:
        FIGURES[name].draw(canvas, results)
