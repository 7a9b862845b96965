"""OpenCV, which few calls need."""

from __future__ import annotations

from typing import Any


def opencv(asked: str) -> Any:
    """``cv2``; ValueError that names what is ``asked`` where it is not installed."""
    try:
        import cv2
    except ModuleNotFoundError as error:
        raise ValueError(f"{asked} needs OpenCV: pip install opencv-python-headless") from error
    return cv2
