"""All results: short texts, tables that escape, exact dictionaries, data frames."""

from __future__ import annotations

import dataclasses
import inspect
import pickle

import numpy as np
import pytest
import test_grammar

import ocisac_fast
from ocisac_fast import Camera, Flag, receive, tone_gain
from ocisac_fast.core.results import Result
from ocisac_fast.exposure import ExposureReason
from ocisac_fast.receiver import Received

RESULTS = sorted(
    {
        value
        for room in test_grammar.GRAMMAR
        for _, value in test_grammar.public(room)
        if inspect.isclass(value) and test_grammar.is_result(value) and dataclasses.is_dataclass(value)
    },
    key=lambda kind: kind.__name__,
)
LARGE = [
    np.arange(10000.0).reshape(100, 100),
    "x\n" * 4000,
    list(range(1000)),
    1e300 / 3.0,
    {str(k): k for k in range(99)},
]


def with_values(kind: type, value: object) -> Result:
    """An instance without a call of its constructor, every attribute the same value."""
    result = object.__new__(kind)
    for field in dataclasses.fields(kind):
        object.__setattr__(result, field.name, np.array([3]) if field.name == "flags" else value)
    return result


@pytest.mark.parametrize("kind", RESULTS, ids=lambda kind: kind.__name__)
def test_texts_of_results_are_short(kind):
    for value in LARGE:
        lines = repr(with_values(kind, value)).splitlines()
        assert len(lines) <= 12
        assert max(map(len, lines)) <= 80
        assert lines[0].startswith(kind.__name__)


def received() -> Received:
    rows = np.kron(np.random.default_rng(1).integers(0, 2, 60), np.ones(6)) * 100.0 + 20.0
    return receive(np.repeat(rows[:, None], 8, axis=1), Camera(1e-5), chip_rate=1 / 6e-5)[0]


def test_a_dictionary_has_the_attributes_exactly():
    found = received()
    facts = found.to_dict()
    assert list(facts) == [field.name for field in dataclasses.fields(Received)]
    assert all(facts[name] is getattr(found, name) for name in facts)
    inner = ocisac_fast.calibrate(np.sin(np.arange(400.0)[:, None] / 5.0) + 2.0, 500.0).to_dict()["found"]
    assert isinstance(inner, dict)


def test_data_frames_have_a_row_for_an_element():
    pandas = pytest.importorskip("pandas")
    columns = 100.0 + 20.0 * np.sin(np.arange(300.0) / 7.0)[:, None] * np.ones(5)
    gains = tone_gain(columns, Camera(1e-4), 1e4 / (14.0 * np.pi))
    frame = gains.to_pandas()
    assert list(frame["gain"]) == list(gains.gain)
    assert len(frame) == 5
    stacked = tone_gain(np.stack([columns] * 2), Camera(1e-4), 1e4 / (14.0 * np.pi))
    assert stacked.to_pandas().loc[(1, 2), "gain"] == stacked.gain[1, 2]
    one = received().to_pandas()  # arrays of several shapes
    assert len(one) == 1
    assert one["bits"][0] == received().bits
    assert isinstance(pandas.concat([one, one]), pandas.DataFrame)


def test_tables_escape_names_of_files():
    @dataclasses.dataclass(frozen=True, repr=False)
    class Named(Result):
        path: str

    assert "&lt;script&gt;" in Named("<script>")._repr_html_()
    assert "<script>" not in Named("<script>")._repr_html_()


def test_flags_are_texts_by_name_and_numbers_by_a_form():
    assert str(Flag.WEAK | Flag.ALIASED) == f"{Flag.WEAK | Flag.ALIASED}" == "weak, aliased"
    assert str(Flag(0)) == "none"
    assert str(ExposureReason.FIRST | ExposureReason.CEILING) == "first, ceiling"
    assert f"{Flag.TOO_FEW_EDGES:d}" == "131072"
    assert "flags=saturated, near_null" in repr(with_values(ocisac_fast.tones.ToneGain, 0.0))


def test_results_survive_pickling():
    found = received()
    assert pickle.loads(pickle.dumps(found)).bits == found.bits
    frame = np.random.default_rng(0).normal(100, 9, (2, 200, 8))
    camera = ocisac_fast.Camera(22.2e-6)
    for one in (found, ocisac_fast.tone_gain(frame, camera, 500.0), ocisac_fast.find_frequency(frame[0], camera)):
        again = pickle.loads(pickle.dumps(one))
        assert (one == again, hash(one) == hash(again), one == camera) == (True, True, False)
    assert ocisac_fast.tone_gain(frame, camera, 500.0) != ocisac_fast.tone_gain(frame, camera, 501.0)


def test_the_package_lists_what_is_public():
    assert set(dir(ocisac_fast)) == {*ocisac_fast.__all__, "__version__"}
