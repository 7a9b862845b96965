"""
Exposures longer than a chip
============================

Error rates by theory of a threshold, of a linear filter and of maximum likelihood, with 4 rows a chip and noise of
4 % of the swing.
"""

import matplotlib.pyplot as plt
import numpy as np

from ocisac_fast.chips import detector_error_rates

exposures = np.arange(0.25, 12.1, 0.25)  # chips
rates = [detector_error_rates(rows_per_chip=4, exposure_rows=4 * chips, noise=0.04) for chips in exposures]
plt.figure(figsize=(8, 4), layout="constrained")
for name, label in (("slicer", "threshold"), ("wiener", "linear filter"), ("mlse", "maximum likelihood")):
    plt.semilogy(exposures, [max(getattr(each, name), 1e-12) for each in rates], label=label)
plt.ylim(1e-9, 1)
plt.xlabel("exposure / chips")
plt.ylabel("share of wrong chips")
plt.legend()
plt.show()
