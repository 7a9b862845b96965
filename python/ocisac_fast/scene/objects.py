"""Objects of a scene: sources, surfaces, masks, and the patterns on them."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from ocisac_fast.core.checks import (
    Finite,
    InnerShare,
    NotNegative,
    Positive,
    Share,
    checked,
    checked_class,
    is_real_array,
    shown,
)
from ocisac_fast.light.waveforms import Waveform
from ocisac_fast.scene.course import check_light
from ocisac_fast.scene.geometry import Array, Pose, Ring, Shape


@checked_class
@dataclass(frozen=True)
class PathLoss:
    """Path loss beta(d) = (reference / d)^exponent * exp(-attenuation * d), d the distance to the camera.

    The light on a pixel that an extended source fills is independent of its distance: exponent 0, the default. A source
    smaller than a pixel has exponent 2.

    Args:
        exponent: 0 or above.
        reference: distance of path loss 1 without attenuation, m, above 0.
        attenuation: 1/m, 0 or above: 0.05 to 0.4 in water.
    """

    exponent: NotNegative = 0.0
    _: KW_ONLY
    reference: Positive = 1.0
    attenuation: NotNegative = 0.0

    @checked
    def at(self, distance: Array) -> Array:
        spread = (self.reference / distance) ** self.exponent if self.exponent else 1.0
        return np.asarray(spread * np.exp(-self.attenuation * distance))


@checked_class
@dataclass(frozen=True)
class Plain:
    """Uniform reflectance (or transmittance of a mask), 0 to 1."""

    level: Share = 1.0


@checked_class
@dataclass(frozen=True)
class Cosine:
    """Stripes, eq. 7: low + (high - low) * (1/2 + 1/2 * cos(2 pi frequency * (x - speed * t) - phase)).

    Args:
        frequency: spatial frequency f_x in periods per metre, above 0. A ring uses the nearest whole number of periods.
        low, high: minimum and maximum reflectance, 0 to 1.
        phase: rad.
    """

    frequency: Positive
    _: KW_ONLY
    low: Share = 0.0
    high: Share = 1.0
    phase: Finite = 0.0


@checked_class
@dataclass(frozen=True)
class Grating:
    """Bars: ``high`` for a share ``duty`` of each period, centred at the maximum of `Cosine`, else ``low``.

    Args:
        frequency: periods per metre, above 0; a slot and a bar are one period. A ring uses the nearest whole number.
        duty: above 0 and below 1.
        low, high: reflectance (or transmittance) of bar and slot, 0 to 1.
        phase: rad.
    """

    frequency: Positive
    _: KW_ONLY
    duty: InnerShare = 0.5
    low: Share = 0.0
    high: Share = 1.0
    phase: Finite = 0.0


@checked_class
@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that repeats along x (around a ring) and y; the middle of one repetition is at the object's middle.

    On a ring, its middle is at the ring's x axis and on the middle circle.

    Args:
        levels: (rows, columns) reflectances, 0 to 1; kept as a read-only float64 copy.
        width, height: of one repetition, m, above 0. A ring uses the nearest whole number of repetitions.
    """

    levels: Any  # real numbers, (rows, columns); an array once made
    width: Positive
    height: Positive

    def __post_init__(self) -> None:
        if not is_real_array(self.levels):
            raise ValueError(f"levels: got {shown(self.levels)}, allowed: real numbers")
        levels = np.array(self.levels, dtype=np.float64)
        if levels.ndim != 2 or levels.size == 0:
            raise ValueError(f"levels: got shape {levels.shape}, allowed: (rows, columns)")
        if not (levels.min() >= 0 and levels.max() <= 1):
            raise ValueError(f"levels: got {levels.min():g} to {levels.max():g}, allowed: 0 to 1")
        levels.flags.writeable = False
        object.__setattr__(self, "levels", levels)

    @property
    def frequency(self) -> float:
        """Repetitions per metre."""
        return 1 / self.width


Pattern = Plain | Cosine | Grating | Picture


@checked_class
@dataclass(frozen=True)
class Source:
    """A light, eq. 5: every voxel of its shape emits intensity * waveform.

    Args:
        shape: its outline.
        pose: of its middle.
        waveform: the luminous factor eta(t), 0 to 1 for eq. 5.
        intensity: I_c, 0 or above.
        path_loss: beta(d) on the way to the camera.
        directivity: light towards a surface at an angle a from its axis (its own z, both directions) is
            cos(a)^directivity; 0: isotropic; 1: a Lambertian radiator.
    """

    shape: Shape
    pose: Pose
    waveform: Waveform
    _: KW_ONLY
    intensity: NotNegative = 1.0
    path_loss: PathLoss = PathLoss()
    directivity: NotNegative = 1.0

    def __post_init__(self) -> None:
        check_light(self.waveform)


@dataclass(frozen=True)
class _Patterned:
    shape: Shape
    pose: Pose
    _: KW_ONLY
    pattern: Pattern = Plain()
    speed: Finite = 0.0

    @property
    def spatial_frequency(self) -> float:
        """Actual f_x of the pattern in periods per metre; a ring has a whole number of periods; 0: plain."""
        if isinstance(self.pattern, Plain):
            return 0.0
        if not isinstance(self.shape, Ring):
            return self.pattern.frequency
        round_length = math.pi * self.shape.diameter
        return max(1, round(self.pattern.frequency * round_length)) / round_length

    @property
    def rate(self) -> float:
        """Periods of the pattern that pass a point per second, f_x * speed in Hz, signed."""
        return self.spatial_frequency * self.speed

    def across(self, x: Array, y: Array) -> Array:
        """Second coordinate of a picture on it: y, or the radial distance from a ring's middle circle."""
        return np.asarray(np.hypot(x, y) - self.shape.diameter / 2) if isinstance(self.shape, Ring) else y

    def periods(self, x: Array, y: Array) -> Array:
        """Periods of the pattern from its phase 0 to the points (x, y) of the object, at time 0.

        A picture has its middle at x = 0 and `across` = 0; its phase 0 is its left edge.
        """
        along = np.arctan2(y, x) * (self.shape.diameter / 2) if isinstance(self.shape, Ring) else x
        if isinstance(self.pattern, Picture):
            return np.asarray(self.spatial_frequency * along + 0.5)
        phase = self.pattern.phase if isinstance(self.pattern, (Cosine, Grating)) else 0.0
        return np.asarray(self.spatial_frequency * along - phase / (2 * math.pi))


@checked_class
@dataclass(frozen=True)
class Surface(_Patterned):
    """A diffuse, opaque reflector, eq. 7, illuminated by the ambient light and by the sources (one bounce).

    Args:
        shape: a plate, or a ring.
        pose: of its middle; its plane is its own x and y.
        pattern: its reflectance.
        speed: of the pattern along x (around a ring), m/s; the outline does not move.
        path_loss: beta(d) on the way to the camera.
        lit_by_sources: sources that are not behind it illuminate it (non-line-of-sight): a source of intensity I and
            area S at distance d adds I * S * cos(a)^directivity * cos(b) / (pi * d^2) to the ambient light.
    """

    _: KW_ONLY
    path_loss: PathLoss = PathLoss()
    lit_by_sources: bool = False


@checked_class
@dataclass(frozen=True)
class Mask(_Patterned):
    """A transmissive plate, such as a rotating grating in front of a light; opaque where ``pattern`` is 0.

    Args:
        shape: its outline.
        pose: of its middle.
        pattern: its transmittance.
        speed: of the pattern along x (around a ring), m/s.
    """
