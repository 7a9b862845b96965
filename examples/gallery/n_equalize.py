"""
Light before the exposure
=========================

``equalize`` undoes the exposure: two tones that it weakened and delayed come back.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import Camera, Sum, Tone, equalize, integrate_exposure

camera = Camera(row_time=22.2e-6, exposure=530e-6)
light = Sum([Tone(300.0, amplitude=60.0), Tone(1100.0, amplitude=40.0, phase=1.0)])
rows = 720
stored = integrate_exposure(light, camera, rows) + np.random.default_rng(3).normal(0, 0.5, rows)
truth = integrate_exposure(light, Camera(22.2e-6, 1e-9), rows)
restored = equalize(stored, camera, method="wiener")
plt.figure(figsize=(8, 3.8), layout="constrained")
plt.plot(truth, color="0.7", lw=4, label="light")
plt.plot(stored, label="rows")
plt.plot(restored, color="C3", lw=1, label="equalised")
plt.xlim(200, 420)
plt.xlabel("row")
plt.ylabel("light / DN")
plt.legend(loc="upper right")
plt.show()
