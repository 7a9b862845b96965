"""Recognition of lights in later frames by how they looked when they were found."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.arrays import box_in_time_order, stored_box
from ocisac_fast.core.flags import Flag
from ocisac_fast.core.regions import Region
from ocisac_fast.lights.sources import LightSource

Pixels = npt.NDArray[Any]


class KnownLight:
    """A light as it looked in the frame in which it was found, to be recognised and measured in later ones.

    Its box is divided into 2 x 8 cells. A box of this size shows the light if

    * the mean of no cell, relative to that of the box, differs by more than a tenth of the light's amplitude (and 4
      standard errors),
    * the box swings 0.7 to 1.4 times as much, and the phases of its halves differ as before.

    So the light neither vanished nor changed its frequency or shape. Its place is where the means agree best, to a
    pixel or a 32nd of its size. Errors do not add up, since the first frame stays the reference. A light that sends
    data has one row of cells; it is recognised at the given places only.

    Args:
        pixels: (rows, columns) in time order.
        camera: as of stored pictures.
        source: the light as found in them.
    """

    def __init__(self, pixels: Pixels, camera: Camera, source: LightSource) -> None:
        self.source = source
        self._axis = camera.scan_axis
        box = box_in_time_order(source.region, pixels.shape, camera.scan_axis)
        self._look = _core.KnownLight(pixels, camera._handle, box, source.frequency, source.carries_data)
        gain, self._mean = self._look.first[3], self._look.first[6]
        self._part = 1.0 if source.carries_data or not gain > 0.0 else source.gain / gain  # the source in its box

    def measure(self, pixels: Pixels, *places: tuple[int, int]) -> LightSource | None:
        """The light in another frame, near one of the places of its box, x and y as stored; None if not recognised.

        Place, gain, phase, mean and flags are measured; amplitude and signal-to-noise ratio follow the swing; frequency
        (but of data), size and the other values stay.
        """
        source, shape, axis = self.source, pixels.shape, self._axis
        boxes = (Region(x, y, source.width, source.height) for x, y in places)
        found = self._look.find(pixels, [box_in_time_order(box, shape, axis)[:2] for box in boxes])
        if found is None:
            return None
        box, frequency, swing, gain, gain_std, phase, mean, flags = found
        brighter = mean / self._mean
        x, y, _, _ = stored_box(box, shape, axis)
        return dataclasses.replace(
            source,
            x=x,
            y=y,
            frequency=frequency,
            gain=gain * self._part,
            gain_std=gain_std * self._part,
            phase=phase,
            mean=source.mean * brighter,
            snr=source.snr * (swing / brighter) ** 2,
            amplitude=source.amplitude * swing,
            flags=Flag(flags),
        )
