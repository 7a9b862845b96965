"""Sweeps of links, and their picture."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

from ocisac_fast.plots import BLUE, ORANGE
from studies.distance.links import Link, LinkResult, measure_link
from studies.drawing import panels


@dataclass(frozen=True)
class Sweep:
    """Links that differ in one value."""

    name: str  # key in tables
    label: str  # of the axis
    values: tuple[float, ...]  # along the axis
    links: tuple[Link, ...]  # one for each value


_DISTANCES = (5.0, 7.5, 10.0, 12.5, 15.0, 17.5, 20.0, 22.5, 25.0, 30.0, 40.0)
_AMBIENT = (0.0, 0.25, 0.5, 0.75, 0.9, 0.95)
_CLOSING = (0.0, 5.0, 10.0, 15.0, 20.0)
_PASSING = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0)
_LAMPS = (1, 2, 3, 4, 6)

SWEEPS = (
    Sweep("distance", "distance / m", _DISTANCES, tuple(Link(value) for value in _DISTANCES)),
    Sweep("ambient", "unmodulated share of the lamp's light, 10 m", _AMBIENT, tuple(Link(ambient=v) for v in _AMBIENT)),
    Sweep("closing", "closing speed / m/s, about 25 m", _CLOSING, tuple(Link(25.0, closing=v) for v in _CLOSING)),
    Sweep("passing", "passing speed / m/s, 15 m", _PASSING, tuple(Link(15.0, passing=v) for v in _PASSING)),
    Sweep("lamps", "vehicles side by side, 10 m", tuple(map(float, _LAMPS)), tuple(Link(lamps=n) for n in _LAMPS)),
)


def measure(sweep: Sweep, recordings: int) -> list[LinkResult]:
    """Counts of each link over ``recordings``."""
    results = []
    for link in sweep.links:
        total = LinkResult()
        for number in range(recordings):
            total.add(measure_link(link, number))
        results.append(total)
    return results


def draw(path: str | os.PathLike[str], sweeps: Sequence[Sweep], results: Sequence[Sequence[LinkResult]]) -> None:
    """Draw share of payloads and chip error rate over each sweep; no error is drawn as half a chip.

    Args:
        path: ``.png``, ``.pdf`` or ``.svg``.
        sweeps, results: equally long.
    """
    with panels(path, 2 * len(sweeps), 2, 10.0, 2.4, 0.4) as (_, axes, _):
        for k, (sweep, counts) in enumerate(zip(sweeps, results, strict=True)):
            payloads, errors = axes[2 * k], axes[2 * k + 1]
            looks = (("receiver", "o-", BLUE), ("everything known but the chips", "x--", ORANGE))
            shares = ([c.received / c.packets for c in counts], [c.bound / c.packets for c in counts])
            rates = (
                [max(c.read_errors, 0.5) / max(c.read, 1) for c in counts],
                [max(c.bound_errors, 0.5) / max(c.chips, 1) for c in counts],
            )
            for (label, line, colour), share, rate in zip(looks, shares, rates, strict=True):
                payloads.plot(sweep.values, share, line, color=colour, label=label)
                errors.semilogy(sweep.values, rate, line, color=colour, label=label)
            payloads.set(xlabel=sweep.label, ylabel="payloads within 2 s", ylim=(-0.05, 1.05))
            errors.set(xlabel=sweep.label, ylabel="wrong chips of those read", ylim=(1e-5, 1.0))
        axes[0].legend(loc="lower left")
