"""Receiver for optical camera communication and sensing (OC-ISAC)."""

from ocisac_fast._core import version as _version
from ocisac_fast.camera import Camera, exposure_response
from ocisac_fast.flags import Flag
from ocisac_fast.gain import ToneGain, tone_gain

__all__ = ["Camera", "Flag", "ToneGain", "exposure_response", "tone_gain"]

__version__ = _version()
