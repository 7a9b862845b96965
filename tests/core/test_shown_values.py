"""Values and alternatives in messages."""

import numpy as np
import pytest

import ocisac_fast
from ocisac_fast.core.checks import one_of, shown


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("z", "'z'"),
        (3, "3"),
        (np.float64(0.5), "0.5"),
        ((1, 2.5), "(1, 2.5)"),
        (None, "None"),
        ("a\nb", "'a\\nb'"),
    ],
)
def test_short_values_are_whole(value, text):
    assert shown(value) == text


@pytest.mark.parametrize(
    "value",
    ["x" * 10**6, list(range(10**6)), np.zeros((500, 500)), dict.fromkeys(range(99), "y" * 100), b"z" * 999, 10**300],
)
def test_long_values_are_cut(value):
    assert 20 < len(shown(value)) <= 80
    assert "..." in shown(value)
    assert "\n" not in shown(value)


def test_a_refusal_is_short():
    with pytest.raises(ValueError, match="scan_axis") as refused:
        ocisac_fast.Camera(1e-5, scan_axis="y" * 10_000)
    assert len(str(refused.value)) < 160


def test_alternatives_read_as_a_sentence():
    assert [one_of(texts) for texts in (["a"], ["a", "b"], ["a", "b", "a", "c"])] == ["a", "a or b", "a, b or c"]
