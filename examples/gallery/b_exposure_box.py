"""
Chips through the exposure
==========================

A row holds the mean of the light over its exposure. Edges become ramps; an exposure of several chips mixes them.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import Camera, Chips, integrate_exposure

light = Chips("0110100111010010", chip_rate=5e3)
rows = 140
time = np.arange(rows) * 22.2e-6 * 1e3  # ms
figure, axes = plt.subplots(3, 1, figsize=(8, 5), sharex=True, layout="constrained")
for axis, chips in zip(axes, (0.2, 1.0, 3.0), strict=True):
    camera = Camera(row_time=22.2e-6, exposure=chips / 5e3)
    axis.plot(time, integrate_exposure(light, Camera(22.2e-6, 1e-9), rows), color="0.75", label="light")
    axis.plot(time, integrate_exposure(light, camera, rows), ".-", label=f"rows, exposure of {chips:g} chips")
    axis.set_ylabel("mean light")
    axis.legend(loc="upper right")
axes[-1].set_xlabel("time / ms")
plt.show()
