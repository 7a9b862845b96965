"""
Exposures without bands
=======================

Bands left of lamps on the mains (100 and 120 Hz, both ± 1 %) and the shortest exposure that leaves less than 2 %.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast.exposure import exposure_modulation, flicker_free_exposure, mains_lights

lights = mains_lights()
found = flicker_free_exposure(lights, 0.02)
times = np.linspace(1e-3, 60e-3, 1500)
plt.figure(figsize=(8, 3.8), layout="constrained")
for light in lights:
    plt.plot(times * 1e3, [exposure_modulation(light, each) for each in times], label=f"{light.frequency:.0f} Hz")
plt.axhline(0.02, color="0.6")
plt.plot(found.exposure * 1e3, found.modulation, "o", label=f"{found.exposure * 1e3:.2f} ms")
plt.xlabel("exposure / ms")
plt.ylabel("(max − min)/(max + min)")
plt.ylim(0, 0.3)
plt.legend()
plt.show()
