"""Merging of the results of several receivers into one line per light and time."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

from ocisac_fast.core.checks import NotNegative, checked, parsed_json, shown


@checked
def merge_receptions(lines: Iterable[str | Mapping[str, Any]], *, window: NotNegative = 0.05) -> list[dict[str, Any]]:
    """Merge the results of several receivers by light and time.

    A line is a JSON object with ``light`` (its ID, a string or a whole number) and ``time_s``; it may have
    ``receiver`` (a name), ``payload`` and ``snr_db``. Lines of one light within ``window`` of the first of them form a
    group; a second line of the same receiver begins the next group.

    Args:
        lines: JSON texts or mappings, in any order; blank texts are skipped.
        window: s, finite, 0 or above.

    Returns:
        One object per group, sorted by time, then by light: ``light``; ``time_s``, the mean weighted by the
        signal-to-noise ratios (power; 1 where none is given); ``receivers``, their names or None; ``payload``, the one
        of the largest weight, and ``agreement``, its share of the weight of all payloads (None without payloads);
        ``snr_db`` of all together (None without any).

    Raises:
        ValueError: a line that is no JSON object, lacks ``light`` or ``time_s``, or has an invalid value.
    """
    records = [_read(line, k) for k, line in enumerate(lines, 1) if not isinstance(line, str) or line.strip()]
    moments: list[list[dict[str, Any]]] = []
    open_moments: dict[tuple[str, Any], list[dict[str, Any]]] = {}
    for record in sorted(records, key=lambda r: (float(r["time_s"]), str(r["light"]))):
        key = (type(record["light"]).__name__, record["light"])
        moment = open_moments.get(key)
        seen_by = [other["receiver"] for other in moment or () if other.get("receiver") is not None]
        if moment is None or record["time_s"] - moment[0]["time_s"] > window or record.get("receiver") in seen_by:
            moment = open_moments[key] = []
            moments.append(moment)
        moment.append(record)
    return [_merged(moment) for moment in moments]


def _read(line: str | Mapping[str, Any], number: int) -> dict[str, Any]:
    try:
        record = parsed_json(line) if isinstance(line, str) else dict(line)
    except (TypeError, ValueError) as error:
        raise ValueError(f"line {number}: got {shown(line)}, allowed: a JSON object") from error
    if not isinstance(record, dict):
        raise ValueError(f"line {number}: got {shown(line)}, allowed: a JSON object")
    light, time, snr = (record.get(name) for name in ("light", "time_s", "snr_db"))
    if isinstance(light, bool) or not isinstance(light, (str, int)):
        raise ValueError(f"line {number}: light: got {shown(light)}, allowed: a string or a whole number")
    for name, value in (("time_s", time), ("snr_db", 0.0 if snr is None else snr)):
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e300:
            raise ValueError(f"line {number}: {name}: got {shown(value)}, allowed: a finite number")
    if snr is not None and abs(snr) > 300.0:
        raise ValueError(f"line {number}: snr_db: got {shown(snr)}, allowed: -300 to 300")
    return record


def _merged(moment: list[dict[str, Any]]) -> dict[str, Any]:
    ratios = [None if r.get("snr_db") is None else 10.0 ** (r["snr_db"] / 10.0) for r in moment]
    weights = [1.0 if ratio is None else ratio for ratio in ratios]
    known = [ratio for ratio in ratios if ratio is not None]
    votes: dict[str, float] = {}
    texts: dict[str, Any] = {}
    for record, weight in zip(moment, weights, strict=True):
        if record.get("payload") is not None:
            key = json.dumps(record["payload"], sort_keys=True, default=repr)  # of bytes
            texts[key] = record["payload"]
            votes[key] = votes.get(key, 0.0) + weight
    best = max(votes, key=lambda key: votes[key]) if votes else None
    total = sum(weights)
    start = moment[0]["time_s"]
    shift = sum(w * (r["time_s"] - start) for w, r in zip(weights, moment, strict=True)) / total if total else 0.0
    return {
        "light": moment[0]["light"],
        "time_s": start + shift,
        "receivers": [record.get("receiver") for record in moment],
        "payload": None if best is None else texts[best],
        "agreement": None if best is None else votes[best] / sum(votes.values()),
        "snr_db": 10.0 * math.log10(sum(known)) if known else None,
    }
