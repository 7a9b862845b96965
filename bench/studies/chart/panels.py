"""The chart's panels, each a function that measures its points.

A new comparison (detectors, scene models) is one more function under ``@panel``; the command draws it and writes it to
the table and to the text.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from studies.chart.measuring import Point

Progress = Callable[[str], None]  # called once per step


@dataclass(frozen=True)
class Effort:
    """Extent of the measurements.

    Attributes:
        columns: of the frames whose gains are compared.
        frames: number of frames.
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
    """One plot of error over cost.

    Attributes:
        name: key in tables.
        title: over the picture.
        cost, error: labels of the axes, with units.
        labelled: True if points have labels; otherwise a legend of families serves all such panels.
        limits: draw cost = 1 and error = 1, the theoretical limits.
        steps: number of calls of ``progress`` by ``measure``.
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
    """Add a measuring function to ``PANELS``."""

    def enter(measure: Callable[[Effort, Progress], list[Point]]) -> Callable[[Effort, Progress], list[Point]]:
        PANELS.append(Panel(name, title, cost, error, labelled, limits, steps, measure))
        return measure

    return enter
