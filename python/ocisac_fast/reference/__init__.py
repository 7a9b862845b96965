"""The same functions in plain NumPy, for checking the C++ core: slow, short and close to the equations."""

from ocisac_fast.reference.gain import tone_gain

__all__ = ["tone_gain"]
