"""
Lamps in a picture
==================

``detect_sources`` finds every modulated lamp: box, frequency, gain.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import Camera, Tone, detect_sources, integrate_exposure
from ocisac_fast.scene.simulation import texture

camera = Camera(row_time=22.2e-6, exposure=100e-6)
rows, columns = 720, 960
picture = 40 * texture(rows, columns, 0.1) + np.random.default_rng(2).normal(0, 2, (rows, columns))
y, x = np.mgrid[:rows, :columns]
for left, top, radius, frequency in ((200, 200, 90, 900.0), (480, 460, 130, 640.0), (780, 250, 70, 1700.0)):
    shape = (x - left) ** 2 + (y - top) ** 2 < radius**2
    picture += 140 * shape * integrate_exposure(Tone(frequency), camera, rows)[:, None]
stored = np.clip(picture, 0, 255).astype(np.uint8)
plt.figure(figsize=(7, 5), layout="constrained")
plt.imshow(stored, cmap="gray")
for light in detect_sources(stored, camera):
    box = light.region
    plt.gca().add_patch(plt.Rectangle(box[:2], box.width, box.height, fill=False, color="C1"))
    plt.text(box.x, box.y - 8, f"{light.frequency:.1f} Hz", color="C1")
plt.axis("off")
plt.show()
