"""``ocisac simulate``."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import click
import numpy as np
import numpy.typing as npt
from click.core import ParameterSource

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.command import command
from ocisac_fast.cli.output import emit, progress, quantity
from ocisac_fast.cli.outputs import OUTPUT, InputFile, require_not_written
from ocisac_fast.cli.units import FREQUENCY, RATE, ROW_TIME, TIME, Parsed, Quantity
from ocisac_fast.files import RecordingStream, write_frames
from ocisac_fast.light.waveforms import Chips, SquareWave, Tone, TriangleWave, Waveform
from ocisac_fast.scene import render
from ocisac_fast.scene.effects import EFFECTS
from ocisac_fast.scene.simulation import lamp_bar, simulate_frames, texture
from ocisac_fast.scene.toml import load_scene_of

_CLIPPED = "noise of dark rows is clipped at 0, which biases gains; give both commands a --dark-level of 5 times it"
_DTYPES = {"8": "uint8", "16": "uint16", "float": "float32"}


_NAMES = "; ".join(f"{name} to {effect.most:g} {effect.unit}" for name, effect in EFFECTS.items())


def _effect(word: str) -> tuple[str, float]:
    name, _, level = word.partition("=")
    return name, float(level)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordingOptions:
    """Options of a simulated recording; a SCENE file states all but the first three."""

    frames: Annotated[int, "Number of frames."] = 1
    start: Annotated[Quantity, TIME, {"default": "0"}, "End of the exposure of the first row."]
    seed: Annotated[int, "Equal seeds give equal files."] = 0
    waveform: Annotated[Literal["tone", "square", "triangle", "chips"], "Of the light."] = "tone"
    frequency: Annotated[Quantity | None, FREQUENCY, "Frequency of a tone, a square or a triangle wave."] = None
    duty: Annotated[float, "Bright share of a square wave."] = 0.5
    phase: Annotated[float, "Phase of these waves, rad at time 0."] = 0.0
    bits: Annotated[str | None, "Chips of on-off keying, such as 0110."] = None
    chip_rate: Annotated[Quantity | None, FREQUENCY, "Chips per second."] = None
    repeat: Annotated[bool, {"names": ["--repeat/--once"]}, "Repeat the bits."] = True
    rise: Annotated[float, "Time constant of a chip that turns bright, in chips."] = 0.0
    fall: Annotated[float, "Time constant of a chip that turns dark, in chips."] = 0.0
    rows: Annotated[int, "Rows of a frame."] = 720
    columns: Annotated[int, "Columns of a frame."] = 1080
    row_time: Annotated[Quantity | None, ROW_TIME, "Time from one row to the next."] = None
    exposure: Annotated[Quantity | None, TIME, "Exposure time of a row."] = None
    swing: Annotated[float, "Stored values from dark to full light."] = 200.0
    dark_level: Annotated[float, "Stored value of no light."] = 0.0
    noise: Annotated[float, "Standard deviation in stored values."] = 0.0
    lamp_width: Annotated[float | None, "A bar along the rows, this standard deviation wide, px."] = None
    tilt: Annotated[float, "Of that bar from upright, degrees."] = 0.0
    texture: Annotated[float, "Standard deviation of the log of the wall's reflectance."] = 0.0
    hum: Annotated[float, "Mains light on the whole picture, peak to peak over --swing."] = 0.0
    mains: Annotated[Quantity, FREQUENCY, {"default": "50"}, "Mains; its light has twice this."]
    jitter: Annotated[Quantity, TIME, {"default": "0"}, "Frames start up to this early or late."]
    effects: Annotated[
        tuple[tuple[str, float], ...],
        {"names": ["--effect"], "multiple": True},
        Parsed("NAME=LEVEL", _effect, "NAME=LEVEL, such as row-pause=5"),
        f"Of a device, several times; levels from 0: {_NAMES}.",
    ] = ()
    bit_depth: Annotated[Literal["8", "16", "float"], "Bits of a stored value."] = "8"
    frame_rate: Annotated[Quantity, RATE, {"default": "30"}, "Frames per second."]


@command
def simulate(
    scene: Annotated[str | None, InputFile(exists=True, dir_okay=False)] = None,
    *,
    options: RecordingOptions,
    tolerance: Annotated[float, "Scene: largest error in DN."] = 0.5,
    noise_off: Annotated[bool, "Scene: without the sensor's noise."] = False,
    output: Annotated[
        str, OUTPUT, {"names": ["-o", "--output"]}, ".png, .tif, .mkv (FFV1), .mp4 (lossless H.264) or .npy."
    ],
    as_json: bool,
) -> None:
    """Simulate a recording of a light that fills the picture, or of a SCENE (a TOML file): a picture, video or array.

    Stored values are dark level + swing × reflectance × (lamp × mean light over the exposure + hum) + noise,
    rounded and clipped to the bit depth (float: neither); --effect adds what phones, dash cameras and cheap senders
    do. A SCENE file defines all this: it can be combined only with --frames, --start, --seed, --tolerance and
    --noise-off.
    """
    context = click.get_current_context()
    names = [field.name for field in dataclasses.fields(options)]
    given = [name for name in names if context.get_parameter_source(name) is ParameterSource.COMMANDLINE]
    if scene is not None:
        others = sorted(set(given) - {"frames", "start", "seed"})
        if others:
            raise click.UsageError(f"--{others[0].replace('_', '-')}: the file of SCENE defines it")
        _simulate_scene(scene, as_json, output, tolerance, noise_off, options)
        return
    if options.row_time is None or options.exposure is None:
        raise click.UsageError(f"Missing option '--{'row-time' if options.row_time is None else 'exposure'}'.")
    row_time, exposure, frame_rate = float(options.row_time), float(options.exposure), float(options.frame_rate)
    dtype = _DTYPES[options.bit_depth]
    frames = simulate_frames(
        _waveform(options),
        Camera(row_time, exposure, frame_time=1.0 / frame_rate),
        start=float(options.start),
        jitter=float(options.jitter),
        effects=dict(options.effects),
        dtype=dtype,
        **_surroundings(options),
        **{
            name: getattr(options, name)
            for name in ("rows", "columns", "frames", "swing", "dark_level", "noise", "seed")
        },
    )
    if dtype != "float32" and options.dark_level < 3.0 * options.noise:
        warnings.warn(_CLIPPED, stacklevel=1)
    _write(output, progress(frames, "simulating", options.frames), options.frames, frame_rate, RecordingStream.linear())
    size = {name: getattr(options, name) for name in ("frames", "rows", "columns")}
    _emit(as_json, {"file": output, **size, "dtype": dtype, "row_time_s": row_time, "exposure_s": exposure})


def _write(
    output: str, frames: Iterator[npt.NDArray[Any]], count: int, frame_rate: float, like: RecordingStream | None = None
) -> None:
    """Write the frames; a .npy file of one is (rows, columns)."""
    is_one = output.lower().endswith(".npy") and count == 1
    write_frames(output, np.asarray(next(frames)) if is_one else frames, frame_rate=frame_rate, like=like)


def _simulate_scene(
    path: str, as_json: bool, output: str, tolerance: float, noise_off: bool, options: RecordingOptions
) -> None:
    scene, pictures = load_scene_of(path, any_folder=False)
    require_not_written(pictures)
    plan = scene.plan(tolerance=tolerance, frames=options.frames, start=float(options.start))
    frames = render(plan, noise=scene.sensor.noisy and not noise_off, seed=options.seed)
    rate = 1 / scene.camera.frame_time if scene.camera.frame_time else 30.0
    _write(output, progress(frames, "rendering", options.frames), options.frames, rate)
    size = {"frames": options.frames, "rows": scene.lens.rows, "columns": scene.lens.columns}
    bits = scene.sensor.bit_depth
    dtype = "float32" if bits is None else "uint8" if bits <= 8 else "uint16"
    times = {"row_time_s": scene.camera.row_time, "exposure_s": scene.exposure}
    _emit(as_json, {"file": output, **size, "dtype": dtype, **times, "error_bound_dn": plan.bound})
    if not as_json:
        click.echo(str(plan))


def _emit(as_json: bool, facts: dict[str, Any]) -> None:
    size = f"{facts['frames']} × {facts['rows']} × {facts['columns']} {facts['dtype']}"
    times = {name: quantity(facts[f"{name.replace(' ', '_')}_s"], "s") for name in ("row time", "exposure")}
    emit(as_json, facts, {"file": facts["file"], "frames × rows × columns": size, **times})


def _surroundings(options: RecordingOptions) -> dict[str, Any]:
    """The lamp's shape and the light and texture around it, for `simulate_frames`."""
    rows, columns, width = options.rows, options.columns, options.lamp_width
    if width is None and options.tilt:
        raise click.UsageError("--tilt: needs --lamp-width")
    parts: dict[str, Any] = {}
    if width is not None:
        parts["lamp"] = lamp_bar(rows, columns, width, tilt=math.radians(options.tilt))
    if options.texture:
        parts["reflectance"] = texture(rows, columns, options.texture, seed=options.seed)
    if options.hum:
        parts["ambient"] = Tone(2 * float(options.mains), amplitude=options.hum)
    return parts


def _waveform(options: RecordingOptions) -> Waveform:
    kind, chips = options.waveform, options.waveform == "chips"
    for name in ("bits", "chip_rate") if chips else ("frequency",):
        if getattr(options, name) is None:
            raise click.UsageError(f"--waveform {kind}: needs --{name.replace('_', '-')}")
    if chips:
        times = {"rise": options.rise, "fall": options.fall}
        return Chips(options.bits or "", float(options.chip_rate or 0.0), repeat=options.repeat, **times)
    frequency = float(options.frequency or 0.0)
    if kind == "square":
        return SquareWave(frequency, duty=options.duty, phase=options.phase)
    return (TriangleWave if kind == "triangle" else Tone)(frequency, phase=options.phase)
