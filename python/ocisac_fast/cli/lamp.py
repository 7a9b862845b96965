"""``ocisac lamp``."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from ocisac_fast.cli.command import command
from ocisac_fast.cli.output import emit, emit_table, quantity
from ocisac_fast.cli.outputs import OUTPUT, PLOTS, draw
from ocisac_fast.cli.units import FREQUENCY, SHARE, TIMES, Quantity, Several
from ocisac_fast.exposure import (
    DIGITAL_SUM_SPANS,
    flicker_free_chip_rate,
    flicker_free_frequencies,
    smallest_flicker_free_duty,
    unmissed_frequency,
)


@command
def lamp(
    *,
    exposures: Annotated[tuple[float, ...], TIMES, "Exposure times of cameras: 1/50s,1/100s, 10us..11ms:50."],
    below: Annotated[float, SHARE, "Max. (max-min)/(max+min)."] = 0.02,
    duty: Annotated[float | None, SHARE, "Min. duty of PWM: 0.1, 5%, 1/32; default: a tone."] = None,
    bounds: Annotated[
        tuple[Quantity, Quantity],
        Several(FREQUENCY, "LOW..HIGH", 2),
        {"names": ["--range"], "default": "50Hz..10kHz"},
        "Range of frequencies.",
    ],
    spread: Annotated[float, SHARE, "Tolerance of each exposure, +-."] = 0.0,
    frequency: Annotated[Quantity | None, FREQUENCY, "Frequency of PWM: print its min. duty instead."] = None,
    plot: Annotated[str | None, OUTPUT, f"Draw the modulation over frequency and duty ({PLOTS})."] = None,
    as_json: bool,
) -> None:
    """Find frequencies at which a lamp shows no bands at any exposure and no exposure misses a pulse, and the chip
    rates from which a line code shows no bands; with --frequency, the duties instead.
    """
    span = float(bounds[0]), float(bounds[1])
    facts: dict[str, Any]
    if frequency is not None:
        facts = {"no_bands_from_duty": smallest_flicker_free_duty(frequency, exposures, below)}
        facts["no_missed_pulse_from_duty"] = max(0.0, 1.0 - frequency * min(exposures))
    else:
        facts = _frequencies(exposures, below, duty, span, spread)
    draw(plot, "plot_lamp", exposures, below, span)
    lines = {
        _LABELS.get(name, name): quantity(value, "Hz" if name.endswith("_hz") else "")
        for name, value in facts.items()
        if not isinstance(value, (dict, np.ndarray))
    }
    if frequency is None:
        ranges = np.column_stack([facts["frequencies_hz"], facts["best_hz"]])
        shown = [[_hertz(value) for value in one] for one in ranges]
        if facts["holds"] and not as_json:
            emit_table("without bands", ("from", "to", "least at"), shown[:_MOST_ROWS])
        if len(shown) > _MOST_ROWS:
            lines["more"] = f"{len(shown) - _MOST_ROWS} further ranges (--json has all)"
        lines[_LABELS["holds"]] = _verdict(facts, shown[0])
    rates = facts.get("chip_rates_from_hz", {})
    emit(as_json, facts, lines | {f"no bands of {code} from": _hertz(rate) for code, rate in rates.items()})


_LABELS = {
    "modulation": "bands at most",
    "holds": "found",
    "always_from_hz": "without bands from",
    "no_missed_pulse_from_hz": "no missed pulse from",
}
_MOST_ROWS = 20


def _hertz(value: float) -> str:
    return quantity(value, "Hz")


def _verdict(facts: dict[str, Any], first: list[str]) -> str:
    if facts["holds"]:
        return "yes"
    if first[0] != first[1]:
        return f"no: every frequency from {first[0]} to {first[1]} is equally bad"
    return f"no: the best there is, {first[0]}"


def _frequencies(
    exposures: tuple[float, ...], below: float, duty: float | None, bounds: tuple[float, float], spread: float
) -> dict[str, Any]:
    found = flicker_free_frequencies(exposures, below, bounds, duty=duty, exposure_spread=spread)
    shortest = [min(exposures) * (1.0 - spread)]
    return {
        "frequencies_hz": found.intervals,
        "best_hz": found.best,
        "modulation": found.modulation,
        "holds": found.holds,
        "always_from_hz": found.always_from,
        "no_missed_pulse_from_hz": None if duty is None else unmissed_frequency(shortest, duty),
        "chip_rates_from_hz": {
            code: flicker_free_chip_rate(shortest, below, digital_sum_span=span)
            for code, span in DIGITAL_SUM_SPANS.items()
        },
    }
