"""The camera: its timing and its response to light."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from typing import Annotated, Literal

from ocisac_fast import _core
from ocisac_fast.core.checks import Within, checked_class


@checked_class
@dataclass(frozen=True)
class Camera:
    """Timing and tone response of a rolling-shutter camera.

    Row ``n`` of frame ``j`` ends its exposure at ``j * frame_time + n * row_time`` and begins it ``exposure`` earlier.

    Args:
        row_time: time from one row to the next, T_r, in seconds; 1e-15 to 1. None: unknown; rates are then per row and
            times in rows, in arguments and results, and exposure and frame time stay unknown.
        exposure: exposure time of a row, T_e, in seconds; 0 (a point sample) to 1e15 row times; None: unknown.
        frame_time: time from one frame to the next in seconds; 1e-15 to 1e15 row times; None: unknown.
        tone_curve: relation of stored values to light: ``"linear"``, ``"gamma"`` (power ``gamma``), ``"srgb"``
            (IEC 61966-2-1), ``"hlg"`` (ARIB STD-B67) or ``"pq"`` (SMPTE ST 2084).
        gamma: exponent from stored value to light for ``tone_curve="gamma"``; above 0.
        dark_level: stored value (DN) of no light, -1e60 to 1e60; 16 for limited-range luma of 8 bits.
        white_level: stored value (DN) of full light; above ``dark_level``. None: the largest value of the array's
            type (255, 65535, 1.0 for floats); 235 for limited-range luma. Values from 98 % of it above dark on are
            saturated; floats are if it is given.
        scan_axis: direction in which the rows are read out, in pictures as stored: ``"y"`` down, ``"-y"`` up, ``"x"``
            to the right, ``"-x"`` to the left. Pictures and boxes in arguments and results are as stored; "rows" are
            the camera's rows and "columns" are perpendicular to them.
    """

    row_time: float | None
    exposure: float | None = None
    frame_time: float | None = None
    _: KW_ONLY
    tone_curve: str = "linear"
    gamma: float = 2.2
    dark_level: Annotated[float, Within(-1e60, 1e60)] = 0.0
    white_level: float | None = None
    scan_axis: Literal["y", "-y", "x", "-x"] = "y"
    _handle: _core.Camera = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, value in (("exposure", self.exposure), ("frame_time", self.frame_time)):
            if self.row_time is None and value is not None:
                raise ValueError(f"{name}: got {value}, allowed: None where row_time is None")
        handle = _core.Camera(
            row_time=self.row_period,
            exposure=self.exposure,
            frame_time=self.frame_time,
            tone_curve=self.tone_curve,
            gamma=self.gamma,
            dark_level=self.dark_level,
            white_level=self.white_level,
        )
        object.__setattr__(self, "_handle", handle)

    def __reduce__(self) -> tuple[Callable[[], Camera], tuple[()]]:
        return functools.partial(
            type(self), **{item.name: getattr(self, item.name) for item in fields(self) if item.init}
        ), ()

    @property
    def row_period(self) -> float:
        """Time from one row to the next in the unit of the results: seconds, or 1 (row) where ``row_time`` is None."""
        return 1.0 if self.row_time is None else self.row_time

    @property
    def in_time_order(self) -> Camera:
        """A copy of this camera for pictures whose rows are already in time order."""
        return self if self.scan_axis == "y" else replace(self, scan_axis="y")
