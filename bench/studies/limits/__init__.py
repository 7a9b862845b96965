"""Limits of methods: a plain method's error and the library's answer; the catalogue of ``make limits``."""

from __future__ import annotations

# Each module registers its limits: this is the order of the catalogue.
# isort: off
from studies.limits import sampling, pixels, restoring, sensing, receiving  # noqa: F401

# isort: on
from studies.limits.catalogue import LIMITS as LIMITS, Limit as Limit, Point as Point
from studies.limits.drawing import draw as draw
