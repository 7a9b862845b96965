"""``python -m studies.drive``."""

from __future__ import annotations

import sys
from typing import Any

import click
import numpy as np

from ocisac_fast.cli.output import emit_json, emit_table, quantity
from ocisac_fast.cli.pictures import json_option, plot_option
from studies.command import run
from studies.drive import NOISE_LEVEL, POLICIES, draw, drive_past_light


@click.command
@click.option("--seconds", type=float, default=8.0, show_default=True, help="Length of the drive.")
@click.option(
    "--hysteresis", type=float, default=0.01, show_default=True, help="Loss of the objective that is tolerated."
)
@click.option(
    "--weights", type=(float, float), default=(1.0, 1.0), show_default=True, help="Weights of light and texture."
)
@click.option("--noise/--no-noise", default=True, show_default=True, help="Divide the objective by the noise.")
@click.option("--seed", type=int, default=0, show_default=True)
@plot_option("exposures, gains and objective over time")
@json_option
def drive(
    seconds: float,
    hysteresis: float,
    weights: tuple[float, float],
    noise: bool,
    seed: int,
    plot: str | None,
    as_json: bool,
) -> None:
    """Drive past a modulated traffic light with the exposure controller in the loop.

    Speed and texture of the road change; every frame is rendered at the exposure that the controller suggests, and
    measured. The results are compared with the paper's closed form and the best fixed exposure in hindsight.
    """
    level = NOISE_LEVEL if noise else None
    result = drive_past_light(seconds=seconds, hysteresis=hysteresis, weights=weights, noise_level=level, seed=seed)
    if plot is not None:
        draw(plot, result)
    facts = [_facts(name, k, result) for k, name in enumerate(POLICIES)]
    if as_json:
        for line in facts:
            emit_json(line)
        return
    header = ["policy", "exposures", "changes", "objective, mean", "least", "least, as known", "ahead of ours at most"]
    emit_table(f"{result.time.size} frames; objective as a share of the largest", header, [_row(f) for f in facts])


def _facts(name: str, k: int, drive: Any) -> dict[str, Any]:
    return {
        "policy": name,
        "frames": drive.time.size,
        "shortest_s": drive.exposure[k].min(),
        "longest_s": drive.exposure[k].max(),
        "changes": int(np.count_nonzero(np.diff(drive.exposure[k]))),
        "objective_mean": drive.true[k].mean(),
        "objective_least": drive.true[k].min(),
        "known_least": drive.known[k].min(),
        "ahead_of_controller": float(np.max(drive.known[k] / drive.known[0] - 1.0)),
    }


def _row(facts: dict[str, Any]) -> list[str]:
    return [
        facts["policy"],
        f"{quantity(facts['shortest_s'], 's', 4)} to {quantity(facts['longest_s'], 's', 4)}",
        str(facts["changes"]),
        *(f"{facts[name]:.4f}" for name in ("objective_mean", "objective_least", "known_least")),
        f"{facts['ahead_of_controller']:.4f}",
    ]


if __name__ == "__main__":
    sys.exit(run(drive))
