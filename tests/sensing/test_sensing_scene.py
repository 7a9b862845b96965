"""One scene, the paper's joint case: a source that sends chips, a moving texture, ambient light, the same frames."""

import numpy as np
import pytest

import ocisac_fast as ocisac
from ocisac_fast import Camera
from ocisac_fast.scene import Ambient, Cosine, Pinhole, Plain, Pose, Rectangle, Scene, Sensor, Source, Surface, render
from ocisac_fast.sensing import KnownMotion

ROW_TIME, EXPOSURE, FRAME_TIME = 22.2e-6, 150e-6, 1 / 30
CAMERA = Camera(ROW_TIME, EXPOSURE, FRAME_TIME, dark_level=8.0)
ROWS, COLUMNS, FRAMES = 720, 320, 3
CHIPS, CHIP_RATE = "110100010111001", 5000.0  # sent over and over
FX, SPEED = 400.0, 1.751
PITCH = 0.3 / 1000  # m a pixel: 0.3 m away, a focal length of 1000 pixels


def joint_scene(lit):
    """Left a wall that the source lights, right a texture that moves across the rows; ambient light on both."""
    lens = Pinhole(focal_length=5e-3, pixel_pitch=5e-6, rows=ROWS, columns=COLUMNS)
    plate, left, right = Rectangle(150 * PITCH, 900 * PITCH), Pose((-75 * PITCH, 0, 0.3)), Pose((80 * PITCH, 0, 0.3))
    wall = Surface(plate, left, pattern=Plain(0.8), lit_by_sources=True)
    texture = Surface(plate, right, pattern=Cosine(FX), speed=SPEED)
    waveform = ocisac.Chips(CHIPS, CHIP_RATE, repeat=True)
    lamp = Source(Rectangle(0.02, 0.02), Pose((-0.02, -0.15, 0.1)), waveform, intensity=300.0)
    sensor = Sensor(gain=100 / EXPOSURE, bit_depth=8, full_well=12000.0, read_noise=30.0, shot_noise=True)
    return Scene(lens, CAMERA, sensor, sources=(lamp,) if lit else (), surfaces=(wall, texture), ambient=Ambient(0.9))


def frames_of(lit, seed):
    plan = joint_scene(lit).plan(tolerance=0.05, frames=FRAMES)
    return np.stack(list(render(plan, noise=True, seed=seed)))


def line_of_chips():
    """The strongest line of the chips, its amplitude over the mean, and all the other lines below half the row rate."""
    levels = np.array([int(chip) for chip in CHIPS])
    harmonics = np.arange(1, int(0.49 / ROW_TIME * len(CHIPS) / CHIP_RATE))
    ratios = 2 * np.abs(np.fft.fft(levels)[harmonics % len(CHIPS)] * np.sinc(harmonics / len(CHIPS))) / levels.sum()
    strongest = ratios.argmax()
    frequencies = harmonics * CHIP_RATE / len(CHIPS)
    real = np.delete(frequencies, strongest)[np.delete(ratios, strongest) > 1e-9]
    return frequencies[strongest], ratios[strongest], real


def scores_of(seed):
    """Errors over standard errors of f_x v and both gains; the chips must be right."""
    lit, unlit = frames_of(True, seed), frames_of(False, seed + 1000)
    wall, texture = np.s_[:, :, 20:140], np.s_[:, :, 180:300]

    received = ocisac.receive(lit[wall], CAMERA)
    assert len(received) == FRAMES
    for one in received:
        assert len(one.bits) > 70
        assert one.bits in CHIPS * 8

    moving = ocisac.sense_region(lit[texture], CAMERA, motion=KnownMotion(pitch=PITCH))
    assert moving.kind == "moving"
    assert moving.speed == pytest.approx(SPEED, rel=1e-3)

    frequency, ratio, others = line_of_chips()
    background = ocisac.background_light(unlit[wall], CAMERA)
    light = ocisac.sense_region(lit[wall], CAMERA, frequency, depth=ratio, others=others, background=background)
    assert light.kind == "light"
    return [
        (moving.motion_frequency - FX * SPEED) / moving.motion_frequency_std,
        (moving.gain - np.sinc(FX * SPEED * EXPOSURE)) / moving.gain_std,
        (light.gain - np.sinc(frequency * EXPOSURE)) / light.gain_std,
    ]


def test_communication_and_sensing_from_the_same_frames():
    scores = scores_of(1)
    assert np.sum(np.square(scores)) < 11.34  # chi-square of 3 at 99 %
    assert np.abs(scores).max() < 4


@pytest.mark.nightly
def test_communication_and_sensing_from_the_same_frames_at_ten_other_seeds():
    scores = [scores_of(seed) for seed in range(2, 12)]
    assert np.sum(np.square(scores)) < 50.89  # chi-square of 30 at 99 %
    assert np.abs(scores).max() < 4
