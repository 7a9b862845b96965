"""
One exposure for a lamp and for motion
======================================

The sum of both signals over the exposure, and its maximum, which ``best_exposure`` finds in constant time.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import best_exposure, exposure_objective

lamp, motion = 500.0, 350.0  # Hz
best = best_exposure(lamp, motion)
paper = best_exposure(lamp, motion, method="closed-form")
times = np.linspace(1e-6, 1 / motion, 600)
plt.figure(figsize=(8, 3.8), layout="constrained")
plt.plot(times * 1e3, exposure_objective(times, lamp, motion) * 1e3)
for found, label in ((best, "exact"), (paper, "the paper's closed form")):
    plt.plot(found.exposure * 1e3, found.objective * 1e3, "o", label=f"{label}: {found.exposure * 1e3:.3f} ms")
plt.xlabel("exposure / ms")
plt.ylabel("objective Y / ms")
plt.legend()
plt.show()
