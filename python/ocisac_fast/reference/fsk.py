"""CM-FSK by least squares: each tone fitted beside mean and slope, and the binomial sum of the error rate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera


def fsk_demodulate(
    column: npt.ArrayLike, camera: Camera, tones: Sequence[float], *, amplitude: float | None = None
) -> tuple[int, npt.NDArray[np.float64]]:
    """Index of the likeliest tone and ln p(rows | tone), the likeliest at 0.

    Mean, slope, cosine and sine are fitted for each tone; what they explain beyond mean and slope is r². The noise is
    what the strongest tone leaves. I0 is summed from its integral.
    """
    rows = np.asarray(column, dtype=float)
    count = len(rows)
    n = np.arange(count)
    plain = np.stack([np.ones(count), n - n.mean()], axis=1)
    left = rows - plain @ np.linalg.lstsq(plain, rows, rcond=None)[0]
    lengths = []
    for tone in tones:
        turn = 2 * np.pi * ((tone * camera.row_time * n) % 1.0)
        model = np.column_stack([plain, np.cos(turn), np.sin(turn)])
        fit = model @ np.linalg.lstsq(model, rows, rcond=None)[0]
        lengths.append(math.sqrt(max(float(left @ left) - float(((rows - fit) ** 2).sum()), 0.0)))
    strongest = int(np.argmax(lengths))
    variance = (float(left @ left) - lengths[strongest] ** 2) / (count - 4)
    exposure = camera.exposure or 0.0
    gains = [max(abs(float(np.sinc(tone * exposure))), 1e-3) for tone in tones]
    if amplitude is None:
        energy = max(lengths[strongest] ** 2 - 2 * variance, 0.0)
        amplitude = math.sqrt(energy / (count / 2)) / gains[strongest]
    turn = (np.arange(4096) + 0.5) * np.pi / 4096
    likelihoods = []
    for length, gain in zip(lengths, gains, strict=True):
        expected = amplitude * gain * math.sqrt(count / 2)
        x = expected * length / variance
        log_i0 = x + math.log(float(np.mean(np.exp(x * (np.cos(turn) - 1)))))
        likelihoods.append(log_i0 - expected**2 / (2 * variance))
    array = np.array(likelihoods)
    return int(np.argmax(array)), array - array.max()


def fsk_symbol_error_rate(tones: int, snr: float) -> float:
    """The binomial sum, term by term; loses its digits beyond 32 tones."""
    others = range(1, tones)
    signs = [(-1.0) ** (k + 1) * math.comb(tones - 1, k) / (k + 1) for k in others]
    return math.fsum(sign * math.exp(-k / (k + 1) * snr) for sign, k in zip(signs, others, strict=True))
