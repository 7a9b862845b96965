"""The virtual testbed of table 2: an LED inside a rotating annular grating, in front of a rolling-shutter camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from ocisac_fast import demo
from ocisac_fast.camera.camera import Camera
from ocisac_fast.light.response import exposure_response
from ocisac_fast.light.waveforms import Constant, SquareWave
from ocisac_fast.scene import (
    Grating,
    Mask,
    Pinhole,
    Pose,
    Rectangle,
    Scene,
    Sensor,
    Source,
    render,
)

FRAMES = 1800  # per setting, as in the paper

DISTANCE = 0.3  # m, from the camera to the ring

# Values that the paper does not state. The lens sees the ring in all rows; the noise is independent of the light. The
# two clocks differ, so that the light's phase takes all values over a recording; dark rows are not clipped at 0.
CLOCK_OFFSET = 70e-6
FOCAL_LENGTH, PIXEL_PITCH = 6e-3, 2.9e-6  # m
FULL_WELL = 20e3  # electrons at 255 DN
TOLERANCE = 1e-3  # DN, of the rendering

Kind = Literal["communication", "sensing"]


def speed() -> float:
    """Speed of the grating, m/s: v = pi D N."""
    return math.pi * demo.RING_DIAMETER * demo.TURNS_PER_SECOND


def true_grating(grating: float) -> float:
    """Periods per metre of the ring with a whole number of periods."""
    return demo.periods_on_ring(grating) / (math.pi * demo.RING_DIAMETER)


@dataclass(frozen=True)
class Setting:
    """One light or grating at one exposure."""

    kind: Kind  # communication: flickering LED, static grating; sensing: steady LED, rotating grating
    nominal: float  # as printed in the paper: Hz, or periods per metre
    exposure: float  # s

    @property
    def frequency(self) -> float:
        """Frequency of the light in a pixel, Hz: f_c, or f_x v of the ring with a whole number of periods."""
        return self.nominal if self.kind == "communication" else demo.motion_frequency(self.nominal)

    @property
    def camera(self) -> Camera:
        frame_time = (1.0 + CLOCK_OFFSET) / demo.FRAMES_PER_SECOND
        return Camera(demo.ROW_TIME, self.exposure, frame_time, dark_level=demo.DARK_LEVEL)

    @property
    def theory(self) -> float:
        """|sinc(f T_e)|."""
        return float(abs(exposure_response(self.frequency, self.exposure)))


def settings() -> list[Setting]:
    """The 12 settings of communication and the 12 of sensing, in ascending order of frequency, then exposure."""
    lights: list[tuple[Kind, float]] = [("communication", f) for f in demo.COMMUNICATION]
    gratings: list[tuple[Kind, float]] = [("sensing", g) for g in demo.GRATINGS]
    return [Setting(kind, nominal, exposure) for kind, nominal in lights + gratings for exposure in demo.EXPOSURES]


def scene(setting: Setting, columns: int, turn: float) -> Scene:
    """The testbed in front of the middle ``columns`` columns of the camera, the light ``turn`` cycles (0 to 1) ahead.

    The lampshade is the plane that touches the ring in front of the LED; its bars have the pitch of the ring. In
    recordings of communication it is static, with a slot in front of the middle column.
    """
    lens = Pinhole(columns=columns, rows=demo.ROWS, focal_length=FOCAL_LENGTH, pixel_pitch=PIXEL_PITCH)
    sensor = Sensor(
        demo.SWING / setting.exposure, bit_depth=8, full_well=FULL_WELL, read_noise=demo.NOISE * FULL_WELL / 255.0
    )
    flickers = setting.kind == "communication"
    light = SquareWave(setting.frequency, phase=2.0 * math.pi * turn) if flickers else Constant(1.0)
    lamp = Source(Rectangle(0.2, 0.2), Pose((0.0, 0.0, DISTANCE + demo.RING_DIAMETER / 2.0)), light)
    grating = demo.GRATINGS[0] if flickers else setting.nominal
    bars = Grating(true_grating(grating), phase=0.0 if flickers else -2.0 * math.pi * turn)
    shade = Mask(Rectangle(0.2, 0.2), Pose((0.0, 0.0, DISTANCE)), pattern=bars, speed=0.0 if flickers else speed())
    return Scene(lens, setting.camera, sensor, sources=(lamp,), masks=(shade,))


def record(setting: Setting, frames: int, seed: int, columns: int = 1) -> npt.NDArray[np.uint8]:
    """A recording of the testbed: (frames, rows, columns) bytes with noise, rendered from :func:`scene`."""
    number = settings().index(setting)
    turn = float(np.random.default_rng([seed, number]).uniform())
    plan = scene(setting, columns, turn).plan(tolerance=TOLERANCE, frames=frames)
    return np.stack(list(render(plan, noise=True, seed=seed * len(settings()) + number)))
