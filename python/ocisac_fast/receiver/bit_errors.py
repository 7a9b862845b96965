"""Bit errors: received bits compared with the sent ones, aligned by search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.core.arrays import Float64s
from ocisac_fast.core.checks import checked, shown
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.results import Result
from ocisac_fast.receiver.blind import Received

IntArray = npt.NDArray[np.int64]

_MAX_CHANCE = 0.01
_TAIL = 0.025  # on either side of the 95 % interval
_MAX_SLIP = 32  # bits, in all
_HALVINGS = 60


@dataclass(frozen=True, slots=True, repr=False)
class BitErrors(Result):
    """Result of :func:`compare_bits`.

    Attributes:
        errors: bits that differ.
        compared: pairs of a received and a sent bit.
        missing: sent bits that were not received: within the received stretch, and without ``repeat`` before and after.
        inserted: received bits that no sent one corresponds to.
        rate: errors / compared, a share; NaN if nothing was compared.
        low, high: 95 % interval of the error probability (Clopper-Pearson), shares.
        shift: index of the sent bit at the first received one; below 0 where that precedes the sent ones.
        inverted: True if dark stands for 1: all received bits were inverted.
        chance: probability that unrelated, equally probable bits align as well at any shift, either way round.
        flags: NO_SIGNAL if ``chance`` is above 1 %; the rate of unrelated bits is 0.5 less what the search explains.
    """

    errors: int
    compared: int
    missing: int
    inserted: int
    rate: float
    low: float
    high: float
    shift: int
    inverted: bool
    chance: float
    flags: Flag


@checked
def compare_bits(
    received: str | Received | Sequence[str | Received], sent: str | npt.ArrayLike, *, repeat: bool = False
) -> BitErrors:
    """Compare received bits with the sent ones: errors, bits missing and inserted, and whether they belong together.

    Shift and inversion are those with the most matches for the length of the overlap. Where the alignment is no chance,
    bits that were lost or inserted within, up to 32 in all, are found by a second search, if that explains the bits in
    fewer words (minimum description length).

    Args:
        received: bits as ``"0"`` and ``"1"``, a :class:`Received`, or several of either, such as all frames; each is
            aligned by itself, counts are added up, ``shift`` and ``inverted`` are those of the first, ``chance`` is the
            largest of those with bits.
        sent: ``"0"`` and ``"1"``, or an array of 0 and 1 such as ``transmit(payload).chips``; at least one.
        repeat: the sent bits are sent over and over.
    """
    parts = [received] if isinstance(received, (str, Received)) else list(received)
    reference = _bits("sent", sent)
    if reference.size == 0:
        raise ValueError("sent: got no bits, allowed: at least one")
    found = [_compared(_bits("received", _text(part)), reference, repeat) for part in parts]
    found = found or [_compared(np.zeros(0, np.int8), reference, repeat)]
    return _result(
        sum(one.errors for one in found),
        sum(one.compared for one in found),
        sum(one.missing for one in found),
        sum(one.inserted for one in found),
        (found[0].shift, found[0].inverted),
        max((one.chance for one in found if one.compared), default=1.0),
    )


def _result(
    errors: int, compared: int, missing: int, inserted: int, alignment: tuple[int, bool], chance: float
) -> BitErrors:
    low, high = _clopper_pearson(errors, compared)
    rate = errors / compared if compared else math.nan
    flags = Flag.NO_SIGNAL if chance > _MAX_CHANCE else Flag(0)
    return BitErrors(errors, compared, missing, inserted, rate, low, high, *alignment, chance, flags)


def _text(part: str | Received) -> str:
    return part if isinstance(part, str) else part.bits


def _bits(name: str, value: str | npt.ArrayLike) -> npt.NDArray[np.int8]:
    values = np.frombuffer(value.encode(), np.uint8) - ord("0") if isinstance(value, str) else np.asarray(value)
    if values.ndim != 1 or not np.isin(values, (0, 1)).all():
        raise ValueError(f"{name}: got {shown(value)}, allowed: 0 and 1")
    return values.astype(np.int8)


def _compared(bits: npt.NDArray[np.int8], sent: npt.NDArray[np.int8], repeat: bool) -> BitErrors:
    if bits.size == 0:
        return _result(0, 0, 0 if repeat else sent.size, 0, (0, False), 1.0)
    shifts, overlaps, matches = _matches_by_shift(bits, sent, repeat)
    scores = (2 * matches - overlaps) / np.sqrt(overlaps)  # standard deviations beyond unrelated bits
    best = int(np.argmax(np.abs(scores)))
    inverted, overlap = bool(scores[best] < 0.0), int(overlaps[best])
    right = int(overlap - matches[best] if inverted else matches[best])
    by_chance = _tail_at_half(right, overlap)
    chance = 1.0 if by_chance >= 1.0 else -math.expm1(2.0 * shifts.size * math.log1p(-by_chance))
    places = shifts[best] + np.arange(bits.size)
    if chance <= _MAX_CHANCE:
        places = places + _slips(bits ^ inverted, sent, places, repeat)
    used = np.ones(bits.size, bool) if repeat else (places >= 0) & (places < sent.size)
    used[:-1] &= places[:-1] < np.minimum.accumulate(places[:0:-1])[::-1]  # else inserted: a later bit is at its place
    errors, compared = int(np.sum(sent[places[used] % sent.size] != bits[used] ^ inverted)), int(used.sum())
    missing = int(np.ptp(places[used])) + 1 - compared if repeat and compared else sent.size - compared
    first = int(places[0]) % sent.size if repeat else int(places[0])
    return _result(errors, compared, missing, bits.size - compared, (first, inverted), chance)


def _matches_by_shift(
    bits: npt.NDArray[np.int8], sent: npt.NDArray[np.int8], repeat: bool
) -> tuple[IntArray, IntArray, IntArray]:
    """All shifts, the bits that overlap at each, and the pairs that are equal."""
    if repeat:
        folded = np.bincount(np.arange(bits.size) % sent.size, 2.0 * bits - 1.0, sent.size)
        products = np.fft.irfft(np.fft.rfft(folded).conj() * np.fft.rfft(2.0 * sent - 1.0), sent.size)
        shifts, overlaps = np.arange(sent.size), np.full(sent.size, bits.size)
    else:
        length = bits.size + sent.size - 1
        products = np.fft.irfft(
            np.fft.rfft(2.0 * bits - 1.0, length).conj() * np.fft.rfft(2.0 * sent - 1.0, length), length
        )
        shifts = np.arange(1 - bits.size, sent.size)
        products = products[shifts]
        overlaps = np.minimum(shifts + bits.size, sent.size) - np.maximum(shifts, 0)
    return shifts, overlaps, (np.rint(products).astype(np.int64) + overlaps) // 2


def _slips(bits: npt.NDArray[np.int8], sent: npt.NDArray[np.int8], sent_at: IntArray, repeat: bool) -> IntArray:
    """(bits,) displacement of each bit's place beyond the common shift: Viterbi's path through displacements.

    A wrong bit costs log((1 - e)/e), with e the share of errors without slips; a slip of a bit the number of places and
    sizes among which it is one.
    """
    offsets = np.arange(-_MAX_SLIP, _MAX_SLIP + 1)

    def wrong(row: int) -> Float64s:
        places = sent_at[row] + offsets
        differs = (sent[places % sent.size] != bits[row]).astype(np.float64)
        return differs if repeat else np.where((places < 0) | (places >= sent.size), 0.5, differs)  # as if by chance

    share = float(np.mean([wrong(row)[_MAX_SLIP] for row in range(bits.size)]))
    if share == 0.0 or share >= 0.5:
        return np.zeros(bits.size, np.int64)
    price = math.log(1.0 / share - 1.0)
    slip = math.log(bits.size * offsets.size) * np.abs(offsets[:, None] - offsets)
    cost, best = price * wrong(0), np.zeros((bits.size, offsets.size), np.int8)
    for row in range(1, bits.size):
        steps = cost + slip
        best[row] = steps.argmin(axis=1)
        cost = steps.min(axis=1) + price * wrong(row)
    path = np.empty(bits.size, np.int64)
    path[-1] = cost.argmin()
    for row in range(bits.size - 1, 0, -1):
        path[row - 1] = best[row, path[row]]
    return offsets[path]


def _log_choose(count: int) -> Float64s:
    """(count + 1,) logarithms of the binomial coefficients."""
    factorial = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1.0, count + 1)))])
    return np.asarray(factorial[-1] - factorial - factorial[::-1])


def _tail_at_half(right: int, count: int) -> float:
    """Probability of ``right`` or more of ``count`` equal bits by chance."""
    return float(min(1.0, np.exp(_log_choose(count)[right:] - count * math.log(2.0)).sum()))


def _clopper_pearson(errors: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a probability; its ends leave 2.5 % for as many errors or more, and for as many or fewer."""
    if count == 0:
        return 0.0, 1.0
    choose, k = _log_choose(count), np.arange(count + 1.0)

    def share_at(probability: float, first: int, last: int) -> float:
        logs = choose + k * math.log(probability) + (count - k) * math.log1p(-probability)
        return float(np.exp(logs[first:last]).sum())

    def end(first: int, last: int, rises: bool) -> float:
        below, above = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (below + above)
            is_above = (share_at(middle, first, last) > _TAIL) == rises
            below, above = (below, middle) if is_above else (middle, above)
        return 0.5 * (below + above)

    low = 0.0 if errors == 0 else end(errors, count + 1, rises=True)
    high = 1.0 if errors == count else end(0, errors + 1, rises=False)
    return low, high
