"""``ocisac info``."""

from __future__ import annotations

import platform
from importlib import metadata

import numpy as np

from ocisac_fast import __version__, _core
from ocisac_fast.chips import DETECTORS
from ocisac_fast.cli.command import command
from ocisac_fast.cli.output import emit

_LIBRARIES = ("numpy", "pillow", "av", "matplotlib", "click", "rich")


@command
def info(*, as_json: bool) -> None:
    """Show the data for a problem report: versions, build of the core, SIMD target in use."""
    libraries = {name: _version(name) for name in _LIBRARIES}
    facts: dict[str, str | list[str]] = {
        "version": __version__,
        "commit": _core.commit(),
        "compiler": _core.compiler(),
        "opencv": _core.opencv_version(),
        "simd_target": _core.simd_target(),
        "simd_targets": _core.simd_targets(),
        "detectors": list(DETECTORS),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
    }
    lines = {
        name.replace("_", " "): value if isinstance(value, str) else ", ".join(value) for name, value in facts.items()
    }
    lines |= {name: version or "not installed" for name, version in libraries.items()}
    emit(as_json, {**facts, "libraries": libraries}, lines)


def _version(name: str) -> str | None:
    if name == "numpy":
        return np.__version__
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
