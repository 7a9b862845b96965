"""
The row time from a lamp of known frequency
===========================================

A lamp of 500 Hz that shows 0.0111 cycles a row is filmed with rows of 22.2 µs. More rows give a smaller error.
"""

import matplotlib.pyplot as plt

from ocisac_fast import Camera, Tone, calibrate
from ocisac_fast.scene.simulation import simulate_frames

camera = Camera(row_time=22.2e-6, exposure=300e-6)
frame = next(simulate_frames(Tone(500.0), camera, 1080, 30, noise=4.0, dark_level=16.0))
heights = (200, 300, 400, 600, 800, 1080)
results = [calibrate(frame[:rows], 500.0) for rows in heights]
plt.figure(figsize=(7, 3.6), layout="constrained")
row_times = [found.row_time * 1e6 for found in results]
plt.errorbar(heights, row_times, [3e6 * found.row_time_std for found in results], fmt="o", capsize=3)
plt.axhline(22.2, color="0.6")
plt.xlabel("rows used")
plt.ylabel("row time / µs, ± 3 standard errors")
plt.show()
