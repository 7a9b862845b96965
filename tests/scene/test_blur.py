"""The lens's blur: every row against a Gaussian mean of sharp pixels at that row's time, conservation, refusals."""

import dataclasses
import math

import numpy as np
import pytest

from ocisac_fast import Camera, SquareWave, Tone
from ocisac_fast.reference import exact_scene
from ocisac_fast.scene import (
    Ambient,
    Cosine,
    Disc,
    Grating,
    Pinhole,
    Plain,
    Pose,
    Rectangle,
    Scene,
    Sensor,
    Source,
    Surface,
    load_scene,
    render,
    save_scene,
)
from ocisac_fast.scene.blur import left_out

CAMERA = Camera(60e-6, 500e-6)
LENS = Pinhole(columns=13, rows=9, focal_length=4e-3, pixel_pitch=1e-4, blur=0.7)


def scene_of(*surfaces, lens=LENS, ambient=0.8):
    return Scene(
        lens,
        CAMERA,
        Sensor(200 / 500e-6),
        sources=[Source(Disc(0.03), Pose((0.02, -0.01, 0.5)), SquareWave(900.0, duty=0.3), intensity=2.0)],
        surfaces=surfaces,
        ambient=Ambient(ambient, waveform=Tone(100.0, depth=0.4)),
    )


def blurred_by_hand(scene):
    """Each row from a frame without rolling shutter at that row's time, by a sharp lens of 8 pixels more."""
    lens = scene.lens
    x, y = lens.centre
    larger = {"columns": lens.columns + 16, "rows": lens.rows + 16, "principal_point": (x + 8, y + 8)}
    wide = dataclasses.replace(lens, **larger, blur=0.0)
    still = Camera(1e-15, scene.exposure)
    at = np.arange(-8, 9)
    tail = [math.erf((k + 0.5) / lens.blur / math.sqrt(2)) for k in range(-9, 9)]
    weights = np.outer(np.diff(tail), np.diff(tail)) / 4
    rows = []
    for row in range(lens.rows):
        sharp = exact_scene(dataclasses.replace(scene, lens=wide, camera=still), start=row * CAMERA.row_time)[0]
        rows.append([(sharp[row + 8 + at][:, column + 8 + at] * weights).sum() for column in range(lens.columns)])
    return np.array(rows)


@pytest.mark.parametrize(
    "surface",
    [
        Surface(Rectangle(0.2, 0.1), Pose((0, 0, 0.6), (0.0, 0.2, 0.0)), pattern=Plain(0.6)),
        Surface(Rectangle(0.2, 0.1), Pose((0.05, 0, 0.6)), pattern=Cosine(40.0, low=0.1, high=0.9), speed=8.0),
        Surface(Rectangle(0.5, 0.5), Pose((0, 0, 0.6)), pattern=Grating(31.0)),
    ],
)
def test_frames_are_means_of_sharp_ones(surface):
    scene = scene_of(surface)
    plan = scene.plan(tolerance=1e-4)
    (frame,) = render(plan)
    assert plan.bound < 2e-3
    assert plan.changing_pixels <= scene.lens.rows * scene.lens.columns
    np.testing.assert_allclose(frame, blurred_by_hand(scene), atol=plan.bound)
    rough = scene.plan(tolerance=5.0)
    assert rough.bound <= 5.0
    np.testing.assert_allclose(next(render(rough)), frame, atol=rough.bound + plan.bound)


def test_light_is_kept_and_no_blur_is_the_sharp_picture():
    lenses = (dataclasses.replace(LENS, columns=41, rows=41, blur=blur) for blur in (0, 2.5))
    sharp, blurred = (scene_of(lens=lens, ambient=0) for lens in lenses)
    first, second = (next(render(scene.plan(tolerance=1e-3))).sum(axis=1) for scene in (sharp, blurred))
    assert np.count_nonzero(second) > np.count_nonzero(first)
    steady = [
        dataclasses.replace(scene, sources=[dataclasses.replace(scene.sources[0], waveform=Tone(0.0))])
        for scene in (sharp, blurred)
    ]
    first, second = (float(next(render(scene.plan(tolerance=1e-3))).astype(float).sum()) for scene in steady)
    assert second == pytest.approx(first, rel=1e-6)


def test_what_is_left_out_is_bounded():
    for blur in (0.01, 0.3, 1.0, 7.0):
        assert 0 <= left_out(dataclasses.replace(LENS, blur=blur)) < 1e-8
    assert left_out(dataclasses.replace(LENS, blur=0.0)) == 0.0


def test_files_hold_the_blur(tmp_path):
    path = tmp_path / "scene.toml"
    scene = scene_of(Surface(Rectangle(0.2, 0.1), Pose((0, 0, 0.6)), pattern=Plain(0.6)))
    save_scene(path, scene)
    assert load_scene(path).lens.blur == 0.7
    assert "blur = 0.7" in path.read_text()


def test_moving_edges_are_refused():
    scene = scene_of(Surface(Rectangle(0.5, 0.5), Pose((0, 0, 0.6)), pattern=Grating(30.0), speed=3.0))
    with pytest.raises(ValueError, match=r"blur: got 0\.7 before surface 0, allowed: 0 before a moving grating"):
        scene.plan(tolerance=1e-3)
