"""``ocisac lamp``."""

from __future__ import annotations

from typing import Any

import click

from ocisac_fast.cli.lights import SHARE
from ocisac_fast.cli.output import emit_facts, emit_json, quantity
from ocisac_fast.cli.outputs import writes
from ocisac_fast.cli.pictures import json_option, plot_option
from ocisac_fast.cli.units import FREQUENCIES, FREQUENCY, TIMES, Quantity


@click.command(short_help="Frequencies, duties and chip rates of a lamp for given exposures.")
@click.option("--exposures", type=TIMES, required=True, help="Exposure times of the cameras.")
@click.option("--below", type=SHARE, default="2%", help="Max. (max-min)/(max+min); default 2%.")
@click.option("--duty", type=float, help="Min. duty of PWM; default: a tone.")
@click.option(
    "--range", "bounds", type=FREQUENCIES, default="50Hz,10kHz", help="Range of frequencies; default 50Hz,10kHz."
)
@click.option("--spread", type=SHARE, default="0", help="Tolerance of each exposure, +-; default 0.")
@click.option("--frequency", type=FREQUENCY, help="Frequency of PWM: print its min. duty instead.")
@plot_option("the modulation over frequency and duty")
@writes("plot")
@json_option
def lamp(
    exposures: tuple[float, ...],
    below: float,
    duty: float | None,
    bounds: tuple[Quantity, ...],
    spread: float,
    frequency: Quantity | None,
    plot: str | None,
    as_json: bool,
) -> None:
    """Find frequencies at which a lamp shows no bands at any exposure and no exposure misses a pulse, and the chip
    rates from which a line code shows no bands; with --frequency, the duties instead.
    """
    if len(bounds) != 2:
        raise click.UsageError(f"--range: got {len(bounds)} frequencies, allowed: LOWEST,HIGHEST")
    span = float(bounds[0]), float(bounds[1])
    if frequency is not None:
        facts = _duties(exposures, below, float(frequency))
    else:
        facts = _frequencies(exposures, below, duty, span, spread)
    if plot is not None:
        from ocisac_fast.plots import plot_lamp

        plot_lamp(exposures, below, span, path=plot)
    if as_json:
        emit_json(facts)
        return
    emit_facts("", {name: _text(name, value) for name, value in facts.items()})


def _frequencies(
    exposures: tuple[float, ...], below: float, duty: float | None, bounds: tuple[float, float], spread: float
) -> dict[str, Any]:
    from ocisac_fast.exposure import (
        DIGITAL_SUM_SPANS,
        flicker_free_chip_rate,
        flicker_free_frequencies,
        unmissed_frequency,
    )

    found = flicker_free_frequencies(exposures, below, bounds, duty=duty, exposure_spread=spread)
    shortest = [min(exposures) * (1.0 - spread)]
    return {
        "frequencies_hz": found.intervals,
        "modulation": found.modulation,
        "holds": found.holds,
        "always_from_hz": found.always_from,
        "no_missed_pulse_from_hz": None if duty is None else unmissed_frequency(shortest, duty),
        "chip_rates_from_hz": {
            code: flicker_free_chip_rate(shortest, below, digital_sum_span=span)
            for code, span in DIGITAL_SUM_SPANS.items()
        },
    }


def _duties(exposures: tuple[float, ...], below: float, frequency: float) -> dict[str, Any]:
    from ocisac_fast.exposure import smallest_flicker_free_duty

    return {
        "no_bands_from_duty": smallest_flicker_free_duty(frequency, exposures, below),
        "no_missed_pulse_from_duty": max(0.0, 1.0 - frequency * min(exposures)),
    }


def _text(name: str, value: Any) -> str:
    if name == "frequencies_hz":
        return ", ".join(f"{quantity(low, 'Hz')} to {quantity(high, 'Hz')}" for low, high in value)
    if isinstance(value, dict):
        return ", ".join(f"{code} {quantity(rate, 'Hz')}" for code, rate in value.items())
    if isinstance(value, bool):
        return "yes" if value else "no: the best there is"
    return quantity(value, "Hz" if name.endswith("_hz") else "")
