"""The channel from light to rows, estimated from known chips: clock, exposure, levels. All lengths are in rows.

Row n integrates the chips over rows n - exposure/2 ... n + exposure/2; chip k lies between ``phase + k rows_per_chip``
and ``phase + (k + 1) rows_per_chip``. With the mean s_n of the chips, row n is dark_n + swing_n s_n plus noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import Count, Finite, NotNegative, Positive, Within, checked, checked_class
from ocisac_fast.core.results import Result

Degree = Annotated[int, Within(0, 6)]


@dataclass(frozen=True, slots=True, repr=False)
class ClockErrors(Result):
    """Standard errors of a clock, or their bounds.

    Attributes:
        chip: the chip in the middle of those used, where phase and rows per chip are nearly independent.
        covariance: (3, 3) of the phase of that chip, rows per chip and exposure, rows^2; zeros for a known exposure.
    """

    chip: int
    covariance: Float64s

    @property
    def phase_std(self) -> float:
        """Standard error of the beginning of chip ``chip``, rows."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def rows_per_chip_std(self) -> float:
        """Standard error of the length of a chip, rows."""
        return float(np.sqrt(self.covariance[1, 1]))

    @property
    def exposure_rows_std(self) -> float:
        """Standard error of the exposure, rows."""
        return float(np.sqrt(self.covariance[2, 2]))


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True)
class ChipClock:
    """Positions of a light's chips in the rows of a frame, and the exposure that blurs them.

    Args:
        rows_per_chip: length of a chip, rows, above 0; need not be whole.
        phase: row at which chip 0 begins, fractional, in the middle of the exposure (of its edge's ramp).
        exposure_rows: exposure, rows, 0 or above; values below 0.001 rows are raised to it.
    """

    rows_per_chip: Positive
    phase: Finite
    exposure_rows: NotNegative

    def _for_core(self) -> tuple[float, float, float]:
        return self.rows_per_chip, self.phase, self.exposure_rows


@dataclass(frozen=True, slots=True, repr=False)
class ChannelEstimate(Result):
    """A channel estimated by least squares.

    Attributes:
        rows_per_chip: length of a chip, rows.
        phase: row at which chip 0 begins, fractional: the middle of its edge's ramp.
        exposure_rows: exposure, rows.
        errors: standard errors, from the residual of the rows.
        dark: Legendre coefficients of the level of steady 0 along the frame, from -1 (first row) to 1 (last row).
        swing: Legendre coefficients of the step from steady 0 to steady 1.
        noise: standard deviation of a row about the model.
        rows: first row of the fit and the one after the last; only rows that see known chips are used.
        converged: True if the iteration converged.
    """

    rows_per_chip: float
    phase: float
    exposure_rows: float
    errors: ClockErrors
    dark: Float64s
    swing: Float64s
    noise: float
    rows: tuple[int, int]
    converged: bool

    @property
    def clock(self) -> ChipClock:
        """Clock and exposure."""
        return ChipClock(rows_per_chip=self.rows_per_chip, phase=self.phase, exposure_rows=self.exposure_rows)

    @checked
    def levels(self, rows: int) -> Float64s:
        """(2, rows): level of steady 0 and of steady 1 in each of the ``rows`` rows of a frame."""
        along = np.linspace(-1, 1, rows) if rows > 1 else np.zeros(1)
        dark = np.polynomial.legendre.legval(along, self.dark)
        return np.stack([dark, dark + np.polynomial.legendre.legval(along, self.swing)])


@dataclass(frozen=True, slots=True, repr=False)
class PreambleMatch(Result):
    """A detected preamble.

    Attributes:
        channel: the channel there; ``channel.phase`` is the row at which the preamble's first chip begins.
        explained: share of the variance of its rows that the preamble explains.
        certainty: ln of the odds against random chips of the same rate, minus ln of the number of places tried.
    """

    channel: ChannelEstimate
    explained: float
    certainty: float


@dataclass(frozen=True, slots=True, repr=False)
class Pooled(Result):
    """Mean of several values weighted by the inverse squares of their errors.

    Attributes:
        value: the mean.
        std: its standard error.
        count: number of values.
    """

    value: float
    std: float
    count: int


@dataclass(frozen=True, slots=True, repr=False)
class RefinedChannel(Result):
    """The channel of a whole frame and the chips that it was estimated from.

    Attributes:
        channel: the channel.
        chips: (chips,) 0 and 1, all chips whose light reaches any row of the frame; the first and last reach few.
        first: number of the first of them.
        settled: True if the last detection changed no chip.
        even: False if a part of the frame has a larger residual than the others: the clock was lost there.
    """

    channel: ChannelEstimate
    chips: Float64s
    first: int
    settled: bool
    even: bool


@dataclass(frozen=True, slots=True, repr=False)
class TrackedClock(Result):
    """The clock predicted for a frame.

    Attributes:
        rows_per_chip: length of a chip, rows.
        phase: row at which chip ``chip`` begins, the chip beginning nearest row 0.
        exposure_rows: exposure, rows.
        chip: number of this chip, counted from the first frame.
        covariance: (3, 3) of that phase, rows per chip and exposure.
        chips_lost: standard error of the count of chips since the last update; the count is reliable below 0.2.
    """

    rows_per_chip: float
    phase: float
    exposure_rows: float
    chip: int
    covariance: Float64s
    chips_lost: float

    @property
    def clock(self) -> ChipClock:
        """Clock and exposure."""
        return ChipClock(rows_per_chip=self.rows_per_chip, phase=self.phase, exposure_rows=self.exposure_rows)

    @checked
    def channel(self, earlier: ChannelEstimate, rows: int) -> ChannelEstimate:
        """Initial channel of a frame: this clock with the levels and noise of an earlier frame.

        Args:
            earlier: the channel of a frame before.
            rows: rows of the frame.

        Returns:
            A start for :func:`refine_channel`; its chip 0 is chip ``chip`` of the light.
        """
        return replace(
            earlier,
            rows_per_chip=self.rows_per_chip,
            phase=self.phase,
            exposure_rows=self.exposure_rows,
            errors=ClockErrors(0, self.covariance),
            rows=(0, rows),
            converged=False,
        )


# detect(rows, rows_per_chip, phase, exposure_rows, noise, first, count) returns the levels of chips first ... first +
# count - 1, all chips that `rows` (0 steady dark, 1 steady bright) see; `phase` is relative to the first of the rows.
Detect = Callable[[Float64s, float, float, float, float, int, int], npt.ArrayLike]


@checked_class
class ClockTracker:
    """Kalman filter of a light's clock from frame to frame: phase, rows per chip and rows per frame.

    The filter predicts across the rows between frames that are not read out. The exposure is pooled separately.

    Args:
        frame_rows: rows from the beginning of a frame to the next: frame time / row time.
        frame_rows_std: standard error of ``frame_rows``, which is estimated along with the clock.
        drift: relative random walk of the chip rate from one frame to the next.
        exposure_wander: relative random walk of the exposure.
    """

    def __init__(
        self, frame_rows: float, *, frame_rows_std: float = 0.0, drift: float = 1e-6, exposure_wander: float = 1e-4
    ) -> None:
        self._handle = _core.ClockTracker(frame_rows, frame_rows_std, drift, exposure_wander)

    @checked
    def update(self, frame: int, channel: ChannelEstimate) -> bool:
        """Update with the channel of a frame; frames in ascending order, any of them may be missing.

        Returns:
            False if the count of chips restarted: the prediction was unreliable (a standard error above 0.2 chips), or
            the clock deviates by more than six standard errors (another light, a jump).

        Raises:
            ValueError: a frame that is not after the last one.
        """
        covariance = channel.errors.covariance.ravel().tolist()
        clock = (channel.rows_per_chip, channel.phase, channel.exposure_rows)
        return self._handle.update(frame, *clock, channel.errors.chip, covariance)

    @checked
    def predict(self, frame: int) -> TrackedClock | None:
        """Predict the clock in a frame not before the last update; None before the first update.

        Raises:
            ValueError: a frame before the last update.
        """
        values = self._handle.predict(frame)
        if values is None:
            return None
        rows_per_chip, phase, exposure_rows, chip, covariance, lost = values
        return TrackedClock(rows_per_chip, phase, exposure_rows, chip, np.array(covariance).reshape(3, 3), lost)

    def reset(self) -> None:
        """Discard the state."""
        self._handle.reset()


@checked
def expose_chips(chips: npt.ArrayLike, rows: Count, clock: ChipClock, *, first: int = 0) -> Float64s:
    """Chips integrated over the exposure of each row: s_n = (1/exposure) times their integral over the exposure.

    Args:
        chips: (chips,) levels, 0 dark to 1 bright; the first and the last extend to infinity.
        rows: rows of the frame.
        clock: of the chips.
        first: number of the first of ``chips``.

    Returns:
        (rows,) float64.
    """
    return _core.expose_chips(_vector(chips, "chips"), first, rows, *clock._for_core())


@checked
def fit_channel(
    signal: npt.ArrayLike,
    chips: npt.ArrayLike,
    clock: ChipClock,
    *,
    first: int = 0,
    exposure_known: bool = False,
    dark_degree: Degree = 1,
    swing_degree: Degree = 0,
) -> ChannelEstimate | None:
    """Estimate clock, exposure and levels from a column with known chips, by Gauss-Newton on the exact model.

    Args:
        signal: (rows,) a column, or columns combined.
        chips: (chips,) levels, 0 dark to 1 bright. Rows that see other chips are excluded.
        clock: initial value, accurate to half a chip at every chip; its exposure is an initial value or the known one.
        first: number of the first of ``chips``.
        exposure_known: keep the exposure fixed.
        dark_degree: degree of the polynomial of the dark level along the frame, 0 to 6.
        swing_degree: degree of the polynomial of the step from dark to bright.

    Returns:
        The channel; None if there are fewer rows than unknowns, or the chips (all alike) do not determine it.
    """
    values = _core.fit_channel(
        _vector(signal, "signal"),
        _vector(chips, "chips"),
        first,
        *clock._for_core(),
        dark_degree,
        swing_degree,
        exposure_known,
    )
    return None if values is None else _channel(values)


@checked
def clock_bounds(
    chips: npt.ArrayLike,
    swing: npt.ArrayLike,
    clock: ChipClock,
    *,
    noise: float,
    first: int = 0,
    exposure_known: bool = False,
    dark_degree: Degree = 1,
    swing_degree: Degree = 0,
) -> ClockErrors | None:
    """Cramer-Rao bounds of rows per chip, phase and exposure for white noise and unknown levels.

    Args:
        chips: (chips,) levels, 0 dark to 1 bright.
        swing: (rows,) the step from dark to bright in each row.
        clock: of the chips.
        noise: standard deviation of a row, in the unit of ``swing``.
        first: number of the first of ``chips``.
        exposure_known: the exposure is not estimated.
        dark_degree: as in :func:`fit_channel`.
        swing_degree: as in :func:`fit_channel`.

    Returns:
        The bounds; None if the chips do not determine the channel.
    """
    values = _core.clock_bounds(
        _vector(chips, "chips"),
        first,
        *clock._for_core(),
        _vector(swing, "swing"),
        noise,
        dark_degree,
        swing_degree,
        exposure_known,
    )
    return None if values is None else _errors(values)


@checked
def find_preamble(
    signal: npt.ArrayLike,
    preamble: npt.ArrayLike,
    *,
    rows_per_chip: float,
    tolerance: float = 0.02,
    exposure_rows: float | None = None,
    max_exposure_chips: float = 14.0,
    max_matches: Count = 1,
) -> list[PreambleMatch]:
    """Detect a known sequence of chips in a column, at any exposure, and estimate the channel there.

    The column, without mean and slope, is correlated at every place with the exposed sequence over a grid of exposures
    and rates. The channel is fitted from the best places.

    Args:
        signal: (rows,) a column, or columns combined, that contains the whole sequence.
        preamble: (chips,) levels, 0 dark to 1 bright, at least two.
        rows_per_chip: nominal, 0.01 to 100,000 rows.
        tolerance: maximum relative deviation of the true rows per chip, 0 to 0.5.
        exposure_rows: known exposure, rows; None: estimated.
        max_exposure_chips: upper bound of an estimated exposure, chips. The sequence must be 6 chips longer.
        max_matches: maximum number of matches.

    Returns:
        The matches, the most certain first; empty if the sequence is not detected.
    """
    found = _core.find_preamble(
        _vector(signal, "signal"),
        _vector(preamble, "preamble"),
        rows_per_chip,
        tolerance,
        exposure_rows,
        max_exposure_chips,
        max_matches,
    )
    return [PreambleMatch(_channel(values), explained, certainty) for values, explained, certainty in found]


@checked
def refine_channel(
    signal: npt.ArrayLike,
    start: ChannelEstimate,
    *,
    detect: Detect | None = None,
    known: npt.ArrayLike = (),
    known_first: int = 0,
    exposure_known: bool = False,
    highest_degree: Degree = 4,
) -> RefinedChannel | None:
    """Extend a channel estimate to the whole frame by alternate detection and least squares.

    Rows are added outwards, in each step only as far as the predicted clock is accurate.

    Args:
        signal: (rows,) a column, or columns combined.
        start: from :func:`find_preamble` or :func:`fit_channel`.
        detect: a detector of exposed chips as :data:`Detect`; None: ``"auto"`` of :func:`detect_chips`.
        known: chips that are not detected: the preamble.
        known_first: number of the first of them.
        exposure_known: keep the exposure of ``start``.
        highest_degree: maximum degree of the polynomials of dark and swing along the frame, 0 to 6; the data decide.

    Returns:
        The channel with all chips of the frame; None if the detected chips do not determine one.
    """
    given = np.asarray(known, dtype=np.float64)
    values = _core.refine_channel(
        _vector(signal, "signal"),
        as_tuple(start),
        detect,
        exposure_known,
        highest_degree,
        given if given.size == 0 else _vector(given, "known"),
        known_first,
    )
    return None if values is None else _refined(values)


@checked
def find_channel(
    signal: npt.ArrayLike,
    *,
    detect: Detect | None = None,
    rows_per_chip: float,
    tolerance: float = 0.02,
    exposure_rows: float | None = None,
    max_exposure_chips: float = 7.0,
    exposure_known: bool = False,
    highest_degree: Degree = 4,
) -> RefinedChannel | None:
    """Estimate the channel without a preamble, from a nominal chip rate.

    The fit starts from several phases, rates and exposures on a short part of the frame; the result with the least
    residual is refined over the frame.

    Args:
        signal: (rows,) a column, or columns combined.
        detect: a detector of exposed chips as :data:`Detect`; None: ``"auto"`` of :func:`detect_chips`.
        rows_per_chip: nominal, 0.01 to 100,000 rows.
        tolerance: maximum relative deviation of the true rows per chip, 0 to 0.5.
        exposure_rows: known exposure, rows; None: estimated.
        max_exposure_chips: upper bound of an estimated exposure, chips.
        exposure_known: keep ``exposure_rows`` fixed; otherwise it is an initial value.
        highest_degree: as in :func:`refine_channel`.

    Returns:
        The channel with all chips of the frame, numbered from an arbitrary one; None if no start leads to one.
    """
    values = _core.find_channel(
        _vector(signal, "signal"),
        rows_per_chip,
        tolerance,
        exposure_rows,
        max_exposure_chips,
        detect,
        exposure_known,
        highest_degree,
    )
    return None if values is None else _refined(values)


@checked
def chip_llr(
    rows: npt.ArrayLike,
    clock: ChipClock,
    *,
    noise: float,
    first: int,
    count: Annotated[int, Within(0)],
    method: str = "mlse",
) -> Float64s:
    """Maximum-likelihood detection of chips with intersymbol interference from the exposure, with soft outputs.

    The exposure is a box, so each row is a known weighted sum of the chips it sees. Forward and backward passes over
    the trellis of the last ceil(exposure/rows_per_chip) chips give for every chip the most likely sequences with it
    bright and with it dark (max-log; Viterbi 1967, Bahl et al. 1974).

    Args:
        rows: (rows,) light of consecutive rows, 0 for steady dark and 1 for steady bright.
        clock: of the chips; an exposure of at most 15 chips, since time grows as 2^(exposure in chips). Other methods:
            24 chips.
        noise: standard deviation of ``rows``, above 0.
        first: number of the first chip that the rows see.
        count: number of chips that the rows see.
        method: one of :data:`ocisac_fast.chips.DETECTORS`.

    Returns:
        (count,) ln p(rows | bright) - ln p(rows | dark): above 0 for a bright chip; 0 for a chip that reaches no row.
    """
    return _core.chip_llr(_vector(rows, "rows"), *clock._for_core(), noise, first, count, method)


@checked
def closest_pair_distance(rows_per_chip: float, exposure_rows: float) -> float:
    """Distance, in swings, between the rows of the two closest sequences of chips: 01 and 10.

    It is the root mean square over the phase of the chips relative to the rows. From exposures of about two chips on,
    no other pair is closer. Noise sigma of a row gives about Q(distance/(2 sigma)) errors per chip for any receiver.

    Args:
        rows_per_chip: above 0.
        exposure_rows: rows, above 0.
    """
    return _core.closest_pair_distance(rows_per_chip, exposure_rows)


@checked
def pool_estimates(values: npt.ArrayLike, errors: npt.ArrayLike) -> Pooled:
    """Mean of values weighted by the inverse squares of their standard errors, such as an exposure from several frames.

    Args:
        values: (values,) those that are not finite are ignored.
        errors: (values,) standard errors; those that are not finite or not above 0 are ignored.

    Returns:
        Value, standard error (at least the one from the scatter) and number of values used; NaN if there are none.
    """
    value, std, count = _core.pool_estimates(_vector(values, "values"), _vector(errors, "errors"))
    return Pooled(value, std, count)


def _vector(values: npt.ArrayLike, name: str) -> Float64s:
    array = np.asarray(values)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"{name}: got shape {array.shape}, allowed: a vector of at least one value")
    return np.ascontiguousarray(array, dtype=np.float64)


def _errors(values: tuple[int, list[float]]) -> ClockErrors:
    chip, covariance = values
    return ClockErrors(chip, np.array(covariance).reshape(3, 3))


def _channel(values: tuple[Any, ...]) -> ChannelEstimate:
    period, phase, exposure, errors, dark, swing, noise, begin, end, converged = values
    levels = np.array(dark), np.array(swing)
    return ChannelEstimate(period, phase, exposure, _errors(errors), *levels, noise, (begin, end), converged)


def as_tuple(channel: ChannelEstimate) -> tuple[Any, ...]:
    """The channel in the form that the core reads."""
    errors = (channel.errors.chip, channel.errors.covariance.ravel().tolist())
    clock = (channel.rows_per_chip, channel.phase, channel.exposure_rows)
    return (*clock, errors, list(channel.dark), list(channel.swing), channel.noise, *channel.rows, channel.converged)


def _refined(values: tuple[tuple[Any, ...], Float64s, int, bool, bool]) -> RefinedChannel:
    channel, chips, first, settled, even = values
    return RefinedChannel(_channel(channel), chips, first, settled, even)
