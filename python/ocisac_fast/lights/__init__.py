"""The lights of a picture: detection, calibration with a lamp, tracking, location."""

from ocisac_fast.lights.calibration import (
    Calibration as Calibration,
    calibrate as calibrate,
    pick_colour as pick_colour,
)
from ocisac_fast.lights.location import Location as Location, locate_camera as locate_camera
from ocisac_fast.lights.scan_axis import ScanAxis as ScanAxis, find_scan_axis as find_scan_axis
from ocisac_fast.lights.sources import LightSource as LightSource, detect_sources as detect_sources
from ocisac_fast.lights.tracker import SourceTracker as SourceTracker, Track as Track
