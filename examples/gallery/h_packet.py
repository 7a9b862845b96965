"""
A text from many frames
=======================

Each frame shows a part of the packet. When enough bytes have come, the text is complete.
"""

import matplotlib.pyplot as plt

from ocisac_fast import Camera, Receiver, transmit
from ocisac_fast.scene.simulation import simulate_frames

text = b"A lamp sends, a camera reads: rows are samples of its light, and any third of the bytes is enough." * 3
light = transmit(text).waveform(chip_rate=15e3)
camera = Camera(row_time=22.2e-6, exposure=200e-6, frame_time=1 / 30)
receiver = Receiver(camera, chip_rate=15e3)
shares = []
for frame in simulate_frames(light, camera, 1080, 20, frames=60, noise=4.0, dark_level=16.0):
    got = receiver.push(frame)
    shares.append(1.0 if got.payload is not None else got.stretch.share)
    if got.payload is not None:
        break
print(f"after {len(shares)} frames: {got.payload.data[:29]}…")
plt.figure(figsize=(7, 3.4), layout="constrained")
plt.bar(range(1, len(shares) + 1), shares)
plt.xlabel("frame")
plt.ylabel("bytes known / bytes needed")
plt.show()
