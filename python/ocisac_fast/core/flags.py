"""What a caller must know of an estimate beside its standard error."""

from __future__ import annotations

from enum import IntFlag


class Flag(IntFlag):
    """Bits of a ``flags`` mask; an estimate without any is what it seems."""

    SATURATED = 1 << 0
    """Samples at the top of the scale: the gain reads low or distorted."""
    NEAR_NULL = 1 << 1
    """The exposure leaves next to nothing of the tone: |sinc(f T_e)| < 0.05."""
    WEAK = 1 << 2
    """The amplitude is below three standard errors: mostly noise."""
    FEW_CYCLES = 1 << 3
    """Less than one cycle in the frame; less than two for a frequency that was searched, where a gradient of the
    light passes for a part of the tone."""
    ALIASED = 1 << 4
    """The tone is above half the row rate and was seen at its alias."""
    UNRESOLVABLE = 1 << 5
    """No answer (NaN): a multiple of half the row rate, tones that coincide, or too few rows."""
    NO_LIGHT = 1 << 6
    """No answer (NaN): the mean less the background is not above 0."""
    OFF_BIN = 1 << 7
    """Method ``dft``: the tone lies beside its bin and the gain is biased."""
    ILL_CONDITIONED = 1 << 8
    """The rows hardly tell the parts of the model apart."""
    HARMONICS_DROPPED = 1 << 9
    """Harmonics were left out of the model: too many for the rows, or on another tone."""
    NO_TONE = 1 << 10
    """Frequency search: nothing periodic stands out of the noise; the answer is the best guess, or NaN."""
    AT_BOUND = 1 << 11
    """Frequency search: the best frequency is a bound of the search; the true one may lie beyond."""
    NO_SIGNAL = 1 << 16
    """``receive``: no chips were found; there are no bits."""
    TOO_FEW_EDGES = 1 << 17
    """``receive``: fewer than 12 changes of the light (4 with a known rate): no bits, or the rate may be wrong."""
    LONG_EXPOSURE = 1 << 18
    """``receive``: the exposure is longer than a chip; the bits are not to be trusted."""
    MODEL_MISFIT = 1 << 24
    """``varying_tone_gain``: light or tone vary along the column, and the gain of ``tone_gain`` is biased by more than
    its standard error."""
    QUANTISED = 1 << 25
    """The rows have less noise than half a step of the stored values: rounding is no noise then and may pull the gain
    by more than the standard error."""
    AMBIGUOUS_MOTION = 1 << 26
    """``sense``: motions of several speeds show the same rows; the slowest that fits is given, or NaN."""
    AMBIGUOUS_KIND = 1 << 27
    """``sense``: a modulated light, a moving texture or a still one would look alike here."""

    def names(self) -> list[str]:
        """The bits that are set, in lower case."""
        return [bit.name.lower() for bit in Flag if bit in self and bit.name]
