"""
A lamp of unknown frequency
===========================

``find_frequency`` fits trend, tone and harmonics of one frequency; the fit lies on the rows.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import Camera, SquareWave, find_frequency, integrate_exposure, tone_gain
from ocisac_fast.scene.simulation import simulate_frames

camera = Camera(row_time=22.2e-6, exposure=400e-6, dark_level=16.0)
light = SquareWave(317.3, phase=0.8)
frame = next(simulate_frames(light, camera, 720, 60, swing=120.0, noise=8.0, dark_level=16.0))
found = find_frequency(frame, camera, waveform="square")
gain = tone_gain(frame, camera, found.frequency, waveform="square", pooled=True)
fit = SquareWave(found.frequency, phase=float(gain.phase), amplitude=2 * float(gain.mean))
plt.figure(figsize=(8, 3.6), layout="constrained")
plt.plot(frame[:, 0], ".", ms=3, color="0.6", label="one column")
plt.plot(16 + integrate_exposure(fit, camera, 720), label=f"{found.frequency:.2f} ± {found.frequency_std:.2f} Hz")
plt.xlabel("row")
plt.ylabel("stored value / DN")
plt.legend(loc="upper right")
print(f"317.3 Hz sent, {found.frequency:.2f} Hz found in {np.size(frame)} pixels")
plt.show()
