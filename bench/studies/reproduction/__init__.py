"""Reproduction of the paper's testbed, figures and table, for ``make reproduce``.

Dong, Cao, Wang, Sensors 2025, 25(22), 7061. :data:`FIGURES` contains the figures by their numbers in the paper.
"""

from studies.reproduction.figures import FIGURES, Figure, Workshop
from studies.reproduction.gains import GainResult, chi_squared, measure
from studies.reproduction.testbed import Setting, settings

__all__ = ["FIGURES", "Figure", "GainResult", "Setting", "Workshop", "chi_squared", "measure", "settings"]
