"""Removal of the bands that a modulated light leaves in a picture."""

from ocisac_fast.cleaning.bands import (
    CleanedFrames as CleanedFrames,
    CleaningOptions as CleaningOptions,
    Mark as Mark,
    remove_bands as remove_bands,
    subtract_still as subtract_still,
)
from ocisac_fast.cleaning.video import VideoCleaner as VideoCleaner
