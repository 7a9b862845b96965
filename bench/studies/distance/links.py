"""A camera films light bars on vehicles; each bar repeats a packet of its own. Frames are scenes of the library.

The bound of every link is the known-everything detector: the true clock, levels, noise and columns of the lamp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.chips import ChipClock, chip_llr
from ocisac_fast.light.waveforms import Constant, Sum
from ocisac_fast.packets import PacketAssembler, PacketFormat, Transmission, transmit
from ocisac_fast.receiver import MultiReceiver, SourceFrame
from ocisac_fast.scene import PathLoss, Pinhole, Pose, Rectangle, Scene, Sensor, Source, render

ROWS, ROW_TIME, FRAME_TIME = 1080, 15e-6, 1 / 30
CHIP_RATE, EXPOSURE = 25e3, 120e-6  # 2.7 rows a chip, 3 chips of exposure
FOCAL_LENGTH, PIXEL_PITCH, LENS_BLUR = 12e-3, 3e-6, 1.0  # m, m, px
LAMP_WIDTH, LAMP_HEIGHT, LANE = 0.1, 0.9, 0.8  # m; LANE: between the middles of neighbouring lamps
ATTENUATION = 0.01  # 1/m, haze
PEAK, FULL_WELL, READ_NOISE = 200.0, 10_000.0, 4.0  # DN at 0 m, electrons, electrons
PAYLOAD_BYTES, BLOCK_BYTES, FRAMES = 16, 2, 60  # two seconds

_EDGE = math.ceil(3.0 * LENS_BLUR)  # px of a lamp's outline that the lens's blur reaches
_TOLERANCE = 0.25  # DN
_METHOD = "mlse"


@dataclass(frozen=True)
class Link:
    """The parameters of a link."""

    distance: float = 10.0  # of the lamps in the middle of the recording, m
    ambient: float = 0.0  # share of the lamps' mean light that is not modulated, below 1; the peak is kept
    closing: float = 0.0  # relative speed along the camera's axis, m/s
    passing: float = 0.0  # relative speed along the rows, m/s
    lamps: int = 1  # vehicles side by side

    @property
    def rows(self) -> float:
        """Rows on a lamp in the middle of the recording."""
        return FOCAL_LENGTH / PIXEL_PITCH * LAMP_HEIGHT / self.distance


@dataclass
class LinkResult:
    """Counts over recordings of a link, of the receiver and of the known-everything detector (bound)."""

    packets: int = 0  # payloads that should have arrived: one for each lamp and recording
    received: int = 0  # payloads that arrived within FRAMES frames
    bound: int = 0
    wrong_payloads: int = 0  # that no lamp sent
    chips: int = 0  # whose light falls wholly into the lamp's rows
    read: int = 0  # those that the receiver returned
    read_errors: int = 0
    bound_errors: int = 0  # of all chips

    def add(self, other: LinkResult) -> None:
        """Add the counts of another recording."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


@dataclass(frozen=True)
class _Lamp:
    """A lamp's packet and light; chip 0 begins at ``start``, s."""

    packet: Transmission
    start: float
    source: Source

    def chip(self, number: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
        return np.asarray(self.packet.chips[number % self.packet.chips.size])


def measure_link(link: Link, seed: int) -> LinkResult:
    """Film and read a link for ``FRAMES`` frames.

    Args:
        link: its geometry.
        seed: of payloads, phases and noise, 0 or above.
    """
    random = np.random.default_rng([seed, 29])
    lamps = [_lamp(link, index, random) for index in range(link.lamps)]
    scene = _scene(link, lamps)
    camera = Camera(ROW_TIME, EXPOSURE, frame_time=FRAME_TIME)
    receiver = MultiReceiver(camera, chip_rate=CHIP_RATE, format=_format(), max_sources=max(2 * link.lamps, 2))
    readers = [_KnownReader(lamp) for lamp in lamps]
    result = LinkResult(packets=link.lamps)
    arrived: set[int] = set()
    for number, frame in enumerate(render(scene.plan(tolerance=_TOLERANCE, frames=FRAMES), noise=True, seed=seed)):
        boxes = [_box(scene, lamp, number) for lamp in lamps]
        for reader, box in zip(readers, boxes, strict=True):
            reader.read(frame, box, scene, number, result)
        for answer in receiver.push(frame, number=number):
            _judge(answer, lamps, boxes, number, arrived, result)
    result.received = len(arrived)
    result.bound = sum(reader.complete for reader in readers)
    return result


def _format() -> PacketFormat:
    return PacketFormat(block_bytes=BLOCK_BYTES)


def _lamp(link: Link, index: int, random: np.random.Generator) -> _Lamp:
    packet = transmit(random.bytes(PAYLOAD_BYTES), format=_format(), number=index)
    start = -float(random.uniform(0.0, packet.chips.size / CHIP_RATE))
    modulated = packet.waveform(CHIP_RATE, start=start, amplitude=1.0)
    steady = 0.5 * link.ambient / (1.0 - link.ambient)  # the chips' mean is 1/2
    x = (index - 0.5 * (link.lamps - 1)) * LANE + 0.5 * link.passing * FRAMES * FRAME_TIME
    z = link.distance + 0.5 * link.closing * FRAMES * FRAME_TIME
    source = Source(
        Rectangle(LAMP_WIDTH, LAMP_HEIGHT),
        Pose(position=(x, 0.0, z)),
        Sum((modulated, Constant(steady))) if steady else modulated,
        intensity=1.0 / (1.0 + steady),
        path_loss=PathLoss(attenuation=ATTENUATION),
    )
    return _Lamp(packet, start, source)


def _scene(link: Link, lamps: list[_Lamp]) -> Scene:
    nearest = link.distance - 0.5 * abs(link.closing) * FRAMES * FRAME_TIME
    width = (link.lamps * LANE + abs(link.passing) * FRAMES * FRAME_TIME) / nearest
    lens = Pinhole(
        columns=64 + round(width * FOCAL_LENGTH / PIXEL_PITCH),
        rows=ROWS,
        focal_length=FOCAL_LENGTH,
        pixel_pitch=PIXEL_PITCH,
        velocity=(link.passing, 0.0, link.closing),
        blur=LENS_BLUR,
    )
    sensor = Sensor(PEAK / EXPOSURE, bit_depth=8, full_well=FULL_WELL, read_noise=READ_NOISE, shot_noise=True)
    return Scene(
        lens,
        Camera(ROW_TIME, EXPOSURE, frame_time=FRAME_TIME, dark_level=10.0),
        sensor,
        sources=[lamp.source for lamp in lamps],
    )


@dataclass(frozen=True)
class _Box:
    """A lamp's inner pixels, clear of the lens's blur, and its light there, DN above dark."""

    top: int
    bottom: int
    left: int
    right: int
    low: float
    high: float


def _box(scene: Scene, lamp: _Lamp, number: int) -> _Box:
    shift = np.array(scene.lens.velocity) * number * FRAME_TIME
    corner = np.array(lamp.source.pose.position) - shift
    half = np.array(lamp.source.shape.half_size)
    first = scene.lens.pixels_of([corner[0] - half[0], -half[1], corner[2]])
    last = scene.lens.pixels_of([corner[0] + half[0], half[1], corner[2]])
    left, top = (math.ceil(value) + _EDGE for value in first)
    right, bottom = (math.floor(value) - _EDGE + 1 for value in last)
    peak = PEAK * math.exp(-ATTENUATION * float(np.linalg.norm(corner)))
    share = 1.0 - lamp.source.intensity  # of the peak that is steady
    return _Box(max(top, 0), min(bottom, ROWS), left, right, peak * share, peak)


def _whole_chips(lamp: _Lamp, box: _Box, number: int) -> npt.NDArray[np.int64]:
    """Numbers of the chips whose light falls wholly into the lamp's rows."""
    begin = number * FRAME_TIME + box.top * ROW_TIME  # the first row's exposure ends
    end = number * FRAME_TIME + (box.bottom - 1) * ROW_TIME - EXPOSURE  # the last row's begins
    first = math.ceil((begin - lamp.start) * CHIP_RATE)
    return np.arange(first, max(math.floor((end - lamp.start) * CHIP_RATE), first), dtype=np.int64)


class _KnownReader:
    """Detects a lamp's chips with everything known but the chips, and assembles its packet."""

    def __init__(self, lamp: _Lamp) -> None:
        self._lamp = lamp
        self._assembler = PacketAssembler(format=_format())
        self.complete = False

    def read(self, frame: npt.NDArray[np.uint8], box: _Box, scene: Scene, number: int, result: LinkResult) -> None:
        if box.right <= box.left or box.bottom <= box.top:
            return
        pixels = frame[box.top : box.bottom, box.left : box.right].mean(axis=1) - scene.camera.dark_level
        rows = (pixels - box.low) / (box.high - box.low)
        end = number * FRAME_TIME + box.top * ROW_TIME - self._lamp.start  # of the first row's exposure
        first = math.floor((end - EXPOSURE) * CHIP_RATE)
        last = math.floor((end + (rows.size - 1) * ROW_TIME) * CHIP_RATE)
        clock = ChipClock(
            rows_per_chip=1.0 / (CHIP_RATE * ROW_TIME),
            phase=(0.5 * EXPOSURE - end) / ROW_TIME,
            exposure_rows=EXPOSURE / ROW_TIME,
        )
        llr = chip_llr(rows, clock, noise=_noise(box), first=first, count=last - first + 1, method=_METHOD)
        chips = _whole_chips(self._lamp, box, number)
        result.chips += chips.size
        result.bound_errors += int(np.count_nonzero((llr[chips - first] > 0) != self._lamp.chip(chips)))
        done = self._assembler.push(first, llr).payload
        self.complete |= done is not None and done.data == self._lamp.packet.payload


def _noise(box: _Box) -> float:
    """Standard deviation of a mean of a row over the swing: shot noise of the mean light, read noise, rounding."""
    gain = (255.0 - 10.0) / FULL_WELL  # DN an electron
    light = 0.5 * (box.low + box.high) / gain
    variance = gain**2 * (light + READ_NOISE**2) + 1.0 / 12.0
    return math.sqrt(variance / (box.right - box.left)) / (box.high - box.low)


def _judge(
    answer: SourceFrame, lamps: list[_Lamp], boxes: list[_Box], number: int, arrived: set[int], result: LinkResult
) -> None:
    """Compare a light's answer with the lamp that it lies on."""
    received = answer.received
    if received is None:
        return
    if received.payload is not None:
        sent = [index for index, lamp in enumerate(lamps) if lamp.packet.payload == received.payload.data]
        arrived.update(sent)
        result.wrong_payloads += not sent
    if not received.bits:
        return
    middle = answer.region.x + 0.5 * answer.region.width
    nearest = min(range(len(lamps)), key=lambda k: abs(0.5 * (boxes[k].left + boxes[k].right) - middle))
    lamp = lamps[nearest]
    bits = np.frombuffer(received.bits.encode(), np.uint8) - ord("0")
    light = number * FRAME_TIME + received.phase * ROW_TIME - 0.5 * received.exposure - lamp.start
    numbers = round(light * CHIP_RATE) + np.arange(bits.size)
    shifts = [(np.asarray(bits != lamp.chip(numbers + shift)), numbers + shift) for shift in (0, -1, 1)]
    wrong, numbers = min(shifts, key=lambda pair: np.count_nonzero(pair[0]))
    inside = np.isin(numbers, _whole_chips(lamp, boxes[nearest], number))
    result.read += int(np.count_nonzero(inside))
    result.read_errors += int(np.count_nonzero(wrong[inside]))
