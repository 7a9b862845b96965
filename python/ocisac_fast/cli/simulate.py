"""``ocisac simulate``."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterable
from typing import Any

import click
import numpy as np
from click.core import ParameterSource

from ocisac_fast.camera.camera import Camera
from ocisac_fast.cli.output import emit_facts, emit_json, progress, quantity
from ocisac_fast.cli.outputs import OUTPUT, InputFile, writes
from ocisac_fast.cli.pictures import json_option
from ocisac_fast.cli.units import FREQUENCY, RATE, ROW_TIME, TIME, Parsed
from ocisac_fast.files import RecordingStream, write_frames
from ocisac_fast.light.waveforms import Chips, SquareWave, Tone, TriangleWave, Waveform
from ocisac_fast.scene.effects import EFFECTS
from ocisac_fast.scene.simulation import lamp_bar, simulate_frames, texture

_CLIPPED = "noise of dark rows is clipped at 0, which biases gains; give both commands a --dark-level of 5 times it"
_DTYPES = {"8": "uint8", "16": "uint16", "float": "float32"}


_NAMES = "; ".join(f"{name} to {effect.most:g} {effect.unit}" for name, effect in EFFECTS.items())


def _effect(word: str) -> tuple[str, float]:
    name, _, level = word.partition("=")
    return name, float(level)


class _Scene(InputFile):
    def files(self, path: str | os.PathLike[str]) -> Iterable[str | os.PathLike[str]]:
        from ocisac_fast.scene.toml import pictures_of

        return (path, *pictures_of(path))


@click.command(short_help="Simulate a recording of a modulated light, or of a scene.")
@click.argument("scene", required=False, type=_Scene(exists=True, dir_okay=False))
@click.option(
    "--waveform", type=click.Choice(["tone", "square", "triangle", "chips"]), default="tone", show_default=True
)
@click.option("--frequency", type=FREQUENCY, help="Frequency of a tone, a square or a triangle wave.")
@click.option("--duty", type=float, default=0.5, show_default=True, help="Bright share of a square wave.")
@click.option("--phase", type=float, default=0.0, show_default=True, help="Phase of these waves, rad at time 0.")
@click.option("--bits", help="Chips of on-off keying, such as 0110.")
@click.option("--chip-rate", type=FREQUENCY)
@click.option("--repeat/--once", default=True, show_default=True, help="Repeat the bits.")
@click.option("--rise", type=float, default=0.0, help="Time constant of a chip that turns bright, in chips.")
@click.option("--fall", type=float, default=0.0, help="Time constant of a chip that turns dark, in chips.")
@click.option("--rows", type=int, default=720, show_default=True)
@click.option("--columns", type=int, default=1080, show_default=True)
@click.option("--row-time", type=ROW_TIME)
@click.option("--exposure", type=TIME)
@click.option("--start", type=TIME, default="0", show_default=True, help="End of the exposure of the first row.")
@click.option("--swing", type=float, default=200.0, show_default=True, help="Stored values from dark to full light.")
@click.option("--dark-level", type=float, default=0.0, show_default=True, help="Stored value of no light.")
@click.option("--noise", type=float, default=0.0, show_default=True, help="Standard deviation in stored values.")
@click.option("--lamp-width", type=float, help="A bar along the rows, this standard deviation wide, px.")
@click.option("--tilt", type=float, default=0.0, help="Of that bar from upright, degrees.")
@click.option("--texture", type=float, default=0.0, help="Standard deviation of the log of the wall's reflectance.")
@click.option("--hum", type=float, default=0.0, help="Mains light on the whole picture, peak to peak over --swing.")
@click.option("--mains", type=FREQUENCY, default="50", show_default=True, help="Mains; its light has twice this.")
@click.option("--jitter", type=TIME, default="0", help="Frames start up to this early or late.")
@click.option(
    "--effect",
    "effects",
    type=Parsed("NAME=LEVEL", _effect, "NAME=LEVEL, such as row-pause=5"),
    multiple=True,
    help=f"Of a device, several times; levels from 0: {_NAMES}.",
)
@click.option("--bit-depth", type=click.Choice(list(_DTYPES)), default="8", show_default=True)
@click.option("--frames", type=int, default=1, show_default=True)
@click.option("--frame-rate", type=RATE, default="30", show_default=True)
@click.option("--seed", type=int, default=0, show_default=True, help="Equal seeds give equal files.")
@click.option("--tolerance", type=float, default=0.5, show_default=True, help="Scene: largest error in DN.")
@click.option("--noise-off", is_flag=True, help="Scene: without the sensor's noise.")
@click.option(
    "-o", "--output", required=True, type=OUTPUT, help=".png, .tif, .mkv (FFV1), .mp4 (lossless H.264) or .npy."
)
@writes
@json_option
def simulate(
    scene: str | None,
    as_json: bool,
    output: str,
    tolerance: float,
    noise_off: bool,
    **options: Any,
) -> None:
    """Simulate a recording of a light that fills the picture, or of a SCENE (a TOML file): a picture, video or array.

    Stored values are dark level + swing × reflectance × (lamp × mean light over the exposure + hum) + noise,
    rounded and clipped to the bit depth (float: neither); --effect adds what phones, dash cameras and cheap senders
    do. A SCENE file defines all this: it can be combined only with --frames, --start, --seed, --tolerance and
    --noise-off.
    """
    context = click.get_current_context()
    given = [name for name in options if context.get_parameter_source(name) is ParameterSource.COMMANDLINE]
    if scene is not None:
        others = sorted(set(given) - {"frames", "start", "seed"})
        if others:
            raise click.UsageError(f"--{others[0].replace('_', '-')}: the file of SCENE defines it")
        _simulate_scene(scene, as_json, output, tolerance, noise_off, options)
        return
    for name in ("row_time", "exposure"):
        if options[name] is None:
            raise click.UsageError(f"Missing option '--{name.replace('_', '-')}'.")
    row_time, exposure, frame_rate = (float(options[name]) for name in ("row_time", "exposure", "frame_rate"))
    dtype = _DTYPES[options["bit_depth"]]
    frames = simulate_frames(
        _waveform(options),
        Camera(row_time, exposure, frame_time=1.0 / frame_rate),
        start=float(options["start"]),
        jitter=float(options["jitter"]),
        effects=dict(options["effects"]),
        dtype=dtype,
        **_surroundings(options),
        **{name: options[name] for name in ("rows", "columns", "frames", "swing", "dark_level", "noise", "seed")},
    )
    if dtype != "float32" and options["dark_level"] < 3.0 * options["noise"]:
        warnings.warn(_CLIPPED, stacklevel=1)
    shown = progress(frames, "simulating", options["frames"])
    # A .npy file of one frame is (rows, columns).
    one_array = output.lower().endswith(".npy") and options["frames"] == 1
    like = RecordingStream.linear()
    write_frames(output, np.asarray(next(shown)) if one_array else shown, frame_rate=frame_rate, like=like)
    facts = {name: options[name] for name in ("frames", "rows", "columns")}
    if as_json:
        emit_json({"file": output, **facts, "dtype": dtype, "row_time_s": row_time, "exposure_s": exposure})
        return
    _emit(output, facts, dtype, row_time, exposure)


def _simulate_scene(
    path: str, as_json: bool, output: str, tolerance: float, noise_off: bool, options: dict[str, Any]
) -> None:
    from ocisac_fast.scene import load_scene, render

    scene = load_scene(path)
    plan = scene.plan(tolerance=tolerance, frames=options["frames"], start=float(options["start"]))
    frames = render(plan, noise=scene.sensor.noisy and not noise_off, seed=options["seed"])
    shown = progress(frames, "rendering", options["frames"])
    one_array = output.lower().endswith(".npy") and options["frames"] == 1
    rate = 1 / scene.camera.frame_time if scene.camera.frame_time else 30.0
    write_frames(output, np.asarray(next(shown)) if one_array else shown, frame_rate=rate)
    facts = {"frames": options["frames"], "rows": scene.lens.rows, "columns": scene.lens.columns}
    bits = scene.sensor.bit_depth
    dtype = "float32" if bits is None else "uint8" if bits <= 8 else "uint16"
    times = {"row_time_s": scene.camera.row_time, "exposure_s": scene.exposure}
    if as_json:
        emit_json({"file": output, **facts, "dtype": dtype, **times, "error_bound_dn": plan.bound})
        return
    _emit(output, facts, dtype, scene.camera.row_period, scene.exposure)
    click.echo(str(plan))


def _emit(output: str, facts: dict[str, Any], dtype: str, row_time: float, exposure: float) -> None:
    size = " × ".join(map(str, facts.values()))
    times = {"row time": quantity(row_time, "s"), "exposure": quantity(exposure, "s")}
    emit_facts("", {"file": output, "frames × rows × columns": f"{size} {dtype}", **times})


def _surroundings(options: dict[str, Any]) -> dict[str, Any]:
    """The lamp's shape and the light and texture around it, for `simulate_frames`."""
    rows, columns, width = options["rows"], options["columns"], options["lamp_width"]
    if width is None and options["tilt"]:
        raise click.UsageError("--tilt: needs --lamp-width")
    parts: dict[str, Any] = {}
    if width is not None:
        parts["lamp"] = lamp_bar(rows, columns, width, tilt=math.radians(options["tilt"]))
    if options["texture"]:
        parts["reflectance"] = texture(rows, columns, options["texture"], seed=options["seed"])
    if options["hum"]:
        parts["ambient"] = Tone(2 * float(options["mains"]), amplitude=options["hum"])
    return parts


def _waveform(options: dict[str, Any]) -> Waveform:
    kind = options["waveform"]
    for name in ("bits", "chip_rate") if kind == "chips" else ("frequency",):
        if options[name] is None:
            raise click.UsageError(f"--waveform {kind}: needs --{name.replace('_', '-')}")
    if kind == "chips":
        times = {name: options[name] for name in ("rise", "fall")}
        return Chips(options["bits"], float(options["chip_rate"]), repeat=options["repeat"], **times)
    if kind == "square":
        return SquareWave(float(options["frequency"]), duty=options["duty"], phase=options["phase"])
    return (TriangleWave if kind == "triangle" else Tone)(float(options["frequency"]), phase=options["phase"])
