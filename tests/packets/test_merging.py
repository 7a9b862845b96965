"""Results of several receivers, merged by light and time."""

from __future__ import annotations

import json
import math

import pytest

from ocisac_fast import merge_receptions


def line(light: object, time: float, **more: object) -> str:
    return json.dumps({"light": light, "time_s": time, **more})


def test_merges_by_light_and_time() -> None:
    lines = [
        line("lamp", 1.04, receiver="b", payload="hello", snr_db=20.0),
        line("lamp", 1.00, receiver="a", payload="hellp", snr_db=10.0),
        line("lamp", 1.01, receiver="c", payload="hello", snr_db=10.0),
        line("other", 1.00, receiver="a"),
        line("lamp", 2.00, receiver="a"),
        "",
    ]
    first, other, last = merge_receptions(lines)
    assert (first["light"], first["receivers"], first["payload"]) == ("lamp", ["a", "c", "b"], "hello")
    assert first["agreement"] == pytest.approx(110 / 120)
    assert first["snr_db"] == pytest.approx(10 * math.log10(120))
    assert first["time_s"] == pytest.approx((1.00 * 10 + 1.01 * 10 + 1.04 * 100) / 120)
    assert (other["light"], other["payload"], other["agreement"], other["snr_db"]) == ("other", None, None, None)
    assert last["time_s"] == 2.0


def test_the_order_of_lines_does_not_matter() -> None:
    lines = [line(k % 3, 0.01 * k, receiver=k % 2, snr_db=k) for k in range(30)]
    assert merge_receptions(lines) == merge_receptions(lines[::-1])


def test_a_receivers_next_frame_is_another_moment() -> None:
    merged = merge_receptions([{"light": 1, "time_s": t, "receiver": "a"} for t in (0.0, 0.01)])
    assert [moment["receivers"] for moment in merged] == [["a"], ["a"]]


def test_a_window_does_not_grow() -> None:
    times = [0.0, 0.04, 0.08]
    merged = merge_receptions([{"light": 1, "time_s": t} for t in times])
    assert [len(moment["receivers"]) for moment in merged] == [2, 1]


def test_numbers_and_texts_are_different_lights() -> None:
    assert len(merge_receptions([line(1, 0.0), line("1", 0.0)])) == 2


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ("{", "line 2: got '{', allowed: a JSON object"),
        ("[]", "line 2: got"),
        (line(1.5, 0.0), "line 2: light: got 1.5"),
        (line(True, 0.0), "line 2: light: got True"),
        ('{"light": 1}', "line 2: time_s: got None"),
        (f'{{"light": 1, "time_s": {10**400}}}', "line 2: time_s: got 1000"),
        ('{"light": 1, "time_s": NaN}', "line 2: time_s: got nan"),
        (line(1, 0.0, snr_db="loud"), "line 2: snr_db: got 'loud'"),
        (line(1, 0.0, snr_db=1e4), "line 2: snr_db: got 10000.0, allowed: -300 to 300"),
    ],
)
def test_refuses(bad: str, message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("{", "\\{")):
        merge_receptions([line(1, 0.0), bad])


def test_payloads_of_bytes_are_merged() -> None:
    """As of ``Payload.data``."""
    pairs = zip("abc", (b"x", b"y", b"x"), strict=True)
    seen = [{"light": 1, "time_s": 0.0, "receiver": name, "payload": payload} for name, payload in pairs]
    (merged,) = merge_receptions(seen)
    assert (merged["payload"], merged["agreement"]) == (b"x", pytest.approx(2 / 3))


def test_what_an_iterator_gives_is_checked_as_it_comes():
    with pytest.raises(ValueError, match="line 2: got 1, allowed: a JSON object"):
        merge_receptions(iter([{"light": 1, "time_s": 0.0}, 1]))
