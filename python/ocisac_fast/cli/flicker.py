"""``ocisac flicker``."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from ocisac_fast.cli.command import command
from ocisac_fast.cli.lights import LIGHTS, light_name
from ocisac_fast.cli.output import emit_facts, emit_json, emit_table, quantity
from ocisac_fast.cli.outputs import OUTPUT, PLOTS, draw
from ocisac_fast.cli.units import SHARE, TIMES
from ocisac_fast.exposure import FlickeringLight, flicker_indices

_NAMES = ("modulation_index", "detection_index", "mitigation_probability", "missed")


@command
def flicker(
    *,
    lights: Annotated[Any, LIGHTS, "90Hz:0.1 (duty), 1kHz:square, mains, 90Hz..200Hz:5%..50%."],
    exposures: Annotated[tuple[float, ...], TIMES, "Exposure times: 1ms,11ms or 10us..11ms:50."],
    background: Annotated[float, "Steady light relative to the lamp's peak."] = 0.0,
    contrast: Annotated[float, SHARE, "Contrast at which a lamp is detected."] = 0.1,
    tolerance: Annotated[float, SHARE, "Deviation from the mean that is mitigated."] = 0.1,
    plot: Annotated[str | None, OUTPUT, f"Draw the indices over the exposure ({PLOTS})."] = None,
    as_json: bool,
) -> None:
    """Compute flicker modulation index, flicker detection index and modulation mitigation probability of every lamp at
    every exposure, over all phases, in closed form. A range of frequencies or duties is five values; :N makes it N.
    """
    settings = {"background": background, "contrast": contrast, "tolerance": tolerance}
    rows: list[tuple[FlickeringLight, float, list[float]]] = []
    for light in lights:
        found = flicker_indices(light, exposures, **settings)
        values = np.array([getattr(found, name) for name in _NAMES])
        rows += [(light, time, each) for time, each in zip(exposures, values.T.tolist(), strict=True)]
    draw(plot, "plot_flicker_indices", lights, exposures, **settings)
    if not as_json:
        header = ["lamp", "exposure", "FMI", "FDI", "MMP", "missed"]
        table = [[light_name(light), quantity(time, "s"), *(f"{v:.4f}" for v in each)] for light, time, each in rows]
        emit_table("", header, table)
        if len(exposures) > 1:
            emit_facts("", _best(rows))
        return
    for light, time, each in rows:
        facts = {"frequency_hz": light.frequency, "duty": light.duty, "exposure_s": time}
        emit_json(facts | dict(zip(_NAMES, each, strict=True)))


def _best(rows: list[tuple[FlickeringLight, float, list[float]]]) -> dict[str, str]:
    """The exposure whose worst lamp has the least modulation."""
    worst: dict[float, tuple[float, str]] = {}
    for light, time, (modulation, *_) in rows:
        worst[time] = max(worst.get(time, (0.0, "")), (modulation, light_name(light)))
    time = min(worst, key=lambda each: worst[each][0])
    modulation, name = worst[time]
    return {"exposure of the least FMI": quantity(time, "s"), "its largest FMI": f"{modulation:.4f} ({name})"}
