"""Detectors of chips behind one interface, and the errors each is bound to make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.chips.channel import ChannelEstimate, as_tuple
from ocisac_fast.core.arrays import as_columns
from ocisac_fast.core.checks import checked

FloatArray = npt.NDArray[np.float64]
DetectorMethod = Literal["auto", "slicer", "inverse", "wiener", "dfe", "reduced", "mlse"]


@dataclass(frozen=True, slots=True)
class DetectedChips:
    """All chips that any row of a frame sees; those at its ends are seen by a few rows only.

    Attributes:
        llr: (chips,), (chips, columns) or (frames, chips, columns): ln p(rows | bright) - ln p(rows | dark), above 0
            for a bright chip, 0 where no row tells.
        first: number of the first chip, as the channel counts them.
        method: the detector that was used; for ``"auto"`` the one chosen.
    """

    llr: FloatArray
    first: int
    method: str

    @property
    def bits(self) -> npt.NDArray[np.uint8]:
        """1 where a chip is bright; shape of ``llr``."""
        return (self.llr > 0).astype(np.uint8)

    @property
    def error_rate(self) -> float:
        """Share of wrong chips to be expected, as the detector itself sees it: the mean of 1/(1 + exp|llr|)."""
        return float(np.mean(1 / (1 + np.exp(np.abs(self.llr))))) if self.llr.size else float("nan")


@dataclass(frozen=True, slots=True)
class DetectorErrorRates:
    """Share of wrong chips of each detector, away from the frame's ends; ``reduced`` makes those of ``mlse``."""

    slicer: float
    inverse: float
    wiener: float
    dfe: float
    mlse: float


@checked
def detect_chips(
    columns: npt.ArrayLike, camera: Camera, channel: ChannelEstimate, method: DetectorMethod = "auto"
) -> DetectedChips:
    """Chips of columns whose channel is known, at any exposure up to 24 chips.

    ======== ============================================================================================
    slicer   the rows in the middle of each chip against a threshold half way between dark and bright
    inverse  :func:`equalize` (inverse sinc), then as the slicer
    wiener   the best linear estimate of each chip from all rows (least mean square error), and a threshold
    dfe      the same with the chips before it decided and their part in the exposure's box taken away
    reduced  the likeliest sequences of chips, as far as they are not hopeless (M-algorithm): nearly mlse
    mlse     all sequences (:func:`chip_llr`), up to 15 chips; time doubles with every chip
    auto     slicer where it makes at most 1.5 times the errors of mlse, or hardly any (1e-9); else reduced
    ======== ============================================================================================

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), rows in time order: light of one channel.
        camera: its tone curve and dark level are undone; clock and exposure are those of the channel.
        channel: clock, levels and noise, as :func:`fit_channel`, :func:`refine_channel` or :func:`find_channel` give.
        method: the detector.

    Returns:
        Log-likelihood ratios; those of slicer, inverse, wiener and dfe take the other chips as Gaussian noise.

    Raises:
        ValueError: an argument outside its range or shape; an exposure longer than the detector takes.
    """
    array = as_columns(columns, scan_axis=camera.scan_axis)
    llr, first, used = _core.detect_chips(array, camera._handle, as_tuple(channel), method)
    if array.ndim < 3:
        llr = llr[0]
    if array.ndim < 2:
        llr = llr[:, 0]
    return DetectedChips(llr, first, used)


@checked
def detector_error_rates(rows_per_chip: float, exposure_rows: float, noise: float) -> DetectorErrorRates:
    """What each detector gets wrong where the channel is known: formulae in docs/receiver.md.

    Exact for slicer, inverse and wiener (the mean of Q((g_0/2 + sum of +-g_j/2)/noise) over the signs, for the weights
    g of the chips in the value that is compared), for dfe without the errors that follow from a wrong decision; for
    mlse a union bound over the sequences that are likeliest taken for each other.

    Args:
        rows_per_chip: above 0.
        exposure_rows: rows, 0 to 24 chips.
        noise: standard deviation of a row over the swing from steady dark to steady bright, above 0.

    Raises:
        ValueError: an argument outside its range; the message names it.
    """
    return DetectorErrorRates(*_core.detector_error_rates(float(rows_per_chip), float(exposure_rows), float(noise)))
