"""Detection of modulated lights in plain NumPy: screening of tiles, box by demodulation, frequency by the periodogram.

Windows are convolved and spectra summed directly, where the C++ core has running sums and Newton steps."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ocisac_fast.camera.camera import Camera
from ocisac_fast.core.flags import Flag
from ocisac_fast.lights.sources import LightSource
from ocisac_fast.reference.data_light import FREQUENCY_REACH, DataLight, find_data_light
from ocisac_fast.reference.gain import tone_gain
from ocisac_fast.reference.source_merging import one_light_across, one_light_down, runs_beside

Array = npt.NDArray[Any]
Box = tuple[int, int, int, int]  # column, row, width, height

WINDOW, HOP, GROUPS, WIDEST, WIDE = 32, 16, 3, 8, 8
CYCLES = np.concatenate([np.arange(2.5, 8.0, 0.5), np.arange(8.0, 15.0)])
MIN_SHARE, MIN_POWER = 0.4, 1e-6
MAX_GROUPS, BOX_EDGE, ALIGNMENT, REACH, ROUNDS, HARMONICS, JACKKNIFE = 64, 0.15, 0.5, 0.12, 2, 3, 16
MAX_SUSPECTS, MIN_ROWS, MIN_PERIODIC, MAX_TEXTURE, MAX_UNEVEN, DATA_PERIODIC, LARGEST_SPREAD = (
    256,
    24,
    0.4,
    0.8,
    0.25,
    0.7,
    0.05,
)
FAINT_LEVEL, REFLECTION_LEVEL, ONE_FREQUENCY = 0.1, 0.5, 0.04
SETTLED_CYCLES, SETTLED_PERIODIC, DATA_TEXTURE = 5, 0.95, 0.3


class Suspect(NamedTuple):
    box: Box
    frequency: float
    evidence: float


class Light(NamedTuple):
    box: Box
    frequency: float
    std: float
    phase: float
    snr: float
    amplitude: float
    periodic: float
    texture: float
    uneven: float


class Found(NamedTuple):
    light: Light  # the strongest part
    box: Box  # of all parts
    merged: int = 0
    joined: bool = False
    data: bool = False


def detect_sources(
    frames: npt.ArrayLike,
    camera: Camera,
    *,
    false_alarms: float = 0.02,
    min_cycles: float = 3.0,
    max_sources: int = 64,
) -> list[LightSource]:
    """Lights of every frame: tiles whose columns swing together at one frequency, refined one by one."""
    pixels = np.asarray(frames)
    sources = []
    for index, frame in enumerate(pixels.reshape(-1, *pixels.shape[-2:]) if pixels.ndim > 1 else pixels[None, :, None]):
        lights = _lights(frame, camera, false_alarms, min_cycles)[:max_sources]
        sources += _sources(frame, camera, index, _joined(frame, camera, lights))
    return sources


def _lights(frame: Array, camera: Camera, false_alarms: float, min_cycles: float) -> list[Found]:
    """Lights that hold, the strongest first, each with the number of doubles merged into it."""
    light = frame.astype(float) - camera.dark_level
    whole = frame.dtype.kind == "u"
    floor = _floor(frame, light, camera)
    suspects = screen(light, floor, 0.5 if whole else 0.0, false_alarms)[:MAX_SUSPECTS]
    rare = -1.6 * math.log(false_alarms) - min(math.log(false_alarms / 0.02), 0.0)
    min_evidence = math.log(max(len(suspects), 1)) + rare - 1.1
    min_amplitude = 1.0 if whole else 0.0
    lights: list[Found] = []
    for suspect in suspects:
        if any(_explained(suspect.box, other.light) for other in lights):
            continue
        found = refine(light, suspect, floor, min_cycles, min_amplitude)
        if found is None:
            continue
        least = (min_evidence, min_cycles, min_amplitude)
        if _accepted(found, *least):
            lights += [Found(one, one.box) for one in _lamps(light, floor, found, least)]
    min_evidence = math.log(max(len(suspects), 1)) - 1.2 * math.log(false_alarms) + 3
    lights = _with_data(light, floor, suspects, lights, (min_evidence, min_cycles, min_amplitude))
    kept: list[Found] = []
    for one in sorted(lights, key=lambda a: -a.light.amplitude * math.sqrt(a.light.box[2] * a.light.box[3])):
        for k, other in enumerate(kept):
            if _share(one.box, other.box) > 0.5:
                kept[k] = other._replace(merged=other.merged + 1)
                break
        else:
            kept.append(one)
    return kept


def _with_data(
    light: Array, floor: float, suspects: list[Suspect], lights: list[Found], least: tuple[float, float, float]
) -> list[Found]:
    """What no tone explains may send data; its periodic parts are merged into it."""
    tones: list[Light] = []
    for suspect in suspects:
        known = [one.light for one in lights if _settled(one)] + tones
        if any(_explained(suspect.box, one) or _holds(suspect, one) for one in known):
            continue
        data = find_data_light(light, floor, suspect.box, suspect.frequency)
        if data is None or not _accepted_data(data, *least):
            continue
        lower, upper = suspect.frequency * (1 - FREQUENCY_REACH), min(suspect.frequency * (1 + FREQUENCY_REACH), 0.499)
        frequency = _peak(data.waveform, lower, upper)
        std = _jackknife(data.waveform, frequency, data.box[3] * frequency, lower, upper)
        rows = data.box[1] + np.arange(data.waveform.size)
        phase = float(np.angle(np.sum(data.waveform * np.exp(-2j * np.pi * frequency * rows))))
        one = Light(data.box, frequency, std, phase, data.snr, data.amplitude, 0.0, data.texture, 0.0)
        clean = [other.light.box for other in lights if not other.data and other.light.periodic >= DATA_PERIODIC]
        if 2 * sum(_rows_in(box, data.box) for box in clean) > data.box[3]:
            tones.append(one)
            continue
        rest = [other for other in lights if _share(other.light.box, data.box) <= 0.5]
        lights = [*rest, Found(one, data.box, merged=len(lights) - len(rest), data=True)]
    return lights


def _accepted(found: Light, min_evidence: float, min_cycles: float, min_amplitude: float) -> bool:
    cycles = found.box[3] * found.frequency
    return (
        found.box[3] >= MIN_ROWS
        and cycles >= min_cycles
        and found.amplitude >= min_amplitude
        and math.log1p(found.snr) * cycles >= min_evidence
        and found.texture <= MAX_TEXTURE * min(1.0, found.box[2] / 24)
        and not (found.texture > 0.25 and found.uneven > MAX_UNEVEN)
        and found.periodic >= MIN_PERIODIC
        and found.std <= LARGEST_SPREAD * found.frequency
    )


def _lamps(light: Array, floor: float, found: Light, least: tuple[float, float, float]) -> list[Light]:
    """The light, or lamps that touch and were found as one, each in its own columns."""
    lamps = []
    for left, right, swing in runs_beside(light, floor, found.box, found.frequency):
        frequency = _peak(swing, 0.5 * found.frequency, min(2 * found.frequency, 0.499))
        suspect = Suspect((0, found.box[1], right - left, found.box[3]), frequency, 0.0)
        lamp = refine(light[:, left:right], suspect, floor, least[1], least[2])
        if lamp is not None and _accepted(lamp, *least):
            x, y, width, height = lamp.box
            lamps.append(lamp._replace(box=(x + left, y, width, height)))
    return lamps if len(lamps) > 1 else [found]


def _accepted_data(data: DataLight, min_evidence: float, min_cycles: float, min_amplitude: float) -> bool:
    return (
        data.box[3] >= MIN_ROWS
        and data.edges / 2 >= min_cycles
        and data.amplitude >= min_amplitude
        and data.evidence >= min_evidence
        and data.snr >= 1
        and data.texture <= DATA_TEXTURE * MAX_TEXTURE * min(1.0, data.box[2] / 24)
    )


def _settled(one: Found) -> bool:
    """No part of a light that sends data: its chips alternate for fewer cycles."""
    light = one.light
    cycles = light.box[3] * light.frequency
    return (
        one.data or light.periodic >= SETTLED_PERIODIC or (light.periodic >= DATA_PERIODIC and cycles >= SETTLED_CYCLES)
    )


def _holds(suspect: Suspect, light: Light) -> bool:
    """A coarse suspect around a light of its frequency."""
    area = light.box[2] * light.box[3]
    near = abs(suspect.frequency - light.frequency) <= 0.25 * light.frequency
    return 2 * _overlap(suspect.box, light.box) > area and near


def _rows_in(box: Box, other: Box) -> int:
    """Rows in common of boxes that have columns in common."""
    beside = min(box[0] + box[2], other[0] + other[2]) <= max(box[0], other[0])
    return 0 if beside else max(min(box[1] + box[3], other[1] + other[3]) - max(box[1], other[1]), 0)


def _share(a: Box, b: Box) -> float:
    """Overlap over the smaller one."""
    return _overlap(a, b) / min(a[2] * a[3], b[2] * b[3])


def _floor(frame: Array, light: Array, camera: Camera) -> float:
    white = camera.white_level or (np.iinfo(frame.dtype).max if frame.dtype.kind == "u" else None)
    if white:
        return (white - camera.dark_level) / 64
    return float(light.max()) / 64 if light.max() > 0 else 1.0


def _joined(frame: Array, camera: Camera, found: list[Found]) -> list[Found]:
    """Parts of one light become one, the strongest first, again with what has been joined so far."""
    light = frame.astype(float) - camera.dark_level
    floor = _floor(frame, light, camera)
    rest, done = list(found), []
    while rest:
        first, *others = rest
        beside = down = False
        for one in others:
            parts = ((first.box, first.light.frequency), (one.box, one.light.frequency))
            beside = one_light_across(light, floor, *parts)
            down = not beside and one_light_down(light, floor, *parts)
            if beside or down:
                break
        else:
            done.append(first)
            rest = others
            continue
        other = others.pop(others.index(one))
        f, g = first.light.frequency, other.light.frequency
        x, y = min(first.box[0], other.box[0]), min(first.box[1], other.box[1])
        right, bottom = (max(first.box[i] + first.box[i + 2], other.box[i] + other.box[i + 2]) for i in (0, 1))
        data = first.data or other.data or down or abs(f - g) > ONE_FREQUENCY * max(f, g)
        merged = first.merged + other.merged + 1
        rest = [Found(first.light, (x, y, right - x, bottom - y), merged, True, data), *others]
    return done


def _overlap(a: Box, b: Box) -> int:
    """Area in common."""
    width = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    height = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    return max(width, 0) * max(height, 0)


def _widened(box: Box, by: int) -> Box:
    left, up = min(box[0], by), min(box[1], by)
    return box[0] - left, box[1] - up, box[2] + left + by, box[3] + up + by


def _explained(suspect: Box, light: Light) -> bool:
    return 2 * _overlap(suspect, _widened(light.box, _rounded(1 / light.frequency))) > suspect[2] * suspect[3]


def _rounded(x: float) -> int:
    return math.floor(x + 0.5)


def screen(light: Array, floor: float, min_swing: float, false_alarms: float) -> list[Suspect]:
    """Places where tiles hold a tone common to their columns, the one with the most evidence first."""
    group = min(max(light.shape[1] // (2 * GROUPS), 1), WIDEST)
    finest = _means(light, 1, group)
    scales = []
    step = 1
    while True:
        if finest.shape[1] >= GROUPS * WIDE:
            scales.append((_means(finest, 1, WIDE), step, group * WIDE))
        scales.append((finest, step, group))
        if finest.shape[0] // 2 < WINDOW:
            break
        across = 2 if finest.shape[1] > 1 else 1
        finest, step, group = _means(finest, 2, across), 2 * step, group * across
    tiles = sum(_windows(scale.shape[0]) * scale.shape[1] for scale, _, _ in scales)
    found = []
    for scale, row_step, column_step in scales:
        groups = min(GROUPS, scale.shape[1])
        half_freedom = (groups * (WINDOW - 2) - 2) / 2
        chance = min(false_alarms / (max(tiles, 1) * CYCLES.size), 1.0)
        threshold = max(MIN_SHARE, 1 - chance ** (1 / half_freedom))
        shares, waves = _tiles(np.log(np.maximum(scale, 0) + floor), groups, threshold, min_swing)
        found += _suspects(shares, waves, groups, row_step, column_step)
    return sorted(found, key=lambda s: -s.evidence)


def _means(x: Array, rows: int, columns: int) -> Array:
    height, width = x.shape[0] // rows, x.shape[1] // columns
    cut: Array = x[: height * rows, : width * columns].reshape(height, rows, width, columns)
    return np.asarray(cut.mean(axis=(1, 3)))


def _windows(rows: int) -> int:
    return 0 if rows < WINDOW else (rows - WINDOW) // HOP + 1


def _tiles(logs: Array, groups: int, threshold: float, min_swing: float) -> tuple[Array, Array]:
    """Share of the best common tone, and its index in CYCLES, (windows, groups of columns); 0 below the threshold."""
    across = logs.shape[1] - groups + 1
    shares, waves = np.zeros((_windows(logs.shape[0]), across)), np.zeros((_windows(logs.shape[0]), across), int)
    n = np.arange(WINDOW)
    trend = np.stack([np.ones(WINDOW), n - n.mean()]) / np.sqrt([[WINDOW], [np.sum((n - n.mean()) ** 2)]])
    carriers = np.exp(-2j * np.pi * np.outer(CYCLES, n) / WINDOW)
    for w in range(shares.shape[0]):
        x = logs[w * HOP : w * HOP + WINDOW]
        mean = sum(x[:, k : k + across].mean(axis=0) for k in range(groups)) / groups
        x = x - trend.T @ (trend @ x)
        energy = sum((x**2).sum(axis=0)[k : k + across] for k in range(groups))
        tones = 2 / WINDOW * np.abs(carriers @ sum(x[:, k : k + across] for k in range(groups))) ** 2
        lit = energy > np.maximum(MIN_POWER, 0.5 * (min_swing * np.exp(-mean)) ** 2) * WINDOW * groups
        best = np.where(lit, tones.max(axis=0) / np.where(lit, groups * energy, 1.0), 0.0)
        shares[w] = np.where(best >= threshold, np.minimum(best, 0.9999), 0.0)
        waves[w] = tones.argmax(axis=0)
    return shares, waves


def _suspects(shares: Array, waves: Array, groups: int, row_step: int, column_step: int) -> list[Suspect]:
    """Tiles that touch and agree in frequency to a cycle in their window."""
    found = []
    seen = shares == 0
    for start in zip(*np.nonzero(~seen), strict=True):
        if seen[start]:
            continue
        seen[start] = True
        members, at = [start], 0
        while at < len(members):
            w, g = members[at]
            at += 1
            for v in range(max(w - 1, 0), min(w + 2, shares.shape[0])):
                for h in range(max(g - 1, 0), min(g + 2, shares.shape[1])):
                    if not seen[v, h] and abs(CYCLES[waves[v, h]] - CYCLES[waves[w, g]]) <= 1:
                        seen[v, h] = True
                        members.append((v, h))
        index = tuple(np.array(members).T)
        top, left = (int(i.min()) for i in index)
        bottom, right = (int(i.max()) for i in index)
        best = waves[index][shares[index].argmax()]
        box = (
            left * column_step,
            top * HOP * row_step,
            (right - left + groups) * column_step,
            ((bottom - top) * HOP + WINDOW) * row_step,
        )
        found.append(Suspect(box, CYCLES[best] / (WINDOW * row_step), float(-np.log1p(-shares[index]).sum())))
    return found


def refine(light: Array, suspect: Suspect, floor: float, min_cycles: float, min_amplitude: float) -> Light | None:
    """Box and frequency in turn, three times; None where there is no such light."""
    box, frequency = suspect.box, suspect.frequency
    for _ in range(ROUNDS):
        margin = _hann_length(frequency) + 2
        rows, columns = light.shape
        left, right = max(box[0] - margin, 0), min(box[0] + box[2] + margin, columns)
        top, bottom = max(box[1] - margin, 0), min(box[1] + box[3] + margin, rows)
        group = max(-(-(right - left) // MAX_GROUPS), min(max(box[2] // 16, 1), 8))
        patch = _means(light[top:bottom, left:right], 1, min(group, right - left))
        lit = _lit_box(patch, frequency, box, (left, top, group))
        if lit is None or 2 * lit[1] < 0.7 * min_amplitude:
            return None
        if lit[0][3] < 0.7 * max(MIN_ROWS, min_cycles / frequency):
            return None
        box, amplitude = lit
        matched, weight, common, energy, noise, uneven = _profile(
            np.log(np.maximum(patch, 0) + floor), frequency, box, (left, top, group)
        )
        lower, upper = frequency * (1 - REACH), min(frequency * (1 + REACH), 0.499)
        frequency = _peak(matched, lower, upper)
        if not lower < frequency < upper:
            return None
    periodic = _periodic_share(matched, weight, frequency)
    explained = common * periodic
    phase = np.angle(np.sum(matched * np.exp(-2j * np.pi * frequency * (top + np.arange(matched.size)))))
    std = _jackknife(matched, frequency, box[3] * frequency, lower, upper)
    box = (box[0], box[1], min(box[2], light.shape[1] - box[0]), box[3])
    snr = explained / max(1 - explained, 1e-12)
    texture = max(energy * (1 - explained) - noise, 0.0) / max(energy * explained, 1e-300)
    return Light(box, frequency, std, float(phase), snr, 2 * amplitude, periodic, texture, uneven)


def _hann_length(frequency: float) -> int:
    return 2 * _rounded(1 / frequency) + 1


def _demodulated(x: Array, frequency: float, length: int) -> Array:
    """Local mean of x e^{-j 2 pi f n} under a Hann window of two cycles, along the rows."""
    reach = length // 2
    offsets = np.arange(-reach, reach + 1)
    window = (1 + np.cos(2 * np.pi * offsets / length)) / length
    padded = np.pad(x, ((reach, reach), (0, 0)), mode="edge")
    carried = padded * np.exp(-2j * np.pi * frequency * np.arange(-reach, x.shape[0] + reach))[:, None]
    return np.stack([np.convolve(column, window, "valid") for column in carried.T], axis=1)


def _inside(shape: tuple[int, ...], box: Box, place: tuple[int, int, int]) -> Array:
    """Mask of a patch's elements in a box; place: first column, first row, columns in a group."""
    left, top, group = place
    starts = left + group * np.arange(shape[1])
    across = (starts + group > box[0]) & (starts < box[0] + box[2])
    down = top + np.arange(shape[0])
    return np.asarray(((down >= box[1]) & (down < box[1] + box[3]))[:, None] & across)


def _lit_box(patch: Array, frequency: float, box: Box, place: tuple[int, int, int]) -> tuple[Box, float] | None:
    """Box of the connected part with the most swing in phase that reaches into the suspect's box; its amplitude."""
    swing = _demodulated(patch - patch.mean(axis=0), frequency, _hann_length(frequency))
    where = _inside(patch.shape, box, place)
    if not where.any():
        return None
    total = (np.abs(swing) * swing)[where].sum()
    sizes = np.sort(np.abs(swing)[where])
    largest = sizes[(sizes.size - 1) * 98 // 100]
    if largest <= 0 or total == 0:
        return None
    aligned = (swing * np.conj(total / abs(total))).real
    free = aligned > np.maximum(ALIGNMENT * np.abs(swing), BOX_EDGE * largest)
    best, best_part = 0.0, None
    for start in zip(*np.nonzero(where & free), strict=True):
        if not free[start]:
            continue
        free[start] = False
        members, at = [start], 0
        while at < len(members):
            n, g = members[at]
            at += 1
            for m in range(max(n - 1, 0), min(n + 2, patch.shape[0])):
                for h in range(max(g - 1, 0), min(g + 2, patch.shape[1])):
                    if free[m, h]:
                        free[m, h] = False
                        members.append((m, h))
        part = tuple(np.array(members).T)
        if aligned[part].sum() > best:
            best, best_part = float(aligned[part].sum()), part
    if best_part is None:
        return None
    down, across = best_part
    left, top, group = place
    width, height = (int(across.max() - across.min()) + 1) * group, int(down.max() - down.min()) + 1
    return (left + int(across.min()) * group, top + int(down.min()), width, height), float(largest)


def _profile(
    logs: Array, frequency: float, box: Box, place: tuple[int, int, int]
) -> tuple[Array, Array, float, float, float, float]:
    """Log swing weighted with its local amplitude and added over the columns, squared weights; in the box: the share in
    common, all energy, that of noise, and the depth at the frequency of the rows' variance across the columns."""
    length = _hann_length(frequency)
    swing = _demodulated(logs - logs.mean(axis=0), frequency, length)
    fast = logs - _demodulated(logs, 0.0, length).real
    core = _inside(logs.shape, box, place)
    wide = _inside(logs.shape, _widened(box, 2 * _rounded(1 / frequency)), place)
    total = swing[core].sum()
    weight = np.maximum((swing * np.conj(total / abs(total) if total != 0 else 1.0)).real, 0)
    sums, weights = (weight * fast * core).sum(axis=1), (weight**2 * core).sum(axis=1)
    energy = (fast**2 * core).sum()
    lit = weights > 0
    common = min((sums[lit] ** 2 / weights[lit]).sum() / energy, 1.0) if energy > 0 else 0.0
    mixed = np.abs(logs[:-1, :-1] - logs[1:, :-1] - logs[:-1, 1:] + logs[1:, 1:])[core[:-1, :-1]]
    middle = np.sort(mixed)[mixed.size // 2] if mixed.size else 0.0
    noise = core.sum() * middle**2 / (4 * 0.6745**2)
    matched, squares = (weight * fast * wide).sum(axis=1), (weight**2 * wide).sum(axis=1)
    count = np.maximum(core.sum(axis=1), 1)
    variance = np.maximum((fast**2 * core).sum(axis=1) - (fast * core).sum(axis=1) ** 2 / count, 0)
    tone = np.sum(variance * np.exp(-2j * np.pi * frequency * np.arange(variance.size)))
    uneven = abs(tone) / variance.sum() if variance.sum() > 0 else 0.0
    return matched, squares, float(common), float(energy), float(noise), float(uneven)


def _energy(x: Array, frequencies: Array, harmonics: int) -> Array:
    n = np.arange(x.size) - x.size / 2
    orders = [h for h in range(1, harmonics + 1) if h == 1 or h * frequencies.max() < 0.5]
    sums = [np.exp(-2j * np.pi * h * np.outer(frequencies, n)) @ x for h in orders]
    return np.asarray((np.abs(sums) ** 2).sum(axis=0))


def _climbed(x: Array, frequency: float, lower: float, upper: float) -> float:
    """The maximum of the energy of all harmonics nearest to a frequency, by ever finer grids."""
    span = 0.125 / x.size
    while span > 1e-12:
        grid = np.clip(frequency + span * np.linspace(-1, 1, 21), lower, upper)
        energy = _energy(x, grid, HARMONICS)
        best = int(energy.argmax())
        frequency = float(grid[best])
        if 0 < best < 20:
            span /= 8
        elif frequency in (lower, upper):
            break
    return frequency


def _peak(x: Array, lower: float, upper: float) -> float:
    grid = np.minimum(np.arange(lower, upper + 0.125 / x.size, 0.125 / x.size), upper)
    return _climbed(x, float(grid[_energy(x, grid, 1).argmax()]), lower, upper)


def _jackknife(x: Array, frequency: float, cycles: float, lower: float, upper: float) -> float:
    """Standard error from the frequencies with one group of cycles after the other left out."""
    lit = np.nonzero(x)[0]
    first, last = (int(lit[0]), int(lit[-1]) + 1) if lit.size else (0, 0)
    count = min(max(int(cycles), 2), JACKKNIFE)
    found = []
    for k in range(count):
        rest = x.copy()
        rest[first + k * (last - first) // count : first + (k + 1) * (last - first) // count] = 0
        found.append(_climbed(rest, frequency, lower, upper))
    return math.sqrt((count - 1) / count * float(np.sum((np.array(found) - np.mean(found)) ** 2)))


def _periodic_share(matched: Array, weight: Array, frequency: float) -> float:
    lit = weight > 0
    total = float(np.sum(matched[lit] ** 2 / weight[lit]))
    orders = np.arange(1, min(int(0.499 / frequency), 9) + 1)
    sums = np.exp(-2j * np.pi * frequency * np.outer(orders, np.arange(matched.size))) @ matched
    return min(float(2 * np.sum(np.abs(sums) ** 2) / weight.sum()) / total, 1.0) if total > 0 else 0.0


def _same_frequency(weak: Light, strong: Light) -> bool:
    spread = 3 * math.hypot(weak.std, strong.std) + 0.002 * strong.frequency
    least = 0.03 * strong.frequency if weak.amplitude < FAINT_LEVEL * strong.amplitude else 0.0
    return abs(weak.frequency - strong.frequency) <= min(max(spread, least), 0.05 * strong.frequency)


def _reflection(lights: list[Light], i: int, reflections: dict[int, tuple[int, str]]) -> tuple[int, str] | None:
    """Index of the stronger light that a light repeats at the same time, and what tells it."""
    weak = lights[i]
    for k, strong in enumerate(lights[:i]):
        flux = [light.amplitude * light.box[2] * light.box[3] for light in (weak, strong)]
        if k in reflections or not _same_frequency(weak, strong) or flux[0] > REFLECTION_LEVEL * flux[1]:
            continue
        middle = weak.box[1] + weak.box[3] / 2
        between = middle - strong.box[1] - strong.box[3] / 2
        spread = 2 * math.pi * abs(between) * strong.std + 0.3
        apart = weak.phase - strong.phase + 2 * math.pi * middle * (weak.frequency - strong.frequency)
        if spread < 1 and abs(math.remainder(apart, 2 * math.pi)) > 3 * spread:
            continue
        return k, "frequency and phase" if spread < 1 else "frequency"
    return None


def _sources(frame: Array, camera: Camera, index: int, found: list[Found]) -> list[LightSource]:
    lights = [one.light for one in found]
    reflections: dict[int, tuple[int, str]] = {}
    sources = []
    for i, one in enumerate(found):
        light = one.light
        reflection = _reflection(lights, i, reflections)
        if reflection is not None:
            reflections[i] = reflection
        x, y, width, height = light.box
        frequency = light.frequency / camera.row_time
        gain = tone_gain(frame[y : y + height, x : x + width], camera, frequency, pooled=True)
        phase = math.remainder(float(gain.phase) - 2 * math.pi * math.fmod(light.frequency * y, 1.0), 2 * math.pi)
        sources.append(
            LightSource(
                frame=index,
                x=one.box[0],
                y=one.box[1],
                width=one.box[2],
                height=one.box[3],
                frequency=frequency,
                frequency_std=light.std / camera.row_time,
                gain=float(gain.gain),
                gain_std=float(gain.gain_std),
                phase=phase,
                mean=float(gain.mean),
                snr=light.snr,
                amplitude=light.amplitude,
                periodic=light.periodic,
                carries_data=one.data or light.periodic < DATA_PERIODIC,
                reflection_of=None if reflection is None else reflection[0],
                reason=reflection[1] if reflection else "waveform" if one.joined else "overlap" if one.merged else "",
                merged=one.merged,
                flags=Flag(int(gain.flags)),
            )
        )
    return sources
