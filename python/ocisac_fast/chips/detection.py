"""Detectors of chips behind one interface, and their theoretical error rates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.chips.channel import ChannelEstimate, as_tuple
from ocisac_fast.core.arrays import Float64s, as_columns
from ocisac_fast.core.checks import checked
from ocisac_fast.core.results import Result

DETECTORS = tuple(_core.detector_names())  # of the list in cpp/src/chips/detect_chips.cpp, "auto" the last


@dataclass(frozen=True, slots=True, repr=False)
class DetectedChips(Result):
    """All chips whose light reaches any row of a frame; the first and last ones reach only a few rows.

    Attributes:
        llr: (chips,), (chips, columns) or (frames, chips, columns): ln p(rows | bright) - ln p(rows | dark), above 0
            for a bright chip, 0 for a chip that reaches no row.
        first: number of the first chip, as the channel counts them.
        method: the detector used; for ``"auto"`` the selected one.
    """

    llr: Float64s
    first: int
    method: str

    @property
    def bits(self) -> npt.NDArray[np.uint8]:
        """1 for a bright chip; shape of ``llr``."""
        return (self.llr > 0).astype(np.uint8)

    @property
    def error_rate(self) -> float:
        """Expected share of wrong chips from the detector's own output: the mean of 1/(1 + exp|llr|)."""
        return float(np.mean(1 / (1 + np.exp(np.abs(self.llr))))) if self.llr.size else float("nan")


@dataclass(frozen=True, slots=True, repr=False)
class DetectorErrorRates(Result):
    """Share of wrong chips of each detector, away from the frame's ends; for ``reduced`` use ``mlse``.

    Attributes:
        slicer, inverse, wiener, dfe, mlse: shares, 0 to 1.
    """

    slicer: float
    inverse: float
    wiener: float
    dfe: float
    mlse: float


@checked
def detect_chips(
    columns: npt.ArrayLike, camera: Camera, channel: ChannelEstimate, *, method: str = "auto"
) -> DetectedChips:
    """Detect the chips of columns whose channel is known, at any exposure up to 24 chips.

    ======== ============================================================================================
    slicer   threshold half way between dark and bright on the rows in the middle of each chip
    inverse  :func:`equalize` (inverse sinc), then the slicer
    wiener   linear estimate of each chip from all rows with least mean square error, then a threshold
    dfe      wiener after the decided chips before it are subtracted (decision feedback)
    reduced  M-algorithm: search over the most likely sequences of chips; error rate close to mlse
    mlse     search over all sequences (:func:`chip_llr`), up to 15 chips; time doubles with every chip
    auto     slicer if its predicted error rate is at most 1.5 times that of mlse, or 1e-9; else reduced
    ======== ============================================================================================

    Args:
        columns: (rows,), (rows, columns) or (frames, rows, columns), rows in time order: light of one channel.
        camera: gives tone curve and dark level, which are inverted; clock and exposure are those of ``channel``.
        channel: clock, levels and noise from :func:`fit_channel`, :func:`refine_channel` or :func:`find_channel`.
        method: one of :data:`DETECTORS`.

    Returns:
        Log-likelihood ratios; slicer, inverse, wiener and dfe model the other chips as Gaussian noise.

    Raises:
        ValueError: an argument outside its range or shape; an exposure longer than the detector supports.
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
    """Theoretical error rate of each detector for a known channel; formulas in docs/explanation/receiver.md.

    Exact for slicer, inverse and wiener: the mean of Q((g_0/2 + sum of +-g_j/2)/noise) over the signs, where g are the
    weights of the chips in the value that is compared. For dfe without the errors that follow from a wrong decision.
    For mlse the sum over the likeliest pairs of sequences, which is no bound: overlaps count twice, other pairs are
    left out.

    Args:
        rows_per_chip: 0.01 to 1000: the computing time grows with its square.
        exposure_rows: rows, 0 to 24 chips.
        noise: standard deviation of a row over the swing from steady dark to steady bright, above 0.
    """
    return DetectorErrorRates(*_core.detector_error_rates(rows_per_chip, exposure_rows, noise))
