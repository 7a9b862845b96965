"""Frames of a planned scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from ocisac_fast import _core
from ocisac_fast.core.checks import Count, Within, checked
from ocisac_fast.scene.description import SceneDescription
from ocisac_fast.scene.plan import Plan, plan_at

Frame = npt.NDArray[Any]


@checked
def render(
    plan: Plan,
    *,
    frames: int | None = None,
    noise: bool = False,
    seed: Annotated[int, Within(0)] = 0,
    threads: Count = 1,
) -> Iterator[Frame]:
    """Render frames of a scene: dark level + v, v = A * T_e * p (eq. 4) within the plan's tolerance.

    Frames start late or early by the sensor's jitter. Its other effects follow in this order: noise (if requested),
    saturation, tone curve, rounding.

    Args:
        plan: from `Scene.plan`.
        frames: number of frames, up to that of the plan; None: all.
        noise: simulate the sensor's shot and read noise.
        seed: of noise and jitter, 0 or above; the same seed gives the same frames.
        threads: 1 or more; the frames do not depend on it.

    Yields:
        (rows, columns): uint8 up to 8 bits, uint16 above, float32 for a sensor without bit depth.

    Raises:
        ValueError: more frames than planned, or noise of a sensor without noise, at the call.
    """
    count = plan.frames if frames is None else frames
    if not 1 <= count <= plan.frames:
        raise ValueError(f"frames: got {count}, allowed: from 1 to {plan.frames}, those of the plan")
    if noise and not plan.scene.sensor.noisy:
        raise ValueError("noise: got True, allowed: False for a sensor without noise")
    return (_frame(plan, number, noise, seed, threads) for number in range(count))


def _frame(plan: Plan, number: int, noise: bool, seed: int, threads: int) -> Frame:
    if number and any(plan.scene.lens.velocity):
        plan = plan_at(plan.scene, plan.tolerance, plan.frames, plan.start, number)
    scene, sensor = plan.scene, plan.scene.sensor
    random = np.random.default_rng([seed, number]) if noise else None
    shape = (scene.lens.rows, scene.lens.columns)
    dark, jitter = scene.camera.dark_level, sensor.frame_jitter
    late = float(np.random.default_rng([seed, number, 1]).uniform(-jitter, jitter)) if jitter else 0.0
    direct = random is None and scene.camera.tone_curve == "linear"
    if direct and sensor.bit_depth is not None:
        frame = np.empty(shape, np.uint8 if sensor.bit_depth <= 8 else np.uint16)
        _fill(plan, number, late, dark, min(scene.white_level, 2**sensor.bit_depth - 1), threads, frame)
        return frame
    light = np.empty(shape, np.float32)
    _fill(plan, number, late, 0.0, scene.white_level, threads, light)
    return respond(scene, light, random)


def _fill(plan: Plan, number: int, late: float, dark: float, white: float, threads: int, out: Frame) -> None:
    camera, start = plan.scene.camera, plan.start + late
    image = plan._base if plan._base is None or not dark else plan._base + np.float32(dark)
    if plan._by_pixel:
        image = np.full(out.shape, dark, np.float32) if image is None else image.copy()
        for pixels in plan._by_pixel:
            image[pixels.rows, pixels.columns] += pixels.light(camera, start, number)
    parts = [part for part, _ in plan._kept]
    tables = [signal.table(camera, start, number) for _, signal in plan._kept]
    _core.render_parts(parts, tables, dark, image, white, threads, out)


def respond(scene: SceneDescription, light: npt.NDArray[np.float32], random: np.random.Generator | None) -> Frame:
    """Convert linear light (DN above dark) to stored values."""
    sensor, dark = scene.sensor, scene.camera.dark_level
    span = scene.white_level - dark
    if random is not None and sensor.full_well is not None:
        electrons = light * (sensor.full_well / span)
        if sensor.shot_noise:
            electrons = random.poisson(np.maximum(electrons, 0)).astype(np.float32)
        if sensor.read_noise:
            electrons += np.float32(sensor.read_noise) * random.standard_normal(light.shape, np.float32)
        light = (electrons * (span / sensor.full_well)).astype(np.float32)
    if sensor.full_well is not None or sensor.bit_depth is not None:
        light = np.minimum(light, np.float32(span))
    values = light + dark
    if scene.camera.tone_curve != "linear":
        values = _core.stored_value(light, scene.camera._handle, scene.white_level)
    if sensor.bit_depth is None:
        return values.astype(np.float32)
    top = 2**sensor.bit_depth - 1
    stored: Frame = np.clip(np.rint(values), 0, top).astype(np.uint8 if sensor.bit_depth <= 8 else np.uint16)
    return stored
