"""Pixel formats of videos to red, green and blue, and back, by the scaler of FFmpeg's filters.

Matrix and ranges are given to the scaler: its own choice, and PyAV's ``reformat``, differ from version to version.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import Any

from ocisac_fast.files.extras import pyav

# Names of FFmpeg's scaler for the matrices of ITU-T H.273; BT.601 for others, and where none is stated.
_MATRICES = {1: "bt709", 4: "fcc", 7: "smpte240m", 9: "bt2020"}
_BT601 = "smpte170m"
_FLAGS = "bilinear+full_chroma_int+full_chroma_inp+accurate_rnd"


def rgb_format(deep: bool) -> str:
    """Planes of red, green and blue: packed formats of 16 bits get wrong colours from 4:2:0 in several FFmpegs."""
    return "gbrp16le" if deep else "gbrp"


def rgb_white(limited: bool, bits: int) -> float:
    """The scaler's white in `rgb_format`, from a format of ``bits`` bits."""
    if bits <= 8:
        return 255.0
    return 255.0 * 256 if limited else 65536.0 - 2.0 ** (16 - bits)


class Conversion:
    """Converts frames of one size and pixel format after the other.

    Args:
        target: pixel format, with the ranges full for RGB.
        matrix: coefficients of Y'CbCr, ITU-T H.273.
        limited: Y'CbCr has black at 16 (of 8 bits).
    """

    def __init__(self, target: str, matrix: int, limited: bool) -> None:
        self._target, self._matrix, self._limited = target, _MATRICES.get(matrix, _BT601), limited
        self._source: tuple[str, int, int] | None = None
        self._graph: Any = None

    def __call__(self, frame: Any) -> Any:
        """The frame in the target's format."""
        source = (frame.format.name, frame.width, frame.height)
        if source != self._source:
            self._source, self._graph = source, self._graph_of(*source)
        self._graph.push(frame)
        return self._graph.pull()

    def _graph_of(self, name: str, width: int, height: int) -> Any:
        av = pyav()
        stated = "limited" if self._limited else "full"
        to_rgb = av.VideoFormat(self._target).is_rgb
        ranges = ("in_range", "out_range") if to_rgb else ("out_range", "in_range")
        options = {"flags": _FLAGS, ranges[0]: stated, ranges[1]: "full"}
        options["in_color_matrix" if to_rgb else "out_color_matrix"] = self._matrix
        scale = "scale", ":".join(f"{key}={value}" for key, value in options.items())
        return _graph(name, width, height, scale, ("format", f"pix_fmts={self._target}"))


def downward(frame: Any) -> Any:
    """A copy of a frame whose lines follow each other upwards in memory, where older PyAVs take them for downwards."""
    graph = _graph(frame.format.name, frame.width, frame.height, ("copy",))
    graph.push(frame)
    return graph.pull()


def _graph(name: str, width: int, height: int, *filters: tuple[str, ...]) -> Any:
    """FFmpeg's filters one after the other, from a pixel format."""
    av = pyav()
    graph = av.filter.Graph()
    form = av.VideoFormat(name, width, height)
    source = graph.add_buffer(width=width, height=height, format=form, time_base=Fraction(1, 90_000))
    for one, other in pairwise([source, *(graph.add(*each) for each in (*filters, ("buffersink",)))]):
        one.link_to(other)
    graph.configure()
    return graph
