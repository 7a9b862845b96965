"""`Scene`: a description that can be planned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ocisac_fast.core.checks import Count, Finite, Positive, checked, checked_class
from ocisac_fast.scene.description import SceneDescription
from ocisac_fast.scene.plan import Plan, make_plan


@checked_class
@dataclass(frozen=True)
class Scene(SceneDescription):
    __doc__ = SceneDescription.__doc__

    @checked
    def plan(
        self, *, tolerance: Positive = 0.5, unit: Literal["DN", "noise"] = "DN", frames: Count = 1, start: Finite = 0.0
    ) -> Plan:
        """Select the terms to compute so that every pixel is within ``tolerance`` of the full model.

        Args:
            tolerance: largest error of linear light v, before saturation, tone curve and rounding; above 0.
            unit: of the tolerance: ``"DN"``, or ``"noise"``: standard deviations of the noise in the dark.
            frames: number of frames that the plan covers.
            start: end of the exposure of row 0 of frame 0, s.
        """
        return make_plan(self, tolerance, unit, frames, start)
