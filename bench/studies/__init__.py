"""Studies that measure the library: gain methods, limits, the paper, links over distance, a simulated drive.

Each is a program: ``PYTHONPATH=bench python -m studies.chart --help``.
"""
