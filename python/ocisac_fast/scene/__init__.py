"""Scenes: frames of lights and moving surfaces by a rolling-shutter camera, computed to a given tolerance."""

from ocisac_fast.scene.description import Ambient, Sensor, Voxels
from ocisac_fast.scene.geometry import Disc, Pinhole, Pose, Rectangle, Ring
from ocisac_fast.scene.objects import Cosine, Grating, Mask, PathLoss, Picture, Plain, Source, Surface
from ocisac_fast.scene.plan import Part, Plan, Scene
from ocisac_fast.scene.rendering import render
from ocisac_fast.scene.toml import SceneFileError, load_scene, save_scene

__all__ = [
    "Ambient",
    "Cosine",
    "Disc",
    "Grating",
    "Mask",
    "Part",
    "PathLoss",
    "Picture",
    "Pinhole",
    "Plain",
    "Plan",
    "Pose",
    "Rectangle",
    "Ring",
    "Scene",
    "SceneFileError",
    "Sensor",
    "Source",
    "Surface",
    "Voxels",
    "load_scene",
    "render",
    "save_scene",
]
