"""Common style of all plots, drawn without a display (matplotlib, ``ocisac-fast[cli]``).

Colours are those of Okabe and Ito, suitable for colour-blind readers.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ocisac_fast.core.checks import shown
from ocisac_fast.files import FileError, atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLACK, ORANGE, SKY, GREEN, BLUE, RED, PURPLE = (
    "#222222",
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#0072B2",
    "#D55E00",
    "#CC79A7",
)
_SUFFIXES = (".png", ".pdf", ".svg")
_LOOK: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": "medium",
    "axes.titleweight": "bold",
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.12,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": "small",
    "svg.hashsalt": "ocisac",
}


@contextlib.contextmanager
def picture(path: str | os.PathLike[str], width: float, height: float) -> Iterator[Figure]:
    """A figure of the given size in inches in the package's style, written atomically: ``.png``, ``.pdf`` or ``.svg``.

    Raises:
        FileError: another suffix, or matplotlib is missing.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        raise FileError(f"{os.fspath(path)}: suffix: got {shown(suffix)}, allowed: {', '.join(_SUFFIXES)}")
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise FileError("plots need matplotlib: pip install 'ocisac-fast[cli]'") from error
    with matplotlib.rc_context(_LOOK):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=120)
