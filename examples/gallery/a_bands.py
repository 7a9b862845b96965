"""
One lamp at four exposures
==========================

The longer a row is exposed, the softer the bands of a lamp of 500 Hz. At 2 ms, one period, they vanish.
"""

import matplotlib.pyplot as plt

from ocisac_fast import Camera, SquareWave
from ocisac_fast.scene.simulation import simulate_frames

exposures = (100e-6, 600e-6, 1200e-6, 2000e-6)  # s
figure, axes = plt.subplots(1, 4, figsize=(9, 4), sharey=True, layout="constrained")
for axis, exposure in zip(axes, exposures, strict=True):
    camera = Camera(row_time=22.2e-6, exposure=exposure)
    frame = next(simulate_frames(SquareWave(500.0), camera, rows=720, columns=200, noise=2.0, dark_level=16.0))
    axis.imshow(frame, cmap="gray", vmin=0, vmax=255)
    axis.set(title=f"{exposure * 1e6:.0f} µs", xticks=[])
axes[0].set_ylabel("row, in order of time")
plt.show()
