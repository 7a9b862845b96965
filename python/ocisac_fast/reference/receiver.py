"""Receiver for exposures shorter than a chip, in plain NumPy: the stages of docs/receiver.md one after the other."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.receiver.blind import Received
from ocisac_fast.reference.light import linear_light, saturation_level

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Timing = dict[str, Any]

BLOCKS = 64  # groups of neighbouring columns that get a weight each
CLIPPED_SHARE = 0.01  # columns with more saturated rows than this are left out
THRESHOLDS = (0.5, 0.35, 0.2, 0.65)  # shares of an edge's height at which its position is read


class Sliced(NamedTuple):
    """Decisions with the levels and soft values they were taken by, one a chip."""

    bits: BoolArray
    bright: FloatArray
    dark: FloatArray
    soft: FloatArray


class Lattice(NamedTuple):
    """Rows a chip, row at which chip 0 begins, standard error of the rows a chip."""

    period: float
    phase: float
    error: float


def moving_mean(signal: FloatArray, reach: int) -> FloatArray:
    """Mean over rows n - reach ... n + reach, as many of them as there are; along the last axis."""
    rows = signal.shape[-1]
    total = np.concatenate([np.zeros((*signal.shape[:-1], 1)), np.cumsum(signal, axis=-1)], axis=-1)
    low, high = np.maximum(np.arange(rows) - reach, 0), np.minimum(np.arange(rows) + reach + 1, rows)
    return np.asarray((total[..., high] - total[..., low]) / (high - low))


def common_factor(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Loadings a and own variances v of the one-factor model C = a aT + diag(v), by principal-factor iteration."""
    power = np.diag(covariance).copy()
    floor = np.maximum(0.01 * power.max(), 1e-12)
    own = 0.5 * power
    loadings = np.ones(len(power))
    for _ in range(8):
        matrix = covariance - np.diag(own)
        for _ in range(8):
            product = matrix @ loadings
            length = np.linalg.norm(product)
            if length == 0:
                return np.zeros(len(power)), np.maximum(power, floor)
            loadings = product / length
        loadings = loadings * np.sqrt(max(float(loadings @ matrix @ loadings), 0.0))
        own = np.maximum(power - loadings**2, floor)
        if not loadings.any():
            break
    return loadings * (1 if loadings.sum() >= 0 else -1), own


def combine(light: FloatArray, usable: BoolArray) -> tuple[FloatArray, FloatArray, float, float]:
    """Columns -> one signal, weights that maximise its signal-to-noise ratio, noise of the signal."""
    rows, columns = light.shape
    groups = min(BLOCKS, columns)
    edges = [group * columns // groups for group in range(groups + 1)]
    kept = [np.flatnonzero(usable[a:b]) + a for a, b in pairwise(edges)]
    kept = [block for block in kept if len(block)]
    means = np.stack([light[:, block].mean(axis=1) for block in kept])
    swing = means - moving_mean(means, rows // 16 + 1)
    loadings, own = common_factor(swing @ swing.T / rows)
    weights = np.maximum(loadings, 0) / own
    if weights.sum() <= 0:
        weights = np.ones(len(kept))
    weights /= weights.sum()
    ratio = float(np.sum(loadings**2 / own))
    per_column = np.zeros(columns)
    for weight, block in zip(weights, kept, strict=True):
        per_column[block] = weight / len(block)
    if len(kept) == 1:
        return means[0], per_column, np.nan, float(np.mean(swing**2))
    return weights @ means, per_column, float(np.sqrt(np.sum(weights**2 * own))), ratio


def zigzag(signal: FloatArray, hysteresis: float) -> list[int]:
    """Rows of alternating minima and maxima, each at least `hysteresis` from the next."""
    pivots = [0]
    low = high = 0
    direction = 0
    for n, value in enumerate(signal):
        if value > signal[high]:
            high = n
        if value < signal[low]:
            low = n
        if direction >= 0 and signal[high] - value > hysteresis:
            pivots.append(high)
            direction, low, high = -1, n, n
        elif direction <= 0 and value - signal[low] > hysteresis:
            pivots.append(low)
            direction, low, high = 1, n, n
    pivots.append(high if direction > 0 else low)
    return [n for k, n in enumerate(pivots) if k == 0 or n != pivots[k - 1]]


def weighted_median(values: FloatArray) -> float:
    """Median in which a value counts as many times as it is large."""
    order = np.sort(values)
    total = np.cumsum(order)
    return float(order[np.searchsorted(total, 0.5 * total[-1])])


def prune(signal: FloatArray, pivots: list[int], share: float = 0.3, reach: int = 6) -> list[int]:
    """Leaves out the swings that are small beside those around them (noise and texture on a steady level)."""
    pivots = list(pivots)
    while len(pivots) > 2:
        swings = np.abs(np.diff(signal[pivots]))
        small = []
        for k, swing in enumerate(swings):
            around = swings[max(k - reach, 0) : k + reach + 1]
            least = min(swings[k - 1] if k > 0 else np.inf, swings[k + 1] if k + 1 < len(swings) else np.inf)
            at_end = k in (0, len(swings) - 1)  # of equal swings the inner one goes, which keeps the level
            if swing < share * weighted_median(around) and (swing < least if at_end else swing <= least):
                small.append(k)
        if not small:
            break
        gone: set[int] = set()
        for k in small:
            ends = {k, k + 1}
            if k == 0:
                ends = {0}
            elif k == len(swings) - 1:
                ends = {k + 1}
            if not ends & gone and k not in gone and k + 1 not in gone:
                gone |= ends
        pivots = [n for k, n in enumerate(pivots) if k not in gone]
    return pivots


def crossings(signal: FloatArray, pivots: list[int], share: float) -> tuple[FloatArray, BoolArray]:
    """Rows (fractional) at which each edge passes `share` of its height above dark, and whether it rises."""
    places, rising = [], []
    for a, b in pairwise(pivots):
        up = signal[b] > signal[a]
        level = signal[a] + (share if up else 1 - share) * (signal[b] - signal[a])
        above = signal[a : b + 1] > level
        if not up:
            above = ~above
        first = np.argmax(above)
        last = len(above) - 1 - np.argmax(~above[::-1]) + 1
        both = []
        for n in (a + first, a + last):
            before, after = signal[n - 1], signal[n]
            both.append(n - 1 + (level - before) / (after - before) if after != before else n - 0.5)
        places.append(0.5 * (both[0] + both[1]))
        rising.append(up)
    return np.array(places), np.array(rising, dtype=bool)


def reliable_edges(signal: FloatArray, pivots: list[int]) -> slice:
    """All edges but a low one at either end: a run that the frame's edge cuts may not show its level."""
    heights = np.abs(np.diff(signal[pivots]))
    low_first = len(heights) > 2 and heights[0] < 0.8 * heights[1]
    low_last = len(heights) > 2 and heights[-1] < 0.8 * heights[-2]
    return slice(1 if low_first else 0, len(heights) - (1 if low_last else 0))


def coherence(
    places: FloatArray, rising: BoolArray, frequencies: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Share of the edges that agree with a lattice at each frequency (cycles per row), and the duty's phase (cycles).

    Falling edges may lie up to a fifth of a chip off the lattice of the rising ones.
    """
    turns = np.exp(-2j * np.pi * ((frequencies[:, None] * places) % 1.0))
    up, down = turns[:, rising].sum(axis=1), turns[:, ~rising].sum(axis=1)
    duty = np.angle(down * np.conj(up)) / (2 * np.pi)
    duty = np.clip(duty, -0.2, 0.2)
    total = up + down * np.exp(-2j * np.pi * duty)
    return np.abs(total) / len(places), -duty, -np.angle(total) / (2 * np.pi)


def solve(chips: FloatArray, falling: BoolArray, places: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Least squares of places = phase + period chips + duty falling: values and their covariance's unit matrix."""
    columns = [np.ones(len(places)), chips]
    if falling.any() and not falling.all():
        columns.append(falling.astype(float))
    design = np.stack(columns, axis=1)
    normal = design.T @ design
    if np.linalg.matrix_rank(normal) < len(columns):
        return None
    inverse = np.linalg.inv(normal)
    values = inverse @ (design.T @ places)
    return np.append(values, 0.0)[:3], inverse


def fit_lattice(places: FloatArray, rising: BoolArray, frequency: float, duty: float, phase: float) -> Timing | None:
    """Chip lattice through the edges: period, phase, duty offset, residual, standard error, length of description."""
    falling = ~rising
    period, origin, offset = 1 / frequency, phase / frequency, duty / frequency
    used = np.ones(len(places), dtype=bool)
    error = np.nan
    for _ in range(4):
        chips = np.round((places - origin - offset * falling) / period)
        shift = chips[len(chips) // 2]  # near the middle: a well-conditioned fit
        solved = solve(chips[used] - shift, falling[used], places[used])
        if solved is None or solved[0][1] <= 0:
            return None
        (origin, period, offset), inverse = solved
        residual = places - origin - period * (chips - shift) - offset * falling
        origin -= period * shift
        spread = np.median(np.abs(residual)) * 1.4826 + 0.02
        used = np.abs(residual) <= 3 * spread
        freedom = max(int(used.sum()) - len(inverse), 1)
        error = float(np.sqrt(inverse[1, 1] * np.sum(residual[used] ** 2) / freedom))
    if abs(offset) > 0.3 * period:
        return None
    collisions = int(np.sum(np.diff(chips) <= 0))
    residual = np.sqrt(np.mean(residual**2))
    edges = len(places)
    cells = max((places[-1] - places[0]) / period, edges)
    share = edges / cells
    entropy = -(share * np.log(share) + (1 - share) * np.log(1 - share)) if share < 1 else 0.0
    cost = edges * np.log(max(residual, 0.05)) + cells * entropy + 4 * collisions
    cost += 8 * edges * (offset / period) ** 2  # of two thresholds, the one that is fair to both levels
    cost -= 0.3 * edges * np.log(period)  # of two lattices, the slower one
    if collisions > 0.1 * edges:
        return None
    return {
        "period": period,
        "phase": origin + 0.5 * offset,
        "duty": offset,
        "residual": float(residual),
        "error": error,
        "cost": float(cost),
    }


def find_lattice(places: FloatArray, rising: BoolArray, rows: int, lowest: float, highest: float) -> Timing | None:
    """The lattice (cycles per row in lowest ... highest) that describes the edges in the fewest words."""
    count = max(int(np.ceil((highest - lowest) * 2 * rows)), 8) + 1
    step = (highest - lowest) / (count - 1)
    frequencies = lowest + step * np.arange(count, dtype=np.float64)
    score, duty, phase = coherence(places, rising, frequencies)
    best = None
    padded = np.concatenate([[-1], score, [-1]])
    peaks = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:]))
    peaks = peaks[score[peaks] >= 0.6 * score.max()]
    peaks = peaks[np.argsort(-score[peaks], kind="stable")][:16]
    for peak in peaks:
        found = fit_lattice(places, rising, frequencies[peak], duty[peak], phase[peak])
        if found is None or not lowest * 0.99 <= 1 / found["period"] <= highest * 1.01:
            continue
        if best is None or found["cost"] < best["cost"]:
            best = found
    if best:
        certainty = (len(places) - 3) * np.log(best["period"] / (np.sqrt(12) * max(best["residual"], 0.02))) - np.log(
            count
        )
        best["certainty"] = float(certainty)
    return best


def time_chips(signal: FloatArray, noise: float, lowest: float, highest: float) -> tuple[Timing | None, int]:
    """The lattice of one signal, over thresholds and (for long chips) smoothing; and the edges it was found with."""
    rows = len(signal)
    ordered = np.sort(signal)
    span = ordered[rows - 1 - rows // 10] - ordered[rows // 10]
    if not np.isfinite(noise):
        second = np.sort(np.abs(signal[2:] - 2 * signal[1:-1] + signal[:-2])) if rows > 2 else np.zeros(1)
        noise = second[len(second) // 4] / (0.3186 * np.sqrt(6))
    edges = None
    for reach in (0, 2, 8):  # rows of smoothing: 1, 5, 17
        top = min(highest, 0.5 / (reach + 1) if reach else highest)
        if lowest >= top:
            break
        smooth = moving_mean(signal, reach)
        hysteresis = min(6 * noise / np.sqrt(2 * reach + 1), 0.08 * span)
        pivots = prune(smooth, zigzag(smooth, hysteresis))
        best, reliable = None, reliable_edges(smooth, pivots)
        edges = len(pivots) - 1 if edges is None else min(edges, len(pivots) - 1)
        for share in THRESHOLDS:
            places, rising = crossings(smooth, pivots, share)
            if len(places[reliable]) < 4:
                continue
            found = find_lattice(places[reliable], rising[reliable], rows, lowest, top)
            if found and (best is None or found["cost"] < best["cost"]):
                best = {**found, "places": places, "rising": rising}
        if best and best["residual"] <= 0.17 * best["period"] and best["certainty"] > 5.5:
            return best, edges
    return None, edges or 0


def chip_values(
    signal: FloatArray, period: float, phase: float, exposure: float | None
) -> tuple[FloatArray, FloatArray, int]:
    """Mean of each whole chip's middle, away from the ramps at its ends, and the middles' rows."""
    rows = len(signal)
    first = int(np.ceil((-0.5 - phase) / period - 1e-9))
    last = int(np.floor((rows - 0.5 - phase) / period + 1e-9))  # chips first ... last - 1 are whole
    centres = phase + (np.arange(first, last, dtype=np.float64) + 0.5) * period
    reach = period / 4 if exposure is None else 0.4 * max(period - exposure, 0)
    reach = max(reach, 0.5)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (signal[1:] + signal[:-1]))])

    def area(place: FloatArray) -> FloatArray:  # integral of the signal, straight between its rows
        place = np.clip(place, 0, rows - 1)
        n = np.minimum(place.astype(int), rows - 2)
        part = place - n
        return np.asarray(total[n] + part * (signal[n] + 0.5 * part * (signal[n + 1] - signal[n])))

    low, high = np.clip(centres - reach, 0, rows - 1), np.clip(centres + reach, 0, rows - 1)
    return (area(high) - area(low)) / (high - low), centres, first


def level(values: FloatArray, kind: BoolArray) -> FloatArray:
    """Level of the chips of one kind along the frame: a line through their neighbours, read at each of them."""
    reach = min(max(len(values) / 16, 2.0), 6.0)
    chips = np.flatnonzero(kind).astype(float)
    distance = chips[None, :] - chips[:, None]
    weight = 1 / (1 + (distance / reach) ** 2) ** 2
    if len(chips) > 1:
        np.fill_diagonal(weight, 0.0)  # a chip has no say in its own level, so a wrong one is found out
    seen = values[kind]
    total = weight.sum(axis=1)
    middle = (weight * distance).sum(axis=1) / total
    mean = (weight * seen).sum(axis=1) / total
    away = distance - middle[:, None]
    slope = (weight * away * (seen - mean[:, None])).sum(axis=1) / ((weight * away**2).sum(axis=1) + 0.25 * reach**2)
    return np.asarray(np.interp(np.arange(len(values)), chips, mean - slope * middle))


def slice_chips(values: FloatArray, bits: BoolArray) -> Sliced | None:
    """Decisions against a threshold half way between the two levels, which follow the chips along the frame."""
    for _ in range(4):
        if bits.all() or not bits.any():
            return None
        bright, dark = level(values, bits), level(values, ~bits)
        swing = np.maximum(bright - dark, 1e-3 * max(np.max(bright - dark), 1e-12))
        soft = (values - 0.5 * (bright + dark)) / (0.5 * swing)
        decided = soft > 0
        if (decided == bits).all():
            break
        bits = decided
    return Sliced(decided, bright, dark, soft)


def refine_lattice(signal: FloatArray, period: float, phase: float, first: int, sliced: Sliced) -> Lattice | None:
    """The lattice again, by least squares on the places where the signal passes half way between the two levels."""
    bits, bright, dark, _ = sliced
    found = []
    for k in np.flatnonzero(bits[1:] != bits[:-1]):
        middle = 0.25 * (bright[k] + dark[k] + bright[k + 1] + dark[k + 1])
        centre = phase + (first + k + 0.5) * period
        low, high = int(np.floor(centre)), int(np.ceil(centre + period))
        low, high = max(low, 0), min(high, len(signal) - 1)
        above = (signal[low : high + 1] > middle) == bits[k + 1]
        if above[0] or not above[-1]:
            continue
        inner = [low + np.argmax(above), low + len(above) - np.argmax(~above[::-1])]
        read = [n - 1 + (middle - signal[n - 1]) / (signal[n] - signal[n - 1]) for n in inner]
        found.append((0.5 * (read[0] + read[1]), first + k + 1, not bits[k + 1]))
    if len(found) < 4:
        return None
    places, chips, falls = np.array(found, dtype=np.float64).T
    falling = falls > 0
    used = np.ones(len(places), dtype=bool)
    for _ in range(2):
        middle = np.floor(chips.mean())
        solved = solve(chips[used] - middle, falling[used], places[used])
        if solved is None:
            return None
        (origin, width, offset), inverse = solved
        residual = places - origin - width * (chips - middle) - offset * falling
        freedom = max(int(used.sum()) - len(inverse), 1)
        error = np.sqrt(inverse[1, 1] * np.sum(residual[used] ** 2) / freedom)
        used = np.abs(residual) <= 3 * 1.4826 * np.median(np.abs(residual)) + 0.06
    return Lattice(width, origin - width * middle + 0.5 * offset, float(error))


def decode(signal: FloatArray, timing: Timing, exposure: float | None) -> tuple[Lattice, int, Sliced] | None:
    """Decisions on the edges' lattice, the lattice again from the levels they show, and decisions on that."""
    lattice = Lattice(timing["period"], timing["phase"], timing["error"])
    values, centres, first = chip_values(signal, lattice.period, lattice.phase, exposure)
    before = np.searchsorted(timing["places"], centres)
    between_edges = np.where(before > 0, timing["rising"][np.maximum(before - 1, 0)], ~timing["rising"][0])
    sliced = slice_chips(values, between_edges)
    if sliced is None:
        return None
    refined = refine_lattice(signal, lattice.period, lattice.phase, first, sliced)
    if refined is None or abs(refined.period / lattice.period - 1) >= 0.02:
        return lattice, first, sliced
    values, _, new_first = chip_values(signal, refined.period, refined.phase, exposure)
    carried_over = sliced.bits[np.clip(new_first + np.arange(len(values)) - first, 0, len(sliced.bits) - 1)]
    again = slice_chips(values, carried_over)
    return (lattice, first, sliced) if again is None else (refined, new_first, again)


def slower_timing(timing: Timing, decoded: tuple[Lattice, int, Sliced], lowest: float) -> Timing | None:
    """The lattice of chips n times as long where every run is a whole multiple of n > 1 chips."""
    (period, phase, error), first, sliced = decoded
    edges = first + 1 + np.flatnonzero(np.diff(sliced.bits.astype(int)))
    if len(edges) < 12:
        return None
    shared = int(np.gcd.reduce(np.diff(edges)))
    if shared < 2 or shared * period * lowest > 1:
        return None
    slower = {"period": shared * period, "phase": phase + float(edges[0]) * period, "error": shared * error}
    return timing | slower


def receive(
    frames: npt.ArrayLike,
    camera: Camera,
    *,
    chip_rate: float | None = None,
    line_code: str = "none",
    colour: int | None = None,
) -> list[Received]:
    """Raw bits of a light in every frame: columns combined, chips timed blind, sliced at a threshold that follows them.

    The stages are the functions above; `docs/receiver.md` says why each is as it is. Arguments and results are those
    of :func:`ocisac_fast.receive`.
    """
    array = np.asarray(frames)
    if line_code != "none":
        raise ValueError(f"line_code: got {line_code!r}, allowed: 'none'")
    shapes = {1: (1, -1, 1, 1), 2: (1, *array.shape, 1), 3: (*array.shape, 1), 4: array.shape}
    stack = array.reshape(shapes[array.ndim])
    if chip_rate is None:
        bounds = max(1 / 64, 4 / stack.shape[1]), 0.5
    else:
        bounds = 0.97 * chip_rate * camera.row_time, min(1.03 * chip_rate * camera.row_time, 0.5)
    colours = list(range(stack.shape[3])) if colour is None else [colour]
    sure = 12 if chip_rate is None else 4  # with fewer edges the rate cannot be sure
    results = [receive_frame(frame, number, colours, camera, bounds, sure) for number, frame in enumerate(stack)]
    return [received for sources in results for received in sources]


def usable_columns(clipped: FloatArray, columns: BoolArray, use_saturated: bool) -> BoolArray:
    """Those of `columns` that saturate in few rows."""
    return np.asarray(columns & ((clipped <= max(CLIPPED_SHARE, 2 * clipped[columns].min())) | use_saturated))


def light_groups(light: FloatArray, usable: BoolArray) -> list[tuple[BoolArray, FloatArray]]:
    """Columns of each light where several stand side by side, the strongest first, and its swings; empty for one."""
    rows, columns = light.shape
    groups = min(BLOCKS, columns)
    edges = [group * columns // groups for group in range(groups + 1)]
    kept = [block for a, b in pairwise(edges) if len(block := np.flatnonzero(usable[a:b]) + a)]
    means = np.stack([light[:, block].mean(axis=1) for block in kept])
    swings = means - moving_mean(means, rows // 16 + 1)
    power = np.sum(swings**2, axis=1)
    unit = swings / np.sqrt(np.where(power > 0, power, 1))[:, None]
    cosines = unit @ unit.T
    seeds: list[int] = []
    while len(seeds) < 8:
        apart = np.all(np.abs(cosines[:, seeds]) < 0.3, axis=1) & (power > 0)
        partners = (cosines >= 0.6) & apart & apart[:, None] & ~np.eye(len(kept), dtype=bool)
        candidates = np.flatnonzero(partners.any(axis=1))
        if not len(candidates):
            break
        seeds.append(int(candidates[np.argmax(power[candidates])]))
    found = []
    for seed in seeds if len(seeds) > 1 else []:
        own = cosines[:, seed]
        members = np.flatnonzero((own >= 0.3) & np.all(cosines[:, seeds] <= own[:, None], axis=1))
        mask = np.zeros(columns, dtype=bool)
        for block in members:
            mask[kept[block]] = True
        found.append((mask, swings[members].sum(axis=0)))
    return found


def receive_frame(
    frame: npt.NDArray[Any], number: int, colours: list[int], camera: Camera, bounds: tuple[float, float], sure: int
) -> list[Received]:
    """All lights of one frame (rows, columns, colours), each from columns of its own where there are several."""
    everything = np.ones(frame.shape[1], dtype=bool)
    whole, signal = receive_source(frame, number, colours, camera, bounds, sure, everything)
    clipped = (frame[..., whole.colour] >= 0.98 * saturation_level(frame, camera)).mean(axis=0)
    usable = usable_columns(clipped, everything, use_saturated=False)
    sources: list[Received] = []
    for columns, swings in light_groups(linear_light(frame[..., whole.colour], camera), usable):
        seen = False
        if signal is not None and not whole.flags & ~Flag.SATURATED:
            own = signal - moving_mean(signal, len(signal) // 16 + 1)
            seen = bool(own @ swings >= 0.9 * np.linalg.norm(own) * np.linalg.norm(swings))
        source, decoded = receive_source(frame, number, colours, camera, bounds, sure, columns)
        if decoded is not None and not source.flags & ~Flag.SATURATED:
            sources.insert(0 if seen else len(sources), source)
        elif seen:
            sources.insert(0, whole)
    return [replace(source, source=k) for k, source in enumerate(sources)] or [whole]


def receive_source(
    frame: npt.NDArray[Any],
    number: int,
    colours: list[int],
    camera: Camera,
    bounds: tuple[float, float],
    sure: int,
    columns: BoolArray,
) -> tuple[Received, FloatArray | None]:
    """The light that stands out most in the columns, from the best colour that can be decoded; and its signal."""
    exposure = None if camera.exposure is None else camera.exposure / camera.row_time
    failed = []
    for use_saturated in (False, True):
        tries = []
        for colour in colours:
            clipped = (frame[..., colour] >= 0.98 * saturation_level(frame, camera)).mean(axis=0)
            usable = usable_columns(clipped, columns, use_saturated)
            signal, weights, noise, quality = combine(linear_light(frame[..., colour], camera), usable)
            saturated = bool(np.any((weights > 0) & (clipped > CLIPPED_SHARE)))
            tries.append((quality, colour, signal, weights, noise, saturated))
        for _, colour, signal, weights, noise, saturated in sorted(tries, key=lambda a: -a[0]):
            if use_saturated and not saturated:
                continue
            flags = Flag.SATURATED if saturated else Flag(0)
            timing, edges = time_chips(signal, noise, *bounds)
            flags |= Flag.TOO_FEW_EDGES if 0 < edges < sure else Flag(0)
            decoded = None if timing is None else decode(signal, timing, exposure)
            slower = None if timing is None or decoded is None else slower_timing(timing, decoded, bounds[0])
            if slower is not None:
                decoded = decode(signal, slower, exposure) or decoded
            if decoded is not None and signal_to_noise(decoded[2].soft) >= 2:
                return result(number, colour, decoded, weights, flags, camera, exposure), signal
            flags |= Flag(0) if 0 < edges < sure else Flag.NO_SIGNAL
            failed.append(received(number, colour, weights=weights, flags=flags))
    return failed[0], None


def signal_to_noise(soft: FloatArray) -> float:
    """(Half the swing)^2 over the variance about the levels."""
    return min(1 / max(float(np.mean((np.abs(soft) - 1) ** 2)), 1e-300), 1e12)


def result(
    number: int,
    colour: int,
    decoded: tuple[Lattice, int, Sliced],
    weights: FloatArray,
    flags: Flag,
    camera: Camera,
    exposure: float | None,
) -> Received:
    """What was decoded as the public result object."""
    (period, phase, error), first, (bits, bright, dark, soft) = decoded
    snr = signal_to_noise(soft)
    if snr < 9:
        flags |= Flag.WEAK
    if exposure is not None and exposure > 1.05 * period:
        flags |= Flag.LONG_EXPOSURE
    return received(
        number,
        colour,
        bits="".join("1" if bit else "0" for bit in bits),
        rows_per_chip=period,
        rows_per_chip_std=error,
        chip_rate=1 / (period * camera.row_time),
        chip_rate_std=error / (period**2 * camera.row_time),
        phase=phase + first * period,
        snr=snr,
        levels=np.stack([dark, bright]),
        soft=soft,
        weights=weights,
        flags=flags,
    )


def received(frame: int, colour: int, *, weights: FloatArray, **found: Any) -> Received:
    """The public result object; what was not found is empty or NaN."""
    numbers = ("rows_per_chip", "rows_per_chip_std", "chip_rate", "chip_rate_std", "phase", "snr")
    nothing: dict[str, Any] = {"bits": "", "levels": np.zeros((2, 0)), "soft": np.zeros(0)}
    nothing |= dict.fromkeys(numbers, np.nan)
    used = np.flatnonzero(weights)
    return Received(frame=frame, source=0, colour=colour, weights=weights, columns=used, **(nothing | found))
