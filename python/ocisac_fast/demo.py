"""The paper's testbed (table 2) from recording to result, for ``ocisac demo``."""

from __future__ import annotations

import contextlib
import math
import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import plots
from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.results import Result
from ocisac_fast.files import FileError, RecordingStream, atomic_path, read_frames, write_frames
from ocisac_fast.files.writing import fixed_outputs
from ocisac_fast.light.response import exposure_response
from ocisac_fast.light.waveforms import Chips, Constant, SquareWave, Tone, Waveform, integrate_exposure
from ocisac_fast.packets.transmission import transmit
from ocisac_fast.receiver.blind import Received, receive
from ocisac_fast.scene import Ambient, Cosine, Pinhole, Pose, Rectangle, Scene, Sensor, Source, Surface, render
from ocisac_fast.scene.simulation import lamp_bar, simulate_frames, texture
from ocisac_fast.tones.gain import tone_gain

# Table 2 of the paper, and values that it does not state: swing, noise and dark level, DN.
ROWS, COLUMNS, FRAMES_PER_SECOND = 720, 1080, 30.0
ROW_TIME = 22.2e-6
EXPOSURES = (622e-6, 1202e-6, 2404e-6, 4981e-6)
COMMUNICATION = (200.0, 500.0, 700.0)
RING_DIAMETER, TURNS_PER_SECOND = 0.15, 223.0 / 60.0
GRATINGS = (100.0, 200.0, 500.0)  # nominal periods per metre
SWING, NOISE, DARK_LEVEL = 200.0, 2.0, 16.0
FRAME_TIME = 1.0 / FRAMES_PER_SECOND

MESSAGE = "OC-ISAC!"
CHIP_RATE = 10e3
CHIP_CAMERA = Camera(ROW_TIME, 60e-6, dark_level=DARK_LEVEL)
MARKER = "1" * 8  # precedes the message: ASCII bytes begin with 0 and contain no such run

PAYLOAD = b"Hello, world"
PACKET_CHIP_RATE = 15e3


def periods_on_ring(grating: float) -> int:
    """Whole number of periods on the ring, nearest to the nominal grating (1/m)."""
    return round(grating * math.pi * RING_DIAMETER)


def motion_frequency(grating: float) -> float:
    """f_x v of the ring with whole periods, Hz."""
    return periods_on_ring(grating) * TURNS_PER_SECOND


SENSING = tuple(motion_frequency(grating) for grating in GRATINGS)


@dataclass(frozen=True, repr=False)
class Setting(Result):
    """One light of the testbed at one exposure.

    Attributes:
        kind: ``"communication"`` or ``"sensing"``.
        frequency: Hz.
        exposure: s.
        phase: of the simulated light, rad.
    """

    kind: str
    frequency: float
    exposure: float
    phase: float

    @property
    def camera(self) -> Camera:
        return Camera(ROW_TIME, self.exposure, FRAME_TIME, dark_level=DARK_LEVEL)

    @property
    def theory(self) -> float:
        """|sinc(f T_e)|."""
        return float(abs(exposure_response(self.frequency, self.exposure)))


@dataclass(frozen=True, repr=False)
class Measurement(Result):
    """Result of a setting.

    Attributes:
        setting: what was simulated.
        gain, gain_std: of the fit, with its standard error.
        mean: light of the fit, DN.
        phase: of the fit, rad.
    """

    setting: Setting
    gain: float
    gain_std: float
    mean: float
    phase: float


@dataclass(frozen=True, repr=False)
class Demonstration(Result):
    """Results of the demo.

    Attributes:
        measurements: one for each of the 24 settings.
        frames: (settings, rows, columns), as read back.
        chips: (rows, columns), as read back.
        received: result of the receiver for ``chips``.
        text: the message in the bits; empty if not found.
        text_at: index of its first chip.
    """

    measurements: list[Measurement]
    frames: npt.NDArray[Any]
    chips: npt.NDArray[Any]
    received: Received
    text: str
    text_at: int


def settings() -> list[Setting]:
    """The 12 communication and 12 sensing settings of table 2, with random phases."""
    phases = np.random.default_rng(7061).uniform(-math.pi, math.pi, (2, 3, 4))
    return [
        Setting(kind, frequency, exposure, float(phases[i, j, k]))
        for i, (kind, frequencies) in enumerate((("communication", COMMUNICATION), ("sensing", SENSING)))
        for j, frequency in enumerate(frequencies)
        for k, exposure in enumerate(EXPOSURES)
    ]


def run(directory: str | os.PathLike[str], *, force: bool = False) -> Demonstration:
    """Write ``testbed.mkv`` (one frame per setting) and ``chips.png`` to the directory, read and decode them.

    ``lamp.mkv``, ``video.mkv`` and ``banded.png`` are recordings for first steps, as README and docs use them.
    Files that show the same stay, as an earlier run left them.

    Raises:
        FileError: another file has one of these names, and ``force`` is False.
    """
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    light = Chips(MARKER + "".join(f"{code:08b}" for code in MESSAGE.encode("ascii")), CHIP_RATE, repeat=True)
    recordings: dict[str, tuple[Iterable[npt.NDArray[Any]], dict[str, Any]]] = {
        "testbed.mkv": (_testbed_frames(), {"frame_rate": 1 / FRAME_TIME}),
        "chips.png": (_simulated(light, CHIP_CAMERA, start=1.7e-3), {}),
        "lamp.mkv": (lamp_frames(), {"frame_rate": FRAMES_PER_SECOND}),
        "video.mkv": (video_frames(), {"frame_rate": FRAMES_PER_SECOND}),
        "banded.png": ([banded_picture()], {"like": RecordingStream.linear()}),
    }
    for name, (pictures, options) in recordings.items():
        with _placed(folder / name, force) as path:
            write_frames(path, pictures, **options)

    frames = read_frames(folder / "testbed.mkv").frames
    measurements = [_measure(setting, frame) for setting, frame in zip(settings(), frames, strict=True)]
    chips = read_frames(folder / "chips.png").frames
    received = receive(chips, CHIP_CAMERA)[0]
    return Demonstration(measurements, frames, chips[0], received, *message_in(received.bits))


@contextlib.contextmanager
def _placed(target: Path, force: bool) -> Iterator[Path]:
    """A path for a picture or video that becomes ``target``, unless that shows the same."""
    is_there = not force and target.exists()
    foreign = FileError(f"{target}: not of the demo, allowed: another --directory, or --force to replace it")
    if is_there and not target.is_file():
        raise foreign
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / target.name
        yield made
        if is_there:
            if not _show_the_same(made, target):
                raise foreign
            return
        with fixed_outputs((target,), replace=force), atomic_path(target) as temporary:
            temporary.write_bytes(made.read_bytes())


def _show_the_same(made: Path, other: Path) -> bool:
    with contextlib.suppress(FileError):
        return np.array_equal(read_frames(made).frames, read_frames(other).frames)
    return False


def lamp_frames() -> Iterator[npt.NDArray[Any]]:
    """30 frames of 1080 rows of a lamp that sends ``PAYLOAD`` as packets of the default format."""
    chips = "".join(map(str, transmit(PAYLOAD).chips.tolist()))
    light, camera = Chips(chips, PACKET_CHIP_RATE, repeat=True), Camera(ROW_TIME, 100e-6, frame_time=FRAME_TIME)
    lamp = lamp_bar(1080, 160, width=25.0)
    return simulate_frames(light, camera, 1080, 160, 30, swing=180.0, lamp=lamp, dark_level=DARK_LEVEL, noise=NOISE)


def video_frames() -> Iterator[npt.NDArray[Any]]:
    """12 frames of 720 rows: on the left a lamp of 500 Hz, on the right stripes of 100 /m that pass at 2 m/s."""
    distance, pitch = 0.5, 0.5e-3  # m; m between neighbouring pixels at that distance
    lens = Pinhole(columns=640, rows=ROWS, focal_length=4e-3, pixel_pitch=4e-3 * pitch / distance)
    lamp = Source(Rectangle(0.12, 0.5), Pose(position=(-0.1, 0.0, distance)), SquareWave(500.0))
    wall = Pose(position=(0.05, 0.0, 1.001 * distance))  # behind the lamp
    stripes = Surface(Rectangle(0.4, 0.5), wall, pattern=Cosine(100.0), speed=2.0)
    sensor = Sensor(gain=1.6e5, bit_depth=8, full_well=8000, read_noise=10, shot_noise=True)
    camera = Camera(ROW_TIME, EXPOSURES[1], frame_time=FRAME_TIME)
    scene = Scene(lens, camera, sensor, sources=[lamp], surfaces=[stripes], ambient=Ambient(0.8))
    return render(scene.plan(frames=12), noise=True, seed=1)


def banded_picture() -> npt.NDArray[Any]:
    """(720, 960): three balls at an exposure of 1/2000 s, under steady light and a lamp that ripples at 700 Hz."""
    rows, columns = ROWS, 960
    y, x = np.mgrid[:rows, :columns]
    reflectance = np.where(y < 520, 0.55 + 0.25 * x / columns, 0.35)
    for left, top, radius, brightness in ((250, 330, 150, 0.9), (520, 420, 110, 0.45), (745, 300, 120, 0.7)):
        from_light = ((x - left + 0.4 * radius) ** 2 + (y - top + 0.4 * radius) ** 2) / (2.6 * radius**2)
        shade = brightness * (0.35 + 0.65 * np.sqrt(np.clip(1.0 - from_light, 0.0, 1.0)))
        reflectance = np.where((x - left) ** 2 + (y - top) ** 2 < radius**2, shade, reflectance)
    reflectance *= texture(rows, columns, 0.06, seed=3)
    lamp, camera = Tone(700.0), Camera(ROW_TIME, 1 / 2000)
    surroundings: dict[str, Any] = {"ambient": Constant(0.4), "reflectance": reflectance}
    return next(simulate_frames(lamp, camera, rows, columns, swing=150.0, noise=1.0, **surroundings))


def _testbed_frames() -> Iterator[npt.NDArray[Any]]:
    for seed, setting in enumerate(settings()):
        light = SquareWave(setting.frequency, phase=setting.phase)
        yield from _simulated(light, setting.camera, seed=seed)


def _simulated(light: Waveform, camera: Camera, **options: Any) -> Iterator[npt.NDArray[Any]]:
    """Simulate one frame of the testbed's camera."""
    return simulate_frames(light, camera, ROWS, COLUMNS, swing=SWING, noise=NOISE, dark_level=DARK_LEVEL, **options)


def _measure(setting: Setting, frame: npt.NDArray[Any]) -> Measurement:
    result = tone_gain(frame, setting.camera, setting.frequency, waveform="square", pooled=True)
    values = (float(value) for value in (result.gain, result.gain_std, result.mean, result.phase))
    return Measurement(setting, *values)


def message_in(bits: str) -> tuple[str, int]:
    """Characters after the first marker with a complete message, and index of the first chip; else "" and 0."""
    length = 8 * len(MESSAGE)
    for marker in re.finditer(f"1{{{len(MARKER)},}}(?=0)", bits):
        payload = bits[marker.end() : marker.end() + length]
        if len(payload) == length:
            return "".join(chr(int(payload[k : k + 8], 2)) for k in range(0, length, 8)), marker.end()
    return "", 0


def model_rows(measurement: Measurement) -> npt.NDArray[np.float64]:
    """(rows,) fitted square wave as stored by the rows, DN."""
    setting = measurement.setting
    light = SquareWave(setting.frequency, phase=measurement.phase, amplitude=2.0 * measurement.mean)
    return DARK_LEVEL + integrate_exposure(light, setting.camera, ROWS)


def draw(demonstration: Demonstration, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Draw the demo: strips of the recording, a column with its fit, gains and theory, received bits."""
    with _placed(Path(path), force) as made, plots.picture(made, 11.0, 7.6) as figure:
        axes = figure.subplots(2, 2, width_ratios=(1.0, 1.25))
        _draw_strips(axes[0, 0], demonstration)
        _draw_gains(axes[0, 1], demonstration.measurements)
        _draw_column(axes[1, 0], demonstration)
        _draw_bits(axes[1, 1], demonstration)


def _shown(demonstration: Demonstration) -> list[int]:
    """Indices of the settings of 500 Hz: one light at the four exposures."""
    return [k for k, each in enumerate(demonstration.measurements) if each.setting.frequency == 500.0]


def _draw_strips(axes: Any, demonstration: Demonstration) -> None:
    width, gap = 200, 24
    strips = []
    for k in _shown(demonstration):
        strips += [demonstration.frames[k][:, :width], np.full((ROWS, gap), 255, np.uint8)]
    picture = np.concatenate(strips[:-1], axis=1)
    axes.imshow(picture, cmap="gray", vmin=0, vmax=255, aspect="auto", interpolation="nearest")
    axes.set_xticks([k * (width + gap) + width / 2 for k in range(4)], [f"{e * 1e6:.0f} µs" for e in EXPOSURES])
    axes.grid(False)
    axes.set(xlabel="exposure time", ylabel="row", title="One 500 Hz light at four exposures")


def _draw_gains(axes: Any, measurements: list[Measurement]) -> None:
    x = np.linspace(0.0, 4.6, 1000)
    axes.plot(x, np.abs(np.sinc(x)), color=plots.BLACK, lw=1.1, label="theory |sinc(f Tₑ)|")
    for kind, marker, colour in (("communication", "o", plots.BLUE), ("sensing", "s", plots.ORANGE)):
        chosen = [each for each in measurements if each.setting.kind == kind]
        axes.errorbar(
            [each.setting.frequency * each.setting.exposure for each in chosen],
            [each.gain for each in chosen],
            [3.0 * each.gain_std for each in chosen],
            fmt=marker,
            color=colour,
            mfc="none",
            mew=1.6,
            ms=6.5,
            capsize=3,
            label=f"{kind}, {len(chosen)} settings (± 3 σ)",
        )
    worst = max(abs(each.gain - each.setting.theory) for each in measurements)
    axes.text(0.97, 0.62, f"largest difference {worst:.1e}", transform=axes.transAxes, ha="right", fontsize="small")
    axes.set(
        xlabel="frequency × exposure time",
        ylabel="gain",
        title="Gain against theory",
        ylim=(0.0, 1.02),
        xlim=(0.0, 4.6),
    )
    axes.legend(loc="upper right")


def _draw_column(axes: Any, demonstration: Demonstration) -> None:
    time = np.arange(ROWS) * ROW_TIME * 1e3
    for k, colour in zip(_shown(demonstration)[:3:2], (plots.BLUE, plots.RED), strict=True):
        measured = demonstration.measurements[k]
        axes.plot(time, demonstration.frames[k][:, 0], ".", color=colour, ms=2.6, alpha=0.6)
        label = f"{measured.setting.exposure * 1e6:.0f} µs: gain {measured.gain:.4f}"
        axes.plot(time, model_rows(measured), color=colour, lw=1.0, label=label)
    axes.set(
        xlabel="time of the row / ms",
        ylabel="stored value / DN",
        title="One column (dots) and its fit (lines)",
        xlim=(0.0, 8.0),
        ylim=(-5.0, 265.0),
    )
    axes.legend(loc="upper left", ncols=2, columnspacing=1.0)


def _draw_bits(axes: Any, demonstration: Demonstration) -> None:
    received = demonstration.received
    begin = received.phase + demonstration.text_at * received.rows_per_chip
    shown = 24 * received.rows_per_chip
    first = begin - len(MARKER) * received.rows_per_chip
    plots.draw_chips(
        demonstration.chips, CHIP_CAMERA, axes=axes, received=received, first=first - 4, last=begin + shown + 4
    )
    for k, letter in enumerate(demonstration.text[:3]):
        centre = begin + (8 * k + 4) * received.rows_per_chip
        axes.text(centre, -28.0, letter, ha="center", va="center", fontsize="large", weight="bold", color=plots.BLUE)
    axes.text(0.5 * (first + begin), -28.0, "marker", ha="center", va="center", color=plots.BLUE)
    axes.set_title(f"{len(received.bits)} chips received in one frame: “{demonstration.text}”")
    axes.set(xlabel="row", ylim=(-45.0, 265.0))
