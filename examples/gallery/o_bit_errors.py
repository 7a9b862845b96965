"""
Bit error rate over exposure
============================

Simulated rows of 40 frames for each exposure, 4.1 rows a chip, noise of 15 % of the swing. ``compare_bits`` aligns the
detected chips with the sent ones and counts. Bars are the 95 % interval (Clopper-Pearson), lines are theory.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast import Camera, Chips, compare_bits, detect_chips, integrate_exposure
from ocisac_fast.chips import ChipClock, detector_error_rates, fit_channel

random, per_chip, noise = np.random.default_rng(1), 4.1, 0.15
sent = random.integers(0, 2, 4000)
exposures, fine = np.array([1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0]), np.linspace(0.8, 3.0, 100)  # chips
received = {"slicer": [], "wiener": [], "mlse": []}
for exposure in exposures:
    camera = Camera(row_time=1e-4 / per_chip, exposure=exposure * 1e-4)
    clock = ChipClock(rows_per_chip=per_chip, phase=per_chip * exposure / 2, exposure_rows=per_chip * exposure)
    for start in range(0, 4000, 100):  # chips
        light = Chips(np.roll(sent, -start), chip_rate=1e4)
        signal = integrate_exposure(light, camera, 1080) + noise * random.standard_normal(1080)
        channel = fit_channel(signal, np.roll(sent, -start)[:260], clock, exposure_known=True)
        for name, frames in received.items():
            frames.append("".join(map(str, detect_chips(signal, camera, channel, method=name).bits[4:-4])))
figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
for (name, frames), colour in zip(received.items(), ("#D55E00", "#E69F00", "#0072B2"), strict=True):
    found = [compare_bits(frames[k : k + 40], sent, repeat=True) for k in range(0, len(frames), 40)]
    rates = np.array([one.rate for one in found])
    spread = np.abs(np.array([[one.low, one.high] for one in found]) - rates[:, None]).T
    axes.errorbar(exposures, rates, spread, fmt="o", color=colour, capsize=3, label=f"{name}, counted")
    theory = [getattr(detector_error_rates(per_chip, per_chip * each, noise), name) for each in fine]
    axes.semilogy(fine, theory, color=colour, label=f"{name}, theory")
axes.set(xlabel="exposure / chips", ylabel="bit error rate", ylim=(1e-4, 5.0))
axes.legend(ncols=3, fontsize="small", loc="upper left")
plt.show()
