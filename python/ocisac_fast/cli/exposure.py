"""``ocisac exposure``."""

from __future__ import annotations

from typing import Any

import click

from ocisac_fast.cli.output import emit_facts, emit_json, quantity
from ocisac_fast.cli.pictures import json_option, plot_option
from ocisac_fast.cli.units import FREQUENCY, TIME, ParameterType, Quantity


class _Pair(ParameterType):
    """Two quantities with a comma between them."""

    def __init__(self, single: ParameterType, name: str) -> None:
        self.name = name
        self._single = single

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, tuple):
            return value
        parts = str(value).split(",")
        if len(parts) != 2:
            self.fail(f"got {value!r}, allowed: {self.name}")
        return tuple(float(self._single.convert(part, param, ctx)) for part in parts)


@click.command(short_help="Best exposure time for communication and sensing.")
@click.option("--comm", type=FREQUENCY, required=True, help="Frequency of the communication tone, f_c.")
@click.option("--sense", type=FREQUENCY, required=True, help="Frequency of the sensed movement, f_s = f_x v.")
@click.option(
    "--method",
    type=click.Choice(["exact", "closed-form", "search"]),
    default="exact",
    show_default=True,
    help="exact: the optimum; closed-form and search: the paper's algorithm and grid.",
)
@click.option("--weights", type=_Pair(click.FLOAT, "COMM,SENSE"), default="1,1", show_default=True)
@click.option("--bounds", type=_Pair(TIME, "SHORTEST,LONGEST"), help="Else above 0 and up to 1/min(f_c, f_s).")
@click.option("--step", type=TIME, help="Grid of exposure times.")
@plot_option("the objective over the exposure time")
@click.option("--front", type=click.Path(dir_okay=False), help="Draw communication against sensing (PNG, PDF or SVG).")
@json_option
def exposure(
    comm: Quantity,
    sense: Quantity,
    method: Any,
    weights: tuple[float, float],
    bounds: tuple[float, float] | None,
    step: Quantity | None,
    plot: str | None,
    front: str | None,
    as_json: bool,
) -> None:
    """Find the exposure time T with the largest Y(T) = |sin(π f_c T)|/(π f_c) + |sin(π f_s T)|/(π f_s)."""
    from ocisac_fast.exposure import best_exposure

    best = best_exposure(
        float(comm),
        float(sense),
        method=method,
        weights=weights,
        bounds=bounds,
        step=None if step is None else float(step),
    )
    exposure_time, objective = float(best.exposure), float(best.objective)
    if plot is not None:
        from ocisac_fast.plots import plot_exposure

        plot_exposure(plot, float(comm), float(sense), weights=weights, bounds=bounds)
    if front is not None:
        from ocisac_fast.plots import plot_front

        plot_front(front, float(comm), float(sense), weights=weights, bounds=bounds)
    if as_json:
        emit_json({"exposure_s": exposure_time, "objective": objective, "method": method})
        return
    facts = {"exposure": quantity(exposure_time, "s", 7), "objective": quantity(objective, "s", 7), "method": method}
    emit_facts("", facts)
