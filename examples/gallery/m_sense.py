"""
Speed of a texture
==================

Stripes pass a camera at 2 m/s, beside a lamp. ``sense`` tells both apart by their phases and measures the speed.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import Camera, sense
from ocisac_fast.demo import video_frames
from ocisac_fast.sensing import KnownMotion

frames = np.stack(list(video_frames()))
camera = Camera(row_time=22.2e-6, exposure=1202e-6, frame_time=1 / 30)
regions = sense(frames, camera, motion=KnownMotion(pitch=0.5e-3))  # m between neighbouring pixels
plt.figure(figsize=(6, 6), layout="constrained")
plt.imshow(frames[0], cmap="gray")
for found, colour in zip(regions, ("C1", "C2"), strict=False):
    box = found.region
    plt.gca().add_patch(plt.Rectangle(box[:2], box.width, box.height, fill=False, color=colour, lw=3))
    speed = "" if np.isnan(found.speed) else f", {found.speed:.3f} m/s"
    label = f"{found.kind}, {found.frequency:.1f} Hz{speed}"
    plt.text(box.x + 10, 40, label, color=colour, backgroundcolor="white")
plt.axis("off")
plt.show()
