"""Reproduction of the paper's testbed, figures and table, for ``make reproduce``.

Dong, Cao, Wang, Sensors 2025, 25(22), 7061.
"""
