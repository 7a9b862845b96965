"""``ocisac info``."""

from __future__ import annotations

import platform
from importlib import metadata

import numpy as np

from ocisac_fast import __version__, _core
from ocisac_fast.chips import DETECTORS
from ocisac_fast.cli.command import command
from ocisac_fast.cli.output import emit_facts, emit_json

_LIBRARIES = ("numpy", "pillow", "av", "matplotlib", "click", "rich")


@command
def info(*, as_json: bool) -> None:
    """Show the data for a problem report: versions, build of the core, SIMD target in use."""
    facts = _facts()
    if as_json:
        emit_json(facts)
        return
    libraries = facts.pop("libraries")
    assert isinstance(libraries, dict)
    facts |= {"simd_targets": ", ".join(_core.simd_targets()), "detectors": ", ".join(DETECTORS)}
    lines = {name.replace("_", " "): str(value) for name, value in facts.items()}
    emit_facts("", {**lines, **{name: version or "not installed" for name, version in libraries.items()}})


def _facts() -> dict[str, object]:
    return {
        "version": __version__,
        "commit": _core.commit(),
        "compiler": _core.compiler(),
        "opencv": _core.opencv_version(),
        "simd_target": _core.simd_target(),
        "simd_targets": _core.simd_targets(),
        "detectors": list(DETECTORS),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "libraries": {name: _version(name) for name in _LIBRARIES},
    }


def _version(name: str) -> str | None:
    if name == "numpy":
        return np.__version__
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
