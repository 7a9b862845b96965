"""Sums over the rows of a region that are computed from those of a basis."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from ocisac_fast import Camera, _core
from ocisac_fast.sensing.fit import Columns, make_model

ROWS = 480


def frames_of(seed, count=3, columns=5):
    return np.random.default_rng(seed).integers(0, 256, (count, ROWS, columns)).astype(np.uint8)


def model_near(cycles, away, shape, others=()):
    """A model whose frequency is ``away`` cycles over the rows from ``cycles``, with a shape of its tones."""
    place = np.linspace(-1.0, 1.0, ROWS)
    envelope = 1.0 + np.polynomial.polynomial.polyval(place, [0.0, *shape])
    return make_model(ROWS, cycles + away / ROWS, (1,), others, degree=4, shape=envelope)


@settings(max_examples=settings.default.max_examples // 4)
@given(
    seed=st.integers(0, 2**32 - 1),
    cycles=st.floats(2.0 / ROWS, 0.45),
    away=st.floats(-1.0, 1.0),
    shape=st.lists(st.floats(-0.2, 0.2), min_size=4, max_size=4),
    others=st.sampled_from([(), (0.013,), (0.2, 0.31)]),
)
def test_sums_are_those_of_the_frames_for_any_weights(seed, cycles, away, shape, others):
    """Near the first weights from the basis, farther away from another one."""
    frames, camera = frames_of(seed), Camera(1e-5, dark_level=16.0)
    once, again = Columns(frames, camera), Columns(frames, camera, repeated=True)
    for model in (model_near(cycles, 0.0, [0.0] * 4, others), model_near(cycles, away, shape, others)):
        weights = np.vstack([model.weights, model.stiffening.T])
        for one, other in zip(again.project(weights, model.tones), once.project(weights, model.tones), strict=True):
            scale = np.abs(weights).sum(axis=1).max() * 255.0 if one.ndim == 3 else 1.0
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-9 * scale)


def test_frames_are_read_once_while_the_model_changes_little(monkeypatch):
    columns, reads = Columns(frames_of(0), Camera(1e-5), repeated=True), []
    project = _core.project
    monkeypatch.setattr(_core, "project", lambda *given: reads.append(1) or project(*given))
    for away in (0.0, 0.01, -0.05, 0.08):
        model = model_near(0.03, away, [0.1, 0.0, 0.05, 0.0])
        columns.project(np.vstack([model.weights, model.stiffening.T]), model.tones)
    assert len(reads) == len(columns.frames)


@pytest.mark.parametrize("rows", [8, 40])
def test_few_rows_are_read_each_time(rows):
    columns = Columns(frames_of(0)[:, :rows], Camera(1e-5), repeated=True)
    weights = np.random.default_rng(1).standard_normal((2, rows))
    sums, squares = columns.project(weights, (0.1,))
    light = columns.frames.astype(np.float64)
    np.testing.assert_allclose(sums, weights @ light, rtol=1e-12)
    np.testing.assert_allclose(squares, (light**2).sum(axis=1), rtol=1e-12)
