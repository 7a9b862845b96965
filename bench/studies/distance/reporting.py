"""Tables of docs/measured/distance.md."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from ocisac_fast.chips import closest_pair_distance
from studies.distance import published
from studies.distance.links import LinkResult
from studies.distance.sweeps import Sweep
from studies.reporting import markdown

_LONG_EXPOSURES = ((7.0, 400_000), (14.0, 400_000))  # chips of exposure, chips counted
_Q = 1e-7  # Q(d/2 sigma) at which they are measured
_ONE_ROW_NOISE = 0.15


def table(sweep: Sweep, results: Sequence[LinkResult]) -> str:
    """Markdown table of a sweep."""
    known = "everything known"
    headings = (sweep.label, "rows on a lamp", "payloads", known, "chips read", "wrong", known)
    rows = [
        (
            f"{value:g}",
            f"{link.rows:.0f}",
            f"{counts.received} of {counts.packets}",
            f"{counts.bound} of {counts.packets}",
            f"{100 * counts.read / max(counts.chips, 1):.0f} %",
            _rate(counts.read_errors, counts.read),
            _rate(counts.bound_errors, counts.chips),
        )
        for value, link, counts in zip(sweep.values, sweep.links, results, strict=True)
    ]
    return markdown("rrrrrrr", headings, rows)


def _rate(wrong: int, chips: int) -> str:
    if not chips:
        return "–"
    return f"{wrong / chips:.1e}" if wrong else f"0 of {chips}"


def comparison() -> dict[str, str]:
    """Blocks ``correlation``, ``exposure``, ``lights`` and ``row``: what others published, measured here."""
    return {"correlation": _correlation(), "exposure": _exposure(), "lights": _lights(), "row": _row()}


def _correlation() -> str:
    random = np.random.default_rng(1)
    chips = tuple(int(chip) for chip in random.integers(0, 2, 4000))
    periodic = [s for n in range(2, 9) for s in itertools.product((0, 1), repeat=n) if 0 < sum(s) < n]
    of = published.correlation_after_exposure
    shares = tuple(published.MATUS)
    near = min(
        periodic,
        key=lambda s: max(
            abs(of(s, published.MATUS_CHIP, published.MATUS_EXPOSURE, c) - published.MATUS[c]) for c in shares
        ),
    )
    headings = ("clipped at, of the peak", "published", "random chips", f"chips {''.join(map(str, near))}")
    rows = []
    for share in shares:
        values = [of(s, published.MATUS_CHIP, published.MATUS_EXPOSURE, share) for s in (chips, near)]
        name = "not clipped" if share == 1.0 else f"{share:g}"
        rows.append((name, *(f"{value:.3f}" for value in (published.MATUS[share], *values))))
    return markdown("rrrr", headings, rows)


def _exposure() -> str:
    headings = ("exposure / chips", "noise / swing", "wrong chips", "error rate below (95 %)", "Q(d/2σ)")
    rows = []
    for exposure, chips in _LONG_EXPOSURES:
        noise = _noise_for(exposure)
        counted, predicted = published.long_exposure_errors(exposure, noise, chips)
        wrong, bound = f"{counted.wrong} of {counted.chips}", f"{counted.bound:.1e}"
        rows.append((f"{exposure:g}", f"{noise:.4f}", wrong, bound, f"{predicted:.1e}"))
    return markdown("rrrrr", headings, rows)


def _noise_for(exposure: float) -> float:
    """Noise at which Q(d/2 sigma) of the two closest sequences is ``_Q``."""
    return closest_pair_distance(4.0, 4.0 * exposure) / (-2.0 * NormalDist().inv_cdf(_Q))


def _lights() -> str:
    counts = [published.simultaneous_lights(published.RAJAGOPAL, seed=seed) for seed in range(4)]
    found, false = (sum(count[k] for count in counts) for k in (0, 1))
    lights = published.RAJAGOPAL
    return (
        f"{len(lights)} lights from {lights[0]:.0f} to {lights[-1]:.0f} Hz in one picture, four pictures with other "
        f"phases and noise: {found} of {4 * len(lights)} found, {false} false."
    )


def _row() -> str:
    result = published.one_row_symbol_errors(_ONE_ROW_NOISE)
    columns = zip(result.offsets[::2], result.detected[::2], result.three_taps[::2], strict=True)
    rows = [(f"{offset:.1f}", f"{detected:.1e}", f"{taps:.1e}") for offset, detected, taps in columns]
    return markdown("rrr", ("offset / rows", "maximum likelihood", "three zero-forcing taps"), rows)
