"""
Measured gains on the curve of theory
=====================================

The gain of a tone is \\|sinc(f·Tₑ)\\|. Each point is measured in one simulated frame of 40 columns, with three
standard errors.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import Camera, SquareWave, exposure_response, tone_gain
from ocisac_fast.scene.simulation import simulate_frames

frequency = 500.0  # Hz
exposures = np.linspace(0.2e-3, 6.2e-3, 25)  # s
gains, spreads = [], []
for seed, exposure in enumerate(exposures):
    camera = Camera(row_time=22.2e-6, exposure=exposure, dark_level=16.0)
    light = SquareWave(frequency, phase=float(seed))
    frame = next(simulate_frames(light, camera, 720, 40, noise=2.0, dark_level=16.0, seed=seed))
    found = tone_gain(frame, camera, frequency, waveform="square", pooled=True)
    gains.append(float(found.gain))
    spreads.append(3 * float(found.gain_std))
fine = np.linspace(1e-6, 6.4e-3, 1000)
plt.figure(figsize=(8, 4), layout="constrained")
plt.plot(frequency * fine, np.abs([exposure_response(frequency, each) for each in fine]), label="theory")
plt.errorbar(frequency * exposures, gains, spreads, fmt="o", mfc="none", label="measured")
plt.xlabel("frequency × exposure")
plt.ylabel("gain")
plt.legend()
plt.show()
