"""Conditions of an estimate that its standard error does not express."""

from __future__ import annotations

import functools
from enum import IntFlag


class Named(IntFlag):
    """Bits that print by their names."""

    def __str__(self) -> str:
        """The names of the bits that are set, ``weak, aliased``; ``none``."""
        return ", ".join(self.names()) or "none"

    def __format__(self, form: str) -> str:
        return format(int(self) if form[-1:] in "bcdoxXn" and form else str(self), form)

    def names(self) -> list[str]:
        """The bits that are set, in lower case."""
        return list(_names(self))


@functools.lru_cache
def _names(flags: Named) -> tuple[str, ...]:
    return tuple(str(bit.name).lower() for bit in type(flags) if bit in flags)


class Flag(Named):
    """Bits of a ``flags`` mask; 0: no condition applies."""

    SATURATED = 1 << 0
    """Samples are at 98 % of white above dark or more, or pile up at a level: the gain may be too low or distorted."""
    NEAR_NULL = 1 << 1
    """The exposure suppresses the tone: |sinc(f T_e)| < 0.05."""
    WEAK = 1 << 2
    """The amplitude is below three standard errors: mostly noise."""
    FEW_CYCLES = 1 << 3
    """Less than one cycle in the frame; less than two for a searched frequency, where a gradient of the light resembles
    part of a tone."""
    ALIASED = 1 << 4
    """The tone is above half the row rate and is measured at its alias."""
    UNRESOLVABLE = 1 << 5
    """No estimate (NaN): a multiple of half the row rate, tones that coincide, or too few rows."""
    NO_LIGHT = 1 << 6
    """No estimate (NaN): the mean minus the background is not above 0."""
    OFF_BIN = 1 << 7
    """Method ``dft``: the tone lies off its bin and the gain is biased."""
    ILL_CONDITIONED = 1 << 8
    """The terms of the model are nearly collinear over the rows."""
    HARMONICS_DROPPED = 1 << 9
    """Harmonics were omitted: too many for the rows, at the frequency of another tone, or they bias the gain."""
    NO_TONE = 1 << 10
    """Frequency search: no periodic component exceeds the noise; the estimate is the best candidate, or NaN."""
    AT_BOUND = 1 << 11
    """Frequency search: the best frequency is a bound of the search; the true one may lie outside."""
    NO_SIGNAL = 1 << 16
    """``receive``: no chips were found; there are no bits."""
    TOO_FEW_EDGES = 1 << 17
    """``receive``: fewer than 12 changes of the light (4 with a known rate): no bits, or the rate may be wrong."""
    LONG_EXPOSURE = 1 << 18
    """``receive``: the stated exposure is longer than a chip; the bits are not to be trusted."""
    PERIODIC = 1 << 19
    """``receive``: one rise and one fall over and over, as of a dimmed lamp (PWM) or still bars, from which data
    cannot be distinguished."""
    MODEL_MISFIT = 1 << 24
    """``tone_gain``: harmonics of the strongest columns fit neither waveform nor exposure (a tone curve that was not
    stated, bloom), another tone is within a cycle per frame, light is below the dark level, or the gain is above that
    of any light: |sinc(f T_e)|, and without an exposure a fundamental of twice the mean. ``varying_tone_gain``: light
    or tone vary along the column, and the gain of ``tone_gain`` is biased by more than its standard error; or both
    gains are, since the tone is far out of step with the stated frequency.
    ``Receiver``: what is left of the rows is no noise, or the chips violate the line code; the bits are less sure than
    they seem. ``receive``: rows are not read one after another at even times, or chips are missing; bits may be
    wrong."""
    QUANTISED = 1 << 25
    """The rows have less noise than half a step of the stored values: the rounding error is not random then and may
    bias the gain by more than the standard error. ``find_frequency``, ``calibrate``: the tone may be the stairs of a
    rounded gradient."""
    AMBIGUOUS_MOTION = 1 << 26
    """``sense``: motions of several speeds fit the rows equally; the slowest of them is given, or NaN."""
    AMBIGUOUS_KIND = 1 << 27
    """``sense``: a modulated light, a moving texture and a still texture cannot be distinguished here. ``receive``: the
    next frame shows the same rows (a picture that stands still, or a light in step with the frames), two halves of
    the columns differ by more than noise, as in a texture, or many columns have bits of their own on one clock, as in
    a printed code."""
