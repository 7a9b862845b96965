"""
Bits of one frame
=================

``receive`` needs the picture and the row time. It finds columns, chip rate and phase, and gives the bits.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import Camera, Chips, receive
from ocisac_fast.scene.simulation import lamp_bar, simulate_frames

bits = "".join(np.random.default_rng(1).choice(["0", "1"], 400))
camera = Camera(row_time=22.2e-6, exposure=60e-6)
lamp = lamp_bar(720, 120, width=15.0)
frame = next(simulate_frames(Chips(bits, 9e3), camera, 720, 120, start=9e-3, lamp=lamp, noise=4.0, dark_level=16.0))
(got,) = receive(frame, camera)
print(f"{len(got.bits)} bits, all sent: {got.bits in bits}; {got.chip_rate:.1f} chips/s")
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), width_ratios=(1, 3), layout="constrained")
left.imshow(frame, cmap="gray", aspect="auto")
left.set(xlabel="column", ylabel="row")
right.plot(frame @ got.weights, color="0.4")
for k, bit in enumerate(got.bits[:30]):
    right.text(got.phase + (k + 0.5) * got.rows_per_chip, 4.0, bit, ha="center")
right.set(xlim=(0, got.phase + 30 * got.rows_per_chip), xlabel="row", ylabel="combined columns / DN")
plt.show()
