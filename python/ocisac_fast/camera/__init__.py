"""The camera: its timing and its response to light."""

from ocisac_fast.camera.camera import Camera as Camera
from ocisac_fast.camera.linear_light import linear_light as linear_light
