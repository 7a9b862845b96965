"""The chart's panels, each a function that measures its points: the place for what other parts have to compare.

A new comparison (detectors, scene models) is one more function under ``@panel``; the command draws it, writes it to
the table and to the text.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from studies.chart.measuring import Point

Progress = Callable[[str], None]  # called once for every step done


@dataclass(frozen=True)
class Effort:
    """How much to measure.

    Attributes:
        columns: of the frames whose gains are compared.
        frames: how many of them.
        seconds: for the timing of a method.
        problems: for exposure choice.
    """

    columns: int
    frames: int
    seconds: float
    problems: int


FULL = Effort(columns=1920, frames=2, seconds=0.3, problems=100)
QUICK = Effort(columns=240, frames=1, seconds=0.02, problems=20)


@dataclass(frozen=True)
class Panel:
    """One picture of cost against error.

    Attributes:
        name: key in tables.
        title: over the picture.
        cost, error: what the axes show, with units.
        labelled: whether points carry their label; else a legend of families serves all such panels.
        limits: draw cost = 1 and error = 1, beyond which nothing can be.
        steps: how often ``measure`` reports progress.
        measure: points from effort and progress.
    """

    name: str
    title: str
    cost: str
    error: str
    labelled: bool
    limits: bool
    steps: int
    measure: Callable[[Effort, Progress], list[Point]]


PANELS: list[Panel] = []


def panel(
    name: str, title: str, cost: str, error: str, steps: int = 1, labelled: bool = True, limits: bool = False
) -> Callable[[Callable[[Effort, Progress], list[Point]]], Callable[[Effort, Progress], list[Point]]]:
    """Enters a measuring function into ``PANELS``."""

    def enter(measure: Callable[[Effort, Progress], list[Point]]) -> Callable[[Effort, Progress], list[Point]]:
        PANELS.append(Panel(name, title, cost, error, labelled, limits, steps, measure))
        return measure

    return enter
