"""Studies that measure the library: chart, limits, reproduction of the paper, and a simulated drive.

Each is a program: ``PYTHONPATH=bench python -m studies.chart --help``.
"""
