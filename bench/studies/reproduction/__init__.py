"""The paper's testbed, figures and table, made again: what ``make reproduce`` shows.

Dong, Cao, Wang, Sensors 2025, 25(22), 7061. :data:`FIGURES` holds what can be made, by its number in the paper.
"""

from studies.reproduction.figures import FIGURES, Figure, Workshop
from studies.reproduction.gains import GainResult, chi_squared, measure
from studies.reproduction.testbed import Setting, settings

__all__ = ["FIGURES", "Figure", "GainResult", "Setting", "Workshop", "chi_squared", "measure", "settings"]
