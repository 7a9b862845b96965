"""``ocisac exposure``."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import click

from ocisac_fast.cli.command import command
from ocisac_fast.cli.lights import LIGHTS_TO_AVOID, light_name
from ocisac_fast.cli.output import emit, quantity
from ocisac_fast.cli.outputs import OUTPUT, PLOTS, draw
from ocisac_fast.cli.units import RATE, SHARE, TIME, Quantity, Several
from ocisac_fast.exposure import FlickerFreeExposure, FlickeringLight, best_exposure, flicker_free_exposure


@command
def exposure(
    *,
    comm: Annotated[Quantity | None, RATE, "Frequency of the communication tone, f_c."] = None,
    sense: Annotated[Quantity | None, RATE, "Frequency of the motion, f_s = f_x v."] = None,
    method: Annotated[
        Literal["exact", "closed-form", "search"],
        {"metavar": "NAME", "show_default": False},
        "exact, or from the paper: closed-form, search.",
    ] = "exact",
    weights: Annotated[tuple[float, float], Several(click.FLOAT, "COMM,SENSE", 2), "Weights of the sum."] = (1.0, 1.0),
    bounds: Annotated[
        tuple[float, float] | None,
        Several(TIME, "MIN,MAX", 2),
        "Default: 0 to 1/min(f_c, f_s); --avoid: to 0.1 s.",
    ] = None,
    step: Annotated[Quantity | None, TIME, "Only multiples of it, for example the row time."] = None,
    avoid: Annotated[Any, LIGHTS_TO_AVOID, "100Hz, 90Hz+-1%, 1kHz:square, 90Hz..200Hz:5%, mains."] = None,
    below: Annotated[float, SHARE, "Max. (max-min)/(max+min) of them."] = 0.02,
    near: Annotated[Quantity | None, TIME, "Find the nearest to it instead of the shortest."] = None,
    keep: Annotated[float | None, SHARE, "Min. gain of the communication tone."] = None,
    plot: Annotated[str | None, OUTPUT, f"Draw the exposures ({PLOTS})."] = None,
    front: Annotated[str | None, OUTPUT, {"metavar": "FILE"}, "Draw communication over sensing."] = None,
    as_json: bool,
) -> None:
    """Find the T of largest Y = |sin(π f_c T)|/(π f_c) + |sin(π f_s T)|/(π f_s).

    With --avoid: the shortest T without bands of other lights; with --comm too, the one of largest Y; with
    --keep, the shortest that keeps the gain.
    """
    shared: dict[str, Any] = {"weights": weights, "bounds": bounds}
    if avoid is not None:
        if method != "exact":
            raise click.UsageError(f"--method: got {method}, allowed: exact with --avoid")
        if comm is None and (sense, keep, front) != (None, None, None):
            raise click.UsageError("--comm: needed by --sense, --keep and --front")
        more = {"near": near, "step": step, "f_comm": comm, "f_sense": sense, "min_gain": keep}
        found = flicker_free_exposure(avoid, below, **more, **shared)  # type: ignore[arg-type]
        draw(plot, "plot_modulation", avoid, below, found=found, bounds=bounds)
        draw(front, "plot_flicker_front", comm, avoid, below, found=found, bounds=bounds)
        _report(found, avoid, as_json)
        return
    for name, value in (("--comm", comm), ("--sense", sense)):
        if value is None:
            raise click.UsageError(f"Missing option '{name}'.")
    for name, given in (("--near", near), ("--keep", keep)):
        if given is not None:
            raise click.UsageError(f"{name}: needs --avoid")
    assert comm is not None
    assert sense is not None
    best = best_exposure(comm, sense, method=method, step=step, **shared)
    exposure_time, objective = float(best.exposure), float(best.objective)
    draw(plot, "plot_exposure", comm, sense, **shared)
    draw(front, "plot_front", comm, sense, **shared)
    lines = {"exposure": quantity(exposure_time, "s", 7), "objective": quantity(objective, "s", 7), "method": method}
    emit(as_json, {"exposure_s": exposure_time, "objective": objective, "method": method}, lines)


def _report(found: FlickerFreeExposure, avoid: tuple[FlickeringLight, ...], as_json: bool) -> None:
    facts: dict[str, Any] = {"exposure_s": found.exposure, "modulation": found.modulation, "holds": found.holds}
    optional = {"null_s": found.null, "gain": found.gain, "objective": found.objective}
    facts |= {name: value for name, value in optional.items() if value == value}
    lights = [
        {"frequency_hz": light.frequency, "frequency_uncertainty_hz": light.uncertainty, "duty": light.duty}
        | {"modulation": left}
        for light, left in zip(avoid, found.modulations, strict=True)
    ]
    lines = {"exposure": quantity(found.exposure, "s", 7), "holds": "yes" if found.holds else "no: the best there is"}
    lines |= {f"left of {light_name(light)}": f"{m:.3%}" for light, m in zip(avoid, found.modulations, strict=True)}
    lines |= {name: quantity(facts[name], "" if name == "gain" else "s", 7) for name in optional if name in facts}
    if "null_s" in lines:
        lines["least beside it, at a null"] = lines.pop("null_s")
    emit(as_json, facts | {"lights": lights}, lines)
