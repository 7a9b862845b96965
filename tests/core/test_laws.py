"""Laws of every function of frames: layout in memory, type of the samples, read-out direction, threads, unit of light,
tone curve, columns; and of every class of values.

One list of operators, one list of laws. A law that an operator does not have is named beside it, with the reason.
"""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from test_bad_values import FUNCTIONS, call

import ocisac_fast as ocisac
from ocisac_fast import Camera, Chips, Flag, SquareWave, integrate_exposure
from ocisac_fast.camera import linear_light
from ocisac_fast.chips import find_channel
from ocisac_fast.core import as_columns

Array = npt.NDArray[Any]
RANDOM = np.random.default_rng(5)
CAMERA = Camera(2e-5, exposure=1e-4, frame_time=1 / 30, white_level=255.0)
ROWS, COLUMNS = 361, 131  # neither a multiple of a vector
ALONG = np.linspace(0.5, 1.0, COLUMNS)


def bytes_of(light: Array) -> Array:
    return np.clip(np.rint(light + RANDOM.standard_normal(light.shape)), 0, 255).astype(np.uint8)


def lamp(waveform: ocisac.Waveform, frames: int = 1, start: float = 0.0) -> Array:
    light = integrate_exposure(waveform, CAMERA, ROWS, start=start, frames=frames)
    return bytes_of(20 + 150 * light[:, :, None] * ALONG)[0 if frames == 1 else slice(None)]


SQUARE = lamp(SquareWave(700.0))
DATA = lamp(Chips("01101000101110100110" * 9, 4000.0, repeat=True))
MOVING = lamp(SquareWave(170.0), frames=3)
PICTURE = bytes_of((SQUARE[:240, :96] // 2) * (1 + np.hypot(*np.mgrid[-1:1:240j, -1:1:96j]) / 2))
CHIP_FIT = find_channel(DATA[:, -1].astype(float), rows_per_chip=12.5)


@dataclasses.dataclass(frozen=True)
class Operator:
    """A function of frames and camera.

    Attributes:
        stored: its answer is in pixels as stored, which another read-out direction changes.
        exact: relative difference of answers for samples of other types; 0: not a bit; None: other rows are added.
        unit: the answer's numbers that have the unit of light; None: the unit counts (noise of whole numbers, levels).
    """

    call: Callable[..., Any]
    frames: Array
    stored: bool = False
    exact: float | None = 0.0
    unit: tuple[str, ...] | None = ()
    threads: bool = False


def kept(result: Any, *names: str) -> dict[str, Any]:
    """Pictures of a result, which are as stored."""
    return {name: getattr(result, name) for name in names}


def tone_gain(**options: Any) -> Callable[..., Any]:
    return lambda frames, camera, **more: ocisac.tone_gain(frames, camera, 700.0, **options, **more)


OPERATORS = {
    "tone_gain": Operator(tone_gain(), SQUARE, exact=3e-3, unit=("mean",), threads=True),
    "tone_gain, square": Operator(tone_gain(waveform="square"), SQUARE, exact=3e-3, unit=("mean",), threads=True),
    "tone_gain, robust": Operator(tone_gain(method="robust"), SQUARE, exact=3e-3, unit=("mean",), threads=True),
    "tone_gain, dft": Operator(tone_gain(method="dft"), SQUARE, exact=1e-9, unit=("mean",), threads=True),
    "tone_gain, pooled": Operator(tone_gain(pooled=True), SQUARE, exact=3e-3, unit=("mean",), threads=True),
    "tone_gain, fast": Operator(tone_gain(efficiency=0.9), SQUARE, exact=None, unit=("mean",), threads=True),
    "tone_gain, frames": Operator(tone_gain(), MOVING, exact=3e-3, unit=("mean",), threads=True),
    "varying_tone_gain": Operator(
        lambda f, c, **more: ocisac.varying_tone_gain(f, c, 700.0, **more),
        SQUARE,
        exact=1e-3,
        unit=("mean",),
        threads=True,
    ),
    "find_frequency": Operator(ocisac.find_frequency, SQUARE, exact=1e-6),
    "tone_columns": Operator(lambda f, c: ocisac.tone_columns(f, c, 700.0), SQUARE, exact=1e-9),
    "equalize": Operator(
        lambda f, c, **more: {"light": ocisac.equalize(f, c, **more)}, DATA, unit=("light",), threads=True
    ),
    "equalize, wiener": Operator(
        lambda f, c, **more: {"light": ocisac.equalize(f, c, method="wiener", **more)},
        DATA[:, :9],
        unit=None,
        threads=True,
    ),
    "linear_light": Operator(lambda f, c: {"light": linear_light(f, c)}, DATA, unit=("light",)),
    "detect_sources": Operator(ocisac.detect_sources, PICTURE, stored=True, exact=1e-3, unit=None),
    "receive": Operator(lambda f, c: ocisac.receive(f, c, chip_rate=4000.0), DATA, exact=1e-3, unit=None),
    "detect_chips": Operator(
        lambda f, c: {"llr": ocisac.detect_chips(f, c, CHIP_FIT.channel).llr}, DATA, exact=1e-9, unit=None
    ),
    "sense_region": Operator(
        lambda f, c: ocisac.sense_region(f, c, 170.0), MOVING, stored=True, exact=1e-2, unit=("mean",)
    ),
    "background_light": Operator(lambda f, c: ocisac.background_light(f, c), SQUARE, exact=1e-9, unit=("mean", "std")),
    "remove_bands": Operator(
        lambda f, c: kept(ocisac.remove_bands(f, c), "frames", "marks"), PICTURE[:150, :24], exact=None, unit=None
    ),
    "subtract_still": Operator(lambda f, c: {"light": ocisac.subtract_still(f, c)}, MOVING, unit=("light",)),
    "Receiver": Operator(lambda f, c: ocisac.Receiver(c, chip_rate=4000.0).push(f), DATA, exact=1e-3, unit=None),
    "MultiReceiver": Operator(
        lambda f, c: ocisac.MultiReceiver(c, chip_rate=4000.0).push(f), DATA, stored=True, exact=1e-3, unit=None
    ),
}

# Other rows are added; pixels as stored serve for a frequency; stored values are restored.
CURVED = {"tone_gain, fast", "find_frequency", "tone_columns", "remove_bands", "detect_sources"}
BY_COLUMN = ("tone_gain", "varying_tone_gain", "equalize", "linear_light", "detect_chips", "background_light")
APART = [name for name in OPERATORS if name.startswith(BY_COLUMN) and not name.endswith(("robust", "pooled"))]
VALUES = [name for name, kind in FUNCTIONS.items() if dataclasses.is_dataclass(kind)]
SUMMED = {"tone_gain, pooled", "tone_gain, robust", "background_light", "sense_region", "detect_sources"}  # as stored


def numbers(value: Any, name: str = "") -> Iterator[tuple[str, Array]]:
    """The arrays of an answer, by name; texts and flags as they are."""
    if dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        for key, one in value.items():
            yield from numbers(one, f"{name}.{key}".strip("."))
    elif isinstance(value, list):
        for k, one in enumerate(value):
            yield from numbers(one, f"{name}[{k}]")
    else:
        yield name, np.asarray(value)


def assert_same(got: Any, want: Any, difference: float = 0.0, factors: dict[str, float] | None = None) -> None:
    found, expected = (list(numbers(value)) for value in (got, want))
    assert [name for name, _ in found] == [name for name, _ in expected]
    for (name, one), (_, other) in zip(found, expected, strict=True):
        if difference == 0.0 or other.dtype.kind != "f":
            np.testing.assert_array_equal(one, other, err_msg=name)
            continue
        scaled = other * (factors or {}).get(name, 1.0)
        turned = np.angle(np.exp(1j * (one - scaled))) if "phase" in name else one - scaled
        size = 1.0 if "phase" in name else np.abs(scaled[np.isfinite(scaled)]).max(initial=1e-300)
        np.testing.assert_array_equal(np.isnan(one), np.isnan(scaled), err_msg=name)
        assert not np.any(np.abs(turned) > difference * size), (name, np.nanmax(np.abs(turned)) / size)


def layouts(frames: Array) -> Iterator[tuple[str, Array]]:
    """The same samples elsewhere in memory, in views that must not be written."""
    wide = np.zeros((*frames.shape[:-2], 2 * frames.shape[-2], 3 * frames.shape[-1]), frames.dtype)
    wide[..., ::2, ::3] = frames
    pictures = {f"one of {k} colours": np.full((*frames.shape, k), 77, frames.dtype) for k in (2, 3, 4, 5)}
    for picture in pictures.values():
        picture[..., 1] = frames
    backwards = np.ascontiguousarray(frames[..., ::-1, ::-1])[..., ::-1, ::-1]
    foreign = frames.astype(frames.dtype.newbyteorder())
    unaligned = np.frombuffer(b"x" + frames.tobytes(), frames.dtype, offset=1).reshape(frames.shape)
    off = np.zeros(frames.size + 3, frames.dtype)[3:].reshape(frames.shape)
    off[...] = frames
    columns_first = np.ascontiguousarray(frames.swapaxes(-1, -2)).swapaxes(-1, -2)
    views = {name: picture[..., 1] for name, picture in pictures.items()}
    views |= {"gaps": wide[..., ::2, ::3], "backwards": backwards, "off": off, "columns first": columns_first}
    views |= {"bytes of another order": foreign, "unaligned": unaligned}
    for name, view in views.items():
        view.flags.writeable = False
        yield name, view


@pytest.mark.parametrize("name", OPERATORS)
@pytest.mark.parametrize(
    ("dtype", "curve"), [("uint8", "linear"), ("uint16", "srgb"), ("float32", "linear"), ("float64", "srgb")]
)
def test_the_layout_in_memory_changes_nothing(name: str, dtype: Any, curve: Any) -> None:
    operator = OPERATORS[name]
    camera = dataclasses.replace(CAMERA, tone_curve=curve)
    frames = operator.frames.astype(dtype)
    want = operator.call(frames, camera)
    for layout, view in layouts(frames):
        difference = 1e-9 if name in SUMMED else 0.0
        try:
            assert_same(operator.call(view, camera), want, difference)
        except AssertionError as error:
            raise AssertionError(f"{layout}: {error}") from error


@pytest.mark.parametrize("name", [name for name, one in OPERATORS.items() if not one.stored])
@pytest.mark.parametrize("axis", ["-y", "x", "-x"])
def test_the_read_out_direction_is_that_of_the_camera(name: str, axis: Any) -> None:
    operator = OPERATORS[name]
    turned = operator.frames.swapaxes(-1, -2) if axis.endswith("x") else operator.frames
    turned = turned[..., ::-1] if axis == "-x" else turned[..., ::-1, :] if axis == "-y" else turned
    got = operator.call(turned, dataclasses.replace(CAMERA, scan_axis=axis))
    want = operator.call(operator.frames, CAMERA)
    if isinstance(want, dict):
        got = {key: value if key == "llr" else as_columns(value, scan_axis=axis) for key, value in got.items()}
    assert_same(got, want, 1e-9)


@pytest.mark.parametrize("name", [name for name, one in OPERATORS.items() if one.exact is not None])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32, np.float64])
def test_samples_of_another_type_are_the_same_light(name: str, dtype: Any) -> None:
    operator = OPERATORS[name]
    got, want = (operator.call(operator.frames.astype(kind), CAMERA) for kind in (dtype, np.uint8))
    assert operator.exact is not None
    assert_same(got, want, operator.exact)


@pytest.mark.parametrize("name", OPERATORS)
@pytest.mark.parametrize("dtype", ["<i4", ">i4", "u4", "i8", ">u8"])
def test_integers_of_other_types_are_those_of_16_bits_with_their_white_level(name: str, dtype: str) -> None:
    operator, camera = OPERATORS[name], dataclasses.replace(CAMERA, white_level=None)
    frames = np.clip(400.0 * operator.frames, 0, 65535).astype(np.uint16)
    want = operator.call(frames, camera)
    assert_same(operator.call(frames.astype(dtype), camera), want)
    if name == "tone_gain":
        assert (want.flags & Flag.SATURATED).any()


@pytest.mark.parametrize("name", [name for name, one in OPERATORS.items() if one.threads])
def test_threads_change_nothing(name: str) -> None:
    operator = OPERATORS[name]
    one, four = (operator.call(operator.frames, CAMERA, threads=threads) for threads in (1, 4))
    assert_same(four, one)


@pytest.mark.parametrize("name", [name for name, one in OPERATORS.items() if one.unit is not None])
def test_the_unit_of_light_is_that_of_the_samples(name: str) -> None:
    operator = OPERATORS[name]
    light, camera = operator.frames.astype(np.float64), dataclasses.replace(CAMERA, white_level=None)
    got, want = (operator.call(factor * light, camera) for factor in (2.0**-9, 1.0))
    assert_same(got, want, 1e-9, dict.fromkeys(operator.unit or (), 2.0**-9))


@pytest.mark.parametrize("name", sorted(OPERATORS.keys() - CURVED))
def test_a_tone_curve_is_undone_first(name: str) -> None:
    operator = OPERATORS[name]
    curved = dataclasses.replace(CAMERA, tone_curve="gamma", gamma=2.0, dark_level=5.0)
    light = linear_light(operator.frames, curved)
    got, want = operator.call(operator.frames.astype(np.float64), curved), operator.call(light, CAMERA)
    assert_same(got, want, 1e-9)


@pytest.mark.parametrize("name", APART)
def test_a_column_is_answered_as_alone(name: str) -> None:
    operator = OPERATORS[name]
    every, alone = (dict(numbers(operator.call(operator.frames[..., part], CAMERA))) for part in (slice(None), [5]))
    for key, values in alone.items():
        if values.ndim:
            np.testing.assert_allclose(every[key][..., 5:6], values, rtol=0, atol=1e-12 * np.abs(values).max())


@pytest.mark.parametrize("name", VALUES)
def test_a_value_is_frozen_pickles_and_prints_its_fields(name: str) -> None:
    value = call(name, {})
    assert repr(pickle.loads(pickle.dumps(value))) == repr(value)
    first, *rest = (field.name for field in dataclasses.fields(value) if field.repr)
    assert repr(value).startswith(f"{type(value).__name__}({first}=")
    assert all(f", {field}=" in repr(value) for field in rest)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(value, first, 1)
