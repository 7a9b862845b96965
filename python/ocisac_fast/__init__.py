"""Receiver for optical camera communication and sensing (OC-ISAC)."""

from ocisac_fast.camera import Camera, exposure_response

__all__ = ["Camera", "exposure_response"]
