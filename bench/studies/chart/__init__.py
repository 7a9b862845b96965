"""Speed and accuracy: methods, scenes, measurements and drawing of ``make chart``."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from studies.chart import detectors, gains, rendering, tradeoffs  # they enter their panels  # noqa: F401
from studies.chart.drawing import draw
from studies.chart.measuring import Point, beaten_by, pareto_front
from studies.chart.methods import GAIN_METHODS, GainMethod
from studies.chart.panels import FULL, PANELS, QUICK, Effort, Panel, panel
from studies.chart.reporting import update_text, write_table
from studies.chart.scenes import SCENES, Scene

__all__ = [
    "FULL",
    "GAIN_METHODS",
    "PANELS",
    "QUICK",
    "SCENES",
    "Effort",
    "GainMethod",
    "Panel",
    "Point",
    "Scene",
    "beaten_by",
    "draw",
    "measure",
    "missing_libraries",
    "panel",
    "pareto_front",
    "update_text",
    "write_table",
]


def measure(
    effort: Effort, progress: Callable[[str], None], panels: Sequence[Panel] = PANELS
) -> list[tuple[Panel, list[Point]]]:
    """All panels with their points; ``progress`` is called after each of their ``steps``."""
    return [(panel, panel.measure(effort, progress)) for panel in panels]


def missing_libraries() -> list[str]:
    """The peers that are not installed; their methods are omitted."""
    return sorted({method.needs for method in GAIN_METHODS if not method.installed})
