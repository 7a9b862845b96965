"""Limits of methods: cause, error, and the library's behaviour; the catalogue of ``make limits``."""

from __future__ import annotations

# Each module registers its limits: this is the order of the catalogue.
# isort: off
from studies.limits import sampling, arithmetic, pixels, restoring, sensing, field  # noqa: F401

# isort: on
from studies.limits.catalogue import LIMITS, Limit, Point, limit
from studies.limits.drawing import draw
from studies.limits.reporting import update_text

__all__ = ["LIMITS", "Limit", "Point", "draw", "limit", "update_text"]
