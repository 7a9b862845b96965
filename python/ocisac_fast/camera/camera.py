"""The camera: its timing and its response to light."""

from __future__ import annotations

from dataclasses import dataclass, field

from ocisac_fast import _core


@dataclass(frozen=True)
class Camera:
    """Timing and tone response of a rolling-shutter camera.

    Row ``n`` of frame ``j`` ends its exposure at ``j * frame_time + n * row_time`` and begins it ``exposure`` earlier.

    Args:
        row_time: time from one row to the next, T_r, in seconds; above 0.
        exposure: exposure time of a row, T_e, in seconds; 0 (a point sample) or above, None where it is not known.
        frame_time: time from one frame to the next in seconds; above 0, None where it is not known.
        tone_curve: how stored values follow the light: ``"linear"``, ``"gamma"`` (power ``gamma``) or ``"srgb"``
            (IEC 61966-2-1).
        gamma: exponent from stored value to light for ``tone_curve="gamma"``; above 0.
        dark_level: stored value (DN) of no light; 16 for limited-range luma of 8 bits.
        white_level: stored value (DN) of full light; above ``dark_level``. None: the largest value of the array's
            type (255, 65535, 1.0 for floats); 235 for limited-range luma.

    Raises:
        ValueError: a value that is not finite or outside its range; the message names it.
    """

    row_time: float
    exposure: float | None = None
    frame_time: float | None = None
    tone_curve: str = "linear"
    gamma: float = 2.2
    dark_level: float = 0.0
    white_level: float | None = None
    _handle: _core.Camera = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        handle = _core.Camera(
            row_time=self.row_time,
            exposure=self.exposure,
            frame_time=self.frame_time,
            tone_curve=self.tone_curve,
            gamma=self.gamma,
            dark_level=self.dark_level,
            white_level=self.white_level,
        )
        object.__setattr__(self, "_handle", handle)

    def __reduce__(self) -> tuple[type[Camera], tuple[object, ...]]:
        values = (self.row_time, self.exposure, self.frame_time)
        return (type(self), (*values, self.tone_curve, self.gamma, self.dark_level, self.white_level))
