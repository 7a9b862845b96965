"""Where methods fail, why, how badly, and what the library does then: the catalogue behind ``ocisac limits``."""

from __future__ import annotations

# Each module enters its limits: this is the order of the catalogue.
# isort: off
from ocisac_fast.limits import sampling, arithmetic, pixels, restoring, sensing  # noqa: F401

# isort: on
from ocisac_fast.limits.catalogue import LIMITS, Limit, Point, limit
from ocisac_fast.limits.drawing import draw
from ocisac_fast.limits.reporting import update_text

__all__ = ["LIMITS", "Limit", "Point", "draw", "limit", "update_text"]
