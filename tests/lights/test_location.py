"""Where the camera is: within 5 cm at 3 m with a pixel of noise, honest errors, and sets of lights that cannot tell."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ocisac_fast as of

cv2 = pytest.importorskip("cv2")

FOCAL, CENTRE = 1500.0, (960.0, 540.0)
LENS = ("--focal", "1500", "--centre", "960,540")
LAMPS = np.array(
    [[-1.3, -0.7, 3.0], [1.3, -0.7, 3.0], [1.3, 0.7, 3.0], [-1.3, 0.7, 3.0], [0.1, 0.0, 2.7], [-0.5, 0.3, 2.6]]
)


def seen_from(position: np.ndarray, lamps: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Pixels of the lamps (lights, 2); the camera looks up at them, turned by a small rotation vector."""
    rotation = cv2.Rodrigues(turn)[0]
    inside = (lamps - position) @ rotation.T
    return np.asarray(FOCAL * inside[:, :2] / inside[:, 2:] + np.array(CENTRE))


class TestAccuracy:
    def test_within_5_cm_at_3_m_with_a_pixel_of_noise(self) -> None:
        random = np.random.default_rng(1)
        errors, pulls, told = [], [], []
        for _ in range(100):
            position = random.uniform((-0.3, -0.3, -0.1), (0.3, 0.3, 0.1))
            pixels = seen_from(position, LAMPS, random.normal(0, 0.05, 3)) + random.normal(0, 1, LAMPS[:, :2].shape)
            found = of.locate_camera(LAMPS, pixels, focal=FOCAL, centre=CENTRE)
            errors.append(np.linalg.norm(found.position - position))
            pulls.append((found.position - position) @ np.linalg.solve(found.covariance, found.position - position))
            told.append(found.status)
        assert max(errors) < 0.05
        assert told.count("ok") >= 98
        assert np.mean(pulls) == pytest.approx(3.0, abs=0.75)  # chi-square of three: 5 standard errors of the mean

    def test_rendered_lamps_found_by_detect_sources(self) -> None:
        """Disks that flicker, each at its own frequency, found in the picture; a further pixel of noise on top."""
        random = np.random.default_rng(2)
        camera, rows, columns = of.Camera(1e-5, exposure=2e-5), 1080, 1920
        frequencies = np.geomspace(6e3, 2e4, len(LAMPS))
        position = np.array([0.2, -0.1, 0.05])
        true = seen_from(position, LAMPS, np.array([0.02, -0.03, 0.01]))
        picture = 20.0 + 2.0 * random.standard_normal((rows, columns))
        y, x = np.ogrid[:rows, :columns]
        for (u, v), frequency in zip(true, frequencies, strict=True):
            light = of.integrate_exposure(of.SquareWave(frequency), camera, rows)
            disk = (x - u) ** 2 + (y - v) ** 2 < 30.0**2
            picture = np.where(disk, picture + 180.0 * light[:, None], picture)
        found = of.detect_sources(np.clip(np.rint(picture), 0, 255).astype(np.uint8), camera)
        by_frequency = [min(found, key=lambda s, f=f: abs(s.frequency - f)) for f in frequencies]
        assert all(abs(s.frequency / f - 1) < 0.02 for s, f in zip(by_frequency, frequencies, strict=True))
        middles = np.array([[s.x + (s.width - 1) / 2, s.y + (s.height - 1) / 2] for s in by_frequency])
        for _ in range(20):
            pixels = middles + random.normal(0, 1, middles.shape)
            place = of.locate_camera(LAMPS, pixels, focal=FOCAL, centre=CENTRE, noise=2.0)
            assert np.linalg.norm(place.position - position) < 0.05

    def test_distortion_is_undone(self) -> None:
        bent = (-0.2, 0.05, 0.001, -0.001)
        turn, position = np.array([0.1, 0.05, 0.3]), np.array([0.1, 0.2, -0.1])
        matrix = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1]])
        shift = -cv2.Rodrigues(turn)[0] @ position
        pixels = cv2.projectPoints(LAMPS, turn, shift, matrix, np.array(bent))[0].reshape(-1, 2)
        found = of.locate_camera(LAMPS, pixels, focal=(FOCAL, FOCAL), centre=CENTRE, distortion=bent)
        assert found.position == pytest.approx(position, abs=1e-5)
        assert found.rotation == pytest.approx(cv2.Rodrigues(turn)[0], abs=1e-5)

    @pytest.mark.parametrize("distance", [300.0, 3e3, 3e5])
    def test_lights_close_together_in_the_picture_hardly_tell(self, distance: float) -> None:
        position = np.array([0.2, -0.1, -distance])
        pixels = seen_from(position, LAMPS, np.zeros(3))
        found = of.locate_camera(LAMPS, pixels, focal=FOCAL, centre=CENTRE, noise=0.5)
        assert found.status == "degenerate"


class TestWhatCannotBeTold:
    def test_three_lights_are_ambiguous_and_the_truth_is_among_the_places(self) -> None:
        position = np.array([0.3, 0.2, 0.0])
        lamps = LAMPS[[0, 1, 4]]
        found = of.locate_camera(lamps, seen_from(position, lamps, np.zeros(3)), focal=FOCAL, centre=CENTRE)
        assert found.status == "ambiguous"
        places = np.vstack([found.position, found.alternatives])
        assert np.linalg.norm(places - position, axis=1).min() < 1e-3
        wrong = places[np.linalg.norm(places - position, axis=1).argmax()]
        away = np.sign(wrong - position)
        low, high = np.where(away > 0, -9.0, position - 0.02), np.where(away > 0, position + 0.02, 9.0)
        resolved = of.locate_camera(
            lamps, seen_from(position, lamps, np.zeros(3)), focal=FOCAL, centre=CENTRE, inside=(list(low), list(high))
        )
        assert resolved.position == pytest.approx(position, abs=1e-3)

    def test_a_far_small_square_is_ambiguous(self) -> None:
        lamps = np.array([[-0.2, -0.2, 6.0], [0.2, -0.2, 6.0], [0.2, 0.2, 6.0], [-0.2, 0.2, 6.0]])
        tilted = lamps @ cv2.Rodrigues(np.array([0.3, 0.0, 0.0]))[0].T
        found = of.locate_camera(tilted, seen_from(np.zeros(3), tilted, np.zeros(3)), focal=FOCAL, centre=CENTRE)
        assert found.status in ("ambiguous", "degenerate")
        assert found.reason

    def test_lights_in_a_line(self) -> None:
        lamps = np.linspace([-1.0, 0.0, 3.0], [1.0, 0.2, 3.0], 5)
        found = of.locate_camera(lamps, seen_from(np.zeros(3), lamps, np.zeros(3)), focal=FOCAL, centre=CENTRE)
        assert found.status == "degenerate"
        assert "in one line" in found.reason
        assert np.all(np.isnan(found.position))
        assert np.all(np.isinf(found.position_std))

    def test_two_ids_changed(self) -> None:
        pixels = seen_from(np.zeros(3), LAMPS, np.zeros(3))[[1, 0, 2, 3, 4, 5]]
        found = of.locate_camera(LAMPS, pixels, focal=FOCAL, centre=CENTRE)
        assert found.status in ("inconsistent", "degenerate")
        assert found.reason


class TestCommand:
    def files(self, tmp_path: Path, count: int = 6) -> tuple[str, str]:
        lights, seen = tmp_path / "lights", tmp_path / "seen"
        pixels = seen_from(np.array([0.1, 0.0, 0.0]), LAMPS, np.zeros(3))
        lights.write_text(
            "\n".join(json.dumps({"light": k, "x_m": x, "y_m": y, "z_m": z}) for k, (x, y, z) in enumerate(LAMPS))
        )
        boxes = [{"light": k, "x": x - 10, "y": y - 5, "width": 21, "height": 11} for k, (x, y) in enumerate(pixels)]
        seen.write_text("\n".join(json.dumps(box) for box in boxes[:count]) + "\n\n")
        return str(lights), str(seen)

    def test_locates(self, tmp_path: Path, run: Any, facts: Any) -> None:
        command = ("locate", *self.files(tmp_path), *LENS)
        (found,) = facts(*command)
        assert found["status"] == "ok"
        assert [found[name] for name in ("x_m", "y_m", "z_m")] == pytest.approx([0.1, 0.0, 0.0], abs=1e-4)
        assert found["x_std_m"] < 0.05
        code, out, _ = run(*command)
        assert code == 0
        assert "0.1000 m" in " ".join(out)

    def test_refuses_in_one_line(self, tmp_path: Path, run: Any) -> None:
        lights, seen = self.files(tmp_path, count=2)
        wrong = ("--focal", "a", "--centre", "1,2")
        for words, message in (
            ((seen, *LENS), "got 2 of the lights"), ((lights, *LENS), "line 1"), ((seen, *wrong), "'--focal'"),
        ):  # fmt: skip
            code, _, (line,) = run("locate", lights, *words)
            assert code == 2
            assert message in line


def test_a_camera_straight_below_a_light_is_found():
    """Two poses of three lights at a right angle are one there: noise leaves a solver none of them."""
    random = np.random.default_rng(0)
    for noise in (0.0, 0.3):
        for _ in range(40):
            (a, b), height = random.uniform(0.5, 2, 2), random.uniform(1, 4)
            places = np.array([[0, 0, height], [a, 0, height], [0, b, height]])
            pixels = places[:, :2] / height * 1500 + (960, 540) + random.normal(0, noise, (3, 2))
            got = of.locate_camera(places, pixels, focal=1500.0, centre=(960.0, 540.0))
            poses = [got.position, *got.alternatives]
            assert min(np.linalg.norm(pose) for pose in poses) < max(0.1 * height, 6 * np.linalg.norm(got.position_std))


@pytest.mark.parametrize("origin", [1e4, 5e5, 4e6])
def test_places_far_from_their_origin_are_located_alike(origin):
    random = np.random.default_rng(4)
    offset = origin * np.array([1.0, -0.5, 0.3])
    for _ in range(5):
        position = random.uniform((-0.3, -0.3, -0.1), (0.3, 0.3, 0.1))
        pixels = seen_from(position, LAMPS, random.normal(0, 0.05, 3)) + random.normal(0, 0.5, LAMPS[:, :2].shape)
        near = of.locate_camera(LAMPS, pixels, focal=FOCAL, centre=CENTRE, noise=0.5)
        far = of.locate_camera(
            LAMPS + offset, pixels, focal=FOCAL, centre=CENTRE, noise=0.5, inside=(offset - 1.0, offset + 1.0)
        )
        assert (near.status, far.status) == ("ok", "ok")
        np.testing.assert_allclose(far.position - offset, near.position, atol=1e-6)
        np.testing.assert_allclose(far.position_std, near.position_std, rtol=1e-4)
