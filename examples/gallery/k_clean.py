"""
A picture without its bands
===========================

A rippling lamp lights balls of the demo's picture; ``remove_bands`` finds the lamp and its share, and restores the
picture.
"""

import matplotlib.pyplot as plt

from ocisac_fast import Camera, remove_bands
from ocisac_fast.demo import banded_picture

stored = banded_picture()
cleaned = remove_bands(stored, Camera(row_time=22.2e-6))
figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for axis, picture, title in zip(axes, (stored, cleaned.frames), ("stored", "remove_bands"), strict=True):
    axis.imshow(picture, cmap="gray", vmin=0, vmax=255)
    axis.set(title=title, xticks=[], yticks=[])
print(f"lamp of {cleaned.frequency[0]:.1f} Hz")
plt.show()
