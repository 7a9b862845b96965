"""Scenes by brute force: the voxel of every pixel, the light of every sub-exposure."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ocisac_fast.light.waveforms import Chips, Constant, Product, SquareWave, Tone, Waveform
from ocisac_fast.reference.light import integrate_exposure, sample_waveform
from ocisac_fast.scene import Cosine, Disc, Grating, Mask, Picture, Plain, Rectangle, Ring, Scene, Source, Surface

Array = npt.NDArray[np.float64]
_Item = Source | Surface | Mask


def _rotation(vector: tuple[float, float, float]) -> Array:
    """Rodrigues' formula, vector by vector."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    axis = np.array(vector) / angle
    turned = [
        np.cos(angle) * unit + np.sin(angle) * np.cross(axis, unit) + (1 - np.cos(angle)) * axis * (axis @ unit)
        for unit in np.eye(3)
    ]
    return np.array(turned).T


def _meet(item: _Item, eye: Array, rays: Array) -> tuple[Array, Array, Array, npt.NDArray[np.bool_]]:
    """Distance along each ray to the object's plane, x and y there; True within the outline."""
    x_axis, y_axis, normal = _rotation(item.pose.rotation).T
    middle = np.array(item.pose.position)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((middle - eye) @ normal) / (rays @ normal)
        places = eye + distance[..., np.newaxis] * rays - middle
        x, y = places @ x_axis, places @ y_axis
        if isinstance(item.shape, Rectangle):
            inside = (abs(x) <= item.shape.width / 2) & (abs(y) <= item.shape.height / 2)
        elif isinstance(item.shape, Disc):
            inside = np.hypot(x, y) <= item.shape.diameter / 2
        else:
            inside = abs(np.hypot(x, y) - item.shape.diameter / 2) <= item.shape.width / 2
        return distance, x, y, inside & (distance > 0)


def _pattern(item: Surface | Mask, x: Array, y: Array, time: Array) -> Array:
    """Reflectance or transmittance at a time."""
    pattern, shape = item.pattern, item.shape
    if isinstance(pattern, Plain):
        return np.full(x.shape, pattern.level)
    if isinstance(shape, Ring):
        per_turn = max(1, round(pattern.frequency * np.pi * shape.diameter))
        turns = np.arctan2(y, x) / (2 * np.pi) - item.speed * time / (np.pi * shape.diameter)
        periods, across = per_turn * turns, np.hypot(x, y) - shape.diameter / 2
    else:
        periods, across = pattern.frequency * (x - item.speed * time), y
    if isinstance(pattern, Cosine):
        wave = 0.5 + 0.5 * np.cos(2 * np.pi * periods - pattern.phase)
        return np.asarray(pattern.low + (pattern.high - pattern.low) * wave)
    if isinstance(pattern, Grating):
        away = periods - pattern.phase / (2 * np.pi)
        return np.where(abs(away - np.round(away)) < pattern.duty / 2, pattern.high, pattern.low)
    assert isinstance(pattern, Picture)
    rows, columns = pattern.levels.shape
    line = np.floor((across / pattern.height + 0.5) * rows).astype(int) % rows
    column = np.floor(((periods + 0.5) % 1) * columns).astype(int) % columns
    return np.asarray(pattern.levels[line, column])


def _lit(source: Source, surface: Surface, points: Array, eye: Array) -> Array:
    """Light of a source reflected by a white diffuse surface."""
    shape = source.shape
    if isinstance(shape, Rectangle):
        area = shape.width * shape.height
    elif isinstance(shape, Disc):
        area = np.pi * (shape.diameter / 2) ** 2
    else:
        area = np.pi / 4 * ((shape.diameter + shape.width) ** 2 - (shape.diameter - shape.width) ** 2)
    way = np.array(source.pose.position) - points
    square = (way**2).sum(axis=-1)
    normal = _rotation(surface.pose.rotation)[:, 2]
    if (eye - np.array(surface.pose.position)) @ normal < 0:
        normal = -normal
    facing = np.clip(way @ normal / np.sqrt(square), 0, None)
    leaving = abs(way @ _rotation(source.pose.rotation)[:, 2]) / np.sqrt(square)
    return np.asarray(source.intensity * area * leaving**source.directivity * facing / (np.pi * square))


class _Views:
    """Visible objects of every pixel in one frame: geometry without light."""

    def __init__(self, scene: Scene, frame_start: float) -> None:
        lens = scene.lens
        x, y = np.meshgrid(np.arange(lens.columns), np.arange(lens.rows))
        focal = lens.focal_length / lens.pixel_pitch
        middle = lens.principal_point or ((lens.columns - 1) / 2, (lens.rows - 1) / 2)
        rays = np.stack([(x - middle[0]) / focal, (y - middle[1]) / focal, np.ones(x.shape)], axis=-1)
        rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ _rotation(lens.pose.rotation).T
        eye = np.array(lens.pose.position) + frame_start * np.array(lens.velocity)
        self.items: list[Source | Surface] = [*scene.sources, *scene.surfaces]
        nearest = np.full(x.shape, np.inf)
        seen = np.full(x.shape, -1)
        for index, item in enumerate(self.items):
            distance, _, _, inside = _meet(item, eye, rays)
            before = inside & (distance < nearest)
            nearest[before], seen[before] = distance[before], index
        self.pixels = [np.nonzero(seen == index) for index in range(len(self.items))]
        self.loss = [self._loss(item, nearest[pixels]) for item, pixels in zip(self.items, self.pixels, strict=True)]
        self.places = [_meet(item, eye, rays[at])[1:3] for item, at in zip(self.items, self.pixels, strict=True)]
        self.lit = [
            self._lit(scene, item, eye + nearest[at][:, np.newaxis] * rays[at], eye)
            for item, at in zip(self.items, self.pixels, strict=True)
        ]
        self.masks = []
        for mask in scene.masks:
            distance, across, down, inside = _meet(mask, eye, rays)
            pixels = np.nonzero(inside & (distance < nearest))
            self.masks.append((pixels, across[pixels], down[pixels]))

    @staticmethod
    def _loss(item: Source | Surface, distance: Array) -> Array:
        loss = item.path_loss
        return np.asarray((loss.reference / distance) ** loss.exponent * np.exp(-loss.attenuation * distance))

    @staticmethod
    def _lit(scene: Scene, item: Source | Surface, points: Array, eye: Array) -> list[Array]:
        if not isinstance(item, Surface) or not item.lit_by_sources:
            return []
        return [_lit(source, item, points, eye) for source in scene.sources]


def render_scene(scene: Scene, frames: int = 1, start: float = 0.0, subexposures: int = 64) -> Array:
    """Linear light v = A * T_e * p of eq. 4 (DN above dark), float64 (frames, rows, columns).

    Eqs. 1-3 and 5-7 for every pixel at the middles of ``subexposures`` equal parts of its row's exposure, averaged: no
    bounding boxes, no gain maps, no closed-form integrals. A pixel shows the nearest object along the ray through its
    centre; masks in front of it multiply.
    """
    lens, camera = scene.lens, scene.camera
    result = np.zeros((frames, lens.rows, lens.columns))
    views = _Views(scene, start)
    for frame in range(frames):
        frame_start = start + frame * (camera.frame_time or 0.0)
        if frame and any(lens.velocity):
            views = _Views(scene, frame_start)
        ends = frame_start + np.arange(lens.rows) * camera.row_period
        for part in (np.arange(subexposures) + 0.5) / subexposures:
            result[frame] += _light(scene, views, ends - scene.exposure * (1 - part))
    return np.asarray(result * (scene.sensor.gain * scene.exposure / subexposures))


def _light(scene: Scene, views: _Views, times: Array) -> Array:
    """Light on every pixel at the time of its row."""
    light = np.zeros((scene.lens.rows, scene.lens.columns))
    courses = [sample_waveform(source.waveform, times) for source in scene.sources]
    ambient = scene.ambient.intensity * sample_waveform(scene.ambient.waveform, times)
    for index, item in enumerate(views.items):
        pixels = views.pixels[index]
        if isinstance(item, Source):
            emitted = item.intensity * courses[index][pixels[0]]
        else:
            falling = ambient[pixels[0]]
            for course, share in zip(courses, views.lit[index], strict=False):
                falling = falling + share * course[pixels[0]]
            emitted = falling * _pattern(item, *views.places[index], times[pixels[0]])
        light[pixels] = emitted * views.loss[index]
    for mask, (pixels, x, y) in zip(scene.masks, views.masks, strict=True):
        light[pixels] *= _pattern(mask, x, y, times[pixels[0]])
    return light


def _pattern_light(item: Surface | Mask, x: float, y: float) -> Waveform:
    """Reflectance or transmittance at a point as a waveform."""
    pattern, shape = item.pattern, item.shape
    if isinstance(pattern, Plain):
        return Constant(pattern.level)
    if isinstance(shape, Ring):
        per_turn = max(1, round(pattern.frequency * np.pi * shape.diameter))
        place, rate = per_turn * np.arctan2(y, x) / (2 * np.pi), per_turn * item.speed / (np.pi * shape.diameter)
    else:
        place, rate = pattern.frequency * x, pattern.frequency * item.speed
    if rate == 0:
        return Constant(float(_pattern(item, np.array([x]), np.array([y]), np.zeros(1))[0]))
    if isinstance(pattern, Picture):
        across = np.hypot(x, y) - shape.diameter / 2 if isinstance(shape, Ring) else y
        rows, columns = pattern.levels.shape
        levels = pattern.levels[int(np.floor((across / pattern.height + 0.5) * rows)) % rows]
        place += 0.5  # from the picture's left edge
        # for rate > 0, place - rate * t runs through the columns backwards
        levels = levels[::-1] if rate > 0 else levels
        begin = (place - np.ceil(place)) / rate if rate > 0 else (np.floor(place) - place) / abs(rate)
        return Chips(levels, abs(rate) * columns, start=begin, repeat=True)
    phase = (pattern.phase - 2 * np.pi * place) * np.sign(rate)
    swing = pattern.high - pattern.low
    if isinstance(pattern, Cosine):
        return Constant(pattern.low) + swing * Tone(abs(rate), phase=phase)
    return Constant(pattern.low) + swing * SquareWave(abs(rate), duty=pattern.duty, phase=phase)


def exact_scene(scene: Scene, frames: int = 1, start: float = 0.0) -> Array:
    """`render_scene` with exact integrals: one waveform per pixel. For small frames of a sharp lens."""
    lens, camera = scene.lens, scene.camera
    if lens.blur:
        raise ValueError(f"blur: got {lens.blur}, allowed: 0")
    result = np.zeros((frames, lens.rows, lens.columns))
    for frame in range(frames):
        views = _Views(scene, start + frame * (camera.frame_time or 0.0))
        masks = _mask_light(scene, views)
        for index, item in enumerate(views.items):
            for count, (row, column) in enumerate(zip(*views.pixels[index], strict=True)):
                light = _item_light(scene, views, index, item, count)
                factors = [light, *masks.get((row, column), [])]
                p = integrate_exposure(
                    Product(factors), camera, [row], start=start, frames=[frame] if frame else None
                ).item()
                result[frame, row, column] = scene.sensor.gain * scene.exposure * views.loss[index][count] * p
    return result


def _mask_light(scene: Scene, views: _Views) -> dict[tuple[int, int], list[Waveform]]:
    """Masks in front of each pixel."""
    found: dict[tuple[int, int], list[Waveform]] = {}
    for mask, (pixels, x, y) in zip(scene.masks, views.masks, strict=True):
        for count, place in enumerate(zip(*pixels, strict=True)):
            found.setdefault(place, []).append(_pattern_light(mask, x[count], y[count]))
    return found


def _item_light(scene: Scene, views: _Views, index: int, item: Source | Surface, count: int) -> Waveform:
    """Light of an object's pixel before path loss and masks."""
    if isinstance(item, Source):
        return item.intensity * item.waveform
    falling = scene.ambient.intensity * scene.ambient.waveform
    for source, share in zip(scene.sources, views.lit[index], strict=False):
        falling = falling + float(share[count]) * source.waveform
    x, y = views.places[index]
    return falling * _pattern_light(item, float(x[count]), float(y[count]))
